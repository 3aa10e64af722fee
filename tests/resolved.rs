//! Numbers of `identify` do not hang on the step of its runs: records far more exact than that step, from code of their own.

#[path = "common/identified.rs"]
mod identified;

use identified::{ALL, identified, paths};
use pitchline::identify::report::IdentificationVerdict;

/// Motor and load on a shaft whose flexibility the file lacks, with noise of a millionth: 400 steps a sample, where the fit's own take four or so. The
/// numbers of both bodies and of the shaft hold the truth within the errors that are stated, which are far smaller than what the fit's first step
/// leaves wrong (2e-5 of the frequency).
#[test]
fn records_more_exact_than_the_first_step_give_the_true_numbers() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    let mut seed = 88_172_645_463_325_252_u64;
    let mut uniform = move || {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    let (near, far, stiffness, damping, drag) = (5e-3, 3e-3, 30.0, 2e-3, 0.01);
    let mut files = String::new();
    for (name, usage) in [("a", "fit"), ("b", "fit"), ("c", "judge")] {
        let mut text = String::from("t,torque,speed\n");
        let (mut torque, mut until) = (0.0, 0);
        let mut x = [0.0_f64; 3];
        for n in 0..600 {
            if n >= until {
                (torque, until) = (uniform(), n + 10 + (20.0 * uniform().abs()) as usize);
            }
            let noise = 1.7e-6 * uniform();
            text += &format!("{:.3},{torque},{:.12}\n", n as f64 * 5e-3, x[1] + noise);
            let h = 5e-3 / 400.0;
            let slope = |x: [f64; 3]| {
                let shaft = stiffness * x[0] + damping * (x[1] - x[2]);
                [x[1] - x[2], (torque - shaft - drag * x[1]) / near, shaft / far]
            };
            let along = |x: [f64; 3], by: f64, k: [f64; 3]| std::array::from_fn(|i| x[i] + by * k[i]);
            for _ in 0..400 {
                let k1 = slope(x);
                let k2 = slope(along(x, 0.5 * h, k1));
                let k3 = slope(along(x, 0.5 * h, k2));
                let k4 = slope(along(x, h, k3));
                x = std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
            }
        }
        write(&format!("{name}.csv"), &text);
        files += &format!(
            "[files.{name}]\npath = \"{name}.csv\"\n[records.{name}]\nfile = \"{name}\"\nuse = \"{usage}\"\ntime_column = \"t\"\ntime_unit = \"s\"\n"
        );
    }
    write(
        "shaft.toml",
        "title = \"shaft\"\nfidelity = \"lumped\"\n[rotors.shaft]\ninertia_kg_m2 = 5.1e-3\n[loads.viscous.shaft]\ntorque_nm_s_per_rad = 0.0102\n[inputs.torque.shaft]\n[sensors.tachometer.shaft]\n",
    );
    let measurement = format!(
        "title = \"shaft\"\ndrive = \"shaft.toml\"\n{files}[channels.speed]\nsensor = \"sensors.tachometer.shaft\"\ncolumn = \"speed\"\nunit = \"rad/s\"\n[inputs.motor]\ninput = \"inputs.torque.shaft\"\ncolumn = \"torque\"\nunit = \"N m\"\nhold = true\n[fit.\"rotors.shaft.inertia_kg_m2\"]\nspread_percent = 10\n[fit.\"loads.viscous.shaft.torque_nm_s_per_rad\"]\n[candidates]\nonly = [\"torsional_resonance\"]\n"
    );
    write("measured.toml", &measurement);
    let r = identified(&folder.path().join("measured.toml"), 2, ALL).expect("identified");
    assert_eq!(r.outcome, IdentificationVerdict::Named, "{:?}", paths(&r));
    assert_eq!(paths(&r), ["effects.torsional_resonance.shaft"]);
    // The resonance is that of the load against the held motor, as the effect counts it.
    let frequency = f64::sqrt(stiffness / far) / (2.0 * std::f64::consts::PI);
    let own = |key: &str| {
        let all = r.effects[0].parameters.iter().chain(&r.numbers_after);
        let p = all.into_iter().find(|p| p.path.ends_with(key)).expect("a number");
        (p.value, p.standard_error)
    };
    let known = [
        ("torsional_resonance.shaft.inertia_kg_m2", far),
        ("frequency_hz", frequency),
        ("rotors.shaft.inertia_kg_m2", near),
        ("torque_nm_s_per_rad", drag),
    ];
    for (key, truth) in known {
        let (value, error) = own(key);
        let off = (value - truth) / error;
        println!("{key}: {value:.9} +- {error:.1e}, true {truth:.9}: {off:.2} errors");
        assert!(off.abs() < 3.5 && error < 1e-5 * truth, "{key}");
    }
}
