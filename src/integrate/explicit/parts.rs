//! What a step knows of every part of a link that touches something: for those who watch a run step by step.

use super::{Scratch, Window};
use crate::elements::contact_law::ContactLaw;
use crate::model::Model;
pub use crate::pairs::contact_group::{CONTACT_GROUPS, ContactGroup};
use crate::recording::frame::Feature;
use crate::state::{ContactMemory, State};

impl ContactGroup {
    /// Those that the links of a model have.
    pub fn in_model(model: &Model) -> Vec<ContactGroup> {
        let has = model.contact_groups();
        let seats_bushes = model.sprockets.iter().any(|s| s.geometry.iso().is_some());
        let is_there = |part: &ContactGroup| has[part.index()] && (seats_bushes || *part != ContactGroup::Bushes);
        ContactGroup::ALL.into_iter().filter(is_there).collect()
    }

    /// Link and feature of a lane.
    pub fn feature(self, model: &Model, lane: usize) -> (usize, Feature) {
        match self {
            ContactGroup::Bushes => {
                let (link, front) = model.chain.bush_carrier(lane);
                (link, Feature::at_teeth(front, model.chain.is_roller(lane)))
            }
            ContactGroup::Guides(set) => {
                (lane, if set % 2 == 0 { Feature::FrontPlateEnd } else { Feature::RearPlateEnd })
            }
            ContactGroup::Rails(set) => {
                (lane, [Feature::FrontPlateEnd, Feature::RearPlateEnd, Feature::PlateEdge][set % 3])
            }
            ContactGroup::Contours(set) => {
                let chain = model.chain.loop_of(lane);
                let body = model.end_bodies.iter().find(|b| b.set == set / 2 && b.chain == chain);
                (lane, body.map_or(Feature::FrontAbutment, |b| b.feature(set % 2 == 0)))
            }
        }
    }

    /// What it remembers from before this step.
    #[inline(always)]
    pub fn past_memory(self, state: &State) -> &ContactMemory {
        &state.contacts[self.index()]
    }

    /// Whether this part may touch `body` (an index as in frames).
    pub fn touches(self, model: &Model, body: usize) -> bool {
        match self {
            ContactGroup::Bushes => body < model.sprockets.len(),
            ContactGroup::Guides(_) => (model.sprockets.len()..model.first_rail()).contains(&body),
            ContactGroup::Rails(set) => {
                let rail = body.checked_sub(model.first_rail()).and_then(|k| model.rails.get(k));
                rail.is_some_and(|r| r.body.side == set / 3)
            }
            ContactGroup::Contours(set) => model.end_bodies.iter().any(|b| b.set == set / 2 && b.body == body),
        }
    }
}

impl Scratch {
    /// Ends that meet in the joints at this node [m]: of link j in front, of link j + 1 behind (from index 1 on); x, then y.
    pub fn joint_ends(&self) -> [(&[f64], &[f64]); 2] {
        [(&self.front.x, &self.rear.x[1..]), (&self.front.y, &self.rear.y[1..])]
    }

    /// Penetration at this node as the step found it [m], where the lane's contact has an age.
    pub fn depth(&self, part: ContactGroup, lane: usize) -> f64 {
        self.groups[part.index()].depth[lane]
    }

    /// All of them, by lane.
    pub fn depths(&self, part: ContactGroup) -> &[f64] {
        &self.groups[part.index()].depth
    }

    /// True only where no guide end and no contour of a link touches anything: known without a look at them.
    pub fn is_off_guides(&self) -> bool {
        self.end_forces.iter().all(|block| !block.used)
    }

    /// Per block of lanes, zero only where nothing touches: known without a look at them.
    pub fn touching_blocks(&self, part: ContactGroup) -> &[u8] {
        &self.groups[part.index()].stale
    }

    /// Sliding speeds that friction works with, by lane [m/s].
    pub fn sliding_speeds(&self, part: ContactGroup) -> &[f64] {
        &self.groups[part.index()].slide
    }

    /// Tooth gaps that contour ends touch, by lane.
    pub fn contour_teeth(&self, set: usize) -> &[f64] {
        &self.contour_tooth[set]
    }

    /// Forces of the joints, x and y [N], and friction torques [N m], shifted by one: joint j at j + 1, the last one also at 0.
    pub fn joint_columns(&self) -> (&[f64], &[f64], &[f64]) {
        (self.joint_x.shifted(), self.joint_y.shifted(), self.joint_torque.shifted())
    }

    /// Grows whenever a bush changes its tooth gap in flight, or a lane the body that it is nearest to.
    pub fn partner_changes(&self) -> u64 {
        self.reseats + self.handovers
    }

    /// Closing speed there [m/s].
    pub fn closing_speed(&self, part: ContactGroup, lane: usize) -> f64 {
        self.groups[part.index()].rate[lane]
    }

    /// What a lane with an age touches: index of the body as in frames, and tooth gap.
    pub fn partner(&self, model: &Model, part: ContactGroup, lane: usize) -> Option<(usize, u32)> {
        let own = |windows: &[Window], nearest: usize, k: usize| {
            windows.iter().any(|w| (w.start..w.end).contains(&lane) && (!w.shared || nearest == k))
        };
        match part {
            ContactGroup::Bushes => {
                let nearest = self.nearest_sprocket[lane];
                let k = (0..self.tooth_windows.len()).find(|k| own(&self.tooth_windows[*k], nearest, *k))?;
                Some((k, self.seat_index[k][lane]))
            }
            ContactGroup::Guides(set) => {
                let nearest = self.nearest_guide[set / 2][lane];
                let on_side = |k: &usize| model.guides[*k].body.side == set / 2;
                let mut guides = (0..self.guide_windows.len()).filter(on_side);
                guides.find(|k| own(&self.guide_windows[*k], nearest, *k)).map(|k| (model.sprockets.len() + k, 0))
            }
            ContactGroup::Rails(set) => {
                let nearest = self.nearest_rail[set / 3][lane];
                let on_side = |k: &usize| model.rails[*k].body.side == set / 3;
                let mut rails = (0..self.rail_windows.len()).filter(on_side);
                rails.find(|k| own(&self.rail_windows[*k], nearest, *k)).map(|k| (model.first_rail() + k, 0))
            }
            ContactGroup::Contours(set) => {
                let body = model.end_bodies.get(self.nearest_end[set / 2][lane])?;
                Some((body.body, self.contour_tooth[set][lane] as u32))
            }
        }
    }

    /// Penetration [m] and closing speed [m/s] at this node, where a lane touches.
    pub fn touch(&self, part: ContactGroup, lane: usize) -> Option<(f64, f64)> {
        let depth = self.depth(part, lane);
        (self.memory(part).age[lane] > 0.0 && depth > 0.0).then(|| (depth, self.closing_speed(part, lane)))
    }

    /// Whether a lane with an age overlaps at this node, or was pushed on either side of it within the step.
    pub fn is_contact(&self, part: ContactGroup, lane: usize) -> bool {
        self.depth(part, lane) > 0.0 || self.memory(part).normal_force[lane] > 0.0
    }

    /// Whether the friction of such a lane is below its limit.
    pub fn sticks(&self, model: &Model, part: ContactGroup, lane: usize) -> Option<bool> {
        let friction = match part {
            ContactGroup::Bushes => model.sprockets[self.partner(model, part, lane)?.0].body.friction,
            ContactGroup::Guides(_) => {
                model.guides[self.partner(model, part, lane)?.0 - model.sprockets.len()].body.friction
            }
            ContactGroup::Rails(_) => {
                model.rails[self.partner(model, part, lane)?.0 - model.first_rail()].body.friction
            }
            ContactGroup::Contours(set) => model.end_bodies.get(self.nearest_end[set / 2][lane])?.friction,
        };
        let memory = self.memory(part);
        Some(memory.tangential_force[lane].abs() < friction * memory.normal_force[lane])
    }

    /// Contact law between a lane with an age and what it touches.
    pub fn law<'a>(&self, model: &'a Model, part: ContactGroup, lane: usize) -> Option<&'a ContactLaw> {
        match part {
            ContactGroup::Bushes => self.partner(model, part, lane).map(|(k, _)| &model.sprockets[k].body.law),
            ContactGroup::Guides(_) => {
                self.partner(model, part, lane).map(|(k, _)| &model.guides[k - model.sprockets.len()].body.law)
            }
            ContactGroup::Rails(_) => {
                self.partner(model, part, lane).map(|(k, _)| &model.rails[k - model.first_rail()].body.law)
            }
            ContactGroup::Contours(set) => model.end_bodies.get(self.nearest_end[set / 2][lane]).map(|b| &b.law),
        }
    }

    /// Memory after this step of one kind of part.
    pub fn memory(&self, part: ContactGroup) -> &ContactMemory {
        &self.contacts[part.index()]
    }
}
