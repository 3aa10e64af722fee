//! Values of a step's own columns, for breakpoints: what the step has computed anyway.

use super::ledger::{Ledger, blocks_of};
use super::quantities::{Quantity, Scope, What};
use super::{Bound, Breakpoint, Compare, Expr, Hit, Number, Operator, SLACK, Subject, Values, energy_number, truth};
use crate::elements::contact_law::{ContactLaw, PairRadii};
use crate::elements::tooth_contact::{Column, LANES};
use crate::integrate::explicit::{Part, Scratch};
use crate::integrate::{Look, vectorised};
use crate::model::Model;
use crate::recording::capture::Camera;
use crate::recording::frame::{Energy, Impact};
use crate::state::State;

/// A breakpoint and what fulfilled it a step ago.
pub struct BreakWatch {
    pub breakpoint: Breakpoint,
    /// True: what fulfils the expression at the first look is no hit, so that a run goes on where it has stopped.
    pub goes_on: bool,
    parts: Vec<Part>,
    held: Vec<Subject>,
    now: Vec<Subject>,
    /// Who touched which tooth a step ago, and a number for every lane to tell by.
    signature: Option<(f64, u64)>,
    keys: Vec<f64>,
    ledger: Ledger,
}

/// Values after the evaluation of a step. A contact is part x links + lane.
struct StepValues<'a> {
    model: &'a Model,
    state: &'a State,
    scratch: &'a Scratch,
    parts: &'a [Part],
    /// And how uncertain they are [J]; where the expression asks for them.
    energy: Option<(Energy, f64)>,
}

impl BreakWatch {
    pub fn new(breakpoint: Breakpoint, model: &Model) -> BreakWatch {
        // Parts that can touch nothing the expression asks for are never looked at.
        let parts: Vec<Part> =
            Part::of(model).into_iter().filter(|p| may_concern(&breakpoint.expr, *p, model)).collect();
        // Distinct whole numbers below 2^40: their sums are exact, and those of sets that follow each other practically never
        // equal.
        let key = |i: usize| ((i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 24) as f64;
        let keys = (0..parts.len() * model.chain.padded).map(key).collect();
        BreakWatch {
            breakpoint,
            goes_on: false,
            parts,
            held: Vec::new(),
            now: Vec::new(),
            signature: None,
            keys,
            ledger: Ledger::new(model),
        }
    }

    /// Looks at the step that has just been evaluated: what fulfils the expression and did not a step ago. What fulfils it
    /// when the watch begins is a hit too, unless the run goes on.
    pub fn look(&mut self, model: &Model, state: &State, scratch: &Scratch, camera: &mut Camera) -> Vec<Hit> {
        if self.breakpoint.uses.impact {
            return Vec::new();
        }
        let energy = match camera.origin() {
            Some(origin) if self.breakpoint.uses.energy => self.ledger.look((model, state, scratch), origin),
            _ => None,
        };
        let values = StepValues { model, state, scratch, parts: &self.parts, energy };
        if self.breakpoint.uses.contact && !self.breakpoint.uses.varying {
            let signature = Some(vectorised(scratch.isa, Signature(&values, &self.keys)));
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
            self.goes_on = false;
            return Vec::new();
        }
        self.now.sort_unstable();
        self.now.dedup();
        let new = self.now.iter().filter(|s| self.held.binary_search(s).is_err());
        let t_s = state.step as f64 * model.step_s;
        let hits: Vec<Hit> = new.map(|s| Hit { step: state.step, t_s, subject: *s, impact: None }).collect();
        std::mem::swap(&mut self.held, &mut self.now);
        if std::mem::take(&mut self.goes_on) { Vec::new() } else { hits }
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

/// Whether a contact of this part can be on the bodies, and with the features, that an expression names.
fn may_concern(expr: &Expr, part: Part, model: &Model) -> bool {
    match expr {
        Expr::Any(parts) => parts.iter().any(|e| may_concern(e, part, model)),
        Expr::All(parts) => parts.iter().all(|e| may_concern(e, part, model)),
        Expr::Compare(Compare::Name { quantity, set, member: true }) if quantity.scope == Scope::Contact => {
            match quantity.what {
                What::Body => set.iter().any(|body| part.touches(model, *body as usize)),
                What::Feature => {
                    let n = model.chain.n_links;
                    (0..n).any(|lane| set.contains(&(part.feature(model, lane).1 as u32)))
                }
                _ => true,
            }
        }
        Expr::Not(_) | Expr::Compare(_) => true,
    }
}

/// Looks for values on the far side of a bound, a block at a time and without a branch.
#[derive(Clone, Copy)]
struct Beyond {
    /// 1: at or above; -1: at or below.
    sign: f64,
    threshold: f64,
}

impl Beyond {
    /// Nearer than rounding counts as beyond.
    fn new(sign: f64, bound: f64) -> Beyond {
        Beyond { sign, threshold: sign * bound - 2.0 * SLACK * bound.abs() }
    }

    /// Counts in `found`, lane by lane: sums of ones vectorise where a reduction to one bit does not.
    #[inline(always)]
    fn count(self, values: &Column, found: &mut Column) {
        for i in 0..LANES {
            found[i] += if self.sign * values[i] >= self.threshold { 1.0 } else { 0.0 };
        }
    }

    /// Among lanes with an age.
    #[inline(always)]
    fn count_where(self, values: &Column, age: &Column, found: &mut Column) {
        for i in 0..LANES {
            let touching = if age[i] > 0.0 { 1.0 } else { 0.0 };
            found[i] += if self.sign * values[i] >= self.threshold { touching } else { 0.0 };
        }
    }

    /// For squares of what is never negative; None where the bound is.
    fn squared(self) -> Option<Beyond> {
        let bound = self.sign * self.threshold;
        (bound >= 0.0).then_some(Beyond { threshold: self.sign * bound * bound, ..self })
    }

    /// 1 or 0.
    #[inline(always)]
    fn one(self, value: f64) -> f64 {
        if self.sign * value >= self.threshold { 1.0 } else { 0.0 }
    }
}

/// [`StepValues::signature`] with its keys.
struct Signature<'a>(&'a StepValues<'a>, &'a [f64]);

impl Look for Signature<'_> {
    type Seen = (f64, u64);

    #[inline(always)]
    fn look(self) -> (f64, u64) {
        self.0.signature(self.1)
    }
}

/// [`StepValues::reaches`] of a quantity.
struct Reach<'a>(&'a StepValues<'a>, &'a Quantity, Beyond);

impl Look for Reach<'_> {
    type Seen = Option<Column>;

    #[inline(always)]
    fn look(self) -> Option<Column> {
        self.0.reaches(self.1, self.2)
    }
}

impl StepValues<'_> {
    /// A number that changes when another set of lanes touches, or one of them another tooth.
    #[inline(always)]
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
                let sign = match operator {
                    Operator::Above | Operator::AtLeast => 1.0,
                    Operator::Below | Operator::AtMost => -1.0,
                    Operator::Equal | Operator::Unequal => return true,
                };
                if quantity.scope == Scope::Energy {
                    let value = self.energy.as_ref().map(|(e, _)| energy_number(quantity.what, e));
                    let unsure = self.blur(quantity) + 2.0 * SLACK * bound.abs();
                    return value.is_none_or(|v| sign * (v - bound) >= -unsure);
                }
                let beyond = Beyond::new(sign, *bound);
                vectorised(self.scratch.isa, Reach(self, quantity, beyond))
                    .is_none_or(|found| found.iter().any(|n| *n > 0.0))
            }
            Expr::Not(_) | Expr::Compare(_) => true,
        }
    }

    /// How often, lane by lane, a quantity of any contact, link or joint is beyond a bound; None: not looked at as a column.
    #[inline(always)]
    fn reaches(&self, quantity: &Quantity, beyond: Beyond) -> Option<Column> {
        let mut found = [0.0; LANES];
        let n = self.model.chain.n_links;
        let whole = n / LANES;
        match (quantity.scope, quantity.what) {
            (Scope::Contact, What::Penetration | What::ApproachSpeed | What::NormalForce) => {
                for part in self.parts {
                    self.contacts_reach(*part, quantity.what, beyond, &mut found)?;
                }
            }
            (Scope::Link, What::Tension) => {
                let (x, y) = self.scratch.joint_columns();
                let l = &self.state.links;
                let [x0, x1, y0, y1] = [x, &x[1..], y, &y[1..]];
                let (x0, x1, y0, y1) =
                    (blocks_of(x0, whole), blocks_of(x1, whole), blocks_of(y0, whole), blocks_of(y1, whole));
                let (cos, sin) = (blocks_of(&l.cos, whole), blocks_of(&l.sin, whole));
                for b in 0..whole {
                    let mut pull = [0.0; LANES];
                    for k in 0..LANES {
                        pull[k] = -0.5 * ((x0[b][k] + x1[b][k]) * cos[b][k] + (y0[b][k] + y1[b][k]) * sin[b][k]);
                    }
                    beyond.count(&pull, &mut found);
                }
                for i in whole * LANES..n {
                    found[0] += beyond.one(self.tension(i));
                }
            }
            (Scope::Joint, What::Force) => {
                let beyond = beyond.squared()?;
                let (x, y) = self.scratch.joint_columns();
                let (x, y) = (&x[1..], &y[1..]);
                let (bx, by) = (blocks_of(x, whole), blocks_of(y, whole));
                for b in 0..whole {
                    let mut square = [0.0; LANES];
                    for k in 0..LANES {
                        square[k] = bx[b][k] * bx[b][k] + by[b][k] * by[b][k];
                    }
                    beyond.count(&square, &mut found);
                }
                for i in whole * LANES..n {
                    found[0] += beyond.one(x[i] * x[i] + y[i] * y[i]);
                }
            }
            _ => return None,
        }
        Some(found)
    }

    /// None: the law of this part needs more than depth and speed.
    #[inline(always)]
    fn contacts_reach(&self, part: Part, what: What, beyond: Beyond, found: &mut Column) -> Option<()> {
        let memory = self.scratch.memory(part);
        let law = match (what, self.law(part)?) {
            (What::NormalForce, ContactLaw::Linear { stiffness_n_per_m, damping_n_s_per_m }) => {
                Some((*stiffness_n_per_m, *damping_n_s_per_m))
            }
            (What::NormalForce, _) => return None,
            _ => None,
        };
        let (depth, rate) = (self.scratch.depths(part), self.scratch.closing_speeds(part));
        let values = if what == What::ApproachSpeed { &memory.approach } else { depth };
        let columns = memory.age.as_chunks::<LANES>().0.iter().zip(values.as_chunks::<LANES>().0);
        for (block, ((age, values), rate)) in columns.zip(rate.as_chunks::<LANES>().0).enumerate() {
            if self.scratch.is_idle(part, block) {
                continue;
            }
            let Some((k, c)) = law else {
                beyond.count_where(values, age, found);
                continue;
            };
            let mut force = [0.0; LANES];
            for i in 0..LANES {
                // Where it only pulls a contact shows no force.
                let f = k * values[i] + c * rate[i];
                force[i] = if f > 0.0 { f } else { 0.0 };
            }
            beyond.count_where(&force, age, found);
        }
        Some(())
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
            Scope::Energy => self.energy.as_ref().map(|(e, _)| energy_number(quantity.what, e)),
            Scope::Impact => None,
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

    fn blur(&self, quantity: &Quantity) -> f64 {
        let Some((energy, blur_j)) = self.energy.as_ref().filter(|_| quantity.scope == Scope::Energy) else {
            return 0.0;
        };
        match quantity.what {
            // A share of next to nothing may be anything.
            What::Error if energy.work_in_j.abs() < 2.0 * blur_j => f64::INFINITY,
            What::Error => {
                2.0 * blur_j * (1.0 + energy.error_j.abs() / energy.work_in_j.abs()) / energy.work_in_j.abs()
            }
            _ => *blur_j,
        }
    }
}
