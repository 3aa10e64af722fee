//! `pitchline diff`: where two recordings differ.

use super::{Answer, Failure, Outcome, answer};
use crate::analysis::diff::{Difference, diff};
use std::path::PathBuf;

#[derive(clap::Args, Debug)]
pub struct DiffArgs {
    /// First recording (.mcap)
    a: PathBuf,
    /// Second recording (.mcap)
    b: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &DiffArgs) -> Result<Outcome, Failure> {
    let (mut a, mut b) = (super::open_recording(&args.a)?, super::open_recording(&args.b)?);
    let difference = diff(&mut a, &mut b)?;
    let found =
        if args.json { Answer::Json(serde_json::json!(difference)) } else { Answer::Text(text(args, &difference)) };
    answer(&[&a, &b], found, if difference.equal { Outcome::Done } else { Outcome::Differs })
}

fn text(args: &DiffArgs, d: &Difference) -> String {
    let mut lines = vec![format!(
        "A = {}, B = {}: {} frames compared{}",
        args.a.display(),
        args.b.display(),
        d.frames_compared,
        if d.interpolated { " (B interpolated to the times of A)" } else { "" }
    )];
    if d.frames_only_in_a + d.frames_only_in_b > 0 {
        lines.push(format!("  {} frames only in A, {} only in B", d.frames_only_in_a, d.frames_only_in_b));
    }
    lines.extend(d.drives.iter().map(|l| format!("  {l}")));
    match &d.first {
        None if d.equal => lines.push("  equal, to the bit".into()),
        None => lines.push("  no difference in the frames that both have".into()),
        Some(first) => {
            let by = match first.distance {
                0.0 => ", whose poses are still equal".to_string(),
                m if first.body.starts_with("link") && m >= 1e-9 => format!(", by {:.3} um", m * 1e6),
                m if first.body.starts_with("link") => format!(", by {m:.3e} m"),
                _ => format!(", by {:.3e} rad", first.distance),
            };
            lines.push(format!(
                "  they part at frame {}, step {}, {:.6} ms: {}{by}",
                first.frame,
                first.step,
                first.t_s * 1e3,
                first.body
            ));
            lines.push(format!("    {}", first.what));
            lines.push("      t [ms]  largest displacement [um]  of link  joint force [N]  chain torque [N m]".into());
            lines.extend(d.growth.iter().map(|g| {
                format!(
                    "  {:10.4} {:26.6} {:8} {:16.4} {:19.5}",
                    g.t_s * 1e3,
                    g.position_m * 1e6,
                    g.link,
                    g.joint_force_n,
                    g.chain_torque_nm
                )
            }));
        }
    }
    lines.join("\n") + "\n"
}
