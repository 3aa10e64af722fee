//! The columns of all chains: one value per lane. Closed loops of links stand behind each other, each on blocks of its own; lanes that hold
//! no link are inert. Between two loops there are two of them at least: behind the last link of one stands its first again while
//! joints are computed, before the first link of the other its last joint.

use crate::elements::link_joint::LinkJoint;
use crate::elements::tooth_contact::LANES;
use crate::geometry::chain::LinkShape;
use std::ops::Range;

/// All chains: one value per lane, padded.
#[derive(Clone, Debug, PartialEq)]
pub struct ChainModel {
    /// Of all loops.
    pub n_links: usize,
    /// Lanes of the links of every loop.
    pub loops: Vec<Range<usize>>,
    /// Lanes up to the last link of the last loop.
    pub lanes: usize,
    /// Length of the columns.
    pub padded: usize,
    /// Half the pitch [m]: lever of both joints.
    pub lever: Vec<f64>,
    pub mass: Vec<f64>,
    pub inertia: Vec<f64>,
    pub inverse_mass: Vec<f64>,
    /// One value longer: the first link's again at `n_links`.
    pub inverse_inertia: Vec<f64>,
    /// 1 where the bush of joint j belongs to link j, 0 where to link j + 1; shifted by one: index 0 is the last joint.
    pub bush_on_front: Vec<f64>,
    /// Of the link that carries the bush of joint j: signed lever, inverse mass and inertia.
    pub bush_lever: Vec<f64>,
    pub bush_inverse_mass: Vec<f64>,
    pub bush_inverse_inertia: Vec<f64>,
    /// Of every loop.
    pub joints: Vec<LinkJoint>,
    /// Joints that turn hard, and the torque of their friction [N m].
    pub tight: Vec<(usize, f64)>,
}

impl ChainModel {
    /// A closed chain of alternating rows, the first row carrying the bushes.
    pub fn new(n_links: usize, rows: &[LinkShape], joint: LinkJoint, lane_width: usize) -> ChainModel {
        ChainModel::of_loops(&[(n_links, rows, joint)], lane_width)
    }

    /// Several of them: number of links, rows and joints of each.
    pub fn of_loops(chains: &[(usize, &[LinkShape], LinkJoint)], lane_width: usize) -> ChainModel {
        let mut loops: Vec<Range<usize>> = Vec::new();
        for (n, ..) in chains {
            let first = loops.last().map_or(0, |l| (l.end + LANES_BETWEEN).next_multiple_of(lane_width));
            loops.push(first..first + n);
        }
        let lanes = loops.last().map_or(0, |l| l.end);
        let padded = lanes.next_multiple_of(lane_width);
        let own = |i: usize| loops.iter().position(|l| l.contains(&i));
        // Loops begin on whole blocks, so that lanes count rows from their own first link.
        let row = |i: usize| own(i).map(|k| &chains[k].1[(i - loops[k].start) % chains[k].1.len()]);
        let column = |f: &dyn Fn(&LinkShape) -> f64, inert: f64, len: usize| -> Vec<f64> {
            (0..len).map(|i| row(i).map_or(inert, f)).collect()
        };
        let next = |j: usize| own(j).filter(|k| j + 1 == loops[*k].end).map_or(j + 1, |k| loops[k].start);
        let carrier = |j: usize| if row(j).is_none_or(|r| r.bush_radius_m.is_some()) { j } else { next(j) };
        let on_front = |j: usize| if carrier(j) == j { 1.0 } else { 0.0 };
        let mut inverse_inertia = column(&|r| 1.0 / r.inertia_kg_m2, 0.0, padded + 1);
        let mut bush_on_front = vec![1.0; padded + 1];
        for j in 0..lanes {
            bush_on_front[j + 1] = on_front(j);
        }
        for l in &loops {
            inverse_inertia[l.end] = inverse_inertia[l.start];
            bush_on_front[l.start] = on_front(l.end - 1);
        }
        let of_carrier = |f: &dyn Fn(&LinkShape) -> f64| -> Vec<f64> {
            (0..padded).map(|j| row(j).and_then(|_| row(carrier(j))).map_or(0.0, f)).collect()
        };
        let signs: Vec<f64> = (0..padded).map(|j| 2.0 * on_front(j) - 1.0).collect();
        ChainModel {
            n_links: chains.iter().map(|c| c.0).sum(),
            lanes,
            padded,
            lever: column(&|r| 0.5 * r.pitch_m, 0.0, padded),
            mass: column(&|r| r.mass_kg, 0.0, padded),
            inertia: column(&|r| r.inertia_kg_m2, 0.0, padded),
            inverse_mass: column(&|r| 1.0 / r.mass_kg, 0.0, padded),
            inverse_inertia,
            bush_on_front,
            bush_lever: of_carrier(&|r| 0.5 * r.pitch_m).iter().zip(&signs).map(|(l, sign)| l * sign).collect(),
            bush_inverse_mass: of_carrier(&|r| 1.0 / r.mass_kg),
            bush_inverse_inertia: of_carrier(&|r| 1.0 / r.inertia_kg_m2),
            joints: chains.iter().map(|c| c.2).collect(),
            loops,
            tight: Vec::new(),
        }
    }

    /// The loop that a lane belongs to; the last one for lanes behind it.
    #[inline(always)]
    pub fn loop_of(&self, lane: usize) -> usize {
        self.loops.iter().position(|l| lane < l.end).unwrap_or(self.loops.len().saturating_sub(1))
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

    pub fn previous(&self, lane: usize) -> usize {
        let own = &self.loops[self.loop_of(lane)];
        if lane == own.start { own.end - 1 } else { lane - 1 }
    }

    /// Which of the lanes from `at` hold links; None: all of them.
    #[inline(always)]
    pub fn gaps(&self, at: usize) -> Option<[bool; LANES]> {
        let whole = self.loops.iter().any(|l| l.start <= at && at + LANES <= l.end);
        (!whole).then(|| std::array::from_fn(|i| self.is_link(at + i)))
    }

    /// Number of a link, counted over all loops, and its lane.
    pub fn number_of(&self, lane: usize) -> usize {
        let k = self.loop_of(lane);
        self.loops[..k].iter().map(Range::len).sum::<usize>() + lane - self.loops[k].start
    }

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

    fn renew_bush_levers(&mut self) {
        for j in self.links().collect::<Vec<_>>() {
            let (link, front) = self.bush_carrier(j);
            self.bush_lever[j] = if front { self.lever[link] } else { -self.lever[link] };
        }
    }

    /// Link that carries the bush of joint `j`, and whether at its front.
    pub fn bush_carrier(&self, j: usize) -> (usize, bool) {
        let front = self.bush_on_front[j + 1] == 1.0;
        (if front { j } else { self.next(j) }, front)
    }

    /// Holds link `i` still: a body of infinite mass.
    pub fn hold(&mut self, i: usize) {
        self.inverse_mass[i] = 0.0;
        self.inverse_inertia[i] = 0.0;
        if let Some(l) = self.loops.iter().find(|l| l.start == i) {
            self.inverse_inertia[l.end] = 0.0;
        }
    }
}

/// Inert lanes between two loops, at least.
const LANES_BETWEEN: usize = 2;

/// SplitMix64 (Steele, Lea and Flood 2014): the same numbers everywhere from one seed.
struct SplitMix(u64);

impl SplitMix {
    /// In 0 .. 1.
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}
