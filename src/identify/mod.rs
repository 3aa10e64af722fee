//! Identification: compares measured records with a drive until the difference is named, or shown to have no name in
//! the catalogue.
//!
//! Sequence: facts -> structure -> baseline fit -> hypotheses, screened and fitted -> held-out score -> shams -> rivals
//! -> residual analysis -> report. The loop runs over the catalogue of effects and contains no physics of its own.

#[doc(hidden)]
pub mod accept;
mod accept_drifting;
pub mod basins;
pub mod by_direction;
#[doc(hidden)]
pub mod candidates;
#[doc(hidden)]
pub mod crossed;
#[doc(hidden)]
pub mod declared;
#[doc(hidden)]
pub mod diagnosis;
#[doc(hidden)]
pub mod drifting;
#[doc(hidden)]
pub mod fit;
mod input_noise;
#[doc(hidden)]
pub mod inverse;
#[doc(hidden)]
pub mod judge;
pub mod misread;
#[doc(hidden)]
pub mod model;
#[doc(hidden)]
pub mod moved;
#[doc(hidden)]
pub mod plausible;
pub mod predict;
#[doc(hidden)]
pub mod problem;
mod race;
pub mod report;
mod resolved;
#[doc(hidden)]
pub mod rivals;
#[doc(hidden)]
pub mod screen;
pub mod search;
mod settled;
mod softened;
#[doc(hidden)]
pub mod stats;
#[doc(hidden)]
pub mod steady;
mod stretches;
#[doc(hidden)]
pub mod structure;
pub mod text;
#[doc(hidden)]
pub mod unnamed;
pub mod updated;
mod waves;
#[doc(hidden)]
pub mod windows;

use crate::machine::Machine;
use crate::machine::fidelity::RecordsOfSensors;
use crate::machine::simulate::RunError;
use crate::measurement::Measurement;
use crate::measurement::segments::Data;
use predict::PredictedRecords;
use report::{IdentificationReport, IdentificationVerdict};
use search::Context;
use std::cell::OnceCell;
use std::sync::atomic::Ordering;

/// The declared model cannot be simulated over a record, so that there is nothing to compare.
#[derive(Clone, Debug, PartialEq)]
pub struct DeclaredModelFails {
    /// Name of the record.
    pub record: String,
    /// Why the model stopped.
    pub cause: RunError,
}

impl std::fmt::Display for DeclaredModelFails {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the declared model cannot follow record `{}`: {}", self.record, self.cause)
    }
}

impl std::error::Error for DeclaredModelFails {}

/// Single effects that are looked at again where one at most is accepted: their sizes may differ from record to record.
const LEADS: usize = 12;

/// Runs the whole identification: fits the free numbers of the machine to the records, searches the catalogue of effects for
/// what remains, and judges by records that took no part in the fit. The result does not depend on the number of threads,
/// unless the budget ends the search.
///
/// # Errors
/// The declared model cannot be simulated over one of the records.
pub fn identify(
    measurement: &Measurement,
    machine: &Machine,
    data: &Data,
    context: &Context,
) -> Result<IdentificationReport, DeclaredModelFails> {
    let own = judge::held_out_segments(data);
    let named = machine.for_records(RecordsOfSensors {
        noise: noise_of_sensors(machine, data),
        at_one_point_s: longest_at_one_point_s(machine, data),
    });
    let problem = declared::problem(measurement, &named, data, context);
    let start = problem.start();
    for (k, s) in data.segments.iter().enumerate() {
        if let Err(cause) = problem.model(k, &start.globals, &start.locals[k], false) {
            return Err(DeclaredModelFails { record: data.records[s.record].clone(), cause });
        }
    }
    let misread = misread::misread(&problem, &start, context);
    let records_on_the_way = Default::default();
    let searched = search::search(measurement, problem, &own, context);
    let (searched, begun) =
        predict::from_short_memory(measurement, (&named, &own), searched, &records_on_the_way, context);
    let leads = single_effects(&searched);
    let again = searched.is_settled.then(|| searched.declared.clone());
    let mut found = accept::accept(searched, None, &own, context);
    if let Some(declared) = again.filter(|_| found.best.effects.is_empty() && !context.must_end()) {
        // What inverse dynamics or a prediction had settled does not stand.
        let searched = search::search_from(measurement, declared, (Vec::new(), Vec::new()), &own, context);
        found = accept::accept(searched, None, &own, context);
    }
    context.report("looking whether numbers hang on the step");
    let mut unresolved = resolved::resolve(&mut found.best, &own, context);
    let mut report = report::report(measurement, data, &found);
    let mut has_course = false;
    let is_trending = || report.effects.iter().any(|e| steady::course(&e.sizes).is_some());
    if (!report.explained || is_trending()) && !context.must_end() {
        context.report("looking for numbers that differ from record to record");
        // A single effect may have taken the place of one whose size differs from record to record.
        let others = if found.best.effects.len() <= 1 { &leads[..] } else { &[] };
        let others: Vec<_> = others.iter().map(|m| m.finished().into_owned()).collect();
        let drifting = drifting::varying_numbers(&found.best, &others, context);
        has_course = accept_drifting::accept_drifting(&mut found, &drifting);
        if has_course {
            unresolved = resolved::resolve(&mut found.best, &own, context);
            report = report::report(measurement, data, &found);
        }
        report.varying = drifting.into_iter().take(drifting::TOLD).map(|d| d.number).collect();
        let proposed = report.varying.first().filter(|_| !has_course).map(drifting::VaryingNumber::experiment);
        report.next_experiment.splice(0..0, proposed);
    }
    report.warnings.extend(unresolved);
    let noisy: [OnceCell<(Data, Data)>; 2] = Default::default();
    if !has_course {
        let records = PredictedRecords { data, machine, named: &named, noisy: &noisy };
        (found, report) = predict::by_prediction(measurement, &records, begun, (found, report), context);
    }
    if declared::is_at_step_limit(&found.best) {
        let (most, machine) = (found.best.problem.max_steps, &found.best.problem.machine);
        let what = match machine.springs.is_empty() {
            true => "friction that is sharper at rest was not tried: a `stick_speed` here is an upper limit",
            false => "stiffer machines were not tried: give the stiffness and damping parameters `low` and `high`",
        };
        report.warnings.push(format!("the fit ended where a sample takes {most:.0} steps, and {what}"));
    }
    if report.outcome == IdentificationVerdict::Named && !context.must_end() {
        let held_out = found.best.own;
        if let Some((body, term)) = unnamed::one_in_place_of_several(&found.declared, &found.best, held_out, context) {
            report.doubts.push(format!(
                "one force of the form {term} on `{body}`, which no effect has, leaves as little as the effects by its speed together"
            ));
        }
    }
    // What comes after this changes no name for want of time.
    let cut_short = found.cut_short || context.must_end();
    if !context.must_end() {
        context.report("looking for other basins");
        report.basins = basins::basins(&found.best, context);
        report.doubts.extend(report.basins.iter().filter_map(basins::Basin::doubt));
    }
    if !context.must_end() {
        context.report("inverse dynamics: the same numbers by another way");
        report.set_inverse_dynamics(inverse::second_voice(&found.best, context));
    }
    let misread::Misread { doubts: mut misread, notes } = misread;
    for moved in moved::moved_numbers(measurement, &found.declared, &found.best) {
        if let Some(unit) = moved.as_unit() {
            if !misread.contains(&unit) {
                misread.push(unit);
            }
        } else if !moved.is_at_bound && report.is_confirmed(&moved.path) {
            report.warnings.push(moved.text + "; inverse dynamics gives the same number");
        } else if moved.is_implausible {
            report.doubts.push(moved.text);
        } else {
            report.warnings.push(moved.text);
        }
    }
    if !has_course {
        let drifting: Vec<String> = report.effects.iter().filter_map(drifting_size).collect();
        report.doubts.extend(drifting);
    }
    if !report.explained {
        report.doubts.extend(plausible::doubts(&found.declared, &found.best));
    }
    report.doubts.extend(plausible::sizes_that_no_machine_has(&found.best));
    context.report("analysing the residuals");
    report.diagnosis = diagnosis::diagnose(&found.declared, context.threads);
    if !report.effects.is_empty() {
        report.diagnosis_after = Some(diagnosis::diagnose(&found.best, context.threads));
    }
    if report.outcome == IdentificationVerdict::None && !report.explained && !context.must_end() {
        context.report("searching an unnamed formula");
        report.unnamed = unnamed::search(&found.best, &own, context);
    }
    if report.outcome == IdentificationVerdict::Named {
        report.outcome = match (report.doubts.is_empty() && misread.is_empty() && !cut_short, report.explained) {
            (false, _) => IdentificationVerdict::Lead,
            (true, false) => IdentificationVerdict::Part,
            (true, true) => IdentificationVerdict::Named,
        };
    }
    report.is_misread = !misread.is_empty();
    report.look_first = misread.into_iter().chain(notes).collect();
    report.interrupted = context.stop.load(Ordering::Relaxed);
    report.budget_spent = context.must_end() && !report.interrupted;
    report.model_runs = context.runs.load(Ordering::Relaxed);
    Ok(report)
}

/// A size that changes by this factor from the first record to the last is no constant. Not varied.
const CHANGES: f64 = 1.25;

/// What speaks against an effect of one size: it falls or rises with the records.
fn drifting_size(e: &report::NamedEffect) -> Option<String> {
    let [first, last] = steady::course(&e.sizes)?;
    let changes = first.max(last) > CHANGES * first.min(last);
    changes.then(|| {
        format!(
            "the size of `{}` goes from {first:.2} times its value in the first record to {last:.2} times in the last: no one size holds for all",
            e.path
        )
    })
}

/// Duration of the records at the operating point that has most [s].
fn longest_at_one_point_s(machine: &Machine, data: &Data) -> f64 {
    // What a record sets about the drive, in one order; gains of its sensors change no run.
    let point_of = |record: usize| {
        let of_drive = |(slot, _): &&(usize, f64)| !machine.slots[*slot].path.starts_with("sensors.");
        let mut own: Vec<(usize, f64)> = data.set[record].iter().filter(of_drive).copied().collect();
        own.sort_by_key(|(slot, _)| *slot);
        own
    };
    let takes_part = |record: &usize| data.segments.iter().any(|s| s.record == *record);
    let points: Vec<(Vec<(usize, f64)>, f64)> = (0..data.set.len().min(data.clocks.len()))
        .filter(takes_part)
        .map(|record| (point_of(record), data.clocks[record].length_s))
        .collect();
    let together = |(point, _): &(Vec<(usize, f64)>, f64)| -> f64 {
        points.iter().filter(|(other, _)| other == point).map(|(_, length_s)| length_s).sum()
    };
    points.iter().map(together).fold(0.0, f64::max)
}

/// Noise of the channel of every sensor, in SI units of its reading; 0: no channel reads it.
fn noise_of_sensors(machine: &Machine, data: &Data) -> Vec<f64> {
    let mut noise = vec![0.0; machine.sensors.len()];
    for c in &data.channels {
        let gain = machine.values[machine.sensors[c.sensor].gain].abs();
        noise[c.sensor] = c.noise / gain.max(1e-300);
    }
    noise
}

/// The best models with one effect, each effect once.
fn single_effects<'a>(searched: &search::SearchResult<'a>) -> Vec<model::FittedModel<'a>> {
    let mut all: Vec<model::FittedModel> = Vec::new();
    for m in searched.all.iter().filter(|m| m.effects.len() == 1) {
        if all.len() < LEADS && all.iter().all(|known| known.identity() != m.identity()) {
            all.push(m.clone());
        }
    }
    all
}
