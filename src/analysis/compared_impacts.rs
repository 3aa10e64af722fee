//! Impacts of two recordings of a drive: what stands out in one alone, and bodies whose impacts differ.
//!
//! Bodies are listed apart, because they tell what a fault does and seldom what it is. What stands out in the other recording too is left out.

use super::suspects::{FoundSuspects, Suspect, empty_suspect, period_s, suspects};
use crate::recording::frame::{Header, Impact};
use crate::statistics::median;
use std::collections::BTreeMap;

/// Ratio in number, force or speed of impacts above which a part of a body stands out.
const RATIO: f64 = 1.05;

/// The time that two recordings have in common.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Common {
    pub from_s: f64,
    pub to_s: f64,
    /// Whether it is not the whole of both.
    pub is_part: bool,
    /// Time for which an impact is observed [s].
    #[serde(skip)]
    watched_s: f64,
}

/// None where it is too short for an impact to be observed.
pub fn common(a: (f64, f64), b: (f64, f64), header: &Header) -> Option<Common> {
    let (from_s, to_s) = (a.0.max(b.0), a.1.min(b.1));
    let watched_s = crate::impacts::WATCHED_PERIODS * period_s(header);
    let common = Common { from_s, to_s, is_part: a != b, watched_s };
    (to_s - from_s > watched_s).then_some(common)
}

impl Common {
    /// Whether both recordings observe an impact at this time to its end. Where they end together, those that the end cuts off count in both.
    fn holds(&self, i: &Impact) -> bool {
        !self.is_part || (i.t_s >= self.from_s && i.t_s + self.watched_s <= self.to_s)
    }
}

/// What stands out in a recording and not in another, each judged over its whole length, and which bodies' impacts differ over the time that both
/// have. With each, the time that it was recorded.
pub fn against(
    own: (&[Impact], &Header, (f64, f64)),
    other: (&[Impact], &Header, (f64, f64)),
    common: &Common,
) -> FoundSuspects {
    let mut found = suspects(own.0, own.1, own.2);
    let theirs = suspects(other.0, other.1, other.2).suspects;
    let same = |a: &Suspect, b: &Suspect| (a.kind, &a.body, a.tooth, a.link) == (b.kind, &b.body, b.tooth, b.link);
    found.suspects.retain(|s| !theirs.iter().any(|t| same(s, t)));
    found.differences = compared_with((own.0, own.1), (other.0, other.1), common);
    found
}

/// Parts of bodies whose impacts differ from those of another recording, in number, force or speed; the largest
/// difference first.
fn compared_with(
    (impacts, header): (&[Impact], &Header),
    (other, other_header): (&[Impact], &Header),
    common: &Common,
) -> Vec<Suspect> {
    let mut found = Vec::new();
    for info in &header.bodies {
        let mut mine = of_body(impacts, header, &info.path);
        let mut theirs = of_body(other, other_header, &info.path);
        mine.retain(|i| common.holds(i));
        theirs.retain(|i| common.holds(i));
        let median_of = |all: &[&Impact], value: fn(&Impact) -> f64| median(all.iter().map(|i| value(i)));
        let compared: [(&'static str, &str, &str, f64, f64); 3] = [
            ("impacts", "impacts", "", mine.len() as f64, theirs.len() as f64),
            (
                "peak_force_n",
                "median peak force",
                " N",
                median_of(&mine, |i| i.peak_force_n),
                median_of(&theirs, |i| i.peak_force_n),
            ),
            (
                "approach_speed_m_s",
                "median approach speed",
                " m/s",
                median_of(&mine, |i| i.approach_speed_m_s),
                median_of(&theirs, |i| i.approach_speed_m_s),
            ),
        ];
        for (quantity, words, unit, here, there) in compared {
            let ratio = (here.max(there) + 1e-9) / (here.min(there) + 1e-9);
            // A small difference in number is random; impacts against none are significant.
            let few = quantity == "impacts" && (here - there).abs() < 2.0 * here.max(there).sqrt();
            if ratio.is_nan() || ratio < RATIO || few {
                continue;
            }
            let first_s = mine.iter().map(|i| i.t_s).fold(f64::INFINITY, f64::min);
            let where_ = if mine.is_empty() {
                String::new()
            } else {
                format!(", {}", crate::recording::frame::Segment::name(most_common(mine.iter().map(|i| i.segment))))
            };
            found.push(Suspect {
                kind: "body",
                quantity,
                median: here,
                others: there,
                score: libm::log(ratio),
                impacts: mine.len(),
                first_s: if first_s.is_finite() { first_s } else { 0.0 },
                text: format!(
                    "{}{where_}: {words} {here:.3}{unit}, in the other recording {there:.3}{unit}",
                    info.path
                ),
                ..empty_suspect(&info.path)
            });
        }
    }
    found.sort_by(|a: &Suspect, b: &Suspect| b.score.total_cmp(&a.score));
    found
}

fn of_body<'a>(impacts: &'a [Impact], header: &Header, path: &str) -> Vec<&'a Impact> {
    let body = header.bodies.iter().position(|b| b.path == path);
    impacts.iter().filter(|i| Some(i.body as usize) == body).collect()
}

fn most_common(values: impl Iterator<Item = u32>) -> u32 {
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    values.for_each(|v| *counts.entry(v).or_default() += 1);
    counts.into_iter().max_by_key(|(_, n)| *n).map_or(0, |(v, _)| v)
}
