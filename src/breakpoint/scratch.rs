//! Values for breakpoints from the columns of a step, which the step has computed anyway.

use super::columns::{ColumnSearch, ThresholdBand, rounding};
use super::extremes::{self, Compared, EnergyRangeTest, RangeTest};
use super::ledger::Ledger;
use super::quantities::{Quantity, Scope, What};
use super::{BoundRows, Breakpoint, Compare, Expr, Hit, QuantityValues, Subject, energy_number, tension_n, truth};
use crate::integrate::explicit::{ContactGroup, ContactGroups, RequiredData, Scratch, shafts, touches};
use crate::integrate::vectorised;
use crate::model::Model;
use crate::recording::capture::Camera;
use crate::recording::frame::{Energy, Impact};
use crate::state::State;

/// A breakpoint and the objects that fulfilled it in the previous step.
pub struct BreakWatch {
    pub breakpoint: Breakpoint,
    /// True: objects that fulfil the expression in the first step are no hits, so that a stopped run can continue.
    pub continues_run: bool,
    parts: Vec<ContactGroup>,
    set: ContactGroups,
    previous: Vec<Subject>,
    now: Vec<Subject>,
    /// Signature of the contacts and their teeth in the previous step.
    signature: Option<(f64, u64)>,
    ledger: Ledger,
    /// Necessary comparisons that are cheap to test. One that is impossible decides the whole expression.
    quick: Vec<RangeTest>,
    quick_energies: Vec<EnergyRangeTest>,
}

/// Values after the evaluation of a step. The index of a contact is group x links + lane.
pub(super) struct StepValues<'a> {
    pub(super) model: &'a Model,
    pub(super) state: &'a State,
    pub(super) scratch: &'a Scratch,
    /// Contact groups that the expression may refer to.
    pub(super) parts: &'a [ContactGroup],
    set: ContactGroups,
    /// Energies and their uncertainty [J], if the expression needs them.
    energy: Option<&'a (Energy, f64)>,
}

impl BreakWatch {
    pub fn new(breakpoint: Breakpoint, model: &Model) -> BreakWatch {
        // Contact groups that cannot fulfil the expression are never examined.
        let may_concern = |p: &ContactGroup| may_concern(&breakpoint.expr, *p, model);
        let parts: Vec<ContactGroup> = ContactGroup::in_model(model).into_iter().filter(may_concern).collect();
        let set = parts.iter().copied().collect();
        let quick = RangeTest::needed_by(&breakpoint.expr, set, model.step_s);
        let quick_energies = EnergyRangeTest::needed_by(&breakpoint.expr);
        BreakWatch {
            breakpoint,
            continues_run: false,
            set,
            parts,
            previous: Vec::new(),
            now: Vec::new(),
            signature: None,
            ledger: Ledger::new(model),
            quick_energies,
            quick,
        }
    }

    /// Data that a step has to keep for this breakpoint.
    pub fn required_data(&self) -> RequiredData {
        let uses = self.breakpoint.uses;
        let mut wanted = RequiredData { segments: uses.segments, ..RequiredData::default() };
        extremes::collect_extremes(&self.breakpoint.expr, self.set, &mut wanted.extremes);
        if uses.contact && !uses.varying {
            wanted.sets.push(self.set);
        }
        wanted
    }

    /// Evaluates the breakpoint after a step: adds to `hits` the objects that fulfil the expression and did not in the
    /// previous step. Objects that fulfil it at the start of the run are hits too, unless the run continues another.
    pub fn evaluate(
        &mut self,
        model: &Model,
        state: &State,
        scratch: &Scratch,
        camera: &mut Camera,
        hits: &mut Vec<Hit>,
    ) {
        if self.breakpoint.uses.impact {
            return;
        }
        if self.previous.is_empty() && self.quick.iter().any(|q| q.is_impossible(scratch)) {
            self.continues_run = false;
            return;
        }
        let energy = match camera.origin() {
            Some(origin) if self.breakpoint.uses.energy => self.ledger.update((model, state, scratch), origin),
            _ => None,
        };
        if self.previous.is_empty() && energy.is_some_and(|e| self.quick_energies.iter().any(|q| q.is_impossible(e))) {
            self.continues_run = false;
            return;
        }
        let uses = self.breakpoint.uses;
        let values = StepValues { model, state, scratch, parts: &self.parts, set: self.set, energy };
        if uses.contact && !uses.varying {
            let signature = values.signature();
            if signature.is_some() && signature == self.signature {
                return;
            }
            self.signature = signature;
        }
        self.now.clear();
        // An expression without contacts and without unindexed links or joints is evaluated directly.
        let one = !(uses.contact || uses.any_link || uses.any_joint);
        let known = !(one || values.may_hold(&self.breakpoint.expr)) || values.holding(&self.breakpoint, &mut self.now);
        if !known {
            self.now = self.breakpoint.holding(&camera.take(model, state, scratch));
        }
        if self.now.is_empty() && self.previous.is_empty() {
            self.continues_run = false;
            return;
        }
        self.now.sort_unstable();
        self.now.dedup();
        let new = self.now.iter().filter(|s| self.previous.binary_search(s).is_err());
        let t_s = state.step as f64 * model.step_s;
        if !std::mem::take(&mut self.continues_run) {
            hits.extend(new.map(|s| Hit { step: state.step, t_s, subject: *s, impact: None }));
        }
        std::mem::swap(&mut self.previous, &mut self.now);
    }

    /// Hits of impacts that fulfil the expression.
    pub fn evaluate_impacts(
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

/// Whether a contact of this group can involve the bodies and features that an expression names.
fn may_concern(expr: &Expr, part: ContactGroup, model: &Model) -> bool {
    match expr {
        Expr::Any(parts) => parts.iter().any(|e| may_concern(e, part, model)),
        Expr::All(parts) => parts.iter().all(|e| may_concern(e, part, model)),
        Expr::Compare(Compare::Name { quantity, set, member: true }) if quantity.scope == Scope::Contact => {
            match quantity.what {
                What::Body => set.iter().any(|body| part.touches(model, *body as usize)),
                What::Feature => model.chain.bodies().any(|lane| set.contains(&(part.feature(model, lane).1 as u32))),
                _ => true,
            }
        }
        Expr::Not(_) | Expr::Compare(_) => true,
    }
}

impl StepValues<'_> {
    /// Speed of a coordinate at the node [rad/s].
    fn coordinate_speed(&self, k: usize) -> f64 {
        self.state.coordinates.omega[k] + 0.5 * self.model.step_s * self.scratch.coordinate_alpha[k]
    }

    /// Changes when the set of lanes in contact changes, or when one of them touches another tooth.
    fn signature(&self) -> Option<(f64, u64)> {
        let mut teeth = self.scratch.partner_changes();
        for part in self.parts {
            let ContactGroup::Contours(set) = part else { continue };
            let age = &self.scratch.memory(*part).age;
            for (lane, tooth) in self.scratch.contour_teeth(*set).iter().enumerate() {
                let own = (*tooth as u64).wrapping_mul(lane as u64 * 2 + 1);
                teeth = teeth.wrapping_add(if age[lane] > 0.0 { own } else { 0 });
            }
        }
        Some((self.scratch.set(self.set)?, teeth))
    }

    /// False only if no contact, link or joint can fulfil the expression, according to the extremes of whole columns.
    fn may_hold(&self, expr: &Expr) -> bool {
        match expr {
            Expr::Any(parts) => parts.iter().any(|p| self.may_hold(p)),
            Expr::All(parts) => parts.iter().all(|p| self.may_hold(p)),
            Expr::Compare(compare) => {
                // One link, joint or sprocket, two quantities, or names: evaluated one by one.
                let Some(compared) = Compared::from_compare(compare) else { return true };
                let Compared { quantity, absolute, operator, bound } = compared;
                let Some(band) = ThresholdBand::new(operator, bound, absolute, rounding(quantity)) else { return true };
                if quantity.scope == Scope::Contact {
                    let quick = RangeTest::new(&compared, self.set, self.model.step_s);
                    if quick.is_some_and(|q| q.is_impossible(self.scratch)) {
                        return false;
                    }
                }
                vectorised(self.scratch.isa, ColumnSearch(self, quantity, band))
                    .is_none_or(|found| found.iter().any(|n| *n > 0.0))
            }
            Expr::Not(_) => true,
        }
    }

    /// Collects the objects that fulfil the expression; false if the step's columns do not decide it.
    fn holding(&self, breakpoint: &Breakpoint, found: &mut Vec<Subject>) -> bool {
        let (expr, uses) = (&breakpoint.expr, breakpoint.uses);
        let (chain, n) = (&self.model.chain, self.model.chain.lanes);
        if uses.contact {
            if uses.any_joint {
                return false;
            }
            for (p, part) in self.parts.iter().enumerate() {
                let memory = self.scratch.memory(*part);
                let own = chain.loops.iter().chain(&chain.rollers);
                let ages = own.flat_map(|own| own.clone().zip(&memory.age[own.clone()]));
                for (lane, _) in ages.filter(|(_, age)| **age != 0.0) {
                    if !self.scratch.is_contact(*part, lane) {
                        continue;
                    }
                    let (link, feature) = part.feature(self.model, lane);
                    let bound = BoundRows { contact: Some(p * n + lane), link: Some(link), ..BoundRows::default() };
                    match truth(expr, self, &bound) {
                        Some(false) => {}
                        Some(true) => {
                            let Some((body, _)) = self.scratch.partner(self.model, *part, lane) else { return false };
                            found.push(Subject::Contact {
                                link: chain.number_of(link) as u32,
                                feature: feature as u32,
                                body: body as u32,
                            });
                        }
                        None => return false,
                    }
                }
            }
            return true;
        }
        let (count, of_links) = match (uses.any_link, uses.any_joint) {
            (true, true) => return false,
            (true, false) => (chain.n_links, true),
            (false, true) => (chain.n_links, false),
            (false, false) => (1, true),
        };
        for i in 0..count {
            let lane = chain.lane_of(i);
            let (bound, subject) = match (uses.any_link || uses.any_joint, of_links) {
                (false, _) => (BoundRows::default(), Subject::Drive),
                (true, true) => (BoundRows { link: Some(lane), ..BoundRows::default() }, Subject::Link(i as u32)),
                (true, false) => (BoundRows { joint: Some(lane), ..BoundRows::default() }, Subject::Joint(i as u32)),
            };
            match truth(expr, self, &bound) {
                Some(true) => found.push(subject),
                Some(false) => {}
                None => return false,
            }
        }
        true
    }

    fn angle(&self, i: usize) -> f64 {
        let l = &self.state.links;
        crate::units::direction(l.sin[i], l.cos[i])
    }

    fn tension(&self, i: usize) -> f64 {
        let rear = self.model.chain.previous(i);
        let (front, rear) = (self.scratch.joint_force(i), self.scratch.joint_force(rear));
        tension_n(self.angle(i), (front.0, front.1), (rear.0, rear.1))
    }

    fn contact(&self, what: What, contact: usize) -> Option<f64> {
        let n = self.model.chain.lanes;
        let (part, lane) = (self.parts[contact / n], contact % n);
        let memory = self.scratch.memory(part);
        match what {
            What::Penetration => Some(self.scratch.depth(part, lane)),
            What::NormalForce => Some(memory.normal_force[lane]),
            What::ApproachSpeed => Some(memory.approach[lane]),
            What::NormalSpeed => Some(self.scratch.closing_speed(part, lane)),
            What::Age => Some(memory.age[lane] * self.model.step_s),
            What::TangentialSpeed => Some(self.scratch.sliding_speeds(part)[lane]),
            What::TangentialForce => Some(memory.tangential_force[lane]),
            What::Stick => {
                let stick = self.scratch.sticks(self.model, part, lane)?;
                Some(f64::from(u8::from(stick)))
            }
            What::Link => Some(self.model.chain.number_of(part.feature(self.model, lane).0) as f64),
            What::Tooth => self.scratch.partner(self.model, part, lane).map(|(_, tooth)| f64::from(tooth)),
            _ => None,
        }
    }

    /// A quantity of the slider or ball in this row of `sliders`.
    fn slider(&self, what: What, row: usize) -> Option<f64> {
        let k = self.model.n_turning() + row;
        let forces = || touches::sliding_forces(self.model, self.state, self.scratch, k);
        match what {
            What::Position => self.state.coordinates.angle.get(k).copied(),
            What::Speed => Some(self.coordinate_speed(k)),
            What::SpringForce => Some(forces().spring_n),
            What::OilForce => Some(forces().oil_n),
            What::TouchForce => Some(forces().touch_n),
            _ => None,
        }
    }

    fn touch(&self, what: What, row: usize) -> Option<f64> {
        let now = self.scratch.touches();
        match what {
            What::Gap => Some(self.model.touches.get(row)?.shape.gap(&self.state.coordinates.angle).gap_m),
            What::NormalForce => now.normal_force.get(row).copied(),
            What::TangentialForce => now.tangential_force.get(row).copied(),
            What::ApproachSpeed => now.approach.get(row).copied(),
            What::Age => now.age.get(row).map(|steps| steps * self.model.step_s),
            _ => None,
        }
    }

    /// A quantity of the span in this row of `spans`.
    fn span(&self, what: What, row: usize) -> Option<f64> {
        let now = shafts::span_at(self.model, self.state, self.model.spans.get(row)?);
        match what {
            What::Tension => Some(now.tension_n),
            What::Elongation => Some(now.elongation_m),
            What::Power => Some(now.power_w),
            _ => None,
        }
    }

    /// A quantity of the chamber or reservoir in this row of `chambers`, or of the passage in this row of `passages`.
    fn oil(&self, what: What, row: usize) -> Option<f64> {
        let oil = self.model.oil.as_ref()?;
        let (q, state) = (&self.state.coordinates.angle, &self.state.oil);
        let flow = |e: usize| oil.flow_m3_s(e, q, &|k| self.coordinate_speed(k), state);
        let end = oil.ends().nth(row);
        match what {
            What::Pressure => Some(oil.pressure_pa(end?, &state.pressure_pa)),
            What::Volume => Some(if row < oil.chambers.len() { oil.volume_m3(row, q) } else { 0.0 }),
            What::Inflow => Some(oil.inflow_m3_s(end?, flow)),
            What::Flow => Some(flow(row)),
            What::PressureDrop => Some(oil.drop_pa(oil.passages.get(row)?, &state.pressure_pa)),
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
            What::Angle => Some(self.angle(i)),
            What::Link => Some(self.model.chain.number_of(i) as f64),
            _ => None,
        }
    }
}

impl QuantityValues for StepValues<'_> {
    fn number(&self, quantity: &Quantity, index: Option<usize>, bound: &BoundRows<'_>) -> Option<f64> {
        match quantity.scope {
            Scope::Contact => self.contact(quantity.what, bound.contact?),
            Scope::Link => self.link(quantity.what, index.map(|i| self.model.chain.lane_of(i)).or(bound.link)?),
            Scope::Joint => {
                let j = index.map(|i| self.model.chain.lane_of(i)).or(bound.joint)?;
                match quantity.what {
                    What::Force => {
                        let (x, y, _) = self.scratch.joint_force(j);
                        Some(libm::hypot(x, y))
                    }
                    _ => Some(self.scratch.joint_force(j).2),
                }
            }
            Scope::Slider | Scope::Ball => self.slider(quantity.what, index?),
            Scope::Touch => self.touch(quantity.what, index?),
            Scope::Chamber | Scope::Reservoir | Scope::Passage => self.oil(quantity.what, index?),
            Scope::Span => self.span(quantity.what, index?),
            Scope::Sprocket | Scope::Shaft | Scope::Arm => {
                let k = index?;
                let coordinate = self.model.coordinates.get(k)?;
                match quantity.what {
                    What::Speed => Some(self.coordinate_speed(k)),
                    What::Angle => Some(self.state.coordinates.angle[k]),
                    what => {
                        let torque = *self.scratch.chain_torque().get(k)?;
                        if what == What::Torque {
                            return Some(torque);
                        }
                        let (angle, speed) = (self.state.coordinates.angle[k], self.coordinate_speed(k));
                        Some(coordinate.outer_force(angle, speed, torque, self.scratch.parts_force()[k]))
                    }
                }
            }
            Scope::Run => Some(match quantity.what {
                What::Time => self.state.step as f64 * self.model.step_s,
                What::Step => self.state.step as f64,
                _ => self.model.crank_angle_rad(self.state.step),
            }),
            Scope::Energy => self.energy.map(|(e, _)| energy_number(quantity.what, e)),
            Scope::Impact => None,
        }
    }

    fn name(&self, what: What, bound: &BoundRows<'_>) -> Option<u32> {
        let n = self.model.chain.lanes;
        let contact = bound.contact?;
        let (part, lane) = (self.parts[contact / n], contact % n);
        match what {
            What::Body => self.scratch.partner(self.model, part, lane).map(|(body, _)| body as u32),
            What::Feature => Some(part.feature(self.model, lane).1 as u32),
            What::Segment => self.scratch.segments(part).map(|segments| segments[lane] as u32),
            _ => None,
        }
    }

    /// Energies are summed in another order than those of frames.
    fn uncertainty(&self, quantity: &Quantity) -> f64 {
        let energy = self.energy.filter(|_| quantity.scope == Scope::Energy);
        energy.map_or(0.0, |energy| extremes::energy_uncertainty(quantity.what, energy))
    }
}
