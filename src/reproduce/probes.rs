//! What trials look at beside signals, frame by frame: angles of links where they mesh, first touches, forces of links by place and speed, forces of guides
//! along their faces, forces into mounts.

use crate::drive::Drive;
use crate::geometry::{Vec2, unit};
use crate::recording::frame::{BodyKind, Frame, Header};
use crate::units::{RPM, wrap_angle};
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// What is looked at.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub enum Probe {
    /// Angles between successive links before and behind every sprocket.
    Meshing,
    /// When and where links of either row first touch a sprocket.
    FirstTouches { sprocket: String },
    /// The largest force of a joint, over the speed.
    LinkForces,
    /// Force of one joint by where it is: `tight` and `slack` name the sprockets that its spans leave.
    Zones { joint: usize },
    /// Normal force and touch along a rail.
    RailForces { rail: String },
    /// Force on the teeth of a sprocket by pitches since the link came in.
    Wrap { sprocket: String },
    /// What touches what.
    ContactPairs,
    /// Forces into mounts: orders 10 and 20.
    Mounts,
}

/// Sees frames, and sums up.
pub trait Watcher {
    fn see(&mut self, frame: &Frame, header: &Header);
    fn finish(self: Box<Self>) -> Value;
}

impl Probe {
    pub fn begin(&self, drive: &Drive, bin_rpm: Option<f64>) -> Box<dyn Watcher> {
        match self {
            Probe::Meshing => Box::new(MeshingWatch::default()),
            Probe::FirstTouches { sprocket } => {
                Box::new(TouchWatch { sprocket: sprocket.clone(), ..TouchWatch::default() })
            }
            Probe::LinkForces => Box::new(ForceWatch { bin_rpm: bin_rpm.unwrap_or(250.0), ..ForceWatch::default() }),
            Probe::Zones { joint } => {
                let names = drive.sprockets.iter().map(|s| s.name.clone()).collect();
                Box::new(ZoneWatch { joint: *joint, names, last: None, seen: Vec::new() })
            }
            Probe::RailForces { rail } => {
                let spec = drive.rails.iter().find(|r| r.name == *rail);
                let pivot = spec.and_then(|r| r.arm).map_or(Vec2::zeros(), |a| drive.arms[a].pivot);
                let start = spec.map_or(Vec2::zeros(), |r| r.start - pivot);
                Box::new(RailWatch { rail: rail.clone(), start, ..RailWatch::default() })
            }
            Probe::Wrap { sprocket } => Box::new(WrapWatch { sprocket: sprocket.clone(), ..WrapWatch::default() }),
            Probe::ContactPairs => Box::new(PairWatch::default()),
            Probe::Mounts => Box::new(MountWatch::default()),
        }
    }
}

/// Front joint of a link.
fn joint_of(frame: &Frame, header: &Header, link: usize) -> Vec2 {
    let l = &frame.links;
    Vec2::new(l.x_m[link], l.y_m[link]) + unit(l.angle_rad[link]) * (0.5 * header.links[link].pitch_m)
}

/// Magnitude of the force of a joint [N].
fn joint_force_n(frame: &Frame, joint: usize) -> f64 {
    libm::hypot(frame.joints.force_x_n[joint], frame.joints.force_y_n[joint])
}

/// Mean pitch of the chains [m].
fn pitch_m(header: &Header) -> f64 {
    header.links.iter().map(|l| l.pitch_m).sum::<f64>() / header.links.len().max(1) as f64
}

/// Angles of a station: the largest of every passing link [rad].
#[derive(Default)]
struct Station {
    passing: Option<usize>,
    largest: [f64; 2],
    done: [Vec<f64>; 2],
}

impl Station {
    fn see(&mut self, joint: usize, angles: [f64; 2]) {
        if self.passing != Some(joint) {
            if self.passing.is_some() {
                self.done.iter_mut().zip(self.largest).for_each(|(done, largest)| done.push(largest));
            }
            (self.passing, self.largest) = (Some(joint), [0.0; 2]);
        }
        self.largest.iter_mut().zip(angles).for_each(|(largest, own)| *largest = largest.max(own));
    }

    fn json(&self) -> Value {
        let of = |values: &[f64]| {
            let n = values.len().max(1) as f64;
            let mean = values.iter().sum::<f64>() / n;
            let square = values.iter().map(|v| v * v).sum::<f64>() / n;
            let largest = values.iter().copied().fold(0.0, f64::max);
            json!({
                "mean_deg": mean.to_degrees(), "rms_deg": libm::sqrt(square).to_degrees(),
                "sigma_deg": libm::sqrt((square - mean * mean).max(0.0)).to_degrees(), "largest_deg": largest.to_degrees(),
            })
        };
        json!({"a1": of(&self.done[0]), "a2": of(&self.done[1])})
    }
}

/// How far behind a sprocket the chain is looked at: what takes it there lies some links away.
const LINKS_BEHIND: usize = 4;
/// Bits of features of a silent link, as `contacts.feature` counts them: trailing and leading flank, rear and front inner flank.
const OUTER_FLANKS: u32 = 1 << 6 | 1 << 7;
const INNER_FLANKS: u32 = 1 << 8 | 1 << 9;
/// A joint that stands out by less than this share of the pitch is seated.
const SEATED: f64 = 0.04;

/// Angles between successive links. Ahead of a sprocket: alpha 1 at the first joint both of whose links are clear of the teeth, alpha 2 what the second
/// seated joint departs from the turn of a pitch. Behind it: the largest of the first joints whose links are clear. A link with one end on the sprocket
/// swings down as it seats, which is the polygon's and is left out.
#[derive(Default)]
struct MeshingWatch {
    /// In and out of every sprocket.
    stations: BTreeMap<String, Station>,
    /// By the link that enters the first sprocket: its angle, features of it that touch, time of entry.
    entering: BTreeMap<usize, (f64, u32, f64)>,
    /// Angles at entry, and whether both an inner and an outer flank touched within two tooth periods.
    entries: Vec<(f64, bool)>,
    transverse: (f64, usize),
    largest_force_n: f64,
}

impl Watcher for MeshingWatch {
    fn see(&mut self, frame: &Frame, header: &Header) {
        let n = header.links.len();
        let joints: Vec<Vec2> = (0..n).map(|i| joint_of(frame, header, i)).collect();
        let ahead = |i: usize| header.links[i].ahead as usize;
        let mut behind = vec![0; n];
        (0..n).for_each(|i| behind[ahead(i)] = i);
        let turn = |i: usize| wrap_angle(frame.links.angle_rad[ahead(i)] - frame.links.angle_rad[i]);
        let pitch = pitch_m(header);
        self.largest_force_n = (0..n).map(|j| joint_force_n(frame, j)).fold(self.largest_force_n, f64::max);
        for (k, body) in header.bodies.iter().enumerate().filter(|(_, b)| b.rotor && b.teeth > 0) {
            let (origin, _) = body.pose(frame);
            let step_rad = 2.0 * PI / f64::from(body.teeth);
            let radius = pitch / (2.0 * libm::sin(0.5 * step_rad));
            let is_seated = |i: usize| (joints[i] - Vec2::new(origin[0], origin[1])).norm() - radius < SEATED * pitch;
            let name = crate::diag::last_name(&body.path);
            let Some(first) = (0..n).find(|i| is_seated(*i) && !is_seated(behind[*i])) else { continue };
            let Some(last) = (0..n).find(|i| is_seated(*i) && !is_seated(ahead(*i))) else { continue };
            let before = turn(behind[behind[first]]).abs();
            let seated = |i: usize| (turn(i).abs() - step_rad).abs();
            self.stations.entry(format!("{name}_in")).or_default().see(first, [before, seated(ahead(first))]);
            let mut out = 0.0_f64;
            let mut at = ahead(last);
            for _ in 0..LINKS_BEHIND {
                at = ahead(at);
                out = out.max(turn(at).abs());
            }
            self.stations.entry(format!("{name}_out")).or_default().see(last, [out, seated(behind[last])]);
            if k == 0 {
                self.see_entry(frame, header, first, before);
                let mut at = first;
                for _ in 0..LINKS_BEHIND {
                    at = behind[at];
                    let across = unit(frame.links.angle_rad[at] + 0.5 * PI);
                    let v = across.x * frame.links.vx_m_s[at] + across.y * frame.links.vy_m_s[at];
                    self.transverse = (self.transverse.0 + v * v, self.transverse.1 + 1);
                }
            }
        }
    }

    fn finish(self: Box<Self>) -> Value {
        let mut map: Map<String, Value> = self.stations.iter().map(|(name, s)| (name.clone(), s.json())).collect();
        let mut entries = self.entries;
        entries.sort_by(|a, b| a.0.total_cmp(&b.0));
        let quarter = entries.len() / 4;
        let share = |k: usize| {
            let own = entries.get(k * quarter..(k + 1) * quarter).unwrap_or_default();
            own.iter().filter(|e| e.1).count() as f64 / own.len().max(1) as f64
        };
        map.insert("both_sides_by_quartile".into(), json!([share(0), share(1), share(2), share(3)]));
        map.insert("entries".into(), json!(entries.len()));
        map.insert("transverse_m_s".into(), json!(libm::sqrt(self.transverse.0 / self.transverse.1.max(1) as f64)));
        map.insert("largest_force_n".into(), json!(self.largest_force_n));
        Value::Object(map)
    }
}

impl MeshingWatch {
    /// Follows the link ahead of the first seated joint for two tooth periods.
    fn see_entry(&mut self, frame: &Frame, header: &Header, first: usize, angle: f64) {
        let period_s = pitch_m(header) / header.chain_speed_m_s.abs().max(1e-9);
        let link = first;
        let t_s = frame.t_s;
        self.entering.entry(link).or_insert((angle, 0, t_s));
        let c = &frame.contacts;
        for i in 0..c.link.len() {
            if c.body[i] == 0
                && let Some(own) = self.entering.get_mut(&(c.link[i] as usize))
            {
                own.1 |= 1 << c.feature[i].min(31);
            }
        }
        let over: Vec<usize> =
            self.entering.iter().filter(|(_, own)| t_s - own.2 > 2.0 * period_s).map(|(link, _)| *link).collect();
        for link in over {
            if let Some((angle, features, _)) = self.entering.remove(&link) {
                let (outer, inner) = (features & OUTER_FLANKS != 0, features & INNER_FLANKS != 0);
                self.entries.push((angle, outer && inner));
            }
        }
    }
}

/// First touches of a sprocket's gaps, one after the other: with links of two rows, every other one belongs to one row.
#[derive(Default)]
struct TouchWatch {
    sprocket: String,
    /// By gap: until when it is known.
    known: BTreeMap<u32, f64>,
    /// Gap, time of the touch, distance of the point from the axis [m].
    touches: Vec<(u32, f64, f64)>,
    period_s: f64,
    from_s: Option<f64>,
}

/// Tooth periods after which a gap that nothing touches is free.
const FREE_AFTER: f64 = 3.0;

impl Watcher for TouchWatch {
    fn see(&mut self, frame: &Frame, header: &Header) {
        let Some(body) = header.bodies.iter().position(|b| crate::diag::last_name(&b.path) == self.sprocket) else {
            return;
        };
        self.period_s = pitch_m(header) / header.chain_speed_m_s.abs().max(1e-9);
        let from_s = *self.from_s.get_or_insert(frame.t_s);
        let (origin, _) = header.bodies[body].pose(frame);
        let c = &frame.contacts;
        for i in (0..c.link.len()).filter(|i| c.body[*i] as usize == body) {
            let is_new = self.known.get(&c.tooth[i]).is_none_or(|until| frame.t_s > *until);
            // What touches in the first frames may have done so before.
            if is_new && frame.t_s > from_s + FREE_AFTER * self.period_s {
                let radius = libm::hypot(c.point_link_x_m[i] - origin[0], c.point_link_y_m[i] - origin[1]);
                self.touches.push((c.tooth[i], frame.t_s - c.age_s[i], radius));
            }
            self.known.insert(c.tooth[i], frame.t_s + FREE_AFTER * self.period_s);
        }
    }

    fn finish(self: Box<Self>) -> Value {
        let mut touches = self.touches;
        touches.sort_by(|a, b| a.1.total_cmp(&b.1));
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
        let distances = |odd: u32| -> Vec<f64> {
            let pairs = touches.windows(2).filter(|w| w[0].0 % 2 == odd);
            pairs.map(|w| (w[1].1 - w[0].1) / self.period_s).filter(|d| *d < 1.9).collect()
        };
        let radius = |odd: u32| {
            let own: Vec<f64> = touches.iter().filter(|t| t.0 % 2 == odd).map(|t| 1e3 * t.2).collect();
            mean(&own)
        };
        json!({
            "touches": touches.len(), "even_radius_mm": radius(0), "odd_radius_mm": radius(1),
            // A row that comes late makes one distance longer and the next shorter.
            "shift_periods": 0.5 * (mean(&distances(0)) - mean(&distances(1))),
        })
    }
}

/// The largest force of a joint.
#[derive(Default)]
struct ForceWatch {
    bin_rpm: f64,
    bins: BTreeMap<i64, f64>,
    largest_n: f64,
    last: Option<(f64, f64)>,
}

impl Watcher for ForceWatch {
    fn see(&mut self, frame: &Frame, header: &Header) {
        let largest = (0..header.links.len()).map(|j| joint_force_n(frame, j)).fold(0.0, f64::max);
        self.largest_n = self.largest_n.max(largest);
        if let Some((t_s, angle)) = self.last {
            let rpm = (frame.crank_angle_rad - angle).abs() / (frame.t_s - t_s).max(1e-12) / RPM;
            let bin = self.bins.entry((rpm / self.bin_rpm).floor() as i64).or_insert(0.0);
            *bin = bin.max(largest);
        }
        self.last = Some((frame.t_s, frame.crank_angle_rad));
    }

    fn finish(self: Box<Self>) -> Value {
        let rpm: Vec<f64> = self.bins.keys().map(|bin| (*bin as f64 + 0.5) * self.bin_rpm).collect();
        json!({"largest_n": self.largest_n, "rpm": rpm, "largest_by_speed_n": self.bins.values().collect::<Vec<_>>()})
    }
}

/// Force of a joint by where it is.
struct ZoneWatch {
    joint: usize,
    names: Vec<String>,
    last: Option<usize>,
    /// Zone, turns of the driver, force [N].
    seen: Vec<(usize, f64, f64)>,
}

/// A joint that stands out by less than this many pitches is on a sprocket.
const ON_SPROCKET: f64 = 0.1;

impl Watcher for ZoneWatch {
    fn see(&mut self, frame: &Frame, header: &Header) {
        let (at, pitch) = (joint_of(frame, header, self.joint), pitch_m(header));
        let on = header.bodies.iter().enumerate().filter(|(_, b)| b.rotor && b.teeth > 0).find(|(_, body)| {
            let (origin, _) = body.pose(frame);
            let radius = pitch / (2.0 * libm::sin(PI / f64::from(body.teeth)));
            (at - Vec2::new(origin[0], origin[1])).norm() < radius + ON_SPROCKET * pitch
        });
        // Even numbers: on sprockets; odd ones: spans behind them.
        let zone = match (on, self.last) {
            (Some((k, _)), _) => {
                self.last = Some(k);
                2 * k
            }
            (None, Some(k)) => 2 * k + 1,
            (None, None) => return,
        };
        self.seen.push((zone, frame.crank_angle_rad.abs() / (2.0 * PI), joint_force_n(frame, self.joint)));
    }

    fn finish(self: Box<Self>) -> Value {
        let mut map = Map::new();
        for (k, name) in self.names.iter().enumerate() {
            for (zone, key) in [(2 * k, format!("on_{name}")), (2 * k + 1, format!("behind_{name}"))] {
                let own: Vec<(f64, f64)> = self.seen.iter().filter(|s| s.0 == zone).map(|s| (s.1, s.2)).collect();
                map.insert(key, zone_json(&own));
            }
        }
        Value::Object(map)
    }
}

/// Mean, scatter and order 2 of a force over turns; tenths of all stays but the first and the last, which the run cuts off.
fn zone_json(own: &[(f64, f64)]) -> Value {
    let n = own.len().max(1) as f64;
    let mean = own.iter().map(|s| s.1).sum::<f64>() / n;
    let sigma = libm::sqrt(own.iter().map(|s| (s.1 - mean) * (s.1 - mean)).sum::<f64>() / n);
    // Stays: parts without a gap.
    let mut stays: Vec<Vec<(f64, f64)>> = Vec::new();
    for s in own {
        match stays.last_mut().filter(|stay| stay.last().is_some_and(|last| s.0 - last.0 < 0.05)) {
            Some(stay) => stay.push(*s),
            None => stays.push(vec![*s]),
        }
    }
    let whole = stays.get(1..stays.len().saturating_sub(1)).filter(|s| !s.is_empty()).unwrap_or(&stays);
    let longest = whole.iter().max_by_key(|s| s.len()).cloned().unwrap_or_default();
    // Least squares of offset, cosine and sine of order 2 over the longest stay.
    let order_two = fitted_amplitude(&longest, 2.0);
    let ends = |stay: &[(f64, f64)]| match (stay.first(), stay.last()) {
        (Some(a), Some(b)) => (a.0, b.0),
        _ => (0.0, 0.0),
    };
    let mut tenths = [(0.0, 0_usize); 10];
    for stay in whole {
        let (first, last) = ends(stay);
        for (turn, force) in stay {
            let part = ((turn - first) / (last - first).max(1e-12) * 10.0) as usize;
            if let Some(own) = tenths.get_mut(part) {
                *own = (own.0 + force, own.1 + 1);
            }
        }
    }
    let tenths: Vec<f64> = tenths.iter().map(|(sum, n)| sum / (*n).max(1) as f64).collect();
    let (first, last) = ends(&longest);
    let low = own.iter().map(|s| s.1).fold(f64::INFINITY, f64::min);
    let high = own.iter().map(|s| s.1).fold(0.0, f64::max);
    json!({"mean_n": mean, "sigma_n": sigma, "order_2_n": order_two, "tenths_n": tenths, "stays": whole.len(), "turns": last - first, "low_n": low, "high_n": high})
}

/// Amplitude of an order by least squares beside a mean and a slope.
fn fitted_amplitude(points: &[(f64, f64)], order: f64) -> f64 {
    if points.len() < 8 {
        return f64::NAN;
    }
    let rows = nalgebra::DMatrix::from_fn(points.len(), 4, |i, c| {
        let (s, cos) = libm::sincos(2.0 * PI * order * points[i].0);
        [1.0, points[i].0 - points[0].0, cos, s][c]
    });
    let values = nalgebra::DVector::from_iterator(points.len(), points.iter().map(|p| p.1));
    let solved = rows.svd(true, true).solve(&values, 1e-12);
    solved.map_or(f64::NAN, |x| libm::hypot(x[2], x[3]))
}

/// What lies further from a rail's chord than this share of it belongs to another span.
const ASIDE: f64 = 0.15;
/// Parts of a rail along its chord.
const RAIL_PARTS: usize = 24;

/// Forces along a rail.
#[derive(Default)]
struct RailWatch {
    rail: String,
    /// Where the chain arrives, in the frame of the rail's body.
    start: Vec2,
    frames: usize,
    force_n: Vec<f64>,
    /// Links whose middle lies over a part, and those of them that press on it.
    over: Vec<usize>,
    pressing: Vec<usize>,
    chord_m: f64,
    pitch_m: f64,
}

impl Watcher for RailWatch {
    fn see(&mut self, frame: &Frame, header: &Header) {
        let is_own = |b: &crate::recording::frame::BodyInfo| {
            b.kind == BodyKind::Rail as u32 && crate::diag::last_name(&b.path) == self.rail
        };
        let Some(body) = header.bodies.iter().position(is_own) else { return };
        let info = &header.bodies[body];
        let Some(outline) = &info.outline else { return };
        let (Some(a), Some(b)) = (outline.elements.first(), outline.elements.last()) else { return };
        let ends = [Vec2::new(a.start_x_m, a.start_y_m), Vec2::new(b.end_x_m, b.end_y_m)];
        let is_reversed = (ends[1] - self.start).norm() < (ends[0] - self.start).norm();
        let (from, to) = if is_reversed { (ends[1], ends[0]) } else { (ends[0], ends[1]) };
        let (origin, angle) = info.pose(frame);
        self.chord_m = (to - from).norm();
        self.pitch_m = pitch_m(header);
        self.force_n.resize(RAIL_PARTS, 0.0);
        self.over.resize(RAIL_PARTS, 0);
        self.pressing.resize(RAIL_PARTS, 0);
        self.frames += 1;
        let c = &frame.contacts;
        let part_of = |x_m: f64, y_m: f64| {
            let own = crate::geometry::rotated(Vec2::new(x_m - origin[0], y_m - origin[1]), -angle);
            let along = (to - from) / self.chord_m;
            let (way, aside) = ((own - from).dot(&along), crate::geometry::cross(along, own - from));
            let part = (way / self.chord_m * RAIL_PARTS as f64).floor();
            (part >= 0.0 && part < RAIL_PARTS as f64 && aside.abs() < ASIDE * self.chord_m).then_some(part as usize)
        };
        let mut presses = vec![false; header.links.len()];
        for i in (0..c.link.len()).filter(|i| c.body[*i] as usize == body) {
            presses[c.link[i] as usize] |= c.normal_force_n[i] > 0.0;
            if let Some(part) = part_of(c.point_link_x_m[i], c.point_link_y_m[i]) {
                self.force_n[part] += c.normal_force_n[i];
            }
        }
        for (link, presses) in presses.iter().enumerate() {
            if let Some(part) = part_of(frame.links.x_m[link], frame.links.y_m[link]) {
                self.over[part] += 1;
                self.pressing[part] += usize::from(*presses);
            }
        }
    }

    fn finish(self: Box<Self>) -> Value {
        let frames = self.frames.max(1) as f64;
        let per_link: Vec<f64> =
            self.force_n.iter().map(|f| f / frames * self.pitch_m / (self.chord_m / RAIL_PARTS as f64)).collect();
        json!({"force_per_link_n": per_link, "over": self.over, "pressing": self.pressing, "chord_m": self.chord_m})
    }
}

/// Pitches along a wrap that are looked at.
const WRAP_PITCHES: usize = 8;

/// Force on teeth along a wrap.
#[derive(Default)]
struct WrapWatch {
    sprocket: String,
    frames: usize,
    force_n: [f64; WRAP_PITCHES],
}

impl Watcher for WrapWatch {
    fn see(&mut self, frame: &Frame, header: &Header) {
        let Some(body) = header.bodies.iter().position(|b| crate::diag::last_name(&b.path) == self.sprocket) else {
            return;
        };
        let info = &header.bodies[body];
        let (origin, _) = info.pose(frame);
        let step_rad = 2.0 * PI / f64::from(info.teeth.max(1));
        let c = &frame.contacts;
        // Segments up to the tip's land belong to teeth; rings come behind.
        let on_teeth: Vec<usize> =
            (0..c.link.len()).filter(|i| c.body[*i] as usize == body && c.segment[*i] <= 4).collect();
        let angle = |i: usize| crate::units::atan2(c.point_link_y_m[i] - origin[1], c.point_link_x_m[i] - origin[0]);
        // The first of them in the sense of travel: no other within half a turn behind it.
        let behind = |i: usize, j: usize| wrap_angle(angle(i) - angle(j)) > 1e-6;
        let Some(first) = on_teeth.iter().copied().find(|i| !on_teeth.iter().any(|j| behind(*i, *j))) else { return };
        self.frames += 1;
        for i in &on_teeth {
            let pitch = (wrap_angle(angle(*i) - angle(first)) / step_rad + 0.5).floor();
            if let Some(sum) = self.force_n.get_mut(pitch.max(0.0) as usize) {
                *sum += c.normal_force_n[*i];
            }
        }
    }

    fn finish(self: Box<Self>) -> Value {
        let frames = self.frames.max(1) as f64;
        json!({"force_n": self.force_n.map(|f| f / frames)})
    }
}

/// What touches what, and how many at once.
#[derive(Default)]
struct PairWatch {
    pairs: BTreeMap<String, u64>,
    links: u64,
    several: u64,
}

impl Watcher for PairWatch {
    fn see(&mut self, frame: &Frame, header: &Header) {
        let c = &frame.contacts;
        let mut of_link: BTreeMap<u32, usize> = BTreeMap::new();
        for i in 0..c.link.len() {
            let Some(body) = header.bodies.get(c.body[i] as usize) else { continue };
            let name = format!("{} on {} {}", c.feature[i], BodyKind::name(body.kind), c.segment[i]);
            *self.pairs.entry(name).or_insert(0) += 1;
            if body.rotor {
                *of_link.entry(c.link[i]).or_insert(0) += 1;
            }
        }
        self.links += of_link.len() as u64;
        self.several += of_link.values().filter(|n| **n > 1).count() as u64;
    }

    fn finish(self: Box<Self>) -> Value {
        json!({"pairs": self.pairs, "several_share": self.several as f64 / self.links.max(1) as f64})
    }
}

/// Forces into mounts: of sprockets on their axes, guides, pivots of arms, housings of plungers.
#[derive(Default)]
struct MountWatch {
    turns: Vec<f64>,
    forces: BTreeMap<String, Vec<[f64; 2]>>,
}

impl Watcher for MountWatch {
    fn see(&mut self, frame: &Frame, header: &Header) {
        let mut sums: BTreeMap<String, [f64; 2]> = BTreeMap::new();
        let c = &frame.contacts;
        // What stands on an arm goes into its pivot, but for what the plunger takes.
        let arm_of = |k: usize| {
            header.bodies[k]
                .coordinate
                .and_then(|row| header.coordinates.get(row as usize))
                .filter(|p| p.starts_with("arms."))
        };
        let mut add = |name: &str, x: f64, y: f64| {
            let sum = sums.entry(name.to_string()).or_insert([0.0; 2]);
            *sum = [sum[0] + x, sum[1] + y];
        };
        for i in 0..c.link.len() {
            let body = c.body[i] as usize;
            let name = arm_of(body).unwrap_or(&header.bodies[body].path);
            let (f, t) = (c.normal_force_n[i], c.tangential_force_n[i]);
            // The force on the link is n f + t tangent; the body feels the opposite.
            add(name, -(c.normal_x[i] * f - c.normal_y[i] * t), -(c.normal_y[i] * f + c.normal_x[i] * t));
        }
        for (k, path) in header.touches.iter().enumerate() {
            let (nx, ny) = (frame.touches.normal_x[k], frame.touches.normal_y[k]);
            let f = frame.touches.normal_force_n[k];
            if path.starts_with("sliders.") && (nx != 0.0 || ny != 0.0) {
                if let Some(arm) = header.coordinates.iter().find(|p| p.starts_with("arms.")) {
                    add(arm, -nx * f, -ny * f);
                }
                add(path, nx * f, ny * f);
            }
        }
        self.turns.push(frame.crank_angle_rad.abs() / (2.0 * PI));
        let n = self.turns.len();
        for (name, force) in sums {
            let column = self.forces.entry(name).or_default();
            column.resize(n - 1, [0.0; 2]);
            column.push(force);
        }
        self.forces.values_mut().for_each(|column| column.resize(n, [0.0; 2]));
    }

    fn finish(self: Box<Self>) -> Value {
        let amplitude = |column: &[[f64; 2]], order: f64| {
            let n = column.len() as f64;
            let mean = |axis: usize| column.iter().map(|f| f[axis]).sum::<f64>() / n;
            let means = [mean(0), mean(1)];
            let mut sums = [[0.0; 2]; 2];
            for (i, (turn, force)) in self.turns.iter().zip(column).enumerate() {
                let window = 0.5 * (1.0 - libm::cos(2.0 * PI * (i as f64 + 0.5) / n));
                let (s, c) = libm::sincos(2.0 * PI * order * turn);
                for axis in 0..2 {
                    sums[axis][0] += window * (force[axis] - means[axis]) * c;
                    sums[axis][1] += window * (force[axis] - means[axis]) * s;
                }
            }
            libm::hypot(libm::hypot(sums[0][0], sums[0][1]), libm::hypot(sums[1][0], sums[1][1])) * 4.0 / n
        };
        let of = |column: &Vec<[f64; 2]>| json!({"order_10_n": amplitude(column, 10.0), "order_20_n": amplitude(column, 20.0)});
        Value::Object(self.forces.iter().map(|(name, column)| (name.clone(), of(column))).collect())
    }
}
