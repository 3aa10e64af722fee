//! Where impact-free engagement ends: the abutment chain's drive with one thing changed at a time, and the bounds that break.
//! Then the peaks of all three chains over speed.
//!
//! cargo bench --bench smartchain_map

use pitchline::compare::{DriveSummary, Plan, run};
use pitchline::drive::{BUNDLED, Drive};
use pitchline::engagement::ContactKind;
use std::sync::atomic::AtomicBool;

/// Simulated after assembling, in tooth periods of the driver.
const DURATION_T: f64 = 40.0;

fn measure(name: &str, sets: &[String]) -> Result<DriveSummary, String> {
    let text = BUNDLED.iter().find(|b| b.0 == name).map(|b| b.1).ok_or("no such drive")?;
    let drive = Drive::parse(name, text, sets).map_err(|e| e.to_string())?;
    let duration_s = DURATION_T * drive.chain.pitch_m() / drive.chain_speed_m_s();
    let plan = Plan { duration_s, recorded_s: 0.0, every_s: 1e-3 };
    let mut runs = run(&[drive], plan, &AtomicBool::new(false)).map_err(|e| e.to_string())?;
    Ok(runs.remove(0).summary)
}

/// Bounds of impact-free engagement that a run breaks.
fn broken(s: &DriveSummary) -> Vec<&'static str> {
    let (window_n, lap_n) = s.largest_n();
    let pressing_n = s.tight_tension_n - s.centrifugal_tension_n;
    let ring_n = s.kind(ContactKind::RingFront).map_or(f64::INFINITY, |k| k.peak_window_n);
    let keeps = [
        ("fastest first touch", s.fastest_touch_m_s() < 0.03 * s.turning_speed_m_s),
        ("largest force, engaging", window_n < 130.0),
        ("largest force, lap", lap_n < 150.0),
        ("ring force", ring_n < 0.30 * pressing_n),
        ("speed ripple", 100.0 * s.speed_ripple < 0.15),
        ("rise of the tooth force", s.tooth().is_some_and(|k| k.rise_t > 0.45)),
        ("sequence in order", s.sequence.is_some_and(|share| share >= 0.99)),
    ];
    keeps.into_iter().filter(|(_, is_kept)| !is_kept).map(|(name, _)| name).collect()
}

fn cases() -> Vec<(String, Vec<String>)> {
    let one = |title: String, set: String| (title, vec![set]);
    // Unloaded pitch of the bundled drive: 8 mm less the stretch at the design tension.
    let unloaded_mm = 8.0 - 440.0 / 3e7 * 1e3;
    let pitches = |inner: f64, outer: f64| {
        vec![format!("chain.smartchain.inner.pitch_mm={inner}"), format!("chain.smartchain.outer.pitch_mm={outer}")]
    };
    let mut all = vec![("as bundled".to_string(), Vec::new())];
    for um in [1.0, 2.0, 5.0] {
        for seed in [1, 2] {
            let sets = vec![format!("chain.scatter.pitch_um={um}"), format!("chain.scatter.seed={seed}")];
            all.push((format!("pitch scatter {um} um, seed {seed}"), sets));
        }
    }
    for percent in [0.1, 0.5, 1.0] {
        let pitch = unloaded_mm * (1.0 + percent / 100.0);
        all.push((format!("elongation {percent} %"), pitches(pitch, pitch)));
    }
    for nm in [5.0, 10.0, 15.0, 25.0] {
        all.push(one(format!("load {nm} N m"), format!("loads.constant.driven.torque_nm={nm}")));
    }
    for um in [-10.0, -3.0, -1.0, 1.0, 3.0, 10.0] {
        all.push(one(format!("guide {um} um lower"), format!("guides.fixed.tight.clearance_um={um}")));
    }
    all.push(one("plain ring, 40 teeth".into(), "sprockets.driven.ring=plain".into()));
    let alternating = "chain.smartchain.bushes=every_other_link".to_string();
    all.push(one("bushes on every other link".into(), alternating.clone()));
    let mut cured = pitches(8.0, 8.0 - 2.0 * 440.0 / 3e7 * 1e3);
    cured.push(alternating);
    all.push(("  outer links shorter, inner longer".into(), cured));
    for friction in [0.0, 0.1] {
        all.push(one(format!("joint friction {friction}"), format!("chain.joint.friction={friction}")));
    }
    for rpm in [1000, 2000, 4000, 5000, 6000] {
        all.push(one(format!("{rpm} rpm"), format!("speeds.constant.driver.speed_rpm={rpm}")));
    }
    all
}

fn main() {
    println!(
        "{:<36} {:>8} {:>8} {:>8} {:>7} {:>7}  bounds broken",
        "change", "touch %", "engage N", "lap N", "rise T", "order"
    );
    for (title, sets) in cases() {
        match measure("smartchain-20-40", &sets) {
            Ok(s) => {
                let broken = broken(&s);
                let (window, lap) = s.largest_n();
                println!(
                    "{title:<36} {:>8.2} {window:>8.1} {lap:>8.1} {:>7.2} {:>7.2}  {}",
                    100.0 * s.fastest_touch_m_s() / s.turning_speed_m_s,
                    s.tooth().map_or(f64::NAN, |k| k.rise_t),
                    s.sequence.unwrap_or(f64::NAN),
                    if broken.is_empty() { "none".to_string() } else { broken.join(", ") }
                );
            }
            Err(e) => println!("{title:<36} {}", e.lines().next().unwrap_or_default()),
        }
    }
    println!("\npeak of the tooth contact, or of any contact of the abutment chain, while a link engages [N]");
    println!("{:>6} {:>10} {:>10} {:>10}", "rpm", "bush", "silent", "abutment");
    for rpm in [1000, 2000, 3000, 4000, 5000, 6000] {
        let set = [format!("speeds.constant.driver.speed_rpm={rpm}")];
        let peak = |name: &str| measure(name, &set).map_or(f64::NAN, |s| s.largest_n().0);
        println!(
            "{rpm:>6} {:>10.1} {:>10.1} {:>10.1}",
            peak("bush-20-40"),
            peak("silent-20-40"),
            peak("smartchain-20-40")
        );
    }
}
