//! A run of a drive in few calls: assembled, stepped, recorded, stopped at break expressions.

use super::{Breaks, Job, RunLength, Summary, run_job};
use crate::assemble::{Assembly, AssemblyError, assemble};
use crate::breakpoint::scratch::BreakWatch;
use crate::breakpoint::{Breakpoint, Names};
use crate::diag::Report;
use crate::drive::Drive;
use crate::impacts::ImpactWatch;
use crate::integrate::explicit::Scratch;
use crate::integrate::{StepError, scheme};
use crate::model::Model;
use crate::recording::capture::{self, Camera};
use crate::recording::frame::{Frame, Header};
use crate::recording::{ViewOptions, create};
use crate::state::State;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// A drive that has been assembled and can be run. For sinks of one's own, windows around hits or an end from outside, see
/// [`run_job`], which this is made of.
pub struct Simulation {
    model: Model,
    state: State,
    scratch: Scratch,
    header: Header,
    names: Names,
    breakpoints: Vec<Breakpoint>,
    has_run: bool,
}

impl Simulation {
    /// Compiles and assembles a drive: preload, static equilibrium, run-in. This takes about a tenth of a second for the
    /// bundled drives.
    ///
    /// # Errors
    /// The drive contradicts itself, has no static equilibrium, or breaks down while it runs in.
    pub fn new(drive: &Drive) -> Result<Simulation, AssemblyError> {
        let Assembly { model, state, report } = assemble(drive)?;
        let mut header = capture::header(drive, &model, &report, 1);
        header.ledger_origin = Some(capture::ledger_at(&model, &state).map_err(AssemblyError::RunIn)?);
        let scratch = Scratch::new(&model);
        let names = Names::of(drive);
        Ok(Simulation { model, state, scratch, header, names, breakpoints: Vec::new(), has_run: false })
    }

    /// Makes every run from here on end at the first step that fulfils this break expression, for example
    /// `impact.approach_speed > 1 m/s`. May be called several times: a run ends at whichever is fulfilled first.
    ///
    /// # Errors
    /// Whatever is wrong with the expression, with its place.
    pub fn stop_at(&mut self, expression: &str) -> Result<(), Report> {
        self.breakpoints.push(Breakpoint::parse(expression, &self.names)?);
        Ok(())
    }

    /// Runs for `duration_s` [s] from the present step, with a frame every `every_s` [s], rounded down to whole steps.
    /// Writes the frames to `recordings`, whose extension (`.mcap`, or `.rrd` with the feature `rerun`) says of what kind
    /// they are. A second call continues where the first ended; parts that touch then are not counted as impacts before they
    /// have separated.
    ///
    /// # Errors
    /// A recording cannot be written. A run that breaks down is no error: see [`Summary::ending`].
    pub fn run(&mut self, duration_s: f64, every_s: f64, recordings: &[&Path]) -> anyhow::Result<Summary> {
        static NEVER: AtomicBool = AtomicBool::new(false);
        let span = RunLength::new(duration_s, every_s, self.model.step_s);
        self.header.steps_per_frame = span.steps_per_frame;
        let header = &self.header;
        let mut sinks = Vec::new();
        for path in recordings {
            sinks.push(create(path, header, ViewOptions::default())?);
        }
        let watches: Vec<BreakWatch> =
            self.breakpoints.iter().map(|b| BreakWatch::new(b.clone(), &self.model)).collect();
        let job = Job {
            header,
            span,
            breaks: (!watches.is_empty()).then_some(Breaks { watches, hits: Some(1), around: None }),
            impacts: if self.has_run {
                ImpactWatch::for_continued_run(&self.model, self.state.step)
            } else {
                ImpactWatch::new(&self.model)
            },
            camera: Camera::since(header.ledger_origin),
        };
        self.has_run = true;
        let summary = run_job(&self.model, &mut self.state, &mut self.scratch, job, &mut sinks, &NEVER, |_| ())?;
        for sink in &mut sinks {
            sink.finish()?;
        }
        Ok(summary)
    }

    /// Everything at the present step: poses, joints, contacts, energies.
    ///
    /// # Errors
    /// The step cannot be computed, as after a run that broke down.
    pub fn frame(&mut self) -> Result<Frame, StepError> {
        scheme::evaluate(&self.model, &self.state, &mut self.scratch)?;
        Ok(Camera::since(self.header.ledger_origin).take(&self.model, &self.state, &self.scratch))
    }

    /// What recordings of this drive begin with: names, masses and outlines of links and bodies, step, assembly.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The compiled drive.
    pub fn model(&self) -> &Model {
        &self.model
    }
}
