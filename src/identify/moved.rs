//! Declared numbers that the fit has moved far from the drive file: they may hide an effect that is missing.

use super::misread::unit_factors;
use super::model::FittedModel;
use super::problem::Global;
use crate::measurement::Measurement;

/// Without a stated uncertainty, a parameter this far from its file value is implausible: a factor of 5.
const IMPLAUSIBLE_CHANGE: f64 = 1.6;

/// With one, a parameter so many of its standard deviations from its file value: one of 16,000 by chance.
const SURPRISING: f64 = 4.0;

/// A declared number that the final fit has moved far from its file value.
pub struct MovedNumber {
    /// Path of the number in the drive file.
    pub path: String,
    /// What the user is told.
    pub text: String,
    /// Its value over that of the file.
    pub times: f64,
    /// Whether nothing in the measurement file says that it may lie so far off.
    pub is_implausible: bool,
    /// Whether the measurement file gives its range.
    pub has_range: bool,
    /// Whether it ends at a limit of its range, so that no other way confirms it.
    pub is_at_bound: bool,
}

impl MovedNumber {
    /// What is said of it where it has moved by the factor between two units.
    pub fn as_unit(&self) -> Option<String> {
        let factors = unit_factors(self.times);
        // Loads and dampers are rough guesses in many files.
        let is_guess = self.path.starts_with("loads.") || self.path.contains(".damping");
        let is_known = !is_guess && !self.is_at_bound && !self.has_range;
        (is_known && !factors.is_empty() && libm::log(self.times).abs() > IMPLAUSIBLE_CHANGE).then(|| {
            format!(
                "the fit has moved `{}` to {:.4} times the file's value, near a factor of {}: is a unit wrong, in the drive file or in the records?",
                self.path,
                self.times,
                factors.join("; or of ")
            )
        })
    }
}

/// Declared numbers that the final fit has moved far from their file values.
pub fn moved_numbers(measurement: &Measurement, declared: &FittedModel, best: &FittedModel) -> Vec<MovedNumber> {
    let file = declared.problem.start();
    let numbers = declared.problem.globals.iter().zip(file.globals.iter().zip(&best.fit.point.globals));
    let text = |(g, (from, to)): (&Global, (&f64, &f64))| {
        let path = declared.problem.machine.slots[g.slot].path.clone();
        let times = if g.law.logarithm { libm::exp(to - from) } else { g.law.value(*to) / g.law.value(*from) };
        let moved = format!("the fit has moved `{path}` to {times:.3} times the file's value");
        let own = measurement.fit.iter().find(|f| f.path == path);
        let stated = g.prior.filter(|_| own.is_some_and(|f| f.spread.is_some()));
        let (far, why) = match stated {
            None => (
                g.law.logarithm && (from - to).abs() > IMPLAUSIBLE_CHANGE,
                ": it may hide a missing effect; `low` and `high`, or `spread_percent`, would limit it".to_string(),
            ),
            Some((mean, spread)) => {
                let off = ((to - mean) / spread).abs();
                let why = format!(
                    ", {off:.1} times its `spread_percent`: it may hide a missing effect, or the file's value is wrong"
                );
                (off > SURPRISING, why)
            }
        };
        let has_range = own.is_some_and(|f| f.low.is_some() || f.high.is_some());
        let (low, high) = g.law.bounds();
        let is_at_bound = *to <= low || *to >= high;
        let is_beyond = g.law.logarithm && (from - to).abs() > IMPLAUSIBLE_CHANGE;
        let is_implausible = (stated.is_none() || is_beyond) && !has_range;
        far.then(|| MovedNumber { path, text: moved + &why, times, is_implausible, has_range, is_at_bound })
    };
    numbers.filter_map(text).collect()
}
