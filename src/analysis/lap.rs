//! A number of links or joints over their way round the loop: its mean, scatter and range at every place, by zones, and over place and time.
//!
//! The way is the closed curve through the centres of a chain's links in the first frame, along their headings (cubic between two of them), in the
//! direction in which the chain travels there; every link of every frame stands at the foot of its perpendicular on it, every joint at its own. Its
//! zero is where the chain runs onto its first sprocket. A place belongs to a sprocket where more than half of the links there touch it, or stand
//! between two that do. Between sprockets a guide reaches from the first place to the last at which any link has touched it.
//!
//! Beside what break expressions know of links and joints there are three numbers of links: `lateral`, how far they stand to the left of their mean
//! place, `contact_force`, the sum of all forces along normals of contacts, and `gap`, the least distance of a plate to any guide or rail of
//! its chain that it lies over, by the exact contour; negative where they overlap.

use super::signal::{Signal, UnknownSignal};
use crate::diag::last_name;
use crate::geometry::{Vec2, cross, perp};
use crate::model::{GuideModel, Model, RailModel};
use crate::pairs::plate_rail::PlatePart;
use crate::recording::frame::{Frame, Header};
use crate::units::sin_cos;

/// Places per link that statistics are taken at.
const PLACES_PER_LINK: usize = 4;
/// Corners of the way per link: on a sprocket of 20 teeth their chords leave the curve by 0.3 um.
const CORNERS_PER_LINK: usize = 32;
/// Rows of the map over time: where there are more, neighbours become one. More would be finer than the picture.
const MAP_ROWS: usize = 240;
/// Links between two that touch a sprocket and stand on it: every second link has no bush, and a bush may lift for a moment.
const SPROCKET_FILL: usize = 4;
/// Share of samples from which a place belongs to a sprocket.
const MAJORITY: f64 = 0.5;
/// A gap beyond this is none: the ends of a rail bend away from the chain, and what stands over them there is not guided [m]. assumed.
const GAP_REACH_M: f64 = 5e-3;
/// Links by which a chain moves on before a place has seen several of them, in several phases of meshing. assumed.
const FEW_LINKS: f64 = 5.0;

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

/// What a part of the way is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ZoneKind {
    Sprocket,
    Span,
    Guide,
}

/// A part of the way.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LapZone {
    /// `on driver`, `driver to driven`, `driver to driven, over guides.rail.tight`.
    pub name: String,
    #[serde(skip)]
    pub kind: ZoneKind,
    /// Name of the sprocket or guide alone, without what it is; empty for a span.
    #[serde(skip)]
    pub short: String,
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

/// One link or joint in one frame.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct LapPoint {
    pub t_s: f64,
    pub place_m: f64,
    pub value: f64,
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
    /// The link that is followed, and its own way.
    pub link: Option<usize>,
    pub points: Vec<LapPoint>,
    /// What could not be measured, or is uncertain, and why.
    pub lacking: Vec<String>,
}

/// What is taken over the way.
enum LapSource {
    /// A signal for each joint, at its front end of the link, or for each link.
    Joints(Vec<Signal>),
    Links(Vec<Signal>),
    Lateral,
    ContactForce,
    Gap(Vec<(usize, GuideShape)>),
}

/// What has a gap to plates; before it the body of the header that it is.
enum GuideShape {
    Straight(GuideModel),
    Rail(RailModel),
}

/// Sums over samples: Welford 1962, so that a small scatter about a large mean keeps its digits.
#[derive(Clone, Copy)]
struct Sums {
    samples: usize,
    mean: f64,
    squares: f64,
    lowest: f64,
    highest: f64,
}

impl Sums {
    const NONE: Sums = Sums { samples: 0, mean: 0.0, squares: 0.0, lowest: f64::INFINITY, highest: f64::NEG_INFINITY };

    fn add(&mut self, value: f64) {
        self.samples += 1;
        let before = value - self.mean;
        self.mean += before / self.samples as f64;
        self.squares += before * (value - self.mean);
        (self.lowest, self.highest) = (self.lowest.min(value), self.highest.max(value));
    }

    /// Both together (Chan, Golub and LeVeque 1983).
    fn with(self, other: Sums) -> Sums {
        if other.samples == 0 {
            return self;
        }
        let (a, b) = (self.samples as f64, other.samples as f64);
        let apart = other.mean - self.mean;
        Sums {
            samples: self.samples + other.samples,
            mean: self.mean + apart * b / (a + b),
            squares: self.squares + other.squares + apart * apart * a * b / (a + b),
            lowest: self.lowest.min(other.lowest),
            highest: self.highest.max(other.highest),
        }
    }

    /// The same values less their mean.
    fn about_mean(self) -> Sums {
        if self.samples == 0 {
            return self;
        }
        Sums { mean: 0.0, lowest: self.lowest - self.mean, highest: self.highest - self.mean, ..self }
    }

    fn statistics(&self, from_m: f64, to_m: f64) -> PlaceStatistics {
        let known = |v: f64| if self.samples == 0 { f64::NAN } else { v };
        PlaceStatistics {
            from_m,
            to_m,
            mean: known(self.mean),
            scatter: known((self.squares / self.samples.max(1) as f64).sqrt()),
            lowest: known(self.lowest),
            highest: known(self.highest),
            samples: self.samples,
        }
    }
}

/// What was seen at a place.
#[derive(Clone)]
struct Seen {
    sums: Sums,
    /// Links that stood there, and of these those on each body; whether any touched a body.
    links: usize,
    on: Vec<usize>,
    touched: Vec<bool>,
}

/// Collects a number over the way, frame by frame.
pub struct LapRecorder {
    name: String,
    unit: String,
    source: LapSource,
    lacking: Vec<String>,
    /// Links of the chain, in the direction of travel once there was a frame.
    order: Vec<usize>,
    first_link: usize,
    /// The link that is followed beside.
    followed: Option<usize>,
    way: Way,
    /// Corner of the way that each link, in `order`, was nearest to.
    nearest: Vec<usize>,
    seen: Vec<Seen>,
    /// Sums of each row of the map at each place; frames that a row holds, and when it begins.
    map: Vec<Vec<(f64, usize)>>,
    frames_per_row: usize,
    begins_s: Vec<f64>,
    points: Vec<LapPoint>,
    frames: usize,
    span_s: (f64, f64),
    travelled_m: f64,
    last_place_m: Option<f64>,
}

/// A closed line.
#[derive(Default)]
struct Way {
    corners: Vec<Vec2>,
    /// Place of every corner, and the whole length [m].
    places_m: Vec<f64>,
    length_m: f64,
}

impl Way {
    /// Through points along directions, cubic between two of them.
    fn through(points: &[(Vec2, Vec2)]) -> Way {
        let mut way = Way::default();
        for (k, (a, along_a)) in points.iter().enumerate() {
            let (b, along_b) = points[(k + 1) % points.len()];
            // The speed at the ends with which a cubic follows an arc that turns by theta: chord / cos^2(theta / 4). Over 0.3 rad it leaves it
            // by less than 0.1 um.
            let half_cos = (0.5 * (1.0 + along_a.dot(&along_b).clamp(0.0, 1.0))).sqrt();
            let speed = (b - a).norm() * 2.0 / (1.0 + half_cos);
            for step in 0..CORNERS_PER_LINK {
                let u = step as f64 / CORNERS_PER_LINK as f64;
                let (u2, u3) = (u * u, u * u * u);
                let p = a * (2.0 * u3 - 3.0 * u2 + 1.0) + b * (3.0 * u2 - 2.0 * u3);
                way.corners.push(p + (along_a * (u3 - 2.0 * u2 + u) + along_b * (u3 - u2)) * speed);
            }
        }
        for (k, c) in way.corners.iter().enumerate() {
            way.places_m.push(way.length_m);
            way.length_m += (way.corners[(k + 1) % way.corners.len()] - c).norm();
        }
        way
    }

    /// Squared distance from the line behind a corner, place, and the distance to the left of it.
    fn foot(&self, k: usize, p: Vec2) -> (f64, f64, f64) {
        let a = self.corners[k];
        let along = self.corners[(k + 1) % self.corners.len()] - a;
        let length = along.norm().max(f64::MIN_POSITIVE);
        let share = ((p - a).dot(&along) / (length * length)).clamp(0.0, 1.0);
        let away = p - (a + along * share);
        (away.norm_squared(), self.places_m[k] + share * length, cross(along, p - a) / length)
    }

    /// Corner, place and distance to the left of the nearest point; looked for about `near` first.
    fn place_of(&self, p: Vec2, near: usize) -> (usize, f64, f64) {
        let n = self.corners.len();
        let reach = (2 * CORNERS_PER_LINK).min(n / 2);
        let nearest = |all: &mut dyn Iterator<Item = usize>| {
            all.map(|k| (k, self.foot(k, p))).min_by(|a, b| a.1.0.total_cmp(&b.1.0))
        };
        let mut found = nearest(&mut (0..=2 * reach).map(|d| (near + n - reach + d) % n));
        let ends = [(near + n - reach) % n, (near + reach) % n];
        let pitch_m = self.length_m / n as f64 * CORNERS_PER_LINK as f64;
        if found.is_none_or(|(k, (squared, ..))| ends.contains(&k) || squared > pitch_m * pitch_m) {
            found = nearest(&mut (0..n));
        }
        found.map_or((0, 0.0, 0.0), |(k, (_, place_m, left_m))| (k, place_m, left_m))
    }

    /// The distance from one place to another, the shorter way round [m].
    fn between(&self, from_m: f64, to_m: f64) -> f64 {
        let d = to_m - from_m;
        d - self.length_m * (d / self.length_m).round()
    }

    fn bin_of(&self, place_m: f64, bins: usize) -> usize {
        ((place_m / self.length_m * bins as f64) as usize).min(bins - 1)
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
        _ if rest.contains('[') => None,
        "joint" | "link" => Some(format!("{scope}[{row}].{rest}")),
        "joints" | "links" => Some(format!("{name}[{row}]")),
        _ => None,
    }
}

/// Signals of all rows of a chain.
fn signals_of(name: &str, header: &Header, links: std::ops::Range<usize>) -> Result<Vec<Signal>, LapError> {
    let find = |row: usize| match of_row(name, row) {
        Some(own) => Signal::find(&own, header).map_err(|e| {
            // The user has not written the row.
            let scope = name.split('.').next().unwrap_or_default();
            let text = e.to_string().replace(&own, name).replace("[12]", "");
            LapError::Unknown(text.replace(&format!("{scope}[{row}]"), scope))
        }),
        None => {
            let known =
                "joint.force, link.tension, link.speed, joints.COLUMN, links.COLUMN, lateral, gap, contact_force";
            Err(LapError::Unknown(format!("`{name}` is no number of all links or joints\nhelp: e.g. {known}")))
        }
    };
    links.map(find).collect()
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
        let links = header.chains().get(chain).cloned().unwrap_or_default();
        let mut lacking = Vec::new();
        let (source, unit) = match name {
            "lateral" => (LapSource::Lateral, "m".to_string()),
            "contact_force" => (LapSource::ContactForce, "N".to_string()),
            "gap" => (LapSource::Gap(guides_of(header, chain, model, &mut lacking)?), "m".to_string()),
            _ => {
                let all = signals_of(name, header, links.clone())?;
                let unit = all.first().map_or(String::new(), |s| s.unit.clone());
                (if name.starts_with("joint") { LapSource::Joints(all) } else { LapSource::Links(all) }, unit)
            }
        };
        let bodies = header.bodies.len();
        let seen = Seen { sums: Sums::NONE, links: 0, on: vec![0; bodies], touched: vec![false; bodies] };
        Ok(LapRecorder {
            name: name.to_string(),
            unit,
            source,
            lacking,
            first_link: links.start,
            seen: vec![seen; PLACES_PER_LINK * links.len()],
            order: links.collect(),
            followed,
            way: Way::default(),
            nearest: Vec::new(),
            map: Vec::new(),
            frames_per_row: 1,
            begins_s: Vec::new(),
            points: Vec::new(),
            frames: 0,
            span_s: (0.0, 0.0),
            travelled_m: 0.0,
            last_place_m: None,
        })
    }

    /// Adds a frame.
    pub fn add(&mut self, frame: &Frame, header: &Header) {
        if self.frames == 0 {
            self.lay_way(frame, header);
            self.span_s.0 = frame.t_s;
        }
        self.span_s.1 = frame.t_s;
        self.begin_row(frame.t_s);
        let (on, touching) = self.touched(frame, header);
        let forces_n = contact_forces_n(frame, header.links.len());
        let bins = self.seen.len();
        for k in 0..self.order.len() {
            let i = self.order[k];
            let (centre, heading) = pose_of(frame, i);
            let (corner, place_m, left_m) = self.way.place_of(centre, self.nearest[k]);
            self.nearest[k] = corner;
            if k == 0 {
                self.travelled_m += self.last_place_m.map_or(0.0, |last_m| self.way.between(last_m, place_m));
                self.last_place_m = Some(place_m);
            }
            let here = &mut self.seen[self.way.bin_of(place_m, bins)];
            here.links += 1;
            on[k].iter().for_each(|body| here.on[*body] += 1);
            touching[k].iter().for_each(|body| here.touched[*body] = true);
            let row = i - self.first_link;
            let (place_m, value) = match &self.source {
                LapSource::Joints(all) => {
                    let joint = centre + heading * (0.5 * header.links[i].pitch_m);
                    (self.way.place_of(joint, corner).1, all.get(row).and_then(|s| s.value(frame, header)))
                }
                LapSource::Links(all) => (place_m, all.get(row).and_then(|s| s.value(frame, header))),
                LapSource::Lateral => (place_m, Some(left_m)),
                LapSource::ContactForce => (place_m, forces_n.get(i).copied()),
                LapSource::Gap(guides) => (place_m, gap_m(guides, frame, header, i)),
            };
            let Some(value) = value.filter(|v| v.is_finite()) else { continue };
            let bin = self.way.bin_of(place_m, bins);
            self.seen[bin].sums.add(value);
            if let Some(cell) = self.map.last_mut().map(|row| &mut row[bin]) {
                *cell = (cell.0 + value, cell.1 + 1);
            }
            if self.followed == Some(i) {
                self.points.push(LapPoint { t_s: frame.t_s, place_m, value });
            }
        }
        self.frames += 1;
    }

    /// The way, in the direction in which the chain moves in the first frame.
    fn lay_way(&mut self, frame: &Frame, header: &Header) {
        let links = std::mem::take(&mut self.order);
        let ahead = |i: usize| (header.links[i].ahead as usize).min(frame.links.x_m.len().saturating_sub(1));
        let onwards = |i: &usize| {
            let forth = pose_of(frame, ahead(*i)).0 - pose_of(frame, *i).0;
            forth.dot(&Vec2::new(frame.links.vx_m_s[*i], frame.links.vy_m_s[*i]))
        };
        let forwards = links.iter().map(onwards).sum::<f64>() >= 0.0;
        self.order.extend(links.first());
        while let Some(last) = self.order.last().copied().filter(|_| self.order.len() < links.len()) {
            self.order.push(ahead(last));
        }
        if !forwards {
            self.order.reverse();
        }
        let sign = if forwards { 1.0 } else { -1.0 };
        let points: Vec<(Vec2, Vec2)> = self.order.iter().map(|i| pose_of(frame, *i)).collect();
        self.way = Way::through(&points.iter().map(|(p, heading)| (*p, heading * sign)).collect::<Vec<_>>());
        self.nearest = (0..points.len()).map(|k| k * CORNERS_PER_LINK).collect();
    }

    /// Opens a row of the map where one is full; where there are too many, pairs of them become one.
    fn begin_row(&mut self, t_s: f64) {
        if !self.frames.is_multiple_of(self.frames_per_row) {
            return;
        }
        if self.map.len() == MAP_ROWS {
            let pairs = std::mem::take(&mut self.map).into_iter();
            let mut joined: Vec<Vec<(f64, usize)>> = Vec::with_capacity(MAP_ROWS);
            for (k, row) in pairs.enumerate() {
                match joined.last_mut().filter(|_| k % 2 == 1) {
                    Some(before) => before.iter_mut().zip(row).for_each(|(a, b)| *a = (a.0 + b.0, a.1 + b.1)),
                    None => joined.push(row),
                }
            }
            self.map = joined;
            self.begins_s = self.begins_s.iter().copied().step_by(2).collect();
            self.frames_per_row *= 2;
        }
        self.map.push(vec![(0.0, 0); self.seen.len()]);
        self.begins_s.push(t_s);
    }

    /// Bodies that every link, in the direction of travel, touches; and sprockets that it stands on, between two that touch.
    fn touched(&self, frame: &Frame, header: &Header) -> (Vec<Vec<usize>>, Vec<Vec<usize>>) {
        let n = self.order.len();
        let mut at = vec![None; header.links.len()];
        self.order.iter().enumerate().for_each(|(k, i)| at[*i] = Some(k));
        let mut touching: Vec<Vec<usize>> = vec![Vec::new(); n];
        let c = &frame.contacts;
        for row in 0..c.link.len() {
            let (k, body) = (at.get(c.link[row] as usize).copied().flatten(), c.body[row] as usize);
            let Some(k) = k.filter(|_| c.normal_force_n[row] > 0.0 && body < header.bodies.len()) else { continue };
            if !touching[k].contains(&body) {
                touching[k].push(body);
            }
        }
        let mut on = touching.clone();
        for body in (0..header.bodies.len()).filter(|b| header.bodies[*b].rotor) {
            let own: Vec<usize> = (0..n).filter(|k| touching[*k].contains(&body)).collect();
            for (a, b) in own.iter().zip(own.iter().cycle().skip(1)) {
                let between = (b + n - a) % n;
                if between <= SPROCKET_FILL {
                    (1..between).for_each(|d| on[(a + d) % n].push(body));
                }
            }
        }
        (on, touching)
    }

    /// What was collected.
    ///
    /// # Errors
    /// There are too few frames.
    pub fn finish(mut self, header: &Header) -> Result<Lap, LapError> {
        if self.frames < 2 || self.order.is_empty() {
            return Err(LapError::Short { frames: self.frames });
        }
        let (length_m, bins) = (self.way.length_m, self.seen.len());
        let moved = (self.travelled_m / length_m * self.order.len() as f64).abs();
        if moved < FEW_LINKS {
            self.lacking.push(format!(
                "the chain moved by {moved:.2} links: a place has seen few links, each in one phase of its meshing. Record longer for means"
            ));
        }
        // Zero is where the chain runs onto its first sprocket.
        let sprockets = self.sprockets_of_places(header);
        let first = sprockets.iter().flatten().min().copied();
        let runs_on = |b: &usize| sprockets[*b] == first && sprockets[(b + bins - 1) % bins] != first;
        let start = (0..bins).find(runs_on).unwrap_or(0);
        self.seen.rotate_left(start);
        let sprockets: Vec<Option<usize>> = (0..bins).map(|b| sprockets[(b + start) % bins]).collect();
        let is_lateral = matches!(self.source, LapSource::Lateral);
        let means: Vec<f64> = self.seen.iter().map(|s| if is_lateral { s.sums.mean } else { 0.0 }).collect();
        if is_lateral {
            self.seen.iter_mut().for_each(|s| s.sums = s.sums.about_mean());
        }
        let limit = |b: usize| b as f64 * length_m / bins as f64;
        let zones = self.zones(&sprockets, header).into_iter().map(|zone| {
            let sums = self.seen[zone.from..zone.to].iter().fold(Sums::NONE, |all, s| all.with(s.sums));
            let statistics = sums.statistics(limit(zone.from), limit(zone.to));
            LapZone { name: zone.name, kind: zone.kind, short: zone.short, statistics }
        });
        let points = self.points.iter().map(|p| {
            let place_m = (p.place_m - limit(start)).rem_euclid(length_m);
            LapPoint { place_m, value: p.value - means[self.way.bin_of(place_m, bins)], ..*p }
        });
        Ok(Lap {
            quantity: self.name.clone(),
            unit: self.unit.clone(),
            links: self.order.len(),
            length_m,
            frames: self.frames,
            from_s: self.span_s.0,
            to_s: self.span_s.1,
            laps: self.travelled_m / length_m,
            zones: zones.collect(),
            places: self.seen.iter().enumerate().map(|(b, s)| s.sums.statistics(limit(b), limit(b + 1))).collect(),
            map: self.means_over_time(start, &means),
            link: self.followed,
            points: points.collect(),
            lacking: self.lacking.clone(),
        })
    }

    /// The sprocket that each place belongs to.
    fn sprockets_of_places(&self, header: &Header) -> Vec<Option<usize>> {
        let most = |seen: &Seen| {
            let body = (0..seen.on.len()).filter(|b| header.bodies[*b].rotor).max_by_key(|b| seen.on[*b]);
            body.filter(|b| seen.on[*b] as f64 > MAJORITY * seen.links as f64)
        };
        let mut found: Vec<_> = self.seen.iter().map(most).collect();
        // Where no link was, it is as before; the first places ask the last.
        for b in 0..2 * found.len() {
            let at = b % found.len();
            if self.seen[at].links == 0 {
                found[at] = found[(at + found.len() - 1) % found.len()];
            }
        }
        // Where links with and without bushes take turns, shares go up and down about a half.
        let n = found.len();
        for b in 0..n {
            let before = found[(b + n - 1) % n];
            let run = (0..n).take_while(|d| found[(b + d) % n] == found[b]).count();
            if run < PLACES_PER_LINK && before != found[b] && before == found[(b + run) % n] {
                (0..run).for_each(|d| found[(b + d) % n] = before);
            }
        }
        found
    }

    fn means_over_time(&self, start: usize, means: &[f64]) -> PlaceTimeMap {
        let bins = self.seen.len();
        let mean = |row: &Vec<(f64, usize)>, column: usize| {
            let own = (0..PLACES_PER_LINK).map(|d| PLACES_PER_LINK * column + d);
            let cells = own.map(|b| (row[(b + start) % bins], means[b]));
            let (sum, n) = cells.fold((0.0, 0), |(s, n), ((sum, count), m)| (s + sum - m * count as f64, n + count));
            (n > 0).then(|| sum / n as f64)
        };
        PlaceTimeMap {
            times_s: self.begins_s.iter().copied().chain([self.span_s.1]).collect(),
            means: self.map.iter().map(|row| (0..self.order.len()).map(|c| mean(row, c)).collect()).collect(),
        }
    }

    /// Runs of places that belong together, from the first sprocket on.
    fn zones(&self, sprockets: &[Option<usize>], header: &Header) -> Vec<PlacesOfZone> {
        let name = |body: Option<usize>| body.map_or("", |b| last_name(&header.bodies[b].path));
        let mut found: Vec<PlacesOfZone> = Vec::new();
        let mut from = 0;
        while from < sprockets.len() {
            let to = (from..sprockets.len()).find(|b| sprockets[*b] != sprockets[from]).unwrap_or(sprockets.len());
            if let Some(body) = sprockets[from] {
                let short = name(Some(body)).to_string();
                found.push(PlacesOfZone { from, to, name: format!("on {short}"), kind: ZoneKind::Sprocket, short });
            } else {
                let before = sprockets[..from].iter().rev().flatten().chain(sprockets.iter().rev().flatten()).next();
                let behind = sprockets[to..].iter().chain(sprockets).flatten().next();
                let span = match (before, behind) {
                    (Some(a), Some(b)) => format!("{} to {}", name(Some(*a)), name(Some(*b))),
                    _ => "the whole loop".to_string(),
                };
                found.extend(self.guides_of_span((from, to), &span, header));
            }
            from = to;
        }
        found
    }

    /// A span, cut at the ends of the guides in it.
    fn guides_of_span(&self, (from, to): (usize, usize), span: &str, header: &Header) -> Vec<PlacesOfZone> {
        let touched = |body: usize| {
            let own = |b: &usize| self.seen[*b].touched[body];
            Some(((from..to).find(own)?, (from..to).rev().find(own)? + 1, body))
        };
        let mut guides: Vec<(usize, usize, usize)> =
            (0..header.bodies.len()).filter(|b| !header.bodies[*b].rotor).filter_map(touched).collect();
        guides.sort_unstable();
        let free = |from: usize, to: usize| PlacesOfZone {
            from,
            to,
            name: span.to_string(),
            kind: ZoneKind::Span,
            short: String::new(),
        };
        let (mut found, mut at) = (Vec::new(), from);
        for (first, end, body) in guides {
            if end <= at {
                continue;
            }
            if first > at {
                found.push(free(at, first));
            }
            let path = &header.bodies[body].path;
            let (name, short) = (format!("{span}, over {path}"), last_name(path).to_string());
            found.push(PlacesOfZone { from: first.max(at), to: end, name, kind: ZoneKind::Guide, short });
            at = end;
        }
        if at < to {
            found.push(free(at, to));
        }
        found
    }
}

/// A zone by its places.
struct PlacesOfZone {
    from: usize,
    to: usize,
    name: String,
    kind: ZoneKind,
    short: String,
}

/// Centre and heading of a link.
fn pose_of(frame: &Frame, link: usize) -> (Vec2, Vec2) {
    let (sin, cos) = sin_cos(frame.links.angle_rad[link]);
    (Vec2::new(frame.links.x_m[link], frame.links.y_m[link]), Vec2::new(cos, sin))
}

/// Sum of the forces along the normals of all contacts, for every link.
fn contact_forces_n(frame: &Frame, links: usize) -> Vec<f64> {
    let mut sums = vec![0.0; links];
    let c = &frame.contacts;
    for (link, force_n) in c.link.iter().zip(&c.normal_force_n) {
        if let Some(sum) = sums.get_mut(*link as usize) {
            *sum += force_n;
        }
    }
    sums
}

/// Guides and rails of a chain that have a gap to its plates, and why others have none.
fn guides_of(
    header: &Header,
    chain: usize,
    model: Option<&Model>,
    lacking: &mut Vec<String>,
) -> Result<Vec<(usize, GuideShape)>, LapError> {
    let Some(model) = model else { return Err(LapError::Unknown("`gap` asks for the drive of the recording".into())) };
    let body = |path: String| header.bodies.iter().position(|b| b.path == path);
    let mut found = Vec::new();
    for guide in model.guides.iter().filter(|g| g.chain == chain) {
        match body(format!("guides.fixed.{}", guide.name)).filter(|_| guide.body.touches_plates) {
            Some(body) => found.push((body, GuideShape::Straight(guide.clone()))),
            None => lacking.push(format!("no gap to `{}`: abutments slide on it, and no plates", guide.name)),
        }
    }
    for rail in model.rails.iter().filter(|r| r.chain == chain) {
        match body(format!("guides.rail.{}", rail.name)).filter(|_| rail.blade.is_none()) {
            Some(body) => found.push((body, GuideShape::Rail(rail.clone()))),
            None => lacking.push(format!("no gap to `{}`: it bends, and recordings do not hold its shape", rail.name)),
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
fn gap_m(guides: &[(usize, GuideShape)], frame: &Frame, header: &Header, link: usize) -> Option<f64> {
    let lever_m = 0.5 * header.links[link].pitch_m;
    let (centre, heading) = pose_of(frame, link);
    let gap = |(body, shape): &(usize, GuideShape)| {
        let ([x, y], angle_rad) = header.bodies[*body].pose(frame);
        let from_origin = centre - Vec2::new(x, y);
        match shape {
            GuideShape::Straight(guide) => {
                let ends = [1.0, -1.0].map(|sign| from_origin + heading * (sign * lever_m));
                ends.iter().filter_map(|end| gap_of_end_m(guide, *end)).reduce(f64::min)
            }
            GuideShape::Rail(rail) => {
                let (sin, cos) = sin_cos(angle_rad);
                let turned = |v: Vec2| Vec2::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x);
                let of = |part: &PlatePart| rail.body.touch(*part, turned(from_origin), turned(heading), lever_m);
                PlatePart::ALL.iter().filter_map(of).map(|t| -t.penetration_m).reduce(f64::min)
            }
        }
    };
    guides.iter().filter_map(gap).reduce(f64::min).filter(|gap| *gap < GAP_REACH_M)
}

/// Gap of a plate's end to a straight guide, its relief arcs included; None where it is not over it, or on the other side of the loop.
/// `end`: the joint, from where the face begins.
fn gap_of_end_m(guide: &GuideModel, end: Vec2) -> Option<f64> {
    let b = &guide.body;
    let (along, above) = (end.dot(&b.along), end.dot(&perp(b.along)));
    let beyond = along - along.clamp(0.0, b.length_m.max(0.0));
    let is_over = beyond.abs() <= b.relief_m && above > -b.plate_radius_m;
    is_over.then(|| libm::hypot(beyond, above + b.end_radius_m) - b.end_radius_m - b.plate_radius_m)
}
