//! Medians and robust scatter.

/// Standard deviation of a normal distribution over the median of the distances from its median.
const NORMAL: f64 = 1.4826;

/// Median; NaN of nothing.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        n => 0.5 * (values[(n - 1) / 2] + values[n / 2]),
    }
}

/// Median and robust standard deviation.
pub fn middle(values: &[f64]) -> (f64, f64) {
    let middle = median(values.iter().copied());
    (middle, NORMAL * median(values.iter().map(|v| (v - middle).abs())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_move_neither_middle_nor_scatter() {
        assert_eq!(middle(&[1.0, 2.0, 3.0, 4.0, 100.0]), (3.0, NORMAL));
        assert_eq!(median([4.0, 1.0]), 2.5);
        assert!(median([]).is_nan());
    }
}
