//! Compares whole columns of a step with a bound, one block of lanes at a time, to find whether any link or joint can
//! fulfil it.

use super::Operator;
use super::quantities::{Quantity, Scope, What};
use super::scratch::StepValues;
use crate::integrate::VectorKernel;
use crate::lanes::{LANES, LaneBlock, blocks};
use crate::model::ChainModel;

/// Rounding of quantities that are compared in another form, such as a square: relative to the bound, and for forces
/// [N].
const ROUNDING: f64 = 1e-9;
const FORCE_ROUNDING_N: f64 = 1e-8;
/// Tolerance of `1 - cos` of an angle, for (cos, sin) that is not exactly a unit vector.
const COSINE_TOLERANCE: f64 = 1e-6;

/// Range of values on one side of a bound that fulfil a comparison, widened by their uncertainty.
#[derive(Clone, Copy)]
pub(super) struct ThresholdBand {
    /// 1: at or above; -1: at or below.
    sign: f64,
    threshold: f64,
    /// Bits of a value that are compared: without the sign bit if the absolute value is meant.
    bits: u64,
}

impl ThresholdBand {
    /// None for equality and inequality: too few or too many values fulfil them for a search over columns to pay.
    pub(super) fn new(operator: Operator, bound: f64, absolute: bool, uncertainty: f64) -> Option<ThresholdBand> {
        let sign = match operator {
            Operator::Above | Operator::AtLeast => 1.0,
            Operator::Below | Operator::AtMost => -1.0,
            Operator::Equal | Operator::Unequal => return None,
        };
        let threshold = sign * bound - (ROUNDING * bound.abs() + uncertainty);
        Some(ThresholdBand { sign, threshold, bits: if absolute { u64::MAX >> 1 } else { u64::MAX } })
    }

    /// The band for the squares of non-negative values.
    fn squared(self) -> ThresholdBand {
        let bound = self.sign * self.threshold;
        let threshold = if bound > 0.0 { self.sign * bound * bound } else { 0.0 };
        // No such value is below a negative bound.
        let threshold = if bound < 0.0 && self.sign < 0.0 { f64::INFINITY } else { threshold };
        ThresholdBand { threshold, ..self }
    }

    /// The band for [`rising`] of angles.
    fn risen(self) -> ThresholdBand {
        let bound = self.sign * self.threshold;
        let at = if bound.abs() > std::f64::consts::PI { f64::INFINITY } else { 1.0 - libm::cos(bound) };
        ThresholdBand { threshold: self.sign * libm::copysign(at, bound) - COSINE_TOLERANCE, ..self }
    }

    /// Counts matches lane by lane in `found`, in block `b` of the chains. Sums of ones vectorise; a reduction to one
    /// bit does not.
    #[inline(always)]
    fn count_links(self, values: &LaneBlock, b: usize, chain: &ChainModel, found: &mut LaneBlock) {
        match chain.link_lanes(b * LANES) {
            None => self.count(values, &[1.0; LANES], found),
            Some(links) => self.count(values, &links.map(|is| if is { 1.0 } else { 0.0 }), found),
        }
    }

    #[inline(always)]
    fn count_all(self, values: &[LaneBlock], chain: &ChainModel, found: &mut LaneBlock) {
        for own in &chain.loops {
            let (first, last) = (own.start / LANES, own.end / LANES);
            for values in &values[first..last] {
                self.count(values, &[1.0; LANES], found);
            }
            if !own.end.is_multiple_of(LANES) {
                self.count_links(&values[last], last, chain, found);
            }
        }
    }

    /// The value with the sign of the threshold, and as an absolute value if that is meant.
    pub(super) fn oriented(self, value: f64) -> f64 {
        self.sign * f64::from_bits(value.to_bits() & self.bits)
    }

    /// Whether values can be in the band if `most` is the largest one in its direction.
    pub(super) fn may_contain(self, most: f64) -> bool {
        most >= self.threshold
    }

    /// Counts lanes where `counts` is 1.
    #[inline(always)]
    fn count(self, values: &LaneBlock, counts: &LaneBlock, found: &mut LaneBlock) {
        for i in 0..LANES {
            let v = f64::from_bits(values[i].to_bits() & self.bits);
            found[i] += if self.sign * v >= self.threshold { counts[i] } else { 0.0 };
        }
    }
}

/// A function of a unit vector that increases from -2 to 2 as its angle goes from -pi to pi; cheaper than the angle.
#[inline(always)]
fn rising(cos: f64, sin: f64) -> f64 {
    if sin < 0.0 { cos - 1.0 } else { 1.0 - cos }
}

/// [`StepValues::lanes_in_band`] of a quantity.
pub(super) struct ColumnSearch<'a>(pub(super) &'a StepValues<'a>, pub(super) &'a Quantity, pub(super) ThresholdBand);

impl VectorKernel for ColumnSearch<'_> {
    type Output = Option<LaneBlock>;

    #[inline(always)]
    fn run(self) -> Option<LaneBlock> {
        self.0.lanes_in_band(self.1, self.2)
    }
}

impl StepValues<'_> {
    /// Number of links or joints in each lane whose quantity is in a band; None: the quantity has no column.
    #[inline(always)]
    fn lanes_in_band(&self, quantity: &Quantity, band: ThresholdBand) -> Option<LaneBlock> {
        let mut found = [0.0; LANES];
        let chain = &self.model.chain;
        match quantity.scope {
            Scope::Link => self.links_in_band(quantity.what, band, &mut found)?,
            Scope::Joint => {
                let (x, y, torque) = self.scratch.joint_columns();
                if quantity.what == What::Force {
                    let (x, y) = (self.lanes(&x[1..]), self.lanes(&y[1..]));
                    let band = band.squared();
                    for b in 0..x.len() {
                        let mut square = [0.0; LANES];
                        for k in 0..LANES {
                            square[k] = x[b][k] * x[b][k] + y[b][k] * y[b][k];
                        }
                        band.count_links(&square, b, chain, &mut found);
                    }
                } else {
                    band.count_all(self.lanes(&torque[1..]), chain, &mut found);
                }
            }
            Scope::Contact | Scope::Impact | Scope::Energy | Scope::Run => return None,
            Scope::Sprocket | Scope::Shaft | Scope::Arm | Scope::Slider | Scope::Ball | Scope::Touch => return None,
            Scope::Chamber | Scope::Reservoir | Scope::Passage | Scope::Span => return None,
        }
        Some(found)
    }

    /// All blocks of a column of links or joints.
    #[inline(always)]
    fn lanes<'c>(&self, column: &'c [f64]) -> &'c [LaneBlock] {
        blocks(column, self.model.chain.padded / LANES)
    }

    /// [`StepValues::lanes_in_band`] for links.
    #[inline(always)]
    fn links_in_band(&self, what: What, band: ThresholdBand, found: &mut LaneBlock) -> Option<()> {
        let (l, s, half) = (&self.state.links, self.scratch, 0.5 * self.model.step_s);
        let chain = &self.model.chain;
        match what {
            What::Tension => {
                let (x, y, _) = s.joint_columns();
                let (x0, x1) = (self.lanes(x), self.lanes(&x[1..]));
                let (y0, y1) = (self.lanes(y), self.lanes(&y[1..]));
                let (cos, sin) = (self.lanes(&l.cos), self.lanes(&l.sin));
                for b in 0..cos.len() {
                    let mut pull = [0.0; LANES];
                    for k in 0..LANES {
                        pull[k] = -0.5 * ((x0[b][k] + x1[b][k]) * cos[b][k] + (y0[b][k] + y1[b][k]) * sin[b][k]);
                    }
                    band.count_links(&pull, b, chain, found);
                }
            }
            What::Speed => {
                let band = band.squared();
                let (u, v) = (self.lanes(&l.vx), self.lanes(&l.vy));
                let (ax, ay) = (self.lanes(&s.ax), self.lanes(&s.ay));
                for b in 0..u.len() {
                    let mut square = [0.0; LANES];
                    for k in 0..LANES {
                        let (u, v) = (u[b][k] + half * ax[b][k], v[b][k] + half * ay[b][k]);
                        square[k] = u * u + v * v;
                    }
                    band.count_links(&square, b, chain, found);
                }
            }
            What::VelocityX => self.rates_in_band((&l.vx, &s.ax), band, found),
            What::VelocityY => self.rates_in_band((&l.vy, &s.ay), band, found),
            What::Omega => self.rates_in_band((&l.omega, &s.alpha), band, found),
            What::X => band.count_all(self.lanes(&l.x), chain, found),
            What::Y => band.count_all(self.lanes(&l.y), chain, found),
            What::Angle => {
                let band = band.risen();
                let (cos, sin) = (self.lanes(&l.cos), self.lanes(&l.sin));
                for b in 0..cos.len() {
                    let mut risen = [0.0; LANES];
                    for k in 0..LANES {
                        risen[k] = rising(cos[b][k], sin[b][k]);
                    }
                    band.count_links(&risen, b, chain, found);
                }
            }
            _ => return None,
        }
        Some(())
    }

    /// Velocities at the node.
    #[inline(always)]
    fn rates_in_band(&self, (v, a): (&[f64], &[f64]), band: ThresholdBand, found: &mut LaneBlock) {
        let (v, a, half) = (self.lanes(v), self.lanes(a), 0.5 * self.model.step_s);
        for b in 0..v.len() {
            let mut at_node = [0.0; LANES];
            for k in 0..LANES {
                at_node[k] = v[b][k] + half * a[b][k];
            }
            band.count_links(&at_node, b, &self.model.chain, found);
        }
    }
}

/// Uncertainty of quantities that are compared in another form [N].
pub(super) fn rounding(quantity: &Quantity) -> f64 {
    match (quantity.scope, quantity.what) {
        (Scope::Link, What::Tension) | (Scope::Joint, What::Force) => FORCE_ROUNDING_N,
        _ => 0.0,
    }
}
