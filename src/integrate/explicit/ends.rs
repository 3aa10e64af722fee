//! The part of a step that concerns links' own contours: abutments and toothed flanks. Many ends at a time; what is near which
//! body is looked up with the other windows.

mod finder;
mod query;

pub(crate) use finder::{EndFinder, LinkPoses};
pub(super) use query::{Answer, Clearances, Poses, Query, ToothGaps};
use query::{Cache, Motion};

use super::abutments;
use super::flanks;
use super::guides::BlockForces;
use super::scratch::{Ends, Wrapped};
use super::watch::{Noted, Watched};
use super::{LANES, MemoryBlocks, Part, Scratch, WINDOW_MARGIN_M, Window};
use crate::elements::arc_lanes::{Found, NOTHING_M};
use crate::elements::contact_law::ContactLaw;
use crate::elements::contour_forces::{self, EndColumns, Lead, OffJoint};
use crate::elements::end_contact::{EndBody, LinkContour};
use crate::elements::tooth_contact::{Column, Lanes, Mask, any, blocks, blocks_mut, mask};
use crate::geometry::Vec2;
use crate::model::Model;
use crate::state::State;
use std::time::Instant;

/// One end of a block of links and one of the bodies that it may touch.
pub(super) struct EndBlock {
    /// Lanes whose nearest body of its kind this is, and whether these are any, or all that hold a link.
    own: Mask,
    has_own: bool,
    all_own: bool,
    /// Nothing touches, and `clearances` hold lower bounds of the gaps.
    is_clear: bool,
    /// Lower bounds of the gaps while `is_clear`. A block is skipped only where it cannot touch, so they change no bit.
    clearances: Clearances,
    cache: Cache,
}

impl EndBlock {
    /// Front and rear ends of every block of links, as the body `body` meets them.
    pub(super) fn all(model: &Model, body: &EndBody, count: usize) -> Vec<[EndBlock; 2]> {
        let end = |block, front| EndBlock {
            own: [0; LANES],
            has_own: false,
            all_own: false,
            is_clear: false,
            clearances: Clearances::default(),
            cache: Cache::new(model, body, block, front),
        };
        (0..count).map(|block| [end(block, true), end(block, false)]).collect()
    }

    /// Elements that were looked up anew.
    pub(super) fn searches(&self) -> u64 {
        match &self.cache {
            Cache::Abutments(cache) => cache.searches(),
            Cache::Flanks(_) => 0,
        }
    }
}

/// Links and their ends: blocks of columns of one length, so that one bounds check does for all.
struct Sources<'a> {
    /// Centres of links, headings, half their pitch.
    x: &'a [Column],
    y: &'a [Column],
    cos: &'a [Column],
    sin: &'a [Column],
    lever: &'a [Column],
    inverse_mass: &'a [Column],
    inverse_inertia: &'a [Column],
    omega: &'a [Column],
    ax: &'a [Column],
    ay: &'a [Column],
    alpha: &'a [Column],
    /// Velocities in the middle of the step before.
    past_vx: &'a [Column],
    past_vy: &'a [Column],
    past_omega: &'a [Column],
    past_ax: &'a [Column],
    past_ay: &'a [Column],
    past_alpha: &'a [Column],
}

impl<'a> Sources<'a> {
    /// Rates as at [`Scratch::omega`] and [`Scratch::wrapped`].
    #[inline(always)]
    fn new(model: &'a Model, state: &'a State, (omega, rates): (&'a [f64], &'a Wrapped), count: usize) -> Sources<'a> {
        let (c, l) = (&model.chain, &state.links);
        let column = |column: &'a [f64]| blocks(column, count);
        Sources {
            x: column(&l.x),
            y: column(&l.y),
            cos: column(&l.cos),
            sin: column(&l.sin),
            lever: column(&c.lever),
            inverse_mass: column(&c.inverse_mass),
            inverse_inertia: column(&c.inverse_inertia),
            omega: column(omega),
            ax: column(&rates.ax),
            ay: column(&rates.ay),
            alpha: column(&rates.alpha),
            past_vx: column(&l.vx),
            past_vy: column(&l.vy),
            past_omega: column(&l.omega),
            past_ax: column(&l.ax),
            past_ay: column(&l.ay),
            past_alpha: column(&l.alpha),
        }
    }
}

/// Positions and velocities of the front or the rear ends.
struct EndSources<'a> {
    x: &'a [Column],
    y: &'a [Column],
    vx: &'a [Column],
    vy: &'a [Column],
    /// How the joint lies from the link's centre: 1 ahead, -1 behind.
    sign: f64,
}

impl<'a> EndSources<'a> {
    #[inline(always)]
    fn new(ends: &'a Ends, sign: f64, count: usize) -> EndSources<'a> {
        let column = |column: &'a [f64]| blocks(column, count);
        EndSources { x: column(&ends.x), y: column(&ends.y), vx: column(&ends.vx), vy: column(&ends.vy), sign }
    }
}

/// What front or rear ends leave behind, a block at a time.
struct Results<'a> {
    memory: MemoryBlocks<'a>,
    rate: &'a mut [Column],
    slide: &'a mut [Column],
    depth: &'a mut [Column],
    tooth: &'a mut [Column],
}

/// Links are accelerated by less, or are met a step later. assumed: a kilonewton on a gram.
const LARGEST_ACCELERATION_M_S2: f64 = 1e6;

/// Gaps wider than this cannot close in a step.
fn far_m(model: &Model, fastest_m_s: f64) -> f64 {
    model.step_s * (2.0 * fastest_m_s + LARGEST_ACCELERATION_M_S2 * model.step_s)
}

/// What all ends share in a step.
struct Pass<'a> {
    model: &'a Model,
    contour: &'a LinkContour,
    far_m: f64,
    links: Sources<'a>,
    fastest_m_s: f64,
    /// Distance of the farthest point of a contour from its link's centre [m].
    extent_m: f64,
    /// Forces on the links of every block.
    pushed: &'a mut [BlockForces],
    /// What contacts of this step have changed so far, for every block.
    leads: &'a mut [Lead],
    watched: &'a mut Option<Box<Watched>>,
    /// The block whose forces are next.
    lanes: &'a mut Lanes,
    off: &'a mut OffJoint,
    found: &'a mut Found,
}

/// A body in this step.
struct Meeting<'a> {
    body: &'a EndBody,
    /// Cosine and sine of its angle, and its speed.
    rotor: (f64, f64),
    omega: f64,
    /// Its speed in the middle of the step before, and its acceleration then.
    past_omega: f64,
    past_alpha: f64,
    /// How far the turning of normals moves an end along one in a step, beyond what speeds say [m].
    turned_m: f64,
    /// See [`Query::details`].
    details: bool,
    /// Of every lane, on the body.
    torque: Column,
}

impl<'a> Meeting<'a> {
    #[inline(always)]
    fn new(model: &'a Model, state: &State, index: usize, (fastest_m_s, watched): (f64, bool)) -> Meeting<'a> {
        let body = &model.end_bodies[index];
        let (rotor, omega) = turning(model, state, body);
        let turned_m = contour_forces::turned_m(model.step_s, omega, fastest_m_s);
        let (past_omega, past_alpha) =
            body.coordinate.map_or((0.0, 0.0), |r| (state.coordinates.omega[r], state.coordinates.alpha[r]));
        let details = watched || !matches!(body.law, ContactLaw::Linear { .. });
        let torque = [0.0; LANES];
        Meeting { body, rotor, omega, past_omega, past_alpha, turned_m, details, torque }
    }
}

/// Contacts of all bodies that ends of links touch.
#[inline(always)]
pub(super) fn contacts<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch) {
    match &model.contour {
        None => {}
        Some(LinkContour::Abutments { .. }) => contacts_of::<WATCHED, true>(model, state, scratch),
        // Flanks push nearly at the centre of their link: their forces are the same to 1e-5 whether they take the others' lead or not.
        Some(LinkContour::Flanks(_)) => contacts_of::<WATCHED, false>(model, state, scratch),
    }
}

/// LED: contacts of a link take the lead of those before them.
#[inline(always)]
fn contacts_of<const WATCHED: bool, const LED: bool>(model: &Model, state: &State, scratch: &mut Scratch) {
    let Some(contour) = &model.contour else { return };
    let s = scratch;
    let count = model.chain.padded / LANES;
    let (mut off, mut found) = (OffJoint::default(), Found::nothing());
    let mut pass = Pass {
        model,
        contour,
        far_m: far_m(model, s.fastest_m_s),
        links: Sources::new(model, state, (&s.omega, &s.wrapped), count),
        fastest_m_s: s.fastest_m_s,
        extent_m: s.contour_extent_m,
        pushed: &mut s.end_forces[..count],
        leads: &mut s.end_leads[..count],
        watched: &mut s.watched,
        lanes: s.lanes.get_or_insert_default(),
        off: &mut off,
        found: &mut found,
    };
    for lead in pass.leads.iter_mut().filter(|lead| lead.used) {
        *lead = Lead::default();
    }
    let goes_on = state.step == s.contour_step + 1;
    s.contour_step = state.step;
    for k in (0..model.end_bodies.len()).filter(|k| !s.end_windows[*k].is_empty()) {
        let mut meeting = Meeting::new(model, state, k, (s.fastest_m_s, WATCHED));
        for rear in 0..2 {
            let (sign, source) = if rear == 0 { (1.0, &s.front) } else { (-1.0, &s.rear) };
            let ends = EndSources::new(source, sign, count);
            let set = 2 * meeting.body.set + rear;
            let mut results = Results {
                memory: MemoryBlocks::new(
                    &state.contour_ends[set],
                    &mut s.contour_ends[set],
                    &mut s.stale_ends[set],
                    count,
                ),
                rate: blocks_mut(&mut s.contour_rate[set], count),
                slide: blocks_mut(&mut s.contour_slide[set], count),
                depth: blocks_mut(&mut s.contour_depth[set], count),
                tooth: blocks_mut(&mut s.contour_tooth[set], count),
            };
            for Window { start, end, .. } in &s.end_windows[k] {
                for at in start / LANES..(end / LANES).min(count) {
                    let end = &mut s.end_blocks[k][at][rear];
                    if !end.has_own {
                        continue;
                    }
                    if end.is_clear && goes_on && pass.is_apart::<LED>(&meeting, at, end) {
                        if let Some(counts) = &mut s.counts {
                            counts.contours[k].skipped += 1;
                        }
                        continue;
                    }
                    let begun = s.counts.is_some().then(Instant::now);
                    let answer = pass.ask(&meeting, &ends, at, end);
                    let near = matches!(answer, Answer::Near);
                    let acts = pass.acts::<LED>(&meeting, (&ends, &results), (at, end), near);
                    if acts {
                        pass.push::<WATCHED, LED>(&mut meeting, (&ends, &mut results, set), (at, end));
                    } else {
                        pass.let_go(&meeting, (&ends, &mut results), (at, end), answer);
                    }
                    if let (Some(begun), Some(counts)) = (begun, &mut s.counts) {
                        let forces = acts.then(|| &results.memory.now.normal_force[at]);
                        counts.contours[k].note(near, forces, begun);
                    }
                }
            }
        }
        if let Some(coordinate) = meeting.body.coordinate {
            s.chain_torque[coordinate] += meeting.torque.iter().sum::<f64>();
        }
    }
}

impl Pass<'_> {
    /// Where the ends of a block meet the body.
    #[inline(always)]
    fn ask(&mut self, meeting: &Meeting<'_>, ends: &EndSources<'_>, at: usize, end: &mut EndBlock) -> Answer {
        let bounds = (self.far_m, self.extent_m);
        let query = Query::new(&self.links, bounds, meeting, (ends, at), &end.own);
        end.cache.touches(&query, self.contour, self.found)
    }

    /// Whether gaps that were known are still too wide for a touch in this step.
    #[inline(always)]
    fn is_apart<const LED: bool>(&self, meeting: &Meeting<'_>, at: usize, end: &mut EndBlock) -> bool {
        end.clearances.outlast(&self.motion::<LED>(meeting, at))
    }

    /// Bounds for all points of the links of a block that may touch a body. Between two nodes they move by the speeds in the middle of
    /// the step; contacts reckon with those at the node, which differ by the accelerations of this step and the one before.
    #[inline(always)]
    fn motion<const LED: bool>(&self, meeting: &Meeting<'_>, at: usize) -> Motion {
        let l = &self.links;
        let (x, y) = from_origin(meeting.body, &l.x[at], &l.y[at]);
        let (vx, vy, omega) = (&l.past_vx[at], &l.past_vy[at], &l.past_omega[at]);
        let (ax, ay, alpha) = (&l.ax[at], &l.ay[at], &l.alpha[at]);
        let (past_ax, past_ay, past_alpha) = (&l.past_ax[at], &l.past_ay[at], &l.past_alpha[at]);
        let lead = &self.leads[at];
        let (h, extent) = (self.model.step_s, self.extent_m);
        // Second-order motion: normals and arms turn, and the body changes its speed.
        let reach_m = meeting.body.distance_bound_m(extent);
        let turned_m = contour_forces::turned_m(h, meeting.past_omega, self.fastest_m_s);
        let turned_m = turned_m + h * h * meeting.past_alpha.abs() * reach_m;
        let (turning, face) = (meeting.past_omega, meeting.body.face_direction());
        let mut out = Motion { moved_m: [0.0; LANES], way_m: [0.0; LANES], along_m: [0.0; LANES] };
        for i in 0..LANES {
            let (ux, uy) = (vx[i] + turning * y[i], vy[i] - turning * x[i]);
            let arm = (omega[i] - turning).abs() * extent;
            let (across, along) = match face {
                Some(along) => ((uy * along.x - ux * along.y).abs(), (ux * along.x + uy * along.y).abs()),
                None => (ux.abs() + uy.abs(), 0.0),
            };
            let moved = h * (across + arm) + turned_m;
            let mut push = ax[i].abs() + ay[i].abs() + 2.0 * extent * alpha[i].abs();
            if LED && lead.used {
                push += lead.ax[i].abs() + lead.ay[i].abs() + 2.0 * extent * lead.alpha[i].abs();
            }
            let past = past_ax[i].abs() + past_ay[i].abs() + 2.0 * extent * past_alpha[i].abs();
            out.moved_m[i] = moved;
            // What is added is above the rounding of distances.
            out.way_m[i] = 1.01 * moved + h * h * (0.77 * push + 0.26 * past) + 1e-12;
            out.along_m[i] = h * along;
        }
        out
    }

    /// Whether an end of the block has touched or may touch in this step.
    #[inline(always)]
    fn acts<const LED: bool>(
        &mut self,
        meeting: &Meeting<'_>,
        (ends, results): (&EndSources<'_>, &Results<'_>),
        (at, end): (usize, &EndBlock),
        near: bool,
    ) -> bool {
        let held = holds(&results.memory.past.age[at], &end.own);
        if !near {
            self.found.penetration = [NOTHING_M; LANES];
            return held;
        }
        held || {
            let columns = self.columns(ends, (meeting.body, at));
            columns.may_touch::<LED>(self.model.step_s, meeting.omega, meeting.turned_m, &end.own)
        }
    }

    /// Forces of a block whose contact points are in [`Pass::found`].
    #[inline(always)]
    fn push<const WATCHED: bool, const LED: bool>(
        &mut self,
        meeting: &mut Meeting<'_>,
        (ends, results, set): (&EndSources<'_>, &mut Results<'_>, usize),
        (at, end): (usize, &mut EndBlock),
    ) {
        end.is_clear = false;
        let body = meeting.body;
        if body.has_teeth() {
            let mut tooth = results.tooth[at];
            for i in 0..LANES {
                tooth[i] = if self.found.penetration[i] != NOTHING_M { self.found.tooth[i] } else { tooth[i] };
            }
            results.tooth[at] = tooth;
        }
        let friction = (body.friction, body.stick_speed_m_s);
        let motion = (self.model.step_s, meeting.omega);
        if !WATCHED
            && end.all_own
            && let ContactLaw::Linear { stiffness_n_per_m, damping_n_s_per_m } = body.law
        {
            let (law, past) = ((stiffness_n_per_m, damping_n_s_per_m), results.memory.remembered(at));
            let columns = self.columns(ends, (body, at));
            if let Some(step) = contour_forces::plain_contour_step::<LED>(law, friction, motion, columns, past) {
                self.pushed[at].add_at_centre(&step);
                if LED {
                    self.leads[at].add(&step);
                }
                for i in 0..LANES {
                    meeting.torque[i] += step.torque[i];
                }
                results.memory.keep_step(at, &step);
                (results.rate[at], results.slide[at], results.depth[at]) =
                    (step.rate, step.slide, self.found.penetration);
                return;
            }
        }
        let columns = self.columns(ends, (body, at));
        let (off, lanes) = (&mut *self.off, &mut *self.lanes);
        columns.load::<LED>(self.found, lanes, off);
        results.memory.recall(at, lanes);
        let past = [lanes.normal_force, lanes.tangential_force];
        contour_forces::contour_forces(&body.law, friction, motion, off, lanes);
        self.pushed[at].add(lanes);
        if LED {
            self.leads[at].add_own(&columns, lanes, [&past[0], &past[1]], &end.own);
        }
        for i in 0..LANES {
            meeting.torque[i] += lanes.torque[i];
        }
        if WATCHED && let Some(watched) = self.watched {
            watch(self.model, watched, (set, at), &end.own, self.found, lanes);
        }
        if end.all_own {
            results.memory.keep(at, lanes);
            (results.rate[at], results.slide[at], results.depth[at]) = (lanes.rate, lanes.slide, lanes.penetration);
        } else {
            results.keep_own(&end.own, at, lanes);
        }
    }

    /// The ends of block `at` and their contact points as the forces need them.
    #[inline(always)]
    fn columns(&self, ends: &EndSources<'_>, (body, at): (&EndBody, usize)) -> EndColumns {
        let (from, found) = (&self.links, &*self.found);
        let lead = &self.leads[at];
        EndColumns {
            x: ends.x[at],
            y: ends.y[at],
            vx: ends.vx[at],
            vy: ends.vy[at],
            omega: from.omega[at],
            ax: from.ax[at],
            ay: from.ay[at],
            alpha: from.alpha[at],
            cos: from.cos[at],
            sin: from.sin[at],
            lever: from.lever[at],
            inverse_mass: from.inverse_mass[at],
            inverse_inertia: from.inverse_inertia[at],
            sign: ends.sign,
            origin: body.origin,
            penetration: found.penetration,
            point_x: found.point_x,
            point_y: found.point_y,
            normal_x: found.normal_x,
            normal_y: found.normal_y,
            lead_ax: lead.ax,
            lead_ay: lead.ay,
            lead_alpha: lead.alpha,
            quarter_step: 0.25 * self.model.step_s,
        }
    }

    /// Of a block that touches nothing.
    #[inline(always)]
    fn let_go(
        &mut self,
        meeting: &Meeting<'_>,
        (ends, results): (&EndSources<'_>, &mut Results<'_>),
        (at, end): (usize, &mut EndBlock),
        answer: Answer,
    ) {
        end.is_clear = false;
        if !end.all_own {
            self.lanes.let_go();
            self.lanes.penetration = [NOTHING_M; LANES];
            results.keep_own(&end.own, at, self.lanes);
        } else if !results.memory.forget(at) {
            let bounds = (self.far_m, self.extent_m);
            let query = Query::new(&self.links, bounds, meeting, (ends, at), &end.own);
            let gaps = match (answer, &end.cache) {
                (Answer::Apart(Some(gaps)), _) => Some(gaps),
                (_, Cache::Flanks(cache)) => Some(flanks::gaps(&query, cache)),
                (Answer::Near, Cache::Abutments(cache)) => Some(abutments::near_gaps(&query, cache)),
                (Answer::Apart(None), Cache::Abutments(_)) => None,
            };
            if let Some(gaps) = gaps {
                (end.clearances, end.is_clear) = (gaps, true);
            }
        }
    }
}

/// Whether any lane has touched in the step before.
#[inline(always)]
fn holds(ages: &Column, own: &Mask) -> bool {
    any(&std::array::from_fn(|i| own[i] & mask(ages[i] != 0.0)))
}

#[inline(always)]
fn from_origin(body: &EndBody, x: &Column, y: &Column) -> (Column, Column) {
    let (mut x, mut y) = (*x, *y);
    for i in 0..LANES {
        x[i] -= body.origin.x;
        y[i] -= body.origin.y;
    }
    (x, y)
}

impl Results<'_> {
    /// Of the lanes of `own` only.
    #[cold]
    fn keep_own(&mut self, own: &Mask, at: usize, lanes: &Lanes) {
        for i in (0..LANES).filter(|i| own[*i] != 0) {
            self.rate[at][i] = lanes.rate[i];
            self.slide[at][i] = lanes.slide[i];
            self.depth[at][i] = lanes.penetration[i];
        }
        self.memory.keep_own(|i| own[i] != 0, at, lanes);
    }
}

/// Cosine and sine of the angle of a body, and its speed at the node.
pub(crate) fn turning(model: &Model, state: &State, body: &EndBody) -> ((f64, f64), f64) {
    match body.coordinate {
        None => ((1.0, 0.0), 0.0),
        Some(r) => {
            let s = &state.coordinates;
            ((s.cos[r], s.sin[r]), s.omega[r] + 0.5 * model.step_s * s.alpha[r])
        }
    }
}

/// For those who look at every step.
fn watch(model: &Model, watched: &mut Watched, (set, block): (usize, usize), own: &Mask, found: &Found, lanes: &Lanes) {
    let at = block * LANES;
    let links = model.chain.gaps(at).unwrap_or([true; LANES]);
    let own = std::array::from_fn(|i| links[i] && own[i] != 0);
    let part = Part::Contours(set);
    if watched.wants_segments() {
        let segment = |i: usize| {
            if found.penetration[i] == NOTHING_M { 0.0 } else { found.segment[i] }
        };
        watched.note_segments(part, at, std::array::from_fn(segment), Some(&own));
    }
    watched.note(&Noted { part, at, lanes }, Some(&own));
}

/// Links near each body, and for every set the nearest body of each link.
pub(super) fn refresh(model: &Model, state: &State, scratch: &mut Scratch) {
    scratch.contour_ends.clone_from(&state.contour_ends);
    let distance = |body: &EndBody, link: usize| {
        body.distance_m(Vec2::new(state.links.x[link], state.links.y[link]) - body.origin)
    };
    for (k, body) in model.end_bodies.iter().enumerate() {
        let reach = body.reach_m(model.chain.lever[0]) + WINDOW_MARGIN_M;
        let near = |link: usize| distance(body, link) < reach;
        scratch.end_windows[k] = super::windows::aligned_windows(&model.chain.loops[body.chain], near);
    }
    for set in 0..scratch.nearest_end.len() {
        for link in model.chain.links() {
            let own = model.chain.loop_of(link);
            let gap = |k: &usize| {
                let body = &model.end_bodies[*k];
                distance(body, link) - body.reach_m(model.chain.lever[0])
            };
            let of_set = (0..model.end_bodies.len())
                .filter(|k| model.end_bodies[*k].set == set && model.end_bodies[*k].chain == own);
            let nearest = of_set.min_by(|a, b| gap(a).total_cmp(&gap(b))).unwrap_or(usize::MAX);
            super::windows::hand_over(&mut scratch.nearest_end[set][link], nearest, &mut scratch.handovers);
        }
    }
    for (k, body) in model.end_bodies.iter().enumerate() {
        let nearest = &scratch.nearest_end[body.set];
        for block in scratch.end_windows[k].iter().flat_map(|w| w.start / LANES..w.end / LANES) {
            let own: Mask = std::array::from_fn(|i| mask(nearest[block * LANES + i] == k));
            let links = model.chain.gaps(block * LANES).unwrap_or([true; LANES]);
            let all_own = (0..LANES).all(|i| own[i] != 0 || !links[i]);
            for end in &mut scratch.end_blocks[k][block] {
                (end.own, end.has_own, end.all_own, end.is_clear) = (own, any(&own), all_own, false);
            }
        }
    }
    for (memory, blocks) in state.contour_ends.iter().zip(&mut scratch.stale_ends) {
        super::windows::stale(memory, blocks);
    }
}
