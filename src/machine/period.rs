//! After how many pitches of the driver's chain a drive with links repeats itself.
//!
//! ```text
//! turns of a sprocket, pitches of a chain: fractions of the pitches of the driver's chain, from the teeth of all sprockets between
//! period = least common multiple of what each part needs: two pitches of every chain of links, and one of
//!          a loop of a chain with an odd link, a turn of a sprocket with an odd tooth, the turns of the driver's orders
//! ```

use super::response::turns_of_orders;
use crate::drive::chains::{RateRatio, gcd};
use crate::drive::sensors::SensorReads;
use crate::drive::shafts::Moving;
use crate::drive::{ChainFidelity, Drive};
use crate::effects::{Effect, speed_fluctuation};
use std::f64::consts::TAU;

/// Least common multiple.
pub(super) fn lcm(a: u32, b: u32) -> u32 {
    let (a, b) = (a.max(1), b.max(1));
    (a / gcd(u64::from(a), u64::from(b)) as u32).saturating_mul(b)
}

/// Periods in pitches of the driver's chain, and what turns or moves on how fast.
#[derive(Clone, Debug)]
pub(super) struct PeriodOfDrive {
    /// If all links and teeth of each part are alike.
    pub(super) alike: u32,
    /// As the drive is declared: what a run is folded on.
    pub(super) declared: u32,
    /// After so many pitches the declared drive looks as before: a share of `declared`, shorter where orders or valves divide their turn evenly.
    pub(super) recurs: u32,
    /// For every body of the machine: its turns per pitch, and its sense; None: it does not turn on.
    pub(super) turns: Vec<Option<(RateRatio, f64)>>,
    /// For every chain with links: its pitches per pitch of the driver's chain.
    pub(super) pitches: Vec<RateRatio>,
}

impl PeriodOfDrive {
    pub(super) fn of(drive: &Drive) -> PeriodOfDrive {
        let sense = if drive.chain_speed_m_s() < 0.0 { -1.0 } else { 1.0 };
        let turning = |k: usize| {
            let own = if drive.nominal_speed_rad_s(k) < 0.0 { -1.0 } else { 1.0 };
            Some((drive.turns_per_pitch(k)?, own * sense))
        };
        let bare = drive.bare_shafts().into_iter().map(|k| turning(drive.sprocket_turning(Moving::Shaft(k))?));
        let sprockets = (0..drive.sprockets.len()).map(turning);
        let others = drive.arms.iter().map(|_| None).chain(drive.sliders.iter().map(|_| None));
        let turns = sprockets.chain(bare).chain(others).collect();
        let of_links = (0..drive.chains()).filter(|chain| drive.fidelity_of(*chain) == ChainFidelity::Links);
        let rate = |chain: usize| {
            let leader = drive.leader_of(chain);
            let turns = drive.turns_per_pitch(leader).unwrap_or(RateRatio::new(1, 1));
            turns.scaled(drive.sprockets[leader].teeth, 1)
        };
        let pitches: Vec<RateRatio> = of_links.clone().map(rate).collect();
        // Inner and outer links alternate in every chain.
        let alike = pitches.iter().fold(2, |all, rate| lcm(all, rate.period(2)));
        let links: Vec<u32> = of_links.map(|chain| drive.links_of(chain) as u32).collect();
        let odd = odd_parts(drive, &pitches, &links);
        let declared = odd.iter().fold(alike, |all, part| lcm(all, part.period));
        // The smallest multiple of the one that is a multiple of period / equal.
        let multiple = |all: u32, part: &OddPart| {
            let often = u64::from(part.period) / gcd(u64::from(all) * u64::from(part.equal), u64::from(part.period));
            all.saturating_mul(often as u32)
        };
        let recurs = odd.iter().fold(alike, multiple);
        PeriodOfDrive { alike, declared, recurs, turns, pitches }
    }

    /// Period of one turn of a body.
    pub(super) fn of_body(&self, body: usize) -> u32 {
        self.turns.get(body).copied().flatten().map_or(1, |(turns, _)| turns.period(1))
    }
}

/// A part of the declared drive that differs from its neighbours.
#[derive(Clone, Copy)]
struct OddPart {
    /// Pitches after which it stands where it stood.
    period: u32,
    /// Into how many equal parts it divides this period: an order of 6 a turn into six.
    equal: u32,
}

/// Parts of the declared drive that differ from their neighbours.
fn odd_parts(drive: &Drive, pitches: &[RateRatio], links: &[u32]) -> Vec<OddPart> {
    let e = &drive.effects;
    let turn = |k: usize| drive.turns_per_pitch(k).map_or(1, |turns| turns.period(1));
    let mut all = Vec::new();
    let mut put = |period: u32, equal: u32| all.push(OddPart { period, equal: equal.max(1) });
    // Links are counted through all chains.
    let has_odd = |chain: usize| {
        let first: u32 = links[..chain].iter().sum();
        let own = first as usize..(first + links[chain]) as usize;
        e.pitch_errors.iter().any(|p| own.contains(&p.link))
            || e.link_masses.iter().any(|m| own.contains(&m.link))
            || e.tight_joints.iter().any(|t| own.contains(&t.joint))
            || drive.sensors.iter().any(|s| matches!(s.reads, SensorReads::Link(i) if own.contains(&i)))
    };
    let with_links = (0..drive.chains()).filter(|chain| drive.fidelity_of(*chain) == ChainFidelity::Links);
    for (place, chain) in with_links.enumerate() {
        if scatter_m(drive, chain) > 0.0 || has_odd(place) {
            put(pitches[place].period(links[place]), 1);
        }
    }
    let driver = drive.driver();
    let motion = &drive.train.motion;
    let orders = motion.harmonics.iter().chain(drive.train.order_loads.iter().flat_map(|l| &l.harmonics));
    if orders.clone().next().is_some() {
        // Orders are of the driver; half ones take two turns. Those without a period are refused where records are compared.
        let turns = turns_of_orders(orders.clone()).unwrap_or(2);
        let waves = orders.map(|h| libm::round(h.order * f64::from(turns)) as u64).fold(0, gcd);
        put(turns * drive.sprockets[driver].teeth, waves as u32);
    }
    let train = &drive.train;
    for (_, values) in &train.motion.fluctuations {
        let (turns, waves) = wave(&speed_fluctuation::ROW, values);
        put(turn(driver) * turns, waves);
    }
    let uneven = train.loads.iter().filter(|l| l.effect.differs_round_turn());
    for (k, load) in uneven.filter_map(|l| Some((drive.sprocket_turning(l.on)?, l))) {
        let (turns, waves) = wave(load.effect, &load.values);
        put(turn(k) * turns, waves);
    }
    for v in &drive.valves {
        put(turn(v.sprocket), alike_valves(&v.phases_rad));
    }
    for k in e.gap_errors.iter().map(|g| g.sprocket).chain(e.gap_waves.iter().map(|w| w.sprocket)) {
        put(turn(k), 1);
    }
    all
}

/// Turns after which an effect on what turns is the same again, two where its order is a half one; and its waves in these turns.
fn wave(effect: &Effect, values: &[f64]) -> (u32, u32) {
    let order = effect.parameters.iter().zip(values).find(|(p, _)| p.key == "order").map_or(1.0, |(_, order)| *order);
    let turns = if order == libm::trunc(order) { 1 } else { 2 };
    (turns, libm::round(order * f64::from(turns)) as u32)
}

/// Most cylinders of a camshaft whose valves may be alike, and how exactly they then lie round it [rad].
const MOST_CYLINDERS: u32 = 12;
const EVENLY_RAD: f64 = 1e-6;

/// Into how many equal parts valves that are alike divide a turn of their camshaft.
fn alike_valves(phases_rad: &[f64]) -> u32 {
    let apart = |a: f64, b: f64| (a - b - TAU * libm::round((a - b) / TAU)).abs();
    let is_same = |parts: &u32| {
        let turned = |phase: &f64| phase + TAU / f64::from(*parts);
        phases_rad.iter().all(|a| phases_rad.iter().any(|b| apart(turned(a), *b) < EVENLY_RAD))
    };
    (1..=MOST_CYLINDERS).rev().find(is_same).unwrap_or(1)
}

/// Standard deviation of the pitch of a chain's links [m].
fn scatter_m(drive: &Drive, chain: usize) -> f64 {
    if chain == 0 { drive.scatter.pitch_m } else { drive.more[chain - 1].scatter.pitch_m }
}

#[cfg(test)]
mod tests {
    use super::{PeriodOfDrive, alike_valves};
    use crate::drive::{BUNDLED, Drive};

    fn period(bundled: usize, sets: &[&str]) -> PeriodOfDrive {
        let (name, text) = BUNDLED[bundled];
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
        PeriodOfDrive::of(&Drive::parse(name, text, &sets).unwrap_or_else(|e| panic!("{e}")))
    }

    /// Orders divide a turn into equal parts, and valves that lie evenly round their shaft do.
    #[test]
    fn orders_and_valves_recur_within_a_turn() {
        let recurs = |of: &PeriodOfDrive| (of.alike, of.recurs, of.declared);
        assert_eq!(recurs(&period(0, &[])), (2, 2, 2));
        let order = |n: &str| {
            let sets = [format!("speeds.constant.driver.orders=[{n}]")];
            let more = ["speeds.constant.driver.amplitudes_deg=[0.1]", "speeds.constant.driver.phases_deg=[0]"];
            recurs(&period(0, &[sets[0].as_str(), more[0], more[1]]))
        };
        // 20 teeth: order 2 recurs after ten pitches, order 5 after four, half an order after two turns, order 6 after twenty thirds: at ten, no
        // pair of links stands as before.
        assert_eq!(
            [order("2"), order("5"), order("0.5"), order("6")],
            [(2, 10, 40), (2, 4, 40), (2, 40, 40), (2, 10, 40)]
        );
        let wave =
            ["effects.speed_fluctuation.driver.amplitude_percent=1", "effects.speed_fluctuation.driver.order=1.5"];
        assert_eq!(recurs(&period(0, &wave)), (2, 40, 40));
        let degrees = |all: &[f64]| alike_valves(&all.iter().map(|x| x.to_radians()).collect::<Vec<f64>>());
        assert_eq!([degrees(&[55.0, 175.0, 295.0]), degrees(&[10.0, -80.0, 100.0, 190.0])], [3, 4]);
        assert_eq!([degrees(&[55.0, 175.0, 296.0]), degrees(&[7.0])], [1, 1]);
    }

    #[test]
    fn a_chain_behind_20_and_40_teeth_takes_two_pitches_while_the_first_takes_four() {
        let one = period(0, &[]);
        assert_eq!((one.alike, one.declared), (2, 2));
        let two = period(4, &[]);
        assert_eq!((two.alike, two.declared), (4, 4));
        // The output turns once while the driver turns four times.
        let gap = ["effects.gap_error.output.gap=3", "effects.gap_error.output.outward_um=10"];
        assert_eq!(period(4, &gap).declared, 80);
        // A link of the second chain is back after 90 pitches of its own.
        let link = ["effects.pitch_error.x.link=131", "effects.pitch_error.x.length_um=10"];
        assert_eq!(period(4, &link).declared, 180);
        let speed = |k: usize| two.turns[k].map(|(turns, sense)| (turns.times, turns.in_times, sense));
        assert_eq!([0, 1, 2, 3].map(speed), [20, 40, 40, 80].map(|pitches| Some((1, pitches, 1.0))));
    }
}
