//! Whether inverse dynamics has already found what is missing, so that the search goes on from there.

use super::accept::{MAX_REMAINING_SHARE, SURE, size_in_standard_errors};
use super::judge;
use super::model::{FittedModel, without_effect};
use super::search::Context;
use crate::measurement::segments::Data;

/// A set from inverse dynamics has settled what is missing where it leaves at most this share of the declared model's error and no larger
/// one leaves less than half of that. Measured: friction and a constant in records of a closed loop leave 0.4 %, viscous friction seen by
/// position alone 5 %; two added bodies in place of a ripple 20 %, and 105 % held out. Where less is missing the usual search finds it, and
/// hears every effect: from viscous friction in place of a gain curve (46 %) it came to a set of two.
const SETTLED_SHARE: f64 = 0.1;
const CLEARLY_LESS: f64 = 0.5;
/// Held-out records must lose nearly as much.
const HELD_OUT_AS_WELL: f64 = 1.5;

/// The smallest set from inverse dynamics that explains the records, fitted to them as a simulation, without effects that it does not
/// need; then the sets that were fitted on the way to it. Empty where there is none, or where an effect of it may as well be nothing.
pub(super) fn settled_by_inverse_dynamics<'a>(
    declared: &FittedModel<'a>,
    prepared: &[FittedModel<'a>],
    own: &'a Data,
    context: &Context<'_>,
) -> Vec<FittedModel<'a>> {
    let error = |m: &FittedModel| judge::mean_error(&m.fit_residuals);
    let held_out = |m: &FittedModel| m.residuals().judge_ratio(declared.residuals())[0];
    // Held-out records are run for those alone that explain the others.
    let explains = |m: &&FittedModel| {
        let share = error(m) / error(declared);
        share < SETTLED_SHARE && held_out(m) < SETTLED_SHARE * HELD_OUT_AS_WELL
    };
    let least = prepared.iter().map(error).fold(f64::MAX, f64::min);
    let clear = prepared.iter().filter(explains).filter(|m| CLEARLY_LESS * error(m) <= least);
    let Some(set) = clear.min_by(|a, b| a.effects.len().cmp(&b.effects.len()).then(error(a).total_cmp(&error(b))))
    else {
        return Vec::new();
    };
    let mut all = vec![set.clone()];
    while all[0].effects.len() > 1 && !context.must_end() {
        let parts = (0..all[0].effects.len()).map(|i| without_effect(declared, &all[0], i, own, context.threads));
        let mut parts: Vec<FittedModel<'a>> = parts.collect();
        parts.sort_by(|a, b| error(a).total_cmp(&error(b)));
        let is_enough = MAX_REMAINING_SHARE * error(&parts[0]) <= error(&all[0]);
        let at = if is_enough { 0 } else { all.len() };
        all.splice(at..at, parts);
        if !is_enough {
            break;
        }
    }
    let is_something = |i: usize| size_in_standard_errors(&all[0], i) >= SURE;
    if (0..all[0].effects.len()).all(is_something) { all } else { Vec::new() }
}
