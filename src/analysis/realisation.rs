//! Poles of many decaying responses at once: the eigensystem realisation algorithm.
//!
//! ```text
//! Y(k) = C A^k B                           responses of all outputs to all inputs, k steps after an impulse
//! H0 = [Y(i + j)] = U S V^T, H1 = [Y(i + j + 1)]
//! A = S^-1/2 U^T H1 V S^-1/2               of so many singular values; exp(s step) are its eigenvalues
//! ```
//! Source: Juang and Pappa, Journal of Guidance 8 (1985), 620. A pole of the system stands whatever number of singular values is kept, one of rounding or of
//! what is not linear moves: poles are kept that several numbers have in common (stabilisation diagram: Peeters and De Roeck, MSSP 13 (1999), 855).

use crate::products::product;
use crate::statistics::median;
use nalgebra::{DMatrix, SymmetricEigen};
use std::f64::consts::PI;

/// Responses at even distances.
#[derive(Clone, Debug)]
pub struct ImpulseResponses {
    pub step_s: f64,
    /// Outputs by inputs.
    pub values: Vec<DMatrix<f64>>,
}

/// A pole s = -d + i w that several orders have in common.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StablePole {
    pub decay_per_s: f64,
    pub rad_s: f64,
    /// In how many orders it stands.
    pub orders: usize,
}

impl StablePole {
    /// |s| / (2 pi) [Hz].
    pub fn frequency_hz(&self) -> f64 {
        libm::hypot(self.decay_per_s, self.rad_s) / (2.0 * PI)
    }

    /// d / |s|.
    pub fn damping_ratio(&self) -> f64 {
        self.decay_per_s / libm::hypot(self.decay_per_s, self.rad_s)
    }

    /// Distance from another over the size of this one.
    pub fn distance(&self, other: &StablePole) -> f64 {
        libm::hypot(other.decay_per_s - self.decay_per_s, other.rad_s - self.rad_s)
            / libm::hypot(self.decay_per_s, self.rad_s)
    }
}

/// Least width of the Hankel matrix: twice as many poles as are found in a table. assumed.
const WIDTH: usize = 160;
/// Largest order.
pub const LARGEST_ORDER: usize = 60;
/// Smallest order, and from one to the next: a swing has two poles.
const ORDER_STEP: usize = 2;
/// Singular values below this share of the largest are rounding: they are roots of eigenvalues.
const ROUNDING: f64 = 1e-7;
/// Poles of two orders that are this near to each other, over their size, are the same. assumed, as is usual in stabilisation diagrams.
const SAME: f64 = 0.02;
/// A pole stands in at least this share of the orders. assumed.
const STANDS_IN: f64 = 0.4;
/// Damping above which nothing swings in a way that frames would show. assumed.
const OVERDAMPED: f64 = 0.7;

/// Poles up to `highest_hz`, by frequency, and the number of orders.
pub fn stable_poles(responses: &ImpulseResponses, highest_hz: f64) -> (Vec<StablePole>, usize) {
    let Some(Families { families, orders, is_exact }) = families(responses, highest_hz) else { return (Vec::new(), 0) };
    let least = libm::ceil(STANDS_IN * orders as f64) as usize;
    // Where responses are those of so many poles to the last digit, the largest order has them all and none beside.
    let stands = |family: &Vec<StablePole>| {
        if is_exact { family.last().is_some_and(|last| last.orders == orders) } else { family.len() >= least.max(2) }
    };
    let mut poles: Vec<StablePole> = families
        .into_iter()
        .filter(stands)
        .filter_map(|family| {
            let middle = |of: fn(&StablePole) -> f64| median(family.iter().map(of));
            let pole =
                StablePole { decay_per_s: middle(|p| p.decay_per_s), rad_s: middle(|p| p.rad_s), orders: family.len() };
            (pole.damping_ratio() < OVERDAMPED).then_some(pole)
        })
        .collect();
    // The one that stands in more orders, where two are the same.
    poles.sort_by(|a, b| b.orders.cmp(&a.orders).then(a.rad_s.total_cmp(&b.rad_s)));
    let mut kept: Vec<StablePole> = Vec::new();
    for pole in poles {
        if kept.iter().all(|other| other.distance(&pole) > SAME) {
            kept.push(pole);
        }
    }
    kept.sort_by(|a, b| a.frequency_hz().total_cmp(&b.frequency_hz()));
    (kept, orders)
}

/// Poles of all orders, those that are the same together; `orders` of a pole is then the number of its own order.
struct Families {
    families: Vec<Vec<StablePole>>,
    orders: usize,
    /// The matrix has no more singular values above rounding.
    is_exact: bool,
}

/// None: there is nothing to make a matrix of.
fn families(responses: &ImpulseResponses, highest_hz: f64) -> Option<Families> {
    let values = &responses.values;
    let (outputs, inputs) = values.first()?.shape();
    if outputs == 0 || inputs == 0 {
        return None;
    }
    let columns = WIDTH.div_ceil(inputs).min(values.len() / 2).max(1);
    let rows = values.len().checked_sub(columns)?;
    if rows == 0 {
        return None;
    }
    let hankel = |shift: usize| {
        DMatrix::from_fn(rows * outputs, columns * inputs, |i, j| {
            values[i / outputs + j / inputs + shift][(i % outputs, j % inputs)]
        })
    };
    let (early, late) = (hankel(0), hankel(1));
    // Products whose sums have one order on every CPU.
    let squares = SymmetricEigen::new(early.tr_mul(&early));
    let crossed = early.tr_mul(&late);
    let mut order: Vec<usize> = (0..squares.eigenvalues.len()).collect();
    order.sort_by(|a, b| squares.eigenvalues[*b].total_cmp(&squares.eigenvalues[*a]));
    let singular = |k: usize| libm::sqrt(squares.eigenvalues[order[k]].max(0.0));
    let largest = singular(0);
    if largest.is_nan() || largest <= 0.0 {
        return None;
    }
    let most = (0..order.len()).take(LARGEST_ORDER).take_while(|k| singular(*k) > ROUNDING * largest).count();
    // U = H0 V / S: the whole matrix at the largest order holds those of all smaller ones.
    let v = DMatrix::from_fn(squares.eigenvectors.nrows(), most, |i, k| squares.eigenvectors[(i, order[k])]);
    let middle = product(&v.tr_mul(&crossed), &v);
    let mut families: Vec<Vec<StablePole>> = Vec::new();
    let mut orders = 0;
    for count in (ORDER_STEP..=most).step_by(ORDER_STEP) {
        let system = DMatrix::from_fn(count, count, |i, k| {
            middle[(i, k)] / (singular(i) * libm::sqrt(singular(i)) * libm::sqrt(singular(k)))
        });
        orders += 1;
        let mut met: Vec<usize> = Vec::new();
        for z in system.complex_eigenvalues().iter() {
            let (size, turned) = (libm::hypot(z.re, z.im), libm::atan2(z.im, z.re));
            if size < 1e-6 || turned <= 0.0 || turned >= 0.98 * PI {
                continue;
            }
            let pole = StablePole {
                decay_per_s: -libm::log(size) / responses.step_s,
                rad_s: turned / responses.step_s,
                orders,
            };
            if pole.frequency_hz() > highest_hz {
                continue;
            }
            let near = |family: &Vec<StablePole>| family.last().map_or(f64::INFINITY, |last| last.distance(&pole));
            let nearest = (0..families.len())
                .filter(|k| !met.contains(k) && near(&families[*k]) < SAME)
                .min_by(|a, b| near(&families[*a]).total_cmp(&near(&families[*b])));
            match nearest {
                Some(k) => {
                    families[k].push(pole);
                    met.push(k);
                }
                None => {
                    met.push(families.len());
                    families.push(vec![pole]);
                }
            }
        }
    }
    let is_exact = most < LARGEST_ORDER.min(order.len()) && most % ORDER_STEP == 0;
    Some(Families { families, orders, is_exact })
}

/// What poles make of responses.
#[derive(Clone, Debug)]
pub struct Residues {
    /// Per pole: size of its part at the first value, outputs by inputs.
    pub sizes: Vec<DMatrix<f64>>,
    /// Per pole: the square of its part over that of the responses; parts that are not orthogonal do not sum to one.
    pub shares: Vec<f64>,
    /// Share of the square that is left.
    pub left: f64,
}

/// Least squares of all responses by decaying swings of these poles. None: the poles cannot be told apart.
pub fn residues(responses: &ImpulseResponses, poles: &[StablePole]) -> Option<Residues> {
    let values = &responses.values;
    let (outputs, inputs) = values.first()?.shape();
    let n = values.len();
    let end_s = responses.step_s * (n - 1) as f64;
    // A growing swing is scaled to 1 at the last value, so that its numbers stay small.
    let from_s = |pole: &StablePole| if pole.decay_per_s < 0.0 { end_s } else { 0.0 };
    let basis = DMatrix::from_fn(n, 2 * poles.len(), |k, j| {
        let (pole, t) = (&poles[j / 2], responses.step_s * k as f64);
        let size = libm::exp(-pole.decay_per_s * (t - from_s(pole)));
        let (s, c) = libm::sincos(pole.rad_s * t);
        size * if j % 2 == 0 { c } else { s }
    });
    let wanted = DMatrix::from_fn(n, outputs * inputs, |k, j| values[k][(j % outputs, j / outputs)]);
    let whole = wanted.norm_squared();
    if poles.is_empty() {
        return Some(Residues { sizes: Vec::new(), shares: Vec::new(), left: 1.0 });
    }
    let solution = basis.clone().svd(true, true).solve(&wanted, 1e-12).ok()?;
    let left = (&wanted - product(&basis, &solution)).norm_squared() / whole;
    let (mut sizes, mut shares) = (Vec::new(), Vec::new());
    for (p, pole) in poles.iter().enumerate() {
        let at_first = libm::exp(pole.decay_per_s * from_s(pole));
        sizes.push(DMatrix::from_fn(outputs, inputs, |o, i| {
            let j = o + outputs * i;
            at_first * libm::hypot(solution[(2 * p, j)], solution[(2 * p + 1, j)])
        }));
        let own = product(&basis.columns(2 * p, 2).into_owned(), &solution.rows(2 * p, 2).into_owned());
        shares.push(own.norm_squared() / whole);
    }
    Some(Residues { sizes, shares, left })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two masses on springs, with one damping ratio each, hit at either.
    fn two_modes(noise: f64) -> ImpulseResponses {
        let step_s = 1e-3;
        let poles = [(60.0, 0.05), (67.0, 0.12)];
        let shapes = [[1.0, 0.6], [0.6, -1.0]];
        let mut random = crate::random::SplitMix::of(&[3]);
        let values = (0..120)
            .map(|k| {
                let t = step_s * k as f64;
                DMatrix::from_fn(2, 2, |o, i| {
                    let parts = poles.iter().zip(&shapes).map(|((hz, zeta), shape)| {
                        let w = 2.0 * PI * hz;
                        let turned = w * libm::sqrt(1.0 - zeta * zeta) * t;
                        shape[o] * shape[i] * libm::exp(-zeta * w * t) * libm::cos(turned)
                    });
                    parts.sum::<f64>() + noise * crate::random::normal_quantile(random.uniform())
                })
            })
            .collect();
        ImpulseResponses { step_s, values }
    }

    #[test]
    fn near_damped_modes_are_told_apart() {
        let responses = two_modes(0.0);
        let (poles, _) = stable_poles(&responses, 400.0);
        assert_eq!(poles.len(), 2, "{poles:?}");
        for (pole, (hz, zeta)) in poles.iter().zip([(60.0, 0.05), (67.0, 0.12)]) {
            assert!((pole.frequency_hz() - hz).abs() < 1e-4 * hz, "{pole:?}");
            assert!((pole.damping_ratio() - zeta).abs() < 1e-4, "{pole:?}");
        }
        let found = residues(&responses, &poles).expect("poles apart");
        assert!(found.left < 1e-8, "{}", found.left);
        // Mode 0 as it was hit at the first mass: 1 and 0.6.
        assert!((found.sizes[0][(1, 0)] / found.sizes[0][(0, 0)] - 0.6).abs() < 1e-3, "{}", found.sizes[0]);
    }

    /// One swing, two swings, without noise: singular values end, and with them the orders.
    #[test]
    fn a_clean_swing_is_found_alone() {
        let step_s = 1e-3;
        let w = 2.0 * PI * 50.0;
        let value = |k: usize| libm::exp(-20.0 * step_s * k as f64) * libm::cos(w * step_s * k as f64);
        let values = (0..100).map(|k| DMatrix::from_element(1, 1, value(k))).collect();
        let (poles, _) = stable_poles(&ImpulseResponses { step_s, values }, 400.0);
        assert_eq!(poles.len(), 1, "{poles:?}");
        assert!((poles[0].rad_s / w - 1.0).abs() < 1e-6 && (poles[0].decay_per_s - 20.0).abs() < 1e-3, "{poles:?}");
    }

    /// Poles of noise stand in many orders too, but hold little of the responses.
    #[test]
    fn noise_hides_no_mode_and_its_own_poles_hold_little() {
        let responses = two_modes(1e-2);
        let (poles, _) = stable_poles(&responses, 400.0);
        let shares = residues(&responses, &poles).expect("poles apart").shares;
        let is_near = |p: &StablePole, hz: f64| (p.frequency_hz() - hz).abs() < 0.02 * hz;
        for (hz, zeta) in [(60.0, 0.05), (67.0, 0.12)] {
            let near = poles.iter().find(|p| is_near(p, hz));
            assert!(near.is_some_and(|p| (p.damping_ratio() - zeta).abs() < 0.02), "{hz} Hz: {poles:?}");
        }
        for (pole, share) in poles.iter().zip(shares) {
            let is_mode = is_near(pole, 60.0) || is_near(pole, 67.0);
            assert!(is_mode == (share > 1e-3), "{pole:?}: {share}");
        }
    }
}
