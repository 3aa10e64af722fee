//! Which parts stand out, how far, and in words.
//!
//! A part stands out among its neighbours by its distance from their median in robust standard deviations, against the header or another recording
//! by its difference; in all cases over the largest of scatter, error of the fit and an eighth of the difference that counts. From a score of
//! [`SCORE`] on it is a finding. What is the same in most parts of a group is one finding about the group.

use super::guides::GuideFit;
use super::least_squares::{median, middle};
use super::measures::{
    AuditPart, GUIDE_HEIGHT, Measure, Measured, OUTWARD, PITCH, TOUCHED, measured, short,
};
use super::{Audit, Estimate};
use crate::recording::frame::Header;
use std::collections::BTreeMap;

/// From this score on a part stands out.
const SCORE: f64 = 8.0;
/// Parts of a group that are compared with their median.
const NEIGHBOURS: usize = 6;
/// Share of a group beyond which a common difference is one of the group.
const MOST: f64 = 0.6;
/// A gap counts as never seated if the others are, in at least this share of the frames in which a joint lies over them.
const SEATED: f64 = 0.2;

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
    /// A property of the part; if not, a force or a loss, as properties lead to.
    pub is_property: bool,
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
        found.extend(judged.finding(m, header));
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
            found.push(of_group(first, &pairs, shift, least));
        }
        let scatter = middle(&pairs.iter().map(|(_, d)| *d).collect::<Vec<_>>()).1;
        for (m, difference) in &pairs {
            let reference = m.estimate.value - difference + if common { shift } else { 0.0 };
            found.extend(Judged { reference, scatter, against: "recording" }.finding(m, header));
        }
    }
    for m in all.iter().filter(|m| m.group.is_none()) {
        let Some(other) = reference.get(&(m.part, m.measure.key)) else { continue };
        let judged = Judged {
            reference: other.estimate.value,
            scatter: m.estimate.error.max(other.estimate.error),
            against: "recording",
        };
        found.extend(judged.finding(m, header));
    }
    found.extend(guide_heights(audit, header, good_header));
    let own = findings(audit, header);
    let known = |f: &Finding| found.iter().any(|k| k.part == f.part && k.quantity == f.quantity);
    let news: Vec<Finding> = own.into_iter().filter(|f| !known(f)).collect();
    let was_so = findings(good, good_header);
    found.extend(news.into_iter().filter(|f| !was_so.iter().any(|w| w.part == f.part && w.quantity == f.quantity)));
    ranked(found)
}

fn ranked(mut found: Vec<Finding>) -> Vec<Finding> {
    found.sort_by(|a, b| (b.is_property, b.score).partial_cmp(&(a.is_property, a.score)).unwrap_or(std::cmp::Ordering::Equal));
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
    fn size(&self, difference: f64) -> String {
        let (unit, size) = self.unit;
        format!("{} {unit}", rough(difference.abs() / size)).trim_end().to_string()
    }
}

/// Some six digits.
fn digits(value: f64) -> String {
    let places = if value == 0.0 { 3 } else { (5.0 - libm::floor(libm::log10(value.abs()))).clamp(0.0, 6.0) as usize };
    format!("{value:.places$}")
}

/// Three digits.
fn rough(value: f64) -> String {
    let places = if value == 0.0 { 1 } else { (2.0 - libm::floor(libm::log10(value.abs()))).clamp(0.0, 6.0) as usize };
    format!("{value:.places$}")
}

/// What a number is compared with.
#[derive(Clone, Copy, Debug)]
struct Judged {
    reference: f64,
    scatter: f64,
    against: &'static str,
}

impl Judged {
    fn finding(&self, m: &Measured, header: &Header) -> Option<Finding> {
        let difference = m.estimate.value - self.reference;
        let least = m.measure.smallest(self.reference);
        let score = difference.abs() / self.scatter.max(m.estimate.error).max(least / SCORE).max(1e-300);
        if score.is_nan() || score < SCORE {
            return None;
        }
        let name = m.part.name(header);
        let word = if difference > 0.0 { m.measure.more } else { m.measure.less };
        let than = match self.against {
            "neighbours" => format!("than the other {}", m.group.as_deref().unwrap_or("parts")),
            "header" => "than the header declares".to_string(),
            _ => "than in the other recording".to_string(),
        };
        let size = m.measure.size(difference);
        let (own, other) = (m.measure.shown(m.estimate.value), m.measure.shown(self.reference));
        let share = if self.reference.abs() > 1e-3 * m.estimate.value.abs() && m.measure.least_share > 0.0 {
            format!(", {:+.0} %", 100.0 * difference / self.reference.abs())
        } else {
            String::new()
        };
        let place = place(m.part, header);
        let text = match m.part {
            AuditPart::Gap(..) => format!("{name} lies {size} {word} ({than}){place}"),
            _ if m.measure.words == "eccentricity of its gaps" || m.measure.words == "eccentricity of its ring" => {
                format!("{name}: {} is {own}, {other} {}", m.measure.words, from(self.against))
            }
            _ => format!("{name}: {} {own}, {size} {word}{share} {than} ({other}){place}", m.measure.words),
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
            is_property: m.measure.is_property,
            text: format!("{text} (score {score:.0})"),
        }
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
fn of_group(first: &Measured, pairs: &[(&Measured, f64)], shift: f64, least: f64) -> Finding {
    let measure = first.measure;
    let group = first.group.clone().unwrap_or_default();
    let value = median(pairs.iter().map(|(m, _)| m.estimate.value));
    let word = if shift > 0.0 { measure.more } else { measure.less };
    let share = if measure.least_share > 0.0 {
        format!(", {:+.0} %", 100.0 * shift / (value - shift).abs().max(1e-300))
    } else {
        String::new()
    };
    let score = shift.abs() / (least / SCORE).max(1e-300);
    let text = format!(
        "all {} {group}: {} {}, {} {word}{share} than in the other recording ({}) (score {score:.0})",
        pairs.len(),
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
        is_property: measure.is_property,
        text,
    }
}

/// Gaps that no link seats in while the others of their sprocket are seated.
fn unseated(audit: &Audit, header: &Header) -> Vec<Finding> {
    let mut found = Vec::new();
    for (body, fit) in audit.sprockets.iter().enumerate() {
        let share = |g: &super::gaps::GapFit| g.seated as f64 / g.over.max(1) as f64;
        let usual = median(fit.gaps.iter().filter(|g| g.over >= TOUCHED).map(share));
        if usual.is_nan() || usual < SEATED {
            continue;
        }
        for (g, gap) in fit.gaps.iter().enumerate().filter(|(_, g)| g.over >= TOUCHED && share(g) < 0.02 * usual) {
            let gap_number = u32::try_from(g).unwrap_or(u32::MAX);
            let estimate = Estimate { value: gap.sinks_m, error: 0.0, samples: gap.over };
            let part = AuditPart::Gap(body, gap_number);
            let m = Measured { part, measure: &OUTWARD, estimate, declared: None, group: None };
            let seated = if gap.seated == 0 { "never".to_string() } else { format!("in {} frames only", gap.seated) };
            let depth = gap.sinks_m * 1e6;
            let text = format!(
                "{} is seated {seated}, of {} in which a joint lies over it: at least {:.1} um low",
                part.name(header),
                gap.over,
                (-depth).max(0.0)
            );
            let judged = Judged { reference: 0.0, scatter: 0.0, against: "neighbours" };
            found.push(judged.told(&m, header, gap.sinks_m.min(0.0), usual / SEATED * SCORE, text));
        }
    }
    found
}

/// How far straight faces stand above those of the other recording.
fn guide_heights(audit: &Audit, header: &Header, good: &Header) -> Vec<Finding> {
    let mut found = Vec::new();
    for guide in &audit.guides {
        let Some(path) = header.bodies.get(guide.body).map(|b| &b.path) else { continue };
        let Some(other) = good.bodies.iter().find(|b| b.path == *path) else { continue };
        let Some(ends) = ends_above(guide, (other.x_m, other.y_m, other.angle_rad)) else { continue };
        let (end, height) = if ends[0].abs() > ends[1].abs() { ("start", ends[0]) } else { ("end", ends[1]) };
        let estimate = Estimate { value: height, error: 0.0, samples: guide.touched };
        let m = Measured { part: AuditPart::Body(guide.body), measure: &GUIDE_HEIGHT, estimate, declared: None, group: None };
        let judged = Judged { reference: 0.0, scatter: 0.0, against: "recording" };
        if let Some(mut finding) = judged.finding(&m, header) {
            finding.text = format!(
                "{path}: its face stands {} {} at its {end}, {} at the other, than in the other recording (score {:.0})",
                GUIDE_HEIGHT.size(height),
                if height > 0.0 { "higher" } else { "lower" },
                GUIDE_HEIGHT.size(if end == "start" { ends[1] } else { ends[0] }),
                finding.score
            );
            found.push(finding);
        }
    }
    found
}

/// Heights of both ends of a face in another guide's frame.
fn ends_above(guide: &GuideFit, (x, y, angle): (f64, f64, f64)) -> Option<[f64; 2]> {
    let (sin, cos) = crate::units::sin_cos(angle);
    guide.face.map(|ends| ends.map(|p| (p[1] - y) * cos - (p[0] - x) * sin))
}

/// Whether two recordings are of one drive; if not, what differs.
pub fn same_drive(a: &Header, b: &Header) -> Result<(), String> {
    if a.links.len() != b.links.len() {
        return Err(format!("their chains have {} and {} links", a.links.len(), b.links.len()));
    }
    let kinds = |h: &Header| h.link_outlines.iter().map(|o| o.name.clone()).collect::<Vec<_>>();
    let bodies = |h: &Header| h.bodies.iter().map(|b| (b.path.clone(), b.teeth)).collect::<Vec<_>>();
    let (own, theirs) = (bodies(a), bodies(b));
    if let Some((path, teeth)) = own.iter().find(|body| !theirs.contains(body)) {
        let other = theirs.iter().find(|(other, _)| other == path);
        return Err(match other {
            Some((_, other)) => format!("`{}` has {teeth} and {other} teeth", short(path)),
            None => format!("`{path}` is in one only"),
        });
    }
    let shape = |h: &Header| h.link_outlines.iter().map(|o| o.elements.len()).collect::<Vec<_>>();
    if own.len() != theirs.len() || kinds(a) != kinds(b) || shape(a) != shape(b) {
        return Err("their links or bodies have other contours".into());
    }
    Ok(())
}

/// The link that is told about where its pitch is: for tests of texts.
pub fn is_pitch(finding: &Finding) -> bool {
    finding.quantity == PITCH.key
}
