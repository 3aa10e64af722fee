//! Forces on what carries a drive: the ways of its forces into the engine's block.
//!
//! ```text
//! sprocket, guide, rail without a bearing     - sum of the forces of its contacts on links and rollers
//! the same on a bearing                       - (spring + damper + film) along each of its ways; of one way only, contacts across it
//! arm, on its pivot                           - contacts of its rails on links, - its pads on tips
//! plunger, on its housing                     - (spring + damper + oil + stops) along its way, and what the pad gives its tip across it
//! cams of a shaft, on its bearings            - forces of cams on followers; its sprockets have rows of their own
//! valves alike, on the cylinder head          cams on followers, less the change of momentum of valves, springs and lifters
//! chain without links, on its sprockets       tension of each span, away from the sprocket
//! ```
//! A cam gives a roller F along the lift and F tan(a) across it, sin(a) = (distance of the touch from the follower's line) / r.
//! The forces of all contacts add up to the change of momentum of links and rollers, sum F = sum m a, which [`Balance`] holds them against.

use crate::diag::last_name;
use crate::drive::Drive;
use crate::drive::mechanism::SliderSpec;
use crate::drive::valves::ValveSpec;
use crate::recording::frame::{BodyInfo, BodyKind, BodyShift, Frame, Header, OutlineElement};
use crate::units::sin_cos;

/// A force that a mount gets, in one frame.
#[derive(Clone, Debug, PartialEq)]
enum MountLoad {
    /// What links and rollers press on a body, by its index.
    Contacts(u32),
    /// What a way of a bearing gives, by its row in `Sliders`, and its direction.
    Way { slider: usize, direction: [f64; 2] },
    /// What links and rollers press on a body across its only way, which has this direction.
    Across { body: u32, direction: [f64; 2] },
    /// What the pad of an arm gets from a tip, by the row of `Touches`.
    Pad(usize),
    /// What a plunger gives its housing: its row, its direction, and the row of its tip.
    Plunger { slider: usize, direction: [f64; 2], tip: Option<usize> },
    /// What a cam gets from its follower, by the row of `Touches`, its axis, and the radius of the follower's roller.
    Cam { touch: usize, axis: [f64; 2], roller_m: Option<f64> },
    /// What a valve train gives the head: the force of its cam, and what moves along the lift, by rows of `Sliders`. All that is given to these sliders is their
    /// mass times their acceleration.
    Head { cam: Box<MountLoad>, direction: [f64; 2], sliders: Vec<usize> },
    /// The tension of a span, along this direction.
    Span { row: usize, direction: [f64; 2] },
}

/// What stands still and carries a part of the drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Mount {
    /// Path of what it carries: `sprockets.driven`, `arms.NAME`, `sliders.NAME`; that of the bearing where it carries several; `cams.` and the
    /// path of their shaft for cams; `head.` and the name of their table for valves.
    pub path: String,
    /// What its force does not hold, or holds too much.
    pub notes: Vec<String>,
    loads: Vec<MountLoad>,
}

fn is_kind(b: &BodyInfo, kind: BodyKind) -> bool {
    b.kind == kind as u32
}

/// The mounts of a drive, in the order of its bodies; then those of plungers, of shafts with cams, and of valves.
///
/// # Errors
/// The recording's drive cannot be read, as of several drives side by side: one sentence.
pub fn mounts(header: &Header) -> Result<Vec<Mount>, String> {
    if header.is_merged() {
        return Err("this recording holds several drives side by side: look at each by itself".into());
    }
    let drive = Drive::parse(&header.drive_name, &header.drive_text, &header.overrides)
        .map_err(|report| format!("the drive of this recording cannot be read\n{report}"))?;
    let mut all: Vec<Mount> = Vec::new();
    for (body, info) in header.bodies.iter().enumerate() {
        let stands = is_kind(info, BodyKind::Rail) && info.coordinate.is_none();
        if is_kind(info, BodyKind::Sprocket) || is_kind(info, BodyKind::Guide) || stands {
            let mount = carrier(header, body, info);
            // Sprockets of one shaft stand on one bearing.
            let has_ways = matches!(mount.loads[..], [MountLoad::Way { .. }, ..]);
            let Some(known) = all.iter_mut().find(|m| has_ways && m.loads == mount.loads) else {
                all.push(mount);
                continue;
            };
            let way = info.shifts.first().and_then(|s| header.sliders.get(s.slider as usize));
            if let Some((bearing, _)) = way.and_then(|path| path.rsplit_once('.')) {
                known.path = bearing.to_string();
            }
        } else if is_kind(info, BodyKind::Arm) {
            all.push(pivot(header, &drive, info));
        }
    }
    for spec in &drive.sliders {
        let path = format!("sliders.{}", spec.name);
        let Some(slider) = header.sliders.iter().position(|row| *row == path) else { continue };
        let (sin, cos) = sin_cos(spec.direction_rad);
        let loads = vec![MountLoad::Plunger { slider, direction: [cos, sin], tip: tip_of(header, spec) }];
        all.push(Mount { path, notes: Vec::new(), loads });
    }
    for (row, shaft) in header.coordinates.iter().enumerate() {
        let own = header.bodies.iter().filter(|b| is_kind(b, BodyKind::Cam) && b.coordinate == Some(row as u32));
        let loads: Vec<MountLoad> = own.filter_map(|cam| follower(header, &drive, cam)).collect();
        if !loads.is_empty() {
            all.push(Mount { path: format!("cams.{shaft}"), notes: Vec::new(), loads });
        }
    }
    all.extend(drive.valves.iter().map(|spec| head(header, &drive, spec)));
    Ok(all)
}

/// What carries a sprocket, a guide or a rail.
fn carrier(header: &Header, body: usize, info: &BodyInfo) -> Mount {
    let way = |s: &BodyShift| MountLoad::Way { slider: s.slider as usize, direction: [s.direction_x, s.direction_y] };
    let mut loads: Vec<MountLoad> = info.shifts.iter().map(way).collect();
    let mut notes = Vec::new();
    if let [MountLoad::Way { direction, .. }] = loads[..] {
        loads.push(MountLoad::Across { body: body as u32, direction });
    }
    if loads.is_empty() {
        loads.push(MountLoad::Contacts(body as u32));
        let spans = spans_on(header, info);
        if !spans.is_empty() {
            notes.push("each span's pull is too large by m' v^2, which presses on no sprocket".into());
        }
        loads.extend(spans);
    }
    if header.sliders.iter().any(|path| path.starts_with(&format!("{}.bending.", info.path))) {
        notes.push("the inertia of what bends is left out".into());
    }
    Mount { path: info.path.clone(), notes, loads }
}

/// The pivot of an arm.
fn pivot(header: &Header, drive: &Drive, arm: &BodyInfo) -> Mount {
    let own = |b: &BodyInfo| is_kind(b, BodyKind::Rail) && b.coordinate == arm.coordinate;
    let rails = header.bodies.iter().enumerate().filter(|(_, b)| own(b));
    let on_it = |s: &&SliderSpec| drive.arms.get(s.arm).is_some_and(|a| a.name == last_name(&arm.path));
    let pads = drive.sliders.iter().filter(on_it).filter_map(|s| tip_of(header, s)).map(MountLoad::Pad);
    let loads = rails.map(|(rail, _)| MountLoad::Contacts(rail as u32)).chain(pads).collect();
    let mut notes = vec!["the arm's own inertia is left out: its file gives no centre of mass".to_string()];
    if header.touches.iter().any(|path| path.starts_with(&format!("{}.", arm.path))) {
        notes.push("forces of its stops are left out: the file gives them no direction".into());
    }
    Mount { path: arm.path.clone(), notes, loads }
}

/// What valves that are alike give the cylinder head: springs, seats, bores of followers, pivots of rockers.
fn head(header: &Header, drive: &Drive, spec: &ValveSpec) -> Mount {
    let (sin, cos) = sin_cos(spec.direction_rad);
    let of_valve = |number: usize| {
        let path = spec.path(number);
        let body = header.bodies.iter().find(|b| b.path == path.replacen("valves.", "cams.", 1))?;
        let cam = Box::new(follower(header, drive, body)?);
        let below = format!("{path}.");
        let own = |(_, row): &(usize, &String)| **row == path || row.starts_with(&below);
        let rows = header.sliders.iter().enumerate().filter(own);
        Some(MountLoad::Head { cam, direction: [cos, sin], sliders: rows.map(|(row, _)| row).collect() })
    };
    let mut notes = Vec::new();
    if spec.gas.is_some() {
        notes.push("what the gas presses the valves onto their seats with is left out".into());
    }
    if spec.rocker.is_some() {
        notes.push("rockers are taken as masses in one line with cam and valve".into());
    }
    if spec.spring_mass_kg > 0.0 && spec.spring_parts == 1 {
        notes.push("of the inertia of springs in one part a third counts, which is right for their energy; their momentum has half".into());
    }
    let loads = (0..spec.phases_rad.len()).filter_map(of_valve).collect();
    Mount { path: format!("head.{}", spec.name), notes, loads }
}

/// Row of `Touches` where the tip of a plunger meets its pad.
fn tip_of(header: &Header, slider: &SliderSpec) -> Option<usize> {
    let path = format!("sliders.{}.tip", slider.name);
    header.touches.iter().position(|row| *row == path)
}

/// What a cam gets from its follower.
fn follower(header: &Header, drive: &Drive, cam: &BodyInfo) -> Option<MountLoad> {
    let valve = cam.path.replacen("cams.", "valves.", 1);
    let path = format!("{valve}.cam");
    let touch = header.touches.iter().position(|row| *row == path)?;
    let is_of = |spec: &&ValveSpec| (0..spec.phases_rad.len()).any(|number| spec.path(number) == valve);
    let roller_m = drive.valves.iter().find(is_of).and_then(|spec| spec.roller_m);
    Some(MountLoad::Cam { touch, axis: [cam.x_m, cam.y_m], roller_m })
}

/// Spans of chains without links on a sprocket: the lines of their chain's outline are in the order of its spans.
fn spans_on(header: &Header, sprocket: &BodyInfo) -> Vec<MountLoad> {
    let name = last_name(&sprocket.path);
    // Names may hold a dash themselves.
    let is_sprocket = |rest: &str| header.bodies.iter().any(|b| b.rotor && last_name(&b.path) == rest);
    let mut loads = Vec::new();
    for chain in header.bodies.iter().filter(|b| is_kind(b, BodyKind::Chain)) {
        let own = header.spans.iter().enumerate().filter(|(_, path)| path.starts_with(&format!("{}.", chain.path)));
        let elements = chain.outline.iter().flat_map(|o| &o.elements);
        let lines = elements.filter(|e| e.radius_m == 0.0);
        for ((row, path), line) in own.zip(lines) {
            let (ends, away) = (last_name(path), direction_of(line));
            if ends.strip_prefix(name).and_then(|rest| rest.strip_prefix('-')).is_some_and(is_sprocket) {
                loads.push(MountLoad::Span { row, direction: away });
            }
            if ends.strip_suffix(name).and_then(|rest| rest.strip_suffix('-')).is_some_and(is_sprocket) {
                loads.push(MountLoad::Span { row, direction: away.map(|x| -x) });
            }
        }
    }
    loads
}

fn direction_of(line: &OutlineElement) -> [f64; 2] {
    let (x, y) = (line.end_x_m - line.start_x_m, line.end_y_m - line.start_y_m);
    let length = libm::hypot(x, y).max(1e-300);
    [x / length, y / length]
}

/// Force of one contact on its link or roller [N].
fn of_contact(frame: &Frame, row: usize) -> [f64; 2] {
    let c = &frame.contacts;
    let (n, t) = (c.normal_force_n[row], c.tangential_force_n[row]);
    let (x, y) = (c.normal_x[row], c.normal_y[row]);
    [n * x - t * y, n * y + t * x]
}

/// Force of a touch on its first part [N].
fn of_touch(frame: &Frame, row: usize) -> [f64; 2] {
    let t = &frame.touches;
    let at = |column: &[f64]| column.get(row).copied().unwrap_or(0.0);
    let (n, s) = (at(&t.normal_force_n), at(&t.tangential_force_n));
    let (x, y) = (at(&t.normal_x), at(&t.normal_y));
    [n * x - s * y, n * y + s * x]
}

/// What links and rollers press on a body [N].
fn of_links(frame: &Frame, body: u32) -> [f64; 2] {
    let own = (0..frame.contacts.body.len()).filter(|row| frame.contacts.body[*row] == body);
    own.map(|row| of_contact(frame, row)).fold([0.0; 2], |[x, y], [fx, fy]| [x - fx, y - fy])
}

impl MountLoad {
    fn force(&self, frame: &Frame) -> [f64; 2] {
        let s = &frame.sliders;
        let at = |column: &[f64], row: usize| column.get(row).copied().unwrap_or(0.0);
        match *self {
            MountLoad::Head { ref cam, direction, ref sliders } => {
                let on_cam = cam.force(frame);
                let given =
                    |row: &usize| at(&s.spring_force_n, *row) + at(&s.oil_force_n, *row) + at(&s.touch_force_n, *row);
                let taken_up: f64 = sliders.iter().map(given).sum();
                [0, 1].map(|i| -on_cam[i] - taken_up * direction[i])
            }
            MountLoad::Contacts(body) => of_links(frame, body),
            MountLoad::Across { body, direction: [dx, dy] } => {
                let [x, y] = of_links(frame, body);
                let along = x * dx + y * dy;
                [x - along * dx, y - along * dy]
            }
            MountLoad::Way { slider, direction } => direction.map(|d| -d * at(&s.spring_force_n, slider)),
            MountLoad::Pad(touch) => of_touch(frame, touch).map(|f| -f),
            MountLoad::Cam { touch, axis, roller_m } => {
                let [x, y] = of_touch(frame, touch);
                let t = &frame.touches;
                let lift = [at(&t.normal_x, touch), at(&t.normal_y, touch)];
                let from_axis = [at(&t.x_m, touch) - axis[0], at(&t.y_m, touch) - axis[1]];
                // To the right of the lift, as the touch leaves the follower's line.
                let beside = from_axis[0] * lift[1] - from_axis[1] * lift[0];
                let sin = roller_m.map_or(0.0, |r| (beside / r).clamp(-1.0, 1.0));
                let across = at(&t.normal_force_n, touch) * sin / libm::sqrt((1.0 - sin * sin).max(1e-12));
                [across * lift[1] - x, -across * lift[0] - y]
            }
            MountLoad::Plunger { slider, direction, tip } => {
                let on_tip = tip.map_or([0.0; 2], |row| of_touch(frame, row));
                let along = on_tip[0] * direction[0] + on_tip[1] * direction[1];
                // What the housing gives along the way, and the pad across it, which the bore takes up.
                let housing = at(&s.spring_force_n, slider) + at(&s.oil_force_n, slider);
                let stops = at(&s.touch_force_n, slider) - along;
                [0, 1].map(|i| on_tip[i] - (along + housing + stops) * direction[i])
            }
            MountLoad::Span { row, direction } => direction.map(|d| d * at(&frame.spans.tension_n, row)),
        }
    }
}

impl Mount {
    /// Force on it in a frame [N].
    pub fn force(&self, frame: &Frame) -> [f64; 2] {
        self.loads.iter().map(|load| load.force(frame)).fold([0.0; 2], |[x, y], [fx, fy]| [x + fx, y + fy])
    }
}

/// Sums over frames of what all contacts give to links and rollers, and of what these take up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Balance {
    left: f64,
    largest_n: f64,
    frames: usize,
}

impl Balance {
    /// Adds a frame.
    pub fn add(&mut self, frame: &Frame, header: &Header) {
        let mut sum = [0.0; 2];
        for row in 0..frame.contacts.body.len() {
            let own = of_contact(frame, row);
            self.largest_n = self.largest_n.max(libm::hypot(own[0], own[1]));
            sum = [sum[0] + own[0], sum[1] + own[1]];
        }
        let (l, r) = (&frame.links, &frame.rollers);
        let links = header.links.iter().map(|i| i.mass_kg).zip(l.ax_m_s2.iter().zip(&l.ay_m_s2));
        let rollers = header.rollers.iter().map(|i| i.mass_kg).zip(r.ax_m_s2.iter().zip(&r.ay_m_s2));
        for (mass, (ax, ay)) in links.chain(rollers) {
            sum = [sum[0] - mass * ax, sum[1] - mass * ay];
        }
        self.left += sum[0] * sum[0] + sum[1] * sum[1];
        self.frames += 1;
    }

    /// Root mean square of what is left, and the largest force of a contact [N].
    pub fn left_n(&self) -> (f64, f64) {
        (libm::sqrt(self.left / self.frames.max(1) as f64), self.largest_n)
    }
}
