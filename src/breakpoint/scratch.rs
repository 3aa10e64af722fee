//! Values of a step's own columns, for breakpoints: what the step has computed anyway.

use super::quantities::{Quantity, Scope, What};
use super::{Bound, Breakpoint, Compare, Expr, Hit, Number, Operator, SLACK, Subject, Values, truth};
use crate::elements::contact_law::{ContactLaw, PairRadii};
use crate::elements::tooth_contact::LANES;
use crate::integrate::explicit::{Part, Scratch};
use crate::model::Model;
use crate::recording::capture::Camera;
use crate::recording::frame::Impact;
use crate::state::State;

/// A breakpoint and what fulfilled it a step ago.
pub struct BreakWatch {
    pub breakpoint: Breakpoint,
    parts: Vec<Part>,
    held: Vec<Subject>,
    now: Vec<Subject>,
    /// Who touched which tooth a step ago, and a number for every lane to tell by.
    signature: Option<(f64, u64)>,
    keys: Vec<f64>,
}

/// Values after the evaluation of a step. A contact is part x links + lane.
struct StepValues<'a> {
    model: &'a Model,
    state: &'a State,
    scratch: &'a Scratch,
    parts: &'a [Part],
}

impl BreakWatch {
    pub fn new(breakpoint: Breakpoint, model: &Model) -> BreakWatch {
        let parts = Part::of(model);
        // Distinct whole numbers below 2^40, whose sums are exact and, for different sets of lanes, different.
        let key = |i: usize| ((i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 24) as f64;
        let keys = (0..parts.len() * model.chain.padded).map(key).collect();
        BreakWatch { breakpoint, parts, held: Vec::new(), now: Vec::new(), signature: None, keys }
    }

    /// Looks at the step that has just been evaluated: what fulfils the expression and did not a step ago. What fulfils it
    /// when the watch begins is a hit too.
    pub fn look(&mut self, model: &Model, state: &State, scratch: &Scratch, camera: &mut Camera) -> Vec<Hit> {
        if self.breakpoint.uses.impact {
            return Vec::new();
        }
        let values = StepValues { model, state, scratch, parts: &self.parts };
        if self.breakpoint.uses.contact && !self.breakpoint.uses.varying {
            let signature = Some(values.signature(&self.keys));
            if signature == self.signature {
                return Vec::new();
            }
            self.signature = signature;
        }
        self.now.clear();
        if values.may_hold(&self.breakpoint.expr) && !values.holding(&self.breakpoint, &mut self.now) {
            self.now = self.breakpoint.holding(&camera.take(model, state, scratch));
        }
        if self.now.is_empty() && self.held.is_empty() {
            return Vec::new();
        }
        self.now.sort_unstable();
        self.now.dedup();
        let new = self.now.iter().filter(|s| self.held.binary_search(s).is_err());
        let t_s = state.step as f64 * model.step_s;
        let hits = new.map(|s| Hit { step: state.step, t_s, subject: *s, impact: None }).collect();
        std::mem::swap(&mut self.held, &mut self.now);
        hits
    }

    /// Impacts that fulfil the expression.
    pub fn look_at_impacts(
        &mut self,
        impacts: &[Impact],
        over: bool,
        frame: impl FnOnce() -> crate::recording::frame::Frame,
    ) -> Vec<Hit> {
        let uses = self.breakpoint.uses;
        if !uses.impact || uses.impact_over != over || impacts.is_empty() {
            return Vec::new();
        }
        let frame = if uses.frame { frame() } else { crate::recording::frame::Frame::default() };
        let fulfil = impacts.iter().filter(|i| self.breakpoint.impact_holds(i, &frame));
        fulfil
            .map(|i| {
                let subject = Subject::Contact { link: i.link, feature: i.feature, body: i.body };
                Hit { step: i.step, t_s: i.t_s, subject, impact: Some(*i) }
            })
            .collect()
    }
}

/// Lowest and highest of many values, several at a time.
struct Extremes {
    low: [f64; LANES],
    high: [f64; LANES],
}

impl Extremes {
    const NONE: Extremes = Extremes { low: [f64::INFINITY; LANES], high: [f64::NEG_INFINITY; LANES] };

    fn widen(&mut self, value: f64) {
        self.low[0] = self.low[0].min(value);
        self.high[0] = self.high[0].max(value);
    }

    /// Values whose lane has an age; columns are padded to whole blocks.
    fn widen_where(&mut self, values: &[f64], age: &[f64], idle: impl Fn(usize) -> bool) {
        for (block, (v, a)) in values.chunks_exact(LANES).zip(age.chunks_exact(LANES)).enumerate() {
            if idle(block) {
                continue;
            }
            for i in 0..LANES {
                let low = if a[i] > 0.0 { v[i] } else { f64::INFINITY };
                let high = if a[i] > 0.0 { v[i] } else { f64::NEG_INFINITY };
                self.low[i] = if low < self.low[i] { low } else { self.low[i] };
                self.high[i] = if high > self.high[i] { high } else { self.high[i] };
            }
        }
    }

    fn widen_each(&mut self, n: usize, value: impl Fn(usize) -> f64) {
        for at in (0..n).step_by(LANES) {
            if at + LANES > n {
                (at..n).for_each(|i| self.widen(value(i)));
                break;
            }
            for i in 0..LANES {
                let v = value(at + i);
                self.low[i] = if v < self.low[i] { v } else { self.low[i] };
                self.high[i] = if v > self.high[i] { v } else { self.high[i] };
            }
        }
    }

    fn both(&self) -> (f64, f64) {
        let low = self.low.iter().copied().fold(f64::INFINITY, f64::min);
        (low, self.high.iter().copied().fold(f64::NEG_INFINITY, f64::max))
    }
}

impl StepValues<'_> {
    /// A number that changes when another set of lanes touches, or one of them another tooth.
    fn signature(&self, keys: &[f64]) -> (f64, u64) {
        let padded = self.model.chain.padded;
        let mut sums = [0.0; LANES];
        let mut teeth = self.scratch.reseats();
        for (p, part) in self.parts.iter().enumerate() {
            let (age, depth) = (&self.scratch.memory(*part).age, self.scratch.depths(*part));
            let keys = &keys[p * padded..(p + 1) * padded];
            for (block, (a, k)) in age.chunks_exact(LANES).zip(keys.chunks_exact(LANES)).enumerate() {
                if self.scratch.is_idle(*part, block) {
                    continue;
                }
                let d = &depth[block * LANES..(block + 1) * LANES];
                for i in 0..LANES {
                    // A contact may begin and end half a step away from a node; frames show what overlaps at the node.
                    sums[i] += if (a[i] > 0.0) & (d[i] > 0.0) { k[i] } else { 0.0 };
                }
            }
            if let Part::Contours(set) = part {
                for (lane, tooth) in self.scratch.contour_teeth(*set).iter().enumerate() {
                    let own = u64::from(*tooth).wrapping_mul(lane as u64 * 2 + 1);
                    teeth = teeth.wrapping_add(if age[lane] > 0.0 { own } else { 0 });
                }
            }
        }
        (sums.iter().sum(), teeth)
    }

    /// False only where no contact, link or joint can fulfil the expression: from the extremes of whole columns.
    fn may_hold(&self, expr: &Expr) -> bool {
        match expr {
            Expr::Any(parts) => parts.iter().any(|p| self.may_hold(p)),
            Expr::All(parts) => parts.iter().all(|p| self.may_hold(p)),
            Expr::Compare(Compare::Numbers { left, operator, right: Number::Constant(bound) }) => {
                let Number::Quantity { quantity, index: None, absolute: false } = left else { return true };
                let Some((low, high)) = self.extremes(quantity) else { return true };
                let slack = SLACK * (low.abs().max(high.abs()) + bound.abs());
                match operator {
                    Operator::Above | Operator::AtLeast => high + slack >= *bound,
                    Operator::Below | Operator::AtMost => low - slack <= *bound,
                    Operator::Equal | Operator::Unequal => true,
                }
            }
            Expr::Not(_) | Expr::Compare(_) => true,
        }
    }

    /// Lowest and highest value of a quantity over all contacts, links or joints; None: not looked at as a column.
    fn extremes(&self, quantity: &Quantity) -> Option<(f64, f64)> {
        let n = self.model.chain.n_links;
        match (quantity.scope, quantity.what) {
            (Scope::Contact, What::Penetration | What::ApproachSpeed) => {
                let mut all = Extremes::NONE;
                for part in self.parts {
                    let memory = self.scratch.memory(*part);
                    let values =
                        if quantity.what == What::Penetration { self.scratch.depths(*part) } else { &memory.approach };
                    all.widen_where(values, &memory.age, |block| self.scratch.is_idle(*part, block));
                }
                Some(all.both())
            }
            (Scope::Contact, What::NormalForce) => {
                let mut all = Extremes::NONE;
                for part in self.parts {
                    let memory = self.scratch.memory(*part);
                    let ContactLaw::Linear { stiffness_n_per_m: k, damping_n_s_per_m: c } = *self.law(*part)? else {
                        return None;
                    };
                    let (depth, rate) = (self.scratch.depths(*part), self.scratch.closing_speeds(*part));
                    for (block, age) in memory.age.chunks_exact(LANES).enumerate() {
                        if self.scratch.is_idle(*part, block) {
                            continue;
                        }
                        let at = block * LANES;
                        let mut force = [0.0; LANES];
                        for i in 0..LANES {
                            force[i] = k * depth[at + i] + c * rate[at + i];
                        }
                        // Where they only pull a contact shows no force.
                        force.iter_mut().for_each(|f| *f = if *f > 0.0 { *f } else { 0.0 });
                        all.widen_where(&force, age, |_| false);
                    }
                }
                Some(all.both())
            }
            (Scope::Link, What::Tension) => {
                let (x, y) = self.scratch.joint_columns();
                let l = &self.state.links;
                let mut all = Extremes::NONE;
                all.widen_each(n, |i| -0.5 * ((x[i] + x[i + 1]) * l.cos[i] + (y[i] + y[i + 1]) * l.sin[i]));
                Some(all.both())
            }
            (Scope::Joint, What::Force) => {
                let (x, y) = self.scratch.joint_columns();
                let mut all = Extremes::NONE;
                all.widen_each(n, |i| x[i + 1] * x[i + 1] + y[i + 1] * y[i + 1]);
                let (low, high) = all.both();
                Some((libm::sqrt(low), libm::sqrt(high)))
            }
            _ => None,
        }
    }

    /// Collects what fulfils the expression; false where that cannot be told.
    fn holding(&self, breakpoint: &Breakpoint, found: &mut Vec<Subject>) -> bool {
        let (expr, uses) = (&breakpoint.expr, breakpoint.uses);
        let n = self.model.chain.n_links;
        if uses.contact {
            if uses.any_joint {
                return false;
            }
            for (p, part) in self.parts.iter().enumerate() {
                let memory = self.scratch.memory(*part);
                for lane in (0..n).filter(|lane| memory.age[*lane] != 0.0) {
                    let depth = self.scratch.depth(*part, lane);
                    // Overlapping by a rounding error: a frame may show it or not.
                    if depth <= -1e-15 {
                        continue;
                    }
                    let (link, feature) = part.feature(self.model, lane);
                    let bound = Bound { contact: Some(p * n + lane), link: Some(link), ..Bound::default() };
                    match truth(expr, self, &bound) {
                        Some(false) => {}
                        Some(true) if depth > 1e-15 => {
                            let Some((body, _)) = self.scratch.partner(self.model, *part, lane) else { return false };
                            found.push(Subject::Contact {
                                link: link as u32,
                                feature: feature as u32,
                                body: body as u32,
                            });
                        }
                        _ => return false,
                    }
                }
            }
            return true;
        }
        let (count, of_links) = match (uses.any_link, uses.any_joint) {
            (true, true) => return false,
            (true, false) => (n, true),
            (false, true) => (n, false),
            (false, false) => (1, true),
        };
        for i in 0..count {
            let (bound, subject) = match (uses.any_link || uses.any_joint, of_links) {
                (false, _) => (Bound::default(), Subject::Drive),
                (true, true) => (Bound { link: Some(i), ..Bound::default() }, Subject::Link(i as u32)),
                (true, false) => (Bound { joint: Some(i), ..Bound::default() }, Subject::Joint(i as u32)),
            };
            match truth(expr, self, &bound) {
                Some(true) => found.push(subject),
                Some(false) => {}
                None => return false,
            }
        }
        true
    }

    fn tension(&self, i: usize) -> f64 {
        let n = self.model.chain.n_links;
        let (front, rear) = (self.scratch.joint_force(i), self.scratch.joint_force((i + n - 1) % n));
        let l = &self.state.links;
        -0.5 * ((front.0 + rear.0) * l.cos[i] + (front.1 + rear.1) * l.sin[i])
    }

    fn joint_force(&self, j: usize) -> f64 {
        let (x, y, _) = self.scratch.joint_force(j);
        libm::sqrt(x * x + y * y)
    }

    /// Of everything that a part can touch: a drive has one law per kind of contact.
    fn law(&self, part: Part) -> Option<&ContactLaw> {
        match part {
            Part::Bushes => self.model.sprockets.first().map(|s| &s.body.law),
            Part::Guides(_) => self.model.guides.first().map(|g| &g.body.law),
            Part::Contours(set) => self.model.end_bodies.iter().find(|b| b.set == set / 2).map(|b| &b.law),
        }
    }

    /// None: the law needs the radius of what is touched.
    fn normal_force(&self, part: Part, lane: usize) -> Option<f64> {
        let law = self.law(part)?;
        if matches!(law, ContactLaw::HertzLine(_)) {
            return None;
        }
        let approach = self.scratch.memory(part).approach[lane];
        let (depth, rate) = (self.scratch.depth(part, lane), self.scratch.closing_speed(part, lane));
        Some(law.force(depth, rate, approach, PairRadii { bush_m: f64::NAN, body_m: f64::NAN }))
    }

    fn contact(&self, what: What, contact: usize) -> Option<f64> {
        let n = self.model.chain.n_links;
        let (part, lane) = (self.parts[contact / n], contact % n);
        let memory = self.scratch.memory(part);
        match what {
            What::Penetration => Some(self.scratch.depth(part, lane)),
            What::NormalForce => self.normal_force(part, lane),
            What::ApproachSpeed => Some(memory.approach[lane]),
            What::NormalSpeed => Some(self.scratch.closing_speed(part, lane)),
            What::Age => Some(memory.age[lane] * self.model.step_s),
            What::Link => Some(part.feature(self.model, lane).0 as f64),
            What::Tooth => self.scratch.partner(self.model, part, lane).map(|(_, tooth)| f64::from(tooth)),
            _ => None,
        }
    }

    fn link(&self, what: What, i: usize) -> Option<f64> {
        let (l, s, half) = (&self.state.links, self.scratch, 0.5 * self.model.step_s);
        match what {
            What::Tension => Some(self.tension(i)),
            What::Speed => Some(libm::hypot(l.vx[i] + half * s.ax[i], l.vy[i] + half * s.ay[i])),
            What::VelocityX => Some(l.vx[i] + half * s.ax[i]),
            What::VelocityY => Some(l.vy[i] + half * s.ay[i]),
            What::Omega => Some(l.omega[i] + half * s.alpha[i]),
            What::X => Some(l.x[i]),
            What::Y => Some(l.y[i]),
            What::Angle => Some(crate::units::atan2(l.sin[i], l.cos[i])),
            What::Link => Some(i as f64),
            _ => None,
        }
    }
}

impl Values for StepValues<'_> {
    fn number(&self, quantity: &Quantity, index: Option<usize>, bound: &Bound<'_>) -> Option<f64> {
        match quantity.scope {
            Scope::Contact => self.contact(quantity.what, bound.contact?),
            Scope::Link => self.link(quantity.what, index.or(bound.link)?),
            Scope::Joint => {
                let j = index.or(bound.joint)?;
                match quantity.what {
                    What::Force => Some(self.joint_force(j)),
                    _ => Some(self.scratch.joint_force(j).2),
                }
            }
            Scope::Sprocket => {
                let k = index?;
                match quantity.what {
                    What::Speed => {
                        Some(self.state.rotors.omega[k] + 0.5 * self.model.step_s * self.scratch.rotor_alpha[k])
                    }
                    What::Angle => Some(self.state.rotors.angle[k]),
                    // Frames add up the forces of the node, steps their means.
                    _ => None,
                }
            }
            Scope::Run => Some(match quantity.what {
                What::Time => self.state.step as f64 * self.model.step_s,
                What::Step => self.state.step as f64,
                _ => {
                    let driver = self.model.sprockets.get(self.model.driver)?;
                    driver.nominal_speed_rad_s * self.state.step as f64 * self.model.step_s
                }
            }),
            Scope::Impact | Scope::Energy => None,
        }
    }

    fn name(&self, what: What, bound: &Bound<'_>) -> Option<u32> {
        let n = self.model.chain.n_links;
        let contact = bound.contact?;
        let (part, lane) = (self.parts[contact / n], contact % n);
        match what {
            What::Body => self.scratch.partner(self.model, part, lane).map(|(body, _)| body as u32),
            What::Feature => Some(part.feature(self.model, lane).1 as u32),
            _ => None,
        }
    }

    fn slack(&self) -> f64 {
        SLACK
    }
}
