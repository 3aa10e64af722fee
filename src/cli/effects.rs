//! `pitchline effects` and `pitchline sensors`: effects and sensors that a drive file may contain.

use super::{Failure, Outcome, print_json, print_out};
use crate::diag::nearest;
use crate::drive::sensors::{SENSORS, is_signal};
use crate::effects::{EFFECTS, Effect, Kind, Physics, named};
use crate::measurement::units::UNITS;

#[derive(clap::Args, Debug)]
pub struct EffectsArgs {
    /// Print all details of this effect
    name: Option<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args, Debug)]
pub struct SensorsArgs {
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Kinds of drive files that support the effect.
fn fidelities(e: &Effect) -> &'static str {
    match (matches!(e.physics, Physics::LinksOnly), e.links) {
        (true, _) => "links",
        (false, Some(_)) => "lumped, links",
        // Sensors are the same in both.
        (false, None) if is_signal(e) => "lumped, links",
        (false, None) => "lumped",
    }
}

pub fn run(args: &EffectsArgs) -> Result<Outcome, Failure> {
    let chosen: Vec<&'static Effect> = match &args.name {
        None => EFFECTS.to_vec(),
        Some(name) => vec![named(name).ok_or_else(|| {
            let near = nearest(name, EFFECTS.iter().map(|e| e.name));
            let help = near.map_or("`pitchline effects` lists all".to_string(), |n| format!("did you mean `{n}`?"));
            Failure::Input(format!("no effect is called `{name}`\nhelp: {help}"))
        })?],
    };
    if args.json {
        return print_json(&serde_json::json!({ "effects": chosen.iter().map(|e| json(e)).collect::<Vec<_>>() }));
    }
    if args.name.is_some() {
        return print_out(&chosen.iter().map(|e| whole(e)).collect::<String>());
    }
    let mut text = format!("{:<22} {:<9} {:<34} {:<15} what it is\n", "effect", "part", "put on", "drive");
    for e in chosen {
        text +=
            &format!("{:<22} {:<9} {:<34} {:<15} {}\n", e.name, e.part.label(), e.on.label(), fidelities(e), e.title);
    }
    text += "\n`pitchline effects NAME` prints equation, numbers with units and ranges, source and signature\n";
    print_out(&text)
}

fn kind(k: Kind) -> &'static str {
    match k {
        Kind::Amplitude => "amplitude",
        Kind::Shape => "form",
        Kind::Phase => "phase, one for every record",
        Kind::Whole => "whole number or order, not fitted",
        Kind::Index => "which one, not fitted",
        Kind::PerMark => "one for every mark # but the first",
        Kind::Start => "fitted, in every part of a record",
        Kind::Given => "given, not fitted",
        Kind::Tried => "form, tried, not fitted",
    }
}

/// Targets of the effect, for both kinds of drive.
fn put_on(e: &Effect) -> String {
    match e.links {
        Some(on) if on != e.on => format!("{}; with links {}", e.on.label(), on.label()),
        _ => e.on.label().to_string(),
    }
}

fn whole(e: &Effect) -> String {
    let mut text = format!(
        "{}: {}\n  part       {} ({})\n  put on     {}\n  drive      {}\n  equation   {}\n  source     {}\n  order      {}\n  speed law  {}\n  channels   {}\n",
        e.name,
        e.title,
        e.part.label(),
        e.family(),
        put_on(e),
        fidelities(e),
        e.equation,
        e.source,
        e.order,
        e.speed_law,
        e.channels
    );
    text += &format!("  [effects.{}.TARGET]\n", e.name);
    for p in e.parameters {
        let default = p.default.map_or(String::new(), |d| format!(", {d} if not given"));
        let of_slides = p.sliding_default.map_or(String::new(), |d| format!(", {d} if not given"));
        let sliding = match p.key == p.sliding_key {
            true => String::new(),
            false => format!(" (`{}` on a slider{of_slides})", p.sliding_key),
        };
        text += &format!(
            "    {:<26} {} ..= {}, off at {}{default}; {}{}{sliding}\n",
            p.key,
            p.low,
            p.high,
            p.off,
            kind(p.kind),
            p.on_links.map_or(String::new(), |p| format!("; with links {}", kind(p.kind)))
        );
    }
    text
}

fn json(e: &Effect) -> serde_json::Value {
    let parameters: Vec<_> = e
        .parameters
        .iter()
        .map(|p| {
            serde_json::json!({
                "key": p.key, "sliding_key": p.sliding_key, "low": p.low, "high": p.high, "off": p.off,
                "default": p.default, "sliding_default": p.sliding_default, "kind": kind(p.kind), "unit_si": p.unit,
            })
        })
        .collect();
    serde_json::json!({
        "name": e.name, "title": e.title, "part": e.part.label(), "on": e.on.label(), "drive": fidelities(e),
        "equation": e.equation, "source": e.source, "order": e.order, "speed_law": e.speed_law,
        "channels": e.channels, "dissipative": e.dissipative, "parameters": parameters,
    })
}

pub fn sensors(args: &SensorsArgs) -> Result<Outcome, Failure> {
    if args.json {
        let list: Vec<_> = SENSORS
            .iter()
            .map(|kind| {
                serde_json::json!({
                    "kind": kind.name, "reads": kind.reads, "unit": kind.unit, "keys": kind.keys,
                    "lumped": kind.lumped.is_some(), "links": kind.links.is_some(),
                    "angle_errors": kind.has_angle_errors,
                })
            })
            .collect();
        let units: Vec<&str> = UNITS.iter().map(|(n, ..)| *n).collect();
        return print_json(&serde_json::json!({ "sensors": list, "units": units }));
    }
    let mut text = String::new();
    for kind in &SENSORS {
        let drives = match (kind.lumped.is_some(), kind.links.is_some()) {
            (true, true) => "",
            (true, false) => "; lumped drives",
            (false, true) => "; drives with links",
            (false, false) => "; no drive",
        };
        let w = 14_usize.saturating_sub(kind.name.len());
        text += &format!("[sensors.{}.NAME]{:<w$} {} ({}{drives})\n", kind.name, "", kind.reads, kind.unit);
        text += &format!("{:29}keys: {}\n", "", kind.keys);
    }
    text += "\nall have `gain`, and `unit` for a unit of their own; keys that name what is read are needed where NAME is not its name\n";
    text += &format!("units of measured columns: {}\n", UNITS.map(|(n, ..)| n).join(", "));
    text += "their errors are effects: `pitchline effects`, part sensor\n";
    print_out(&text)
}
