//! Claims of Lin and Hwang on the timing drive of a V6 engine: silent chain, hydraulic tensioner with a check ball.

use super::laboratory::{ClaimTrial, Laboratory, Unanswered};
use super::probes::Probe;
use super::{ClaimAnswer, ClaimVerdict, Experiment, list, peak_of, place};
use crate::statics::Plungers;

pub(super) const CLAIMS: [(&str, &str, Experiment); 8] = [
    ("L01", "The plunger's displacement over speed has a resonance near 5000 1/min, measured and simulated", l01),
    ("L02", "Natural frequencies agree well with the test", l02),
    ("L03", "Contacts of a silent chain are arc on arc, arc on line and line on line, several for a link at once", l03),
    ("L04", "A search by the seat's index, then among its elements, finds the contact", l04),
    ("L05", "Guide and arm are arcs of different radii", l05),
    ("L06", "The model gives the tensioner's position, pressure and leakage, tension, impact forces, frequencies", l06),
    ("L07", "Pins and plates modelled apart change the dynamics little", l07),
    ("L08", "The backlash between links and sprocket matters", l08),
];

const DRIVE: &str = "ford-v6";

/// At a speed; supply pressure and crank's ripple go with it.
fn at(rpm: f64) -> ClaimTrial {
    let supply_bar =
        if rpm < 3000.0 { 1.2 + (rpm - 800.0).max(0.0) / 2200.0 * 2.3 } else { 3.5 + 0.5 * (rpm - 3000.0) / 3500.0 };
    let ripple = (3400.0 / rpm) * (3400.0 / rpm);
    // Inertia of the valves grows with the square of the speed; measured beside springs at 3400 and 5000 1/min.
    let load = |at_3400: f64, at_5000: f64| {
        at_3400 + (at_5000 - at_3400) * (rpm * rpm - 3400.0 * 3400.0) / (5000.0 * 5000.0 - 3400.0 * 3400.0)
    };
    let torques = format!(
        "[{:.3},{:.3},{:.3},{:.3}]",
        load(7.24, 6.78).max(0.0),
        load(1.74, 3.28).max(0.0),
        load(0.88, 1.90).max(0.0),
        load(0.43, 0.85).max(0.0)
    );
    ClaimTrial::run(DRIVE, 40.0 * 60.0 / rpm, 31.0 * 60.0 / rpm).set(&format!(
        "speeds.constant.crank.speed_rpm={rpm} speeds.constant.crank.amplitudes_deg=[{:.5},{:.5},{:.5}] reservoirs.supply.pressure_bar={supply_bar:.3} chambers.high.pressure_bar={supply_bar:.3} chambers.valve.pressure_bar={supply_bar:.3} loads.orders.exhaust.torques_nm={torques} loads.orders.intake.torques_nm={torques}",
        0.0112 * ripple, 0.0418 * ripple, 0.0028 * ripple
    ))
    .signals(&["slider.plunger.position", "sensors.tachometer.cam", "sensors.strain_gauge.slack", "sensors.pressure.chamber"])
}

fn l01(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let speeds: Vec<f64> = if lab.is_quick() {
        vec![3500.0, 4500.0, 5000.0, 5500.0, 6000.0]
    } else {
        (0..16).map(|k| 2500.0 + 250.0 * f64::from(k)).collect()
    };
    let trials: Vec<ClaimTrial> = speeds.iter().map(|rpm| at(*rpm)).collect();
    let own = lab.all(&trials)?;
    let curve = |f: &dyn Fn(&super::facts::SignalFacts) -> f64| -> Vec<(f64, f64)> {
        speeds.iter().zip(&own).map(|(rpm, facts)| (*rpm, f(&facts.signal("slider.plunger.position")))).collect()
    };
    let swing = curve(&|s| 1e3 * s.peak_to_peak());
    let mean = curve(&|s| 1e3 * s.mean);
    let cam: Vec<(f64, f64)> =
        speeds.iter().zip(&own).map(|(rpm, f)| (*rpm, f.signal("sensors.tachometer.cam").order(3.0))).collect();
    let (peak, size) = peak_of(&swing);
    let (mean_peak, _) = peak_of(&mean);
    let (cam_peak, _) = peak_of(&cam);
    let mode = lab.one(&ClaimTrial::modes(DRIVE, Plungers::Oil, 400.0))?;
    let together = mode
        .modes
        .iter()
        .max_by(|a, b| a.share("sprockets.").total_cmp(&b.share("sprockets.")))
        .map_or(f64::NAN, |m| m.hz);
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend((peak - 5000.0).abs() <= 250.0 && (mean_peak - 5000.0).abs() <= 250.0),
        format!(
            "travel from peak to peak is largest at {} ({size:.2} mm), its mean at {}, order 3 of the cam at {}; the mode in which the cams swing together on closed oil has {together:.0} Hz, order 3 at {:.0} 1/min",
            place(peak, "1/min"),
            place(mean_peak, "1/min"),
            place(cam_peak, "1/min"),
            20.0 * together
        ),
        "both peaks within 250 1/min of 5000; the stiffness of a link was chosen for a mode of 250 Hz, so that the speed is no test, the peak of the plunger is",
    )
    .with_plot("crank [1/min]", "plunger [mm]", vec![("peak to peak", swing), ("mean", mean)]))
}

fn l02(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let found = lab.one(&ClaimTrial::modes(DRIVE, Plungers::Oil, 700.0))?;
    let own: Vec<f64> =
        found.modes.iter().filter(|m| m.share("sprockets.") + m.share("arms.") > 0.2).map(|m| m.hz).collect();
    Ok(ClaimAnswer::new(
        ClaimVerdict::NotCheckable,
        format!("modes of sprockets and arm: {} Hz", list(&own, 0)),
        "the paper prints no frequency, measured or computed",
    ))
}

fn l03(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let found = lab.one(&ClaimTrial::run(DRIVE, 0.02, 0.06).probe(Probe::ContactPairs))?;
    let share = found.probed("several_share");
    let pairs = found.probe.get("pairs").and_then(|p| p.as_object()).cloned().unwrap_or_default();
    let total: f64 = pairs.values().filter_map(serde_json::Value::as_f64).sum();
    let mut sorted: Vec<(String, f64)> = pairs.iter().map(|(k, v)| (k.clone(), v.as_f64().unwrap_or(0.0))).collect();
    sorted.sort_by(|a, b| b.1.total_cmp(&a.1));
    let told: Vec<String> = sorted.iter().take(6).map(|(k, v)| format!("{k} {:.0} %", 100.0 * v / total)).collect();
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend(share > 0.01 && pairs.len() >= 3),
        format!(
            "{:.0} % of the links that touch a sprocket do so in several places; features on elements: {}",
            100.0 * share,
            told.join(", ")
        ),
        "flanks are lines and toes arcs, faces of teeth arcs; line on line does not occur, since faces of teeth are arcs here and rails are touched by plate backs",
    ))
}

/// The same contact by the gap's index and by a search through the whole contour.
fn l04(_lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    use crate::geometry::Vec2;
    use crate::geometry::sprocket::{GapForm, Sprocket, SprocketSpec};
    use crate::pairs::bush_gap::gap_contact;
    const POSES: usize = 100_000;
    const BUSH_M: f64 = 2.5e-3;
    let spec = SprocketSpec {
        teeth: 21,
        pitch_m: 8e-3,
        roller_diameter_m: 2.0 * BUSH_M,
        form: GapForm::Max,
        tip_diameter_m: None,
    };
    let broken = |e: &dyn std::fmt::Display| Unanswered::Broken(e.to_string());
    let sprocket = Sprocket::new(spec).map_err(|e| broken(&e))?;
    let profile = sprocket.profile().map_err(|e| broken(&e))?;
    let mut random = crate::random::SplitMix::of(&[4]);
    let radius = sprocket.rolling_radius_m();
    let (mut worst, mut touched) = (0.0_f64, 0);
    for _ in 0..POSES {
        let angle = random.uniform() * std::f64::consts::TAU;
        let at = radius + (random.uniform() - 0.1) * 1.5e-3;
        let centre = Vec2::new(at * libm::cos(angle), at * libm::sin(angle));
        let by_index = gap_contact(&sprocket, centre, BUSH_M).touch.penetration_m;
        let through_all = BUSH_M - (profile.closest(centre).point - centre).norm();
        // A bush whose axis lies in the metal has no depth to compare.
        if through_all > 0.0 && by_index < BUSH_M {
            touched += 1;
            worst = worst.max((by_index - through_all).abs());
        }
    }
    Ok(ClaimAnswer::new(
        ClaimVerdict::number(worst < 1e-9 && touched > POSES / 100),
        format!(
            "{POSES} random places of a bush about a sprocket of 21 teeth, {touched} of them touching: depths differ by {worst:.1e} m at most"
        ),
        "the depth by the gap's index is that of a search through the whole contour; for flanks of silent chains the tests hold the kernels against such a search",
    ))
}

/// A step of a face's force at a jump of its curvature.
pub(super) struct FaceStep {
    pub before_n: f64,
    pub after_n: f64,
    pub measured_n: f64,
    pub oracle_n: f64,
    /// Along the guide [mm], force a link [N].
    pub curve: Vec<(f64, f64)>,
}

/// At the arm's junction of faces of 297 and 377 mm, on whose joint lines the chain has 300 and 380 mm; slowly driven.
pub(super) fn face_step(lab: &Laboratory) -> Result<FaceStep, Unanswered> {
    let rpm = 150.0;
    let found = lab.one(
        &ClaimTrial::run(DRIVE, 0.4, 1.0)
            .set(&format!("speeds.constant.crank.speed_rpm={rpm} speeds.constant.crank.amplitudes_deg=[0,0,0]"))
            .set("loads.orders.exhaust.torques_nm=[0,0,0,0] loads.orders.intake.torques_nm=[0,0,0,0]")
            .signals(&["sensors.strain_gauge.slack"])
            .probe(Probe::RailForces { rail: "slack".into() }),
    )?;
    let (forces, chord_m) = (found.list("force_per_link_n"), found.probed("chord_m"));
    let at_m = |k: usize| (k as f64 + 0.5) / forces.len() as f64 * chord_m;
    // Eight pitches before the junction, 97.3 mm along the chord, and all of the contact behind it, 5.56 links: impulses of links that come at the same
    // phase of the teeth stand in the same places, and even out over whole pitches.
    let part = |from_m: f64, to_m: f64| {
        let inside = (0..forces.len()).filter(|k| (from_m..to_m).contains(&at_m(*k)));
        let own: Vec<f64> = inside.map(|k| forces[k]).collect();
        own.iter().sum::<f64>() / own.len().max(1) as f64
    };
    let junction_m = 0.0973;
    let (before_n, after_n) = (part(junction_m - 0.064, junction_m), part(junction_m, junction_m + 0.0445));
    let v = 21.0 * 8e-3 * rpm / 60.0;
    let pressed_n = found.signal("sensors.strain_gauge.slack").mean - 0.55 * v * v;
    Ok(FaceStep {
        before_n,
        after_n,
        measured_n: after_n - before_n,
        oracle_n: pressed_n * 8e-3 * (1.0 / 0.38 - 1.0 / 0.3),
        curve: (0..forces.len()).map(|k| (1e3 * at_m(k), forces[k])).collect(),
    })
}

fn l05(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let step = face_step(lab)?;
    let drive = lab.drive(DRIVE, "")?;
    let mut largest_turn = 0.0_f64;
    let mut radii: Vec<f64> = Vec::new();
    for spec in &drive.rails {
        let rail = crate::geometry::rail::Rail::new(spec.side, spec.start, spec.heading_rad, &spec.stretches)
            .map_err(|e| Unanswered::Broken(e.to_string()))?;
        radii.extend(spec.stretches.iter().filter_map(|s| s.radius_m));
        // Arcs that touch with one tangent have their centres on one line through the junction.
        for pair in rail.bends().windows(2) {
            let [(a, ra), (b, rb)] = pair else { continue };
            largest_turn = largest_turn.max(((a - b).norm() - (ra - rb).abs()).abs() / ra.max(*rb));
        }
    }
    let arcs = radii.len();
    radii.sort_by(f64::total_cmp);
    radii.dedup();
    Ok(ClaimAnswer::new(
        ClaimVerdict::number(largest_turn < 1e-9 && (step.measured_n / step.oracle_n - 1.0).abs() < 0.15),
        format!(
            "faces of {arcs} arcs with {} radii, tangents continuous to {largest_turn:.0e}; force a link {:.2} N on one arc of the arm, {:.2} N on the next: {:+.2} N, T p (1/R2 - 1/R1) = {:+.2} N",
            radii.len(),
            step.before_n,
            step.after_n,
            step.measured_n,
            step.oracle_n
        ),
        "tangents continuous to 1e-9, and the step of the force within 15 % of its closed form",
    ))
}

fn l06(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let found = lab.one(&at(5000.0).impacts().signals(&["sensors.flow.leak", "passage.plunger.flow"]))?;
    let has = |name: &str| found.signals.get(name).is_some_and(|s| s.n > 0);
    let all =
        ["slider.plunger.position", "sensors.pressure.chamber", "sensors.flow.leak", "sensors.strain_gauge.slack"];
    let impacts = found.number("impacts.count");
    let leak = found.signal("sensors.flow.leak");
    Ok(ClaimAnswer::new(
        ClaimVerdict::number(all.iter().all(|n| has(n)) && impacts > 0.0),
        format!(
            "at 5000 1/min: travel {:.2} to {:.2} mm, pressure {:.1} to {:.1} bar, leakage {:.0} ml/min, slack span {:.0} to {:.0} N, {impacts:.0} impacts of up to {:.0} N",
            1e3 * found.signal("slider.plunger.position").low,
            1e3 * found.signal("slider.plunger.position").high,
            1e-5 * found.signal("sensors.pressure.chamber").low,
            1e-5 * found.signal("sensors.pressure.chamber").high,
            6e7 * leak.mean,
            found.signal("sensors.strain_gauge.slack").low,
            found.signal("sensors.strain_gauge.slack").high,
            found.number("impacts.peak_force_max_n")
        ),
        "all of these are in every frame of a run; frequencies by `modes` and `spectrum`",
    ))
}

fn l07(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let trial = |body: &str| {
        ClaimTrial::run("roller-20-40", 0.04, 0.2)
            .set(&format!("chain.bush.rollers.body={body}"))
            .signals(&["sprocket.driven.speed", "span.driven.driver.tension"])
            .impacts()
    };
    let own = lab.all(&[trial("separate"), trial("link")])?;
    let change = |f: &dyn Fn(&super::laboratory::TrialFacts) -> f64| 100.0 * (f(&own[0]) / f(&own[1]) - 1.0);
    let speed = change(&|f| f.signal("sprocket.driven.speed").order(20.0));
    let strand = change(&|f| f.signal("span.driven.driver.tension").rms);
    let mean = change(&|f| f.signal("span.driven.driver.tension").mean);
    let peak = change(&|f| f.number("impacts.peak_force_max_n"));
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend([mean, strand, speed].iter().all(|c| c.abs() < 5.0)),
        format!(
            "rollers as bodies against rollers in their links: tight span {mean:+.1} % in the mean, {strand:+.0} % in its swing; order of the teeth of the driven shaft {speed:+.0} %; largest impact {peak:+.0} %"
        ),
        "held against a roller drive, since this chain has no rollers: mean and swing of the span and order of the teeth within 5 %. Free rollers take impacts up with their play of 40 um",
    ))
}

fn l08(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let own = lab.all(
        &["min", "max"].map(|form| super::schaffner_engine::with_gaps(lab, form, 3400.0).probe(Probe::ContactPairs)),
    )?;
    let change = |f: &dyn Fn(&super::laboratory::TrialFacts) -> f64| 100.0 * (f(&own[1]) / f(&own[0]) - 1.0);
    let count = change(&|f| f.number("impacts.bodies.crank.count"));
    let peak = change(&|f| f.number("impacts.bodies.crank.peak_force_max_n"));
    let impulse = change(&|f| f.number("impacts.bodies.crank.impulse_sum_n_s"));
    let touches = change(&|f| {
        f.probe
            .get("pairs")
            .and_then(|p| p.as_object())
            .map_or(f64::NAN, |p| p.values().filter_map(serde_json::Value::as_f64).sum())
    });
    let order = change(&|f| f.signal("sprocket.intake.speed").order(20.0));
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend([count, peak, impulse, order].iter().any(|c| c.abs() > 10.0)),
        format!(
            "widest against narrowest tooth gap, at 3400 1/min: impacts on the crank's sprocket {count:+.0} % in number, {peak:+.0} % in the largest force, {impulse:+.0} % in impulse; order of the teeth of the intake {order:+.0} %; contacts at an instant {touches:+.0} %"
        ),
        "one of them changes by more than a tenth; held against the bush chain of a three-cylinder engine, since the faces of silent teeth here are made without play",
    ))
}
