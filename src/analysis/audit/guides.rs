//! Guides and rails: place of the face, contact law and friction, from where links touch and how hard.

use super::least_squares::NormalEquations;
use super::{ContactLawFit, ContactLawSums, Estimate};
use crate::recording::frame::{BodyKind, Frame, Header, Segment};

/// Sums over the contacts of one guide.
#[derive(Clone, Debug)]
struct GuideSums {
    body: usize,
    law: ContactLawSums,
    friction: NormalEquations<1>,
    /// Height of a straight face over the way along it, in the guide's frame.
    face: NormalEquations<2>,
    from_m: f64,
    to_m: f64,
    force_n: f64,
    /// Force of the chain over way, speed and acceleration of a guide that one way shifts.
    mount: NormalEquations<3>,
    points: Vec<TouchedPoint>,
    /// Sum of the speeds of links that touch it, along its x-axis [m/s].
    runs_m_s: f64,
    /// Every so many contacts one is kept; contacts so far.
    stride: usize,
    contacts: usize,
    touched: usize,
    frames: usize,
}

/// Contacts of a guide that are kept at most.
const POINTS: usize = 512;

/// A point of a contour and its outward normal there, in the frame of its body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TouchedPoint {
    /// [m]
    pub point: [f64; 2],
    pub normal: [f64; 2],
}

/// What the frames tell of a guide.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GuideFit {
    /// Index into `Header::bodies`.
    pub body: usize,
    pub law: ContactLawFit,
    pub friction: Option<Estimate>,
    /// Mean of the sum of all normal forces on it [N].
    pub force_n: Option<Estimate>,
    /// Compliance of what it stands on, along its way [m/N]; 0 where it stands still.
    pub mount_compliance_m_per_n: Option<Estimate>,
    /// Two points of a straight face, where contacts begin and end along it, in the world [m].
    pub face: Option<[[f64; 2]; 2]>,
    /// Contacts, evenly over the recording.
    pub points: Vec<TouchedPoint>,
    /// Whether the chain runs along its x-axis.
    pub forwards: bool,
    pub touched: usize,
}

#[derive(Clone, Debug)]
pub struct GuidePass {
    guides: Vec<GuideSums>,
}

impl GuidePass {
    pub fn new(header: &Header) -> GuidePass {
        let guides = header.bodies.iter().enumerate();
        let guides = guides.filter(|(_, b)| [BodyKind::Guide as u32, BodyKind::Rail as u32].contains(&b.kind));
        let empty = |body: usize| GuideSums {
            body,
            law: ContactLawSums::default(),
            friction: NormalEquations::default(),
            face: NormalEquations::default(),
            from_m: f64::INFINITY,
            to_m: f64::NEG_INFINITY,
            force_n: 0.0,
            mount: NormalEquations::default(),
            points: Vec::new(),
            runs_m_s: 0.0,
            stride: 1,
            contacts: 0,
            touched: 0,
            frames: 0,
        };
        GuidePass { guides: guides.map(|(body, _)| empty(body)).collect() }
    }

    pub fn take(&mut self, frame: &Frame, header: &Header) {
        let c = &frame.contacts;
        for sums in &mut self.guides {
            let (origin, angle) = header.bodies[sums.body].pose(frame);
            let (sin, cos) = crate::units::sin_cos(angle);
            let before = sums.law.samples();
            sums.frames += 1;
            if let [shift] = header.bodies[sums.body].shifts.as_slice() {
                let (row, s) = (shift.slider as usize, &frame.sliders);
                sums.mount.add([s.position_m[row], s.speed_m_s[row], s.acceleration_m_s2[row]], s.chain_force_n[row]);
            }
            let body = sums.body;
            for row in (0..c.link.len()).filter(|row| c.body[*row] as usize == body) {
                sums.force_n += c.normal_force_n[row];
                if !c.stick[row] && c.normal_force_n[row] > 0.0 {
                    sums.friction.add([c.normal_force_n[row]], c.tangential_force_n[row].abs());
                }
                if c.penetration_m[row] <= 0.0 {
                    continue;
                }
                // A force that would pull is clipped at zero, and does not follow the law.
                if c.instant_force_n[row] > 0.0 {
                    sums.law.add(c.penetration_m[row], c.normal_speed_m_s[row], c.instant_force_n[row]);
                }
                let link = c.link[row] as usize;
                sums.runs_m_s += frame.links.vx_m_s[link] * cos + frame.links.vy_m_s[link] * sin;
                let turned_back = |at: [f64; 2]| [at[0] * cos + at[1] * sin, at[1] * cos - at[0] * sin];
                let point = turned_back([c.point_body_x_m[row] - origin[0], c.point_body_y_m[row] - origin[1]]);
                sums.keep(TouchedPoint { point, normal: turned_back([c.normal_x[row], c.normal_y[row]]) });
                if c.segment[row] == Segment::GuideFace as u32 {
                    let [x, y] = point;
                    sums.face.add([1.0, x], y);
                    (sums.from_m, sums.to_m) = (sums.from_m.min(x), sums.to_m.max(x));
                }
            }
            sums.touched += usize::from(sums.law.samples() > before);
        }
    }

    pub fn fits(&self, header: &Header) -> Vec<GuideFit> {
        self.guides.iter().map(|sums| sums.fit(header)).collect()
    }
}

impl GuideSums {
    /// Keeps contacts that lie evenly over the recording.
    fn keep(&mut self, touched: TouchedPoint) {
        if self.contacts.is_multiple_of(self.stride) {
            self.points.push(touched);
        }
        self.contacts += 1;
        if self.points.len() > POINTS {
            self.stride *= 2;
            let mut number = 0;
            self.points.retain(|_| {
                number += 1;
                number % 2 == 1
            });
        }
    }

    fn fit(&self, header: &Header) -> GuideFit {
        let friction = self.friction.solve(0.0);
        let info = &header.bodies[self.body];
        // A guide that stands still has the frame of the header.
        let face = self.face.solve(0.0).filter(|_| !info.moves() && self.face.samples >= 8).map(|line| {
            let (sin, cos) = crate::units::sin_cos(info.angle_rad);
            [self.from_m, self.to_m].map(|x| {
                let y = line.value[0] + line.value[1] * x;
                [info.x_m + x * cos - y * sin, info.y_m + x * sin + y * cos]
            })
        });
        let frames = self.frames.max(1);
        let stands = Estimate { value: 0.0, error: 0.0, samples: frames };
        let mount = match info.shifts.len() {
            0 => (!info.moves()).then_some(stands),
            1 => self.mount.solve(0.0).filter(|m| m.error[0] < super::LAW_ERROR * m.value[0]).map(|m| Estimate {
                value: 1.0 / m.value[0],
                error: m.error[0] / (m.value[0] * m.value[0]),
                samples: self.mount.samples,
            }),
            _ => None,
        };
        GuideFit {
            body: self.body,
            law: self.law.fit(),
            friction: friction.map(|f| Estimate::of(&f, 0, self.friction.samples)),
            force_n: Some(Estimate { value: self.force_n / frames as f64, error: 0.0, samples: frames }),
            mount_compliance_m_per_n: mount,
            face,
            points: self.points.clone(),
            forwards: self.runs_m_s >= 0.0,
            touched: self.touched,
        }
    }
}
