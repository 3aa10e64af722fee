//! Machines with what a simulation does not know: a measured torque with noise, a controller that reacts to it, friction that bends or fades, drives
//! that lose or give a share by the sign. The data are generated here, by small steps of Euler's rule with sticking as an inequality, independent of
//! the program's own scheme.

#[path = "common/identified.rs"]
mod identified;

use identified::{ALL, identified, paths};
use pitchline::identify::report::{IdentificationReport, IdentificationVerdict};
use pitchline::identify::stats::Random;
use std::path::{Path, PathBuf};

/// Inertia [kg m2], viscous friction [N m s/rad], time between samples [s].
const INERTIA: f64 = 0.05;
const VISCOUS: f64 = 0.08;
const SAMPLE_S: f64 = 0.005;

/// What acts on the disc beside its viscous friction and the torque of the drive, over one small step.
struct Disc<'a> {
    /// Torque on the disc, from the torque of the drive and the speed of the disc.
    drive: &'a dyn Fn(f64, f64) -> f64,
    /// Dry friction at a time of the record.
    friction: &'a dyn Fn(f64) -> f64,
    /// Torque on the disc at an angle of it.
    cogging: &'a dyn Fn(f64) -> f64,
    /// Angle over which the friction bends before it slips; 0: none.
    slip: f64,
    /// What the tachometer shows at an angle and a speed.
    tachometer: &'a dyn Fn(f64, f64) -> f64,
    /// Inertia in the drive file [kg m2].
    declared_inertia: f64,
    /// Noise of the measured torque, and of the measured speed.
    noise: (f64, f64),
    is_controlled: bool,
}

/// A number about zero with a standard deviation of one.
fn gauss(random: &mut Random) -> f64 {
    (0..12).map(|_| random.below(1_000_001) as f64 / 1e6).sum::<f64>() - 6.0
}

/// Records of the disc under a torque that changes every 0.2 s, or under a controller that follows a sine.
fn records(folder: &Path, disc: &Disc, declared: &str) -> PathBuf {
    let mut random = Random::new(11);
    let (mut files, mut all) = (String::new(), String::new());
    for (k, name) in ["a", "b", "c", "d"].into_iter().enumerate() {
        let mut text = String::from("torque,speed\n");
        let (mut q, mut v, mut z, mut past, mut torque) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
        for i in 0..800 {
            let t = f64::from(i) * SAMPLE_S;
            let shown = (disc.tachometer)(q, v) + disc.noise.1 * gauss(&mut random);
            if disc.is_controlled {
                let wanted = 6.0 * (1.5 * t + k as f64).sin() + 3.0 * (4.3 * t).sin();
                past += SAMPLE_S * (wanted - shown);
                torque = 0.8 * (wanted - shown) + 4.0 * past;
            } else if i % 40 == 0 {
                torque = 4.0 * (random.below(2001) as f64 / 1000.0 - 1.0);
            }
            text += &format!("{},{shown}\n", torque + disc.noise.0 * gauss(&mut random));
            for step in 0..50 {
                let h = SAMPLE_S / 50.0;
                let friction = (disc.friction)(t + f64::from(step) * h);
                let driven = (disc.drive)(torque, v) + (disc.cogging)(q) - VISCOUS * v;
                if disc.slip > 0.0 {
                    z += h * (v - v.abs() * z) / disc.slip;
                    v += h * (driven - friction * z) / INERTIA;
                } else {
                    let (free, stop) = (v + h * driven / INERTIA, h * friction / INERTIA);
                    v = if free.abs() <= stop { 0.0 } else { free - stop * free.signum() };
                }
                q += h * v;
            }
        }
        std::fs::write(folder.join(format!("{name}.csv")), text).expect("written");
        files += &format!("[files.{name}]\npath = \"{name}.csv\"\n");
        let usage = if k % 2 == 1 { "judge" } else { "fit" };
        all += &format!("[records.{name}]\nfile = \"{name}\"\nuse = \"{usage}\"\nrate_hz = {}\n", 1.0 / SAMPLE_S);
    }
    let drive = format!(
        "fidelity = \"lumped\"\n[rotors.disc]\ninertia_kg_m2 = {}\n[loads.viscous.disc]\ntorque_nm_s_per_rad = 0.1\n{declared}\
         [inputs.torque.disc]\n[sensors.tachometer.disc]\n",
        disc.declared_inertia
    );
    std::fs::write(folder.join("rig.toml"), drive).expect("written");
    let text = format!(
        "title = \"rig\"\ndrive = \"rig.toml\"\n{files}\
         [channels.speed]\nsensor = \"sensors.tachometer.disc\"\ncolumn = \"speed\"\nunit = \"rad/s\"\n\
         [inputs.torque]\ninput = \"inputs.torque.disc\"\ncolumn = \"torque\"\nunit = \"N m\"\nhold = true\n{all}\
         [fit.\"rotors.disc.inertia_kg_m2\"]\nspread_percent = 20\n[fit.\"loads.viscous.disc.torque_nm_s_per_rad\"]\n"
    );
    let path = folder.join("rig-measured.toml");
    std::fs::write(&path, text).expect("written");
    path
}

fn report(disc: &Disc, declared: &str) -> IdentificationReport {
    let folder = tempfile::tempdir().expect("a folder");
    let r = identified(&records(folder.path(), disc, declared), 2, ALL).expect("identified");
    println!("{}", pitchline::identify::text::text(&r));
    r
}

/// Value of a number of an effect that was found.
fn size(r: &IdentificationReport, key: &str) -> f64 {
    let all = r.effects.iter().flat_map(|e| &e.parameters);
    all.into_iter().find(|p| p.path.ends_with(key)).unwrap_or_else(|| panic!("no {key}")).value
}

const PLAIN: Disc = Disc {
    drive: &|u, _| u,
    friction: &|_| 0.0,
    cogging: &|_| 0.0,
    slip: 0.0,
    tachometer: &|_, v| v,
    declared_inertia: 0.055,
    noise: (0.0, 0.02),
    is_controlled: false,
};

/// A controller answers the noise of its own tachometer, and the torque is measured with noise of 0.1 N m: simulated, its sum walks away from the
/// records, and nothing is white. Predicted from sample to sample, what is left is noise.
#[test]
fn friction_behind_a_noisy_torque_in_a_closed_loop_is_explained_by_prediction() {
    let disc = Disc { friction: &|_| 0.4, noise: (0.1, 0.02), is_controlled: true, ..PLAIN };
    let r = report(&disc, "");
    assert_eq!(r.outcome, IdentificationVerdict::Named, "{:?}", paths(&r));
    assert_eq!(paths(&r), ["effects.coulomb_friction.disc"]);
    assert!(r.explained, "{:?}", r.noise_floor);
    let friction = size(&r, "torque_nm");
    assert!((friction - 0.4).abs() < 0.02, "{friction}");
    assert!((r.numbers_after[0].value / INERTIA - 1.0).abs() < 0.02, "{:?}", r.numbers_after[0]);
    let prediction = r.prediction.as_ref().expect("a prediction");
    // The torque that nobody knows is the noise of its measurement.
    let unmeasured = prediction.unmeasured[0].size;
    assert!((0.07..0.14).contains(&unmeasured), "{prediction:?}");
}

/// Noise of the measured torque makes an inertia too large, and no residual shows by how much: its interval is wide enough to hold the truth.
#[test]
fn the_interval_of_an_inertia_holds_what_noise_of_the_torque_may_hide() {
    for (torque, speed, widest) in [(0.1, 0.02, 0.01), (0.2, 0.04, 0.03)] {
        let disc = Disc { friction: &|_| 0.4, noise: (torque, speed), is_controlled: true, ..PLAIN };
        let r = report(&disc, "");
        let found = &r.numbers_after[0];
        let off = (found.value - INERTIA) / INERTIA;
        println!("noise {torque} N m: {:.2} % +- {:.2} %", 100.0 * off, 100.0 * found.standard_error / INERTIA);
        assert!(off.abs() < 1.96 * found.standard_error / INERTIA, "{found:?}");
        assert!(found.standard_error < widest * INERTIA, "{found:?}");
    }
    let exact = Disc { friction: &|_| 0.4, noise: (0.0, 0.02), is_controlled: true, ..PLAIN };
    let found = &report(&exact, "").numbers_after[0];
    assert!(found.standard_error < 2e-3 * INERTIA, "{found:?}");
}

/// The same torque known exactly: the simulation explains the records, and nothing is predicted.
#[test]
fn an_exact_torque_needs_no_prediction() {
    let disc = Disc { friction: &|_| 0.4, ..PLAIN };
    let r = report(&disc, "");
    assert_eq!(paths(&r), ["effects.coulomb_friction.disc"]);
    assert!(r.explained && r.prediction.is_none(), "{:?}", r.prediction);
}

/// A transmission loses a fifth of what goes through it.
#[test]
fn friction_that_grows_with_the_drive_is_named() {
    let disc = Disc { drive: &|u, v| if v == 0.0 { 0.8 * u } else { u - 0.2 * u.abs() * v.signum() }, ..PLAIN };
    let r = report(&disc, "");
    assert_eq!((r.outcome, paths(&r)), (IdentificationVerdict::Named, vec!["effects.load_friction.disc"]));
    assert!((size(&r, "loss_percent") - 20.0).abs() < 1.0, "{}", size(&r, "loss_percent"));
}

/// An amplifier gives a tenth more forwards, and a tenth less backwards.
#[test]
fn a_gain_that_differs_by_sign_is_named() {
    let disc = Disc { drive: &|u, _| u + 0.1 * u.abs(), ..PLAIN };
    let r = report(&disc, "");
    assert_eq!((r.outcome, paths(&r)), (IdentificationVerdict::Named, vec!["effects.input_gain_by_sign.disc"]));
    assert!((size(&r, "difference_percent") - 10.0).abs() < 0.5, "{}", size(&r, "difference_percent"));
}

/// Grease that warms up: beside the friction of the warm machine, which the file has, a friction fades over 0.8 s.
#[test]
fn friction_that_fades_within_records_is_named() {
    let disc = Disc { friction: &|t| 0.2 + 0.5 * (-t / 0.8).exp(), ..PLAIN };
    let r = report(&disc, "[loads.friction.disc]\ntorque_nm = 0.2\nstick_speed_rad_s = 0.01\n");
    assert_eq!((r.outcome, paths(&r)), (IdentificationVerdict::Named, vec!["effects.warming_friction.disc"]));
    assert!((size(&r, "torque_nm") - 0.5).abs() < 0.05, "{}", size(&r, "torque_nm"));
    assert!((size(&r, "time_s") - 0.8).abs() < 0.1, "{}", size(&r, "time_s"));
}

/// A slide on rubber: each reversal bends it by half a radian before it slips.
#[test]
fn friction_that_bends_before_it_slips_is_named() {
    let disc = Disc { friction: &|_| 0.5, slip: 0.5, ..PLAIN };
    let r = report(&disc, "");
    assert_eq!((r.outcome, paths(&r)), (IdentificationVerdict::Named, vec!["effects.presliding_friction.disc"]));
    assert!((size(&r, "torque_nm") - 0.5).abs() < 0.02, "{}", size(&r, "torque_nm"));
    assert!((size(&r, "slip_rad") - 0.5).abs() < 0.05, "{}", size(&r, "slip_rad"));
}

/// A tachometer whose error goes round seven times a turn: an order that the catalogue does not list.
#[test]
fn an_order_that_stands_out_of_the_residuals_is_named() {
    let disc = Disc { tachometer: &|q, v| v * (1.0 + 0.04 * (7.0 * q + 1.0).cos()), ..PLAIN };
    let r = report(&disc, "");
    assert_eq!(paths(&r), ["effects.encoder_error.disc"]);
    assert_eq!(size(&r, "order"), 7.0);
    // 0.04 / 7 rad.
    assert!((size(&r, "amplitude_deg") / 0.3274 - 1.0).abs() < 0.02, "{}", size(&r, "amplitude_deg"));
}

/// Teeth of a motor that hold the disc now and then, and an inertia sixteen times too small in the file: a simulation of whole records finds no way
/// from there, short memory does.
#[test]
fn cogging_is_named_although_the_inertia_is_sixteen_times_wrong() {
    let disc = Disc { cogging: &|q| 0.8 * (8.0 * q + 2.0).sin(), declared_inertia: INERTIA / 16.0, ..PLAIN };
    let r = report(&disc, "");
    assert_eq!(paths(&r), ["effects.torque_ripple.disc"]);
    assert!((size(&r, "torque_nm") / 0.8 - 1.0).abs() < 0.02, "{}", size(&r, "torque_nm"));
    assert!((r.numbers_after[0].value / INERTIA - 1.0).abs() < 0.02, "{:?}", r.numbers_after[0]);
}
