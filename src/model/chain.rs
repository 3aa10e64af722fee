//! The chain's columns: one value per link, padded with inert links.

use crate::elements::link_joint::LinkJoint;
use crate::geometry::chain::LinkShape;

/// The chain: one value per link, padded.
#[derive(Clone, Debug, PartialEq)]
pub struct ChainModel {
    pub n_links: usize,
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
    pub joint: LinkJoint,
    /// Joints that turn hard, and the torque of their friction [N m].
    pub tight: Vec<(usize, f64)>,
}

impl ChainModel {
    /// A closed chain of alternating rows, the first row carrying the bushes.
    pub fn new(n_links: usize, rows: &[LinkShape], joint: LinkJoint, lane_width: usize) -> ChainModel {
        let padded = n_links.div_ceil(lane_width) * lane_width;
        let row = |i: usize| &rows[i % rows.len()];
        let column = |f: &dyn Fn(usize) -> f64, inert: f64, len: usize| -> Vec<f64> {
            (0..len).map(|i| if i < n_links { f(i) } else { inert }).collect()
        };
        let carrier = |j: usize| if row(j).bush_radius_m.is_some() { j } else { (j + 1) % n_links };
        let on_front = |j: usize| if carrier(j) == j { 1.0 } else { 0.0 };
        let mut inverse_inertia = column(&|i| 1.0 / row(i).inertia_kg_m2, 0.0, padded + 1);
        inverse_inertia[n_links] = inverse_inertia[0];
        let mut bush_on_front = vec![1.0; padded + 1];
        for j in 0..n_links {
            bush_on_front[j + 1] = on_front(j);
        }
        bush_on_front[0] = on_front(n_links - 1);
        let half_pitch = |i: usize| 0.5 * row(i).pitch_m;
        ChainModel {
            n_links,
            padded,
            lever: column(&half_pitch, 0.0, padded),
            mass: column(&|i| row(i).mass_kg, 0.0, padded),
            inertia: column(&|i| row(i).inertia_kg_m2, 0.0, padded),
            inverse_mass: column(&|i| 1.0 / row(i).mass_kg, 0.0, padded),
            inverse_inertia,
            bush_on_front,
            bush_lever: column(&|j| half_pitch(carrier(j)) * (2.0 * on_front(j) - 1.0), 0.0, padded),
            bush_inverse_mass: column(&|j| 1.0 / row(carrier(j)).mass_kg, 0.0, padded),
            bush_inverse_inertia: column(&|j| 1.0 / row(carrier(j)).inertia_kg_m2, 0.0, padded),
            joint,
            tight: Vec::new(),
        }
    }

    /// Pitches that scatter: every link longer or shorter by a normally distributed length of standard deviation `sigma_m`.
    pub fn scatter(&mut self, sigma_m: f64, seed: u64) {
        let mut random = SplitMix(seed);
        for i in 0..self.n_links {
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
        for j in 0..self.n_links {
            let (link, front) = self.bush_carrier(j);
            self.bush_lever[j] = if front { self.lever[link] } else { -self.lever[link] };
        }
    }

    /// Link that carries the bush of joint `j`, and whether at its front.
    pub fn bush_carrier(&self, j: usize) -> (usize, bool) {
        let front = self.bush_on_front[j + 1] == 1.0;
        (if front { j } else { (j + 1) % self.n_links }, front)
    }

    /// Holds link `i` still: a body of infinite mass.
    pub fn hold(&mut self, i: usize) {
        self.inverse_mass[i] = 0.0;
        self.inverse_inertia[i] = 0.0;
        if i == 0 {
            self.inverse_inertia[self.n_links] = 0.0;
        }
    }
}

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
