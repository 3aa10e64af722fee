//! A drive of several chains: what belongs to each, which drives which, and what turns.

use super::bearings::BearingSpec;
use super::mechanism::{PassageLaw, SliderSpec};
use super::valves::ValveSpec;
use super::{ChainFidelity, ChainSpec, Drive, OuterSpec, PreloadSpec};
use crate::recording::columns::Rows;

/// How often something repeats while something else does once: a fraction in lowest terms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RateRatio {
    /// How often.
    pub times: u64,
    /// While the other does so often.
    pub in_times: u64,
}

/// Greatest common divisor.
pub fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

impl RateRatio {
    /// `times` in `in_times`, which is not zero.
    pub fn new(times: u64, in_times: u64) -> RateRatio {
        let common = gcd(times, in_times).max(1);
        RateRatio { times: times / common, in_times: in_times / common }
    }

    /// This many times as often, over that many times.
    pub fn scaled(self, times: u32, in_times: u32) -> RateRatio {
        RateRatio::new(self.times * u64::from(times), self.in_times * u64::from(in_times))
    }

    /// After how many of the other this has been done a multiple of `every` times.
    pub fn period(self, every: u32) -> u32 {
        let all = u64::from(every) * self.in_times;
        u32::try_from(all / gcd(all, self.times).max(1)).unwrap_or(u32::MAX)
    }

    /// As a number.
    pub fn value(self) -> f64 {
        self.times as f64 / self.in_times as f64
    }
}

impl Drive {
    /// Number of chains.
    pub fn chains(&self) -> usize {
        1 + self.more.len()
    }

    /// Sprockets of a chain.
    pub fn sprockets_of(&self, chain: usize) -> std::ops::Range<usize> {
        let first = self.sprockets.iter().position(|s| s.chain == chain).unwrap_or(0);
        first..first + self.sprockets.iter().filter(|s| s.chain == chain).count()
    }

    /// Type and dimensions of the links of a chain.
    pub fn chain_of(&self, chain: usize) -> &ChainSpec {
        if chain == 0 { &self.chain } else { &self.more[chain - 1].chain }
    }

    /// How a chain is tightened.
    pub fn preload_of(&self, chain: usize) -> &PreloadSpec {
        if chain == 0 { &self.preload } else { &self.more[chain - 1].preload }
    }

    /// Number of links of every chain.
    pub fn links_of(&self, chain: usize) -> usize {
        if chain == 0 { self.links } else { self.more[chain - 1].links }
    }

    /// What a chain is made of.
    pub fn fidelity_of(&self, chain: usize) -> ChainFidelity {
        if chain == 0 { self.fidelity } else { self.more[chain - 1].fidelity }
    }

    /// Number of bodies that the links of a chain are: none of a chain of spans. Links and joints are numbered by these through all chains.
    pub fn link_bodies_of(&self, chain: usize) -> usize {
        match self.fidelity_of(chain) {
            ChainFidelity::Links => self.links_of(chain),
            ChainFidelity::Spans => 0,
        }
    }

    /// Paths of the spans of all chains of spans, in the order of the chains: each leaves one sprocket and reaches the next.
    pub fn span_paths(&self) -> Vec<String> {
        let of_chain = |chain: usize| {
            let own = self.sprockets_of(chain);
            let name = |k: usize| &self.sprockets[own.start + k % own.len()].name;
            let path = |k: usize| format!("chains.{}.spans.{}-{}", self.chain_names[chain], name(k), name(k + 1));
            (0..own.len()).map(path).collect::<Vec<_>>()
        };
        (0..self.chains()).filter(|chain| self.fidelity_of(*chain) == ChainFidelity::Spans).flat_map(of_chain).collect()
    }

    /// The drive of one of its chains: what belongs to others is not there. A shaft that turns another chain before it turns this one with
    /// its speed.
    pub fn single_chain(&self, chain: usize) -> Drive {
        let mut alone = self.clone();
        if self.more.is_empty() {
            return alone;
        }
        let own = self.sprockets_of(chain);
        let first_link: usize = (0..chain).map(|c| self.link_bodies_of(c)).sum();
        let links = first_link..first_link + self.link_bodies_of(chain);
        if chain > 0 {
            let part = &self.more[chain - 1];
            (alone.chain, alone.links, alone.scatter, alone.joint) = (part.chain, part.links, part.scatter, part.joint);
            (alone.tooth_contact, alone.guide_contact, alone.ring_contact) =
                (part.tooth_contact, part.guide_contact, part.ring_contact);
            alone.roller_contact = part.roller_contact;
            (alone.preload, alone.fidelity) = (part.preload, part.fidelity);
        }
        alone.more.clear();
        alone.valves.clear();
        alone.chain_names.clear();
        alone.places = self.places.within(&format!("chains.{}", self.chain_names[chain]));
        alone.sprockets = self.sprockets[own.clone()].to_vec();
        let leader = self.leader_of(chain);
        for (k, s) in alone.sprockets.iter_mut().enumerate() {
            s.chain = 0;
            s.passes_on_nm = self.passed_on_nm(own.start + k);
            s.outer = match s.outer {
                OuterSpec::Speed { .. } => s.outer,
                OuterSpec::Load { .. } if own.start + k == leader => {
                    OuterSpec::Speed { speed_rad_s: self.shaft_speed_rad_s(leader) }
                }
                OuterSpec::Load { .. } => s.outer,
            };
        }
        if let PreloadSpec::Sprocket { moves, .. } = &mut alone.preload {
            *moves -= own.start;
        }
        let kept: Vec<usize> = (0..self.arms.len())
            .filter(|a| self.rails.iter().any(|r| r.arm == Some(*a) && own.contains(&r.span)))
            .collect();
        let arm = |a: usize| kept.iter().position(|k| *k == a).unwrap_or(0);
        alone.arms = kept.iter().map(|a| self.arms[*a].clone()).collect();
        if let PreloadSpec::Arm(a) = &mut alone.preload {
            *a = arm(*a);
        }
        alone.sliders.retain(|s| kept.contains(&s.arm));
        alone.sliders.iter_mut().for_each(|s| s.arm = arm(s.arm));
        alone.guides.retain(|g| own.contains(&g.span));
        alone.guides.iter_mut().for_each(|g| g.span -= own.start);
        // A guide or rail of this chain, counted among its own.
        let own_guide = |k: usize| own.contains(&self.guides[k].span);
        let own_rail = |k: usize| own.contains(&self.rails[k].span);
        alone.bearings = self.bearings_of(
            &own,
            |k| own_guide(k).then(|| (0..k).filter(|g| own_guide(*g)).count()),
            |k| own_rail(k).then(|| (0..k).filter(|r| own_rail(*r)).count()),
        );
        alone.rails.retain(|r| own.contains(&r.span));
        for r in &mut alone.rails {
            (r.span, r.arm) = (r.span - own.start, r.arm.map(arm));
        }
        let e = &mut alone.effects;
        e.gap_errors.retain(|g| own.contains(&g.sprocket));
        e.gap_errors.iter_mut().for_each(|g| g.sprocket -= own.start);
        e.gap_waves.retain(|w| own.contains(&w.sprocket));
        e.gap_waves.iter_mut().for_each(|w| w.sprocket -= own.start);
        e.pitch_errors.retain(|p| links.contains(&p.link));
        e.pitch_errors.iter_mut().for_each(|p| p.link -= links.start);
        e.link_masses.retain(|m| links.contains(&m.link));
        e.link_masses.iter_mut().for_each(|m| m.link -= links.start);
        e.tight_joints.retain(|t| links.contains(&t.joint));
        e.tight_joints.iter_mut().for_each(|t| t.joint -= links.start);
        alone.spans.retain(|s| s.chain == chain);
        alone.spans.iter_mut().for_each(|s| s.chain = 0);
        alone.sensors.clear();
        alone
    }

    /// The sprocket that drives a chain: with the prescribed speed, or on a shaft that a chain before it turns.
    pub fn leader_of(&self, chain: usize) -> usize {
        let own = self.sprockets_of(chain);
        let turned_before = |k: &usize| {
            let shaft = self.sprockets[*k].shaft;
            shaft.is_some() && self.sprockets[..own.start].iter().any(|s| s.shaft == shaft)
        };
        let prescribed = |k: &usize| matches!(self.sprockets[*k].outer, OuterSpec::Speed { .. });
        own.clone().find(prescribed).or_else(|| own.clone().find(turned_before)).unwrap_or(own.start)
    }

    /// What the chains that a sprocket's shaft drives take from it [N m].
    fn passed_on_nm(&self, sprocket: usize) -> f64 {
        let s = &self.sprockets[sprocket];
        let driven = (s.chain + 1..self.chains()).filter(|chain| {
            let leader = &self.sprockets[self.leader_of(*chain)];
            leader.shaft.is_some() && leader.shaft == s.shaft
        });
        driven.map(|chain| self.taken_nm(chain)).sum()
    }

    /// What the constant loads of a chain, and of those behind it, take from its leader [N m].
    fn taken_nm(&self, chain: usize) -> f64 {
        let leader = self.leader_of(chain);
        let others = self.sprockets_of(chain).filter(|k| *k != leader);
        let taken = |k: usize| {
            let own_nm = match self.sprockets[k].outer {
                OuterSpec::Load { torque_nm, .. } => torque_nm,
                OuterSpec::Speed { .. } => 0.0,
            };
            let teeth = |k: usize| f64::from(self.sprockets[k].teeth);
            (own_nm + self.passed_on_nm(k)) * teeth(leader) / teeth(k)
        };
        others.map(taken).sum()
    }

    /// Nominal speed of a sprocket in the sense in which its chain moves forwards [rad/s].
    fn shaft_speed_rad_s(&self, sprocket: usize) -> f64 {
        let s = &self.sprockets[sprocket];
        if let OuterSpec::Speed { speed_rad_s } = s.outer {
            return speed_rad_s;
        }
        let leader = self.leader_of(s.chain);
        if sprocket != leader {
            let (from, to) = (&self.sprockets[leader], s);
            return self.shaft_speed_rad_s(leader) * f64::from(from.teeth) / f64::from(to.teeth);
        }
        // Turned by a chain before this one, in the sense of the sprocket on that chain.
        let other = self.sprockets.iter().position(|o| o.chain < s.chain && o.shaft == s.shaft && s.shaft.is_some());
        other.map_or(0.0, |o| self.shaft_speed_rad_s(o) * self.sprockets[o].wrap.sign() * s.wrap.sign())
    }

    /// Turns of a sprocket while the driver's chain moves by one pitch, without slip. None: nothing turns its chain.
    pub fn turns_per_pitch(&self, sprocket: usize) -> Option<RateRatio> {
        let s = &self.sprockets[sprocket];
        if let OuterSpec::Speed { .. } = s.outer {
            return Some(RateRatio::new(1, u64::from(self.sprockets[self.driver()].teeth)));
        }
        let leader = self.leader_of(s.chain);
        if sprocket != leader {
            return Some(self.turns_per_pitch(leader)?.scaled(self.sprockets[leader].teeth, s.teeth));
        }
        let other = self.sprockets.iter().position(|o| o.chain < s.chain && o.shaft == s.shaft && s.shaft.is_some());
        self.turns_per_pitch(other?)
    }

    /// Nominal speed of a sprocket, positive counter-clockwise [rad/s].
    pub fn nominal_speed_rad_s(&self, sprocket: usize) -> f64 {
        self.shaft_speed_rad_s(sprocket) * self.sprockets[sprocket].wrap.sign()
    }

    /// Rows of what turns: shafts and sprockets in the order of the chains, then arms, then shafts without sprockets, then modes of elastic
    /// shafts, then backs of arms that give way. Paths in the file.
    pub fn coordinate_paths(&self) -> Vec<String> {
        let mut paths: Vec<String> = Vec::new();
        for s in &self.sprockets {
            let path = s
                .shaft
                .filter(|_| !self.more.is_empty())
                .map_or(format!("sprockets.{}", s.name), |k| format!("shafts.{}", self.shafts[k].name));
            if !paths.contains(&path) {
                paths.push(path);
            }
        }
        // Arms in the order of the chains whose rails they carry.
        for chain in 0..self.chains() {
            let own = self.single_chain(chain).arms;
            paths.extend(own.iter().map(|a| format!("arms.{}", a.name)));
        }
        paths.extend(self.bare_shafts().into_iter().map(|k| format!("shafts.{}", self.shafts[k].name)));
        paths.extend(self.elastic_shafts.iter().flat_map(|s| s.mode_paths()));
        paths.extend(self.effects.arms.iter().map(|a| a.path.clone()));
        paths
    }

    /// Paths of what slides or touches, and of oil, in the order of the tables of frames that have a row for each; none for other tables.
    pub fn row_paths(&self, rows: Rows) -> Vec<String> {
        let oil = self.oil_with_effects();
        let passages = || oil.iter().flat_map(|oil| &oil.passages);
        let balls = || passages().filter(|p| matches!(p.law, PassageLaw::Check(_)));
        let mut paths = Vec::new();
        match rows {
            Rows::Link | Rows::Joint | Rows::Roller | Rows::Contact | Rows::Rotor => {}
            Rows::Slider => {
                for chain in 0..self.chains() {
                    paths.extend(self.single_chain(chain).sliders.iter().map(|s| format!("sliders.{}", s.name)));
                }
                paths.extend(self.valves.iter().flat_map(ValveSpec::slider_paths));
                paths.extend(balls().map(|p| p.path.clone()));
                paths.extend(self.ratchets().map(|s| format!("sliders.{}_pawl", s.name)));
                let sides = |b: &BearingSpec| ["along", "across"].map(|side| format!("{}.{side}", b.path));
                paths.extend(self.bearings.iter().flat_map(sides));
                paths.extend(self.effects.mounts().map(|(_, mount)| mount.path.clone()));
                for (rail, bending) in self.rails.iter().filter_map(|r| Some((r, r.bending.as_ref()?))) {
                    let mode = |n: usize| format!("guides.rail.{}.bending.{n}", rail.name);
                    paths.extend((1..=bending.modes).map(mode));
                }
            }
            Rows::Touch => {
                for chain in 0..self.chains() {
                    paths.extend(self.single_chain(chain).touch_paths());
                }
                paths.extend(self.valves.iter().flat_map(ValveSpec::touch_paths));
                paths.extend(balls().flat_map(|p| ["seat", "stop"].map(|end| format!("{}.{end}", p.path))));
                paths.extend(self.ratchets().map(|s| format!("sliders.{}.ratchet", s.name)));
            }
            Rows::Chamber => {
                let oil = oil.iter();
                paths.extend(oil.clone().flat_map(|o| &o.chambers).map(|c| format!("chambers.{}", c.name)));
                paths.extend(oil.flat_map(|o| &o.reservoirs).map(|(name, _)| format!("reservoirs.{name}")));
            }
            Rows::Passage => paths.extend(passages().map(|p| p.path.clone())),
            Rows::Span => paths = self.span_paths(),
        }
        paths
    }

    /// Sliders with a ratchet.
    fn ratchets(&self) -> impl Iterator<Item = &SliderSpec> {
        self.sliders.iter().filter(|s| s.ratchet.is_some() && self.tip_contact.is_some())
    }

    /// Stops of arms, then tips and stops of sliders, of a drive with one chain.
    fn touch_paths(&self) -> Vec<String> {
        let given = |path: String, key: &str, limit: Option<f64>| limit.map(|_| format!("{path}.{key}"));
        let mut paths = Vec::new();
        for arm in self.arms.iter().filter(|_| self.stop_contact.is_some()) {
            let path = || format!("arms.{}", arm.name);
            paths.extend(given(path(), "low_deg", arm.low_rad));
            paths.extend(given(path(), "high_deg", arm.high_rad));
        }
        for slider in self.sliders.iter().filter(|_| self.tip_contact.is_some()) {
            let path = || format!("sliders.{}", slider.name);
            paths.push(format!("{}.tip", path()));
            paths.extend(given(path(), "low_mm", slider.low_m));
            paths.extend(given(path(), "high_mm", slider.high_m));
        }
        paths
    }

    /// Sprockets and what else turns, by their paths, each with its row among [`Drive::coordinate_paths`].
    pub fn turning_paths(&self) -> Vec<(String, usize)> {
        let paths = self.coordinate_paths();
        let row = |path: &String| paths.iter().position(|p| p == path);
        let on_shaft = self.sprockets.iter().filter_map(|s| {
            let path = format!("sprockets.{}", s.name);
            let shaft = s.shaft.map(|k| format!("shafts.{}", self.shafts[k].name));
            let found = row(&path).or_else(|| row(&shaft?))?;
            Some((path, found))
        });
        let own = paths.iter().enumerate().filter(|(_, p)| !p.starts_with("sprockets."));
        on_shaft.chain(own.map(|(row, path)| (path.clone(), row))).collect()
    }
}
