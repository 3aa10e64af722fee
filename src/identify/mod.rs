//! Identification: compares measured records with a drive until the difference is named, or shown to have no name in
//! the catalogue.
//!
//! Sequence: facts -> structure -> baseline fit -> hypotheses, screened and fitted -> held-out score -> shams -> rivals
//! -> residual analysis -> report. The loop runs over the catalogue of effects and contains no physics of its own.

pub mod accept;
pub mod candidates;
pub mod crossed;
pub mod diagnosis;
pub mod fit;
pub mod judge;
pub mod model;
pub mod plant;
pub mod problem;
pub mod report;
pub mod screen;
pub mod search;
pub mod stats;
pub mod steady;
pub mod structure;
pub mod text;
pub mod unnamed;
pub mod windows;

use crate::machine::Machine;
use crate::measurement::Measurement;
use crate::measurement::segments::Data;
use report::{IdentificationReport, IdentificationVerdict};
use search::Context;
use std::sync::atomic::Ordering;

/// Runs the whole identification. `Err` says why the declared model cannot be simulated at all.
pub fn identify(
    measurement: &Measurement,
    machine: &Machine,
    data: &Data,
    context: &Context,
) -> Result<IdentificationReport, String> {
    let own = judge::held_out_segments(data);
    let problem = search::declared(measurement, machine, data, context);
    let start = problem.start();
    for (k, s) in data.segments.iter().enumerate() {
        if let Err(e) = problem.model(k, &start.globals, &start.locals[k], false) {
            return Err(format!("the declared model cannot follow record `{}`: {e}", data.records[s.record]));
        }
    }
    let searched = search::search(measurement, problem, &own, context);
    let found = accept::accept(searched, &own, context);
    let cut_short = found.cut_short || context.must_end();
    let mut report = report::report(measurement, data, &found);
    if search::is_at_step_limit(&found.best) {
        let most = found.best.problem.max_steps;
        report.warnings.push(format!(
            "the fit ended where a sample takes {most:.0} steps, and stiffer machines were not tried: give the stiffness and damping parameters `low` and `high`"
        ));
    }
    report.warnings.extend(search::moved_parameters(&found.declared, &found.best));
    context.report("analysing the residuals");
    report.diagnosis = diagnosis::diagnose(&found.declared, context.threads);
    if !report.effects.is_empty() {
        report.diagnosis_after = Some(diagnosis::diagnose(&found.best, context.threads));
    }
    if report.outcome == IdentificationVerdict::None
        && !report.explained
        && !context.must_end()
        && context.plant.is_none()
    {
        context.report("searching an unnamed formula");
        report.unnamed = unnamed::search(&found.best, &own, context);
    }
    report.interrupted = context.stop.load(Ordering::Relaxed);
    report.budget_spent = cut_short && !report.interrupted;
    report.model_runs = context.runs.load(Ordering::Relaxed);
    Ok(report)
}
