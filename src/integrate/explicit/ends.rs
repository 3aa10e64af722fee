//! The part of a step that concerns links' own contours: abutments and toothed flanks. Many ends at a time; what is near which
//! body is looked up with the other windows.

mod finder;
mod query;

pub(crate) use finder::{EndFinder, LinkPoses};
use query::{Cache, MotionBounds};
pub(super) use query::{Clearances, Poses, Query, QueryResult, ToothGaps};

use super::abutments;
use super::flanks;
use super::guides::BlockForces;
use super::scratch::{LinkEnds, WrappedColumns};
use super::watch::{ContactBlock, ObservedStep};
use super::{BodyReaction, ContactGroup, LANES, MemoryBlocks, Scratch, WINDOW_MARGIN_M, Window};
use crate::elements::body_frame::FrameMotion;
use crate::elements::contact_law::ClosedForm;
use crate::geometry::Vec2;
use crate::lanes::{LaneBlock, LaneMask, any, blocks, blocks_mut, mask};
use crate::model::Model;
use crate::pairs::arc_lanes::{EndContactLanes, NO_CONTACT_M};
use crate::pairs::bush_tooth::Lanes;
use crate::pairs::contour_body::{EndBody, LinkContour};
use crate::pairs::contour_forces::{self, AccelerationChange, EndColumns, OffJoint};
use crate::state::State;
use std::time::Instant;

/// One end of a block of links and one of the bodies that it may touch.
pub(super) struct EndBlock {
    /// Lanes whose nearest body of its kind this is, and whether these are any, or all that hold a link.
    own: LaneMask,
    has_own: bool,
    all_own: bool,
    /// Nothing touches, and `clearances` hold lower bounds of the gaps.
    is_clear: bool,
    /// Lower bounds of the gaps while `is_clear`. A block is skipped only where it cannot touch, so they change no bit.
    clearances: Clearances,
    cache: Cache,
}

impl EndBlock {
    /// Front and rear ends of every block of the links of its chain, as the body `body` meets them.
    pub(super) fn all(model: &Model, body: &EndBody) -> Vec<[EndBlock; 2]> {
        let end = |block, front| EndBlock {
            own: [0; LANES],
            has_own: false,
            all_own: false,
            is_clear: false,
            clearances: Clearances::default(),
            cache: Cache::new(model, body, block, front),
        };
        model.chain.blocks_of(body.chain).map(|block| [end(block, true), end(block, false)]).collect()
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
struct LinkSources<'a> {
    /// Centres of links, headings, half their pitch.
    x: &'a [LaneBlock],
    y: &'a [LaneBlock],
    cos: &'a [LaneBlock],
    sin: &'a [LaneBlock],
    lever: &'a [LaneBlock],
    inverse_mass: &'a [LaneBlock],
    inverse_inertia: &'a [LaneBlock],
    omega: &'a [LaneBlock],
    ax: &'a [LaneBlock],
    ay: &'a [LaneBlock],
    alpha: &'a [LaneBlock],
    /// Velocities in the middle of the step before.
    past_vx: &'a [LaneBlock],
    past_vy: &'a [LaneBlock],
    past_omega: &'a [LaneBlock],
    past_ax: &'a [LaneBlock],
    past_ay: &'a [LaneBlock],
    past_alpha: &'a [LaneBlock],
}

impl<'a> LinkSources<'a> {
    /// Rates as at [`Scratch::omega`] and [`Scratch::wrapped`].
    #[inline(always)]
    fn new(
        model: &'a Model,
        state: &'a State,
        (omega, rates): (&'a [f64], &'a WrappedColumns),
        count: usize,
    ) -> LinkSources<'a> {
        let (c, l) = (&model.chain, &state.links);
        let column = |column: &'a [f64]| blocks(column, count);
        LinkSources {
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
    x: &'a [LaneBlock],
    y: &'a [LaneBlock],
    vx: &'a [LaneBlock],
    vy: &'a [LaneBlock],
    /// How the joint lies from the link's centre: 1 ahead, -1 behind.
    sign: f64,
}

impl<'a> EndSources<'a> {
    #[inline(always)]
    fn new(ends: &'a LinkEnds, sign: f64, count: usize) -> EndSources<'a> {
        let column = |column: &'a [f64]| blocks(column, count);
        EndSources { x: column(&ends.x), y: column(&ends.y), vx: column(&ends.vx), vy: column(&ends.vy), sign }
    }
}

/// What front or rear ends leave behind, a block at a time.
struct EndResults<'a> {
    memory: MemoryBlocks<'a>,
    rate: &'a mut [LaneBlock],
    slide: &'a mut [LaneBlock],
    depth: &'a mut [LaneBlock],
    tooth: &'a mut [LaneBlock],
}

/// Links are accelerated by less, or are met a step later. assumed: a kilonewton on a gram.
const LARGEST_ACCELERATION_M_S2: f64 = 1e6;

/// Gaps wider than this cannot close in a step.
fn closable_gap_m(model: &Model, fastest_m_s: f64) -> f64 {
    model.step_s * (2.0 * fastest_m_s + LARGEST_ACCELERATION_M_S2 * model.step_s)
}

/// What all ends share in a step.
struct EndContactPass<'a> {
    model: &'a Model,
    far_m: f64,
    links: LinkSources<'a>,
    fastest_m_s: f64,
    /// Forces on the links of every block.
    block_forces: &'a mut [BlockForces],
    /// What contacts of this step have changed so far, for every block.
    changes: &'a mut [AccelerationChange],
    watched: &'a mut Option<Box<ObservedStep>>,
    /// The block whose forces are next.
    lanes: &'a mut Lanes,
    off: &'a mut OffJoint,
    found: &'a mut EndContactLanes,
}

/// A body in this step.
struct BodyInStep<'a> {
    body: &'a EndBody,
    /// Contour of the links that touch it, and the distance of its farthest point from its link's centre [m].
    contour: &'a LinkContour,
    extent_m: f64,
    /// Its frame: place, cosine and sine of its angle, and speeds.
    motion: FrameMotion,
    rotor: (f64, f64),
    omega: f64,
    /// Whether its axis moves: what is known of gaps then holds for no longer than a step.
    moves: bool,
    /// Its speed in the middle of the step before, and its acceleration then.
    past_omega: f64,
    past_alpha: f64,
    /// How far the turning of normals moves an end along one in a step, beyond what speeds say [m].
    turned_m: f64,
    /// See [`Query::details`].
    details: bool,
    /// What its contacts give it.
    given: BodyReaction,
}

impl<'a> BodyInStep<'a> {
    #[inline(always)]
    fn new(
        (model, contour, extent_m): (&'a Model, &'a LinkContour, f64),
        state: &State,
        body: &'a EndBody,
        (fastest_m_s, watched): (f64, bool),
    ) -> BodyInStep<'a> {
        let motion = body.frame.motion(&super::coordinate_columns(model, state));
        let FrameMotion { cos, sin, omega, .. } = motion;
        let turned_m = contour_forces::turned_m(model.step_s, omega, fastest_m_s);
        let (past_omega, past_alpha) =
            body.frame.turn.map_or((0.0, 0.0), |r| (state.coordinates.omega[r], state.coordinates.alpha[r]));
        let details = watched || body.law.closed_form().is_none();
        BodyInStep {
            body,
            contour,
            extent_m,
            motion,
            rotor: (cos, sin),
            omega,
            moves: !body.frame.shifts.is_empty(),
            past_omega,
            past_alpha,
            turned_m,
            details,
            given: BodyReaction::default(),
        }
    }
}

/// Contacts of all bodies that ends of links touch.
#[inline(always)]
pub(super) fn contacts<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch) {
    for change in scratch.end_changes.iter_mut().filter(|change| change.used) {
        *change = AccelerationChange::default();
    }
    for (chain, contour) in model.contours.iter().enumerate() {
        match contour {
            None => {}
            Some(of @ LinkContour::Abutments { .. }) => {
                contacts_of::<WATCHED, true>((model, chain, of), state, scratch)
            }
            // Flanks push nearly at the centre of their link: their forces are the same to 1e-5 whether they take the changes of the others into account or not.
            Some(of @ LinkContour::Flanks(_)) => contacts_of::<WATCHED, false>((model, chain, of), state, scratch),
        }
    }
    scratch.contour_step = state.step;
}

/// Those of one chain. UPDATED: contacts of a link take the changes by those before them into account.
#[inline(always)]
fn contacts_of<const WATCHED: bool, const UPDATED: bool>(
    (model, chain, contour): (&Model, usize, &LinkContour),
    state: &State,
    scratch: &mut Scratch,
) {
    let s = scratch;
    let count = model.chain.padded / LANES;
    let (mut off, mut found) = (OffJoint::default(), EndContactLanes::none());
    let mut pass = EndContactPass {
        model,
        far_m: closable_gap_m(model, s.fastest_m_s),
        links: LinkSources::new(model, state, (&s.omega, &s.wrapped), count),
        fastest_m_s: s.fastest_m_s,
        block_forces: &mut s.end_forces[..count],
        changes: &mut s.end_changes[..count],
        watched: &mut s.watched,
        lanes: s.lanes.get_or_insert_default(),
        off: &mut off,
        found: &mut found,
    };
    let goes_on = state.step == s.contour_step + 1;
    let (of_chain, first_block) = ((model, contour, s.contour_extents_m[chain]), model.chain.blocks_of(chain).start);
    for (k, body) in model.end_bodies.iter().enumerate() {
        if body.chain != chain || s.end_windows[k].is_empty() {
            continue;
        }
        let mut meeting = BodyInStep::new(of_chain, state, body, (s.fastest_m_s, WATCHED));
        for rear in 0..2 {
            let (sign, source) = if rear == 0 { (1.0, &s.front) } else { (-1.0, &s.rear) };
            let ends = EndSources::new(source, sign, count);
            let set = 2 * meeting.body.set + rear;
            let group = ContactGroup::Contours(set).index();
            let columns = &mut s.groups[group];
            let mut results = EndResults {
                memory: MemoryBlocks::new(&state.contacts[group], &mut s.contacts[group], &mut columns.stale, count),
                rate: blocks_mut(&mut columns.rate, count),
                slide: blocks_mut(&mut columns.slide, count),
                depth: blocks_mut(&mut columns.depth, count),
                tooth: blocks_mut(&mut s.contour_tooth[set], count),
            };
            for Window { start, end, .. } in &s.end_windows[k] {
                for at in start / LANES..(end / LANES).min(count) {
                    let end = &mut s.end_blocks[k][at - first_block][rear];
                    if !end.has_own {
                        continue;
                    }
                    if end.is_clear && goes_on && !meeting.moves && pass.is_apart::<UPDATED>(&meeting, at, end) {
                        if let Some(counts) = &mut s.counts {
                            counts.contours[k].skipped += 1;
                        }
                        continue;
                    }
                    let begun = s.counts.is_some().then(Instant::now);
                    let answer = pass.find_contacts(&meeting, &ends, at, end);
                    let near = matches!(answer, QueryResult::Near);
                    let acts = pass.needs_forces::<UPDATED>(&meeting, (&ends, &results), (at, end), near);
                    if acts {
                        pass.apply_forces::<WATCHED, UPDATED>(&mut meeting, (&ends, &mut results, set), (at, end));
                    } else {
                        pass.release(&meeting, (&ends, &mut results), (at, end), answer);
                    }
                    if let (Some(begun), Some(counts)) = (begun, &mut s.counts) {
                        let forces = acts.then(|| &results.memory.now.normal_force[at]);
                        counts.contours[k].record(near, forces, begun);
                    }
                }
            }
        }
        meeting.given.give_back(&body.frame, &mut s.chain_torque);
    }
}

impl EndContactPass<'_> {
    /// Where the ends of a block meet the body.
    #[inline(always)]
    fn find_contacts(
        &mut self,
        meeting: &BodyInStep<'_>,
        ends: &EndSources<'_>,
        at: usize,
        end: &mut EndBlock,
    ) -> QueryResult {
        let query = Query::new(&self.links, self.far_m, meeting, (ends, at), &end.own);
        end.cache.touches(&query, meeting.contour, self.found)
    }

    /// Whether gaps that were known are still too wide for a touch in this step.
    #[inline(always)]
    fn is_apart<const UPDATED: bool>(&self, meeting: &BodyInStep<'_>, at: usize, end: &mut EndBlock) -> bool {
        end.clearances.remain_clear(&self.motion_bounds::<UPDATED>(meeting, at))
    }

    /// Bounds for all points of the links of a block that may touch a body. Between two nodes they move by the speeds in the middle of
    /// the step; contacts use those at the node, which differ by the accelerations of this step and the one before.
    #[inline(always)]
    fn motion_bounds<const UPDATED: bool>(&self, meeting: &BodyInStep<'_>, at: usize) -> MotionBounds {
        let l = &self.links;
        let (x, y) = from_origin(meeting.motion.origin, &l.x[at], &l.y[at]);
        let (vx, vy, omega) = (&l.past_vx[at], &l.past_vy[at], &l.past_omega[at]);
        let (ax, ay, alpha) = (&l.ax[at], &l.ay[at], &l.alpha[at]);
        let (past_ax, past_ay, past_alpha) = (&l.past_ax[at], &l.past_ay[at], &l.past_alpha[at]);
        let change = &self.changes[at];
        let (h, extent) = (self.model.step_s, meeting.extent_m);
        // Second-order motion: normals and arms turn, and the body changes its speed.
        let reach_m = meeting.body.distance_bound_m(extent);
        let turned_m = contour_forces::turned_m(h, meeting.past_omega, self.fastest_m_s);
        let turned_m = turned_m + h * h * meeting.past_alpha.abs() * reach_m;
        let (turning, face) = (meeting.past_omega, meeting.body.face_direction());
        let mut out = MotionBounds { moved_m: [0.0; LANES], way_m: [0.0; LANES], along_m: [0.0; LANES] };
        for i in 0..LANES {
            let (ux, uy) = (vx[i] + turning * y[i], vy[i] - turning * x[i]);
            let arm = (omega[i] - turning).abs() * extent;
            let (across, along) = match face {
                Some(along) => ((uy * along.x - ux * along.y).abs(), (ux * along.x + uy * along.y).abs()),
                None => (ux.abs() + uy.abs(), 0.0),
            };
            let moved = h * (across + arm) + turned_m;
            let mut push = ax[i].abs() + ay[i].abs() + 2.0 * extent * alpha[i].abs();
            if UPDATED && change.used {
                push += change.ax[i].abs() + change.ay[i].abs() + 2.0 * extent * change.alpha[i].abs();
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
    fn needs_forces<const UPDATED: bool>(
        &mut self,
        meeting: &BodyInStep<'_>,
        (ends, results): (&EndSources<'_>, &EndResults<'_>),
        (at, end): (usize, &EndBlock),
        near: bool,
    ) -> bool {
        let held = was_touching(&results.memory.past.age[at], &end.own);
        if !near {
            self.found.penetration = [NO_CONTACT_M; LANES];
            return held;
        }
        held || {
            let columns = self.columns(ends, meeting, at);
            columns.may_touch::<UPDATED>(self.model.step_s, meeting.omega, meeting.turned_m, &end.own)
        }
    }

    /// Forces of a block whose contact points are in [`EndContactPass::found`].
    #[inline(always)]
    fn apply_forces<const WATCHED: bool, const UPDATED: bool>(
        &mut self,
        meeting: &mut BodyInStep<'_>,
        (ends, results, set): (&EndSources<'_>, &mut EndResults<'_>, usize),
        (at, end): (usize, &mut EndBlock),
    ) {
        end.is_clear = false;
        let body = meeting.body;
        if body.has_teeth() {
            let mut tooth = results.tooth[at];
            for i in 0..LANES {
                tooth[i] = if self.found.penetration[i] != NO_CONTACT_M { self.found.tooth[i] } else { tooth[i] };
            }
            results.tooth[at] = tooth;
        }
        let friction = (body.friction, body.stick_speed_m_s);
        let motion = (self.model.step_s, meeting.omega);
        if !WATCHED
            && end.all_own
            && let Some(law) = body.law.closed_form()
        {
            let past = results.memory.past_contacts(at);
            let columns = self.columns(ends, meeting, at);
            let fast = match law {
                ClosedForm::Constant(k, c) => {
                    contour_forces::fast_contour_step::<UPDATED, false>((k, c), friction, motion, columns, past)
                }
                ClosedForm::Growing(k, c) => {
                    contour_forces::fast_contour_step::<UPDATED, true>((k, c), friction, motion, columns, past)
                }
            };
            if let Some(step) = fast {
                self.block_forces[at].add_at_centre(&step);
                if UPDATED {
                    self.changes[at].add(&step);
                }
                meeting.given.add(meeting.moves, [&step.force_x, &step.force_y, &step.torque]);
                results.memory.store_step(at, &step);
                (results.rate[at], results.slide[at], results.depth[at]) =
                    (step.rate, step.slide, self.found.penetration);
                return;
            }
        }
        let columns = self.columns(ends, meeting, at);
        let (off, lanes) = (&mut *self.off, &mut *self.lanes);
        columns.load::<UPDATED>(self.found, lanes, off);
        results.memory.load_past(at, lanes);
        let past = [lanes.normal_force, lanes.tangential_force];
        contour_forces::contour_forces(&body.law, friction, motion, off, lanes);
        self.block_forces[at].add(lanes);
        if UPDATED {
            self.changes[at].add_lanes(&columns, lanes, [&past[0], &past[1]], &end.own);
        }
        meeting.given.add(meeting.moves, [&lanes.force_x, &lanes.force_y, &lanes.torque]);
        if WATCHED && let Some(watched) = self.watched {
            observe(self.model, watched, (set, at), &end.own, self.found, lanes);
        }
        if end.all_own {
            results.memory.store(at, lanes);
            (results.rate[at], results.slide[at], results.depth[at]) = (lanes.rate, lanes.slide, lanes.penetration);
        } else {
            results.store_lanes(&end.own, at, lanes);
        }
    }

    /// The ends of block `at` and their contact points as the forces need them.
    #[inline(always)]
    fn columns(&self, ends: &EndSources<'_>, meeting: &BodyInStep<'_>, at: usize) -> EndColumns {
        let (from, found) = (&self.links, &*self.found);
        let change = &self.changes[at];
        let mut columns = EndColumns {
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
            origin: meeting.motion.origin,
            penetration: found.penetration,
            point_x: found.point_x,
            point_y: found.point_y,
            normal_x: found.normal_x,
            normal_y: found.normal_y,
            change_ax: change.ax,
            change_ay: change.ay,
            change_alpha: change.alpha,
            quarter_step: 0.25 * self.model.step_s,
        };
        if meeting.moves {
            // As seen from the axis. The law takes the link's mass alone: an axis weighs many links.
            let FrameMotion { velocity, acceleration, .. } = meeting.motion;
            for i in 0..LANES {
                columns.vx[i] -= velocity.x;
                columns.vy[i] -= velocity.y;
                columns.ax[i] -= acceleration.x;
                columns.ay[i] -= acceleration.y;
            }
        }
        columns
    }

    /// Of a block that touches nothing.
    #[inline(always)]
    fn release(
        &mut self,
        meeting: &BodyInStep<'_>,
        (ends, results): (&EndSources<'_>, &mut EndResults<'_>),
        (at, end): (usize, &mut EndBlock),
        answer: QueryResult,
    ) {
        end.is_clear = false;
        if !end.all_own {
            self.lanes.release();
            self.lanes.penetration = [NO_CONTACT_M; LANES];
            results.store_lanes(&end.own, at, self.lanes);
        } else if !results.memory.clear_block(at) {
            let query = Query::new(&self.links, self.far_m, meeting, (ends, at), &end.own);
            let gaps = match (answer, &end.cache) {
                (QueryResult::Apart(Some(gaps)), _) => Some(gaps),
                (_, Cache::Flanks(cache)) => Some(flanks::gaps(&query, cache)),
                (QueryResult::Near, Cache::Abutments(cache)) => Some(abutments::near_gaps(&query, cache)),
                (QueryResult::Apart(None), Cache::Abutments(_)) => None,
            };
            if let Some(gaps) = gaps {
                (end.clearances, end.is_clear) = (gaps, true);
            }
        }
    }
}

/// Whether any lane has touched in the step before.
#[inline(always)]
fn was_touching(ages: &LaneBlock, own: &LaneMask) -> bool {
    any(&std::array::from_fn(|i| own[i] & mask(ages[i] != 0.0)))
}

#[inline(always)]
fn from_origin(origin: Vec2, x: &LaneBlock, y: &LaneBlock) -> (LaneBlock, LaneBlock) {
    let (mut x, mut y) = (*x, *y);
    for i in 0..LANES {
        x[i] -= origin.x;
        y[i] -= origin.y;
    }
    (x, y)
}

impl EndResults<'_> {
    /// Of the lanes of `own` only.
    #[cold]
    fn store_lanes(&mut self, own: &LaneMask, at: usize, lanes: &Lanes) {
        for i in (0..LANES).filter(|i| own[*i] != 0) {
            self.rate[at][i] = lanes.rate[i];
            self.slide[at][i] = lanes.slide[i];
            self.depth[at][i] = lanes.penetration[i];
        }
        self.memory.store_lanes(|i| own[i] != 0, at, lanes);
    }
}

/// For observers of every step.
fn observe(
    model: &Model,
    watched: &mut ObservedStep,
    (set, block): (usize, usize),
    own: &LaneMask,
    found: &EndContactLanes,
    lanes: &Lanes,
) {
    let at = block * LANES;
    let links = model.chain.link_lanes(at).unwrap_or([true; LANES]);
    let own = std::array::from_fn(|i| links[i] && own[i] != 0);
    let part = ContactGroup::Contours(set);
    if watched.wants_segments() {
        let segment = |i: usize| {
            if found.penetration[i] == NO_CONTACT_M { 0.0 } else { found.segment[i] }
        };
        watched.record_segments(part, at, std::array::from_fn(segment), Some(&own));
    }
    watched.record(&ContactBlock { part, at, lanes }, Some(&own));
}

/// Half the pitch of the first link of a chain [m].
fn first_lever_m(model: &Model, chain: usize) -> f64 {
    model.chain.lever[model.chain.loops[chain].start]
}

/// Links near each body, and for every set the nearest body of each link.
pub(super) fn refresh(model: &Model, state: &State, scratch: &mut Scratch) {
    if model.end_bodies.is_empty() {
        return;
    }
    let distance = |body: &EndBody, link: usize| {
        body.distance_m(
            Vec2::new(state.links.x[link], state.links.y[link]) - body.frame.origin_at(&state.coordinates.angle),
        )
    };
    for (k, body) in model.end_bodies.iter().enumerate() {
        let reach = body.reach_m(first_lever_m(model, body.chain)) + WINDOW_MARGIN_M;
        let near = |link: usize| distance(body, link) < reach;
        scratch.end_windows[k] = super::windows::aligned_windows(&model.chain.loops[body.chain], near);
    }
    for set in 0..scratch.nearest_end.len() {
        for link in model.chain.links() {
            let own = model.chain.loop_of(link);
            let gap = |k: &usize| {
                let body = &model.end_bodies[*k];
                distance(body, link) - body.reach_m(first_lever_m(model, own))
            };
            let of_set = (0..model.end_bodies.len())
                .filter(|k| model.end_bodies[*k].set == set && model.end_bodies[*k].chain == own);
            let nearest = of_set.min_by(|a, b| gap(a).total_cmp(&gap(b))).unwrap_or(usize::MAX);
            super::windows::update_nearest(&mut scratch.nearest_end[set][link], nearest, &mut scratch.handovers);
        }
    }
    for (k, body) in model.end_bodies.iter().enumerate() {
        let (nearest, first_block) = (&scratch.nearest_end[body.set], model.chain.blocks_of(body.chain).start);
        for block in scratch.end_windows[k].iter().flat_map(|w| w.start / LANES..w.end / LANES) {
            let own: LaneMask = std::array::from_fn(|i| mask(nearest[block * LANES + i] == k));
            let links = model.chain.link_lanes(block * LANES).unwrap_or([true; LANES]);
            let all_own = (0..LANES).all(|i| own[i] != 0 || !links[i]);
            for end in &mut scratch.end_blocks[k][block - first_block] {
                (end.own, end.has_own, end.all_own, end.is_clear) = (own, any(&own), all_own, false);
            }
        }
    }
}
