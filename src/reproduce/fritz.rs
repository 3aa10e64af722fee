//! Claims of Fritz, Kell and Pfeiffer on the timing drive of a four-cylinder engine, a roller chain of 106 links.

use super::laboratory::{ClaimTrial, Laboratory, Unanswered};
use super::probes::Probe;
use super::{ClaimAnswer, ClaimVerdict, Experiment, list};
use crate::statics::Plungers;

pub(super) const CLAIMS: [(&str, &str, Experiment); 10] = [
    ("F01", "320 degrees of freedom: 106 links of three, a guide, a sprocket", f01),
    ("F02", "The crank's speed is prescribed as it was measured; the tight guide is fixed", f02),
    (
        "F03",
        "In the spectrum of the cam sprocket's irregularity at 3000 1/min, order 2 and its multiples dominate",
        f03,
    ),
    ("F04", "The tension guide moves mainly with order 2; its phase differs from the measured one", f04),
    (
        "F05",
        "Chain force of a link at 1000 1/min in four zones: high and modulated by order 2 on the tight side, a rapid fall on the crank, low and nearly constant on the slack side, a rise on the cam",
        f05,
    ),
    (
        "F06",
        "In the slack zone the simulation has the measured maximum, a smaller minimum, and a polygon frequency that stands out far more than measured",
        f06,
    ),
    ("F07", "Contours are circles and lines; where the curvature jumps, the contact force is discontinuous", f07),
    ("F08", "Inner and outer links differ in mass, inertia and pitch", f08),
    ("F09", "The strain-gauge bridge sums bending and load outside, and bending cancels inside", f09),
    ("F10", "Polygon impacts stimulate all eigenfrequencies", f10),
];

const DRIVE: &str = "bmw318";
/// Time to settle, and ten laps of the chain at 1000 1/min, whose phases to the crank differ [s].
const SETTLE_S: f64 = 0.12;
const LAPS_S: f64 = 3.2;
/// A crank that turns evenly, and no torque but friction.
const SMOOTH: &str = "speeds.constant.crank.amplitudes_deg=[0,0,0] loads.orders.cam.torques_nm=[0,0,0,0]";

/// At 1000 1/min, as the drive file stands.
fn at_1000() -> ClaimTrial {
    ClaimTrial::run(DRIVE, SETTLE_S, LAPS_S)
        .signals(&[
            "sensors.strain_gauge.slack",
            "sensors.strain_gauge.tight",
            "sensors.tachometer.cam",
            "arm.arm.speed",
        ])
        .probe(Probe::Zones { joint: 20 })
}

/// At 3000 1/min: 0.8 % of order 2, and the friction, valves and preload of that speed.
fn at_3000() -> ClaimTrial {
    ClaimTrial::run(DRIVE, SETTLE_S, 0.4)
        .set("speeds.constant.crank.speed_rpm=3000 speeds.constant.crank.amplitudes_deg=[0.229,0.0286,0.00764] sliders.plunger.spring_n=44 loads.constant.cam.torque_nm=3.5 loads.orders.cam.torques_nm=[7.06,0.09,0.31,0.57]")
        .signals(&["sensors.tachometer.cam", "sensors.displacement.plunger"])
}

fn f01(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let drive = lab.drive(DRIVE, "")?;
    let free = drive.sprockets.iter().filter(|s| s.name != "crank").count();
    let of_links = 3 * drive.links;
    let (arms, sliders) = (drive.arms.len(), drive.sliders.len());
    Ok(ClaimAnswer::new(
        ClaimVerdict::number(of_links + arms + free == 320),
        format!("{} links x 3 + {arms} arm + {free} sprocket = {}", drive.links, of_links + arms + free),
        format!("counted in the drive; its {sliders} plunger follows the arm by a contact and is one coordinate more"),
    ))
}

fn f02(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let drive = lab.drive(DRIVE, "")?;
    let is_fixed = drive.rails.iter().any(|r| r.name == "tight" && r.arm.is_none());
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend(is_fixed),
        format!(
            "the crank turns with orders 2, 4 and 6; the tight guide is {}",
            if is_fixed { "fixed" } else { "not fixed" }
        ),
        "the measured signal is lost: three orders of a gas torque stand for it",
    ))
}

fn f03(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let cam = lab.one(&at_3000())?.signal("sensors.tachometer.cam");
    let mut below: Vec<(f64, f64)> =
        (1..40).map(|k| (0.5 * f64::from(k), cam.order(0.5 * f64::from(k)))).filter(|(o, _)| *o < 19.5).collect();
    below.sort_by(|a, b| b.1.total_cmp(&a.1));
    let top: Vec<f64> = below.iter().take(3).map(|o| o.0).collect();
    let multiples = top.iter().filter(|o| (*o / 2.0).fract() == 0.0).count();
    let share = cam.order(2.0) / cam.mean.abs();
    let plot: Vec<(f64, f64)> = (1..60).map(|k| (0.5 * f64::from(k), cam.order(0.5 * f64::from(k)))).collect();
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend(top.first() == Some(&2.0) && multiples == 3),
        format!(
            "largest orders below the teeth: {}; order 2 (100 Hz) is {:.2} % of the cam's speed",
            list(&top, 1),
            100.0 * share
        ),
        "order 2 the largest, and the next two multiples of it; the crank's ripple is assumed",
    )
    .with_plot("order of the crank", "cam speed [rad/s]", vec![("amplitude", plot)]))
}

fn f04(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let own = lab.all(&[
        at_3000(),
        at_3000().set("chain.joint.damping_n_s_per_m=120"),
        at_3000().set("chain.bush.inner.mass_g=4.84 chain.bush.outer.mass_g=3.96"),
        at_3000().set("sliders.plunger.damping_n_s_per_m=200"),
        at_3000().set("sliders.plunger.damping_n_s_per_m=800"),
        at_3000().set("sprockets.cam.inertia_kg_m2=2.5e-3"),
    ])?;
    let of = |k: usize| own[k].signal("sensors.displacement.plunger");
    let base = of(0);
    let mut orders: Vec<(f64, f64)> = (1..24).map(|k| (0.5 * f64::from(k), base.order(0.5 * f64::from(k)))).collect();
    orders.sort_by(|a, b| b.1.total_cmp(&a.1));
    let largest = orders.first().map_or(f64::NAN, |o| o.0);
    let moved = |k: usize| crate::units::wrap_angle(of(k).phase(2.0) - base.phase(2.0)).to_degrees();
    let (damped, heavier) = (moved(1), moved(2));
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend(largest == 2.0 && damped.abs().max(heavier.abs()) > 10.0),
        format!(
            "largest order of the plunger's travel: {largest:.1}, {:.3} mm; its phase moves by {damped:.1} deg with twice the damping of the joints, by {heavier:.1} deg with links 10 % heavier; by {:.1} and {:.1} deg with half and twice the plunger's damper, by {:.1} deg with a cam sprocket of 2.5e-3 kg m2",
            1e3 * base.order(2.0),
            moved(3),
            moved(4),
            moved(5)
        ),
        "order 2 is the largest, and its phase moves by more than 10 deg with twice the damping or a tenth more mass, to which the authors lay their error of phase; the measured phase is lost",
    )
    .because("What the authors name moves it hardly, the plunger's damper more"))
}

/// Mean forces of the zones I to IV.
fn f05(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let found = lab.one(&at_1000())?;
    let zone = |name: &str, key: &str| found.probed(&format!("{name}.{key}"));
    let tenths = |name: &str| -> Vec<f64> {
        let list = found.probe.get(name).and_then(|z| z.get("tenths_n")).and_then(|t| t.as_array());
        list.into_iter().flatten().filter_map(serde_json::Value::as_f64).collect()
    };
    let (tight, slack) = (zone("behind_cam", "mean_n"), zone("behind_crank", "mean_n"));
    let (two_tight, two_slack) = (zone("behind_cam", "order_2_n"), zone("behind_crank", "order_2_n"));
    let crank = tenths("on_crank");
    let cam = tenths("on_cam");
    let falls = crank.first() > crank.last() && crank.windows(2).filter(|w| w[1] < w[0]).count() >= 7;
    let rises = cam.first() < cam.last() && cam.windows(2).filter(|w| w[1] > w[0]).count() >= 7;
    // The load's torque over the cam's pitch radius.
    let oracle = 4.5 / (9.525e-3 / (2.0 * libm::sin(std::f64::consts::PI / 40.0)));
    let (sigma_tight, sigma_slack) = (zone("behind_cam", "sigma_n"), zone("behind_crank", "sigma_n"));
    let is_load = ((tight - slack) / oracle - 1.0).abs() < 0.1;
    let holds = two_tight >= 5.0 * two_slack && sigma_slack < 0.2 * sigma_tight && falls && rises && is_load;
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend(holds),
        format!(
            "I tight {tight:.0} N with {two_tight:.0} N of order 2, II on the crank from {:.0} to {:.0} N, III slack {slack:.0} N with {two_slack:.0} N of order 2 and a scatter of {:.0} N, IV on the cam from {:.0} to {:.0} N; I less III {:.0} N, of the load alone {oracle:.0} N",
            crank.first().copied().unwrap_or(f64::NAN),
            crank.last().copied().unwrap_or(f64::NAN),
            zone("behind_crank", "sigma_n"),
            cam.first().copied().unwrap_or(f64::NAN),
            cam.last().copied().unwrap_or(f64::NAN),
            tight - slack
        ),
        format!(
            "order 2 on the tight side five times that of the slack side or more, scatter on the slack side below a fifth, falling on the crank, rising on the cam, the difference of the means the load's; the ratio of the means is {:.1}, which the friction of the cams decides, and that is assumed. Arm and tensioner of this drive let the slack side swing too",
            tight / slack
        ),
    )
    .with_plot(
        "tenths of the way through the zone",
        "force of the joint [N]",
        vec![
            ("on the crank", crank.iter().enumerate().map(|(k, f)| (k as f64, *f)).collect()),
            ("on the cam", cam.iter().enumerate().map(|(k, f)| (k as f64, *f)).collect()),
        ],
    ))
}

fn f06(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let changes = [
        ("as it is", ""),
        ("plunger pressed 50 % more", "sliders.plunger.spring_n=39.6"),
        ("joints with 15 um of clearance", "chain.joint.clearance_um=15"),
        ("joints damped ten times as much", "chain.joint.damping_n_s_per_m=600"),
        ("guides with twice the friction", "contact.guide.friction=0.16"),
    ];
    let trials: Vec<ClaimTrial> = changes.iter().map(|(_, set)| at_1000().set(set)).collect();
    let own = lab.all(&trials)?;
    let of = |k: usize| own[k].signal("sensors.strain_gauge.slack");
    let told: Vec<String> = changes
        .iter()
        .enumerate()
        .map(|(k, (name, _))| format!("{name}: lowest {:.0} N, order 20 {:.1} N", of(k).low, of(k).order(20.0)))
        .collect();
    Ok(ClaimAnswer::new(
        ClaimVerdict::NotCheckable,
        told.join("; "),
        "the measured force is lost; told is what raises the lowest force and what lowers the order of the teeth, which the paper lays to the tensioner's preload",
    ))
}

/// Where the radius of a face jumps, a chain under tension T presses with T p (1/R2 - 1/R1) more a link.
fn f07(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let step = super::lin::face_step(lab)?;
    Ok(ClaimAnswer::new(
        ClaimVerdict::number((step.measured_n / step.oracle_n - 1.0).abs() < 0.3),
        format!(
            "force of the face a link: {:.2} N on an arc of 300 mm, {:.2} N on the next of 380 mm; step {:+.2} N, T p (1/R2 - 1/R1) = {:+.2} N",
            step.before_n, step.after_n, step.measured_n, step.oracle_n
        ),
        "the step is within 30 % of its closed form, on the arm of the V6's drive, slowly driven, whose arcs follow each other as the paper's",
    )
    .with_plot("along the arm [mm]", "force a link [N]", vec![("arm", step.curve)]))
}

/// With a crank that turns evenly, at a speed at which half the order of the teeth meets no mode.
fn smooth(rpm: f64) -> ClaimTrial {
    at_1000().set(SMOOTH).set(&format!("speeds.constant.crank.speed_rpm={rpm}"))
}

fn f08(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let equal = "chain.bush.inner.pitch_mm=9.525 chain.bush.outer.pitch_mm=9.525";
    let masses = "chain.bush.inner.mass_g=4 chain.bush.outer.mass_g=4 chain.bush.inner.inertia_g_mm2=39 chain.bush.outer.inertia_g_mm2=39";
    let frictionless = "contact.sprocket.friction=0 chain.joint.friction=0";
    let own = lab.all(&[
        smooth(1500.0),
        smooth(1500.0).set(equal),
        smooth(1500.0).set(equal).set(masses),
        smooth(1500.0).set(masses),
        smooth(1500.0).set(equal).set(masses).set(frictionless),
    ])?;
    let cam = |k: usize| own[k].signal("sensors.tachometer.cam");
    let half = |k: usize| cam(k).order(10.0);
    let (with, without) = (half(0), half(1));
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend(with > 10.0 * without),
        format!(
            "order 10 of the cam at 1500 1/min, half that of the teeth: {:.2} mrad/s with pitches 20 um apart, {:.2} mrad/s with equal ones; with equal masses too {:.2} mrad/s, with these pitches and equal masses {:.2} mrad/s; with equal rows the line stands {:.0} dB over its surroundings, without friction of joints and teeth too {:.0} dB, {:.2} mrad/s",
            1e3 * with,
            1e3 * without,
            1e3 * half(2),
            1e3 * half(3),
            cam(2).over_floor_db(10.0),
            cam(4).over_floor_db(10.0),
            1e3 * half(4)
        ),
        "rows have masses, inertias and pitches of their own; half the order of the teeth follows from the pitches, at least ten times what the masses alone make",
    )
    .because("The order does not go when rows are equal; it goes when friction does, see S11"))
}

fn f09(_lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    Ok(ClaimAnswer::new(
        ClaimVerdict::NotCheckable,
        "a strain gauge of a link here reads the force of its joint",
        "plates have no bending of their own in this model, so that there is nothing that could cancel",
    ))
}

fn f10(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let run = lab.one(&at_1000().set(SMOOTH))?;
    let modes = lab.one(&ClaimTrial::modes(DRIVE, Plungers::Oil, 1500.0))?;
    let peaks: Vec<(f64, f64)> =
        ["sensors.strain_gauge.slack", "sensors.strain_gauge.tight", "arm.arm.speed", "sensors.tachometer.cam"]
            .iter()
            .flat_map(|name| run.signal(name).peaks)
            .collect();
    let driven = |hz: f64| {
        // What comes back with the crank, the teeth or half of them is no sign of a mode.
        let order = hz / (1000.0 / 60.0);
        (order - order.round()).abs() < 0.05
    };
    let swings: Vec<f64> = peaks.iter().map(|p| p.0).filter(|hz| *hz < 1500.0 && *hz > 20.0).collect();
    let own: Vec<f64> = modes.modes.iter().map(|m| m.hz).filter(|hz| *hz > 20.0).take(6).collect();
    let met: Vec<f64> = own.iter().copied().filter(|hz| swings.iter().any(|s| (s / hz - 1.0).abs() < 0.03)).collect();
    let free = met.iter().filter(|hz| !driven(**hz)).count();
    let running = if lab.is_quick() {
        String::new()
    } else {
        let modes = lab.one(&ClaimTrial::running(DRIVE, SETTLE_S, 4, 250.0).set(SMOOTH))?;
        let swings = modes.modes.iter().filter_map(|m| Some((m.hz, m.damping_ratio?)));
        let told: Vec<String> = swings.map(|(hz, zeta)| format!("{hz:.0} Hz ({:.0} %)", 100.0 * zeta)).collect();
        format!("; about the running drive, with their damping: {}", told.join(", "))
    };
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend(met.len() >= 4),
        format!(
            "modes at rest {} Hz; peaks of forces of the spans, speeds of cam and arm within 3 % of {} of these six, {free} of them beside the crank's orders; the crank turns evenly{running}",
            list(&own, 0),
            met.len()
        ),
        "at least four of the first six modes; with so many lines of the crank some are met by chance",
    )
    .because("The modes that were looked for are those at rest; about the running drive they are others"))
}
