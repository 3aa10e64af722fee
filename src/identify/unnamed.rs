//! Unexplained remainder: the residual force on the body where it is simplest, as a curve and as the shortest formula
//! that also holds on held-out records. It never gets a physical name.

use super::candidates::Hypothesis;
use super::diagnosis::StateLine;
use super::fit::Fit;
use super::judge::mean_error;
use super::model::{FIT_ITERATIONS, FittedModel, placed_path, refit_with, refitted};
use super::screen::{FitStart, LinearisedBase, screen};
use super::search::Context;
use crate::effects::{
    BodyAt, BodyLaw, Effect, HighestOrder, Kin, Kind, On, Parameter, Part, Physics, Scale, coulomb_friction,
    quadratic_drag, viscous_friction,
};
use crate::machine::{Body, Machine, Target};
use crate::measurement::segments::Data;
use crate::side_by_side::parallel;
use serde::Serialize;

/// A force law without a name.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unnamed {
    pub body: String,
    /// In SI; q and v are angle or position and speed of the body.
    pub formula: String,
    pub terms: Vec<(String, f64)>,
    /// Held-out error with it, relative to that without it.
    pub judge_ratio: [f64; 3],
    /// Speed range in which the records determine it [rad/s or m/s].
    pub from_speed: f64,
    pub to_speed: f64,
}

/// Library of terms: notation and function.
const LIBRARY: [(&str, BodyLaw); 12] = [
    ("1", |p, _| p[0]),
    ("v", |p, at| p[0] * at.v),
    ("v |v|", |p, at| p[0] * at.v * at.v.abs()),
    ("v^3", |p, at| p[0] * at.v * at.v * at.v),
    ("sign(v)", |p, at| p[0] * crate::effects::soft_sign(at.v, 0.05)),
    ("sign(v) exp(-|v|)", |p, at| p[0] * crate::effects::soft_sign(at.v, 0.05) * libm::exp(-at.v.abs())),
    ("q", |p, at| p[0] * at.q),
    ("q^3", |p, at| p[0] * at.q * at.q * at.q),
    ("sin(q)", |p, at| p[0] * libm::sin(at.q)),
    ("cos(q)", |p, at| p[0] * libm::cos(at.q)),
    ("sin(2 q)", |p, at| p[0] * libm::sin(2.0 * at.q)),
    ("cos(2 q)", |p, at| p[0] * libm::cos(2.0 * at.q)),
];

const SIZE: Parameter = Parameter::new("size", 1.0, -1e12, 1e12, Kind::Amplitude).starts(Scale::Force, &[0.1]);

/// The library as effects, so that its terms are fitted like named effects.
fn effect(index: usize) -> &'static Effect {
    static ROWS: std::sync::OnceLock<Vec<Effect>> = std::sync::OnceLock::new();
    let rows = ROWS.get_or_init(|| {
        LIBRARY
            .iter()
            .map(|(name, law)| Effect {
                name,
                title: "Term of an unnamed force",
                part: Part::Load,
                on: On::Body,
                equation: name,
                source: "library of terms",
                order: "",
                speed_law: "",
                channels: "",
                parameters: &[SIZE],
                dissipative: false,
                physics: Physics::BodyForce(*law),
                links: None,
                highest_order: HighestOrder::None,
                kin: Kin::NONE,
            })
            .collect()
    });
    &rows[index]
}

/// Bodies that an unnamed force may act on.
fn bodies(m: &Machine) -> Vec<usize> {
    let of = |(_, target)| if let Target::Body(b) = target { Some(b) } else { None };
    m.targets(effect(0)).into_iter().filter_map(of).collect()
}

/// Whether a term of the library has a meaning on a body: a wave over the position has none where that is a distance.
fn is_meant_for(term: usize, body: &Body) -> bool {
    !(body.slides && WAVES.contains(&LIBRARY[term].0))
}

/// Terms of the library that are waves over an angle.
const WAVES: [&str; 4] = ["sin(q)", "cos(q)", "sin(2 q)", "cos(2 q)"];

/// Maximum number of terms of a formula.
const MAX_TERMS: usize = 3;

/// The shortest formula for the remainder, if one holds.
pub fn search<'a>(best: &FittedModel<'a>, own: &'a Data, context: &Context<'_>) -> Option<Unnamed> {
    let m = &best.problem.machine;
    let mut found: Option<(FittedModel<'a>, usize, Vec<usize>)> = None;
    for b in bodies(m) {
        let mut model = best.clone();
        let mut terms: Vec<usize> = Vec::new();
        while terms.len() < MAX_TERMS && !context.must_end() {
            let Some((term, next)) = one_more(&model, b, &terms, own, context) else { break };
            let ratio = next.residuals().judge_ratio(model.residuals());
            if ratio[2] >= 1.0 || ratio[0] > 0.97 {
                break;
            }
            terms.push(term);
            model = next;
        }
        let error = |m: &FittedModel| mean_error(&m.residuals().judge);
        let better = |old: &FittedModel| error(&model) < error(old);
        if !terms.is_empty() && found.as_ref().is_none_or(|(old, ..)| better(old)) {
            found = Some((model, b, terms));
        }
    }
    let (model, b, terms) = found?;
    let first = best.problem.globals.len();
    let values: Vec<(String, f64)> = terms
        .iter()
        .enumerate()
        .map(|(i, t)| {
            let g = &model.problem.globals[first + i];
            (LIBRARY[*t].0.to_string(), g.law.value(model.fit.point.globals[first + i]))
        })
        .collect();
    let formula = values.iter().map(|(term, x)| format!("{x:+.4e} {term}")).collect::<Vec<_>>().join(" ");
    let speeds = best.problem.speeds_of(&best.fit.point, b);
    Some(Unnamed {
        body: m.bodies[b].path.clone(),
        formula: format!("r = {formula}"),
        terms: values,
        judge_ratio: model.residuals().judge_ratio(best.residuals()),
        from_speed: speeds.0,
        to_speed: speeds.1,
    })
}

/// Terms in a body's speed that could replace an effect's load, each of the same size at the body's usual speed. Empty
/// if the effect is not a load that depends on speed. The effect's own law is left out, also in another smoothing of
/// the same friction.
pub fn in_place_of(model: &FittedModel, which: usize) -> Vec<Hypothesis> {
    let h = &model.effects[which];
    let (Target::Body(body), Physics::BodyForce(law)) = (h.target, h.effect.physics) else { return Vec::new() };
    if !bodies(&model.problem.machine).contains(&body) || h.phase().is_some() {
        return Vec::new();
    }
    let path = placed_path(model, which);
    let m = &model.problem.machine;
    let Some(placed) = m.placed.iter().find(|p| p.path == path) else { return Vec::new() };
    let number = |slot: &usize| {
        let free = model.problem.globals.iter().zip(&model.fit.point.globals).find(|(g, _)| g.slot == *slot);
        free.map_or(m.values[*slot], |(g, x)| g.law.value(*x))
    };
    let numbers: Vec<f64> = placed.slots.iter().map(number).collect();
    let sizes = super::candidates::Sizes::new(&model.problem, &model.fit.point);
    let at = BodyAt { q: 0.0, v: sizes.speed(body) };
    let force = law(&numbers, at);
    let own_form = OWN_FORM.iter().find(|(effect, _)| *effect == h.effect).map(|(_, form)| *form);
    let by_speed = (0..LIBRARY.len()).filter(|t| IN_SPEED.contains(&LIBRARY[*t].0) && Some(LIBRARY[*t].0) != own_form);
    by_speed
        .map(|t| {
            let size = force / LIBRARY[t].1(&[1.0], at);
            Hypothesis { values: vec![size], ..hypothesis(model, body, t, sizes.force(body)) }
        })
        .filter(|h| h.values[0].is_finite() && h.values[0] != 0.0)
        .collect()
}

/// A body on which several effects of the set act by its speed, and one term that no effect has as its law and that leaves as little in place of them
/// all: the set may then be no more than a shape of that law.
pub fn one_in_place_of_several<'a>(
    declared: &FittedModel<'a>,
    best: &FittedModel<'a>,
    own: &'a Data,
    context: &Context<'_>,
) -> Option<(String, &'static str)> {
    let records = best.problem.data.records.len();
    for body in bodies(&best.problem.machine) {
        let acts = |which: &usize| {
            best.effects[*which].target == Target::Body(body)
                && !in_place_of(best, *which).is_empty()
                && depends_on_speed(best, *which)
        };
        let (several, kept): (Vec<usize>, Vec<usize>) = (0..best.effects.len()).partition(acts);
        if several.len() < 2 {
            continue;
        }
        let sizes = super::candidates::Sizes::new(&best.problem, &best.fit.point);
        let force = sizes.force(body);
        let terms: Vec<usize> = (0..LIBRARY.len()).filter(|t| NAMELESS.contains(&LIBRARY[*t].0)).collect();
        let models = parallel(terms.len(), context.threads, |i| {
            let h = hypothesis(best, body, terms[i], force);
            let of_one = LIBRARY[terms[i]].1(&[1.0], BodyAt { q: 0.0, v: sizes.speed(body) });
            let start =
                FitStart { values: vec![-0.1 * force / of_one], phases: vec![0.0; records], travels: Vec::new() };
            (!context.must_end()).then(|| refitted(declared, best, &kept, Some((&h, &start)), own, 1, FIT_ITERATIONS))
        });
        let fitted = models.into_iter().flatten().zip(&terms);
        let mut as_good = fitted.filter(|(m, _)| m.residuals().judge_ratio(best.residuals())[0] < AS_LITTLE);
        if let Some((_, term)) = as_good.next() {
            return Some((best.problem.machine.bodies[body].name.clone(), LIBRARY[*term].0));
        }
    }
    None
}

/// Terms of the speed that are the law of no effect.
const NAMELESS: [&str; 1] = ["v^3"];

/// Whether the force of a load differs between two speeds.
fn depends_on_speed(model: &FittedModel, which: usize) -> bool {
    let Physics::BodyForce(law) = model.effects[which].effect.physics else { return false };
    let numbers = vec![1.0; model.effects[which].effect.parameters.len()];
    let at = |v: f64| law(&numbers, BodyAt { q: 0.0, v });
    at(1.0) != at(-1.0)
}

/// Held-out error of one term over that of the effects that it replaces, up to which it leaves as little. Not varied.
const AS_LITTLE: f64 = 1.02;

/// Terms of the library that depend on speed alone.
const IN_SPEED: [&str; 4] = ["v", "v |v|", "v^3", "sign(v)"];

/// Effects whose law is one of these terms.
const OWN_FORM: [(&Effect, &str); 3] =
    [(&viscous_friction::ROW, "v"), (&quadratic_drag::ROW, "v |v|"), (&coulomb_friction::ROW, "sign(v)")];

/// Share of a model's remaining error that a small force of every term on every free body would remove.
pub fn forces(model: &FittedModel, threads: usize) -> Vec<StateLine> {
    let m = &model.problem.machine;
    let all: Vec<(usize, usize)> = bodies(m)
        .into_iter()
        .flat_map(|b| (0..LIBRARY.len()).map(move |t| (b, t)))
        .filter(|(b, t)| is_meant_for(*t, &m.bodies[*b]))
        .collect();
    if all.is_empty() {
        return Vec::new();
    }
    let base = LinearisedBase::new(&model.problem, &model.fit);
    let sizes = super::candidates::Sizes::new(&model.problem, &model.fit.point);
    parallel(all.len(), threads, |i| {
        let (b, t) = all[i];
        let h = hypothesis(model, b, t, sizes.force(b));
        let share = screen(&model.problem, &base, &model.fit, &h).gain;
        StateLine { body: m.bodies[b].path.clone(), term: LIBRARY[t].0.into(), share }
    })
}

fn hypothesis(model: &FittedModel, body: usize, term: usize, scale: f64) -> Hypothesis {
    Hypothesis {
        effect: effect(term),
        name: model.problem.machine.bodies[body].name.clone(),
        target: Target::Body(body),
        values: vec![0.1 * scale],
        rows: vec![&effect(term).parameters[0]],
        scales: vec![scale],
        has_place: false,
        own_locals: 0,
    }
}

/// The term that explains most, fitted beside the others.
fn one_more<'a>(
    model: &FittedModel<'a>,
    body: usize,
    taken: &[usize],
    own: &'a Data,
    context: &Context<'_>,
) -> Option<(usize, FittedModel<'a>)> {
    let fit: &Fit = &model.fit;
    let base = LinearisedBase::new(&model.problem, fit);
    let sizes = super::candidates::Sizes::new(&model.problem, &fit.point);
    let scale = sizes.force(body);
    let hypothesis = |t: usize| hypothesis(model, body, t, scale);
    let gains = parallel(LIBRARY.len(), context.threads, |t| {
        let is_out = taken.contains(&t) || !is_meant_for(t, &model.problem.machine.bodies[body]);
        if is_out { 0.0 } else { screen(&model.problem, &base, fit, &hypothesis(t)).gain }
    });
    let term = (0..LIBRARY.len()).max_by(|a, b| gains[*a].total_cmp(&gains[*b]))?;
    if gains[term] < 0.02 {
        return None;
    }
    let h = hypothesis(term);
    let p = screen(&model.problem, &base, fit, &h);
    Some((term, refit_with(model, &h, &p.fit_start, own, context.threads)))
}
