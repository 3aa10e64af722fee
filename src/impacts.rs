//! Detects impacts at every step of a run: the part and link, its contact partner, approach speed and force.
//!
//! Definitions, for one part of one link (a bush, a plate end, an abutment, a flank: whatever has a contact memory of
//! its own):
//! * tooth period: pitch / nominal chain speed.
//! * first contact: the first step in which it carries force after two tooth periods without force. Its time is that of
//!   the step; its approach speed is the closing speed along the normal at contact, measured once both bodies overlap
//!   at a node.
//! * peak: the largest normal force within two tooth periods from first contact on, whatever the partner, at nodes and
//!   between them ([`PeakMeter`]; Hertz's law: the largest mean over a step).
//! * impulse: time integral of the force from first contact until, after its peak, it has fallen to half of it.
//! * rise time: from the last tenth of the peak before the first nine tenths of it; linear between steps, zero force a
//!   step before first contact. A constant damper beside the spring of a contact law gives c v at the touch itself: where that is more than
//!   a tenth of the peak, the rise is the law's, and is not told ([`Impact::own_rise_time_s`]).
//! * second period mean: its mean force in the second tooth period, when the impact is over.
//!
//! A part that is already in contact when the observation begins is not counted before it has separated. If the
//! observation begins in the middle of a run, the previous separation time is unknown, and all parts count as having
//! just been in contact.

use crate::elements::contact_law::{ContactLaw, PeakMeter};
use crate::integrate::explicit::{ContactGroup, Scratch};
use crate::integrate::{VectorKernel, vectorised};
use crate::lanes::LANES;
use crate::model::Model;
use crate::recording::capture::contacts_of;
use crate::recording::frame::Impact;
use crate::state::State;

/// Tooth periods for which an impact is observed, and for which a part must have been free before.
pub const WATCHED_PERIODS: f64 = 2.0;

/// Least sum of closing speeds by which the time of a touch is found [m/s].
const SLOWEST_M_S: f64 = 1e-9;

/// Contact memories of one kind of part.
struct WatchedGroup {
    group: ContactGroup,
    /// Step in which each lane last carried force; None: not since the start of the observation.
    last: Vec<Option<u64>>,
    /// Index into the open impacts.
    open: Vec<Option<usize>>,
}

struct OpenImpact {
    impact: Impact,
    parts: usize,
    lane: usize,
    has_partner: bool,
    /// Normal force of every step since first contact, mean over the step and maximum since the step before [N]. Steps
    /// without force are inserted when the next step with force comes, or at the end.
    force_n: Vec<f64>,
    top_n: Vec<f64>,
    meter: PeakMeter,
    best_n: f64,
    /// Contact law of the body that was touched first.
    law: Option<ContactLaw>,
}

impl OpenImpact {
    /// Inserts steps without force up to step `steps`; returns whether there were any.
    fn pad_without_force(&mut self, steps: u64) -> bool {
        let without = self.force_n.len() < steps as usize;
        if without {
            self.force_n.resize(steps as usize, 0.0);
            self.top_n.resize(steps as usize, 0.0);
        }
        without
    }
}

/// Observes a run. `observe` must be called at every step, after its evaluation.
pub struct ImpactWatch {
    period_steps: f64,
    step_s: f64,
    /// False: only first contacts are recorded.
    pub follows_forces: bool,
    /// Last observed step.
    step: u64,
    /// Step at which the next observation of an impact ends.
    next_close: u64,
    started: bool,
    parts: Vec<WatchedGroup>,
    open: Vec<Option<OpenImpact>>,
    /// Columns of finished impacts for reuse: allocating new ones took longer than filling them.
    spare: Vec<[Vec<f64>; 2]>,
    free: Vec<usize>,
    without_partner: usize,
    /// Blocks of lanes with a change, during their evaluation.
    changed: Vec<usize>,
    /// Impacts whose partner has become known since they were last taken.
    touched: Vec<Impact>,
    done: Vec<Impact>,
}

impl ImpactWatch {
    pub fn new(model: &Model) -> ImpactWatch {
        let n = model.chain.lanes;
        ImpactWatch {
            period_steps: Self::period_steps_of(model),
            step_s: model.step_s,
            follows_forces: true,
            step: 0,
            next_close: u64::MAX,
            started: false,
            parts: ContactGroup::in_model(model)
                .into_iter()
                .map(|of| WatchedGroup { group: of, last: vec![None; n], open: vec![None; n] })
                .collect(),
            open: Vec::new(),
            spare: Vec::new(),
            free: Vec::new(),
            without_partner: 0,
            changed: Vec::new(),
            touched: Vec::new(),
            done: Vec::new(),
        }
    }

    /// Steps of a tooth period, not rounded.
    pub fn period_steps_of(model: &Model) -> f64 {
        let pitch_m = 2.0 * model.chain.lever.first().copied().unwrap_or(0.0);
        let period_s = pitch_m / model.chain_speed_m_s().abs().max(1e-12);
        (period_s / model.step_s).max(1.0)
    }

    /// For a run that is continued at `step`.
    pub fn for_continued_run(model: &Model, step: u64) -> ImpactWatch {
        let mut watch = ImpactWatch::new(model);
        for parts in &mut watch.parts {
            parts.last.fill(Some(step));
        }
        watch
    }

    /// Records the step that has just been evaluated.
    pub fn observe(&mut self, model: &Model, state: &State, scratch: &Scratch) {
        let step = state.step;
        self.step = step;
        let apart = (WATCHED_PERIODS * self.period_steps) as u64;
        for p in 0..self.parts.len() {
            let (n, of) = (self.parts[p].last.len(), self.parts[p].group);
            let (past, now) = (&of.past_memory(state).age, &scratch.memory(of).age);
            self.changed.clear();
            vectorised(scratch.isa, Changes { scratch, of, past, now, changed: &mut self.changed });
            for block in std::mem::take(&mut self.changed) {
                let at = block * LANES;
                for lane in (at..(at + LANES).min(n)).filter(|lane| model.chain.is_body(*lane)) {
                    if now[lane] == 0.0 && past[lane] > 0.0 {
                        self.parts[p].last[lane] = Some(step.saturating_sub(1));
                    }
                    let free = self.parts[p].last[lane].is_none_or(|last| step - last > apart);
                    let begins = now[lane] == 1.0 && free && self.parts[p].open[lane].is_none();
                    if begins && self.started {
                        self.begin_impact(model, p, lane, step, scratch.memory(of).approach[lane]);
                    }
                }
            }
        }
        self.started = true;
        self.follow_forces(model, scratch, step);
        if self.without_partner > 0 {
            self.find_partners(model, state, scratch);
        }
    }

    fn begin_impact(&mut self, model: &Model, parts: usize, lane: usize, step: u64, approach_m_s: f64) {
        let (link, feature) = self.parts[parts].group.feature(model, lane);
        let t_s = step as f64 * self.step_s;
        let impact = Impact {
            link: model.chain.number_of(link) as u32,
            feature: feature as u32,
            step,
            t_s,
            approach_speed_m_s: approach_m_s,
            ..Impact::default()
        };
        let [force_n, top_n] = self.spare.pop().unwrap_or_default();
        let open = OpenImpact {
            impact,
            parts,
            lane,
            has_partner: false,
            force_n,
            top_n,
            meter: PeakMeter::default(),
            best_n: 0.0,
            law: None,
        };
        self.without_partner += 1;
        let at = match self.free.pop() {
            Some(at) => at,
            None => {
                self.open.push(None);
                self.open.len() - 1
            }
        };
        let window = (WATCHED_PERIODS * self.period_steps) as u64;
        self.next_close = self.next_close.min(step + window);
        self.open[at] = Some(open);
        self.parts[parts].open[lane] = Some(at);
    }

    fn follow_forces(&mut self, model: &Model, scratch: &Scratch, step: u64) {
        let window = (WATCHED_PERIODS * self.period_steps) as u64;
        if !self.follows_forces && step < self.next_close {
            return;
        }
        self.next_close = u64::MAX;
        for at in 0..self.open.len() {
            let Some(open) = &mut self.open[at] else { continue };
            if step - open.impact.step >= window {
                self.close_impact(at);
                continue;
            }
            self.next_close = self.next_close.min(open.impact.step + window);
            if !self.follows_forces {
                continue;
            }
            let (part, lane) = (self.parts[open.parts].group, open.lane);
            let memory = scratch.memory(part);
            if memory.age[lane] == 0.0 {
                continue;
            }
            let mean = memory.normal_force[lane];
            if open.pad_without_force(step - open.impact.step) {
                open.meter = PeakMeter::default();
            }
            open.force_n.push(mean);
            let (touch, approach) = (scratch.touch(part, lane), memory.approach[lane]);
            let law = touch.and_then(|_| match part {
                // All sprockets have the drive's single law, so that it need not be looked up.
                ContactGroup::Bushes if open.has_partner => Some(&model.sprockets[open.impact.body as usize].body.law),
                ContactGroup::Bushes | ContactGroup::Guides(_) | ContactGroup::Rails(_) | ContactGroup::Contours(_) => {
                    scratch.law(model, part, lane)
                }
            });
            open.law = open.law.or_else(|| law.filter(|_| open.has_partner).copied());
            let top = match law {
                Some(law) => open.meter.peak_since(law, touch, approach, self.step_s, open.best_n).unwrap_or(mean),
                None => {
                    open.meter = PeakMeter::default();
                    0.0
                }
            };
            open.best_n = open.best_n.max(top);
            open.top_n.push(top);
        }
    }

    /// Determines the contact partner, at the first node at which the two overlap.
    fn find_partners(&mut self, model: &Model, state: &State, scratch: &Scratch) {
        let step = state.step;
        for open in self.open.iter_mut().flatten().filter(|o| !o.has_partner) {
            let (link, feature) = (open.impact.link, open.impact.feature);
            let part = self.parts[open.parts].group;
            // Without overlap the search among all contacts is skipped.
            if scratch.touch(part, open.lane).is_none() {
                continue;
            }
            let contacts = contacts_of(model, state, scratch, Some(link as usize));
            let same = |i: &usize| {
                contacts.link[*i] == link
                    && contacts.feature[*i] == feature
                    && part.touches(model, contacts.body[*i] as usize)
            };
            let Some(i) = (0..contacts.link.len()).find(same) else { continue };
            let impact = &mut open.impact;
            // A prediction when the impact began; now the measured value.
            impact.approach_speed_m_s = scratch.memory(part).approach[open.lane];
            // From the touch to this node the bodies close at the mean of both speeds.
            if let Some((depth_m, closing_m_s)) = scratch.touch(part, open.lane) {
                let since_s = 2.0 * depth_m / (impact.approach_speed_m_s + closing_m_s).max(SLOWEST_M_S);
                let passed_s = (step - impact.step) as f64 * self.step_s;
                // Never before the step in which nothing touched.
                impact.touch_offset_s = (passed_s - since_s).max(-self.step_s);
            }
            (impact.body, impact.tooth, impact.segment) = (contacts.body[i], contacts.tooth[i], contacts.segment[i]);
            (impact.x_m, impact.y_m) = (contacts.point_body_x_m[i], contacts.point_body_y_m[i]);
            open.has_partner = true;
            self.without_partner -= 1;
            self.touched.push(*impact);
        }
    }

    fn close_impact(&mut self, at: usize) {
        let Some(mut open) = self.open[at].take() else { return };
        if self.follows_forces {
            let window = (WATCHED_PERIODS * self.period_steps) as u64;
            open.pad_without_force((self.step + 1 - open.impact.step).min(window));
        }
        self.free.push(at);
        self.parts[open.parts].open[open.lane] = None;
        if !open.has_partner {
            // Contact and separation between two nodes, or the end of the observation: the partner is unknown.
            self.without_partner -= 1;
            return;
        }
        self.done.push(measured(&open, self.step_s, self.period_steps));
        let mut columns = [open.force_n, open.top_n];
        columns.iter_mut().for_each(Vec::clear);
        self.spare.push(columns);
    }

    /// Impacts that have begun and whose partner is known, each once; forces are not known yet.
    pub fn take_touched(&mut self) -> Vec<Impact> {
        std::mem::take(&mut self.touched)
    }

    /// Finished impacts, each once.
    pub fn take_done(&mut self) -> Vec<Impact> {
        std::mem::take(&mut self.done)
    }

    pub fn period_steps(&self) -> f64 {
        self.period_steps
    }

    pub fn has_new_impacts(&self) -> bool {
        !(self.touched.is_empty() && self.done.is_empty())
    }

    /// Ends the run: open impacts are closed, with the time for which they were observed.
    pub fn finish(&mut self) -> Vec<Impact> {
        (0..self.open.len()).for_each(|at| self.close_impact(at));
        self.take_done()
    }
}

/// Blocks in which the contact of a lane begins or ends, from its ages a step ago and now.
struct Changes<'a> {
    scratch: &'a Scratch,
    of: ContactGroup,
    past: &'a [f64],
    now: &'a [f64],
    changed: &'a mut Vec<usize>,
}

impl VectorKernel for Changes<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Changes { scratch, of, past, now, changed } = self;
        let touching = scratch.touching_blocks(of);
        let is_busy = |block: usize| touching.get(block).is_none_or(|t| *t != 0);
        let columns = || past.as_chunks::<LANES>().0.iter().zip(now.as_chunks::<LANES>().0).enumerate();
        let mut sums = [0.0; LANES];
        for (_, (before, after)) in columns().filter(|(block, _)| is_busy(*block)) {
            changes(before, after, &mut sums);
        }
        // In most steps nothing changes.
        if sums.iter().sum::<f64>() == 0.0 {
            return;
        }
        for (block, (before, after)) in columns().filter(|(block, _)| is_busy(*block)) {
            let mut sums = [0.0; LANES];
            changes(before, after, &mut sums);
            if sums.iter().sum::<f64>() > 0.0 {
                changed.push(block);
            }
        }
    }
}

/// Counts, lane by lane, which contacts of a block begin or end.
#[inline(always)]
fn changes(past: &[f64; LANES], now: &[f64; LANES], sums: &mut [f64; LANES]) {
    for i in 0..LANES {
        let touched = if past[i] > 0.0 { 1.0 } else { 0.0 };
        let ends = if now[i] == 0.0 { touched } else { 0.0 };
        sums[i] += if now[i] == 1.0 { 1.0 } else { ends };
    }
}

fn measured(open: &OpenImpact, step_s: f64, period_steps: f64) -> Impact {
    let mut impact = open.impact;
    let (f, top) = (&open.force_n, &open.top_n);
    let (at, peak) =
        top.iter().copied().enumerate().fold((0, 0.0), |best, (i, f)| if f > best.1 { (i, f) } else { best });
    impact.peak_force_n = peak;
    impact.peak_after_s = at as f64 * step_s;
    let until = (at..top.len()).find(|i| top[*i] <= 0.5 * peak).unwrap_or(f.len());
    impact.impulse_n_s = f[..until].iter().sum::<f64>() * step_s;
    let force = |i: usize| if i == 0 { 0.0 } else { top[i - 1] };
    // Time at which the force crosses a level between steps i - 1 and i, counted from the step before first contact.
    let crossing = |i: usize, level: f64| {
        let (a, b) = (force(i - 1), force(i));
        (i - 1) as f64 + if b > a { (level - a) / (b - a) } else { 0.0 }
    };
    if peak > 0.0 {
        let high = (1..=top.len()).find(|i| force(*i) >= 0.9 * peak).unwrap_or(1);
        let low = (1..=high).rev().find(|i| force(i - 1) <= 0.1 * peak).unwrap_or(1);
        impact.rise_time_s = (crossing(high, 0.9 * peak) - crossing(low, 0.1 * peak)) * step_s;
    }
    impact.touch_force_n = open.law.map_or(0.0, |law| law.touch_force_n(impact.approach_speed_m_s));
    let second = f.get(period_steps as usize..).unwrap_or_default();
    impact.second_period_mean_n = second.iter().sum::<f64>() / second.len().max(1) as f64;
    impact.watched_s = f.len() as f64 * step_s;
    impact
}
