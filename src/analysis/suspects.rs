//! Finds the tooth, link or body that stands out among all impacts.
//!
//! Impacts of one part of links on one body (front bushes on the driver, say) are comparable. Only arrivals are compared
//! ([`super::arrivals`]): a bush that is lifted in its seat and returns to it tells of another gap. The departure of an
//! impact is its distance from their median in robust standard deviations (1.4826 x median absolute deviation). Impacts
//! with another common property, a tooth gap or a joint of the chain, form a group. The departure of a group is the
//! median of those of its m impacts; of two middle values the smaller one counts, so that one odd impact of two has no
//! effect. It does not depend on the length of the recording, and ranks. The score, departure times sqrt(m), is the
//! evidence: a group stands out if it exceeds [`SCORE`] and its difference is not negligible. A gap or joint at which no
//! bush arrives, while most others have theirs, stands out most. Impacts cut off by the end of the run and those of its
//! first two tooth periods are ignored. Where links bear bushes, only these are compared: abutments roll on rings, which
//! all gaps share.
//!
//! A fault at one tooth or link also disturbs the ones that arrive after it, and in force also the one before. Of
//! neighbours that stand out, the cause is therefore the one that arrives first, judged by quantities known at first
//! contact (time of arrival, approach speed), if it departs by more than [`TRACED`] of the largest departure. A joint
//! indicates the link ahead of it. Flanks of silent links are their link's own: the cause is the link that departs most, summed
//! over the quantities. Its neighbours, groups that share most of their impacts with them, and groups
//! whose impacts follow the cause within three tooth periods, on whatever sprocket, are its shadows: they are listed with
//! it and accuse nobody.
//!
//! Where many parts stand out and none follows from another, the fault is not one part's: that is said first, of no part.
//!
//! A fault that is the same for all teeth and links, such as another seat form or a guide in the way, shows only in
//! comparison with another recording ([`super::compared_impacts`]). What the frames measure of the parts near a suspect says which of them it
//! is ([`super::blame`]).

use super::arrivals::ArrivalRhythm;
use super::audit::Finding;
use crate::recording::frame::{Feature, Header, Impact};
use crate::recording::places::Loops;
use crate::statistics::{median, middle};
use std::collections::{BTreeMap, BTreeSet};

/// Score above which a group stands out: in runs of the bundled drives of 30 to 300 ms without defects none of some
/// 240 groups by four quantities goes beyond 7.
const SCORE: f64 = 8.0;
/// Departure from which a group stands out, however often it arrives: below it lie patterns over all gaps, such as runout gives.
const LEAST_DEPARTURE: f64 = 4.4;
/// So many causes are not one part's fault.
const MANY: usize = 5;

/// Score from which a neighbour of what stands out may be its cause, and share of the largest departure from which it is.
const WEAK_SCORE: f64 = 4.0;
const TRACED: f64 = 0.3;
/// Departures of at least this share of the largest one are alike; the one with the highest score is then taken first.
const ALIKE: f64 = 0.8;
/// Largest departure that is told: what hardly scatters has no scale.
const MOST_DEPARTURE: f64 = 999.0;
/// Departures beyond this one are all equally certain.
const CERTAIN: f64 = 20.0;
/// Departure of what does not arrive at all.
const ABSENT: f64 = 40.0;
/// Share of the tooth periods in which a link must arrive, for arrivals to be told from other impacts: without a steady
/// speed they have no rhythm.
const IN_RHYTHM: f64 = 0.6;
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
/// Tooth periods before and after the arrival of a cause within which its shadows have their impacts.
const SHADOW: (f64, f64) = (1.0, 3.0);

/// A tooth, link or body that stands out.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Suspect {
    /// `tooth`, `link`, `joint`, `body`, or `drive` for what many parts share.
    pub kind: &'static str,
    /// Path of the body on which it stands out.
    pub body: String,
    pub tooth: Option<u32>,
    pub link: Option<u32>,
    /// Joint whose bush stands out: the rear one of `link`. Where there is a `cause`, the joint that it names, or none.
    pub joint: Option<u32>,
    /// What frames measure of it; then it is the part that is measured to be odd, and `text` says where that shows.
    pub cause: Option<Finding>,
    /// Quantity in which it stands out, its median for this group and for the others.
    pub quantity: &'static str,
    pub median: f64,
    pub others: f64,
    /// Departure in robust standard deviations, and that times the square root of the number of impacts.
    pub departure: f64,
    pub score: f64,
    pub impacts: usize,
    /// Time of the first of them [s].
    pub first_s: f64,
    /// Where it stands out, in words.
    pub place: String,
    /// What stands out only because of it.
    pub shadows: Vec<String>,
    pub text: String,
}

/// What stands out, and what could not be judged.
pub struct FoundSuspects {
    pub suspects: Vec<Suspect>,
    /// What stands out, though frames measure it to be healthy.
    pub healthy: Vec<Suspect>,
    /// Bodies whose impacts differ from those of another recording.
    pub differences: Vec<Suspect>,
    /// How long a recording must be for links to be judged [s], where this one is shorter.
    pub links_take_s: Option<f64>,
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

/// What a group shares.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    body: usize,
    is_tooth: bool,
    /// Tooth gap; joint, or link where links have no bushes.
    number: u32,
}

/// A group that stands out, before causes and consequences are separated.
struct Candidate<'a> {
    key: Key,
    /// Known at first contact.
    is_touch: bool,
    /// On a sprocket whose impacts are those of bushes, which a fault ahead of them may misplace. Flanks are their link's own.
    bushed: bool,
    suspect: Suspect,
    impacts: Vec<&'a Impact>,
    /// When they arrived, or should have [s].
    times_s: Vec<f64>,
}

impl Candidate<'_> {
    fn is_strong(&self) -> bool {
        self.suspect.score >= SCORE && self.suspect.departure >= LEAST_DEPARTURE
    }
}

/// How the numbers of a body follow each other: the first, how many, and the step from one arrival to the next.
#[derive(Clone, Copy)]
struct Order {
    first: u32,
    count: u32,
    step: u32,
}

impl Order {
    fn new(first: u32, count: u32, is_rising: bool) -> Order {
        Order { first, count: count.max(1), step: if is_rising { 1 } else { count.max(1) - 1 } }
    }

    fn moved(&self, number: u32, by: u32) -> u32 {
        self.first + (number.wrapping_sub(self.first) % self.count + by * self.step) % self.count
    }

    fn before(&self, number: u32, by: u32) -> u32 {
        self.moved(number, by * (self.count - 1))
    }
}

/// What is compared on one sprocket.
struct ComparedSprocket<'a> {
    body: usize,
    path: &'a str,
    period_s: f64,
    /// Time within which arrivals count [s].
    within_s: (f64, f64),
    bushed: bool,
    gaps: Order,
    joints: Order,
    is_forwards: bool,
    loops: &'a Loops,
}

/// Everything that stands out in a recording of this time, the largest departure first.
pub fn suspects(impacts: &[Impact], header: &Header, (begin_s, end_s): (f64, f64)) -> FoundSuspects {
    let loops = Loops::new(header);
    let period_s = period_s(header);
    let within_s = (begin_s + SETTLED * period_s, end_s - WATCHED * period_s);
    let mut candidates = Vec::new();
    let mut orders = BTreeMap::new();
    let mut links_take_s: Option<f64> = None;
    for (body, info) in header.bodies.iter().enumerate().filter(|(_, b)| b.rotor) {
        let counts = |i: &&Impact| i.watched_s >= WATCHED * period_s && i.t_s >= within_s.0;
        let mut own: Vec<&Impact> = impacts.iter().filter(|i| i.body as usize == body).filter(counts).collect();
        let bushed = own.iter().any(|i| is_bush(i));
        own.retain(|i| is_bush(i) || !bushed);
        let Some(first) = own.first() else { continue };
        let (start, links) = loops.of(first.link);
        let is_forwards = header.chain_speed_m_s >= 0.0;
        let mut stage = ComparedSprocket {
            body,
            path: &info.path,
            period_s,
            within_s,
            bushed,
            gaps: Order::new(0, info.teeth, is_forwards),
            joints: Order::new(start, links, !is_forwards),
            is_forwards,
            loops: &loops,
        };
        let by_gap = |i: &Impact| Some(i.tooth);
        let by_joint = |i: &Impact| if bushed { loops.joint(i) } else { Some(i.link) };
        stage.keep_arrivals(&mut own);
        let mut cases = cases(&own, stage.period_s);
        let medians = compute_departures(&mut cases, ARRIVAL_KNOWN_M / header.chain_speed_m_s.abs().max(1e-12));
        for q in 0..QUANTITIES.len() {
            for (number, group) in groups(&cases, by_gap) {
                candidates.extend(stage.candidate(Key { body, is_tooth: true, number }, q, &group, &medians));
            }
            for (number, group) in groups(&cases, by_joint) {
                candidates.extend(stage.candidate(Key { body, is_tooth: false, number }, q, &group, &medians));
            }
        }
        if bushed {
            candidates.extend(stage.absentees(&own));
        }
        if groups(&cases, by_joint).is_empty() {
            let laps = (MIN_IN_GROUP as f64 + 0.1) * f64::from(links) * period_s;
            links_take_s = Some(links_take_s.unwrap_or(0.0).max(laps));
        }
        orders.insert(body, (stage.gaps, stage.joints));
    }
    let suspects = causes(candidates, &orders, header, period_s);
    FoundSuspects { suspects, healthy: Vec::new(), differences: Vec::new(), links_take_s }
}

impl FoundSuspects {
    /// Says first where so many parts stand out that the fault is hardly one part's.
    #[must_use]
    pub fn with_many_told(mut self) -> FoundSuspects {
        if self.suspects.len() >= MANY && self.suspects.iter().all(|s| s.cause.is_none()) {
            self.suspects.insert(0, of_many(&self.suspects));
        }
        self
    }
}

/// What many parts share.
fn of_many(suspects: &[Suspect]) -> Suspect {
    let n = suspects.len();
    let first_s = suspects.iter().map(|s| s.first_s).fold(f64::INFINITY, f64::min);
    let text = format!(
        "the drive: {n} parts stand out and none follows from another: hardly the fault of one of them (`audit` measures them all)"
    );
    Suspect { kind: "drive", quantity: "suspects", median: n as f64, impacts: 0, first_s, text, ..empty_suspect("") }
}

impl<'a> ComparedSprocket<'a> {
    /// Leaves arrivals, where there is a rhythm, and finds in which order and how fast gaps arrive.
    fn keep_arrivals(&mut self, own: &mut Vec<&Impact>) {
        let numbered: Vec<(&Impact, u32)> = own.iter().map(|i| (*i, i.tooth % self.gaps.count)).collect();
        let teeth = ArrivalRhythm { period_s: self.period_s, count: self.gaps.count }.measured(&numbered);
        self.period_s = teeth.period_s;
        let arrivals = teeth.arrivals(&numbered);
        let periods = (self.within_s.1 - self.within_s.0) / self.period_s;
        if arrivals.impacts.len() as f64 >= IN_RHYTHM * periods {
            own.clear();
            own.extend(arrivals.impacts.iter().map(|(i, _)| *i));
        }
        self.gaps = Order::new(0, self.gaps.count, arrivals.is_rising);
    }

    /// Gaps and joints at which no bush arrives in time.
    fn absentees<'b>(&self, own: &[&'b Impact]) -> Vec<Candidate<'b>> {
        let mut found = Vec::new();
        // An arrival may be late by a period.
        let within_s = (self.within_s.0 + self.period_s, self.within_s.1 - self.period_s);
        for (is_tooth, order) in [(true, self.gaps), (false, self.joints)] {
            let number = |i: &Impact| {
                let number = if is_tooth { Some(i.tooth) } else { self.loops.joint(i) };
                number.map(|n| n.wrapping_sub(order.first) % order.count)
            };
            let numbered: Vec<(&Impact, u32)> = own.iter().filter_map(|i| Some((*i, number(i)?))).collect();
            let rhythm = ArrivalRhythm { period_s: self.period_s, count: order.count };
            let arrivals = rhythm.arrivals(&numbered);
            for (number, due_s) in rhythm.absent(&arrivals, within_s) {
                let key = Key { body: self.body, is_tooth, number: order.first + number };
                let who = self.named(key);
                let n = due_s.len();
                let first_s = due_s.first().copied().unwrap_or(0.0);
                let text = format!(
                    "{who}: no bush seats in time, in none of {n} passes, where others do in every one (first {:.4} ms)",
                    first_s * 1e3
                );
                let suspect = Suspect {
                    quantity: "arrivals",
                    median: 0.0,
                    others: n as f64,
                    departure: ABSENT,
                    score: ABSENT * (n as f64).sqrt(),
                    impacts: 0,
                    first_s,
                    place: who,
                    text,
                    ..self.suspect(key)
                };
                found.push(Candidate {
                    key,
                    is_touch: true,
                    bushed: true,
                    suspect,
                    impacts: Vec::new(),
                    times_s: due_s,
                });
            }
        }
        found
    }

    fn suspect(&self, key: Key) -> Suspect {
        let empty = empty_suspect(self.path);
        match (key.is_tooth, self.bushed) {
            (true, _) => Suspect { kind: "tooth", tooth: Some(key.number), ..empty },
            (false, true) => {
                let link = if self.is_forwards { self.loops.ahead(key.number) } else { key.number };
                Suspect { kind: "link", link: Some(link), joint: Some(key.number), ..empty }
            }
            (false, false) => Suspect { kind: "link", link: Some(key.number), ..empty },
        }
    }

    /// The place in words.
    fn named(&self, key: Key) -> String {
        let path = self.path;
        match (key.is_tooth, self.suspect(key).link) {
            (true, _) => format!("{path}, tooth gap {}", key.number),
            (false, Some(link)) if self.bushed => {
                let end = if self.is_forwards { "rear" } else { "front" };
                format!("link {link} or its {end} joint {}, on {path}", key.number)
            }
            (false, _) => format!("link {} on {path}", key.number),
        }
    }

    /// The group, if it stands out, or might as the neighbour of one that does.
    fn candidate<'b>(
        &self,
        key: Key,
        q: usize,
        group: &[&ImpactCase<'b>],
        medians: &BTreeMap<u32, [f64; QUANTITIES.len()]>,
    ) -> Option<Candidate<'b>> {
        let departure = lower_median(group.iter().map(|c| c.departure[q]).collect()).min(MOST_DEPARTURE);
        let score = departure * (group.len() as f64).sqrt();
        let (here, others) = (
            median(group.iter().map(|c| c.value[q])),
            median(group.iter().filter_map(|c| medians.get(&c.impact.feature)).map(|m| m[q])),
        );
        let off = (here - others).abs();
        let counts = if q == ARRIVAL { off >= MIN_DELAY_S } else { off >= SHARE * others.abs() };
        if score.is_nan() || score < WEAK_SCORE || !counts {
            return None;
        }
        let (quantity, words, unit, factor) = QUANTITIES[q];
        let first_s = group.iter().map(|c| c.impact.t_s).fold(f64::INFINITY, f64::min);
        let how = if q == ARRIVAL {
            format!("{:.2} us {}", off * factor, if here > others { "late" } else { "early" })
        } else {
            format!("{words} {:.3} {unit} where others have {:.3} {unit}", here * factor, others * factor)
        };
        let place = self.named(key);
        let text = format!(
            "{place}: {how} ({departure:.1} times the scatter, score {score:.0}; {} impacts, first {:.4} ms)",
            group.len(),
            first_s * 1e3
        );
        let suspect = Suspect {
            quantity,
            median: here,
            others,
            departure: departure.min(CERTAIN),
            score,
            impacts: group.len(),
            first_s,
            place,
            text,
            ..self.suspect(key)
        };
        let impacts: Vec<&Impact> = group.iter().map(|c| c.impact).collect();
        let times_s = impacts.iter().map(|i| i.t_s).collect();
        let is_touch = q == ARRIVAL || q == APPROACH;
        Some(Candidate { key, is_touch, bushed: self.bushed, suspect, impacts, times_s })
    }
}

/// Separates causes from consequences.
fn causes(
    mut candidates: Vec<Candidate<'_>>,
    orders: &BTreeMap<usize, (Order, Order)>,
    header: &Header,
    period_s: f64,
) -> Vec<Suspect> {
    let mut found: Vec<Suspect> = Vec::new();
    while let Some(top) = first_of(&candidates) {
        let Some((gaps, joints)) = orders.get(&top.body) else { break };
        let order = if top.is_tooth { gaps } else { joints };
        let root = traced(&candidates, top, order);
        let at_root = || candidates.iter().filter(|c| c.key == root);
        let by_score = |a: &&Candidate<'_>, b: &&Candidate<'_>| a.suspect.score.total_cmp(&b.suspect.score);
        let Some(cause) = at_root().max_by(by_score) else { break };
        // The force also affects the neighbours before it.
        let follows: Vec<u32> =
            (0..=CONSEQUENCES + 2).map(|by| order.moved(order.before(root.number, 2), by)).collect();
        let is_neighbour = |c: &Candidate<'_>| {
            (c.key.body, c.key.is_tooth) == (root.body, root.is_tooth) && follows.contains(&c.key.number)
        };
        let mut covered: BTreeSet<(u64, u32)> = BTreeSet::new();
        for c in candidates.iter().filter(|c| is_neighbour(c)) {
            covered.extend(c.impacts.iter().map(|i| (i.step, i.link)));
        }
        let passes_s: Vec<f64> = at_root().flat_map(|c| c.times_s.iter().copied()).collect();
        let is_close = |t_s: f64| {
            let after = |pass_s: &f64| (t_s - pass_s) / period_s;
            passes_s.iter().map(after).any(|periods| (-SHADOW.0..=SHADOW.1).contains(&periods))
        };
        let is_shadow = |c: &Candidate<'_>| {
            let shared = c.impacts.iter().filter(|i| covered.contains(&(i.step, i.link))).count();
            let close = c.times_s.iter().filter(|t_s| is_close(**t_s)).count();
            let same_link = !root.is_tooth && !c.key.is_tooth && follows.contains(&c.key.number);
            is_neighbour(c) || same_link || 2 * shared.max(close) >= c.times_s.len()
        };
        let mut shadows: Vec<Key> =
            candidates.iter().filter(|c| is_shadow(c) && c.key != root && c.is_strong()).map(|c| c.key).collect();
        shadows.sort_unstable();
        shadows.dedup();
        found.push(Suspect {
            shadows: shadows.iter().map(|k| shadow_name(*k, root, header)).collect(),
            ..cause.suspect.clone()
        });
        let kept: Vec<bool> = candidates.iter().map(|c| !is_shadow(c)).collect();
        let mut kept = kept.into_iter();
        candidates.retain(|_| kept.next().unwrap_or(false));
    }
    found
}

/// Key of the group to begin with. Among bushes: of the largest departures the one with the highest score. Among flanks: the
/// one with the largest sum of departures over all quantities.
fn first_of(candidates: &[Candidate<'_>]) -> Option<Key> {
    let strong = |bushed: bool| candidates.iter().filter(move |c| c.is_strong() && c.bushed == bushed);
    let touch = strong(true).any(|c| c.is_touch);
    let pool = || strong(true).filter(|c| c.is_touch || !touch);
    let largest = pool().map(|c| c.suspect.departure).fold(0.0, f64::max);
    let of_bushes = pool()
        .filter(|c| c.suspect.departure >= ALIKE * largest)
        .max_by(|a, b| a.suspect.score.total_cmp(&b.suspect.score))
        .map(|c| c.key);
    let mut sums: BTreeMap<Key, f64> = BTreeMap::new();
    for c in strong(false) {
        let of_key = candidates.iter().filter(|o| o.key == c.key).map(|o| o.suspect.departure);
        sums.insert(c.key, of_key.sum());
    }
    of_bushes.or(sums.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(key, _)| key))
}

/// Goes back over neighbours that stand out to the first arrival, across gaps of one.
fn traced(candidates: &[Candidate<'_>], top: Key, order: &Order) -> Key {
    let of_top = || candidates.iter().filter(|c| c.key == top);
    if of_top().any(|c| !c.bushed) {
        return top;
    }
    let largest = of_top().map(|c| c.suspect.departure).fold(0.0, f64::max);
    let stands_out = |number: u32| {
        let key = Key { number, ..top };
        candidates.iter().any(|c| c.key == key && c.is_touch && c.suspect.departure >= TRACED * largest)
    };
    let mut key = top;
    for _ in 0..CONSEQUENCES {
        let (one, two) = (order.before(key.number, 1), order.before(key.number, 2));
        match (stands_out(one), stands_out(two)) {
            (true, _) => key.number = one,
            (false, true) => key.number = two,
            (false, false) => break,
        }
    }
    key
}

fn shadow_name(key: Key, root: Key, header: &Header) -> String {
    let what = if key.is_tooth { "tooth gap" } else { "joint" };
    let path = header.bodies.get(key.body).map_or("?", |b| b.path.as_str());
    let on = if key.body == root.body { String::new() } else { format!(" on {path}") };
    format!("{what} {}{on}", key.number)
}

fn is_bush(i: &Impact) -> bool {
    [Feature::FrontBush, Feature::RearBush, Feature::FrontRoller, Feature::RearRoller]
        .iter()
        .any(|f| i.feature == *f as u32)
}

fn cases<'a>(impacts: &[&'a Impact], period_s: f64) -> Vec<ImpactCase<'a>> {
    // Times of arrival are periodic in the tooth period. They are measured from the circular mean of their part, far
    // from the wrap.
    let mut middles = BTreeMap::new();
    for i in impacts {
        let (s, c) = libm::sincos(2.0 * std::f64::consts::PI * i.touched_s() / period_s);
        let sum: &mut (f64, f64) = middles.entry(i.feature).or_default();
        *sum = (sum.0 + s, sum.1 + c);
    }
    let arrival = |i: &Impact| {
        let (s, c) = middles.get(&i.feature).copied().unwrap_or((0.0, 1.0));
        let t_s = i.touched_s() - period_s * libm::atan2(s, c) / (2.0 * std::f64::consts::PI);
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
pub(super) fn period_s(header: &Header) -> f64 {
    let pitch_m = header.links.iter().map(|l| l.pitch_m).sum::<f64>() / header.links.len().max(1) as f64;
    pitch_m / header.chain_speed_m_s.abs().max(1e-12)
}

/// Computes departures for each part; returns the medians of each part.
fn compute_departures(cases: &mut [ImpactCase<'_>], arrival_known_s: f64) -> BTreeMap<u32, [f64; QUANTITIES.len()]> {
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
            let (centre, spread) = middle(&values);
            of_part[q] = centre;
            for i in &own {
                let least = if q == ARRIVAL { arrival_known_s } else { 1e-12 };
                cases[*i].departure[q] = (cases[*i].value[q] - of_part[q]) / spread.max(least);
            }
        }
        medians.insert(feature, of_part);
    }
    medians
}

fn groups<'a, 'b>(
    cases: &'a [ImpactCase<'b>],
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

/// Way of the chain to which arrivals are alike [m]: swings of the spans shift them by as much. A gap that lies 1 um off shifts them by some 3.5 um.
const ARRIVAL_KNOWN_M: f64 = 4e-6;

/// Magnitude that at least half of the values exceed, on the side of the majority.
fn lower_median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    let (below, above) = (values[(n - 1) / 2], values[n / 2]);
    if below * above <= 0.0 { 0.0 } else { below.abs().min(above.abs()) }
}

pub(super) fn empty_suspect(body: &str) -> Suspect {
    Suspect {
        kind: "",
        body: body.to_string(),
        tooth: None,
        link: None,
        joint: None,
        cause: None,
        quantity: "",
        median: 0.0,
        others: 0.0,
        departure: 0.0,
        score: 0.0,
        impacts: 0,
        first_s: 0.0,
        place: body.to_string(),
        shadows: Vec::new(),
        text: String::new(),
    }
}
