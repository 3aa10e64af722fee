//! The part of a step that concerns rails: plates on arcs and lines, on arms that give way.

use super::watch::ContactBlock;
use super::{
    BodyReaction, ContactGroup, MemoryBlocks, Scratch, Window, coordinate_columns, load_links, owned_lanes, take,
    write_block,
};
use crate::aligned::AlignedColumn;
use crate::elements::beam::MAX_MODES;
use crate::elements::body_frame::{BodyMobility, FrameMotion};
use crate::lanes::{LANES, LaneBlock};
use crate::model::Model;
use crate::pairs::bush_tooth::{self, FrictionInput, Lanes};
use crate::pairs::plate_blade::{BladeLanes, BladeMotion};
use crate::pairs::plate_rail::{self, PlatePart, RailContactLanes};
use crate::state::{FAR_AWAY_M, State};
use std::time::Instant;

/// What rails leave behind, by set: inside front, rear and edge, then outside.
pub(super) struct RailColumns {
    /// Where on the axis of its link a contact lies [m], the piece of the rail, and the normal out of it.
    pub(super) along: [AlignedColumn; SETS],
    pub(super) piece: [AlignedColumn; SETS],
    pub(super) normal_x: [AlignedColumn; SETS],
    pub(super) normal_y: [AlignedColumn; SETS],
}

pub(super) const SETS: usize = 2 * PARTS;
/// Parts of a plate: front, rear and edge.
const PARTS: usize = PlatePart::ALL.len();

impl RailColumns {
    pub(super) fn new(n: usize) -> RailColumns {
        let columns = || std::array::from_fn(|_| AlignedColumn::zeros(n));
        RailColumns { along: columns(), piece: columns(), normal_x: columns(), normal_y: columns() }
    }
}

/// Lanes of the three parts of plates.
#[derive(Clone, Default)]
#[repr(align(64))]
pub(super) struct PlateLanes {
    lanes: [Lanes; PARTS],
    found: [RailContactLanes; PARTS],
    /// Where they touch a rail that bends, and how it moves.
    on_blade: [BladeLanes; PARTS],
    blade: BladeMotion,
}

/// What a step knows of a rail before it looks at links.
struct RailPass {
    k: usize,
    swing: FrameMotion,
    mobility: BodyMobility,
    /// No link comes nearer to it within the step [m].
    reach_m: f64,
    /// As `reach_m`, to where it is drawn.
    far_m: f64,
    /// Blocks of lanes.
    count: usize,
}

/// Sums of what links exert on a rail.
#[derive(Default)]
struct RailReaction {
    body: BodyReaction,
    modes: [f64; MAX_MODES],
}

/// Contacts of all plates near rail `k`.
#[inline(always)]
pub(super) fn contacts<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch, k: usize) {
    let rail = &model.rails[k];
    let swing = rail.frame.motion(&coordinate_columns(model, state));
    let mobility = rail.frame.mobility(&model.coordinates);
    let reach_m =
        (scratch.fastest_m_s + swing.omega.abs() * rail.reach_m + swing.velocity.norm() + bending_m_s(model, state, k))
            * model.step_s;
    let mut own = scratch.plates.take().unwrap_or_default();
    if let Some(blade) = &rail.blade {
        let (q, bent) = (&state.coordinates, &mut own.blade);
        let half_step = 0.5 * model.step_s;
        blade.shape.deflection(blade.modes().map(|k| q.angle[k]), &mut bent.way);
        blade.shape.deflection(blade.modes().map(|k| q.omega[k] + half_step * q.alpha[k]), &mut bent.speed);
        blade.shape.deflection(blade.modes().map(|k| q.alpha[k]), &mut bent.acceleration);
    }
    let far_m = reach_m + rail.blade.as_ref().map_or(0.0, |blade| blade.shape.most_outward_m(&own.blade.way));
    let pass = RailPass { k, swing, mobility, reach_m, far_m, count: model.chain.padded / LANES };
    let mut given = RailReaction::default();
    for w in 0..scratch.rail_windows[k].len() {
        let Window { start, end, shared } = scratch.rail_windows[k][w];
        for block in start / LANES..end / LANES {
            block_contacts::<WATCHED>(model, state, scratch, &pass, (block, shared), &mut own, &mut given);
        }
    }
    if let Some(blade) = &rail.blade {
        for (k, force) in blade.modes().zip(given.modes) {
            scratch.chain_torque[k] += force;
        }
    }
    given.body.give_back(&rail.frame, &mut scratch.chain_torque);
    scratch.plates = Some(own);
}

/// Contacts of a block of links with a rail.
#[inline(always)]
fn block_contacts<const WATCHED: bool>(
    model: &Model,
    state: &State,
    scratch: &mut Scratch,
    pass: &RailPass,
    (block, shared): (usize, bool),
    own: &mut PlateLanes,
    given: &mut RailReaction,
) {
    let RailPass { k, swing, reach_m, count, .. } = *pass;
    let (rail, body, at) = (&model.rails[k], &model.rails[k].body, block * LANES);
    let PlateLanes { lanes, found, on_blade, blade: bent } = own;
    // What parts of plates no piece of the rail is for exert nothing, but another rail may have its contacts there.
    let active = if shared { [true; PARTS] } else { body.touches };
    let parts = || (0..PARTS).filter(|part| active[*part]);
    let group_of = |part: usize| ContactGroup::Rails(PARTS * body.side + part).index();
    let near = |lanes: &Lanes| lanes.penetration.iter().any(|p| *p > -reach_m);
    let held = |part: usize| take(&state.contacts[group_of(part)].age, at).iter().any(|age| *age != 0.0);
    let held: [bool; PARTS] = std::array::from_fn(|part| active[part] && held(part));
    let begun = scratch.counts.is_some().then(Instant::now);
    for part in (0..PARTS).filter(|part| !active[*part]) {
        super::memory_of(state, scratch, group_of(part), count).clear_block(block);
    }
    // What a contact remembers may go from one part to another.
    let looked_at_m = if shared || held != [false; PARTS] { f64::INFINITY } else { pass.far_m };
    find_contacts(model, state, scratch, (pass, shared, looked_at_m), at, active, lanes, found);
    if let Some(blade) = &rail.blade {
        for part in parts() {
            let levers = take(&model.chain.lever, at);
            let own = (&mut found[part], &mut lanes[part]);
            let part_of_plate = (PlatePart::ALL[part], &levers);
            blade.shape.bend_lanes(body, part_of_plate, pass.far_m, &swing, bent, own, &mut on_blade[part]);
        }
    }
    if !shared && !parts().any(|part| near(&lanes[part]) || held[part]) {
        for part in parts() {
            super::memory_of(state, scratch, group_of(part), count).clear_block(block);
        }
        return count_query(scratch, k, None, begun);
    }
    for part in parts() {
        super::memory_of(state, scratch, group_of(part), count).load_past(block, &mut lanes[part]);
    }
    if active == [true; PARTS] {
        transfer_contacts(lanes, found);
    }
    for part in parts() {
        let (lanes, found) = (&mut lanes[part], &found[part]);
        // A part of which nothing is near and nothing was held exerts nothing.
        if !shared && !near(lanes) && !held[part] && lanes.age.iter().all(|age| *age == 0.0) {
            super::memory_of(state, scratch, group_of(part), count).clear_block(block);
            continue;
        }
        let sliding =
            FrictionInput { mu: body.friction, stick_speed: body.stick_speed_m_s, radius: body.plate_radius_m };
        let turns = (swing.omega, pass.mobility);
        bush_tooth::forces_on_body(&body.law, sliding, &found.link_radius, model.step_s, turns, lanes);
        scratch.end_forces[block].add(lanes);
        if let Some(blade) = &rail.blade {
            blade.shape.give_back(lanes, &on_blade[part], &mut given.modes);
        }
        given.body.add(!rail.frame.shifts.is_empty(), [&lanes.force_x, &lanes.force_y, &lanes.torque]);
        let set = PARTS * body.side + part;
        if WATCHED {
            observe(model, scratch, k, (at, shared), set, (lanes, found));
        }
        store(state, scratch, (k, shared), (at, set), (lanes, found), count);
    }
    count_query(scratch, k, Some((lanes, active)), begun);
}

/// No point of a blade moves faster than this half a step before the node [m/s].
#[inline(always)]
pub(super) fn bending_m_s(model: &Model, state: &State, k: usize) -> f64 {
    let blade = model.rails[k].blade.as_ref();
    blade.map_or(0.0, |blade| blade.modes().map(|q| state.coordinates.omega[q].abs()).sum())
}

/// Geometry of the active parts of the plates of a block.
#[inline(always)]
fn find_contacts(
    model: &Model,
    state: &State,
    scratch: &Scratch,
    (pass, shared, far_m): (&RailPass, bool, f64),
    at: usize,
    active: [bool; PARTS],
    lanes: &mut [Lanes; PARTS],
    found: &mut [RailContactLanes; PARTS],
) {
    let (k, swing) = (pass.k, pass.swing);
    let body = &model.rails[k].body;
    let bent_m = model.rails[k].most_bent_m(&state.coordinates.angle);
    let alpha = take(&scratch.wrapped.alpha, at);
    load(model, state, scratch, at, (&swing, !model.rails[k].frame.shifts.is_empty()), &mut lanes[2]);
    if shared {
        let nearest = &scratch.nearest_rail[body.side][at..at + LANES];
        for i in (0..LANES).filter(|i| nearest[*i] != k) {
            lanes[2].x[i] = FAR_AWAY_M;
        }
    }
    // The last part takes the lanes as they are; the others get copies of them.
    let [front, rear, edge] = lanes;
    for (part, own) in [front as &mut Lanes, rear].into_iter().enumerate() {
        if body.touches[part] {
            *own = *edge;
        }
    }
    for (part, (lanes, found)) in PlatePart::ALL.into_iter().zip([front, rear, edge].into_iter().zip(found)) {
        if body.touches[part as usize] {
            *found = plate_rail::find_contacts((body, bent_m, far_m), part, swing, &alpha, lanes);
        } else if active[part as usize] {
            *found = plate_rail::face_nothing(lanes);
        }
    }
}

/// Where a joint of the chain passes an edge support, the contact of the edge becomes that of an end, or the other way round: what it remembers goes with
/// it.
fn transfer_contacts(lanes: &mut [Lanes; PARTS], found: &[RailContactLanes; PARTS]) {
    let [front, rear, edge] = lanes;
    for i in 0..LANES {
        for (end, of_end) in [(front as &mut Lanes, &found[0]), (rear, &found[1])] {
            // Both may be there for a step: rounding tells on which side of the joint a point lies.
            let begins = |lanes: &Lanes, found: &RailContactLanes| found.here[i] && lanes.age[i] <= 1.0;
            let ended = |lanes: &Lanes, found: &RailContactLanes| !found.here[i] && lanes.age[i] != 0.0;
            if begins(edge, &found[2]) && ended(end, of_end) {
                transfer_lane(end, edge, i);
            } else if begins(end, of_end) && ended(edge, &found[2]) {
                transfer_lane(edge, end, i);
            }
        }
    }
}

fn transfer_lane(from: &mut Lanes, to: &mut Lanes, i: usize) {
    to.normal_force[i] = std::mem::take(&mut from.normal_force[i]);
    to.tangential_force[i] = std::mem::take(&mut from.tangential_force[i]);
    to.age[i] = std::mem::take(&mut from.age[i]);
    to.approach[i] = std::mem::take(&mut from.approach[i]);
}

/// Gives results and memory of a part of a block back to their columns.
#[inline(always)]
fn store(
    state: &State,
    scratch: &mut Scratch,
    (k, shared): (usize, bool),
    (at, set): (usize, usize),
    (lanes, found): (&Lanes, &RailContactLanes),
    count: usize,
) {
    let Scratch { rails: r, contacts, groups, nearest_rail, .. } = scratch;
    let group = ContactGroup::Rails(set).index();
    let columns = &mut groups[group];
    let results = [
        (&mut columns.rate, &lanes.rate),
        (&mut columns.slide, &lanes.slide),
        (&mut columns.depth, &lanes.penetration),
        (&mut r.along[set], &lanes.lever),
        (&mut r.piece[set], &found.piece),
        (&mut r.normal_x[set], &lanes.normal_x),
        (&mut r.normal_y[set], &lanes.normal_y),
    ];
    let mut memory = MemoryBlocks::new(&state.contacts[group], &mut contacts[group], &mut columns.stale, count);
    if shared {
        let nearest = &nearest_rail[set / 3][at..at + LANES];
        for (column, values) in results {
            for i in (0..LANES).filter(|i| nearest[*i] == k) {
                column[at + i] = values[i];
            }
        }
        memory.store_lanes(|i| nearest[i] == k, at / LANES, lanes);
    } else {
        for (column, values) in results {
            write_block(column, at, *values);
        }
        memory.store(at / LANES, lanes);
    }
}

/// For those who ask what contacts cost.
fn count_query(
    scratch: &mut Scratch,
    k: usize,
    lanes: Option<(&[Lanes; PARTS], [bool; PARTS])>,
    begun: Option<Instant>,
) {
    if let (Some(begun), Some(counts)) = (begun, &mut scratch.counts) {
        let mut forces: LaneBlock = [0.0; LANES];
        for (own, _) in lanes.into_iter().flat_map(|(lanes, active)| lanes.iter().zip(active)).filter(|(_, own)| *own) {
            for (sum, force) in forces.iter_mut().zip(own.normal_force) {
                *sum += force;
            }
        }
        counts.rails[k].record(lanes.is_some(), lanes.is_some().then_some(&forces), begun);
    }
}

/// For observers of every step.
#[inline(always)]
fn observe(
    model: &Model,
    scratch: &mut Scratch,
    k: usize,
    (at, shared): (usize, bool),
    set: usize,
    (lanes, found): (&Lanes, &RailContactLanes),
) {
    let Some(watched) = &mut scratch.watched else { return };
    let nearest = &scratch.nearest_rail[model.rails[k].body.side];
    let own = owned_lanes(model.chain.link_lanes(at), shared.then_some(&nearest[at..at + LANES]), k);
    let part = ContactGroup::Rails(set);
    if watched.wants_segments() {
        let segment = |i: usize| f64::from(model.rails[k].segment(found.piece[i] as usize) as u32);
        watched.record_segments(part, at, std::array::from_fn(segment), own.as_ref());
    }
    watched.record(&ContactBlock { part, at, lanes }, own.as_ref());
}

/// The links `at` .. `at + LANES` as seen from a rail's origin.
#[inline(always)]
fn load(
    model: &Model,
    state: &State,
    scratch: &Scratch,
    at: usize,
    (frame, moves): (&FrameMotion, bool),
    lanes: &mut Lanes,
) {
    let (front, rear) = (&scratch.front, &scratch.rear);
    let (x, y) = (take(&state.links.x, at), take(&state.links.y, at));
    let (front_vx, front_vy) = (take(&front.vx, at), take(&front.vy, at));
    let (rear_vx, rear_vy) = (take(&rear.vx, at), take(&rear.vy, at));
    for i in 0..LANES {
        lanes.x[i] = x[i] - frame.origin.x;
        lanes.y[i] = y[i] - frame.origin.y;
        lanes.vx[i] = 0.5 * (front_vx[i] + rear_vx[i]);
        lanes.vy[i] = 0.5 * (front_vy[i] + rear_vy[i]);
    }
    load_links(model, scratch, at, lanes);
    if moves {
        lanes.take_off(frame);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests {
    use super::*;
    use crate::elements::contact_law::ContactLaw;
    use crate::geometry::guide::GuideSide;
    use crate::geometry::rail::{Rail, Stretch};
    use crate::geometry::{Vec2, rotated};
    use crate::pairs::plate_rail::RailBody;

    /// A plate that slides along a line onto an arc, and along an arc onto a line, always 1 um deep at its nearest point: at the joint the
    /// contact of one part becomes that of another with all that it remembers, and is never lost.
    #[test]
    fn contacts_go_on_over_the_joints_of_arcs_and_lines() {
        let (plate_m, lever_m, deep_m) = (3.55e-3, 4e-3, 1e-6);
        let stretch = |length_m: f64, radius_m: Option<f64>| Stretch { length_m, radius_m };
        let stretches = [stretch(0.03, None), stretch(0.03, Some(0.1)), stretch(0.03, None)];
        let rail = Rail::new(GuideSide::Outside, Vec2::zeros(), 0.0, &stretches).expect("a rail");
        let law = ContactLaw::Linear { stiffness_n_per_m: 1e7, damping_n_s_per_m: 0.0 };
        let body = RailBody::new(&rail, plate_m, law, 0.0, 0.1);
        let swing = FrameMotion::turning(Vec2::zeros(), (1.0, 0.0), 0.0, 0.0);
        // Where the chain is on its way: point and outward normal.
        let at = |s: f64| {
            let turn = ((s - 0.03) / 0.1).clamp(0.0, 0.3);
            let centre = Vec2::new(0.03, -0.1);
            let normal = rotated(Vec2::new(0.0, 1.0), -turn);
            let along = rotated(Vec2::new(1.0, 0.0), -turn);
            let beyond = if s < 0.03 { s - 0.03 } else { (s - 0.06).max(0.0) };
            (centre + normal * 0.1 + along * beyond, normal)
        };
        let mut held = [0.0_f64; 3];
        let (mut steps, mut moves) = (0, [0; 2]);
        for i in 0..20_000 {
            let (point, normal) = at(0.01 + i as f64 * 3e-6);
            let centre = point + normal * (plate_m - deep_m);
            let heading = rotated(normal, -std::f64::consts::FRAC_PI_2);
            let mut lanes = [Lanes::default(); 3];
            let mut found = [RailContactLanes::default(); 3];
            for (part, (lanes, found)) in PlatePart::ALL.into_iter().zip(lanes.iter_mut().zip(&mut found)) {
                (lanes.x, lanes.y) = ([centre.x; LANES], [centre.y; LANES]);
                (lanes.cos, lanes.sin) = ([heading.x; LANES], [heading.y; LANES]);
                lanes.lever = [lever_m; LANES];
                *found = plate_rail::find_contacts((&body, 0.0, f64::INFINITY), part, swing, &[0.0; LANES], lanes);
            }
            for (lanes, age) in lanes.iter_mut().zip(held) {
                (lanes.age, lanes.normal_force) = ([age; LANES], [age; LANES]);
            }
            let before = held;
            transfer_contacts(&mut lanes, &found);
            for (part, age) in held.iter_mut().enumerate() {
                let touches = found[part].here[0] && lanes[part].penetration[0] > 0.0;
                *age = if touches { lanes[part].age[0] + 1.0 } else { 0.0 };
            }
            let oldest = |ages: [f64; 3]| ages.into_iter().fold(0.0, f64::max);
            assert!(oldest(held) > oldest(before), "step {i}: {before:?} {held:?}");
            moves[0] += usize::from(before[2] == 0.0 && held[2] > 1.0);
            moves[1] += usize::from(before[2] > 0.0 && held[2] == 0.0 && held[1] > 1.0);
            steps += 1;
        }
        assert_eq!((steps, moves), (20_000, [1, 1]));
    }
}
