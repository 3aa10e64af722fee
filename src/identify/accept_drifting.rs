//! Acceptance of sizes that differ from record to record.

use super::accept::{AcceptedResult, CLEAR_SCORE_GAP, evidence_from, left_unexplained, rejection_reason};
use super::crossed::HeldOutComparison;
use super::drifting::{Course, DriftingNumber, is_ordered_by_load};
use super::model::{FittedModel, placed_path, score};
use super::plausible::outside_the_records;
use super::rivals::Rival;
use super::search::{MIN_SCORE_GAIN, Trial, best_effective};

/// The held-out error of a set with a size for each record may be this multiple of the noise at most.
const MOST_TIMES_FLOOR: f64 = 1.5;

/// Takes the accepted set, or a single effect where none was accepted or one that is worse, with a size for each record, if held-out records confirm the
/// course of the sizes and little more than noise is left then. Returns whether it did.
pub fn accept_drifting<'a>(found: &mut AcceptedResult<'a>, drifting: &[DriftingNumber<'a>]) -> bool {
    let effect_of = |d: &DriftingNumber| {
        let is_of = |which: &usize| d.number.path.starts_with(&format!("{}.", placed_path(&d.model, *which)));
        (0..d.model.effects.len()).find(is_of)
    };
    let models: Vec<FittedModel> = drifting.iter().map(|d| d.model.clone()).collect();
    let effective = best_effective(&models);
    let mut able: Vec<(f64, usize, &DriftingNumber)> = drifting
        .iter()
        .filter(|d| d.is_confirmed && !is_ordered_by_load(&d.model.problem))
        .filter(|d| is_at_the_floor(&d.model))
        .filter_map(|d| Some((score(&d.model, &effective), effect_of(d)?, d)))
        .filter(|(_, which, d)| outside_the_records(&d.model, *which).is_none())
        .collect();
    able.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (_, which, d) in able {
        let is_single = d.model.effects.len() == 1 && found.best.effects.len() <= 1;
        if is_single && accept_single(found, d, which, drifting) {
            return true;
        }
        if d.model.identity() == found.best.identity() {
            found.best = d.model.clone();
            return true;
        }
    }
    false
}

/// Whether little more than noise is left of every channel.
fn is_at_the_floor(model: &FittedModel) -> bool {
    let channels = model.problem.data.channels.iter().enumerate();
    channels.into_iter().all(|(c, channel)| {
        let (fitted, held_out) = model.residuals().rms(c);
        fitted.max(held_out) <= MOST_TIMES_FLOOR * channel.noise
    })
}

/// Accepts a set of one effect with a size for each record.
fn accept_single<'a>(
    found: &mut AcceptedResult<'a>,
    d: &DriftingNumber<'a>,
    which: usize,
    drifting: &[DriftingNumber<'a>],
) -> bool {
    let DriftingNumber { number, model, .. } = d;
    let (with, without) = (model.residuals().clone(), found.declared.residuals().clone());
    let judged = HeldOutComparison { with, without, left_out: Vec::new() };
    let effective = best_effective(&[found.declared.clone(), model.clone()]);
    let mut evidence = evidence_from(model, &found.declared, which, &effective, &judged, model.threads);
    // The sizes of all records but one are free beyond what a set is charged for.
    let more = number.values.len().saturating_sub(1) as f64;
    evidence.score -= more * libm::log(effective.iter().sum::<f64>().max(2.0));
    if rejection_reason(model, which, &evidence).is_some() || left_unexplained(model, &judged).is_some() {
        return false;
    }
    let own_score = score(model, &effective);
    let before = &found.best;
    let takes_a_place = !before.effects.is_empty() && before.identity() != model.identity();
    let charged = own_score + more * libm::log(effective.iter().sum::<f64>().max(2.0));
    if takes_a_place && charged > score(before, &effective) - MIN_SCORE_GAIN {
        return false;
    }
    let mut rivals: Vec<Rival> = Vec::new();
    for other in drifting {
        let is_clear = score(&other.model, &effective) > own_score + CLEAR_SCORE_GAP;
        let [h] = other.model.effects.as_slice() else { continue };
        let is_known = other.model.identity() == model.identity() || rivals.iter().any(|r| r.identity == h.identity());
        let is_degenerate = outside_the_records(&other.model, 0).is_some();
        if other.number.course != Course::NoOrder && !is_clear && !is_known && !is_degenerate {
            let (identity, path, score) = (h.identity(), h.path(), score(&other.model, &effective) - own_score);
            let judge_ratio = other.model.residuals().judge_ratio(model.residuals());
            rivals.push(Rival { identity, path, score, judge_ratio });
        }
    }
    let id = model.effects[which].identity();
    let replaced = found.best.identity();
    let is_replaced = |t: &&mut Trial| takes_a_place && t.beside.is_empty() && replaced == [t.identity.as_str()];
    let why = format!("{id}, with a size for each record, is better");
    found.trials.iter_mut().filter(is_replaced).for_each(|t| t.why.clone_from(&why));
    let own = |t: &&mut Trial| t.identity == id && t.beside.is_empty() && t.rms_fit.is_some();
    found.trials.iter_mut().filter(own).for_each(|t| t.why = "accepted, with a size for each record".into());
    found.rivals = vec![rivals];
    found.evidence = vec![evidence];
    found.best = model.clone();
    true
}
