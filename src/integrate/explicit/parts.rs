//! What a step knows of every part of a link that touches something: for those who watch a run step by step.

use super::{Scratch, Window};
use crate::elements::contact_law::ContactLaw;
use crate::model::Model;
use crate::recording::frame::Feature;
use crate::state::{ContactMemory, State};

/// Parts of links that touch things, by the memory they have: one lane per joint (bushes) or per link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    Bushes,
    /// Set of guide ends.
    Guides(usize),
    /// Set of plates on rails: inside front, rear and edge, then outside.
    Rails(usize),
    /// Set of contour ends.
    Contours(usize),
}

/// Kinds of parts.
pub(super) const PARTS: usize = 17;

impl Part {
    /// Whether or not a model has them.
    pub(super) const ALL: [Part; PARTS] = [
        Part::Bushes,
        Part::Guides(0),
        Part::Guides(1),
        Part::Guides(2),
        Part::Guides(3),
        Part::Rails(0),
        Part::Rails(1),
        Part::Rails(2),
        Part::Rails(3),
        Part::Rails(4),
        Part::Rails(5),
        Part::Contours(0),
        Part::Contours(1),
        Part::Contours(2),
        Part::Contours(3),
        Part::Contours(4),
        Part::Contours(5),
    ];

    /// Among all of them.
    pub(super) fn index(self) -> usize {
        match self {
            Part::Bushes => 0,
            Part::Guides(set) => 1 + set,
            Part::Rails(set) => 5 + set,
            Part::Contours(set) => 11 + set,
        }
    }

    /// Those that the links of a model have.
    pub fn of(model: &Model) -> Vec<Part> {
        let (sides, rails, contours) = (model.guide_sides(), model.rail_sides(), model.contour_sets());
        let has = |part: &Part| match *part {
            Part::Bushes => model.sprockets.iter().any(|s| s.geometry.iso().is_some()),
            Part::Guides(set) => sides[set / 2],
            Part::Rails(set) => rails[set / 3],
            Part::Contours(set) => contours[set / 2],
        };
        Part::ALL.into_iter().filter(has).collect()
    }

    /// Link and feature of a lane.
    pub fn feature(self, model: &Model, lane: usize) -> (usize, Feature) {
        match self {
            Part::Bushes => {
                let (link, front) = model.chain.bush_carrier(lane);
                (link, if front { Feature::FrontBush } else { Feature::RearBush })
            }
            Part::Guides(set) => (lane, if set % 2 == 0 { Feature::FrontPlateEnd } else { Feature::RearPlateEnd }),
            Part::Rails(set) => (lane, [Feature::FrontPlateEnd, Feature::RearPlateEnd, Feature::PlateEdge][set % 3]),
            Part::Contours(set) => {
                let body = model.end_bodies.iter().find(|b| b.set == set / 2);
                (lane, body.map_or(Feature::FrontAbutment, |b| b.feature(set % 2 == 0)))
            }
        }
    }

    /// What it remembers from before this step.
    #[inline(always)]
    pub fn past_memory(self, state: &State) -> &ContactMemory {
        match self {
            Part::Bushes => &state.bushes,
            Part::Guides(set) => &state.guide_ends[set],
            Part::Rails(set) => &state.rail_plates[set],
            Part::Contours(set) => &state.contour_ends[set],
        }
    }

    /// Whether it slides on guides only; bushes and contours on sprockets do not.
    pub fn is_on_guides(self) -> bool {
        // The last two sets of contours are those of the guides' faces.
        matches!(self, Part::Guides(_) | Part::Rails(_) | Part::Contours(4..))
    }

    /// Whether it is one of the two ends of a set of links' own contours.
    pub fn is_set(self, set: usize) -> bool {
        matches!(self, Part::Contours(own) if own / 2 == set)
    }

    /// Whether this part may touch `body` (an index as in frames).
    pub fn touches(self, model: &Model, body: usize) -> bool {
        match self {
            Part::Bushes => body < model.sprockets.len(),
            Part::Guides(_) => (model.sprockets.len()..model.first_rail()).contains(&body),
            Part::Rails(set) => {
                let rail = body.checked_sub(model.first_rail()).and_then(|k| model.rails.get(k));
                rail.is_some_and(|r| r.body.side == set / 3)
            }
            Part::Contours(set) => model.end_bodies.iter().any(|b| b.set == set / 2 && b.body == body),
        }
    }
}

impl Scratch {
    /// Ends that meet in the joints at this node [m]: of link j in front, of link j + 1 behind (from index 1 on); x, then y.
    pub fn joint_ends(&self) -> [(&[f64], &[f64]); 2] {
        [(&self.front.x, &self.rear.x[1..]), (&self.front.y, &self.rear.y[1..])]
    }

    /// Penetration at this node as the step found it [m], where the lane's contact has an age.
    pub fn depth(&self, part: Part, lane: usize) -> f64 {
        match part {
            Part::Bushes => self.bush_depth[lane],
            Part::Guides(set) => self.guide_depth[set][lane],
            Part::Rails(set) => self.rails.depth[set][lane],
            Part::Contours(set) => self.contour_depth[set][lane],
        }
    }

    /// All of them, by lane.
    pub fn depths(&self, part: Part) -> &[f64] {
        match part {
            Part::Bushes => &self.bush_depth,
            Part::Guides(set) => &self.guide_depth[set],
            Part::Rails(set) => &self.rails.depth[set],
            Part::Contours(set) => &self.contour_depth[set],
        }
    }

    /// True only where no guide end and no contour of a link touches anything: known without a look at them.
    pub fn is_off_guides(&self) -> bool {
        self.end_forces.iter().all(|block| !block.used)
    }

    /// Per block of lanes, zero only where nothing touches: known without a look at them.
    pub fn touching_blocks(&self, part: Part) -> &[u8] {
        match part {
            Part::Bushes => &self.stale_bushes,
            Part::Guides(set) => &self.stale_blocks[set],
            Part::Rails(set) => &self.stale_rails[set],
            Part::Contours(set) => &self.stale_ends[set],
        }
    }

    /// Sliding speeds that friction works with, by lane [m/s].
    pub fn sliding_speeds(&self, part: Part) -> &[f64] {
        match part {
            Part::Bushes => &self.bush_slide,
            Part::Guides(set) => &self.guide_slide[set],
            Part::Rails(set) => &self.rails.slide[set],
            Part::Contours(set) => &self.contour_slide[set],
        }
    }

    /// Tooth gaps that contour ends touch, by lane.
    pub fn contour_teeth(&self, set: usize) -> &[f64] {
        &self.contour_tooth[set]
    }

    /// Forces of the joints, x and y [N], and friction torques [N m], shifted by one: joint j at j + 1, the last one also at 0.
    pub fn joint_columns(&self) -> (&[f64], &[f64], &[f64]) {
        (self.joint_x.before(), self.joint_y.before(), self.joint_torque.before())
    }

    /// Grows whenever a bush changes its tooth gap in flight, or a lane the body that it is nearest to.
    pub fn partner_changes(&self) -> u64 {
        self.reseats + self.handovers
    }

    /// Closing speed there [m/s].
    pub fn closing_speed(&self, part: Part, lane: usize) -> f64 {
        match part {
            Part::Bushes => self.bush_rate[lane],
            Part::Guides(set) => self.guide_rate[set][lane],
            Part::Rails(set) => self.rails.rate[set][lane],
            Part::Contours(set) => self.contour_rate[set][lane],
        }
    }

    /// What a lane with an age touches: index of the body as in frames, and tooth gap.
    pub fn partner(&self, model: &Model, part: Part, lane: usize) -> Option<(usize, u32)> {
        let own = |windows: &[Window], nearest: usize, k: usize| {
            windows.iter().any(|w| (w.start..w.end).contains(&lane) && (!w.shared || nearest == k))
        };
        match part {
            Part::Bushes => {
                let nearest = self.nearest_sprocket[lane];
                let k = (0..self.tooth_windows.len()).find(|k| own(&self.tooth_windows[*k], nearest, *k))?;
                Some((k, self.seat_index[k][lane]))
            }
            Part::Guides(set) => {
                let nearest = self.nearest_guide[set / 2][lane];
                let on_side = |k: &usize| model.guides[*k].body.side == set / 2;
                let mut guides = (0..self.guide_windows.len()).filter(on_side);
                guides.find(|k| own(&self.guide_windows[*k], nearest, *k)).map(|k| (model.sprockets.len() + k, 0))
            }
            Part::Rails(set) => {
                let nearest = self.nearest_rail[set / 3][lane];
                let on_side = |k: &usize| model.rails[*k].body.side == set / 3;
                let mut rails = (0..self.rail_windows.len()).filter(on_side);
                rails.find(|k| own(&self.rail_windows[*k], nearest, *k)).map(|k| (model.first_rail() + k, 0))
            }
            Part::Contours(set) => {
                let body = model.end_bodies.get(self.nearest_end[set / 2][lane])?;
                Some((body.body, self.contour_tooth[set][lane] as u32))
            }
        }
    }

    /// Penetration [m] and closing speed [m/s] at this node, where a lane touches.
    pub fn touch(&self, part: Part, lane: usize) -> Option<(f64, f64)> {
        let depth = self.depth(part, lane);
        (self.memory(part).age[lane] > 0.0 && depth > 0.0).then(|| (depth, self.closing_speed(part, lane)))
    }

    /// Whether a lane with an age overlaps at this node, or was pushed on either side of it within the step.
    pub fn is_contact(&self, part: Part, lane: usize) -> bool {
        self.depth(part, lane) > 0.0 || self.memory(part).normal_force[lane] > 0.0
    }

    /// Whether the friction of such a lane is below its limit.
    pub fn sticks(&self, model: &Model, part: Part, lane: usize) -> Option<bool> {
        let friction = match part {
            Part::Bushes => model.sprockets[self.partner(model, part, lane)?.0].body.friction,
            Part::Guides(_) => model.guides[self.partner(model, part, lane)?.0 - model.sprockets.len()].body.friction,
            Part::Rails(_) => model.rails[self.partner(model, part, lane)?.0 - model.first_rail()].body.friction,
            Part::Contours(set) => model.end_bodies.get(self.nearest_end[set / 2][lane])?.friction,
        };
        let memory = self.memory(part);
        Some(memory.tangential_force[lane].abs() < friction * memory.normal_force[lane])
    }

    /// Contact law between a lane with an age and what it touches.
    pub fn law<'a>(&self, model: &'a Model, part: Part, lane: usize) -> Option<&'a ContactLaw> {
        match part {
            Part::Bushes => self.partner(model, part, lane).map(|(k, _)| &model.sprockets[k].body.law),
            Part::Guides(_) => {
                self.partner(model, part, lane).map(|(k, _)| &model.guides[k - model.sprockets.len()].body.law)
            }
            Part::Rails(_) => {
                self.partner(model, part, lane).map(|(k, _)| &model.rails[k - model.first_rail()].body.law)
            }
            Part::Contours(set) => model.end_bodies.get(self.nearest_end[set / 2][lane]).map(|b| &b.law),
        }
    }

    /// Memory after this step of one kind of part.
    pub fn memory(&self, part: Part) -> &ContactMemory {
        match part {
            Part::Bushes => &self.bushes,
            Part::Guides(set) => &self.guide_ends[set],
            Part::Rails(set) => &self.rail_plates[set],
            Part::Contours(set) => &self.contour_ends[set],
        }
    }
}
