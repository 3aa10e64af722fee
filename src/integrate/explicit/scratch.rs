//! Scratch: what a step computes on the way, and what may be asked of it between [`super::evaluate`] and [`super::advance`].

use super::counts::ContactCounts;
use super::ends::EndBlock;
use super::guides::BlockForces;
use super::rails::{PlateLanes, RailColumns};
use super::rollers::BoreColumns;
use super::watch::ObservedStep;
use super::{ContactGroup, RunIn, Window};
use crate::aligned::AlignedColumn;
use crate::elements::friction;
use crate::geometry::Vec2;
use crate::integrate::Isa;
use crate::lanes::{LANES, LaneBlock, take};
use crate::model::{ChainModel, Model};
use crate::pairs::bush_tooth::Lanes;
use crate::pairs::contour_forces::AccelerationChange;
use crate::state::ContactMemory;
use std::any::Any;

/// What a step computes on the way. May be thrown away at any time.
pub struct Scratch {
    pub isa: Isa,
    /// Steps between two looks for who is near whom. Changes no bit of the results.
    pub refresh_steps: u64,
    pub run_in: RunIn,
    pub(super) next_refresh: u64,
    /// Fastest joint at the last look [m/s]; nothing that is further off than this times the step touches within one.
    pub(super) fastest_m_s: f64,
    pub(super) front: LinkEnds,
    pub(super) rear: LinkEnds,
    pub(super) omega: AlignedColumn,
    /// Mean ends and speeds over a step, from which the forces of the joints follow.
    pub(super) mean_front: LinkEnds,
    pub(super) mean_rear: LinkEnds,
    pub(super) mean_omega: AlignedColumn,
    pub(super) wrapped: WrappedColumns,
    pub(super) joint_x: JointColumn,
    pub(super) joint_y: JointColumn,
    pub(super) joint_torque: JointColumn,
    pub(super) joint_power_damping: AlignedColumn,
    /// Largest friction torque of every joint [N m].
    pub joint_limit: AlignedColumn,
    pub(super) constants: LinkConstants,
    pub(super) joint_power_friction: AlignedColumn,
    pub(super) bush_x: JointColumn,
    pub(super) bush_y: JointColumn,
    pub(super) bush_moment: JointColumn,
    /// Memories after the step, and what it knows of each contact, in the order of `ContactGroup::ALL`.
    pub(in crate::integrate) contacts: Vec<ContactMemory>,
    pub(in crate::integrate) groups: Vec<GroupColumns>,
    /// Where plates touch rails.
    pub(super) rails: RailColumns,
    /// Forces of guides and of what contours touch, per block of links.
    pub(super) end_forces: Vec<BlockForces>,
    /// See [`AccelerationChange`]; empty where there are no contours.
    pub(super) end_changes: Vec<AccelerationChange>,
    /// Per sprocket: direction of the axis of every joint's tooth gap, in the sprocket's frame.
    pub(super) seat_cos: Vec<AlignedColumn>,
    pub(super) seat_sin: Vec<AlignedColumn>,
    /// How far that gap lies beside its place, outwards and counterclockwise [m], and its index.
    pub(super) seat_out: Vec<AlignedColumn>,
    pub(super) seat_left: Vec<AlignedColumn>,
    pub(super) seat_index: Vec<AlignedColumn<u32>>,
    pub(super) reseats: u64,
    /// How often the body of its kind that a lane is nearest to has changed.
    pub(super) handovers: u64,
    /// Nearest sprocket of every joint; nearest guide of every link, per side.
    pub(super) nearest_sprocket: Vec<usize>,
    pub(super) nearest_guide: [Vec<usize>; 2],
    /// Nearest rail of every link, per side.
    pub(super) nearest_rail: [Vec<usize>; 2],
    pub(super) tooth_windows: Vec<Vec<Window>>,
    pub(super) guide_windows: Vec<Vec<Window>>,
    pub(super) rail_windows: Vec<Vec<Window>>,
    /// Rollers on their bushes.
    pub(crate) bores: BoreColumns,
    /// Lanes that are being worked on: kept, because clearing them for every body takes longer than filling them.
    pub(super) lanes: Option<Box<Lanes>>,
    pub(super) plates: Option<Box<PlateLanes>>,
    /// Tooth gaps that contours touch, or have touched last.
    pub(super) contour_tooth: [AlignedColumn; 6],
    /// Links near each body they may touch, and the nearest of those bodies per set and link.
    pub(super) end_windows: Vec<Vec<Window>>,
    pub(super) nearest_end: [Vec<usize>; 3],
    /// Per body and block of the links of its chain, for front and rear ends: what they faced last.
    pub(super) end_blocks: Vec<Vec<[EndBlock; 2]>>,
    /// For every chain, the distance from a link's centre that no point of its contour and no joint exceeds [m].
    pub(super) contour_extents_m: Vec<f64>,
    /// The step whose contacts of contours were looked for last.
    pub(super) contour_step: u64,
    /// For observers of every step.
    pub(super) watched: Option<Box<ObservedStep>>,
    /// For those who ask what contacts cost.
    pub(super) counts: Option<Box<ContactCounts>>,
    /// Accelerations of this step.
    pub ax: AlignedColumn,
    pub ay: AlignedColumn,
    pub alpha: AlignedColumn,
    /// Accelerations by the joints at this node, as predicted before the contacts.
    pub joint_ax: AlignedColumn,
    pub joint_ay: AlignedColumn,
    pub joint_alpha: AlignedColumn,
    pub coordinate_alpha: Vec<f64>,
    /// Torque of the chain on each coordinate, mean over the step [N m].
    pub chain_torque: Vec<f64>,
    /// What touching parts remember, and the force of touching parts and oil on each coordinate, mean over the step [N m, N].
    pub(in crate::integrate) touches: ContactMemory,
    pub(super) parts_force: Vec<f64>,
    /// Force of touches that this step has not come to yet, as it was a step ago.
    pub(super) touches_behind: Vec<f64>,
    /// The shares of loads and couplings that lose energy, and that do work outside.
    pub(super) losing_force: Vec<f64>,
    pub(super) working_force: Vec<f64>,
    /// What of `losing_force` is of loads, of dampers of couplings, and of spans.
    pub(super) losing_parts: [Vec<f64>; 3],
    /// Where coordinates stand at the node, and in the middle of the step; empty without oil.
    pub(super) places_before: Vec<f64>,
    pub(super) places_between: Vec<f64>,
    /// The scheme adds forces of contacts to those that were watched.
    pub(in crate::integrate) adds_forces: bool,
    /// What another scheme than the leapfrog computes on the way.
    pub(in crate::integrate) of_scheme: Option<Box<dyn Any + Send + Sync>>,
}

/// One value per joint, and the last joint's again before the first's: of the joint behind every link, and of the one before it.
pub(super) struct JointColumn(AlignedColumn);

impl JointColumn {
    /// Where the first joint stands: at the beginning of a cache line.
    const FIRST: usize = LANES;

    fn new(n: usize) -> JointColumn {
        JointColumn(AlignedColumn::zeros(Self::FIRST + n))
    }

    pub(super) fn values(&self) -> &[f64] {
        &self.0[Self::FIRST..]
    }

    pub(super) fn values_mut(&mut self) -> &mut [f64] {
        &mut self.0[Self::FIRST..]
    }

    /// Shifted by one: joint j at j + 1, the last one of a loop before its first.
    pub(super) fn shifted(&self) -> &[f64] {
        &self.0[Self::FIRST - 1..]
    }

    /// To be called when all joints have their values.
    #[inline(always)]
    pub(super) fn wrap_loops<const N: usize>(mut columns: [&mut JointColumn; N], chain: &ChainModel) {
        for l in &chain.loops {
            let (before, last) = (Self::FIRST + l.start - 1, Self::FIRST + l.end - 1);
            for column in &mut columns {
                column.0[before] = column.0[last];
            }
        }
    }

    pub(super) fn clear(&mut self) {
        self.0.fill(0.0);
    }
}

/// What links and joints do not change, by block: most blocks of a chain are alike, and one that is read for all of them stays in the
/// processor's nearest memory. Columns of their own were a tenth of what a step reads.
#[derive(Default)]
pub(super) struct LinkConstants {
    /// Blocks that differ from the first one, and the first.
    kinds: Vec<BlockConstants>,
    /// Which of them each block is.
    kind: Vec<usize>,
}

/// Of a block of links and of the joints behind them.
#[derive(Clone, Copy, PartialEq)]
#[repr(align(64))]
pub(super) struct BlockConstants {
    /// Half the pitch [m].
    pub(super) lever: LaneBlock,
    /// [1/kg], [1/(kg m2)].
    pub(super) inverse_mass: LaneBlock,
    pub(super) inverse_inertia: LaneBlock,
    /// Largest friction torque per relative speed of every joint that does not overshoot [N m s/rad].
    pub(super) friction_slope: LaneBlock,
}

impl LinkConstants {
    pub(super) fn read(&mut self, model: &Model) {
        let (c, half) = (&model.chain, 0.5 * model.step_s);
        self.kinds.clear();
        self.kind.clear();
        for at in (0..c.padded).step_by(LANES) {
            let inverse = &c.inverse_inertia;
            let block = BlockConstants {
                lever: take(&c.lever, at),
                inverse_mass: take(&c.inverse_mass, at),
                inverse_inertia: take(inverse, at),
                friction_slope: std::array::from_fn(|i| {
                    friction::largest_stable_slope(half * (inverse[at + i] + inverse[at + i + 1]))
                }),
            };
            if self.kinds.first() == Some(&block) {
                self.kind.push(0);
            } else {
                self.kind.push(self.kinds.len());
                self.kinds.push(block);
            }
        }
    }

    #[inline(always)]
    pub(super) fn block(&self, at: usize) -> &BlockConstants {
        &self.kinds[self.kind[at]]
    }
}

/// What a step knows of the contacts of one group. Stale where a contact's age is zero.
#[derive(Clone)]
pub(in crate::integrate) struct GroupColumns {
    /// Closing speed at the node [m/s].
    pub(super) rate: AlignedColumn,
    /// Sliding speed that friction works with [m/s].
    pub(super) slide: AlignedColumn,
    /// Penetration at the node [m].
    pub(in crate::integrate) depth: AlignedColumn,
    /// Per block: how many of the two memories that change hands still hold an old contact.
    pub(super) stale: Vec<u8>,
}

impl GroupColumns {
    fn new(len: usize) -> GroupColumns {
        let column = || AlignedColumn::zeros(len);
        GroupColumns { rate: column(), slide: column(), depth: column(), stale: vec![2; len / LANES] }
    }
}

/// Positions and velocities of one end of every link, one value longer.
pub(super) struct LinkEnds {
    pub(super) x: AlignedColumn,
    pub(super) y: AlignedColumn,
    pub(super) vx: AlignedColumn,
    pub(super) vy: AlignedColumn,
}

/// Headings, and the predicted accelerations that contacts use, one value longer.
pub(super) struct WrappedColumns {
    pub(super) cos: AlignedColumn,
    pub(super) sin: AlignedColumn,
    pub(super) ax: AlignedColumn,
    pub(super) ay: AlignedColumn,
    pub(super) alpha: AlignedColumn,
}

impl LinkEnds {
    pub(super) fn new(len: usize) -> LinkEnds {
        let column = || AlignedColumn::zeros(len);
        LinkEnds { x: column(), y: column(), vx: column(), vy: column() }
    }
}

/// Steps between two looks for who is near whom.
const REFRESH_STEPS: u64 = 64;
/// Room around a body inside which joints are looked at [m]: more than twice what they move between two looks.
pub(crate) const WINDOW_MARGIN_M: f64 = 5e-3;

impl Scratch {
    pub fn new(model: &Model) -> Scratch {
        Scratch::with_isa(model, Isa::detect())
    }

    pub fn with_isa(model: &Model, isa: Isa) -> Scratch {
        let n = model.chain.padded;
        let column = || AlignedColumn::zeros(n);
        let longer = || AlignedColumn::zeros(n + 1);
        let first_seat = |seats: &[f64]| AlignedColumn::of(seats.first().map_or(0.0, |v| *v), n);
        let lengths = model.contact_groups().map(|has| if has { n } else { 0 });
        Scratch {
            isa,
            refresh_steps: REFRESH_STEPS,
            run_in: RunIn::OFF,
            next_refresh: 0,
            fastest_m_s: 0.0,
            front: LinkEnds::new(n + 1),
            rear: LinkEnds::new(n + 1),
            omega: longer(),
            mean_front: LinkEnds::new(n + 1),
            mean_rear: LinkEnds::new(n + 1),
            mean_omega: longer(),
            wrapped: WrappedColumns { cos: longer(), sin: longer(), ax: longer(), ay: longer(), alpha: longer() },
            joint_x: JointColumn::new(n),
            joint_y: JointColumn::new(n),
            joint_torque: JointColumn::new(n),
            joint_power_damping: column(),
            joint_limit: column(),
            constants: LinkConstants::default(),
            joint_power_friction: column(),
            bush_x: JointColumn::new(n),
            bush_y: JointColumn::new(n),
            bush_moment: JointColumn::new(n),
            end_forces: vec![BlockForces::default(); n / LANES],
            end_changes: vec![AccelerationChange::default(); if model.has_contours() { n / LANES } else { 0 }],
            // All joints in gap 0 until somebody looks.
            seat_cos: vec![AlignedColumn::of(1.0, n); model.sprockets.len()],
            seat_sin: vec![column(); model.sprockets.len()],
            seat_out: model.sprockets.iter().map(|s| first_seat(&s.body.seat_out)).collect(),
            seat_left: model.sprockets.iter().map(|s| first_seat(&s.body.seat_left)).collect(),
            seat_index: vec![AlignedColumn::of(0, n); model.sprockets.len()],
            reseats: 0,
            handovers: 0,
            nearest_sprocket: vec![0; n],
            nearest_guide: [vec![0; n], vec![0; n]],
            nearest_rail: [vec![0; n], vec![0; n]],
            tooth_windows: vec![Vec::new(); model.sprockets.len()],
            guide_windows: vec![Vec::new(); model.guides.len()],
            rail_windows: vec![Vec::new(); model.rails.len()],
            contacts: lengths.map(ContactMemory::new).to_vec(),
            groups: lengths.map(GroupColumns::new).to_vec(),
            bores: BoreColumns::new(model),
            rails: RailColumns::new(if model.rails.is_empty() { 0 } else { n }),
            lanes: Some(Box::default()),
            plates: None,
            contour_tooth: std::array::from_fn(|_| column()),
            end_windows: vec![Vec::new(); model.end_bodies.len()],
            nearest_end: std::array::from_fn(|_| vec![usize::MAX; n]),
            end_blocks: model.end_bodies.iter().map(|body| EndBlock::all(model, body)).collect(),
            contour_extents_m: {
                let contour_m = |chain: usize| model.contours[chain].as_ref().map_or(0.0, |contour| contour.extent_m());
                let extent_m = |chain: usize| contour_m(chain).max(model.chain.longest_lever_m(chain));
                (0..model.contours.len()).map(extent_m).collect()
            },
            contour_step: u64::MAX - 1,
            watched: None,
            counts: None,
            ax: column(),
            ay: column(),
            alpha: column(),
            joint_ax: column(),
            joint_ay: column(),
            joint_alpha: column(),
            coordinate_alpha: vec![0.0; model.coordinates.len()],
            chain_torque: vec![0.0; model.coordinates.len()],
            touches: ContactMemory::new(model.touches.len()),
            parts_force: vec![0.0; model.coordinates.len()],
            touches_behind: vec![0.0; model.coordinates.len()],
            losing_force: vec![0.0; model.coordinates.len()],
            working_force: vec![0.0; model.coordinates.len()],
            losing_parts: std::array::from_fn(|_| vec![0.0; model.coordinates.len()]),
            places_before: vec![0.0; if model.oil.is_some() { model.coordinates.len() } else { 0 }],
            places_between: vec![0.0; if model.oil.is_some() { model.coordinates.len() } else { 0 }],
            adds_forces: false,
            of_scheme: None,
        }
    }

    /// For a State whose contacts are not those of the step before: any block of either memory may hold an old contact.
    pub(in crate::integrate) fn forget_contacts(&mut self) {
        self.groups.iter_mut().for_each(|group| group.stale.fill(2));
    }

    /// Closing and sliding speed of a contact whose forces were found elsewhere [m/s].
    pub(in crate::integrate) fn tell_speeds(&mut self, part: ContactGroup, lane: usize, [rate, slide]: [f64; 2]) {
        let group = &mut self.groups[part.index()];
        (group.rate[lane], group.slide[lane]) = (rate, slide);
    }

    /// Adds a force of parts that touch to a coordinate.
    pub(in crate::integrate) fn add_part_force(&mut self, coordinate: usize, force: f64) {
        self.parts_force[coordinate] += force;
    }

    /// Force on link j + 1 at joint `j` [N], and friction torque on it [N m].
    pub fn joint_force(&self, j: usize) -> (f64, f64, f64) {
        (self.joint_x.values()[j], self.joint_y.values()[j], self.joint_torque.values()[j])
    }

    /// Angular acceleration of every coordinate [rad/s2].
    pub fn coordinate_alpha(&self) -> &[f64] {
        &self.coordinate_alpha
    }

    /// Force of touching parts and oil on every coordinate [N m, N].
    pub fn parts_force(&self) -> &[f64] {
        &self.parts_force
    }

    /// Parts that touch each other and no chain, in the order of the Model.
    pub fn touches(&self) -> &ContactMemory {
        &self.touches
    }

    /// Torque of the chain on every coordinate [N m].
    pub fn chain_torque(&self) -> &[f64] {
        &self.chain_torque
    }

    /// Power lost in each joint at this node [W]: damping, friction.
    pub fn joint_powers(&self) -> (&[f64], &[f64]) {
        (&self.joint_power_damping, &self.joint_power_friction)
    }

    /// Links near body `k` that are nearest to it.
    pub fn ends_near<'a>(&'a self, model: &'a Model, k: usize) -> impl Iterator<Item = usize> + 'a {
        let set = model.end_bodies[k].set;
        let near = self.end_windows[k].iter().flat_map(|w| w.start..w.end);
        near.filter(move |i| model.chain.is_link(*i) && self.nearest_end[set][*i] == k)
    }

    /// Joints that sprocket `k` is the nearest to of all that are near, and the tooth gap that the bush of each is in.
    pub fn joints_near(&self, k: usize) -> impl Iterator<Item = (usize, u32)> + '_ {
        let own = move |w: &Window, j: &usize| !w.shared || self.nearest_sprocket[*j] == k;
        let joints = self.tooth_windows[k].iter().flat_map(move |w| (w.start..w.end).filter(move |j| own(w, j)));
        joints.map(move |j| (j, self.seat_index[k][j]))
    }

    /// Links that rail `k` is the nearest to of all that are near on its side.
    pub fn links_near_rail<'a>(&'a self, model: &Model, k: usize) -> impl Iterator<Item = usize> + 'a {
        let nearest = &self.nearest_rail[model.rails[k].body.side];
        let own = move |w: &Window, i: &usize| !w.shared || nearest[*i] == k;
        self.rail_windows[k].iter().flat_map(move |w| (w.start..w.end).filter(move |i| own(w, i)))
    }

    /// Where a plate touches a rail: place on the axis of its link [m], piece of the rail, normal out of the rail.
    pub fn on_rail(&self, set: usize, link: usize) -> (f64, usize, Vec2) {
        let r = &self.rails;
        (r.along[set][link], r.piece[set][link] as usize, Vec2::new(r.normal_x[set][link], r.normal_y[set][link]))
    }

    /// Links that guide `k` is the nearest to of all that are near on its side.
    pub fn links_near<'a>(&'a self, model: &Model, k: usize) -> impl Iterator<Item = usize> + 'a {
        let nearest = &self.nearest_guide[model.guides[k].body.side];
        let own = move |w: &Window, i: &usize| !w.shared || nearest[*i] == k;
        self.guide_windows[k].iter().flat_map(move |w| (w.start..w.end).filter(move |i| own(w, i)))
    }
}
