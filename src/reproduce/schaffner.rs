//! Claims of Schaffner, Sopouch and Priebsch on the drive of two sprockets with which they compare the abutment chain.

use super::laboratory::{ClaimTrial, Laboratory, TrialFacts, Unanswered};
use super::probes::Probe;
use super::schaffner_engine::with_gaps;
use super::{ClaimAnswer, ClaimVerdict, Experiment, list};
use std::sync::Arc;

pub(super) const CLAIMS: [(&str, &str, Experiment); 8] = [
    (
        "S21",
        "Drive of 20 and 40 teeth, 8 mm pitch, 3000 1/min, 20 N m, guides on both spans, preload by centre distance",
        s21,
    ),
    (
        "S22",
        "Abutment chain: all forces between links and driver are low, 130 N at most, without peaks at meshing",
        s22,
    ),
    (
        "S23",
        "Abutment chain: guide, ring, end of the descent, tooth, then both abutments on the ring; the tooth's force falls along the wrap",
        s23,
    ),
    ("S24", "Abutment chain: the tooth's force builds up continuously and over a long time", s24),
    ("S25", "Bush and silent chains show typical peaks of force", s25),
    (
        "S26",
        "The path over the abutments turns a constant speed of the sprocket into a constant speed of the chain",
        s26,
    ),
    ("S27", "For bush chains the profile of DIN 8196 plays no significant role", s27),
    (
        "S28",
        "Correlation is very good for primary dynamics, less so for structural; guide elasticity, crank train and block would improve it",
        s28,
    ),
];

const DRIVES: [&str; 3] = ["bush-20-40", "silent-20-40", "smartchain-20-40"];

/// What `compare` observes of the three, over two laps.
fn compared(lab: &Laboratory) -> Result<Vec<Arc<TrialFacts>>, Unanswered> {
    // Two laps: every link passes.
    let measured_s = 0.18;
    lab.all(&DRIVES.map(|drive| {
        ClaimTrial::run(drive, 0.0, measured_s)
            .signals(&["span.driven.driver.tension", "span.driver.driven.tension", "sprocket.driven.speed"])
            .probe(Probe::Wrap { sprocket: "driver".into() })
            .compare()
    }))
}

fn s21(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let own = compared(lab)?;
    let expected = 20.0 / (8e-3 / (2.0 * libm::sin(std::f64::consts::PI / 40.0)));
    let pulls: Vec<f64> = own
        .iter()
        .map(|f| f.signal("span.driven.driver.tension").mean - f.signal("span.driver.driven.tension").mean)
        .collect();
    let drive = lab.drive("smartchain-20-40", "")?;
    let teeth: Vec<u32> = drive.sprockets.iter().map(|s| s.teeth).collect();
    Ok(ClaimAnswer::new(
        ClaimVerdict::number(teeth == [20, 40] && pulls.iter().all(|p| (p / expected - 1.0).abs() < 0.02)),
        format!(
            "tight less slack: bush {:.1}, silent {:.1}, abutment {:.1} N; torque over radius {expected:.1} N",
            pulls[0], pulls[1], pulls[2]
        ),
        "within 2 %; links, masses, stiffnesses, preload and centre distance are not printed",
    ))
}

/// The largest force of each kind of contact with the driver [N].
fn peaks(facts: &TrialFacts) -> Vec<(String, f64)> {
    let kinds = facts.tree.get("compare").and_then(|c| c.get("kinds")).and_then(|k| k.as_array());
    let of =
        |kind: &serde_json::Value| Some((kind.get("kind")?.as_str()?.to_string(), kind.get("peak_lap_n")?.as_f64()?));
    kinds.into_iter().flatten().filter_map(of).collect()
}

fn s22(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let own = compared(lab)?;
    let smart = &own[2];
    let all = peaks(smart);
    let largest = all.iter().map(|p| p.1).fold(0.0, f64::max);
    let engaging = smart.number("compare.peak_force_max_n");
    let told: Vec<String> = all.iter().map(|(kind, n)| format!("{kind} {n:.0}")).collect();
    // No peak shorter than half a tooth period.
    let rises = ["ring_front", "bush"].map(|kind| smart.number(&format!("compare.kinds.{kind}.rise_t")));
    Ok(ClaimAnswer::new(
        ClaimVerdict::number(
            (largest / 130.0 - 1.0).abs() < 0.3 && engaging < 130.0 * 1.3 && rises.iter().all(|r| *r >= 0.5),
        ),
        format!(
            "largest force {largest:.0} N over the lap, {engaging:.0} N while a link engages; by contact: {} N; forces of ring and tooth rise over {} tooth periods; fastest touch {:.1} % of p omega",
            told.join(", "),
            list(&rises, 2),
            100.0 * smart.number("compare.approach_speed_max_m_s") / smart.number("compare.turning_speed_m_s")
        ),
        "within 30 % of 130 N, and no force that rises in less than half a tooth period; preload and contact stiffness, which are assumed, decide the force",
    ))
}

fn s23(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let smart = compared(lab)?.swap_remove(2);
    let share = smart.number("compare.sequence");
    let forces = smart.list("force_n");
    // The first pitch has the teeth that are being loaded.
    let along = forces.get(1..7).unwrap_or_default();
    let falls = along.windows(2).all(|w| w[1] <= w[0]) && along.len() == 6;
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend(share >= 0.99 && falls),
        format!(
            "{:.0} % of the links keep the order guide, front abutment on the ring, tooth, both abutments; mean force on a tooth, pitch by pitch from the second: {} N",
            100.0 * share,
            list(along, 0)
        ),
        "99 % of the links, and a mean force that falls from pitch to pitch. The sequence holds; the force does not fall all along: links of this drive have their nominal pitch at the tension of the tight span, and shrink as it falls, so that later teeth take it up",
    )
    .with_plot("pitches since the first loaded tooth", "force on a tooth [N]", vec![("abutment chain", forces.iter().enumerate().map(|(k, f)| (k as f64, *f)).collect())]))
}

fn s24(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let own = compared(lab)?;
    let rise = |k: usize, kind: &str| own[k].number(&format!("compare.kinds.{kind}.rise_t"));
    let (smart, bush, silent) = (rise(2, "bush"), rise(0, "bush"), rise(1, "flank_trailing"));
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend(smart >= 0.5 && smart > 10.0 * bush && smart > 10.0 * silent),
        format!(
            "from a tenth to nine tenths of the force on the tooth: abutment chain {smart:.2} tooth periods, bush chain {bush:.3}, silent chain {silent:.3}"
        ),
        "half a tooth period or more, and ten times as long as the others",
    ))
}

fn s25(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let own = compared(lab)?;
    let ratio: Vec<f64> = own.iter().map(|f| f.number("compare.peak_to_steady")).collect();
    let force: Vec<f64> = own.iter().map(|f| f.number("compare.peak_force_max_n")).collect();
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend(ratio[0] > 1.5 && ratio[1] > 1.5 && force[0] > 2.0 * force[2] && force[1] > 2.0 * force[2]),
        format!(
            "peak while engaging over the steady force: bush {:.1}, silent {:.1}, abutment {:.1}; peaks {} N",
            ratio[0],
            ratio[1],
            ratio[2],
            list(&force, 0)
        ),
        "more than 1.5 for bush and silent, and twice the abutment chain's peak; the paper's values are lost",
    ))
}

fn s26(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let own = compared(lab)?;
    let stiff = lab.one(
        &ClaimTrial::run("smartchain-20-40", 0.0, 0.06)
            .set("chain.joint.stiffness_n_per_m=3e8 preload.tension_n=100")
            .set(
                "contact.sprocket.hunt_crossley.stiffness_n_per_m=1e9 contact.ring.hunt_crossley.stiffness_n_per_m=1e9",
            )
            .compare(),
    )?;
    let stiff = 100.0 * stiff.number("compare.speed_ripple");
    let ripple: Vec<f64> = own.iter().map(|f| 100.0 * f.number("compare.speed_ripple")).collect();
    // Speed of the span of a polygon, which falls from its largest by 1 - cos(pi/z) and back over a tooth: its share at the order of the teeth.
    let polygon =
        100.0 * (1.0 - libm::cos(std::f64::consts::PI / 20.0)) * 8.0 / (std::f64::consts::PI * std::f64::consts::PI);
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend(stiff < 0.05),
        format!(
            "ripple of the tight span's speed at the order of the teeth: bush {:.3}, silent {:.3}, abutment {:.3} %; abutment with links and contacts ten times as stiff {stiff:.3} %; a polygon of 20 sides has {polygon:.2} %",
            ripple[0], ripple[1], ripple[2]
        ),
        "below 0.05 % where links and contacts are ten times as stiff; what is left is their elasticity",
    ))
}

fn s27(lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    let speeds = if lab.is_quick() {
        vec![2000.0, 3000.0, 4000.0]
    } else {
        vec![1500.0, 2000.0, 2500.0, 3000.0, 3500.0, 4000.0, 5000.0]
    };
    let mut trials: Vec<ClaimTrial> = speeds.iter().map(|rpm| with_gaps(lab, "min", *rpm)).collect();
    trials.extend(speeds.iter().map(|rpm| with_gaps(lab, "max", *rpm)));
    let own = lab.all(&trials)?;
    let n = speeds.len();
    let change = |f: &dyn Fn(&TrialFacts) -> f64| {
        let each: Vec<f64> = (0..n).map(|k| f(&own[k + n]) / f(&own[k]) - 1.0).collect();
        100.0 * crate::statistics::median(each)
    };
    let order = change(&|f| f.signal("sprocket.intake.speed").order(20.0));
    let peak = change(&|f| f.number("impacts.bodies.crank.peak_force_max_n"));
    Ok(ClaimAnswer::new(
        ClaimVerdict::trend(order.abs() < 20.0 && peak.abs() < 20.0),
        format!(
            "largest against smallest tooth gap of ISO 606, median over {n} speeds: order 20 of the intake {order:+.0} %, largest impact on the crank's sprocket {peak:+.0} %"
        ),
        "both below 20 %",
    ))
}

fn s28(_lab: &Laboratory) -> Result<ClaimAnswer, Unanswered> {
    Ok(ClaimAnswer::new(
        ClaimVerdict::NotCheckable,
        "no number is claimed",
        "an outlook; guides on elastic mounts are in the model (`guide_compliance`), crank train and block are not",
    ))
}
