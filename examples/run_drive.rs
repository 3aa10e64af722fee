//! Runs a bundled drive for 20 ms and prints what it carries and where its energy went.
//!
//! `cargo run --release --example run_drive`

use pitchline::drive::Drive;
use pitchline::simulate::{Ending, Simulation};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    print!("{}", report()?);
    Ok(())
}

/// What this program prints.
pub fn report() -> Result<String, Box<dyn Error>> {
    // A drive of your own: `Drive::parse(name, &text, &[])?`. The last argument replaces values, as `--set` does.
    let drive = Drive::bundled("bush-20-40").ok_or("no such drive")?;
    let mut simulation = Simulation::new(&drive)?;
    // 20 ms, a frame every 50 us. Paths of recordings go into the last argument.
    let summary = simulation.run(20e-3, 50e-6, &[])?;
    if let Ending::Broke(error) = &summary.ending {
        return Err(error.to_string().into());
    }
    let mut text = format!("{}: {} steps, {} frames\n", drive.name, summary.steps, summary.frames);
    for (name, joules) in [
        ("put in", summary.energy.work_in_j),
        ("taken out", summary.energy.work_out_j),
        ("lost", summary.energy.lost_j()),
        ("unaccounted", summary.energy.error_j),
    ] {
        text += &format!("  {name:<12} {joules:8.3} J\n");
    }
    // One frame holds everything at one instant, by columns.
    let frame = simulation.frame()?;
    let joints = &frame.joints;
    let force_n = joints.force_x_n.iter().zip(&joints.force_y_n).map(|(x, y)| x.hypot(*y));
    let highest_n = force_n.fold(0.0, f64::max);
    text += &format!("  highest joint force {highest_n:.1} N, {} contacts\n", frame.contacts.link.len());
    Ok(text)
}
