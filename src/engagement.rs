//! Observes every link on its way over one sprocket, step by step, and records its engagement.
//!
//! A pass begins when the link's front joint comes within two pitches of the sprocket and is measured in tooth periods:
//! u = 0 when the joint passes `origin_m` along the arriving span, measured from the foot of the sprocket's axis (for
//! an abutment chain the end of the straight path, otherwise the foot itself). In a bush chain the joint is followed,
//! otherwise the link. Peaks are the largest force of the contact law between two steps ([`PeakMeter`]), sums use the
//! step means of the integration scheme. First contact of a kind is the first step of the pass in which it overlaps;
//! its speed is the approach speed at that step.

use crate::elements::contact_law::PeakMeter;
use crate::integrate::explicit::{ContactGroup, Scratch};
use crate::model::{Model, Toothing};
use crate::pairs::contour_body::LinkContour;
use crate::state::State;
use std::f64::consts::PI;

/// Kind of contact of a link with a sprocket and its guide.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactKind {
    Guide,
    /// Front and rear abutment on the ring.
    RingFront,
    RingRear,
    /// Bush of the front joint in the teeth, or the roller on it.
    Bush,
    /// Leading and trailing outer flank.
    FlankLeading,
    FlankTrailing,
    /// Either inner flank.
    InnerFlank,
}

impl ContactKind {
    /// What touches what.
    pub fn words(self) -> &'static str {
        match self {
            ContactKind::Guide => "abutment on guide",
            ContactKind::RingFront => "front abutment on ring",
            ContactKind::RingRear => "rear abutment on ring",
            ContactKind::Bush => "bush in teeth",
            ContactKind::FlankLeading => "leading flank",
            ContactKind::FlankTrailing => "trailing flank",
            ContactKind::InnerFlank => "inner flank",
        }
    }
}

/// All kinds, in the order of [`Pass`] columns.
pub const KINDS: [ContactKind; 7] = [
    ContactKind::Guide,
    ContactKind::RingFront,
    ContactKind::RingRear,
    ContactKind::Bush,
    ContactKind::FlankLeading,
    ContactKind::FlankTrailing,
    ContactKind::InnerFlank,
];

/// Start of a pass, in tooth periods.
pub const PASS_FROM: f64 = -2.0;
/// Bins per tooth period of a pass's force histories.
pub const BINS_PER_PITCH: usize = 200;

/// Passage of one link over the sprocket.
#[derive(Clone, Debug, PartialEq)]
pub struct Pass {
    pub link: usize,
    /// Time of u = 0 [s].
    pub start_s: f64,
    /// Per kind: u of first contact and its approach speed [m/s].
    pub first_touch: [Option<(f64, f64)>; KINDS.len()],
    /// Mean force per bin of u, from [`PASS_FROM`] on, per kind [N].
    pub force_n: Vec<[f64; KINDS.len()]>,
    /// Largest force per bin, per kind [N].
    pub peak_n: Vec<[f64; KINDS.len()]>,
    samples: Vec<u32>,
    last_bin: Option<usize>,
    meters: [PeakMeter; MAX_CONTACT_GROUPS],
}

/// Observes passes over one sprocket.
pub struct EngagementWatch {
    sprocket: usize,
    /// Unit vector of the arriving span, and u = 0 along it from the foot of the axis [m].
    direction: crate::geometry::Vec2,
    origin_m: f64,
    period_s: f64,
    pass_pitches: f64,
    follows_joints: bool,
    open: Vec<Option<Pass>>,
    last_along_m: Vec<f64>,
    pub done: Vec<Pass>,
    /// Mean speed and tension of the joints of the arriving span.
    speed: OrderSums,
    tension: OrderSums,
    span_m: (f64, f64),
    /// Largest distance of a joint of the span from the line through the axis [m].
    reach_m: f64,
}

/// Sums over steps of a value, and of its components at orders z/2 and z of the sprocket as (cos, sin). Only complete
/// double tooth periods count: over an incomplete one the mean itself has components at every order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct OrderSums {
    whole: ComponentSums,
    open: ComponentSums,
    /// Number of the current double period.
    number: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct ComponentSums {
    n: f64,
    sum: f64,
    half_order: (f64, f64),
    full_order: (f64, f64),
}

impl Pass {
    fn new(link: usize, start_s: f64, pitches: f64) -> Pass {
        let bins = ((pitches - PASS_FROM) * BINS_PER_PITCH as f64) as usize;
        Pass {
            link,
            start_s,
            first_touch: [None; KINDS.len()],
            force_n: vec![[0.0; KINDS.len()]; bins],
            peak_n: vec![[0.0; KINDS.len()]; bins],
            samples: vec![0; bins],
            last_bin: None,
            meters: [PeakMeter::default(); MAX_CONTACT_GROUPS],
        }
    }

    /// u of a bin's middle.
    pub fn u_of(bin: usize) -> f64 {
        PASS_FROM + (bin as f64 + 0.5) / BINS_PER_PITCH as f64
    }

    fn bins(&self, from: f64, to: f64) -> std::ops::Range<usize> {
        let bin = |u: f64| (((u - PASS_FROM) * BINS_PER_PITCH as f64).max(0.0) as usize).min(self.force_n.len());
        bin(from)..bin(to)
    }

    /// Largest force of a kind between two u [N].
    pub fn peak(&self, kind: ContactKind, from: f64, to: f64) -> f64 {
        self.bins(from, to).map(|b| self.peak_n[b][kind as usize]).fold(0.0, f64::max)
    }

    /// Mean force of a kind between two u [N].
    pub fn mean(&self, kind: ContactKind, from: f64, to: f64) -> f64 {
        let bins = self.bins(from, to);
        let n = bins.len().max(1) as f64;
        bins.map(|b| self.force_n[b][kind as usize]).sum::<f64>() / n
    }

    /// Range of u in which the force of a kind first rises from a tenth to nine tenths of its largest bin between
    /// `from` and `to`.
    pub fn rise(&self, kind: ContactKind, from: f64, to: f64) -> Option<f64> {
        let bins = self.bins(from, to);
        let at = |b: usize| self.force_n[b][kind as usize].max(self.peak_n[b][kind as usize]);
        let top = bins.clone().map(at).fold(0.0, f64::max);
        if top <= 0.0 {
            return None;
        }
        let high = bins.clone().find(|b| at(*b) >= 0.9 * top)?;
        // The last bin below a tenth before that; a rise within one bin has a duration of at most a bin.
        let low = (bins.start..=high).rev().find(|b| at(*b) <= 0.1 * top).unwrap_or(bins.start);
        Some((high - low) as f64 / BINS_PER_PITCH as f64)
    }
}

impl EngagementWatch {
    /// Observes sprocket `sprocket` of a model that was built from a drive.
    pub fn new(model: &Model, sprocket: usize) -> EngagementWatch {
        let (route, place) = model.route_at(sprocket).expect("a model of a drive has a route");
        let span = route.span_before(place);
        let s = &model.sprockets[sprocket];
        let teeth = f64::from(s.geometry.teeth());
        let wrap_rad = route.wrap(place).sweep_rad.abs();
        let follows_joints = matches!(s.geometry, Toothing::Iso(_)) && model.contours[s.chain].is_none();
        let links = model.chain.lanes;
        let lever_m = model.chain.lever[model.chain.loops[s.chain].start];
        EngagementWatch {
            sprocket,
            direction: span.direction,
            origin_m: model.line_end_m.get(sprocket).copied().unwrap_or(0.0),
            period_s: 2.0 * PI / (s.nominal_speed_rad_s.abs() * teeth),
            pass_pitches: wrap_rad / (2.0 * PI) * teeth + 4.0,
            follows_joints,
            open: vec![None; links],
            last_along_m: vec![f64::NAN; links],
            done: Vec::new(),
            speed: OrderSums::default(),
            tension: OrderSums::default(),
            reach_m: s.geometry.pitch_radius_m() + 2.0 * lever_m,
            // Links completely between the sprockets, at least two pitches from either.
            span_m: (-span.length_m + 2.0 * 2.0 * lever_m, -2.0 * 2.0 * lever_m),
        }
    }

    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// Records the step that has just been evaluated.
    pub fn observe(&mut self, model: &Model, state: &State, scratch: &Scratch) {
        let t = state.step as f64 * model.step_s;
        let (own, centre) = {
            let s = &model.sprockets[self.sprocket];
            (model.chain.loops[s.chain].clone(), s.frame.origin_at(&state.coordinates.angle))
        };
        let pitch = 2.0 * model.chain.lever[own.start];
        let half = 0.5 * model.step_s;
        let (mut speed, mut weights, mut tension) = (0.0, 0.0, 0.0);
        for link in own {
            let l = &state.links;
            let lever = model.chain.lever[link];
            let joint = crate::geometry::Vec2::new(l.x[link] + lever * l.cos[link], l.y[link] + lever * l.sin[link]);
            let d = joint - centre;
            let along = d.dot(&self.direction);
            let aside = crate::geometry::cross(self.direction, d);
            // On the arriving span, which has the axis on its left: not further out than the teeth extend.
            if aside < 0.0 && -aside < self.reach_m {
                let before = std::mem::replace(&mut self.last_along_m[link], along);
                let gate = self.origin_m + PASS_FROM * pitch;
                if before < gate && along >= gate {
                    let start = t - PASS_FROM * self.period_s;
                    self.open[link] = Some(Pass::new(link, start, self.pass_pitches));
                }
                if before < self.origin_m
                    && along >= self.origin_m
                    && let Some(pass) = &mut self.open[link]
                {
                    // The exact crossing, within the step.
                    let rate = (along - before) / model.step_s;
                    pass.start_s = t - (along - self.origin_m) / rate.max(1e-9);
                }
                if (self.span_m.0..self.span_m.1).contains(&along) {
                    let v = crate::geometry::Vec2::new(
                        l.vx[link] + half * scratch.ax[link],
                        l.vy[link] + half * scratch.ay[link],
                    );
                    // A Hann window over the span gives joints that enter or leave it zero weight.
                    let share = (along - self.span_m.0) / (self.span_m.1 - self.span_m.0);
                    let sine = crate::units::sin_cos(PI * share).0;
                    let weight = sine * sine;
                    let (fx, fy, _) = scratch.joint_force(link);
                    speed += weight * v.dot(&self.direction);
                    tension += weight * libm::hypot(fx, fy);
                    weights += weight;
                }
            } else {
                self.last_along_m[link] = f64::NAN;
            }
            self.follow(link, t, model, scratch);
        }
        if weights > 0.0 {
            self.sum_span(t, speed / weights, tension / weights);
        }
    }

    fn sum_span(&mut self, t: f64, speed: f64, tension: f64) {
        let phase = t / self.period_s;
        self.speed.add(phase, speed);
        self.tension.add(phase, tension);
    }

    fn follow(&mut self, link: usize, t: f64, model: &Model, scratch: &Scratch) {
        let Some(pass) = &mut self.open[link] else { return };
        let u = (t - pass.start_s) / self.period_s;
        let bin = ((u - PASS_FROM) * BINS_PER_PITCH as f64) as usize;
        if bin >= pass.force_n.len() {
            let pass = self.open[link].take().expect("just looked at");
            self.done.push(pass);
            return;
        }
        // A step may be longer than a bin.
        let from = pass.last_bin.map_or(bin, |last| (last + 1).min(bin));
        pass.last_bin = Some(bin);
        for bin in from..=bin {
            pass.samples[bin] += 1;
        }
        let contour = &model.contours[model.sprockets[self.sprocket].chain];
        let groups = contact_groups(contour.as_ref(), self.follows_joints);
        let seen = forces(model, scratch, link, groups, &mut pass.meters);
        for (kind, ContactsInStep { force, top, approach, touches }) in seen.into_iter().enumerate() {
            for bin in from..=bin {
                let share = 1.0 / f64::from(pass.samples[bin]);
                pass.force_n[bin][kind] += (force - pass.force_n[bin][kind]) * share;
                pass.peak_n[bin][kind] = pass.peak_n[bin][kind].max(top);
            }
            if touches && pass.first_touch[kind].is_none() {
                pass.first_touch[kind] = Some((u, approach));
            }
        }
    }

    /// Tooth-order variation of the speed of the arriving span: peak to peak of its component at order z, relative.
    pub fn speed_ripple(&self) -> f64 {
        let s = &self.speed.whole;
        2.0 * s.amplitude(s.full_order) / (s.sum / s.n)
    }

    /// Mean tension of the arriving span, and its amplitudes at orders z/2 and z of the sprocket [N].
    pub fn tension_n(&self) -> (f64, f64, f64) {
        let s = &self.tension.whole;
        (s.sum / s.n, s.amplitude(s.half_order), s.amplitude(s.full_order))
    }
}

impl OrderSums {
    fn add(&mut self, phase: f64, value: f64) {
        let number = libm::floor(0.5 * phase);
        if number != self.number {
            self.whole.n += self.open.n;
            self.whole.sum += self.open.sum;
            for (whole, open) in
                [(&mut self.whole.full_order, self.open.full_order), (&mut self.whole.half_order, self.open.half_order)]
            {
                *whole = (whole.0 + open.0, whole.1 + open.1);
            }
            (self.open, self.number) = (ComponentSums::default(), number);
        }
        let (s1, c1) = crate::units::sin_cos(2.0 * PI * phase);
        let (s2, c2) = crate::units::sin_cos(PI * phase);
        let open = &mut self.open;
        open.n += 1.0;
        open.sum += value;
        open.full_order = (open.full_order.0 + value * c1, open.full_order.1 + value * s1);
        open.half_order = (open.half_order.0 + value * c2, open.half_order.1 + value * s2);
    }
}

impl ComponentSums {
    fn amplitude(&self, (cos, sin): (f64, f64)) -> f64 {
        2.0 / self.n * libm::hypot(cos, sin)
    }
}

/// Force on one kind of part of a link.
#[derive(Clone, Copy, Debug, Default)]
struct ContactsInStep {
    /// Mean over the step, and maximum since the step before [N].
    force: f64,
    top: f64,
    /// At its first contact [m/s].
    approach: f64,
    touches: bool,
}

/// Maximum number of contact groups.
const MAX_CONTACT_GROUPS: usize = 5;

/// Kinds of contact and their contact groups, by chain type. Of several groups the one with the larger force counts.
fn contact_groups(contour: Option<&LinkContour>, joints: bool) -> &'static [(ContactKind, ContactGroup)] {
    const BUSH: (ContactKind, ContactGroup) = (ContactKind::Bush, ContactGroup::Bushes);
    const ABUTMENTS: [(ContactKind, ContactGroup); 5] = [
        BUSH,
        (ContactKind::RingFront, ContactGroup::Contours(0)),
        (ContactKind::RingRear, ContactGroup::Contours(1)),
        (ContactKind::Guide, ContactGroup::Contours(4)),
        (ContactKind::Guide, ContactGroup::Contours(5)),
    ];
    const FLANKS: [(ContactKind, ContactGroup); 5] = [
        (ContactKind::FlankLeading, ContactGroup::Contours(0)),
        (ContactKind::FlankTrailing, ContactGroup::Contours(1)),
        (ContactKind::InnerFlank, ContactGroup::Contours(2)),
        (ContactKind::InnerFlank, ContactGroup::Contours(3)),
        BUSH,
    ];
    match (contour, joints) {
        (Some(LinkContour::Abutments { .. }), _) => &ABUTMENTS,
        (Some(_), true) => &FLANKS,
        (Some(_), false) => &FLANKS[..4],
        (None, true) => &ABUTMENTS[..1],
        (None, false) => &[],
    }
}

/// Forces on every kind of part of a link.
fn forces(
    model: &Model,
    scratch: &Scratch,
    link: usize,
    groups: &[(ContactKind, ContactGroup)],
    meters: &mut [PeakMeter; MAX_CONTACT_GROUPS],
) -> [ContactsInStep; KINDS.len()] {
    let mut all = [ContactsInStep::default(); KINDS.len()];
    for ((kind, part), meter) in groups.iter().zip(meters) {
        let memory = scratch.memory(*part);
        if memory.is_empty() {
            continue;
        }
        let lane = if *part == ContactGroup::Bushes { model.chain.bush_lane(link) } else { link };
        let (force, approach) = (memory.normal_force[lane], memory.approach[lane]);
        let touch = scratch.touch(*part, lane);
        let law = touch.and_then(|_| scratch.law(model, *part, lane));
        let top = match law {
            Some(law) => meter.peak_since(law, touch, approach, model.step_s, 0.0).unwrap_or(force),
            None => {
                *meter = PeakMeter::default();
                0.0
            }
        };
        let seen = &mut all[*kind as usize];
        if force > seen.force || (touch.is_some() && !seen.touches) {
            (seen.force, seen.approach) = (force, approach);
        }
        seen.top = seen.top.max(top);
        seen.touches |= touch.is_some();
    }
    all
}
