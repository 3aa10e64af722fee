//! A factor: values of a drive that differ from case to case, and how a coordinate of the design becomes a value.

use crate::random::{SplitMix, normal_quantile, normal_share};

/// A value that a factor gives to the drive.
#[derive(Clone, Debug, PartialEq)]
pub enum FactorValue {
    Number(f64),
    Text(String),
    Flag(bool),
}

impl FactorValue {
    /// As `--set` takes it: a text in quotes; a number by the fewest digits that read back to its bits.
    pub fn written(&self) -> String {
        match self {
            FactorValue::Number(x) => format!("{x}"),
            FactorValue::Text(text) => toml_edit::Value::from(text.as_str()).to_string(),
            FactorValue::Flag(flag) => format!("{flag}"),
        }
    }

    /// As a table shows it.
    pub fn shown(&self) -> String {
        match self {
            FactorValue::Text(text) => text.clone(),
            FactorValue::Number(_) | FactorValue::Flag(_) => self.written(),
        }
    }
}

/// How the values of a factor are spread.
#[derive(Clone, Debug, PartialEq)]
pub enum Spread {
    /// One of these, each as likely.
    Values(Vec<FactorValue>),
    /// Evenly between two values, or between their logarithms.
    Uniform { low: f64, high: f64, by_logarithm: bool },
    /// Normally distributed, cut off at [`CUT_SD`] standard deviations: a part beyond is not delivered.
    Normal { mean: f64, sd: f64 },
}

/// Standard deviations at which a normal distribution is cut off. assumed: 6 in 100,000 parts lie beyond.
pub const CUT_SD: f64 = 4.0;

/// What a number of a factor means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FactorScale {
    /// The value itself.
    Absolute,
    /// Added to the drive's value.
    Added,
    /// Per cent by which the drive's value is larger.
    Percent,
}

/// Values of a drive that differ from case to case.
#[derive(Clone, Debug, PartialEq)]
pub struct Factor {
    pub name: String,
    /// Values of the drive that it sets, all alike.
    pub paths: Vec<String>,
    pub spread: Spread,
    pub scale: FactorScale,
    /// Rounded to whole numbers.
    pub is_whole: bool,
    /// Values in a grid, or changed one at a time.
    pub levels: usize,
    /// Every link has a value of its own; paths then have a `*` for its name.
    pub each_link: bool,
}

/// What a table says of a factor in a case.
#[derive(Clone, Debug, PartialEq)]
pub enum FactorCell {
    /// The drive's own value.
    Unset,
    Value(FactorValue),
    /// Seed from which the random numbers of all links follow.
    Seed(u64),
}

impl Factor {
    /// Cell of the table at a coordinate; `base` is the drive's value of the first path.
    pub fn cell(&self, u: f64, base: f64) -> FactorCell {
        match (u.is_nan(), self.each_link) {
            (true, _) => FactorCell::Unset,
            (false, true) => FactorCell::Seed(link_seed(u)),
            (false, false) => FactorCell::Value(self.value(u, base)),
        }
    }

    /// `path=value` for all paths at a coordinate; `bases` are the drive's values there.
    pub fn overrides(&self, u: f64, bases: &[f64], links: usize) -> Vec<String> {
        if u.is_nan() {
            return Vec::new();
        }
        let mut all = Vec::new();
        for (path, base) in self.paths.iter().zip(bases) {
            if !self.each_link {
                all.push(format!("{path}={}", self.value(u, *base).written()));
                continue;
            }
            let mut random = SplitMix::of(&[link_seed(u), twox_hash::XxHash3_64::oneshot(self.name.as_bytes())]);
            let (table, _) = path.rsplit_once('.').unwrap_or((path, ""));
            for link in 0..links {
                let name = format!("{}_{link}", self.name);
                all.push(format!("{}.link={link}", table.replace('*', &name)));
                // Never 0, where a normal distribution has no value.
                let own = self.value(random.uniform().max(f64::MIN_POSITIVE), *base);
                all.push(format!("{}={}", path.replace('*', &name), own.written()));
            }
        }
        all
    }

    /// As [`Factor::cell`], of a value that a table gives.
    pub fn cell_of_value(&self, value: f64) -> FactorCell {
        match (value.is_nan(), self.each_link) {
            (true, _) => FactorCell::Unset,
            (false, true) => FactorCell::Seed(value as u64),
            (false, false) => FactorCell::Value(FactorValue::Number(self.rounded(value))),
        }
    }

    fn rounded(&self, value: f64) -> f64 {
        if self.is_whole { libm::round(value) } else { value }
    }

    /// As [`Factor::overrides`], of a value that a table gives: that of the first path, or the seed of the links' random numbers.
    pub fn overrides_of_value(&self, value: f64, bases: &[f64], links: usize) -> Vec<String> {
        if self.each_link {
            return self.overrides(value / (1_u64 << 53) as f64, bases, links);
        }
        if value.is_nan() {
            return Vec::new();
        }
        let value = self.rounded(value);
        let first = bases.first().copied().unwrap_or(0.0);
        let own = |base: f64| match self.scale {
            FactorScale::Absolute => value,
            FactorScale::Added => base + (value - first),
            FactorScale::Percent => base * (value / first),
        };
        self.paths
            .iter()
            .zip(bases)
            .map(|(path, base)| format!("{path}={}", FactorValue::Number(own(*base)).written()))
            .collect()
    }

    /// The value at a coordinate.
    fn value(&self, u: f64, base: f64) -> FactorValue {
        let number = match &self.spread {
            Spread::Values(values) => {
                let i = ((u * values.len() as f64) as usize).min(values.len() - 1);
                match &values[i] {
                    FactorValue::Number(x) => *x,
                    other @ (FactorValue::Text(_) | FactorValue::Flag(_)) => return other.clone(),
                }
            }
            Spread::Uniform { low, high, by_logarithm: false } => (low + u * (high - low)).min(*high),
            Spread::Uniform { low, high, by_logarithm: true } => (low * libm::pow(high / low, u)).min(*high),
            Spread::Normal { mean, sd } => {
                // What lies beyond is left out, and the rest takes its share.
                let beyond = normal_share(-CUT_SD);
                mean + sd * normal_quantile(beyond + u * (1.0 - 2.0 * beyond)).clamp(-CUT_SD, CUT_SD)
            }
        };
        let number = match self.scale {
            FactorScale::Absolute => number,
            FactorScale::Added => base + number,
            FactorScale::Percent => base * (1.0 + number / 100.0),
        };
        FactorValue::Number(self.rounded(number))
    }

    /// Coordinate of a level in a grid: an even share of a normal distribution, whose ends are not reached.
    pub fn grid_coordinate(&self, u: f64, levels: usize) -> f64 {
        match self.spread {
            Spread::Normal { .. } => (u * (levels - 1) as f64 + 0.5) / levels as f64,
            Spread::Values(_) | Spread::Uniform { .. } => u,
        }
    }

    /// Number of values that are listed one by one.
    pub fn listed(&self) -> usize {
        match &self.spread {
            Spread::Values(values) => values.len(),
            Spread::Uniform { .. } | Spread::Normal { .. } => 0,
        }
    }

    /// Numbers, or texts and flags too.
    pub fn is_numeric(&self) -> bool {
        match &self.spread {
            Spread::Values(values) => values.iter().all(|v| matches!(v, FactorValue::Number(_))),
            Spread::Uniform { .. } | Spread::Normal { .. } => true,
        }
    }
}

/// Seed of the links' random numbers: the coordinate's own digits, so that a sequence that fills the cube gives every case other links.
fn link_seed(u: f64) -> u64 {
    (u * (1_u64 << 53) as f64) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factor(spread: Spread, scale: FactorScale) -> Factor {
        let paths = vec!["a.b".to_string()];
        Factor { name: "f".into(), paths, spread, scale, is_whole: false, levels: 3, each_link: false }
    }

    #[test]
    fn coordinates_become_values_and_values_coordinates() {
        let range = factor(Spread::Uniform { low: -1.0, high: 3.0, by_logarithm: false }, FactorScale::Added);
        assert_eq!(range.overrides(0.25, &[10.0], 0), ["a.b=10"]);
        let percent = factor(Spread::Uniform { low: -10.0, high: 10.0, by_logarithm: false }, FactorScale::Percent);
        assert_eq!(percent.overrides(1.0, &[20.0], 0), ["a.b=22"]);
        let decades = factor(Spread::Uniform { low: 1.0, high: 100.0, by_logarithm: true }, FactorScale::Absolute);
        assert_eq!(decades.overrides(0.5, &[7.0], 0), ["a.b=10"]);
        assert_eq!(percent.overrides_of_value(22.0, &[20.0, 40.0], 0), ["a.b=22"]);
        let normal = factor(Spread::Normal { mean: 1.0, sd: 0.5 }, FactorScale::Absolute);
        assert_eq!(normal.value(0.5, 0.0), FactorValue::Number(1.0));
        let FactorValue::Number(least) = normal.value(0.0, 0.0) else { panic!("a number") };
        assert!((least + 1.0).abs() < 1e-12, "cut at four standard deviations: {least}");
        let texts = factor(
            Spread::Values(vec![FactorValue::Text("min".into()), FactorValue::Text("max".into())]),
            FactorScale::Absolute,
        );
        assert_eq!(texts.overrides(0.7, &[0.0], 0), ["a.b=\"max\""]);
    }

    #[test]
    fn links_have_values_of_their_own_and_the_same_ones_again() {
        let mut lengths = factor(Spread::Normal { mean: 0.0, sd: 4.0 }, FactorScale::Absolute);
        lengths.paths = vec!["effects.pitch_error.*.length_um".into()];
        lengths.each_link = true;
        let set = lengths.overrides(0.3, &[0.0], 90);
        assert_eq!((set.len(), set[2].as_str()), (180, "effects.pitch_error.f_1.link=1"));
        assert_eq!(set, lengths.overrides(0.3, &[0.0], 90));
        assert_ne!(set, lengths.overrides(0.3000001, &[0.0], 90));
        let values: Vec<f64> = set
            .iter()
            .skip(1)
            .step_by(2)
            .map(|s| s.split('=').nth(1).expect("a value").parse().expect("a number"))
            .collect();
        let sd = libm::sqrt(values.iter().map(|v| v * v).sum::<f64>() / 90.0);
        assert!((3.0..5.0).contains(&sd), "{sd}");
    }
}
