//! Sobol' sequences: points that fill the unit cube evenly, each dimension a sequence of its own.
//!
//! Point i of a dimension is the exclusive or of its direction numbers v_k over the bits of the Gray code of i (Antonov and Saleev 1979); the
//! direction numbers follow from m_k = 2 a_1 m_(k-1) ^ ... ^ 2^s m_(k-s) ^ m_(k-s) (Bratley and Fox 1988, algorithm 659) and the table of Joe
//! and Kuo 2008. A random digital shift, one word a dimension, leaves the sequence as even as it is and makes means over it unbiased.

use crate::random::SplitMix;

/// Bits of a coordinate.
const BITS: usize = 32;

/// Dimensions of the table.
pub const MOST_DIMENSIONS: usize = 512;

const TABLE: &str = include_str!("../../assets/studies/sobol-directions.txt");

/// A sequence of some dimensions.
#[derive(Clone, Debug, PartialEq)]
pub struct SobolSequence {
    directions: Vec<[u32; BITS]>,
    shifts: Vec<u32>,
}

impl SobolSequence {
    /// With a digital shift from `seed`; None: as published. At most [`MOST_DIMENSIONS`].
    pub fn new(dimensions: usize, seed: Option<u64>) -> SobolSequence {
        assert!(dimensions <= MOST_DIMENSIONS, "{dimensions} dimensions");
        let rows = TABLE.lines().filter(|line| !line.starts_with('#'));
        let first = std::array::from_fn(|k| 1 << (BITS - 1 - k));
        let directions = std::iter::once(first).chain(rows.map(row)).take(dimensions).collect();
        let shift = |dimension: usize| seed.map_or(0, |s| (SplitMix::of(&[s, dimension as u64]).bits() >> 32) as u32);
        SobolSequence { directions, shifts: (0..dimensions).map(shift).collect() }
    }

    /// Coordinates of point `i` as whole numbers below 2^32.
    fn words(&self, i: u32) -> impl Iterator<Item = u32> {
        let gray = i ^ (i >> 1);
        let word = move |directions: &[u32; BITS]| {
            (0..BITS).filter(|k| gray >> k & 1 == 1).fold(0, |word, k| word ^ directions[k])
        };
        self.directions.iter().zip(&self.shifts).map(move |(own, shift)| word(own) ^ shift)
    }

    /// Point `i`, in the middle of its cell: never 0 or 1.
    pub fn point(&self, i: u32) -> Vec<f64> {
        self.words(i).map(|word| (f64::from(word) + 0.5) / (1_u64 << BITS) as f64).collect()
    }
}

/// Direction numbers of a row of the table.
fn row(line: &str) -> [u32; BITS] {
    let numbers: Vec<u32> = line.split(' ').filter_map(|word| word.parse().ok()).collect();
    let (polynomial, known) = (numbers[0], &numbers[1..]);
    let degree = known.len();
    let mut m = [0_u32; BITS];
    m[..degree].copy_from_slice(known);
    for k in degree..BITS {
        m[k] = m[k - degree] ^ (m[k - degree] << degree);
        for i in 1..degree {
            if polynomial >> (degree - i) & 1 == 1 {
                m[k] ^= m[k - i] << i;
            }
        }
    }
    std::array::from_fn(|k| m[k] << (BITS - 1 - k))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against scipy 1.17: `qmc.Sobol(512, scramble=False, bits=32)`, point 1000.
    #[test]
    fn points_are_those_of_another_library() {
        let words: Vec<u32> = SobolSequence::new(MOST_DIMENSIONS, None).words(1000).collect();
        let known = [
            (0, 943_718_400),
            (1, 415_236_096),
            (2, 2_227_175_424),
            (7, 3_862_953_984),
            (100, 3_300_917_248),
            (511, 1_698_693_120),
        ];
        for (dimension, word) in known {
            assert_eq!(words[dimension], word, "dimension {dimension}");
        }
    }

    #[test]
    fn every_dimension_has_one_point_in_each_of_256_cells_shifted_or_not() {
        for seed in [None, Some(7)] {
            let sequence = SobolSequence::new(40, seed);
            let mut seen = vec![[false; 256]; 40];
            for i in 0..256 {
                for (dimension, x) in sequence.point(i).into_iter().enumerate() {
                    seen[dimension][(x * 256.0) as usize] = true;
                }
            }
            assert!(seen.iter().flatten().all(|cell| *cell));
        }
    }
}
