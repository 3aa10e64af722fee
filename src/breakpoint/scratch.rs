//! Values of a step's own columns, for breakpoints: what the step has computed anyway.

use super::columns::{Band, ChainTorques, FORCE_BLUR, Pairing, Reach, SPEED_BLUR_M_S, Torques};
use super::extremes::{self, Compared, Quick, QuickEnergy};
use super::ledger::Ledger;
use super::quantities::{Quantity, Scope, What};
use super::{Bound, Breakpoint, Compare, Expr, Hit, SLACK, Subject, Values, energy_number, truth};
use crate::elements::contact_law::ContactLaw;
use crate::elements::rotor::Rotor;
use crate::integrate::explicit::{Part, Parts, Scratch, Wanted};
use crate::integrate::vectorised;
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
    set: Parts,
    all_parts: Vec<Part>,
    /// Of all parts.
    pairings: Vec<Option<Pairing>>,
    held: Vec<Subject>,
    now: Vec<Subject>,
    /// Who touched which tooth a step ago.
    signature: Option<(f64, u64)>,
    ledger: Ledger,
    /// Any of these that cannot be settles the whole: in a few instructions.
    quick: Vec<Quick>,
    quick_energies: Vec<QuickEnergy>,
    /// Before this step contacts are looked at one by one: not long ago their extremes did not settle it.
    close_until: u64,
}

/// Steps for which a step keeps what touches where, once that was asked for.
const CLOSE_STEPS: u64 = 256;

/// Values after the evaluation of a step. A contact is part x links + lane.
pub(super) struct StepValues<'a> {
    pub(super) model: &'a Model,
    pub(super) state: &'a State,
    pub(super) scratch: &'a Scratch,
    /// Those that the expression may concern, and all.
    pub(super) parts: &'a [Part],
    set: Parts,
    pub(super) all_parts: &'a [Part],
    pub(super) pairings: &'a [Option<Pairing>],
    /// And how uncertain they are [J]; where the expression asks for them.
    energy: Option<&'a (Energy, f64)>,
    /// Where the expression asks for them.
    torques: Option<ChainTorques>,
}

impl BreakWatch {
    pub fn new(breakpoint: Breakpoint, model: &Model) -> BreakWatch {
        // Parts that can touch nothing the expression asks for are never looked at.
        let all_parts = Part::of(model);
        let may_concern = |p: &Part| may_concern(&breakpoint.expr, *p, model);
        let parts: Vec<Part> = all_parts.iter().copied().filter(may_concern).collect();
        let set = parts.iter().copied().collect();
        let quick = Quick::needed_by(&breakpoint.expr, set, model.step_s);
        let quick_energies = QuickEnergy::needed_by(&breakpoint.expr);
        BreakWatch {
            breakpoint,
            goes_on: false,
            set,
            parts,
            pairings: all_parts.iter().map(|p| Pairing::one(model, *p)).collect(),
            all_parts,
            held: Vec::new(),
            now: Vec::new(),
            signature: None,
            ledger: Ledger::new(model),
            quick_energies,
            quick,
            close_until: 0,
        }
    }

    /// Whether [`BreakWatch::wants`] asks at this step for what touches where, because extremes do not settle the expression.
    pub fn is_close(&self, step: u64) -> bool {
        step < self.close_until
    }

    /// What a step has to keep for this.
    pub fn wants(&self, model: &Model, step: u64) -> Wanted {
        let uses = self.breakpoint.uses;
        let hertz = |law: &ContactLaw| matches!(law, ContactLaw::HertzLine(_));
        let laws = model.sprockets.iter().map(|s| &s.body.law).chain(model.guides.iter().map(|g| &g.body.law));
        let hertz = uses.contact && laws.chain(model.end_bodies.iter().map(|b| &b.law)).any(hertz);
        let touches = hertz || uses.touches && self.is_close(step);
        let mut wanted = Wanted { touches, segments: uses.segments, torques: uses.torque, ..Wanted::default() };
        extremes::of_expression(&self.breakpoint.expr, self.set, &mut wanted.extremes);
        if uses.contact && !uses.varying {
            wanted.sets.push(self.set);
        }
        wanted
    }

    /// Looks at the step that has just been evaluated: adds to `hits` what fulfils the expression and did not a step ago. What
    /// fulfils it when the watch begins is a hit too, unless the run goes on.
    pub fn look(&mut self, model: &Model, state: &State, scratch: &Scratch, camera: &mut Camera, hits: &mut Vec<Hit>) {
        if self.breakpoint.uses.impact {
            return;
        }
        if self.held.is_empty() && self.quick.iter().any(|q| q.is_impossible(scratch)) {
            self.goes_on = false;
            return;
        }
        let energy = match camera.origin() {
            Some(origin) if self.breakpoint.uses.energy => self.ledger.look((model, state, scratch), origin),
            _ => None,
        };
        if self.held.is_empty() && energy.is_some_and(|e| self.quick_energies.iter().any(|q| q.is_impossible(e))) {
            self.goes_on = false;
            return;
        }
        let (parts, set, all_parts, pairings) = (&self.parts, self.set, &self.all_parts, &self.pairings);
        let uses = self.breakpoint.uses;
        let torques = scratch.torques().filter(|_| uses.torque).map(extremes::coarse_torques);
        let mut values = StepValues { model, state, scratch, parts, set, all_parts, pairings, energy, torques };
        if uses.contact && !uses.varying {
            let signature = values.signature();
            if signature.is_some() && signature == self.signature {
                return;
            }
            self.signature = signature;
        }
        self.now.clear();
        // What is one number is told by itself.
        let one = !(uses.contact || uses.any_link || uses.any_joint);
        if one || values.may_hold(&self.breakpoint.expr) {
            let mut known = values.holding(&self.breakpoint, &mut self.now);
            if uses.touches && !(known && one) {
                self.close_until = state.step + CLOSE_STEPS;
            }
            if !known && uses.torque {
                // Nearer than friction can be told without: with it.
                values.torques = vectorised(scratch.isa, Torques(&values));
                self.now.clear();
                known = values.holding(&self.breakpoint, &mut self.now);
            }
            if !known {
                self.now = self.breakpoint.holding(&camera.take(model, state, scratch));
            }
        }
        if self.now.is_empty() && self.held.is_empty() {
            self.goes_on = false;
            return;
        }
        self.now.sort_unstable();
        self.now.dedup();
        let new = self.now.iter().filter(|s| self.held.binary_search(s).is_err());
        let t_s = state.step as f64 * model.step_s;
        if !std::mem::take(&mut self.goes_on) {
            hits.extend(new.map(|s| Hit { step: state.step, t_s, subject: *s, impact: None }));
        }
        std::mem::swap(&mut self.held, &mut self.now);
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

impl StepValues<'_> {
    /// Changes when another set of lanes touches, or one of them another tooth.
    fn signature(&self) -> Option<(f64, u64)> {
        let mut teeth = self.scratch.reseats();
        for part in self.parts {
            let Part::Contours(set) = part else { continue };
            let age = &self.scratch.memory(*part).age;
            for (lane, tooth) in self.scratch.contour_teeth(*set).iter().enumerate() {
                let own = (*tooth as u64).wrapping_mul(lane as u64 * 2 + 1);
                teeth = teeth.wrapping_add(if age[lane] > 0.0 { own } else { 0 });
            }
        }
        Some((self.scratch.set(self.set)?, teeth))
    }

    /// False only where no contact, link or joint can fulfil the expression: from the extremes of whole columns.
    fn may_hold(&self, expr: &Expr) -> bool {
        match expr {
            Expr::Any(parts) => parts.iter().any(|p| self.may_hold(p)),
            Expr::All(parts) => parts.iter().all(|p| self.may_hold(p)),
            Expr::Compare(compare) => {
                // Of one link, joint or sprocket, of two quantities, or of names: told one by one.
                let Some(compared) = Compared::of(compare) else { return true };
                let Compared { quantity, absolute, operator, bound } = compared;
                let Some(band) = Band::new(operator, bound, absolute, self.blur(quantity)) else { return true };
                if quantity.scope == Scope::Contact {
                    let quick = Quick::of(&compared, self.set, self.model.step_s);
                    if quick.is_some_and(|q| q.is_impossible(self.scratch)) {
                        return false;
                    }
                }
                vectorised(self.scratch.isa, Reach(self, quantity, band))
                    .is_none_or(|found| found.iter().any(|n| *n > 0.0))
            }
            Expr::Not(_) => true,
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
            What::TangentialSpeed => self.slide_of(part, lane),
            What::TangentialForce => {
                let pairing = self.pairing(part, lane)?;
                let ratio = (self.slide_of(part, lane)? / pairing.stick_speed_m_s).clamp(-1.0, 1.0);
                Some(-pairing.mu * self.normal_force(part, lane)? * ratio)
            }
            What::Stick => {
                let (stick, slide) = (self.pairing(part, lane)?.stick_speed_m_s, self.slide_of(part, lane)?.abs());
                let unsure = SLACK * stick + SPEED_BLUR_M_S;
                ((slide - stick).abs() > unsure).then_some(if slide < stick { 1.0 } else { 0.0 })
            }
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
            What::Angle => Some(crate::units::direction(l.sin[i], l.cos[i])),
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
                    what => {
                        let torque = *self.torques.as_ref()?.0.get(k)?;
                        match self.model.sprockets[k].rotor {
                            _ if what == What::Torque => Some(torque),
                            Rotor::Driven { .. } => Some(-torque),
                            Rotor::Free { torque_nm, .. } => Some(torque_nm),
                        }
                    }
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
            Scope::Energy => self.energy.map(|(e, _)| energy_number(quantity.what, e)),
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
            What::Segment => self.scratch.segments(part).map(|segments| segments[lane] as u32),
            _ => None,
        }
    }

    fn slack(&self) -> f64 {
        SLACK
    }

    fn blur(&self, quantity: &Quantity) -> f64 {
        match (quantity.scope, quantity.what) {
            (Scope::Contact, What::TangentialSpeed) => return SPEED_BLUR_M_S,
            (Scope::Contact, What::TangentialForce | What::NormalForce)
            | (Scope::Link, What::Tension)
            | (Scope::Joint, What::Force) => return FORCE_BLUR,
            (Scope::Sprocket, What::Torque | What::OuterTorque) => return self.torques.map_or(0.0, |t| t.1),
            _ => {}
        }
        let energy = self.energy.filter(|_| quantity.scope == Scope::Energy);
        energy.map_or(0.0, |energy| extremes::energy_blur(quantity.what, energy))
    }
}
