//! Tells the arrivals of links at a sprocket from the impacts that follow while they lie on it.
//!
//! While a drive runs at constant speed, tooth gap g arrives at t = t0 +- g T + k z T, with the tooth period T and z
//! teeth, and joint j of a chain of n links likewise with n in place of z. The phase of an impact is its time less the
//! part that its number explains, modulo the whole turn or lap. Phases of arrivals differ by less than T; a bush that
//! is lifted in its seat and comes back to it does so many periods later. For every part of links t0 is the middle of
//! the window of one period that holds most phases, and the sign is the one with which these windows hold more.

use crate::recording::frame::Impact;
use std::collections::BTreeMap;

/// Impacts on one body, with the number by which they return: of a tooth gap, or of a joint in its chain.
pub struct ArrivalRhythm {
    /// Tooth period [s], and how many of them until a number returns.
    pub period_s: f64,
    pub count: u32,
}

/// What arrives when.
pub struct Arrivals<'a> {
    /// Impacts that are arrivals, with their numbers.
    pub impacts: Vec<(&'a Impact, u32)>,
    /// Whether the next to arrive has the higher number.
    pub is_rising: bool,
    /// Middle of the phases of every part of links [s].
    middles: BTreeMap<u32, f64>,
}

impl ArrivalRhythm {
    fn turn_s(&self) -> f64 {
        self.period_s * f64::from(self.count)
    }

    fn phase_s(&self, impact: &Impact, number: u32, is_rising: bool) -> f64 {
        let explained_s = f64::from(number) * self.period_s * if is_rising { 1.0 } else { -1.0 };
        let turn_s = self.turn_s();
        let phase_s = impact.touched_s() - explained_s;
        phase_s - turn_s * libm::floor(phase_s / turn_s)
    }

    /// With the period that the impacts show: the pitch that a header states is that of links without load, and over two
    /// hundred periods a pitch that is 0.1 % off shifts the phase by a fifth of a period.
    pub fn measured(self, impacts: &[(&Impact, u32)]) -> ArrivalRhythm {
        let mut times_s: BTreeMap<(u32, u32), Vec<f64>> = BTreeMap::new();
        impacts.iter().for_each(|(i, number)| times_s.entry((i.feature, *number)).or_default().push(i.touched_s()));
        times_s.values_mut().for_each(|times_s| times_s.sort_by(f64::total_cmp));
        // From turn to turn first: over many turns the stated period might count one too many.
        let rough = self.median_of(times_s.values().flat_map(|t| t.windows(2).map(|w| (w[0], w[1]))));
        rough.median_of(times_s.values().filter_map(|t| Some((*t.first()?, *t.last()?))))
    }

    /// The median of the periods between such times of the same number.
    fn median_of(self, pairs: impl Iterator<Item = (f64, f64)>) -> ArrivalRhythm {
        let turn_s = self.turn_s();
        let period = |(from_s, to_s): (f64, f64)| {
            let turns = libm::round((to_s - from_s) / turn_s);
            let is_whole = (to_s - from_s - turns * turn_s).abs() <= 0.5 * self.period_s;
            (turns >= 1.0 && is_whole).then(|| (to_s - from_s) / (turns * f64::from(self.count)))
        };
        let mut periods_s: Vec<f64> = pairs.filter_map(period).collect();
        periods_s.sort_by(f64::total_cmp);
        ArrivalRhythm { period_s: periods_s.get(periods_s.len() / 2).copied().unwrap_or(self.period_s), ..self }
    }

    /// Arrivals among impacts with their numbers.
    pub fn arrivals<'a>(&self, impacts: &[(&'a Impact, u32)]) -> Arrivals<'a> {
        let mut parts: BTreeMap<u32, Vec<(&Impact, u32)>> = BTreeMap::new();
        impacts.iter().for_each(|(i, number)| parts.entry(i.feature).or_default().push((i, *number)));
        let with = |is_rising: bool| {
            let of_part = |own: &Vec<(&Impact, u32)>| {
                self.fullest_window(own.iter().map(|(i, number)| self.phase_s(i, *number, is_rising)).collect())
            };
            let windows: BTreeMap<u32, (f64, usize)> = parts.iter().map(|(part, own)| (*part, of_part(own))).collect();
            (windows.values().map(|w| w.1).sum::<usize>(), windows)
        };
        let (rising, falling) = (with(true), with(false));
        let is_rising = rising.0 >= falling.0;
        let windows = if is_rising { rising.1 } else { falling.1 };
        let middles: BTreeMap<u32, f64> = windows.into_iter().map(|(part, (middle_s, _))| (part, middle_s)).collect();
        let turn_s = self.turn_s();
        let is_arrival = |(i, number): &(&Impact, u32)| {
            let off_s = self.phase_s(i, *number, is_rising) - middles.get(&i.feature).copied().unwrap_or(0.0);
            (off_s - turn_s * libm::round(off_s / turn_s)).abs() <= self.period_s
        };
        Arrivals { impacts: impacts.iter().filter(|i| is_arrival(i)).copied().collect(), is_rising, middles }
    }

    /// Middle of the window of one period, on the circle of a turn, that holds most phases, and how many.
    fn fullest_window(&self, mut phases_s: Vec<f64>) -> (f64, usize) {
        phases_s.sort_by(f64::total_cmp);
        let (n, turn_s) = (phases_s.len(), self.turn_s());
        phases_s.extend_from_within(..);
        phases_s[n..].iter_mut().for_each(|p| *p += turn_s);
        let (mut best, mut end) = (0..0, 0);
        for begin in 0..n {
            while end < begin + n && phases_s[end] - phases_s[begin] < self.period_s {
                end += 1;
            }
            if end - begin > best.len() {
                best = begin..end;
            }
        }
        let held = best.len();
        if held == 0 { (0.0, 0) } else { (phases_s[best.start + held / 2], held) }
    }

    /// Numbers of which a part should have arrived at least twice between two times and never did, with when it should
    /// have. Parts that most numbers of the same parity lack do not belong to them.
    pub fn absent(&self, arrivals: &Arrivals<'_>, (from_s, to_s): (f64, f64)) -> BTreeMap<u32, Vec<f64>> {
        let mut absent = BTreeMap::new();
        for (part, middle_s) in &arrivals.middles {
            let mut seen: BTreeMap<u32, usize> = BTreeMap::new();
            let own = arrivals.impacts.iter().filter(|(i, _)| i.feature == *part);
            own.for_each(|(_, number)| *seen.entry(*number).or_default() += 1);
            let expected = |number: u32| {
                let first_s =
                    middle_s + f64::from(number) * self.period_s * if arrivals.is_rising { 1.0 } else { -1.0 };
                let turn_s = self.turn_s();
                let (low, high) = (libm::ceil((from_s - first_s) / turn_s), libm::floor((to_s - first_s) / turn_s));
                let n = (high - low + 1.0).max(0.0) as usize;
                (0..n).map(|k| first_s + (low + k as f64) * turn_s).collect::<Vec<f64>>()
            };
            for parity in 0..2 {
                let alike: Vec<(u32, usize, Vec<f64>)> = (parity..self.count)
                    .step_by(2)
                    .map(|number| (number, seen.get(&number).copied().unwrap_or(0), expected(number)))
                    .filter(|(_, _, expected)| expected.len() >= 2)
                    .collect();
                let present = alike.iter().filter(|(_, seen, expected)| seen + 1 >= expected.len()).count();
                if (present as f64) < PRESENT * alike.len() as f64 {
                    continue;
                }
                absent
                    .extend(alike.into_iter().filter(|(_, seen, _)| *seen == 0).map(|(number, _, due)| (number, due)));
            }
        }
        absent
    }
}

/// Share of like numbers at which a part must arrive, for its absence at the others to mean something.
const PRESENT: f64 = 0.7;

#[cfg(test)]
mod tests {
    use super::*;

    fn impact(t_s: f64) -> Impact {
        Impact { t_s, ..Impact::default() }
    }

    /// Ten gaps that arrive in falling order, one of them never, one lifted and seated again in the middle of its lap.
    #[test]
    fn arrivals_are_told_from_what_follows_and_gaps_from_their_absence() {
        let stated = ArrivalRhythm { period_s: 1.001e-3, count: 10 };
        let mut all: Vec<(Impact, u32)> = Vec::new();
        for k in 0..50_u32 {
            let gap = (100 - k) % 10;
            if gap != 4 {
                all.push((impact(0.5e-3 + f64::from(k) * 1e-3), gap));
            }
            if gap == 7 {
                all.push((impact(0.5e-3 + (f64::from(k) + 4.3) * 1e-3), gap));
            }
        }
        let seen: Vec<(&Impact, u32)> = all.iter().map(|(i, gap)| (i, *gap)).collect();
        let rhythm = stated.measured(&seen);
        assert!((rhythm.period_s - 1e-3).abs() < 1e-12, "{}", rhythm.period_s);
        let arrivals = rhythm.arrivals(&seen);
        assert!(!arrivals.is_rising);
        assert_eq!((arrivals.impacts.len(), seen.len()), (45, 50));
        let absent = rhythm.absent(&arrivals, (0.0, 50e-3));
        assert_eq!(absent.keys().collect::<Vec<_>>(), [&4]);
        let due: Vec<f64> = absent[&4].iter().map(|t_s| libm::round(t_s * 1e6) / 1e3).collect();
        assert_eq!(due, [6.5, 16.5, 26.5, 36.5, 46.5]);
        // In a single turn nothing can be absent twice.
        assert_eq!(rhythm.absent(&arrivals, (0.0, 15e-3)), BTreeMap::new());
    }
}
