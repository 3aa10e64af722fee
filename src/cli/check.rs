//! `pitchline check`: reads and assembles a drive, and prints derived quantities.

use super::{Failure, Outcome, assemble, load_drive, print_json, print_out};
use crate::elements::link_joint::LinkJoint;
use crate::geometry::smartchain::Abutment;
use crate::machine::Machine;
use crate::model::{Model, SprocketModel};
use std::f64::consts::PI;
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(clap::Args, Debug)]
pub struct CheckArgs {
    /// Drive file or bundled name
    drive: String,
    /// Replace a value of the drive
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Print the drive's text as this version reads it, where an earlier one read it otherwise; comments and layout stay
    #[arg(long, conflicts_with_all = ["set", "json"])]
    migrate: bool,
    /// With --migrate: the file to write, instead of printing it
    #[arg(short, long, value_name = "FILE", requires = "migrate")]
    output: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &CheckArgs) -> Result<Outcome, Failure> {
    if args.migrate {
        return migrate(args);
    }
    let (name, text) = super::drive_text(&args.drive)?;
    if crate::machine::is_lumped(&text) {
        return check_lumped(args, &name, &text);
    }
    let drive = load_drive(&args.drive, &args.set)?;
    let assembly = assemble(&drive)?;
    let (model, report) = (&assembly.model, &assembly.report);
    let rows: Vec<_> = model
        .rows
        .iter()
        .map(|r| {
            serde_json::json!({
                "name": r.name,
                "pitch_mm": r.pitch_m * 1e3,
                "mass_g": r.mass_kg * 1e3,
                "inertia_g_mm2": r.inertia_kg_m2 * 1e9,
            })
        })
        .collect();
    let bounds = centre_distances(model);
    let abutments = || model.abutments.iter().flatten();
    let first = abutments().next();
    if args.json {
        return print_json(&serde_json::json!({
            "drive": drive.name,
            "title": drive.title,
            "links": model.chain.n_links,
            "rows": rows,
            "mass_per_length_kg_m": mass_per_length(model),
            "chain_speed_m_s": model.chain_speed_m_s(),
            "centre_distances_mm": bounds.iter().map(|(n, d)| serde_json::json!({ "between": n, "mm": d * 1e3 })).collect::<Vec<_>>(),
            "joint_damping_ratio_at_1_khz": joint_damping_ratio(model),
            "abutment_planes": first.map(Abutment::planes),
            "guide_overlap_um": first.map(|a| a.guide_overlap_m * 1e6),
            "assembly": report,
            "values": drive.places.paths().collect::<Vec<_>>(),
        }));
    }
    let mut text = String::new();
    let _infallible = writeln!(text, "{}: {}", drive.name, drive.title)
        .and_then(|()| {
            writeln!(
                text,
                "  chain                {} links, {:.3} kg/m, {:.3} m/s",
                model.chain.n_links,
                mass_per_length(model),
                model.chain_speed_m_s()
            )
        })
        .and_then(|()| {
            model.rows.iter().try_for_each(|r| {
                writeln!(
                    text,
                    "  {:<5} link           pitch {:.4} mm, {:.3} g, {:.2} g mm2",
                    r.name,
                    r.pitch_m * 1e3,
                    r.mass_kg * 1e3,
                    r.inertia_kg_m2 * 1e9
                )
            })
        })
        .and_then(|()| {
            abutments().try_for_each(|a| {
                writeln!(text, "  abutments            {} planes across the width", a.planes())?;
                if a.guide_overlap_m > 0.0 {
                    let (rise_um, overlap_um) = (a.rise_m * 1e6, a.guide_overlap_m * 1e6);
                    writeln!(
                        text,
                        "    hollow             guide {rise_um:.2} um lower, rear ones {overlap_um:.2} um into it"
                    )?;
                }
                Ok(())
            })
        })
        .and_then(|()| {
            bounds.iter().try_for_each(|(n, d)| writeln!(text, "  centre distance      {n}: {:.4} mm", d * 1e3))
        })
        .and_then(|()| {
            writeln!(
                text,
                "  joint damping        ratio {:.3} % of a mode at 1 kHz",
                joint_damping_ratio(model) * 100.0
            )
        })
        .and_then(|()| {
            report.lines().iter().try_for_each(|line| writeln!(text, "  {}", line.replacen(" = ", ": ", 1)))
        });
    print_out(&text)
}

/// The text of an earlier version's drive as this version reads it.
fn migrate(args: &CheckArgs) -> Result<Outcome, Failure> {
    super::check_outputs(args.output.as_deref(), [Path::new(&args.drive)])?;
    let (name, text) = super::drive_text(&args.drive)?;
    let (new, changes) = super::migrate::migrated(&name, &text)?;
    for change in &changes {
        eprintln!("changed: {change}");
    }
    if changes.is_empty() {
        eprintln!("{name} is read as it is");
    }
    match &args.output {
        None => print_out(&new),
        Some(path) => {
            crate::output::write(path, new.as_bytes())?;
            print_out(&format!("wrote {}\n", path.display()))
        }
    }
}

fn mass_per_length(model: &Model) -> f64 {
    // Unused lanes have neither mass nor length.
    model.chain.mass.iter().sum::<f64>() / (2.0 * model.chain.lever.iter().sum::<f64>())
}

/// zeta = c omega / (2 k): joints are springs in series, each with its damper.
fn joint_damping_ratio(model: &Model) -> f64 {
    let ratio = |joint: &LinkJoint| joint.damping_n_s_per_m * 2.0 * PI * 1000.0 / (2.0 * joint.stiffness_n_per_m);
    model.chain.joints.first().map_or(f64::NAN, ratio)
}

fn centre_distances(model: &Model) -> Vec<(String, f64)> {
    let mut all = Vec::new();
    for chain in 0..model.chain.loops.len() {
        let own: Vec<&SprocketModel> = model.sprockets.iter().filter(|s| s.chain == chain).collect();
        let pairs = own.iter().zip(own.iter().cycle().skip(1)).take(if own.len() == 2 { 1 } else { own.len() });
        all.extend(pairs.map(|(a, b)| (format!("{} to {}", a.name, b.name), (a.frame.origin - b.frame.origin).norm())));
    }
    all
}

/// A lumped drive: its bodies and what joins them. It has no links to assemble.
fn check_lumped(args: &CheckArgs, name: &str, text: &str) -> Result<Outcome, Failure> {
    let machine = Machine::parse(name, text, &args.set).map_err(|report| Failure::Input(report.to_string()))?;
    let value = |slot: Option<usize>| slot.and_then(|s| machine.values.get(s).copied());
    let springs = || machine.springs.iter().map(|s| (s, machine.spring_numbers(&machine.values, s)));
    if args.json {
        let inertia = |slides: bool| if slides { "mass_kg" } else { "inertia_kg_m2" };
        return print_json(&serde_json::json!({
            "drive": machine.name,
            "title": machine.title,
            "fidelity": "lumped",
            "bodies": machine.bodies.iter().map(|b| serde_json::json!({
                "name": b.name, "teeth": b.teeth, inertia(b.slides): value(b.inertia),
            })).collect::<Vec<_>>(),
            "springs": springs().map(|(s, (stiffness, damping))| serde_json::json!({
                "name": s.name, "stiffness": stiffness, "damping": damping,
            })).collect::<Vec<_>>(),
            "sensors": machine.sensors.iter().map(|s| &s.path).collect::<Vec<_>>(),
        }));
    }
    let mut said = format!(
        "{}: {}\n  lumped: no links to simulate; `pitchline identify` holds it against records\n",
        machine.name, machine.title
    );
    for b in &machine.bodies {
        let (what, unit) = if b.slides { ("mass", "kg") } else { ("inertia", "kg m2") };
        let size = value(b.inertia).map_or(String::new(), |v| format!(", {what} {v:.6} {unit}"));
        let teeth = b.teeth.map_or(String::new(), |z| format!(", {z} teeth"));
        let _infallible = writeln!(said, "  body `{}`{teeth}{size}", b.name);
    }
    for (s, (stiffness, damping)) in springs() {
        let _infallible =
            writeln!(said, "  spring `{}`: stiffness {stiffness:.5e}, damping {damping:.5e} (SI)", s.name);
    }
    let _infallible = writeln!(said, "  {} sensors, {} effects", machine.sensors.len(), machine.placed.len());
    print_out(&said)
}
