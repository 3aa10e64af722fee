//! The catalogue of what is measured, and the measured numbers part by part.
//!
//! A row of the catalogue says how a number is called, how it is printed and which difference counts. Everything else loops over rows.

use super::spans::SpanEnds;
use super::{Audit, Estimate, Topology};
use crate::diag::last_name;
use crate::recording::frame::{BodyKind, Energy, Header};
use std::f64::consts::PI;

/// A measured quantity.
#[derive(Debug, PartialEq)]
pub struct Measure {
    pub key: &'static str,
    pub words: &'static str,
    /// What a part is that has more of it, or less.
    pub more: &'static str,
    pub less: &'static str,
    /// Unit of a difference and of a value, and their sizes in SI.
    pub unit: (&'static str, f64),
    pub shown_in: (&'static str, f64),
    /// The smallest difference that counts [SI], and as a share of what it is compared with. A single part, with nothing beside it, is
    /// told apart by as much; among neighbours that scatter, by more.
    pub least: f64,
    pub least_share: f64,
    pub kind: MeasureKind,
}

/// Whether a number belongs to a part, or follows from others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum MeasureKind {
    /// Forces, losses, speeds.
    Consequence,
    /// How the drive is put together: preload and places of axes, which lengths of links lead to as well.
    Assembly,
    Property,
}

const UM: (&str, f64) = ("um", 1e-6);
const MM: (&str, f64) = ("mm", 1e-3);
const NEWTON: (&str, f64) = ("N", 1.0);
const TORQUE: (&str, f64) = ("N m", 1.0);

/// A number that belongs to a part.
const fn property(
    key: &'static str,
    words: &'static str,
    (more, less): (&'static str, &'static str),
    unit: (&'static str, f64),
    (least, least_share): (f64, f64),
) -> Measure {
    Measure { key, words, more, less, unit, shown_in: unit, least, least_share, kind: MeasureKind::Property }
}

/// A number that follows from others.
const fn effect(
    key: &'static str,
    words: &'static str,
    signs: (&'static str, &'static str),
    unit: (&'static str, f64),
    least: (f64, f64),
) -> Measure {
    Measure { kind: MeasureKind::Consequence, ..property(key, words, signs, unit, least) }
}

// Differences that count: healthy bundled drives of 40 to 200 ms scatter by less than a third of them.
pub static PITCH: Measure =
    Measure { shown_in: MM, ..property("pitch_m", "pitch", ("longer", "shorter"), UM, (2e-6, 0.0)) };
pub static MASS: Measure = property("mass_kg", "mass", ("heavier", "lighter"), ("g", 1e-3), (0.0, 0.02));
pub static INERTIA: Measure =
    property("inertia_kg_m2", "moment of inertia", ("more", "less"), ("g mm2", 1e-9), (0.0, 0.02));
pub static JOINT_STIFFNESS: Measure =
    property("stiffness_n_per_m", "stiffness", ("stiffer", "softer"), ("N/um", 1e6), (0.0, 0.05));
pub static JOINT_DAMPING: Measure =
    property("damping_n_s_per_m", "damping", ("more", "less"), ("N s/m", 1.0), (0.0, 0.5));
pub static CLEARANCE: Measure = property("clearance_m", "clearance", ("more", "less"), UM, (2e-6, 0.0));
pub static FRICTION_ARM: Measure =
    property("friction_arm_m", "friction arm (friction times pin radius)", ("more", "less"), UM, (5e-6, 0.1));
pub static TIGHT_TORQUE: Measure =
    property("tight_torque_nm", "friction torque whatever the force", ("more", "less"), ("mN m", 1e-3), (2e-3, 0.0));
pub static OUTWARD: Measure = property("outward_m", "depth", ("high", "low"), UM, (3e-6, 0.0));
pub static SIDEWAYS: Measure =
    property("sideways_m", "place along the turn", ("counterclockwise", "clockwise"), UM, (6e-6, 0.0));
pub static ECCENTRICITY: Measure =
    property("eccentricity_m", "eccentricity of its gaps", ("eccentric", "less eccentric"), UM, (4e-6, 0.0));
pub static RING_ECCENTRICITY: Measure =
    property("ring_eccentricity_m", "eccentricity of its ring", ("eccentric", "less eccentric"), UM, (4e-6, 0.0));
pub static SEAT_RADIUS: Measure = Measure {
    shown_in: MM,
    ..property("seat_radius_m", "radius of its seats", ("wider", "narrower"), UM, (25e-6, 0.0))
};
pub static GAP_FORM: Measure =
    property("gap_form_m", "contour of its gaps", ("further out", "further in"), UM, (5e-6, 0.0));
pub static PLACE_WAVE: Measure = property(
    "place_wave_m",
    "wave of its gaps' places along the turn",
    ("more uneven", "less uneven"),
    UM,
    (4e-6, 0.0),
);
pub static AXES: Measure = Measure {
    shown_in: MM,
    kind: MeasureKind::Assembly,
    ..property("axes_m", "distance of its sprockets' axes", ("longer", "shorter"), UM, (15e-6, 0.0))
};
pub static RING_RADIUS: Measure =
    Measure { shown_in: MM, ..property("ring_radius_m", "radius of its ring", ("larger", "smaller"), UM, (4e-6, 0.0)) };
pub static CONTACT_STIFFNESS: Measure =
    property("contact_stiffness_n_per_m", "contact stiffness", ("stiffer", "softer"), ("N/um", 1e6), (0.0, 0.1));
pub static CONTACT_DAMPING: Measure =
    property("contact_damping_n_s_per_m", "contact damping", ("more", "less"), ("N s/m", 1.0), (0.0, 0.2));
/// Damping over the force of the spring.
pub static CONTACT_LOAD_DAMPING: Measure =
    property("contact_load_damping_s_per_m", "contact damping by load", ("more", "less"), ("s/m", 1.0), (0.0, 0.2));
pub static RING_STIFFNESS: Measure = property(
    "ring_stiffness_n_per_m",
    "contact stiffness of its ring",
    ("stiffer", "softer"),
    ("N/um", 1e6),
    (0.0, 0.1),
);
pub static RING_DAMPING: Measure =
    property("ring_damping_n_s_per_m", "contact damping of its ring", ("more", "less"), ("N s/m", 1.0), (0.0, 0.2));
pub static RING_LOAD_DAMPING: Measure = property(
    "ring_load_damping_s_per_m",
    "contact damping by load of its ring",
    ("more", "less"),
    ("s/m", 1.0),
    (0.0, 0.2),
);
pub static MOUNT_COMPLIANCE: Measure = property(
    "mount_compliance_m_per_n",
    "compliance of its mount",
    ("softer", "stiffer"),
    ("um/kN", 1e-9),
    (5e-9, 0.05),
);
pub static GUIDE_FRICTION: Measure = property("friction", "friction", ("more", "less"), ("", 1.0), (0.005, 0.1));
pub static GUIDE_HEIGHT: Measure = property("height_m", "height of its face", ("high", "low"), UM, (15e-6, 0.0));
pub static RAIL_PLACE: Measure = property(
    "place_m",
    "place of its contour",
    ("further towards the chain", "further off the chain"),
    UM,
    (15e-6, 0.0),
);
pub static GUIDE_FORCE: Measure = effect("force_n", "mean force of the chain", ("more", "less"), NEWTON, (5.0, 0.3));
pub static PRELOAD: Measure = Measure {
    kind: MeasureKind::Assembly,
    ..property("preload_n", "mean tension of all spans", ("more", "less"), NEWTON, (5.0, 0.05))
};
pub static TIGHTENING: Measure = Measure {
    kind: MeasureKind::Assembly,
    ..property("tightening_n", "tension at rest", ("tighter", "slacker"), NEWTON, (5.0, 0.04))
};
pub static TENSION: Measure = effect("tension_n", "mean tension", ("more", "less"), NEWTON, (10.0, 0.1));
pub static SPEED: Measure = effect("speed_rad_s", "mean speed", ("faster", "slower"), ("rpm", PI / 30.0), (0.1, 0.01));
/// What irregular impacts give a free shaft is a third of what counts.
pub static SPEED_SCATTER: Measure =
    effect("speed_scatter_rad_s", "standard deviation of its speed", ("more", "less"), ("rpm", PI / 30.0), (0.3, 0.5));
/// Share of its mean speed by which the speed of a driver varies that is not swept.
const STEADY: f64 = 0.03;
/// The drive file prescribes the speed of the driver: what varies in it is a property of the drive.
pub static DRIVER_SPEED_SCATTER: Measure = property(
    "driver_speed_scatter_rad_s",
    "standard deviation of its speed",
    ("more", "less"),
    ("rpm", PI / 30.0),
    (0.1, 0.1),
);
pub static OUTER_TORQUE: Measure =
    effect("outer_torque_nm", "mean torque of drive and load", ("more", "less"), TORQUE, (0.5, 0.05));
pub static ARM_ANGLE: Measure = effect(
    "angle_rad",
    "mean angle",
    ("further counterclockwise", "further clockwise"),
    ("deg", PI / 180.0),
    (1e-3, 0.0),
);
pub static POWER: Measure = effect("power_w", "power", ("more", "less"), ("W", 1.0), (2.0, 0.15));

/// What a number belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AuditPart {
    Link(usize),
    Joint(usize),
    /// A tooth gap: index of the sprocket in `Header::bodies`, and number of the gap.
    Gap(usize, u32),
    Body(usize),
    Span(SpanEnds),
    /// A row of `rotors`.
    Turning(usize),
    /// All spans together.
    Spans,
    /// An account of the ledger.
    Account(usize),
}

/// A measured number of a part.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    pub part: AuditPart,
    pub measure: &'static Measure,
    pub estimate: Estimate,
    /// What the header declares.
    pub declared: Option<f64>,
    /// Parts that are alike: they are compared with each other.
    pub group: Option<String>,
}

impl AuditPart {
    /// Its name in texts.
    pub fn name(self, header: &Header) -> String {
        let body = |b: usize| body_name(header, b);
        match self {
            AuditPart::Link(i) => format!("link {i}"),
            AuditPart::Joint(j) => format!("joint {j}"),
            AuditPart::Gap(b, gap) => format!("gap {gap} of `{}`", body(b)),
            AuditPart::Body(b) => header.bodies.get(b).map_or_else(String::new, |b| b.path.clone()),
            AuditPart::Span((from, to)) => format!("span from `{}` to `{}`", body(from), body(to)),
            AuditPart::Turning(k) => header.coordinates.get(k).cloned().unwrap_or_default(),
            AuditPart::Spans => "chain".into(),
            AuditPart::Account(k) => {
                Energy::MESSAGE.columns.get(k).map_or_else(String::new, |c| c.name.replace("_j", ""))
            }
        }
    }
}

/// Name of a body: the last word of its path, or all of it where several end so.
fn body_name(header: &Header, body: usize) -> String {
    let Some(path) = header.bodies.get(body).map(|b| &b.path) else { return String::new() };
    let alike = header.bodies.iter().filter(|b| b.rotor && last_name(&b.path) == last_name(path)).count();
    if alike > 1 { path.clone() } else { last_name(path).to_string() }
}

/// All numbers of an audit.
pub fn measured(audit: &Audit, header: &Header) -> Vec<Measured> {
    let mut all = Vec::new();
    put_links(audit, header, &mut all);
    put_sprockets(audit, header, &mut all);
    for guide in &audit.guides {
        let part = AuditPart::Body(guide.body);
        let mut put = |measure, estimate: Option<Estimate>| put_one(&mut all, part, measure, estimate, None);
        put(&CONTACT_STIFFNESS, guide.law.stiffness_n_per_m);
        put(&CONTACT_DAMPING, guide.law.damping_n_s_per_m);
        put(&CONTACT_LOAD_DAMPING, guide.law.load_damping_s_per_m);
        put(&MOUNT_COMPLIANCE, guide.mount_compliance_m_per_n);
        put(&GUIDE_FRICTION, guide.friction);
        put(&GUIDE_FORCE, guide.force_n);
    }
    let spans = &audit.spans;
    for (ends, tension) in &spans.spans {
        put_one(&mut all, AuditPart::Span(*ends), &TENSION, Some(*tension), None);
        // The axes of a pair once, though two spans may lie between them.
        let is_first = ends.0 < ends.1 || !spans.axes.contains_key(&(ends.1, ends.0));
        put_one(
            &mut all,
            AuditPart::Span(*ends),
            &AXES,
            spans.axes.get(ends).filter(|_| is_first).and_then(|a| a.estimate()),
            None,
        );
    }
    put_one(&mut all, AuditPart::Spans, &PRELOAD, spans.preload_n, Some(header.static_tension_n));
    for (k, ([speed, _, outer, angle], scatter)) in spans.turning.iter().zip(&spans.speed_scatter).enumerate() {
        let path = header.coordinates.get(k).map_or("", String::as_str);
        let part = AuditPart::Turning(k);
        // The back of an arm that gives way turns as the arm does.
        if path.starts_with("arms.") || path.starts_with("effects.arm_compliance.") {
            put_one(&mut all, part, &ARM_ANGLE, *angle, None);
        } else {
            put_one(&mut all, part, &SPEED, *speed, None);
            // In a sweep it tells how long was recorded.
            let is_steady = scatter.zip(*speed).is_some_and(|(s, mean)| s.value < STEADY * mean.value.abs());
            let is_driver = spans.driver == Some(k) && is_steady;
            put_one(&mut all, part, if is_driver { &DRIVER_SPEED_SCATTER } else { &SPEED_SCATTER }, *scatter, None);
            put_one(&mut all, part, &OUTER_TORQUE, *outer, None);
        }
    }
    for (k, power) in spans.power_w.iter().enumerate() {
        // A difference of two instants: stored energies go up and down.
        let is_sum = Energy::MESSAGE.columns.get(k).is_some_and(|c| !c.kind.is_stored() && c.name != "error_j");
        if is_sum && *power != 0.0 {
            let estimate = Estimate { value: *power, error: 0.0, samples: 2 };
            put_one(&mut all, AuditPart::Account(k), &POWER, Some(estimate), None);
        }
    }
    all
}

fn put_one(
    all: &mut Vec<Measured>,
    part: AuditPart,
    measure: &'static Measure,
    estimate: Option<Estimate>,
    declared: Option<f64>,
) {
    if let Some(estimate) = estimate.filter(|e| e.value.is_finite()) {
        all.push(Measured { part, measure, estimate, declared, group: None });
    }
}

fn put_links(audit: &Audit, header: &Header, all: &mut Vec<Measured>) {
    let mut put = |part, measure, estimate: Option<Estimate>, declared, group: &str| {
        put_one(all, part, measure, estimate, declared);
        if let (Some(last), true) = (all.last_mut(), estimate.is_some_and(|e| e.value.is_finite())) {
            last.group = Some(group.to_string());
        }
    };
    for (i, (fit, info)) in audit.links.iter().zip(&header.links).enumerate() {
        let row = header.link_outlines.get(info.outline as usize).map_or("", |o| o.name.as_str());
        let (part, group) = (AuditPart::Link(i), format!("{row} links"));
        put(part, &PITCH, fit.pitch_m(), Some(info.pitch_m), &group);
        put(part, &MASS, fit.mass_kg, Some(info.mass_kg), &group);
        put(part, &INERTIA, fit.inertia_kg_m2, Some(info.inertia_kg_m2), &group);
    }
    let topology = Topology::of(header);
    for (j, fit) in audit.joints.iter().enumerate() {
        let part = AuditPart::Joint(j);
        let joints = joints_of(header, &topology, j);
        // Joints that yield little tell little of their damping.
        let damping = fit.damping_n_s_per_m.filter(|d| d.error < DAMPING_ERROR * d.value.abs());
        let turned = fit.turning_samples >= TURNED && fit.tight_torque_nm.is_some_and(|t| t.error < TORQUE_ERROR_NM);
        put(part, &JOINT_STIFFNESS, fit.stiffness_n_per_m, None, &joints);
        put(part, &JOINT_DAMPING, damping, None, &joints);
        put(part, &CLEARANCE, fit.clearance_m, None, &joints);
        put(part, &FRICTION_ARM, fit.friction_arm_m.filter(|_| turned), None, &joints);
        put(part, &TIGHT_TORQUE, fit.tight_torque_nm.filter(|_| turned), None, &joints);
    }
}

fn put_sprockets(audit: &Audit, header: &Header, all: &mut Vec<Measured>) {
    for (body, fit) in audit.sprockets.iter().enumerate() {
        let part = AuditPart::Body(body);
        let group = format!("gaps of `{}`", body_name(header, body));
        for (g, gap) in fit.gaps.iter().enumerate() {
            for (measure, estimate) in [(&OUTWARD, gap.outward_m), (&SIDEWAYS, gap.sideways_m)] {
                let Some(estimate) = estimate else { continue };
                let (part, group) = (AuditPart::Gap(body, u32::try_from(g).unwrap_or(u32::MAX)), Some(group.clone()));
                all.push(Measured { part, measure, estimate, declared: None, group });
            }
        }
        let mut put = |measure, estimate, declared| put_one(all, part, measure, estimate, declared);
        put(&ECCENTRICITY, fit.eccentricity_m, Some(0.0));
        put(&SEAT_RADIUS, fit.seat_radius_m, None);
        let samples = fit.gaps.iter().map(|g| g.seated).sum();
        put(&PLACE_WAVE, fit.wave.map(|w| Estimate { value: w.amplitude_m, error: 0.0, samples }), Some(0.0));
        put(&RING_RADIUS, fit.ring_radius_m, None);
        put(&RING_ECCENTRICITY, fit.ring_eccentricity_m, Some(0.0));
        put(&CONTACT_STIFFNESS, fit.law.stiffness_n_per_m, None);
        put(&CONTACT_DAMPING, fit.law.damping_n_s_per_m, None);
        put(&CONTACT_LOAD_DAMPING, fit.law.load_damping_s_per_m, None);
        put(&GUIDE_FRICTION, fit.friction, None);
        put(&RING_STIFFNESS, fit.ring_law.stiffness_n_per_m, None);
        put(&RING_DAMPING, fit.ring_law.damping_n_s_per_m, None);
        put(&RING_LOAD_DAMPING, fit.ring_law.load_damping_s_per_m, None);
    }
}

/// Joints of one chain are alike: their name, with that of the chain where there are several.
fn joints_of(header: &Header, topology: &Topology, joint: usize) -> String {
    let first = topology.chain.get(joint).and_then(|chain| topology.chain.iter().position(|c| c == chain));
    let outline = first.and_then(|link| header.link_outlines.get(header.links.get(link)?.outline as usize));
    // Outlines of several chains are called after their chain, then their row.
    match outline.and_then(|o| o.name.rsplit_once(' ')).filter(|_| topology.pitch_m.len() > 1) {
        Some((chain, _)) => format!("joints of chain `{chain}`"),
        None => "joints".into(),
    }
}

/// Largest error of a joint's damping that is told, over itself.
const DAMPING_ERROR: f64 = 0.05;
/// Frames in which a joint must turn fast for its friction to be told.
pub const TURNED: usize = 12;
/// Largest error of a friction torque that is told [N m]: frames in which a joint sticks are no friction at its limit.
const TORQUE_ERROR_NM: f64 = 5e-3;
/// Frames in which a gap must be touched for its place to be told.
pub const TOUCHED: usize = 8;

/// What could not be measured, and what it takes.
pub fn lacking(audit: &Audit, header: &Header) -> Vec<String> {
    let mut lines = Vec::new();
    let duration_s = audit.to_s - audit.from_s;
    let pitch_m = header.links.first().map_or(0.0, |l| l.pitch_m);
    let period_s = pitch_m / header.chain_speed_m_s.abs().max(1e-12);
    let longest = header.chains().iter().map(ExactSizeIterator::len).max().unwrap_or(0);
    let lap_s = period_s * longest as f64;
    let (ms, us) = (|s: f64| s * 1e3, |s: f64| s * 1e6);
    let takes = |needed_s: f64, fine_s: f64| {
        let longer = duration_s.max(needed_s) * (audit.interval_s / fine_s).max(1.0);
        if audit.interval_s > fine_s {
            format!(
                "a frame every {:.0} us is too coarse: it takes one every {:.0} us, or {:.0} ms at this interval; `pitchline zoom` \
                 records a part again with --every",
                us(audit.interval_s),
                us(fine_s),
                ms(longer)
            )
        } else if duration_s < needed_s {
            format!("it takes {:.1} ms of the drive; this recording has {:.1} ms", ms(needed_s), ms(duration_s))
        } else {
            "they seldom do; it takes a longer recording".into()
        }
    };
    let still = audit.joints.iter().filter(|j| j.turning_samples < TURNED).count();
    if still > 0 {
        let text = takes(lap_s, 0.4 * period_s);
        lines.push(format!("friction of {still} joints, which turn in fewer than {TURNED} frames: {text}"));
    }
    let unknown = audit.links.iter().filter(|l| l.pitch_m().is_none()).count();
    if unknown > 0 {
        lines.push(format!("pitch of {unknown} links, without force across them: {}", takes(lap_s, 0.4 * period_s)));
    }
    for (fit, info) in audit.sprockets.iter().zip(&header.bodies) {
        // On a sprocket of a chain without links nothing ever lies over a gap.
        if fit.gaps.iter().all(|g| g.over == 0) && !header.spans.is_empty() {
            continue;
        }
        let few = fit.gaps.iter().filter(|g| g.over < TOUCHED).count();
        if few > 0 {
            let turn_s = if fit.turns > 0.0 { duration_s / fit.turns } else { period_s * f64::from(info.teeth) };
            let text = takes(1.2 * turn_s, 0.4 * turn_s / TOUCHED as f64);
            lines.push(format!("{few} tooth gaps of {}, met in fewer than {TOUCHED} frames: {text}", info.path));
        }
    }
    for guide in audit.guides.iter().filter(|g| g.touched == 0) {
        lines.push(format!(
            "{}: no link touches it; `--against` another recording compares the poses of straight guides",
            AuditPart::Body(guide.body).name(header)
        ));
    }
    let is_straight = |body: usize| header.bodies.get(body).is_some_and(|b| b.kind == BodyKind::Guide as u32);
    for guide in audit.guides.iter().filter(|g| g.touched > 0 && g.face.is_none() && is_straight(g.body)) {
        lines.push(format!(
            "height of {}, by itself: links touch its ends alone; `--against` another recording tells it",
            AuditPart::Body(guide.body).name(header)
        ));
    }
    lines.extend(unknown_to_audit(header));
    lines
}

/// Parts of a drive of which nothing is measured.
fn unknown_to_audit(header: &Header) -> Vec<String> {
    let sliding = |of: &str| header.sliders.iter().filter(|path| path.starts_with(of)).count();
    let rails = header.bodies.iter().filter(|b| b.kind == BodyKind::Rail as u32).count();
    let parts = [
        (header.rollers.len(), "rollers: their clearance, and stiffness and friction on their bushes"),
        (sliding("sliders.") + sliding("passages."), "plungers and check balls: their springs, stops and friction"),
        (header.touches.iter().filter(|path| path.ends_with(".cam")).count(), "valves: their springs and lash"),
        (
            rails,
            "rails and pivots of arms: their places, by themselves; `--against` another recording tells those of rails",
        ),
        (header.chambers.len(), "chambers and reservoirs: their oil"),
        (header.passages.len(), "passages: what flows through them"),
    ];
    let is_there =
        |(count, what): (usize, &str)| (count > 0).then(|| format!("{count} {what}: see `pitchline export`"));
    parts.into_iter().filter_map(is_there).collect()
}
