//! Whether inverse dynamics has already found what is missing, so that the search goes on from there.

use super::accept::{CLEAR_SCORE_GAP, MAX_REMAINING_SHARE, SURE, size_in_standard_errors};
use super::candidates::Hypothesis;
use super::fit::parallel;
use super::judge;
use super::model::{FittedModel, fitted_values, without_effect};
use super::rivals::rival_of;
use super::search::Context;
use crate::machine::Target;
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
    if let Some(elsewhere) = on_another_body(declared, &all[0], own, context) {
        all.insert(0, elsewhere);
    }
    let is_something = |i: usize| size_in_standard_errors(&all[0], i) >= SURE;
    if (0..all[0].effects.len()).all(is_something) { all } else { Vec::new() }
}

/// The set with one of its loads on another body, where that is better: inverse dynamics hardly tells bodies apart that a stiff spring joins, and the
/// search that goes on from the set does not ask again.
fn on_another_body<'a>(
    declared: &FittedModel<'a>,
    set: &FittedModel<'a>,
    own: &'a Data,
    context: &Context<'_>,
) -> Option<FittedModel<'a>> {
    if set.is_noise_alone() || !set.is_near_the_floor() {
        return None;
    }
    let starts = fitted_values(set);
    let moved = |which: usize| {
        let h = &set.effects[which];
        let places = match h.target {
            Target::Body(_) => set.problem.machine.targets(h.effect),
            Target::Spring(_)
            | Target::Input(_)
            | Target::Sensor(_)
            | Target::Chain(_)
            | Target::Part(_)
            | Target::Span(_) => Vec::new(),
        };
        let elsewhere = places.into_iter().map(|(name, target)| Hypothesis { name, target, ..h.clone() });
        elsewhere.map(move |h| (which, h)).collect::<Vec<_>>()
    };
    let taken = |h: &Hypothesis| set.effects.iter().any(|e| e.identity() == h.identity());
    let moves: Vec<(usize, Hypothesis)> = (0..set.effects.len()).flat_map(moved).filter(|(_, h)| !taken(h)).collect();
    let models = parallel(moves.len(), context.threads, |at| {
        let (which, h) = &moves[at];
        let rest: Vec<usize> = (0..set.effects.len()).filter(|e| e != which).collect();
        (!context.must_end()).then(|| rival_of(declared, set, &rest, (h, &starts[*which]), own)).flatten()
    });
    let best = models.into_iter().flatten().min_by(|a, b| a.misfit().total_cmp(&b.misfit()))?;
    (best.misfit() < set.misfit() - CLEAR_SCORE_GAP).then_some(best)
}

/// Other sets of as many effects that leave at most so many times the error of the settled one take part in the search where that leaves more than noise, so many
/// of them at most: which law is the right one may show only beside what is still missing. Beside a gain curve that nobody knew of, Coulomb friction left 0.83 of what
/// the true viscous friction left.
const NEARLY_AS_GOOD: f64 = 1.5;
const ALTERNATIVES: usize = 2;

/// Sets from inverse dynamics that explain nearly as much as the settled one, the best first.
pub(super) fn nearly_as_good<'a>(set: &FittedModel<'a>, prepared: &[FittedModel<'a>]) -> Vec<FittedModel<'a>> {
    if set.is_near_the_floor() {
        return Vec::new();
    }
    let error = |m: &FittedModel| judge::mean_error(&m.fit_residuals);
    let is_other = |m: &&FittedModel| m.effects.len() == set.effects.len() && m.identity() != set.identity();
    let mut others: Vec<&FittedModel<'a>> =
        prepared.iter().filter(is_other).filter(|m| error(m) <= NEARLY_AS_GOOD * error(set)).collect();
    others.sort_by(|a, b| error(a).total_cmp(&error(b)));
    others.into_iter().take(ALTERNATIVES).cloned().collect()
}
