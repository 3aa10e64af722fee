//! The columns of all chains: one value per lane. Closed loops of links stand behind each other, each on blocks of its own; lanes that hold
//! no link are inert. Behind the last link of a loop its first stands again while joints are computed, before its first link its last
//! joint: so a whole block is left between two loops, which no window over links reaches.
//!
//! Rollers that are bodies of their own stand behind all loops, one for every joint of their chain: links of no length in whose one end sits
//! the bush that the teeth touch. No joint holds them; what they touch does.

use crate::aligned::AlignedColumn;
use crate::elements::link_joint::LinkJoint;
use crate::geometry::chain::{LinkShape, RollerShape};
use crate::lanes::LANES;
use crate::random::SplitMix;
use std::ops::Range;

/// All chains: one value per lane, padded.
#[derive(Clone, Debug, PartialEq)]
pub struct ChainModel {
    /// Number of links of all loops together.
    pub n_links: usize,
    /// Lanes of the links of every loop.
    pub loops: Vec<Range<usize>>,
    /// Lanes of the rollers of every loop; an empty range where its links have none of their own.
    pub rollers: Vec<Range<usize>>,
    /// The rollers of every loop.
    pub roller_shapes: Vec<Option<RollerShape>>,
    /// Lanes up to the last link or roller.
    pub lanes: usize,
    /// Length of the columns.
    pub padded: usize,
    /// Blocks of which every lane holds a link or a roller.
    full_blocks: Vec<bool>,
    /// Lanes of every block that hold one.
    held_lanes: Vec<[bool; LANES]>,
    /// Half the pitch [m]: lever of both joints.
    pub lever: AlignedColumn,
    /// Mass per lane [kg].
    pub mass: AlignedColumn,
    /// Moment of inertia about the centre of mass per lane [kg m2].
    pub inertia: AlignedColumn,
    /// 1 / mass; zero in lanes without a link [1/kg].
    pub inverse_mass: AlignedColumn,
    /// One value longer: the first link's again at `n_links`.
    pub inverse_inertia: AlignedColumn,
    /// 1 where the bush of joint j belongs to link j, 0 where to link j + 1; shifted by one: index 0 is the last joint.
    pub bush_on_front: AlignedColumn,
    /// Of the link that carries the bush of joint j: signed lever, inverse mass and inertia.
    pub bush_lever: AlignedColumn,
    /// Inverse mass of that link [1/kg].
    pub bush_inverse_mass: AlignedColumn,
    /// Inverse inertia of that link [1/(kg m2)].
    pub bush_inverse_inertia: AlignedColumn,
    /// Joint law of every loop.
    pub joints: Vec<LinkJoint>,
    /// Joints that turn hard, and the torque of their friction [N m].
    pub tight: Vec<(usize, f64)>,
}

impl ChainModel {
    /// A closed chain of alternating rows, the first row carrying the bushes.
    pub fn new(n_links: usize, rows: &[LinkShape], joint: LinkJoint, lane_width: usize) -> ChainModel {
        let padded = n_links.div_ceil(lane_width) * lane_width;
        let row = |i: usize| &rows[i % rows.len()];
        let column = |f: &dyn Fn(usize) -> f64, inert: f64, len: usize| -> AlignedColumn {
            (0..len).map(|i| if i < n_links { f(i) } else { inert }).collect()
        };
        let carrier = |j: usize| if row(j).bush_radius_m.is_some() { j } else { (j + 1) % n_links };
        let on_front = |j: usize| if carrier(j) == j { 1.0 } else { 0.0 };
        let mut inverse_inertia = column(&|i| 1.0 / row(i).inertia_kg_m2, 0.0, padded + 1);
        inverse_inertia[n_links] = inverse_inertia[0];
        let mut bush_on_front = AlignedColumn::of(1.0, padded + 1);
        for j in 0..n_links {
            bush_on_front[j + 1] = on_front(j);
        }
        bush_on_front[0] = on_front(n_links - 1);
        let half_pitch = |i: usize| 0.5 * row(i).pitch_m;
        let mut chain = ChainModel {
            n_links,
            loops: std::iter::once(0..n_links).collect(),
            rollers: Vec::new(),
            roller_shapes: vec![rows.iter().find_map(|r| r.roller)],
            lanes: n_links,
            padded,
            full_blocks: Vec::new(),
            held_lanes: Vec::new(),
            lever: column(&half_pitch, 0.0, padded),
            mass: column(&|i| row(i).mass_kg, 0.0, padded),
            inertia: column(&|i| row(i).inertia_kg_m2, 0.0, padded),
            inverse_mass: column(&|i| 1.0 / row(i).mass_kg, 0.0, padded),
            inverse_inertia,
            bush_on_front,
            bush_lever: column(&|j| half_pitch(carrier(j)) * (2.0 * on_front(j) - 1.0), 0.0, padded),
            bush_inverse_mass: column(&|j| 1.0 / row(carrier(j)).mass_kg, 0.0, padded),
            bush_inverse_inertia: column(&|j| 1.0 / row(carrier(j)).inertia_kg_m2, 0.0, padded),
            joints: vec![joint],
            tight: Vec::new(),
        };
        chain.append_rollers();
        chain
    }

    /// Rollers of all loops, behind their links.
    fn append_rollers(&mut self) {
        for (own, shape) in self.loops.iter().zip(&self.roller_shapes) {
            let Some(shape) = shape else {
                self.rollers.push(0..0);
                continue;
            };
            let first = (self.lanes + 1).next_multiple_of(LANES) + LANES;
            let rollers = first..first + own.len();
            self.lanes = rollers.end;
            self.padded = self.lanes.next_multiple_of(LANES);
            // `ahead`: by how much a column stands further back.
            let extend = |column: &mut AlignedColumn, inert: f64, own: f64, more: usize, ahead: usize| {
                column.resize(self.padded + more, inert);
                column[rollers.start + ahead..rollers.end + ahead].fill(own);
            };
            let (inverse_mass, inverse_inertia) = (1.0 / shape.mass_kg, 1.0 / shape.inertia_kg_m2);
            extend(&mut self.lever, 0.0, 0.0, 0, 0);
            extend(&mut self.mass, 0.0, shape.mass_kg, 0, 0);
            extend(&mut self.inertia, 0.0, shape.inertia_kg_m2, 0, 0);
            extend(&mut self.inverse_mass, 0.0, inverse_mass, 0, 0);
            extend(&mut self.inverse_inertia, 0.0, inverse_inertia, 1, 0);
            extend(&mut self.bush_on_front, 1.0, 1.0, 1, 1);
            extend(&mut self.bush_lever, 0.0, 0.0, 0, 0);
            extend(&mut self.bush_inverse_mass, 0.0, inverse_mass, 0, 0);
            extend(&mut self.bush_inverse_inertia, 0.0, inverse_inertia, 0, 0);
            self.rollers.push(rollers);
        }
        self.held_lanes =
            (0..self.padded).step_by(LANES).map(|at| std::array::from_fn(|i| self.is_body(at + i))).collect();
        self.full_blocks = self.held_lanes.iter().map(|held| *held == [true; LANES]).collect();
    }

    /// A chain without link bodies.
    pub fn without_links(joint: LinkJoint) -> ChainModel {
        ChainModel {
            n_links: 0,
            loops: std::iter::once(0..0).collect(),
            rollers: std::iter::once(0..0).collect(),
            roller_shapes: vec![None],
            lanes: 0,
            padded: 0,
            full_blocks: Vec::new(),
            held_lanes: Vec::new(),
            lever: AlignedColumn::default(),
            mass: AlignedColumn::default(),
            inertia: AlignedColumn::default(),
            inverse_mass: AlignedColumn::default(),
            inverse_inertia: AlignedColumn::default(),
            bush_on_front: AlignedColumn::default(),
            bush_lever: AlignedColumn::default(),
            bush_inverse_mass: AlignedColumn::default(),
            bush_inverse_inertia: AlignedColumn::default(),
            joints: vec![joint],
            tight: Vec::new(),
        }
    }

    /// Lanes up to the last link of the last loop that has any.
    pub fn lanes_of(loops: &[Range<usize>]) -> usize {
        loops.iter().rfind(|l| !l.is_empty()).map_or(0, |l| l.end)
    }

    /// Chains behind each other; one without links stands on no block.
    pub fn join(chains: &[ChainModel]) -> ChainModel {
        let mut loops: Vec<Range<usize>> = Vec::new();
        for c in chains {
            let first = loops.last().map_or(0, |l| match c.n_links {
                0 => l.end.next_multiple_of(LANES),
                _ => (l.end + 1).next_multiple_of(LANES) + LANES,
            });
            loops.push(first..first + c.n_links);
        }
        let lanes = ChainModel::lanes_of(&loops);
        let padded = lanes.next_multiple_of(LANES);
        // `more`: values behind those of the links that belong to a chain.
        let joined = |of: &dyn Fn(&ChainModel) -> &[f64], inert: f64, more: usize| {
            let mut column = AlignedColumn::of(inert, padded + more);
            for (c, own) in chains.iter().zip(&loops).filter(|(_, own)| !own.is_empty()) {
                column[own.start..own.end + more].copy_from_slice(&of(c)[..c.n_links + more]);
            }
            column
        };
        let first = |k: usize| loops[k].start;
        let tight = chains.iter().enumerate().flat_map(|(k, c)| c.tight.iter().map(move |(j, t)| (first(k) + j, *t)));
        let mut joined = ChainModel {
            n_links: chains.iter().map(|c| c.n_links).sum(),
            lanes,
            padded,
            full_blocks: Vec::new(),
            held_lanes: Vec::new(),
            lever: joined(&|c| &c.lever, 0.0, 0),
            mass: joined(&|c| &c.mass, 0.0, 0),
            inertia: joined(&|c| &c.inertia, 0.0, 0),
            inverse_mass: joined(&|c| &c.inverse_mass, 0.0, 0),
            inverse_inertia: joined(&|c| &c.inverse_inertia, 0.0, 1),
            bush_on_front: joined(&|c| &c.bush_on_front, 1.0, 1),
            bush_lever: joined(&|c| &c.bush_lever, 0.0, 0),
            bush_inverse_mass: joined(&|c| &c.bush_inverse_mass, 0.0, 0),
            bush_inverse_inertia: joined(&|c| &c.bush_inverse_inertia, 0.0, 0),
            joints: chains.iter().flat_map(|c| c.joints.iter().copied()).collect(),
            tight: tight.collect(),
            rollers: Vec::new(),
            roller_shapes: chains.iter().flat_map(|c| c.roller_shapes.iter().copied()).collect(),
            loops,
        };
        joined.append_rollers();
        joined
    }

    /// The loop that a lane belongs to; the last one for lanes behind it.
    #[inline(always)]
    pub fn loop_of(&self, lane: usize) -> usize {
        let of_roller = || self.rollers.iter().position(|r| r.contains(&lane));
        let of_link = self.loops.iter().position(|l| lane < l.end);
        of_link.or_else(of_roller).unwrap_or(self.loops.len().saturating_sub(1))
    }

    /// Lanes of what the teeth touch at the joints of a chain: its rollers, where they are bodies, or the bushes by their joints.
    pub fn bush_lanes(&self, chain: usize) -> Range<usize> {
        let rollers = &self.rollers[chain];
        if rollers.is_empty() { self.loops[chain].clone() } else { rollers.clone() }
    }

    /// Whether any chain has rollers that are bodies.
    pub fn has_rollers(&self) -> bool {
        self.rollers.iter().any(|r| !r.is_empty())
    }

    /// Lanes of all rollers, in the order of the joints of their chains.
    pub fn all_rollers(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        self.rollers.iter().cloned().flatten()
    }

    /// Whether a lane holds a roller.
    pub fn is_roller(&self, lane: usize) -> bool {
        self.rollers.iter().any(|r| r.contains(&lane))
    }

    /// Lane of the joint whose bush carries the roller in this lane; any other lane as it is.
    pub fn joint_of(&self, lane: usize) -> usize {
        // Rollers stand behind all links.
        if self.loops.last().is_none_or(|l| lane < l.end) {
            return lane;
        }
        let own = self.rollers.iter().zip(&self.loops).find(|(r, _)| r.contains(&lane));
        own.map_or(lane, |(r, l)| l.start + lane - r.start)
    }

    /// The lane that remembers what the bush of this joint, or its roller, does at the teeth.
    pub fn bush_lane(&self, joint: usize) -> usize {
        let own = self.rollers.iter().zip(&self.loops).find(|(r, l)| !r.is_empty() && l.contains(&joint));
        own.map_or(joint, |(r, l)| r.start + joint - l.start)
    }

    /// Lanes of all links, then of all rollers.
    pub fn bodies(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        self.loops.iter().chain(&self.rollers).cloned().flatten()
    }

    /// Whether a lane holds a link or a roller.
    pub fn is_body(&self, lane: usize) -> bool {
        self.is_link(lane) || self.is_roller(lane)
    }

    /// Blocks that hold the links of a loop.
    pub fn blocks_of(&self, chain: usize) -> Range<usize> {
        let own = &self.loops[chain];
        own.start / LANES..own.end.div_ceil(LANES)
    }

    /// Half the longest pitch of a loop [m].
    pub fn longest_lever_m(&self, chain: usize) -> f64 {
        self.lever[self.loops[chain].clone()].iter().copied().fold(0.0, f64::max)
    }

    /// Whether a lane holds a link.
    pub fn is_link(&self, lane: usize) -> bool {
        self.loops.iter().any(|l| l.contains(&lane))
    }

    /// Lanes of all links, in their order.
    pub fn links(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        self.loops.iter().cloned().flatten()
    }

    /// Joint law between a link and the next.
    pub fn joint(&self, lane: usize) -> &LinkJoint {
        &self.joints[self.loop_of(lane)]
    }

    /// The link ahead of one, and the one behind it.
    pub fn next(&self, lane: usize) -> usize {
        let own = &self.loops[self.loop_of(lane)];
        if lane + 1 == own.end { own.start } else { lane + 1 }
    }

    /// Lane of the link behind.
    pub fn previous(&self, lane: usize) -> usize {
        let own = &self.loops[self.loop_of(lane)];
        if lane == own.start { own.end - 1 } else { lane - 1 }
    }

    /// Which of the lanes from `at` hold links or rollers; None: all of them.
    #[inline(always)]
    pub fn link_lanes(&self, at: usize) -> Option<[bool; LANES]> {
        if self.full_blocks[at / LANES] { None } else { Some(self.held_lanes[at / LANES]) }
    }

    /// Number of a link, counted over all loops, and its lane.
    pub fn number_of(&self, lane: usize) -> usize {
        let k = self.loop_of(lane);
        self.loops[..k].iter().map(Range::len).sum::<usize>() + lane - self.loops[k].start
    }

    /// Lane of a link, counted through all chains.
    pub fn lane_of(&self, link: usize) -> usize {
        let mut left = link;
        for l in &self.loops {
            if left < l.len() {
                return l.start + left;
            }
            left -= l.len();
        }
        self.lanes
    }

    /// Pitches that scatter: every link longer or shorter by a normally distributed length of standard deviation `sigma_m`.
    pub fn scatter(&mut self, sigma_m: f64, seed: u64) {
        let mut random = SplitMix(seed);
        for i in self.links().collect::<Vec<_>>() {
            // Box-Muller; both halves of the pair would do, one is taken.
            let radius = libm::sqrt(-2.0 * libm::log(1.0 - random.uniform()));
            let deviation = radius * crate::units::sin_cos(2.0 * std::f64::consts::PI * random.uniform()).1;
            self.lever[i] += 0.5 * sigma_m * deviation;
        }
        self.renew_bush_levers();
    }

    /// Makes link `i` longer.
    pub fn lengthen(&mut self, i: usize, length_m: f64) {
        self.lever[i] += 0.5 * length_m;
        self.renew_bush_levers();
    }

    /// Makes link `i` heavier by these factors.
    pub fn weigh(&mut self, i: usize, mass: f64, inertia: f64) {
        self.mass[i] *= mass;
        self.inertia[i] *= inertia;
        self.inverse_mass[i] = 1.0 / self.mass[i];
        self.inverse_inertia[i] = 1.0 / self.inertia[i];
        if let Some(l) = self.loops.iter().find(|l| l.start == i) {
            self.inverse_inertia[l.end] = self.inverse_inertia[i];
        }
        // Bushes that are no rollers have the mass of their link.
        for j in [self.previous(i), i] {
            if self.bush_carrier(j).0 == i && !self.is_roller(self.bush_lane(j)) {
                self.bush_inverse_mass[j] = self.inverse_mass[i];
                self.bush_inverse_inertia[j] = self.inverse_inertia[i];
            }
        }
    }

    fn renew_bush_levers(&mut self) {
        for j in self.links().collect::<Vec<_>>() {
            let (link, front) = self.bush_carrier(j);
            self.bush_lever[j] = if front { self.lever[link] } else { -self.lever[link] };
        }
    }

    /// Link that carries the bush of joint `j`, or of the roller in lane `j`, and whether at its front.
    pub fn bush_carrier(&self, j: usize) -> (usize, bool) {
        let j = self.joint_of(j);
        let front = self.bush_on_front[j + 1] == 1.0;
        (if front { j } else { self.next(j) }, front)
    }

    /// Holds link `i` still: a body of infinite mass.
    pub fn fix_link(&mut self, i: usize) {
        self.inverse_mass[i] = 0.0;
        self.inverse_inertia[i] = 0.0;
        if let Some(l) = self.loops.iter().find(|l| l.start == i) {
            self.inverse_inertia[l.end] = 0.0;
        }
    }
}
