//! Forces on what carries a drive: the ways of its forces into the engine's block.
//!
//! ```text
//! sprocket, guide, rail without a bearing     - sum of the forces of its contacts on links and rollers
//! the same on a bearing                       - (spring + damper + film) along each of its ways
//! arm, on its pivot                           - contacts of its rails on links, - its pads on tips
//! plunger, on its housing                     - (spring + damper + oil + stops) along its way, and what the pad gives its tip across it
//! shaft of cams, beside its sprocket          - the forces of cams on followers
//! chain without links, on its sprockets       tension of each span, away from the sprocket
//! ```
//! The forces of all contacts add up to the change of momentum of links and rollers, sum F = sum m a, which [`Balance`] holds them against.

use crate::diag::last_name;
use crate::drive::Drive;
use crate::recording::frame::{BodyInfo, BodyKind, Frame, Header, OutlineElement};
use crate::units::sin_cos;

/// A force that a mount gets, in one frame.
#[derive(Clone, Debug, PartialEq)]
enum MountLoad {
    /// What links and rollers press on a body, by its index.
    Contacts(u32),
    /// What a way of a bearing gives, by its row in `Sliders`, and its direction.
    Way { slider: usize, direction: [f64; 2] },
    /// What the pad of an arm gets from a tip, by the row of `Touches`.
    Pad(usize),
    /// What a plunger gives its housing: its row, its direction, and the row of its tip.
    Plunger { slider: usize, direction: [f64; 2], tip: Option<usize> },
    /// What a cam gets from its follower.
    Cam(usize),
    /// The tension of a span, along this direction.
    Span { row: usize, direction: [f64; 2] },
}

/// What stands still and carries a part of the drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Mount {
    /// Path of what it carries: `sprockets.driven`, `arms.NAME`, `sliders.NAME`; `cams.SHAFT` for the cams of a shaft.
    pub path: String,
    /// What is not in its force.
    pub lacks: Vec<String>,
    loads: Vec<MountLoad>,
}

/// The mounts of a drive, in the order of its bodies; then those of plungers and of shafts with cams.
///
/// # Errors
/// The recording's drive cannot be read, as of several drives side by side: one sentence.
pub fn mounts(header: &Header) -> Result<Vec<Mount>, String> {
    if header.is_merged() {
        return Err("this recording holds several drives side by side: look at each by itself".into());
    }
    let drive = Drive::parse(&header.drive_name, &header.drive_text, &header.overrides)
        .map_err(|report| format!("the drive of this recording cannot be read\n{report}"))?;
    let kind = |b: &BodyInfo, kind: BodyKind| b.kind == kind as u32;
    let rows = |from: &str| -> Vec<usize> {
        header.touches.iter().enumerate().filter(|(_, path)| *path == from).map(|(row, _)| row).collect()
    };
    let tip = |slider: &str| rows(&format!("sliders.{slider}.tip")).first().copied();
    let mut all: Vec<Mount> = Vec::new();
    for (body, info) in header.bodies.iter().enumerate() {
        let is_carried = kind(info, BodyKind::Sprocket)
            || kind(info, BodyKind::Guide)
            || kind(info, BodyKind::Rail) && info.coordinate.is_none();
        if is_carried {
            let ways = info.shifts.iter();
            let way = |s: &crate::recording::frame::BodyShift| MountLoad::Way {
                slider: s.slider as usize,
                direction: [s.direction_x, s.direction_y],
            };
            let mut mount = Mount { path: info.path.clone(), lacks: Vec::new(), loads: ways.map(way).collect() };
            if mount.loads.is_empty() {
                mount.loads.push(MountLoad::Contacts(body as u32));
                mount.loads.extend(spans_on(header, info));
                if mount.loads.len() > 1 {
                    mount.lacks.push("tensions hold m' v^2, which presses on no sprocket".into());
                }
                if header.sliders.iter().any(|path| path.starts_with(&format!("{}.", info.path))) {
                    mount.lacks.push("the inertia of what bends is left out".into());
                }
            }
            all.push(mount);
        } else if kind(info, BodyKind::Arm) {
            let own = |b: &BodyInfo| kind(b, BodyKind::Rail) && b.coordinate == info.coordinate;
            let rails = header.bodies.iter().enumerate().filter(|(_, b)| own(b));
            let on_it = |s: &&crate::drive::mechanism::SliderSpec| {
                drive.arms.get(s.arm).is_some_and(|arm| arm.name == last_name(&info.path))
            };
            let pads = drive.sliders.iter().filter(on_it).filter_map(|s| tip(&s.name)).map(MountLoad::Pad);
            let loads = rails.map(|(rail, _)| MountLoad::Contacts(rail as u32)).chain(pads).collect();
            let lacks = vec!["the arm's own inertia is left out: its file gives no centre of mass".into()];
            all.push(Mount { path: info.path.clone(), lacks, loads });
        }
    }
    for (name, direction_rad) in drive.sliders.iter().map(|s| (&s.name, s.direction_rad)) {
        let path = format!("sliders.{name}");
        let Some(slider) = header.sliders.iter().position(|row| *row == path) else { continue };
        let (sin, cos) = sin_cos(direction_rad);
        let loads = vec![MountLoad::Plunger { slider, direction: [cos, sin], tip: tip(name) }];
        all.push(Mount { path, lacks: Vec::new(), loads });
    }
    for (row, shaft) in header.coordinates.iter().enumerate() {
        let own = |b: &&BodyInfo| kind(b, BodyKind::Cam) && b.coordinate == Some(row as u32);
        let touch = |b: &BodyInfo| rows(&format!("{}.cam", b.path.replacen("cams.", "valves.", 1)));
        let loads: Vec<MountLoad> = header.bodies.iter().filter(own).flat_map(touch).map(MountLoad::Cam).collect();
        if !loads.is_empty() {
            all.push(Mount { path: format!("cams.{shaft}"), lacks: Vec::new(), loads });
        }
    }
    Ok(all)
}

/// Spans of chains without links on a sprocket: the lines of their chain's outline are in the order of its spans.
fn spans_on(header: &Header, sprocket: &BodyInfo) -> Vec<MountLoad> {
    let mut loads = Vec::new();
    for chain in header.bodies.iter().filter(|b| b.kind == BodyKind::Chain as u32) {
        let own = header.spans.iter().enumerate().filter(|(_, path)| path.starts_with(&format!("{}.", chain.path)));
        let elements = chain.outline.iter().flat_map(|o| &o.elements);
        let lines = elements.filter(|e| e.radius_m == 0.0);
        for ((row, path), line) in own.zip(lines) {
            let Some((from, to)) = last_name(path).split_once('-') else { continue };
            let name = last_name(&sprocket.path);
            let away = direction_of(line);
            if from == name {
                loads.push(MountLoad::Span { row, direction: away });
            }
            if to == name {
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

impl MountLoad {
    fn force(&self, frame: &Frame) -> [f64; 2] {
        let s = &frame.sliders;
        let at = |column: &[f64], row: usize| column.get(row).copied().unwrap_or(0.0);
        match *self {
            MountLoad::Contacts(body) => {
                let own = (0..frame.contacts.body.len()).filter(|row| frame.contacts.body[*row] == body);
                own.fold([0.0; 2], |[x, y], row| {
                    let [fx, fy] = of_contact(frame, row);
                    [x - fx, y - fy]
                })
            }
            MountLoad::Way { slider, direction } => direction.map(|d| -d * at(&s.spring_force_n, slider)),
            MountLoad::Pad(touch) => of_touch(frame, touch).map(|f| -f),
            MountLoad::Cam(touch) => of_touch(frame, touch).map(|f| -f),
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
