//! Finds the tooth, link or body that stands out among all impacts.
//!
//! Impacts of one part of links on one body (front bushes on the driver, say) are comparable. The departure of an
//! impact is its distance from their median in robust standard deviations (1.4826 x median absolute deviation). Impacts
//! with another common property, a tooth gap or a joint of the chain, form a group. A group stands out if the median of
//! its m departures times sqrt(m) exceeds [`SCORE`] and its difference is not negligible. Of two middle values the
//! smaller one counts, so that one odd impact of two has no effect. Impacts cut off by the end of the run and those of
//! its first two tooth periods are ignored.
//!
//! A fault at one tooth or link also disturbs the ones that arrive after it, and in force also the one before. Of
//! neighbours that stand out, the cause is therefore the one that arrives first, judged by quantities known at first
//! contact (time of arrival, approach speed); a joint indicates the link ahead of it. The other neighbours, and groups
//! that share most of their impacts with them, are consequences and are removed before the search continues.
//!
//! A fault that is the same for all teeth and links, such as another seat form or a guide in the way, shows only in
//! comparison with another recording: see [`compared_with`].

use crate::recording::frame::{Feature, Header, Impact};
use std::collections::{BTreeMap, BTreeSet};

/// Departure above which a group stands out: in runs of the bundled drives of 30 to 300 ms without defects none of some
/// 240 groups by four quantities goes beyond 7.
const SCORE: f64 = 8.0;
/// Smallest departure that counts, relative to the median, for forces and speeds.
const SHARE: f64 = 0.02;
/// Smallest difference in time of arrival that counts [s].
const MIN_DELAY_S: f64 = 1e-6;
/// Smallest number of impacts for a reference median, and for a group.
const MIN_IMPACTS: usize = 12;
const MIN_IN_GROUP: usize = 2;
/// Tooth periods for which an impact must have been observed, and for which a run settles.
const WATCHED: f64 = 1.9;
const SETTLED: f64 = 2.0;
/// Maximum number of following groups that count as consequences of a cause.
const CONSEQUENCES: u32 = 8;
/// In comparison with another recording: ratio in number, force or speed of impacts above which a part of a body stands
/// out.
const RATIO: f64 = 1.05;

/// A tooth, link or body that stands out.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Suspect {
    /// `tooth`, `link` or `body`.
    pub kind: &'static str,
    /// Path of the body.
    pub body: String,
    pub tooth: Option<u32>,
    pub link: Option<u32>,
    /// Quantity in which it stands out, its median for this group and for the others.
    pub quantity: &'static str,
    pub median: f64,
    pub others: f64,
    /// Departure in robust standard deviations, times the square root of the number of impacts.
    pub score: f64,
    pub impacts: usize,
    /// Time of the first of them [s].
    pub first_s: f64,
    pub text: String,
}

/// Quantities in which groups are compared: name, words, unit, factor for text.
const QUANTITIES: [(&str, &str, &str, f64); 4] = [
    ("peak_force_n", "peak force", "N", 1.0),
    ("approach_speed_m_s", "approach speed", "m/s", 1.0),
    ("second_period_mean_n", "force in the second tooth period", "N", 1.0),
    ("arrival_s", "arrival", "us", 1e6),
];
const APPROACH: usize = 1;
const ARRIVAL: usize = 3;

/// An impact, and its departures.
struct ImpactCase<'a> {
    impact: &'a Impact,
    value: [f64; QUANTITIES.len()],
    departure: [f64; QUANTITIES.len()],
}

/// A group that stands out, before causes and consequences are separated.
struct Candidate<'a> {
    /// Index of tooth gap or joint.
    key: u32,
    is_tooth: bool,
    q: usize,
    suspect: Suspect,
    impacts: Vec<&'a Impact>,
}

/// Everything that stands out, in descending order of score.
pub fn suspects(impacts: &[Impact], header: &Header) -> Vec<Suspect> {
    let mut found = Vec::new();
    let links = header.links.len() as u32;
    let forwards = header.chain_speed_m_s >= 0.0;
    let period_s = period_s(header);
    for (body, info) in header.bodies.iter().enumerate().filter(|(_, b)| b.rotor) {
        let whole = |i: &&Impact| i.watched_s >= WATCHED * period_s && i.t_s >= SETTLED * period_s;
        let own: Vec<&Impact> = impacts.iter().filter(|i| i.body as usize == body).filter(whole).collect();
        let mut cases = cases(&own, period_s);
        let medians = compute_departures(&mut cases);
        let all: Vec<&ImpactCase<'_>> = cases.iter().collect();
        // A bush is positioned by the link ahead of it; a flank by its own link.
        let bushed = own.iter().any(|i| is_bush(i));
        let mut candidates = Vec::new();
        for q in 0..QUANTITIES.len() {
            for (tooth, group) in groups(&all, |i| Some(i.tooth)) {
                let suspect = Suspect { kind: "tooth", tooth: Some(tooth), ..empty_suspect(&info.path) };
                candidates.extend(outstanding_group(suspect, (tooth, true, q), &group, &medians));
            }
            for (joint, group) in groups(&all, |i| if bushed { joint_of(i, header) } else { Some(i.link) }) {
                let ahead = if forwards && bushed {
                    header.links.get(joint as usize).map_or(joint, |l| l.ahead)
                } else {
                    joint
                };
                let suspect = Suspect { kind: "link", link: Some(ahead), ..empty_suspect(&info.path) };
                candidates.extend(outstanding_group(suspect, (joint, false, q), &group, &medians));
            }
        }
        // Index increment from one arrival to the next.
        let tooth_step = if next_tooth_is_higher(&own, info.teeth) { 1 } else { info.teeth.max(1) - 1 };
        let joint_step = if forwards { links - 1 } else { 1 };
        found.extend(causes(candidates, (tooth_step, info.teeth.max(1)), (joint_step, links)));
    }
    found.sort_by(|a: &Suspect, b: &Suspect| b.score.total_cmp(&a.score));
    found
}

/// Separates causes from consequences.
fn causes(mut candidates: Vec<Candidate<'_>>, tooth: (u32, u32), joint: (u32, u32)) -> Vec<Suspect> {
    let mut found = Vec::new();
    let touch = |c: &Candidate<'_>| c.q == ARRIVAL || c.q == APPROACH;
    while let Some(top) = candidates
        .iter()
        .filter(|c| touch(c) || !candidates.iter().any(touch))
        .max_by(|a, b| a.suspect.score.total_cmp(&b.suspect.score))
    {
        let (is_tooth, (step, n)) = (top.is_tooth, if top.is_tooth { tooth } else { joint });
        let stands_out = |key: u32| candidates.iter().any(|c| c.is_tooth == is_tooth && c.key == key && touch(c));
        let mut key = top.key;
        // Goes back over neighbours that stand out to the first arrival, across gaps of one.
        let before = |key: u32, by: u32| (key + by * (n - step)) % n;
        for _ in 0..CONSEQUENCES {
            match (stands_out(before(key, 1)), stands_out(before(key, 2))) {
                (true, _) => key = before(key, 1),
                (false, true) => key = before(key, 2),
                (false, false) => break,
            }
        }
        let same = |c: &&Candidate<'_>| c.is_tooth == is_tooth && c.key == key;
        let root = candidates.iter().filter(same).max_by(|a, b| a.suspect.score.total_cmp(&b.suspect.score));
        let Some(root) = root.or(Some(top)) else { break };
        found.push(root.suspect.clone());
        // The force also affects the neighbour before it.
        let follows: Vec<u32> = (0..=CONSEQUENCES + 1).map(|by| (before(key, 1) + by * step) % n).collect();
        let mut covered: Vec<(u64, u32)> = Vec::new();
        for c in candidates.iter().filter(|c| c.is_tooth == is_tooth && follows.contains(&c.key)) {
            covered.extend(c.impacts.iter().map(|i| (i.step, i.link)));
        }
        covered.sort_unstable();
        let shares = |c: &Candidate<'_>| {
            let of_it = c.impacts.iter().filter(|i| covered.binary_search(&(i.step, i.link)).is_ok()).count();
            2 * of_it >= c.impacts.len()
        };
        candidates.retain(|c| !shares(c));
    }
    found
}

/// Whether the next tooth gap to arrive has the higher number.
fn next_tooth_is_higher(impacts: &[&Impact], teeth: u32) -> bool {
    let mut sorted: Vec<(u64, u32)> = impacts.iter().map(|i| (i.step, i.tooth)).collect();
    sorted.sort_unstable();
    let steps = |by: u32| sorted.windows(2).filter(|w| (w[0].1 + by) % teeth.max(1) == w[1].1).count();
    steps(1) >= steps(teeth.max(1) - 1)
}

fn is_bush(i: &Impact) -> bool {
    [Feature::FrontBush, Feature::RearBush, Feature::FrontRoller, Feature::RearRoller]
        .iter()
        .any(|f| i.feature == *f as u32)
}

/// Joint that carries a bush or a roller.
fn joint_of(i: &Impact, header: &Header) -> Option<u32> {
    if [Feature::FrontBush, Feature::FrontRoller].iter().any(|f| i.feature == *f as u32) {
        return Some(i.link);
    }
    let behind = || header.links.iter().position(|l| l.ahead == i.link).map(|joint| joint as u32);
    is_bush(i).then(behind).flatten()
}

fn cases<'a>(impacts: &[&'a Impact], period_s: f64) -> Vec<ImpactCase<'a>> {
    // Times of arrival are periodic in the tooth period. They are measured from the circular mean of their part, far
    // from the wrap.
    let mut middles = BTreeMap::new();
    for i in impacts {
        let (s, c) = libm::sincos(2.0 * std::f64::consts::PI * i.t_s / period_s);
        let sum: &mut (f64, f64) = middles.entry(i.feature).or_default();
        *sum = (sum.0 + s, sum.1 + c);
    }
    let arrival = |i: &Impact| {
        let (s, c) = middles.get(&i.feature).copied().unwrap_or((0.0, 1.0));
        let t_s = i.t_s - period_s * libm::atan2(s, c) / (2.0 * std::f64::consts::PI);
        t_s - period_s * libm::round(t_s / period_s)
    };
    impacts
        .iter()
        .map(|i| ImpactCase {
            impact: i,
            value: [i.peak_force_n, i.approach_speed_m_s, i.second_period_mean_n, arrival(i)],
            departure: [0.0; QUANTITIES.len()],
        })
        .collect()
}

/// Time between two arrivals.
fn period_s(header: &Header) -> f64 {
    let pitch_m = header.links.iter().map(|l| l.pitch_m).sum::<f64>() / header.links.len().max(1) as f64;
    pitch_m / header.chain_speed_m_s.abs().max(1e-12)
}

/// Computes departures for each part; returns the medians of each part.
fn compute_departures(cases: &mut [ImpactCase<'_>]) -> BTreeMap<u32, [f64; QUANTITIES.len()]> {
    let mut medians = BTreeMap::new();
    let features: Vec<u32> = cases.iter().map(|c| c.impact.feature).collect();
    for feature in features.iter().copied().collect::<BTreeSet<u32>>() {
        let own: Vec<usize> = (0..cases.len()).filter(|i| features[*i] == feature).collect();
        if own.len() < MIN_IMPACTS {
            continue;
        }
        let mut of_part = [0.0; QUANTITIES.len()];
        for q in 0..QUANTITIES.len() {
            let values: Vec<f64> = own.iter().map(|i| cases[*i].value[q]).collect();
            of_part[q] = median(values.clone());
            let spread = 1.4826 * median(values.iter().map(|v| (v - of_part[q]).abs()).collect());
            for i in &own {
                cases[*i].departure[q] = (cases[*i].value[q] - of_part[q]) / spread.max(1e-12);
            }
        }
        medians.insert(feature, of_part);
    }
    medians
}

fn groups<'a, 'b>(
    cases: &[&'a ImpactCase<'b>],
    key: impl Fn(&Impact) -> Option<u32>,
) -> BTreeMap<u32, Vec<&'a ImpactCase<'b>>> {
    let mut all: BTreeMap<u32, Vec<&ImpactCase<'_>>> = BTreeMap::new();
    for case in cases {
        if let Some(key) = key(case.impact) {
            all.entry(key).or_default().push(case);
        }
    }
    all.retain(|_, group| group.len() >= MIN_IN_GROUP);
    all
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n == 0 { f64::NAN } else { 0.5 * (values[(n - 1) / 2] + values[n / 2]) }
}

/// Magnitude that at least half of the values exceed, on the side of the majority.
fn lower_median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    let (below, above) = (values[(n - 1) / 2], values[n / 2]);
    if below * above <= 0.0 { 0.0 } else { below.abs().min(above.abs()) }
}

fn empty_suspect(body: &str) -> Suspect {
    Suspect {
        kind: "",
        body: body.to_string(),
        tooth: None,
        link: None,
        quantity: "",
        median: 0.0,
        others: 0.0,
        score: 0.0,
        impacts: 0,
        first_s: 0.0,
        text: String::new(),
    }
}

/// The group, if it stands out.
fn outstanding_group<'a>(
    suspect: Suspect,
    (key, is_tooth, q): (u32, bool, usize),
    group: &[&ImpactCase<'a>],
    medians: &BTreeMap<u32, [f64; QUANTITIES.len()]>,
) -> Option<Candidate<'a>> {
    let score = lower_median(group.iter().map(|c| c.departure[q]).collect()) * (group.len() as f64).sqrt();
    let (here, others) = (
        median(group.iter().map(|c| c.value[q]).collect()),
        median(group.iter().filter_map(|c| medians.get(&c.impact.feature)).map(|m| m[q]).collect()),
    );
    let off = (here - others).abs();
    let counts = if q == ARRIVAL { off >= MIN_DELAY_S } else { off >= SHARE * others.abs() };
    if score.is_nan() || score < SCORE || !counts {
        return None;
    }
    let (quantity, words, unit, factor) = QUANTITIES[q];
    let first_s = group.iter().map(|c| c.impact.t_s).fold(f64::INFINITY, f64::min);
    let who = match (suspect.tooth, suspect.link) {
        (Some(tooth), _) => format!("{}, tooth gap {tooth}", suspect.body),
        (_, Some(link)) if group.iter().all(|c| is_bush(c.impact)) => {
            format!("link {link}: the bush behind it on {}", suspect.body)
        }
        (_, Some(link)) => format!("link {link} on {}", suspect.body),
        _ => suspect.body.clone(),
    };
    let how = if q == ARRIVAL {
        format!("{:.2} us {}", off * factor, if here > others { "late" } else { "early" })
    } else {
        format!("{words} {:.3} {unit} where others have {:.3} {unit}", here * factor, others * factor)
    };
    let text = format!("{who}: {how} (score {score:.0}; {} impacts, first {:.4} ms)", group.len(), first_s * 1e3);
    let suspect = Suspect { quantity, median: here, others, score, impacts: group.len(), first_s, text, ..suspect };
    Some(Candidate { key, is_tooth, q, suspect, impacts: group.iter().map(|c| c.impact).collect() })
}

/// Parts of bodies whose impacts differ from those of another recording, in number, force or speed; the largest
/// difference first.
pub fn compared_with(impacts: &[Impact], header: &Header, other: &[Impact], other_header: &Header) -> Vec<Suspect> {
    let mut found = Vec::new();
    for info in &header.bodies {
        let (mine, theirs) = (of_body(impacts, header, &info.path), of_body(other, other_header, &info.path));
        let median_of = |all: &[&Impact], value: fn(&Impact) -> f64| median(all.iter().map(|i| value(i)).collect());
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
