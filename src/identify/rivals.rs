//! Rivals of an accepted effect: other effects that fit as well in its place.
//!
//! Each alternative that was fitted at any stage, or that looked alike from the start, takes the effect's place and is fitted there. Those that leave
//! as much are rivals, and where the effects leave more than noise also those that leave little more: what is still missing may make the difference. One that leaves clearly less takes the effect's place: beside these effects it may never have been fitted in the search, or its
//! fit may have missed its minimum there.

use super::accept::CLEAR_SCORE_GAP;
use super::candidates::Hypothesis;
use super::model::{FIT_ITERATIONS, FittedModel, begin_again, refitted, score, without_effect};
use super::plausible::outside_the_records;
use super::race::fit_against;
use super::screen::{FitStart, LinearisedBase, screen};
use super::search::{Context, MAX_SCORE_GAP, Trial};
use super::stats;
use super::structure::IndistinguishablePair;
use crate::effects::Kind;
use crate::measurement::segments::Data;
use crate::side_by_side::parallel;

/// Another effect that fits as well in the place of an accepted one.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Rival {
    pub identity: String,
    pub path: String,
    pub score: f64,
    pub judge_ratio: [f64; 3],
}

/// A hypothesis whose gain as a small addition is a smaller share of the effect's own is not fitted in its place. Twice and
/// half of it change no name of the 16 cases of tests/blind_share.rs.
const RIVAL_GAIN: f64 = 0.25;
/// Up to this multiple of what does not repeat itself in the means of two runs, their difference may be that alone: sqrt(2) is
/// expected of two runs of one drive. measured: a constant load against the same friction 0.14 to 0.68, against drag 1.3 to 59.
const SAME_MEANS: f64 = 2.0;

/// Whether two models give the same output but for what does not repeat itself in their runs. A score may still prefer one, by chance.
fn are_the_same(a: &FittedModel, b: &FittedModel) -> bool {
    let Some(unrepeated) = b.problem.unrepeated(&b.fit.point) else { return false };
    let apart = |c: usize| {
        let parts = a.fit_residuals[c].iter().zip(&b.fit_residuals[c]);
        let differences: Vec<Vec<f64>> = parts.map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect();
        stats::rms(&differences)
    };
    unrepeated.iter().enumerate().all(|(c, u)| apart(c) <= SAME_MEANS * u.in_mean)
}

/// What is left above the noise floor may hide a cause that favours one set before another. A rival with as few numbers that leaves up to this multiple of the
/// squared error above the floor is not excluded by the difference. Not varied. measured: 1.2, of the true damper beside false friction.
const AS_UNEXPLAINED: f64 = 1.5;

/// Whether a model whose effects leave more than noise is parted from the best one by less than what neither of them explains.
fn is_as_unexplained(rival: &FittedModel, best: &FittedModel) -> bool {
    let problem = &best.problem;
    if !problem.machine.effort().noise_alone_is_left || best.is_explained() || rival.freedom() > best.freedom() {
        return false;
    }
    let is_near = |c: usize, rival: f64, best: f64| {
        let floor = problem.data.channels[c].noise.powi(2);
        let above = |rms: f64| (rms * rms - floor).max(0.0);
        above(rival) <= AS_UNEXPLAINED * above(best) + CHANCE * floor
    };
    let channels = 0..problem.data.channels.len();
    // Held-out records take a fit of their own: they are asked last.
    let fitted = |m: &FittedModel, c: usize| stats::rms(&m.fit_residuals[c]);
    channels.clone().all(|c| is_near(c, fitted(rival, c), fitted(best, c)))
        && channels.into_iter().all(|c| {
            let (of_rival, of_best) = (rival.residuals().rms(c).1, best.residuals().rms(c).1);
            !of_best.is_finite() || is_near(c, of_rival, of_best)
        })
}

/// Share of the squared noise by which an error above the floor differs by chance.
const CHANCE: f64 = 0.02;

/// Where the best model leaves more than noise, a rival that promises to leave more than this multiple of its squared error is given up: what is
/// missing may bend its linear model. Not varied.
const UNEXPLAINED_FAR: f64 = 9.0;

/// The best model with another hypothesis in place of an effect, fitted; None: it stays far from the best model.
pub(super) fn rival_of<'a>(
    declared: &FittedModel<'a>,
    best: &FittedModel<'a>,
    rest: &[usize],
    (h, fit_start): (&Hypothesis, &FitStart),
    own: &'a Data,
) -> Option<FittedModel<'a>> {
    if !best.problem.machine.effort().is_thorough {
        return Some(refitted(declared, best, rest, Some((h, fit_start)), own, 1, FIT_ITERATIONS));
    }
    let is_behind = |score: f64, share: f64| score > MAX_SCORE_GAP && (share > UNEXPLAINED_FAR || best.is_explained());
    fit_against(begin_again(declared, best, rest, Some((h, fit_start)), 1), best, is_behind, own)
}

/// Replaces every effect of the best model by each alternative that was examined, and keeps those that fit as well; and the best model that fits
/// clearly better, in held-out records too, if there is one.
pub(super) fn rivals<'a>(
    declared: &FittedModel<'a>,
    best: &FittedModel<'a>,
    all: &[FittedModel<'a>],
    (hypotheses, alike, is_settled): (&[Hypothesis], &[IndistinguishablePair], bool),
    effective: &[f64],
    own: &'a Data,
    context: &Context<'_>,
    trials: &mut [Trial],
) -> (Vec<Vec<Rival>>, Option<FittedModel<'a>>) {
    let best_score = score(best, effective);
    let mut better: Option<FittedModel<'a>> = None;
    let mut rivals = Vec::new();
    for which in 0..best.effects.len() {
        let id = best.effects[which].identity();
        let rest: Vec<usize> = (0..best.effects.len()).filter(|i| *i != which).collect();
        let mut mine: Vec<Rival> = Vec::new();
        context.report("looking for rivals");
        let less = without_effect(declared, best, which, own, context.threads);
        // Alternatives are the hypotheses that were fitted at any stage, and those whose columns looked alike from the
        // start, in their own form and with sharper shapes, even if they explained little in their own form.
        let taken = |other: &str| best.effects.iter().any(|b| b.identity() == other);
        let twin = |h: &&Hypothesis| {
            let other = h.identity();
            let is_pair = |a: &IndistinguishablePair| (a.a == id && a.b == other) || (a.b == id && a.a == other);
            !taken(&other) && alike.iter().any(is_pair)
        };
        let twins: Vec<Hypothesis> = hypotheses.iter().filter(twin).flat_map(in_both_forms).collect();
        let mut tried: Vec<&Hypothesis> = twins.iter().collect();
        // Where the search began at a set, its effects were never fitted against others: screening decides which are.
        let others: &[Hypothesis] = if is_settled { hypotheses } else { &[] };
        for h in all.iter().flat_map(|m| &m.effects).chain(others) {
            let own_id = h.identity();
            if !taken(&own_id) && own_id != id && tried.iter().all(|t| t.identity() != own_id) {
                tried.push(h);
            }
        }
        let base = LinearisedBase::new(&less.problem, &less.fit);
        let own_gain = screen(&less.problem, &base, &less.fit, &best.effects[which]).gain;
        let models = parallel(tried.len(), context.threads, |i| {
            if context.must_end() {
                return None;
            }
            let p = screen(&less.problem, &base, &less.fit, tried[i]);
            // A hypothesis that explains far less as a small addition is not a rival.
            if !p.columns.is_empty() && p.gain < RIVAL_GAIN * own_gain {
                return None;
            }
            rival_of(declared, best, &rest, (tried[i], &p.fit_start), own)
        });
        for m in models.into_iter().flatten() {
            let worse = score(&m, effective) - best_score;
            let Some(h) = m.effects.last() else { continue };
            let same = are_the_same(&m, best);
            // Friction that bends beyond the speeds of the records is the damper that it is held against.
            let is_degenerate =
                m.effects.len().checked_sub(1).is_some_and(|last| outside_the_records(&m, last).is_some());
            let is_open = same || !is_degenerate && is_as_unexplained(&m, best);
            if is_degenerate || worse >= CLEAR_SCORE_GAP && !is_open {
                continue;
            }
            let ratio = m.residuals().judge_ratio(best.residuals());
            let is_clear = worse < -CLEAR_SCORE_GAP && ratio[2] < 1.0 && !same;
            let is_best = better.as_ref().is_none_or(|b| score(&m, effective) < score(b, effective));
            if is_clear && is_best {
                better = Some(m.clone());
            }
            if ratio[1] < 1.02 || is_open {
                mine.push(Rival { identity: h.identity(), path: h.path(), score: worse, judge_ratio: ratio });
                for t in trials.iter_mut().filter(|t| t.identity == h.identity()) {
                    t.why = format!("cannot be told from {id}");
                }
            }
        }
        mine.sort_by(|a, b| a.score.total_cmp(&b.score));
        let mut known: Vec<String> = Vec::new();
        mine.retain(|r| {
            let new = !known.contains(&r.identity);
            known.push(r.identity.clone());
            new
        });
        rivals.push(mine);
    }
    (rivals, better)
}

/// A hypothesis, and the same with sharper shapes if it has any.
fn in_both_forms(h: &Hypothesis) -> Vec<Hypothesis> {
    let sharp = narrowed(h);
    if sharp.values == h.values { vec![sharp] } else { vec![h.clone(), sharp] }
}

/// The hypothesis with shape parameters a thirtieth as wide, which then approximate a jump or step that they would
/// round off.
fn narrowed(h: &Hypothesis) -> Hypothesis {
    let mut sharp = h.clone();
    for (value, row) in sharp.values.iter_mut().zip(&h.rows) {
        if row.kind == Kind::Shape {
            *value /= 30.0;
        }
    }
    sharp
}
