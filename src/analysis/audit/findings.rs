//! Which parts stand out, how far, and in words.
//!
//! A part stands out among its neighbours by its distance from their median in robust standard deviations, against the header or another recording
//! by its difference; over the largest of scatter, error of the fit and an eighth of the difference that counts, and of whole groups over the latter alone. From a score of
//! [`SCORE`] on it is a finding. What is the same in most parts of a group is one finding about the group.

use super::contours::{gap_forms, guide_heights, rail_places};
use super::measures::{
    AXES, AuditPart, CLEARANCE, ECCENTRICITY, GAP_FORM, JOINT_STIFFNESS, Measure, MeasureKind, Measured, OUTWARD,
    PITCH, PLACE_WAVE, PRELOAD, RING_ECCENTRICITY, TENSION, TIGHTENING, TOUCHED, measured,
};
use super::{Audit, Estimate};
use crate::diag::last_name;
use crate::recording::frame::Header;
use crate::statistics::{median, middle};
use std::collections::BTreeMap;

/// From this score on a part stands out. Measured: in healthy bundled drives of 30 to 100 ms no part lies further off than its scatter or the
/// difference that counts, that is a score of 8 at most by the latter.
const SCORE: f64 = 8.0;
/// What is compared with an exact zero has no scale.
const LARGEST_SCORE: f64 = 1e6;
/// Parts of a group that are compared with their median.
const NEIGHBOURS: usize = 6;
/// Share of a group beyond which a common difference is one of the group.
const MOST: f64 = 0.6;
/// A gap counts as never seated if the others are, in at least this share of the frames in which a joint lies over them. Measured:
/// 0.4 to 0.9 in the bundled drives; 0 in silent chains, whose flanks touch instead.
const SEATED: f64 = 0.2;
/// Share of a tightening at rest that the mean tension of the moving chain follows at least. Measured on two sprockets and an arm: 0.3 to 1;
/// tensioners take up the rest.
const FOLLOWS: f64 = 0.2;
/// Turns of a sprocket after which all its gaps have carried the chain.
const TURNS: f64 = 1.1;

/// Something that stands out.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Finding {
    pub part: String,
    pub quantity: &'static str,
    pub link: Option<usize>,
    pub joint: Option<usize>,
    /// Path of the body.
    pub body: Option<String>,
    pub tooth: Option<u32>,
    /// Measured, what it is compared with, and their difference, in SI.
    pub value: f64,
    pub reference: f64,
    pub difference: f64,
    /// `neighbours`, `header` or `recording`.
    pub against: &'static str,
    pub score: f64,
    pub kind: MeasureKind,
    pub text: String,
}

/// What stands out among neighbours and against the header, the furthest first; properties before what they lead to.
pub fn findings(audit: &Audit, header: &Header) -> Vec<Finding> {
    let all = measured(audit, header);
    let mut found = Vec::new();
    for group in groups(&all).values() {
        let values: Vec<f64> = group.iter().map(|m| m.estimate.value).collect();
        let (centre, scatter) = middle(&values);
        if group.len() < NEIGHBOURS {
            continue;
        }
        for m in group {
            let judged = Judged { reference: centre, scatter, against: "neighbours" };
            found.extend(judged.finding(m, header));
        }
    }
    for m in &all {
        let Some(declared) = m.declared.filter(|_| m.measure.key != "preload_n") else { continue };
        let judged = Judged { reference: declared, scatter: m.estimate.error, against: "header" };
        found.extend(judged.finding(m, header).map(|f| with_more(f, m, audit, (header, header))));
    }
    found.extend(unseated(audit, header));
    ranked(found)
}

/// What differs from another recording of the same drive, the furthest first; then what stands out by itself.
pub fn compared(audit: &Audit, header: &Header, good: &Audit, good_header: &Header) -> Vec<Finding> {
    let (all, theirs) = (measured(audit, header), measured(good, good_header));
    let reference: BTreeMap<(AuditPart, &str), &Measured> =
        theirs.iter().map(|m| ((m.part, m.measure.key), m)).collect();
    let mut found = Vec::new();
    for group in groups(&all).values() {
        let pairs: Vec<(&Measured, f64)> = group
            .iter()
            .filter_map(|m| Some((*m, m.estimate.value - reference.get(&(m.part, m.measure.key))?.estimate.value)))
            .collect();
        let Some((first, _)) = pairs.first() else { continue };
        let shift = median(pairs.iter().map(|(_, d)| *d));
        let of = |m: &Measured| m.estimate.value - shift;
        let least = first.measure.smallest(median(pairs.iter().map(|(m, _)| of(m))));
        let shifted = pairs.iter().filter(|(_, d)| d * shift > 0.0 && d.abs() >= least).count();
        let common = shifted as f64 > MOST * pairs.len() as f64;
        if common {
            found.push(of_group(first, &pairs, (shift, shifted), least));
        }
        let scatter = middle(&pairs.iter().map(|(_, d)| *d).collect::<Vec<_>>()).1;
        for (m, difference) in &pairs {
            let reference = m.estimate.value - difference + if common { shift } else { 0.0 };
            // Where all share a difference, what is left of a part is its difference from its neighbours.
            let against = if common { "neighbours" } else { "recording" };
            found.extend(Judged { reference, scatter, against }.finding(m, header));
        }
    }
    let mut moved_m = 0.0_f64;
    for m in all.iter().filter(|m| m.group.is_none()) {
        let other = reference.get(&(m.part, m.measure.key)).map(|other| other.estimate);
        // A guide that no link touches there is compared with the other guides there.
        let Some(other) = other.or_else(|| of_other_guides(m, audit, &theirs)) else { continue };
        let judged =
            Judged { reference: other.value, scatter: m.estimate.error.max(other.error), against: "recording" };
        if m.measure == &AXES {
            moved_m = moved_m.max((m.estimate.value - other.value).abs());
        }
        found.extend(judged.finding(m, header).map(|f| with_more(f, m, audit, (header, good_header))));
    }
    found.extend(guide_heights(audit, (header, good_header), moved_m));
    found.extend(rail_places(audit, good, header, good_header));
    found.extend(gap_forms(audit, header, good_header));
    found.extend(tightening(&found, (&all, &theirs), header));
    let own = findings(audit, header);
    let known = |f: &Finding| found.iter().any(|k| k.part == f.part && k.quantity == f.quantity);
    let news: Vec<Finding> = own.into_iter().filter(|f| !known(f)).collect();
    let was_so = findings(good, good_header);
    found.extend(news.into_iter().filter(|f| !was_so.iter().any(|w| w.part == f.part && w.quantity == f.quantity)));
    ranked(found)
}

/// Adds where an eccentricity points, how many waves a turn has, what tension headers declare.
fn with_more(mut finding: Finding, m: &Measured, audit: &Audit, (header, other): (&Header, &Header)) -> Finding {
    if m.measure == &PRELOAD {
        let (own, theirs) = (header.static_tension_n, other.static_tension_n);
        finding.text += &format!("; at rest under load the headers declare {own:.1} and {theirs:.1} N");
    }
    let AuditPart::Body(body) = m.part else { return finding };
    let Some(fit) = audit.sprockets.get(body) else { return finding };
    let degrees = |rad: f64| rad / crate::units::DEG;
    let more = if m.measure == &ECCENTRICITY {
        format!("; it points {:.0} deg counterclockwise from gap 0", degrees(fit.eccentric_towards_rad))
    } else if m.measure == &RING_ECCENTRICITY {
        format!("; it points {:.0} deg counterclockwise from gap 0", degrees(fit.ring_towards_rad))
    } else if m.measure == &PLACE_WAVE {
        format!("; {} waves a turn", fit.wave.map_or(0, |w| w.order))
    } else {
        String::new()
    };
    finding.text += &more;
    finding
}

/// Median of a number over the guides of the other recording, for a guide that has none there.
fn of_other_guides(m: &Measured, audit: &Audit, theirs: &[Measured]) -> Option<Estimate> {
    let is_guide = |part: AuditPart| audit.guides.iter().any(|g| part == AuditPart::Body(g.body));
    if !is_guide(m.part) {
        return None;
    }
    let own = || theirs.iter().filter(|t| t.measure == m.measure && is_guide(t.part)).map(|t| t.estimate);
    let value = median(own().map(|e| e.value));
    value.is_finite().then_some(Estimate { value, error: own().map(|e| e.error).fold(0.0, f64::max), samples: 0 })
}

fn ranked(mut found: Vec<Finding>) -> Vec<Finding> {
    // How much a chain is tightened says what its moved axes and its tension mean.
    let explains = |f: &Finding| f.quantity == TIGHTENING.key;
    found.sort_by(|a, b| b.kind.cmp(&a.kind).then(explains(b).cmp(&explains(a))).then(b.score.total_cmp(&a.score)));
    // The same part and number by neighbours and by header: the further one.
    let mut kept: Vec<Finding> = Vec::new();
    for finding in found {
        if !kept.iter().any(|k| k.part == finding.part && k.quantity == finding.quantity) {
            kept.push(finding);
        }
    }
    kept
}

fn groups(all: &[Measured]) -> BTreeMap<(String, &'static str), Vec<&Measured>> {
    let mut groups: BTreeMap<(String, &'static str), Vec<&Measured>> = BTreeMap::new();
    for m in all {
        if let Some(group) = &m.group {
            groups.entry((group.clone(), m.measure.key)).or_default().push(m);
        }
    }
    groups
}

impl Measure {
    /// Smallest difference from a value that counts.
    fn smallest(&self, from: f64) -> f64 {
        self.least.max(self.least_share * from.abs())
    }

    /// A value with its unit.
    pub fn shown(&self, value: f64) -> String {
        let (unit, size) = self.shown_in;
        format!("{} {unit}", digits(value / size)).trim_end().to_string()
    }

    /// The size of a difference with its unit.
    pub fn size(&self, difference: f64) -> String {
        let (unit, size) = self.unit;
        format!("{} {unit}", rough(difference.abs() / size)).trim_end().to_string()
    }
}

/// A difference in percent, of quantities that are compared so.
fn share(measure: &Measure, difference: f64, reference: f64) -> String {
    let is_share = measure.least_share > 0.0 && reference.abs() > 1e-3 * difference.abs();
    if is_share { format!(" ({:.0} %)", 100.0 * (difference / reference).abs()) } else { String::new() }
}

/// Five digits.
fn digits(value: f64) -> String {
    let places =
        if value.abs() < 5e-7 { 1 } else { (4.0 - libm::floor(libm::log10(value.abs()))).clamp(0.0, 6.0) as usize };
    let shown = format!("{value:.places$}");
    // No sign before a zero.
    if shown.trim_matches(['-', '0', '.']).is_empty() { shown.replace('-', "") } else { shown }
}

/// Three digits.
fn rough(value: f64) -> String {
    let places =
        if value.abs() < 5e-7 { 1 } else { (2.0 - libm::floor(libm::log10(value.abs()))).clamp(0.0, 6.0) as usize };
    format!("{value:.places$}")
}

/// What a number is compared with.
#[derive(Clone, Copy, Debug)]
pub(super) struct Judged {
    pub reference: f64,
    pub scatter: f64,
    pub against: &'static str,
}

impl Judged {
    pub fn finding(&self, m: &Measured, header: &Header) -> Option<Finding> {
        let difference = m.estimate.value - self.reference;
        let least = m.measure.smallest(self.reference);
        let score = difference.abs() / self.scatter.max(m.estimate.error).max(least / SCORE).max(1e-300);
        if score.is_nan() || score < SCORE {
            return None;
        }
        let score = score.min(LARGEST_SCORE);
        let name = m.part.name(header);
        let word = if difference > 0.0 { m.measure.more } else { m.measure.less };
        let than = match self.against {
            "neighbours" => format!("than the other {}", m.group.as_deref().unwrap_or("parts")),
            "header" => "than the header declares".to_string(),
            _ => "than in the other recording".to_string(),
        };
        let size = m.measure.size(difference);
        let (own, other) = (m.measure.shown(m.estimate.value), m.measure.shown(self.reference));
        let share = share(m.measure, difference, self.reference);
        let place = place(m.part, header);
        let text = if matches!(m.part, AuditPart::Gap(..)) {
            format!("{name} lies {size} {word} {}", beside(self.against))
        } else if m.declared == Some(0.0) {
            format!("{name}: {} {own}, {other} {}", m.measure.words, from(self.against))
        } else {
            format!("{name}: {} {own}, {size}{share} {word} {than} ({other}){place}", m.measure.words)
        };
        Some(self.told(m, header, difference, score, text))
    }

    fn told(&self, m: &Measured, header: &Header, difference: f64, score: f64, text: String) -> Finding {
        let body = |b: usize| header.bodies.get(b).map(|b| b.path.clone());
        Finding {
            part: m.part.name(header),
            quantity: m.measure.key,
            link: if let AuditPart::Link(i) = m.part { Some(i) } else { None },
            joint: if let AuditPart::Joint(j) = m.part { Some(j) } else { None },
            body: match m.part {
                AuditPart::Gap(b, _) | AuditPart::Body(b) => body(b),
                AuditPart::Turning(k) => header.coordinates.get(k).cloned(),
                AuditPart::Link(_) | AuditPart::Joint(_) | AuditPart::Span(_) => None,
                AuditPart::Spans | AuditPart::Account(_) => None,
            },
            tooth: if let AuditPart::Gap(_, gap) = m.part { Some(gap) } else { None },
            value: m.estimate.value,
            reference: self.reference,
            difference,
            against: self.against,
            score,
            kind: m.measure.kind,
            text: format!("{text} (score {score:.0})"),
        }
    }
}

fn beside(against: &str) -> &'static str {
    match against {
        "header" => "against the header",
        "neighbours" => "against the other gaps of its sprocket",
        _ => "against the other recording",
    }
}

fn from(against: &str) -> &'static str {
    match against {
        "header" => "by the header",
        "neighbours" => "of the others",
        _ => "in the other recording",
    }
}

/// Where a link or joint lies.
fn place(part: AuditPart, header: &Header) -> String {
    match part {
        AuditPart::Link(i) => {
            let behind = header.links.iter().position(|l| l.ahead as usize == i).unwrap_or(0);
            format!("; it lies between joints {behind} and {i}")
        }
        AuditPart::Joint(j) => {
            let ahead = header.links.get(j).map_or(0, |l| l.ahead);
            format!("; it joins links {j} and {ahead}")
        }
        AuditPart::Gap(..) | AuditPart::Body(_) | AuditPart::Span(_) => String::new(),
        AuditPart::Turning(_) | AuditPart::Spans | AuditPart::Account(_) => String::new(),
    }
}

/// A difference that most parts of a group share.
fn of_group(first: &Measured, pairs: &[(&Measured, f64)], (shift, shifted): (f64, usize), least: f64) -> Finding {
    let measure = first.measure;
    let group = first.group.clone().unwrap_or_default();
    let value = median(pairs.iter().map(|(m, _)| m.estimate.value));
    let word = if shift > 0.0 { measure.more } else { measure.less };
    let share = share(measure, shift, value - shift);
    let score = shift.abs() / (least / SCORE).max(1e-300);
    let text = format!(
        "{} {group}: {} {}, {}{share} {word} than in the other recording ({}) (score {score:.0})",
        if shifted < pairs.len() { format!("{shifted} of {}", pairs.len()) } else { format!("all {shifted}") },
        measure.words,
        measure.shown(value),
        measure.size(shift),
        measure.shown(value - shift),
    );
    Finding {
        part: group,
        quantity: measure.key,
        link: None,
        joint: None,
        body: None,
        tooth: None,
        value,
        reference: value - shift,
        difference: shift,
        against: "recording",
        score,
        kind: measure.kind,
        text,
    }
}

/// Gaps that no link seats in while the others of their sprocket are seated.
fn unseated(audit: &Audit, header: &Header) -> Vec<Finding> {
    let mut found = Vec::new();
    for (body, fit) in audit.sprockets.iter().enumerate() {
        let share = |g: &super::gaps::GapFit| g.seated as f64 / g.over.max(1) as f64;
        let usual = median(fit.gaps.iter().filter(|g| g.over >= TOUCHED).map(share));
        // Within less than a turn, a gap may have met the chain only where it leaves.
        if usual.is_nan() || usual < SEATED || fit.turns < TURNS {
            continue;
        }
        let met = TOUCHED.max(median(fit.gaps.iter().map(|g| g.over as f64)) as usize / 2);
        for (g, gap) in fit.gaps.iter().enumerate().filter(|(_, g)| g.over >= met && share(g) < 0.02 * usual) {
            let gap_number = u32::try_from(g).unwrap_or(u32::MAX);
            let estimate = Estimate { value: gap.sinks_m, error: 0.0, samples: gap.over };
            let part = AuditPart::Gap(body, gap_number);
            let m = Measured { part, measure: &OUTWARD, estimate, declared: None, group: None };
            let seated = match gap.seated {
                0 => format!("is never seated in the {} frames", gap.over),
                n => format!("is seated in {n} of the {} frames only", gap.over),
            };
            let sinks_um = -gap.sinks_m * 1e6;
            let depth = if sinks_um < 0.5 {
                String::new()
            } else {
                format!(", by more than the {sinks_um:.1} um that joints sink deeper there")
            };
            let text = format!("{} {seated} in which a joint lies over it: it is low{depth}", part.name(header));
            let judged = Judged { reference: 0.0, scatter: 0.0, against: "neighbours" };
            found.push(judged.told(&m, header, gap.sinks_m.min(0.0), usual / SEATED * SCORE, text));
        }
    }
    found
}

/// How much less or more the chain was tightened at rest: links and joints being as long and stiff as in the other recording, from how far the
/// axes of the spans moved, n of its joints in series with the measured stiffness.
fn tightening(found: &[Finding], (all, theirs): (&[Measured], &[Measured]), header: &Header) -> Option<Finding> {
    let lengths = [PITCH.key, CLEARANCE.key, JOINT_STIFFNESS.key, GAP_FORM.key];
    // Axes that carry several chains do not tell which of them they tighten.
    if header.chains().len() > 1 {
        return None;
    }
    if found.iter().any(|f| lengths.contains(&f.quantity)) {
        return None;
    }
    let value =
        |list: &[Measured], key: &str| median(list.iter().filter(|m| m.measure.key == key).map(|m| m.estimate.value));
    let axes = |list: &[Measured], part: AuditPart| {
        list.iter().find(|m| m.measure == &AXES && m.part == part).map(|m| m.estimate.value)
    };
    let moved = all.iter().filter(|m| m.measure == &AXES).filter_map(|m| {
        let AuditPart::Span((from, to)) = m.part else { return None };
        let spans = all.iter().filter(|s| s.measure == &TENSION);
        let spans = spans.filter(|s| s.part == m.part || s.part == AuditPart::Span((to, from))).count();
        let radius = |b: usize| {
            let teeth = header.bodies.get(b).map_or(0, |b| b.teeth).max(1);
            0.5 * value(all, PITCH.key) / crate::units::sin_cos(std::f64::consts::PI / f64::from(teeth)).0
        };
        let lean = (radius(to) - radius(from)) / m.estimate.value;
        let change = m.estimate.value - axes(theirs, m.part)?;
        Some(spans as f64 * change * (1.0 - lean * lean).max(0.0).sqrt())
    });
    let longer_m: f64 = moved.sum();
    let difference = value(all, JOINT_STIFFNESS.key) * longer_m / header.links.len().max(1) as f64;
    let tension = value(theirs, PRELOAD.key);
    // Where the chain's mean tension does not follow, the axes moved for another reason, e.g. under the load of their bearings.
    let followed = value(all, PRELOAD.key) - tension;
    if followed * difference.signum() < FOLLOWS * difference.abs() {
        return None;
    }
    let estimate = Estimate { value: tension + difference, error: 0.0, samples: 0 };
    let m = Measured { part: AuditPart::Spans, measure: &TIGHTENING, estimate, declared: None, group: None };
    let judged = Judged { reference: tension, scatter: 0.0, against: "recording" };
    let mut finding = judged.finding(&m, header)?;
    finding.text = format!(
        "chain: it is tightened by {} {} at rest than in the other recording, as its axes stand and its joints yield (score {:.0})",
        TIGHTENING.size(difference),
        if difference > 0.0 { "more" } else { "less" },
        finding.score
    );
    Some(finding)
}

/// What differs between two recordings that are of two drives; None: they are of one.
pub fn difference(a: &Header, b: &Header) -> Option<String> {
    if a.links.len() != b.links.len() {
        return Some(format!("their chains have {} and {} links", a.links.len(), b.links.len()));
    }
    let kinds = |h: &Header| h.link_outlines.iter().map(|o| o.name.clone()).collect::<Vec<_>>();
    let bodies = |h: &Header| h.bodies.iter().map(|b| (b.path.clone(), b.teeth)).collect::<Vec<_>>();
    let (own, theirs) = (bodies(a), bodies(b));
    if let Some((path, teeth)) = own.iter().find(|body| !theirs.contains(body)) {
        let other = theirs.iter().find(|(other, _)| other == path);
        return Some(match other {
            Some((_, other)) => format!("`{}` has {teeth} and {other} teeth", last_name(path)),
            None => format!("`{path}` is in one only"),
        });
    }
    let shape = |h: &Header| h.link_outlines.iter().map(|o| o.elements.len()).collect::<Vec<_>>();
    if own.len() != theirs.len() || kinds(a) != kinds(b) || shape(a) != shape(b) {
        return Some("their links or bodies have other contours".into());
    }
    None
}
