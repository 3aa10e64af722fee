//! Comparisons that the extremes of a step can decide. The step notes its extremes at little cost. For most steps they
//! show that nothing fulfils an expression.

use super::columns::Band;
use super::quantities::{Quantity, Scope, What};
use super::{Compare, Expr, Number, Operator, energy_number};
use crate::integrate::explicit::{ContactGroups, ContactValue, Extreme, Scratch};
use crate::recording::frame::Energy;

/// A quantity of any contact, link or joint, or its absolute value, compared with a constant.
pub(super) struct Compared<'a> {
    pub(super) quantity: &'a Quantity,
    pub(super) absolute: bool,
    pub(super) operator: Operator,
    pub(super) bound: f64,
}

impl<'a> Compared<'a> {
    /// None for names, for one given link, joint or sprocket, and for two quantities.
    pub(super) fn of(compare: &'a Compare) -> Option<Compared<'a>> {
        let Compare::Numbers { left, operator, right } = compare else { return None };
        match (left, right) {
            (Number::Quantity { quantity, index: None, absolute }, Number::Constant(bound)) => {
                Some(Compared { quantity, absolute: *absolute, operator: *operator, bound: *bound })
            }
            (Number::Constant(bound), Number::Quantity { quantity, index: None, absolute }) => {
                Some(Compared { quantity, absolute: *absolute, operator: operator.mirrored(), bound: *bound })
            }
            _ => None,
        }
    }

    /// The extreme that decides whether the comparison can be fulfilled.
    pub(super) fn extreme(&self, parts: ContactGroups) -> Option<Extreme> {
        let sign = match self.operator {
            Operator::Above | Operator::AtLeast => 1.0,
            Operator::Below | Operator::AtMost => -1.0,
            Operator::Equal | Operator::Unequal => return None,
        };
        if self.quantity.scope != Scope::Contact {
            return None;
        }
        let value = match self.quantity.what {
            What::Penetration => ContactValue::Penetration,
            What::ApproachSpeed => ContactValue::ApproachSpeed,
            What::NormalSpeed => ContactValue::NormalSpeed,
            What::Age => ContactValue::Age,
            What::NormalForce => ContactValue::NormalForce,
            What::TangentialSpeed => ContactValue::TangentialSpeed,
            What::TangentialForce => ContactValue::TangentialForce,
            _ => return None,
        };
        Some(Extreme { value, sign, absolute: self.absolute, parts })
    }
}

/// A comparison that an extreme can rule out.
pub(super) struct Quick {
    extreme: Extreme,
    band: Band,
    /// SI value of the extreme's unit.
    unit: f64,
}

impl Quick {
    pub(super) fn of(compared: &Compared, parts: ContactGroups, step_s: f64) -> Option<Quick> {
        let extreme = compared.extreme(parts)?;
        let band = Band::new(compared.operator, compared.bound, compared.absolute, 0.0)?;
        let unit = if extreme.value == ContactValue::Age { step_s } else { 1.0 };
        Some(Quick { extreme, band, unit })
    }

    /// Comparisons that must all hold for the expression to hold.
    pub(super) fn needed_by(expr: &Expr, parts: ContactGroups, step_s: f64) -> Vec<Quick> {
        match expr {
            Expr::All(of) => of.iter().flat_map(|e| Quick::needed_by(e, parts, step_s)).collect(),
            Expr::Compare(compare) => {
                Compared::of(compare).and_then(|c| Quick::of(&c, parts, step_s)).into_iter().collect()
            }
            Expr::Any(_) | Expr::Not(_) => Vec::new(),
        }
    }

    /// False: some contact may fulfil it, or the extreme was not noted.
    pub(super) fn is_impossible(&self, scratch: &Scratch) -> bool {
        let Some(most) = scratch.extreme(&self.extreme) else { return false };
        !self.band.is_reached_by(most * self.unit)
    }
}

/// A comparison of an energy with a constant.
pub(super) struct QuickEnergy {
    what: What,
    absolute: bool,
    operator: Operator,
    bound: f64,
}

impl QuickEnergy {
    /// Comparisons that must all hold for the expression to hold.
    pub(super) fn needed_by(expr: &Expr) -> Vec<QuickEnergy> {
        match expr {
            Expr::All(of) => of.iter().flat_map(QuickEnergy::needed_by).collect(),
            Expr::Compare(compare) => {
                let of_energy = Compared::of(compare).filter(|c| c.quantity.scope == Scope::Energy);
                let quick = of_energy.map(|c| QuickEnergy {
                    what: c.quantity.what,
                    absolute: c.absolute,
                    operator: c.operator,
                    bound: c.bound,
                });
                quick.into_iter().collect()
            }
            Expr::Any(_) | Expr::Not(_) => Vec::new(),
        }
    }

    /// False: it may be fulfilled.
    pub(super) fn is_impossible(&self, energy: &(Energy, f64)) -> bool {
        let Some(band) = Band::new(self.operator, self.bound, self.absolute, energy_blur(self.what, energy)) else {
            return false;
        };
        !band.is_reached_by(band.of(energy_number(self.what, &energy.0)))
    }
}

/// Uncertainty of an energy [J], or of a share of the work [-].
pub(super) fn energy_blur(what: What, (energy, blur_j): &(Energy, f64)) -> f64 {
    match what {
        // Relative to a negligible work any value is possible.
        What::Error if energy.work_in_j.abs() < 2.0 * blur_j => f64::INFINITY,
        What::Error => 2.0 * blur_j * (1.0 + energy.error_j.abs() / energy.work_in_j.abs()) / energy.work_in_j.abs(),
        _ => *blur_j,
    }
}

/// Collects the extremes that an expression needs.
pub(super) fn of_expression(expr: &Expr, parts: ContactGroups, found: &mut Vec<Extreme>) {
    match expr {
        Expr::Any(of) | Expr::All(of) => of.iter().for_each(|e| of_expression(e, parts, found)),
        Expr::Compare(compare) => found.extend(Compared::of(compare).and_then(|c| c.extreme(parts))),
        Expr::Not(_) => {}
    }
}
