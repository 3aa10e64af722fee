//! Who is near whom: runs of joints near each sprocket and of links near each guide, looked up every so many steps with a
//! margin that they cannot cross in between. What lies outside touches nothing, so looking more or less often changes no bit.

use super::guides::BlockForces;
use super::teeth::seat_of;
use super::{LANES, Scratch, WINDOW_MARGIN_M, Window};
use crate::elements::body_frame::FrameMotion;
use crate::geometry::Vec2;
use crate::model::Model;
use crate::state::{ContactMemory, State};
use std::ops::Range;

/// Finds the joints near each sprocket and the links near each guide, and the tooth gap of each joint.
pub(super) fn refresh(model: &Model, state: &State, scratch: &mut Scratch) {
    // Memory changes hands with the State at every step; lanes outside the windows must be the same in both.
    scratch.contacts.clone_from(&state.contacts);
    for (memory, columns) in state.contacts.iter().zip(&mut scratch.groups) {
        mark_stale_blocks(memory, &mut columns.stale);
    }
    for column in [&mut scratch.bush_x, &mut scratch.bush_y, &mut scratch.bush_moment] {
        column.clear();
    }
    scratch.end_forces.fill(BlockForces::default());
    for (k, sprocket) in model.sprockets.iter().enumerate() {
        if sprocket.geometry.iso().is_none() {
            continue;
        }
        let reach = sprocket.geometry.tip_radius_m()
            + sprocket.body.bush_radius_m
            + sprocket.body.most_shift_m
            + WINDOW_MARGIN_M;
        let centre = sprocket.frame.origin_at(&state.coordinates.angle);
        let offset = |j: usize| (scratch.front.x[j] - centre.x, scratch.front.y[j] - centre.y);
        let near = |j: usize| {
            let (dx, dy) = offset(j);
            dx * dx + dy * dy < reach * reach
        };
        let windows = aligned_windows(&model.chain.bush_lanes(sprocket.chain), near);
        let body = &sprocket.body;
        let q = sprocket.coordinate;
        let (cos, sin) = (state.coordinates.cos[q], state.coordinates.sin[q]);
        for j in windows.iter().flat_map(|w| w.start..w.end) {
            let (dx, dy) = offset(j);
            let (seat_cos, seat_sin) = (scratch.seat_cos[k][j], scratch.seat_sin[k][j]);
            let (gx, gy) = (cos * seat_cos - sin * seat_sin, sin * seat_cos + cos * seat_sin);
            // Still in the gap that is written down.
            if (gx * dy - gy * dx).abs() <= body.half_gap_tan * (dx * gx + dy * gy) {
                continue;
            }
            let seat = seat_of(model, k, cos, sin, dx, dy);
            scratch.seat_cos[k][j] = body.seat_cos[seat];
            scratch.seat_sin[k][j] = body.seat_sin[seat];
            scratch.seat_out[k][j] = body.seat_out[seat];
            scratch.seat_left[k][j] = body.seat_left[seat];
            scratch.reseats += u64::from(scratch.seat_index[k][j] != seat as u32);
            scratch.seat_index[k][j] = seat as u32;
        }
        scratch.tooth_windows[k] = windows;
    }
    for (k, guide) in model.guides.iter().enumerate().filter(|(_, g)| g.body.touches_plates) {
        let b = &guide.body;
        // Link centres lie up to a lever from the ends that touch.
        let lever = longest_lever(model, guide.chain);
        let reach = b.plate_radius_m + lever + WINDOW_MARGIN_M;
        let beyond = b.relief_m + reach;
        let origin = guide.frame.origin_at(&state.coordinates.angle);
        let near = |i: usize| {
            let (dx, dy) = (state.links.x[i] - origin.x, state.links.y[i] - origin.y);
            let along = dx * b.along.x + dy * b.along.y;
            let above = dy * b.along.x - dx * b.along.y;
            above.abs() < reach && along > -beyond && along < b.length_m + beyond
        };
        scratch.guide_windows[k] = aligned_windows(&model.chain.loops[guide.chain], near);
    }
    for (k, rail) in model.rails.iter().enumerate() {
        let swing = rail.frame.motion(&super::coordinate_columns(model, state));
        let bent_m = rail.most_bent_m(&state.coordinates.angle);
        let reach = rail.body.plate_radius_m + longest_lever(model, rail.chain) + bent_m + WINDOW_MARGIN_M;
        let near = |i: usize| rail.box_distance_m(in_frame(&swing, state, i)) < reach;
        scratch.rail_windows[k] = aligned_windows(&model.chain.loops[rail.chain], near);
    }
    find_nearest(model, state, scratch);
    find_nearest_rail(model, state, scratch);
    super::ends::refresh(model, state, scratch);
}

/// Half the longer pitch of a loop's two rows [m].
fn longest_lever(model: &Model, chain: usize) -> f64 {
    let first = model.chain.loops[chain].start;
    model.chain.lever[first].max(model.chain.lever[model.chain.next(first)])
}

/// The centre of link `i` in the frame of a rail.
fn in_frame(swing: &FrameMotion, state: &State, i: usize) -> Vec2 {
    let (x, y) = (state.links.x[i] - swing.origin.x, state.links.y[i] - swing.origin.y);
    Vec2::new(swing.cos * x + swing.sin * y, swing.cos * y - swing.sin * x)
}

/// Where nothing has been touched both memories that change hands say so already.
pub(super) fn mark_stale_blocks(memory: &ContactMemory, blocks: &mut [u8]) {
    let lanes = memory.age.chunks(LANES).zip(memory.normal_force.chunks(LANES));
    for (block, (age, force)) in blocks.iter_mut().zip(lanes) {
        *block = if age.iter().chain(force).any(|v| *v != 0.0) { 2 } else { 0 };
    }
}

/// Notes which body is nearest, and counts where it is another than before.
pub(super) fn update_nearest(nearest: &mut usize, now: usize, handovers: &mut u64) {
    *handovers += u64::from(*nearest != now);
    *nearest = now;
}

/// Marks windows that lie over each other, and for their lanes the nearest body.
fn find_nearest(model: &Model, state: &State, scratch: &mut Scratch) {
    let everything = |_: usize, _: usize| true;
    if mark_shared(&mut scratch.tooth_windows, everything) {
        for j in model.chain.bodies() {
            let own = model.chain.loop_of(j);
            let gap = |k: &usize| {
                let s = &model.sprockets[*k];
                let centre = s.frame.origin_at(&state.coordinates.angle);
                let d = libm::hypot(scratch.front.x[j] - centre.x, scratch.front.y[j] - centre.y);
                d - s.geometry.tip_radius_m()
            };
            let of_chain = (0..model.sprockets.len()).filter(|k| model.sprockets[*k].chain == own);
            let nearest = of_chain.min_by(|a, b| gap(a).total_cmp(&gap(b)));
            update_nearest(&mut scratch.nearest_sprocket[j], nearest.unwrap_or(0), &mut scratch.handovers);
        }
    }
    let same_side = |a: usize, b: usize| model.guides[a].body.side == model.guides[b].body.side;
    if mark_shared(&mut scratch.guide_windows, same_side) {
        for side in 0..2 {
            for i in model.chain.links() {
                let own = model.chain.loop_of(i);
                let gap = |k: &usize| {
                    let b = &model.guides[*k].body;
                    let origin = model.guides[*k].frame.origin_at(&state.coordinates.angle);
                    let (dx, dy) = (state.links.x[i] - origin.x, state.links.y[i] - origin.y);
                    let along = dx * b.along.x + dy * b.along.y;
                    let above = dy * b.along.x - dx * b.along.y;
                    libm::hypot(above, along - along.clamp(0.0, b.length_m))
                };
                let on_side = (0..model.guides.len())
                    .filter(|k| model.guides[*k].body.side == side && model.guides[*k].chain == own);
                let nearest = on_side.min_by(|a, b| gap(a).total_cmp(&gap(b))).unwrap_or(0);
                update_nearest(&mut scratch.nearest_guide[side][i], nearest, &mut scratch.handovers);
            }
        }
    }
}

/// The rail that is nearest to every link, per side, where windows lie over each other.
fn find_nearest_rail(model: &Model, state: &State, scratch: &mut Scratch) {
    let same_side = |a: usize, b: usize| model.rails[a].body.side == model.rails[b].body.side;
    if !mark_shared(&mut scratch.rail_windows, same_side) {
        return;
    }
    let columns = super::coordinate_columns(model, state);
    let swings: Vec<FrameMotion> = model.rails.iter().map(|rail| rail.frame.motion(&columns)).collect();
    for side in 0..2 {
        for i in model.chain.links() {
            let own = model.chain.loop_of(i);
            let mut nearest: Option<(usize, f64)> = None;
            for (k, rail) in model.rails.iter().enumerate().filter(|(_, r)| r.body.side == side && r.chain == own) {
                let place = in_frame(&swings[k], state, i);
                // No point of a rail is nearer than the box about it.
                let is_nearer = |gap_m: f64| nearest.is_none_or(|(_, least_m)| gap_m < least_m);
                if is_nearer(rail.box_distance_m(place)) {
                    let gap_m = rail.rail.profile.closest(place).distance_m.abs();
                    if is_nearer(gap_m) {
                        nearest = Some((k, gap_m));
                    }
                }
            }
            let nearest = nearest.map_or(0, |(k, _)| k);
            update_nearest(&mut scratch.nearest_rail[side][i], nearest, &mut scratch.handovers);
        }
    }
}

/// Parts windows where those of other bodies lie over them, and sets `shared` on these parts; returns whether there are any.
fn mark_shared(windows: &mut [Vec<Window>], compete: impl Fn(usize, usize) -> bool) -> bool {
    let overlap = |a: &Window, b: &Window| a.start < b.end && b.start < a.end;
    let all: Vec<Vec<Window>> = windows.to_vec();
    let mut any = false;
    for (a, own) in windows.iter_mut().enumerate() {
        let others: Vec<Window> =
            all.iter().enumerate().filter(|(b, _)| *b != a && compete(a, *b)).flat_map(|(_, w)| w).copied().collect();
        if !own.iter().any(|w| others.iter().any(|other| overlap(w, other))) {
            continue;
        }
        any = true;
        let blocks = own.iter().flat_map(|w| (w.start..w.end).step_by(LANES)).map(|start| {
            let block = Window { start, end: start + LANES, shared: false };
            Window { shared: others.iter().any(|other| overlap(&block, other)), ..block }
        });
        let mut parted: Vec<Window> = Vec::new();
        for block in blocks {
            match parted.last_mut() {
                Some(last) if last.end == block.start && last.shared == block.shared => last.end = block.end,
                _ => parted.push(block),
            }
        }
        *own = parted;
    }
    any
}

/// Runs of lanes of a loop that are near, widened to multiples of [`LANES`] and joined.
pub(super) fn aligned_windows(own: &Range<usize>, near: impl Fn(usize) -> bool) -> Vec<Window> {
    let mut windows: Vec<Window> = Vec::new();
    for start in own.clone().step_by(LANES) {
        if (start..(start + LANES).min(own.end)).any(&near) {
            match windows.last_mut() {
                Some(last) if last.end == start => last.end += LANES,
                _ => windows.push(Window { start, end: start + LANES, shared: false }),
            }
        }
    }
    windows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_parted_where_others_lie_over_them() {
        let window = |start: usize, end: usize, shared: bool| Window { start: start * LANES, end: end * LANES, shared };
        let mut windows =
            vec![vec![window(0, 4, false), window(6, 7, false)], vec![window(3, 5, false)], vec![window(2, 3, false)]];
        // The third competes with none.
        assert!(mark_shared(&mut windows, |a, b| a != 2 && b != 2));
        assert_eq!(windows[0], [window(0, 3, false), window(3, 4, true), window(6, 7, false)]);
        assert_eq!(windows[1], [window(3, 4, true), window(4, 5, false)]);
        assert_eq!(windows[2], [window(2, 3, false)]);
        assert!(!mark_shared(&mut [vec![window(0, 1, false)], vec![window(1, 2, false)]], |_, _| true));
    }
}
