//! A number of links or joints over their way round the loop: its mean, scatter and range at every place, by zones, and over place and time.
//!
//! The way is the closed line through the centres of a chain's links in the first frame, in the direction of travel; every link of every frame
//! stands at the foot of its perpendicular on it. Its zero is where the chain runs onto its first sprocket. A zone is a sprocket, or a span between
//! two of them, or the part of a span over a guide: what more than half of the links there touch, or stand between two links that do.
//!
//! Beside what break expressions know of links and joints there are three numbers of links: `lateral`, how far they stand beside the way (the mean
//! of their place taken off), `contact_force`, the sum of all forces along normals of contacts, and `gap`, the least distance of a plate to any guide
//! or rail of its chain, by the exact contour; negative where they overlap.

use super::audit::Topology;
use super::signal::{Signal, UnknownSignal};
use crate::diag::last_name;
use crate::geometry::{Vec2, cross, perp};
use crate::model::{GuideModel, Model, RailModel};
use crate::pairs::plate_rail::PlatePart;
use crate::recording::frame::{BodyInfo, Frame, Header};

/// Places per link that statistics are taken at.
const PLACES_PER_LINK: usize = 4;
/// Most rows of the map over time: more would be finer than the picture.
const MAP_ROWS: usize = 150;
/// Links that may miss between two that touch a sprocket: every second link has no bush.
const SPROCKET_FILL: usize = 4;
/// Share of samples from which a place belongs to a body.
const MAJORITY: f64 = 0.5;
/// A gap beyond this is none: the chain is elsewhere [m].
const GAP_REACH_M: f64 = 5e-3;

/// Statistics of the samples at a place.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PlaceStatistics {
    /// From the zero of the way [m].
    pub from_m: f64,
    pub to_m: f64,
    pub mean: f64,
    /// Standard deviation over links and time.
    pub scatter: f64,
    pub lowest: f64,
    pub highest: f64,
    pub samples: usize,
}

/// A part of the way.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LapZone {
    /// `on driver`, `driver to driven`, `driver to driven, over guides.rail.tight`.
    pub name: String,
    #[serde(flatten)]
    pub statistics: PlaceStatistics,
}

/// Means over place and time.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct PlaceTimeMap {
    /// Limits of the rows [s]: one more than there are rows.
    pub times_s: Vec<f64>,
    /// Row by row, a place for each link; None where no link passed.
    pub means: Vec<Vec<Option<f64>>>,
}

/// A number over the way round a loop.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Lap {
    pub quantity: String,
    /// SI.
    pub unit: String,
    pub links: usize,
    /// Length of the way [m].
    pub length_m: f64,
    pub frames: usize,
    pub from_s: f64,
    pub to_s: f64,
    /// How often the chain came round.
    pub laps: f64,
    pub zones: Vec<LapZone>,
    pub places: Vec<PlaceStatistics>,
    pub map: PlaceTimeMap,
    /// Place and value of one link, frame by frame.
    pub link: Vec<(f64, f64)>,
    /// What could not be measured, and why.
    pub lacking: Vec<String>,
}

/// What is taken over the way.
enum LapSource {
    /// A signal for each link or joint.
    Signals(Vec<Signal>),
    Lateral,
    ContactForce,
    Gap(Vec<GuideShape>),
}

/// A guide or a rail, and the body of the header that it is.
enum GuideShape {
    Straight(GuideModel),
    Rail(usize, RailModel),
}

/// Collects a number over the way, frame by frame.
pub struct LapRecorder {
    name: String,
    unit: String,
    source: LapSource,
    lacking: Vec<String>,
    /// Links in the direction of travel.
    order: Vec<usize>,
    /// Links that are followed beside: place and value.
    followed: Option<usize>,
    way: Way,
    topology: Topology,
    samples: Vec<LapSample>,
    times_s: Vec<f64>,
    /// Of every place: samples, and those on each body.
    seen: Vec<(usize, Vec<usize>)>,
    travelled_m: f64,
    last_place_m: Option<f64>,
}

/// One link in one frame.
#[derive(Clone, Copy)]
struct LapSample {
    frame: u32,
    link: u32,
    place_m: f64,
    value: f64,
}

/// The closed line through the centres of links.
#[derive(Default)]
struct Way {
    corners: Vec<Vec2>,
    /// Place of every corner, and the whole length [m].
    places_m: Vec<f64>,
    length_m: f64,
}

impl Way {
    fn through(corners: Vec<Vec2>) -> Way {
        let mut places_m = Vec::with_capacity(corners.len());
        let mut length_m = 0.0;
        for (k, c) in corners.iter().enumerate() {
            places_m.push(length_m);
            length_m += (corners[(k + 1) % corners.len()] - c).norm();
        }
        Way { corners, places_m, length_m }
    }

    /// Place of the nearest point, and the distance from it, to the left of the way.
    fn place_of(&self, p: Vec2) -> (f64, f64) {
        let mut best = (f64::MAX, 0.0, 0.0);
        for (k, a) in self.corners.iter().enumerate() {
            let along = self.corners[(k + 1) % self.corners.len()] - a;
            let length = along.norm();
            let share = ((p - a).dot(&along) / (length * length)).clamp(0.0, 1.0);
            let away = p - (a + along * share);
            let squared = away.norm_squared();
            if squared < best.0 {
                best = (squared, self.places_m[k] + share * length, cross(along, p - a) / length);
            }
        }
        (best.1, best.2)
    }
}

/// Why there is no such lap.
#[derive(Clone, Debug, PartialEq)]
pub enum LapError {
    /// The recording has no such quantity.
    Unknown(String),
    /// It has fewer frames than it takes.
    Short { frames: usize },
}

impl From<UnknownSignal> for LapError {
    fn from(e: UnknownSignal) -> LapError {
        LapError::Unknown(e.to_string())
    }
}

/// `name` of one row of a chain: `joint.force` of row 3 is `joint[3].force`, `joints.force_x_n` is `joints.force_x_n[3]`.
fn of_row(name: &str, row: usize) -> Option<String> {
    let (scope, rest) = name.split_once('.')?;
    match scope {
        "joint" | "link" => Some(format!("{scope}[{row}].{rest}")),
        "joints" | "links" => Some(format!("{name}[{row}]")),
        _ => None,
    }
}

impl LapRecorder {
    /// For the links of one chain, `chain` of the header's. `model` is that of the recording's drive; it is asked for `gap` alone.
    ///
    /// # Errors
    /// The recording has no such quantity, or the chain none of its kind.
    pub fn new(
        name: &str,
        header: &Header,
        chain: usize,
        followed: Option<usize>,
        model: Option<&Model>,
    ) -> Result<LapRecorder, LapError> {
        let topology = Topology::of(header);
        let links = header.chains().get(chain).cloned().unwrap_or_default();
        let mut order = vec![links.start];
        while let Some(last) = order.last().copied().filter(|_| order.len() < links.len()) {
            order.push(if topology.forwards { topology.ahead[last] } else { topology.behind[last] });
        }
        let mut lacking = Vec::new();
        let (source, unit) = match name {
            "lateral" => (LapSource::Lateral, "m".to_string()),
            "contact_force" => (LapSource::ContactForce, "N".to_string()),
            "gap" => (LapSource::Gap(guides_of(header, chain, model, &mut lacking)?), "m".to_string()),
            _ => {
                let Some(first) = of_row(name, links.start) else {
                    let known = "joint.force, link.tension, link.speed, joints.COLUMN, links.COLUMN, lateral, gap, contact_force";
                    return Err(LapError::Unknown(format!(
                        "`{name}` is no number of links or joints\nhelp: e.g. {known}"
                    )));
                };
                let unit = Signal::find(&first, header)?.unit;
                let find = |row: usize| Signal::find(&of_row(name, row).unwrap_or_default(), header);
                (LapSource::Signals(links.clone().map(find).collect::<Result<_, _>>()?), unit)
            }
        };
        Ok(LapRecorder {
            name: name.to_string(),
            unit,
            source,
            lacking,
            order,
            followed,
            way: Way::default(),
            topology,
            samples: Vec::new(),
            times_s: Vec::new(),
            seen: vec![(0, vec![0; header.bodies.len()]); PLACES_PER_LINK * links.len()],
            travelled_m: 0.0,
            last_place_m: None,
        })
    }

    /// Adds a frame.
    pub fn add(&mut self, frame: &Frame, header: &Header) {
        let centre = |i: &usize| Vec2::new(frame.links.x_m[*i], frame.links.y_m[*i]);
        if self.times_s.is_empty() {
            self.way = Way::through(self.order.iter().map(centre).collect());
        }
        let number = u32::try_from(self.times_s.len()).unwrap_or(u32::MAX);
        self.times_s.push(frame.t_s);
        let on = self.touched(frame, header);
        let first_link = self.order.iter().copied().min().unwrap_or(0);
        for (k, i) in self.order.clone().into_iter().enumerate() {
            let (place_m, beside_m) = self.way.place_of(centre(&i));
            if k == 0 {
                let way = |from: f64| {
                    let d = place_m - from;
                    d - self.way.length_m * (d / self.way.length_m).round()
                };
                self.travelled_m += self.last_place_m.map_or(0.0, way);
                self.last_place_m = Some(place_m);
            }
            let at = bin_of(place_m, self.way.length_m, self.seen.len());
            self.seen[at].0 += 1;
            on[k].iter().for_each(|body| self.seen[at].1[*body] += 1);
            let value = match &self.source {
                LapSource::Signals(all) => all.get(i - first_link).and_then(|s| s.value(frame, header)),
                LapSource::Lateral => Some(beside_m),
                LapSource::ContactForce => Some(contact_force_n(frame, i)),
                LapSource::Gap(guides) => gap_m(guides, frame, header, i),
            };
            if let Some(value) = value.filter(|v| v.is_finite()) {
                self.samples.push(LapSample { frame: number, link: i as u32, place_m, value });
            }
        }
    }

    /// Bodies that every link touches or stands over, in the direction of travel.
    fn touched(&self, frame: &Frame, header: &Header) -> Vec<Vec<usize>> {
        let n = self.order.len();
        let mut at = vec![None; self.topology.ahead.len()];
        self.order.iter().enumerate().for_each(|(k, i)| at[*i] = Some(k));
        let mut on: Vec<Vec<usize>> = vec![Vec::new(); n];
        let c = &frame.contacts;
        for row in 0..c.link.len() {
            let k = at.get(c.link[row] as usize).copied().flatten();
            if let Some(k) = k.filter(|_| c.normal_force_n[row] > 0.0)
                && !on[k].contains(&(c.body[row] as usize))
            {
                on[k].push(c.body[row] as usize);
            }
        }
        let touching = on.clone();
        let rotor = |body: &usize| header.bodies.get(*body).is_some_and(|b| b.rotor);
        for body in 0..header.bodies.len() {
            let own: Vec<usize> = (0..n).filter(|k| touching[*k].contains(&body)).collect();
            for (a, b) in own.iter().zip(own.iter().cycle().skip(1)) {
                let between = (b + n - a) % n;
                let free = |d: usize| !touching[(a + d) % n].iter().any(rotor);
                let fills = match rotor(&body) {
                    true => between <= SPROCKET_FILL,
                    false => own.len() > 1 && (1..between).all(free),
                };
                let inner = if fills { between } else { 0 };
                (1..inner).map(|d| (a + d) % n).for_each(|k| on[k].push(body));
            }
        }
        on
    }

    /// What was collected.
    ///
    /// # Errors
    /// There are too few frames.
    pub fn finish(mut self, header: &Header) -> Result<Lap, LapError> {
        if self.times_s.len() < 2 {
            return Err(LapError::Short { frames: self.times_s.len() });
        }
        let (length_m, bins) = (self.way.length_m, self.seen.len());
        let bodies = self.bodies_of_places(header);
        // Zero is where the chain runs onto its first sprocket.
        let first = bodies.iter().filter_map(|b| b.0).min();
        let start = (0..bins).find(|b| bodies[*b].0 == first && bodies[(b + bins - 1) % bins].0 != first).unwrap_or(0);
        let zero_m = start as f64 * length_m / bins as f64;
        for s in &mut self.samples {
            s.place_m = (s.place_m - zero_m).rem_euclid(length_m);
        }
        if matches!(self.source, LapSource::Lateral) {
            let means: Vec<f64> = statistics(&self.samples, length_m, bins).iter().map(|p| p.mean).collect();
            self.samples.iter_mut().for_each(|s| s.value -= means[bin_of(s.place_m, length_m, bins)]);
        }
        let rotated: Vec<_> = (0..bins).map(|b| bodies[(b + start) % bins]).collect();
        let zones = zones(&rotated, header).into_iter().map(|(from, to, name)| {
            let [from_m, to_m] = [from, to].map(|b| b as f64 * length_m / bins as f64);
            let own = self.samples.iter().filter(|s| (from_m..to_m).contains(&s.place_m));
            LapZone { name, statistics: place_statistics(from_m, to_m, own.map(|s| s.value)) }
        });
        let own = |s: &&LapSample| self.followed == Some(s.link as usize);
        Ok(Lap {
            quantity: self.name.clone(),
            unit: self.unit.clone(),
            links: self.order.len(),
            length_m,
            frames: self.times_s.len(),
            from_s: self.times_s[0],
            to_s: self.times_s[self.times_s.len() - 1],
            laps: self.travelled_m / length_m,
            zones: zones.collect(),
            places: statistics(&self.samples, length_m, bins),
            map: self.map(),
            link: self.samples.iter().filter(own).map(|s| (s.place_m, s.value)).collect(),
            lacking: self.lacking.clone(),
        })
    }

    /// The sprocket of every place, and the guide.
    fn bodies_of_places(&self, header: &Header) -> Vec<(Option<usize>, Option<usize>)> {
        let most = |(samples, on): &(usize, Vec<usize>), rotor: bool| {
            let body = (0..on.len()).filter(|b| header.bodies[*b].rotor == rotor).max_by_key(|b| on[*b]);
            body.filter(|b| on[*b] as f64 > MAJORITY * *samples as f64)
        };
        let mut found: Vec<_> = self.seen.iter().map(|s| (most(s, true), most(s, false))).collect();
        // Where no link was, it is as before.
        for b in 1..found.len() {
            if self.seen[b].0 == 0 {
                found[b] = found[b - 1];
            }
        }
        found
    }

    fn map(&self) -> PlaceTimeMap {
        let (frames, columns) = (self.times_s.len(), self.order.len());
        let rows = frames.min(MAP_ROWS);
        let row_of = |frame: usize| frame * rows / frames;
        let mut sums = vec![vec![(0.0, 0_usize); columns]; rows];
        for s in &self.samples {
            let cell = &mut sums[row_of(s.frame as usize)][bin_of(s.place_m, self.way.length_m, columns)];
            *cell = (cell.0 + s.value, cell.1 + 1);
        }
        let mean = |(sum, n): &(f64, usize)| (*n > 0).then(|| sum / *n as f64);
        let begins = (0..rows).map(|r| self.times_s[(r * frames).div_ceil(rows)]);
        PlaceTimeMap {
            times_s: begins.chain([self.times_s[frames - 1]]).collect(),
            means: sums.iter().map(|row| row.iter().map(mean).collect()).collect(),
        }
    }
}

fn bin_of(place_m: f64, length_m: f64, bins: usize) -> usize {
    ((place_m / length_m * bins as f64) as usize).min(bins - 1)
}

fn statistics(samples: &[LapSample], length_m: f64, bins: usize) -> Vec<PlaceStatistics> {
    let mut own: Vec<Vec<f64>> = vec![Vec::new(); bins];
    samples.iter().for_each(|s| own[bin_of(s.place_m, length_m, bins)].push(s.value));
    let limit = |b: usize| b as f64 * length_m / bins as f64;
    own.into_iter().enumerate().map(|(b, v)| place_statistics(limit(b), limit(b + 1), v.into_iter())).collect()
}

fn place_statistics(from_m: f64, to_m: f64, values: impl Iterator<Item = f64>) -> PlaceStatistics {
    let (mut n, mut mean, mut squares) = (0_usize, 0.0, 0.0);
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for v in values {
        // Welford 1962: a small scatter about a large mean keeps its digits.
        n += 1;
        let before = v - mean;
        mean += before / n as f64;
        squares += before * (v - mean);
        (lowest, highest) = (f64::min(lowest, v), f64::max(highest, v));
    }
    if n == 0 {
        (mean, lowest, highest) = (f64::NAN, f64::NAN, f64::NAN);
    }
    let scatter = (squares / n.max(1) as f64).sqrt();
    PlaceStatistics { from_m, to_m, mean, scatter, lowest, highest, samples: n }
}

/// Runs of places that belong together, from the first sprocket on: first place, place behind the last, name.
fn zones(bodies: &[(Option<usize>, Option<usize>)], header: &Header) -> Vec<(usize, usize, String)> {
    let sprockets: Vec<usize> = bodies.iter().filter_map(|b| b.0).collect();
    let name = |body: usize| header.bodies.get(body).map_or("", |b: &BodyInfo| last_name(&b.path));
    let mut found: Vec<(usize, usize, String)> = Vec::new();
    let mut last = sprockets.first().copied();
    for (b, (sprocket, guide)) in bodies.iter().enumerate() {
        let next = || bodies[b..].iter().find_map(|b| b.0).or(sprockets.first().copied());
        let called = match (sprocket, last, guide) {
            (Some(s), ..) => format!("on {}", name(*s)),
            (None, Some(from), _) => {
                let span = format!("{} to {}", name(from), next().map_or("", name));
                guide.map_or(span.clone(), |g| format!("{span}, over {}", header.bodies[g].path))
            }
            (None, None, _) => "the whole loop".to_string(),
        };
        last = sprocket.or(last);
        match found.last_mut() {
            Some(zone) if zone.2 == called => zone.1 = b + 1,
            _ => found.push((b, b + 1, called)),
        }
    }
    // A zone of less than a link is where two share a place: the one before takes it.
    let mut kept: Vec<(usize, usize, String)> = Vec::new();
    for zone in found {
        match kept.last_mut() {
            Some(before) if zone.1 - zone.0 < PLACES_PER_LINK || before.2 == zone.2 => before.1 = zone.1,
            _ => kept.push(zone),
        }
    }
    kept
}

fn contact_force_n(frame: &Frame, link: usize) -> f64 {
    let c = &frame.contacts;
    (0..c.link.len()).filter(|row| c.link[*row] as usize == link).map(|row| c.normal_force_n[row]).sum()
}

/// Guides and rails of a chain that have a gap to its plates, and why others have none.
fn guides_of(
    header: &Header,
    chain: usize,
    model: Option<&Model>,
    lacking: &mut Vec<String>,
) -> Result<Vec<GuideShape>, LapError> {
    let Some(model) = model else { return Err(LapError::Unknown("`gap` asks for the drive of the recording".into())) };
    let mut found = Vec::new();
    for guide in model.guides.iter().filter(|g| g.chain == chain) {
        match guide.body.touches_plates {
            true => found.push(GuideShape::Straight(guide.clone())),
            false => lacking.push(format!("`{}`: abutments slide on it, and no plates", guide.name)),
        }
    }
    for rail in model.rails.iter().filter(|r| r.chain == chain) {
        let body = header.bodies.iter().position(|b| last_name(&b.path) == rail.name && b.path.starts_with("guides."));
        match body.filter(|_| rail.blade.is_none()) {
            Some(body) => found.push(GuideShape::Rail(body, rail.clone())),
            None => lacking.push(format!("`{}`: it bends, and recordings do not hold its shape", rail.name)),
        }
    }
    if found.is_empty() {
        let why = match lacking.is_empty() {
            true => "no plate of this chain runs on a guide".to_string(),
            false => lacking.join("; "),
        };
        return Err(LapError::Unknown(format!("there is no gap to measure: {why}")));
    }
    Ok(found)
}

/// Least gap of a plate to these guides; None where it is over none of them [m].
fn gap_m(guides: &[GuideShape], frame: &Frame, header: &Header, link: usize) -> Option<f64> {
    let lever_m = 0.5 * header.links[link].pitch_m;
    let centre = Vec2::new(frame.links.x_m[link], frame.links.y_m[link]);
    let (sin, cos) = crate::units::sin_cos(frame.links.angle_rad[link]);
    let heading = Vec2::new(cos, sin);
    let gap = |shape: &GuideShape| match shape {
        GuideShape::Straight(guide) => {
            let b = &guide.body;
            let over = |p: &Vec2| (0.0..=b.length_m.abs()).contains(&(p - b.origin).dot(&b.along));
            let ends = [1.0, -1.0].map(|sign| centre + heading * (sign * lever_m));
            let height = |p: &Vec2| (p - b.origin).dot(&perp(b.along)) - b.plate_radius_m;
            // What lies deeper than a plate is wide is the other strand.
            ends.iter().filter(|p| over(p)).map(height).filter(|h| *h > -2.0 * b.plate_radius_m).reduce(f64::min)
        }
        GuideShape::Rail(body, rail) => {
            let (origin, angle) = header.bodies[*body].pose(frame);
            let (sin, cos) = crate::units::sin_cos(angle);
            let turned = |v: Vec2| Vec2::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x);
            let (c, h) = (turned(centre - Vec2::new(origin[0], origin[1])), turned(heading));
            let of = |part: &PlatePart| rail.body.touch(*part, c, h, lever_m).map(|t| -t.penetration_m);
            PlatePart::ALL.iter().filter_map(of).reduce(f64::min)
        }
    };
    guides.iter().filter_map(gap).reduce(f64::min).filter(|gap| *gap < GAP_REACH_M)
}
