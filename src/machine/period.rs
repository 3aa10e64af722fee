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
use crate::elements::driver_motion::Harmonic;

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
    /// As the drive is declared.
    pub(super) declared: u32,
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
        let declared = declared_period(drive, alike, &pitches, &links);
        PeriodOfDrive { alike, declared, turns, pitches }
    }

    /// Period of one turn of a body.
    pub(super) fn of_body(&self, body: usize) -> u32 {
        self.turns.get(body).copied().flatten().map_or(1, |(turns, _)| turns.period(1))
    }
}

/// Period of the drive as it is declared: some of its parts differ from their neighbours.
fn declared_period(drive: &Drive, alike: u32, pitches: &[RateRatio], links: &[u32]) -> u32 {
    let e = &drive.effects;
    let turn = |k: usize| drive.turns_per_pitch(k).map_or(1, |turns| turns.period(1));
    let mut all = alike;
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
            all = lcm(all, pitches[place].period(links[place]));
        }
    }
    let driver = drive.driver();
    let motion = &drive.train.motion;
    let orders = motion.harmonics.iter().chain(drive.train.order_loads.iter().flat_map(|l| &l.harmonics));
    if orders.clone().next().is_some() {
        // Orders are of the driver; half ones take two turns. Those without a period are refused where records are compared.
        all = lcm(all, turns_of_orders(orders).unwrap_or(2) * drive.sprockets[driver].teeth);
    }
    let train = &drive.train;
    for (_, values) in &train.motion.fluctuations {
        all = lcm(all, turn(driver) * turns_of(&speed_fluctuation::ROW, values));
    }
    let uneven = train.loads.iter().filter(|l| l.effect.differs_round_turn());
    for (k, load) in uneven.filter_map(|l| Some((drive.sprocket_turning(l.on)?, l))) {
        all = lcm(all, turn(k) * turns_of(load.effect, &load.values));
    }
    for k in drive.valves.iter().map(|v| v.sprocket) {
        all = lcm(all, turn(k));
    }
    for k in e.gap_errors.iter().map(|g| g.sprocket).chain(e.gap_waves.iter().map(|w| w.sprocket)) {
        all = lcm(all, turn(k));
    }
    all
}

/// Turns after which an effect on what turns is the same again: two where its order is a half one.
fn turns_of(effect: &Effect, values: &[f64]) -> u32 {
    let order = effect.order_in(values).unwrap_or(1.0);
    let wave = Harmonic { order, amplitude: 1.0, phase_rad: 0.0 };
    if order == libm::trunc(order) { 1 } else { turns_of_orders([wave].iter()).unwrap_or(2) }
}

/// Standard deviation of the pitch of a chain's links [m].
fn scatter_m(drive: &Drive, chain: usize) -> f64 {
    if chain == 0 { drive.scatter.pitch_m } else { drive.more[chain - 1].scatter.pitch_m }
}

#[cfg(test)]
mod tests {
    use super::PeriodOfDrive;
    use crate::drive::{BUNDLED, Drive};

    fn period(bundled: usize, sets: &[&str]) -> PeriodOfDrive {
        let (name, text) = BUNDLED[bundled];
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
        PeriodOfDrive::of(&Drive::parse(name, text, &sets).unwrap_or_else(|e| panic!("{e}")))
    }

    /// Half an order takes two turns of its shaft, a third of one three.
    #[test]
    fn a_wave_of_half_an_order_takes_two_turns() {
        let of = |order: &str| {
            let wave = [
                "effects.speed_fluctuation.driver.amplitude_percent=1".to_string(),
                format!("effects.speed_fluctuation.driver.order={order}"),
            ];
            period(0, &[wave[0].as_str(), wave[1].as_str()]).declared
        };
        assert_eq!([of("2"), of("1.5"), of("0.6666666666666667")], [20, 40, 60]);
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
