//! All contacts of links, one kind of pair after the other. Each kind loads its blocks of lanes, calls its kernel in `crate::pairs`, keeps memory and
//! columns of its group, and gives the forces to links and bodies. A new kind is a file beside this one, and a call here.

use super::guides::BlockForces;
use super::scratch::JointColumn;
use super::{Scratch, ends, guides, rails, rollers, teeth};
use crate::model::Model;
use crate::state::State;

/// Forces of all contacts of links at the node.
#[inline(always)]
pub(super) fn contacts<const WATCHED: bool>(model: &Model, state: &State, scratch: &mut Scratch) {
    for windows in &scratch.tooth_windows {
        for w in windows.iter().filter(|w| w.shared) {
            scratch.bush_x.values_mut()[w.start..w.end].fill(0.0);
            scratch.bush_y.values_mut()[w.start..w.end].fill(0.0);
            scratch.bush_moment.values_mut()[w.start..w.end].fill(0.0);
        }
    }
    scratch.chain_torque.fill(0.0);
    let has_rollers = model.chain.has_rollers();
    if has_rollers {
        rollers::contacts(model, state, scratch);
    }
    for k in 0..model.sprockets.len() {
        teeth::contacts::<WATCHED>(model, state, scratch, k);
    }
    JointColumn::wrap_loops([&mut scratch.bush_x, &mut scratch.bush_y, &mut scratch.bush_moment], &model.chain);
    for block in scratch.end_forces.iter_mut().filter(|block| block.used) {
        *block = BlockForces::default();
    }
    if has_rollers {
        rollers::give(model, scratch);
    }
    for k in (0..model.guides.len()).filter(|k| model.guides[*k].body.touches_plates) {
        guides::contacts::<WATCHED>(model, state, scratch, k);
    }
    for k in 0..model.rails.len() {
        rails::contacts::<WATCHED>(model, state, scratch, k);
    }
    if model.has_contours() {
        ends::contacts::<WATCHED>(model, state, scratch);
    }
}
