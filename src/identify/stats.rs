//! Statistics of residuals: effective sample size, whiteness, bootstrap intervals.

/// Correlation of neighbours within segments, pooled.
pub fn neighbour_correlation(parts: &[Vec<f64>]) -> f64 {
    correlation(parts, 1)
}

/// Correlation of values `lag` apart within segments, pooled.
pub fn correlation(parts: &[Vec<f64>], lag: usize) -> f64 {
    let n: usize = parts.iter().map(Vec::len).sum();
    let mean = parts.iter().flatten().sum::<f64>() / n.max(1) as f64;
    let (mut product, mut square, mut pairs) = (0.0, 0.0, 0_usize);
    for p in parts {
        square += p.iter().map(|r| (r - mean) * (r - mean)).sum::<f64>();
        product += p.iter().zip(p.iter().skip(lag)).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>();
        pairs += p.len().saturating_sub(lag);
    }
    if square > 0.0 && pairs > 0 { (product / pairs as f64) / (square / n as f64) } else { 0.0 }
}

/// So many samples count as one at most.
const MOST_SAMPLES_FOR_ONE: f64 = 50.0;

/// Effective number of independent samples, after Bayley and Hammersley 1946 with all lags until the correlation has
/// decayed; at least one in fifty.
pub fn effective(parts: &[Vec<f64>]) -> f64 {
    let n: usize = parts.iter().map(Vec::len).sum();
    let longest = parts.iter().map(Vec::len).max().unwrap_or(0);
    let mut sum = 1.0;
    for lag in 1..longest / 3 {
        let rho = correlation(parts, lag);
        // Beyond the least share further lags change nothing.
        if rho < 0.1 || sum >= MOST_SAMPLES_FOR_ONE {
            break;
        }
        sum += 2.0 * rho;
    }
    (n as f64 / sum).max(n as f64 / MOST_SAMPLES_FOR_ONE).min(n as f64)
}

/// Root mean square over segments.
pub fn rms(parts: &[Vec<f64>]) -> f64 {
    let n: usize = parts.iter().map(Vec::len).sum();
    libm::sqrt(parts.iter().flatten().map(|r| r * r).sum::<f64>() / n.max(1) as f64)
}

/// Ljung and Box 1978 over 10 lags against the 99.9 % point of chi-squared. Negligible correlations pass too, because
/// with enough samples no series is exactly white.
pub fn white(parts: &[Vec<f64>]) -> bool {
    let n: usize = parts.iter().map(Vec::len).sum();
    let (mut q, mut largest) = (0.0, 0.0_f64);
    for lag in 1..=10 {
        let rho = correlation(parts, lag);
        largest = largest.max(rho.abs());
        q += rho * rho / (n.saturating_sub(lag)).max(1) as f64;
    }
    let q = q * n as f64 * (n as f64 + 2.0);
    // 99.9 % point of chi-squared with 10 degrees of freedom.
    q < 29.588 || largest < 0.1
}

/// Own pseudorandom generator, so that the same input gives the same report: xorshift64*, Vigna 2016.
#[derive(Clone, Copy, Debug)]
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    pub fn next_u64(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    /// An integer below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.next_u64() >> 11) as f64 / (1_u64 << 53) as f64 * n as f64) as usize
    }
}

/// Draws of a block bootstrap.
const DRAWS: usize = 1000;
/// Shortest block [samples].
const BLOCK: usize = 15;

/// Ratio of two root mean squares over the same samples, with its 2.5 and 97.5 % points by block bootstrap (the same
/// blocks are drawn for both).
pub fn ratio(after: &[Vec<f64>], before: &[Vec<f64>]) -> [f64; 3] {
    let longest = before.iter().map(Vec::len).max().unwrap_or(1);
    let mut block = BLOCK;
    // Blocks are long enough that neighbouring blocks are nearly uncorrelated.
    while block < longest / 8 && correlation(before, block) > 0.2 {
        block += block / 2;
    }
    // Sums of squares block by block: after, before.
    let mut sums: Vec<(f64, f64)> = Vec::new();
    for (a, b) in after.iter().zip(before) {
        for (a, b) in a.chunks(block).zip(b.chunks(block)) {
            sums.push((a.iter().map(|r| r * r).sum(), b.iter().map(|r| r * r).sum()));
        }
    }
    let of = |(a, b): (f64, f64)| if b > 0.0 { libm::sqrt(a / b) } else { 1.0 };
    let whole = sums.iter().fold((0.0, 0.0), |s, x| (s.0 + x.0, s.1 + x.1));
    if sums.len() < 2 {
        return [of(whole), 0.0, f64::INFINITY];
    }
    let mut random = Random::new(1);
    let mut drawn: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let sum = (0..sums.len()).fold((0.0, 0.0), |s, _| {
                let x = sums[random.below(sums.len())];
                (s.0 + x.0, s.1 + x.1)
            });
            of(sum)
        })
        .collect();
    drawn.sort_by(f64::total_cmp);
    [of(whole), drawn[DRAWS / 40], drawn[DRAWS - 1 - DRAWS / 40]]
}

/// Root mean square with its 2.5 and 97.5 % points by block bootstrap.
pub fn rms_interval(parts: &[Vec<f64>]) -> [f64; 3] {
    let ones: Vec<Vec<f64>> = parts.iter().map(|p| vec![1.0; p.len()]).collect();
    ratio(parts, &ones)
}
