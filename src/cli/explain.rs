//! `pitchline explain`: the free body of one link at one instant, and the origin of its contacts.

use super::run::instant;
use super::{Answer, Failure, Outcome, answer};
use crate::analysis::explain::{FreeBody, explain, of_joint};
use crate::recording::frame::Feature;
use crate::render::{free_body, png};
use crate::replay::Replay;
use std::path::{Path, PathBuf};

#[derive(clap::Args, Debug)]
pub struct ExplainArgs {
    /// Recording (.mcap)
    recording: PathBuf,
    /// Number of the link
    #[arg(long, required_unless_present = "impact")]
    link: Option<usize>,
    /// The instant, e.g. 12.342ms
    #[arg(long, value_parser = instant, required_unless_present = "impact")]
    at: Option<f64>,
    /// At the peak of this impact instead: a number from `pitchline impacts`
    #[arg(long, value_name = "N", conflicts_with_all = ["link", "at"])]
    impact: Option<usize>,
    /// Drawing to write, .svg or .png
    #[arg(short, long = "output", value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &ExplainArgs) -> Result<Outcome, Failure> {
    super::open_recording(&args.recording)?;
    let mut replay = Replay::open(&args.recording)?;
    let (link, t_s) = match (args.impact, args.link, args.at) {
        (Some(number), _, _) => {
            let impact = super::impacts::numbered(&mut replay.reader, number)?;
            (impact.link as usize, impact.t_s + impact.peak_after_s)
        }
        (None, Some(link), Some(t_s)) => (link, t_s),
        _ => return Err(Failure::Input("give --link with --at, or --impact".into())),
    };
    let links = replay.header().links.len();
    if link >= links {
        return Err(Failure::Input(format!("there is no link {link}; they are numbered 0 to {}", links - 1)));
    }
    let ends = replay.reader.ends()?;
    let step = replay.step_at(t_s);
    let (first, last) = ends.map_or((0, 0), |(first, last)| (first.step, last.step));
    if !(first..=last).contains(&step) {
        let ms = |step: u64| step as f64 * replay.model.step_s * 1e3;
        return Err(Failure::Input(format!(
            "{:.4} ms lies outside the recording, which goes from {:.4} to {:.4} ms",
            t_s * 1e3,
            ms(first),
            ms(last)
        )));
    }
    let body = explain(&mut replay, link, step)?;
    if let Some(path) = &args.output {
        draw(path, &args.recording, &mut replay, &body)?;
    }
    let found = if args.json {
        Answer::Json(serde_json::json!(body))
    } else {
        let drawn = args.output.iter().map(|path| format!("  drawn in {}\n", path.display()));
        Answer::Text(text(&body) + &drawn.collect::<String>())
    };
    answer(&[&replay.reader], found, Outcome::Done)
}

fn draw(path: &Path, recording: &Path, replay: &mut Replay, body: &FreeBody) -> Result<(), Failure> {
    let shown = path.display();
    super::check_outputs([path], [recording])?;
    let frame = replay.frame_of_step(body.step)?;
    let svg = free_body::svg(replay.header(), body, &frame);
    let bytes = match path.extension().and_then(|e| e.to_str()) {
        Some("svg") => svg.into_bytes(),
        Some("png") => png::encode(&svg, 2.0)?,
        _ => return Err(Failure::Input(format!("{shown}: drawings end in .svg or .png"))),
    };
    Ok(crate::output::write(path, &bytes)?)
}

fn text(b: &FreeBody) -> String {
    let mut lines = vec![
        format!("link {} at {:.6} ms, step {}", b.link, b.t_s * 1e3, b.step),
        "forces on it, means over this step                                               x [N]       y [N]    size [N]  moment [mN m]"
            .to_string(),
    ];
    let row = |name: &str, x: f64, y: f64, m: f64| {
        format!("  {name:74} {x:11.3} {y:11.3} {:11.3} {:14.4}", libm::hypot(x, y), m * 1e3)
    };
    lines.extend(b.forces.iter().map(|f| row(&f.cause, f.fx_n, f.fy_n, f.moment_nm)));
    lines.push(row("sum", b.sum_x_n, b.sum_y_n, b.sum_moment_nm));
    lines.push(row(
        "mass x acceleration",
        b.mass_kg * b.acceleration_x_m_s2,
        b.mass_kg * b.acceleration_y_m_s2,
        b.inertia_kg_m2 * b.angular_acceleration_rad_s2,
    ));
    lines.push(format!(
        "  remainder {:.1e} N ({:.0e} of the largest force), moment {:.0e}",
        b.remainder_n, b.remainder_share, b.remainder_moment_share
    ));
    for c in &b.contacts {
        let tooth = c.tooth.map_or(String::new(), |t| format!(", tooth gap {t}"));
        lines.push(format!("{} on {}{tooth}, {}:", of_joint(c.feature, c.joint), c.body, c.segment));
        lines.push(format!(
            "  {:.3} um {}, {:.1} N on average over this step, friction {:.1} N; touched {:.1} us ago at {:.3} m/s",
            c.penetration_m.abs() * 1e6,
            if c.penetration_m > 0.0 { "deep" } else { "apart" },
            c.normal_force_n,
            c.tangential_force_n,
            c.age_s * 1e6,
            c.approach_speed_m_s
        ));
        lines.push(if c.history_is_whole {
            format!("  peak of its impact {:.1} N, reached by {:.6} ms", c.peak_force_n, c.peak_t_s * 1e3)
        } else {
            "  the peak of its impact is not known: it touched before the keyframe".to_string()
        });
        if let Some(a) = &c.approach {
            lines.push(format!(
                "  its approach speed of {:.3} m/s at {:.6} ms came from",
                a.closing_speed_m_s,
                a.t_s * 1e3
            ));
            lines.extend(a.parts.iter().map(|p| format!("    {:+9.4} m/s  {}", p.speed_m_s, p.cause)));
            lines.push(format!(
                "    tension of the link {:.1} N, in the tooth period before {:.1} N on average",
                a.tension_n, a.tension_before_n
            ));
        }
    }
    if b.contacts.is_empty() {
        lines.push(format!("no contact; {} and the like are free", Feature::name(0)));
    }
    lines.join("\n") + "\n"
}
