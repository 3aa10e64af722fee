//! Stops a run at the first impact above 1.5 m/s and prints what touches there.
//!
//! `cargo run --release --example stop_at_impact`

use pitchline::drive::Drive;
use pitchline::recording::frame::Feature;
use pitchline::simulate::{Simulation, hit_text};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    print!("{}", report()?);
    Ok(())
}

/// What this program prints.
pub fn report() -> Result<String, Box<dyn Error>> {
    let drive = Drive::bundled("bush-20-40").ok_or("no such drive")?;
    let mut simulation = Simulation::new(&drive)?;
    // A wrong name or unit is an error that points at its place. docs/debugger.md lists all quantities.
    simulation.stop_at("impact.approach_speed > 1.5 m/s")?;
    let summary = simulation.run(50e-3, 50e-6, &[])?;
    let Some(hit) = summary.hits.first() else {
        return Ok("no impact above 1.5 m/s in 50 ms\n".into());
    };
    let header = simulation.header().clone();
    let mut text = format!("step {}, {:.4} ms: {}\n", hit.step, hit.t_s * 1e3, hit_text(hit, &header));
    // The run stands at this step: all contacts of the same link at this instant.
    let frame = simulation.frame()?;
    let link = hit.impact.ok_or("the expression is about impacts")?.link;
    let contacts = &frame.contacts;
    for row in (0..contacts.link.len()).filter(|row| contacts.link[*row] == link) {
        text += &format!(
            "  {} on {}: {:.3} um deep, {:.1} N\n",
            Feature::name(contacts.feature[row]),
            header.bodies[contacts.body[row] as usize].path,
            contacts.penetration_m[row] * 1e6,
            contacts.normal_force_n[row]
        );
    }
    Ok(text)
}
