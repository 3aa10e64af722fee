//! Products of matrices that sum in the same order on every processor.

use nalgebra::DMatrix;

/// Matrix product with the same summation order on every processor, as in `tr_mul`. The library's `*` for two large
/// matrices uses kernels with fused multiply-add where the processor supports it.
pub fn product(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(a.nrows(), b.ncols());
    for (k, column) in b.column_iter().enumerate() {
        out.set_column(k, &(a * column));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The result has the same bits on every processor; the expected ones were computed with AVX-512.
    #[test]
    fn products_sum_in_one_order() {
        let value = |i: usize| libm::sin(i as f64 * 0.7) * libm::exp(libm::cos(i as f64 * 1.3));
        let a = DMatrix::from_fn(41, 9, |r, c| value(r * 9 + c));
        let b = DMatrix::from_fn(9, 12, |r, c| value(1000 + r * 12 + c));
        let bits = |m: &DMatrix<f64>| m.iter().fold(0_u64, |h, v| h.rotate_left(7) ^ v.to_bits());
        let (gram, outer) = (a.tr_mul(&a), product(&a, &b));
        assert_eq!([bits(&gram), bits(&outer)], [0x4435_93eb_6388_a0ce, 0x60de_aa69_745e_699b]);
        let naive = |r: usize, c: usize| (0..9).map(|k| a[(r, k)] * b[(k, c)]).sum::<f64>();
        assert!((0..41 * 12).all(|i| (outer[(i % 41, i / 41)] - naive(i % 41, i / 41)).abs() < 1e-12));
    }
}
