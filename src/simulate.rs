//! The simulation loop: steps, frames for sinks, keyframes, impacts, breakpoints, interruption.
//!
//! With a window around breakpoints, recorded items are held back for as long as the window reaches back. At a hit the
//! run is repeated from a snapshot of the State before the window and recorded densely, with bit-identical steps.

mod lift_off;
mod simulation;

pub use lift_off::{LiftOff, LiftOffWatch};
pub use simulation::Simulation;

use crate::breakpoint::scratch::BreakWatch;
use crate::breakpoint::{Hit, Subject};
use crate::impacts::{ImpactWatch, WATCHED_PERIODS};
use crate::integrate::explicit::{RequiredData, Scratch};
use crate::integrate::scheme::SchemeSummary;
use crate::integrate::{StepError, scheme};
use crate::model::Model;
use crate::recording::Sink;
use crate::recording::capture::Camera;
use crate::recording::columns::ColumnKind;
use crate::recording::frame::{Energy, Event, Feature, Frame, Header, Impact, Keyframe, Segment};
use crate::state::State;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};

/// Maximum number of frames between keyframes.
pub const FRAMES_PER_KEYFRAME: u64 = 1000;
/// Maximum simulated time between keyframes [s]: if frames are far apart, going back must not take the whole run.
const LONGEST_KEYFRAME_S: f64 = 60e-3;
/// One of so many frames is taken if no sink records them.
const FRAMES_PER_LEDGER: u64 = 64;
/// First contacts slower than this are no events [m/s], for example a wrapped bush that separates and returns.
pub const SLOWEST_EVENT_M_S: f64 = 0.02;
/// Maximum number of stored hits; more are only counted.
pub const MAX_HITS: usize = 10_000;

/// Duration and frame interval of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunLength {
    /// Steps to take.
    pub steps: u64,
    /// Steps between two frames.
    pub steps_per_frame: u64,
}

impl RunLength {
    /// Whole steps for a duration and a frame interval [s].
    pub fn new(duration_s: f64, every_s: f64, step_s: f64) -> RunLength {
        let steps_per_frame = (every_s / step_s * (1.0 + 1e-9)).floor().max(1.0) as u64;
        RunLength { steps: (duration_s / step_s).round().max(1.0) as u64, steps_per_frame }
    }
}

/// Where a run stops, or is recorded more densely.
pub struct Breaks {
    /// The expressions, each with what it remembers of the step before.
    pub watches: Vec<BreakWatch>,
    /// Hits after which the run ends; None: it continues.
    pub hits: Option<usize>,
    /// Recorded densely round every hit; None: as the rest.
    pub around: Option<DenseWindow>,
}

/// A window around a hit that is recorded more densely.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DenseWindow {
    /// Steps before and after the hit.
    pub steps: u64,
    /// Steps between two frames in the window.
    pub steps_per_frame: u64,
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Ending {
    /// All steps were taken.
    Done,
    /// At a breakpoint.
    Hit,
    /// Interrupted after a whole step.
    Interrupted,
    /// The step could not be computed: the last frames are those before it.
    Broke(StepError),
}

/// Summary of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Why it ended.
    pub ending: Ending,
    /// Steps taken.
    pub steps: u64,
    /// Frames recorded, or taken where there is no sink.
    pub frames: u64,
    /// XXH3-64 of the last State.
    pub state_hash: u64,
    /// At the last frame; for a run without a sink that breaks down, up to 63 frames before.
    pub energy: Energy,
    /// Stored energy at the first and at the last frame [J].
    pub stored_first_j: f64,
    /// Stored energy at the last frame [J].
    pub stored_last_j: f64,
    /// At most [`MAX_HITS`] of them.
    pub hits: Vec<Hit>,
    /// Number of hits, of which `hits` lists the first ones.
    pub n_hits: u64,
    /// None: not detected.
    pub impacts: Option<u64>,
    /// Valves that left their cams.
    pub lift_offs: Vec<LiftOff>,
    /// How another scheme than the leapfrog did.
    pub scheme: Option<SchemeSummary>,
}

/// Inputs of a run besides the model and its State.
pub struct Job<'a> {
    /// Header of the recordings; says the interval of frames.
    pub header: &'a Header,
    /// Duration and frame interval.
    pub span: RunLength,
    /// Break expressions, where there are any.
    pub breaks: Option<Breaks>,
    /// Has observed the previous steps, if there are any.
    pub impacts: ImpactWatch,
    /// Takes frames; knows where the energy ledger began.
    pub camera: Camera,
}

/// An item for the sinks.
enum SinkItem {
    Frame(Box<Frame>),
    Keyframe(Box<Keyframe>),
    Event(Event),
    Impact(Impact),
}

/// Passes the output of a run to the sinks; holds items back while windows may still change them.
struct Recorder<'a, 's> {
    model: &'a Model,
    sinks: &'s mut [Box<dyn Sink>],
    camera: Camera,
    held: VecDeque<(u64, SinkItem)>,
    hold_steps: u64,
    frames: u64,
    since_keyframe: u64,
    /// Step of the last keyframe.
    keyframe_step: Option<u64>,
    energies: Option<(f64, Energy)>,
}

/// Runs `span` from `state`, with frames at its first and last step and in between. `stop` ends it after a step;
/// `progress` receives the step number at every frame.
///
/// # Errors
/// A sink cannot write. A run that breaks down is no error: see [`Summary::ending`].
pub fn run(
    model: &Model,
    state: &mut State,
    scratch: &mut Scratch,
    header: &Header,
    span: RunLength,
    sinks: &mut [Box<dyn Sink>],
    stop: &AtomicBool,
    progress: impl FnMut(u64),
) -> anyhow::Result<Summary> {
    let job = Job { header, span, breaks: None, impacts: ImpactWatch::new(model), camera: Camera::default() };
    run_job(model, state, scratch, job, sinks, stop, progress)
}

/// As [`run`], with breakpoints.
///
/// # Errors
/// As those of [`run`]; and where a window is recorded again, that it breaks down there.
pub fn run_job(
    model: &Model,
    state: &mut State,
    scratch: &mut Scratch,
    job: Job<'_>,
    sinks: &mut [Box<dyn Sink>],
    stop: &AtomicBool,
    mut progress: impl FnMut(u64),
) -> anyhow::Result<Summary> {
    let Job { header, span, mut breaks, mut impacts, camera } = job;
    let first = state.step;
    let last = first.saturating_add(span.steps);
    // Impacts are needed only by sinks and breakpoints.
    let wants_impacts =
        !sinks.is_empty() || breaks.as_ref().is_some_and(|b| b.watches.iter().any(|w| w.breakpoint.uses.impact));
    let over = breaks.as_ref().is_some_and(|b| b.watches.iter().any(|w| w.breakpoint.uses.impact_over));
    impacts.follows_forces = !sinks.is_empty() || over;
    let mut found = Vec::new();
    match &breaks {
        Some(breaks) => require_data(breaks, model, scratch),
        None => scratch.require(model, &RequiredData::default()),
    }
    let around = breaks.as_ref().and_then(|b| b.around);
    let late = (WATCHED_PERIODS * impacts.period_steps()).ceil() as u64 + 1;
    let mut recorder = Recorder {
        model,
        sinks,
        camera,
        held: VecDeque::new(),
        hold_steps: around.map_or(0, |a| a.steps.saturating_add(late)),
        frames: 0,
        since_keyframe: 0,
        keyframe_step: None,
        energies: None,
    };
    let mut stops = BreakProgress {
        hits: Vec::new(),
        n_hits: 0,
        dense_until: None,
        stop_at: last,
        enough: false,
        snapshots: VecDeque::new(),
        steps_per_frame: span.steps_per_frame,
    };
    let (mut n_impacts, mut lift_offs) = (0, LiftOffWatch::new(model));
    let ending = loop {
        let every = match around {
            Some(around) if stops.is_dense(state.step) => around.steps_per_frame,
            _ => span.steps_per_frame,
        };
        // The grid of frames starts at step 0, so that a continued run has frames at the same steps as its recording.
        // The run's own grid also applies in windows, because readers rely on its interval.
        let on_grid = state.step.is_multiple_of(every) || state.step.is_multiple_of(span.steps_per_frame);
        let mut due = on_grid || state.step == first;
        let interrupted = stop.load(Ordering::Relaxed);
        if let Err(e) = scheme::evaluate(model, state, scratch) {
            break Ending::Broke(e);
        }
        if wants_impacts {
            impacts.observe(model, state, scratch);
        }
        for event in lift_offs.observe(model, state, scratch) {
            recorder.hold_back(state.step, SinkItem::Event(event));
        }
        let (touched, over) = if impacts.has_new_impacts() {
            (impacts.take_touched(), impacts.take_done())
        } else {
            (Vec::new(), Vec::new())
        };
        if let Some(breaks) = &mut breaks {
            found.clear();
            evaluate_breaks(breaks, model, state, scratch, &mut recorder.camera, [&touched, &over], &mut found);
            if !found.is_empty() {
                stops.process_hits(&found, breaks, (first, state.step), &mut recorder, header)?;
                due |= stops.is_dense(state.step);
            }
        }
        due |= state.step == stops.stop_at;
        for impact in touched.iter().filter(|i| i.approach_speed_m_s > SLOWEST_EVENT_M_S) {
            recorder.hold_back(impact.step, SinkItem::Event(touch_event(impact, header)));
        }
        // Impacts that began before the first frame are in the recording that this run continues.
        for impact in over.into_iter().filter(|i| i.step >= first) {
            n_impacts += 1;
            recorder.hold_back(state.step, SinkItem::Impact(impact));
        }
        if due || interrupted {
            recorder.frame(state, scratch, interrupted || state.step == stops.stop_at);
            progress(state.step);
        }
        recorder.release_items(state.step)?;
        if interrupted || state.step == stops.stop_at {
            break match (interrupted, stops.enough) {
                (true, _) => Ending::Interrupted,
                (false, true) => Ending::Hit,
                (false, false) => Ending::Done,
            };
        }
        if let Some(around) = around {
            stops.store_snapshot(
                state,
                (state.step - first).is_multiple_of((around.steps / 2).max(1)),
                recorder.hold_steps,
            );
        }
        scheme::advance(model, state, scratch);
    };
    let open = impacts.finish();
    for watch in breaks.iter_mut().flat_map(|b| &mut b.watches) {
        let found = watch.evaluate_impacts(&open, true, || recorder.camera.take(model, state, scratch));
        stops.count(&found, &mut recorder, header);
    }
    for impact in open.into_iter().filter(|i| i.step >= first) {
        n_impacts += 1;
        recorder.hold_back(state.step, SinkItem::Impact(impact));
    }
    recorder.hold_steps = 0;
    recorder.release_items(u64::MAX)?;
    let (stored_first_j, energy) = recorder.energies.unwrap_or_default();
    Ok(Summary {
        ending,
        steps: state.step - first,
        frames: recorder.frames,
        state_hash: state.hash(),
        energy,
        stored_first_j,
        stored_last_j: energy.stored_j(),
        hits: stops.hits,
        n_hits: stops.n_hits,
        impacts: wants_impacts.then_some(n_impacts),
        lift_offs: lift_offs.into_found(),
        scheme: scheme::summary(scratch),
    })
}

/// Hits so far, and their consequences.
struct BreakProgress {
    hits: Vec<Hit>,
    n_hits: u64,
    /// Last step of the latest window.
    dense_until: Option<u64>,
    /// Step after which the run ends.
    stop_at: u64,
    /// True: it ends there because of its hits.
    enough: bool,
    /// States from before the window that the next hit may open.
    snapshots: VecDeque<State>,
    /// Frame interval of the run, outside of windows.
    steps_per_frame: u64,
}

impl BreakProgress {
    fn is_dense(&self, step: u64) -> bool {
        self.dense_until.is_some_and(|until| step <= until)
    }

    fn count(&mut self, found: &[Hit], recorder: &mut Recorder<'_, '_>, header: &Header) {
        self.n_hits += found.len() as u64;
        for hit in found {
            recorder.hold_back(hit.step, SinkItem::Event(hit_event(hit, header)));
        }
        let room = MAX_HITS.saturating_sub(self.hits.len());
        self.hits.extend(found.iter().take(room).cloned());
    }

    /// Processes the hits of a step: opens a window around them, and determines when the run ends.
    fn process_hits(
        &mut self,
        found: &[Hit],
        breaks: &Breaks,
        (first, now): (u64, u64),
        recorder: &mut Recorder<'_, '_>,
        header: &Header,
    ) -> anyhow::Result<()> {
        let steps = || found.iter().map(|h| h.step);
        let (Some(earliest), Some(latest)) = (steps().min(), steps().max()) else { return Ok(()) };
        self.count(found, recorder, header);
        if let Some(around) = breaks.around {
            let from = earliest.saturating_sub(around.steps).max(first);
            let until = latest.saturating_add(around.steps);
            // An impact is known late: items already recorded densely for a later hit remain.
            self.dense_until = Some(self.dense_until.map_or(until, |d| d.max(until)));
            if let Some(start) = self.snapshots.iter().rev().find(|s| s.step <= from) {
                recorder.rerecord(
                    start,
                    from,
                    now.min(until.saturating_add(1)),
                    [around.steps_per_frame, self.steps_per_frame],
                )?;
            }
        }
        if breaks.hits.is_some_and(|most| self.n_hits >= most as u64) && !self.enough {
            self.enough = true;
            let tail = breaks.around.map_or(0, |a| a.steps);
            self.stop_at = self.stop_at.min(latest.saturating_add(tail)).max(now);
        }
        Ok(())
    }

    /// Stores the State for future windows if `due`, and drops those that no window can reach back to.
    fn store_snapshot(&mut self, state: &State, due: bool, hold_steps: u64) {
        if !due {
            return;
        }
        let oldest = state.step.saturating_sub(hold_steps);
        // The newest one that is old enough is kept.
        while self.snapshots.get(1).is_some_and(|s| s.step <= oldest) {
            self.snapshots.pop_front();
        }
        self.snapshots.push_back(state.clone());
    }
}

/// Makes the steps keep the data that breakpoints need.
fn require_data(breaks: &Breaks, model: &Model, scratch: &mut Scratch) {
    let wanted =
        breaks.watches.iter().map(BreakWatch::required_data).fold(RequiredData::default(), RequiredData::union);
    scratch.require(model, &wanted);
}

fn evaluate_breaks(
    breaks: &mut Breaks,
    model: &Model,
    state: &State,
    scratch: &Scratch,
    camera: &mut Camera,
    [touched, over]: [&[Impact]; 2],
    found: &mut Vec<Hit>,
) {
    for watch in &mut breaks.watches {
        watch.evaluate(model, state, scratch, camera, found);
        if !(touched.is_empty() && over.is_empty()) {
            found.extend(watch.evaluate_impacts(touched, false, || camera.take(model, state, scratch)));
            found.extend(watch.evaluate_impacts(over, true, || camera.take(model, state, scratch)));
        }
    }
}

impl Recorder<'_, '_> {
    /// Takes the frame of a step, and a keyframe if one is due.
    fn frame(&mut self, state: &State, scratch: &Scratch, last: bool) {
        // Without a sink only the energy ledger is needed: at the end, or near it if a run breaks down.
        let nobody = self.sinks.is_empty() && self.hold_steps == 0;
        if nobody && !last && !self.frames.is_multiple_of(FRAMES_PER_LEDGER) {
            self.frames += 1;
            return;
        }
        let frame = self.camera.take(self.model, state, scratch);
        let stored_first = self.energies.map_or(frame.energy.stored_j(), |(stored, _)| stored);
        self.energies = Some((stored_first, frame.energy));
        self.hold_back(state.step, SinkItem::Frame(Box::new(frame)));
        let apart = |from: u64| (state.step - from) as f64 * self.model.step_s;
        if self.keyframe_step.is_none_or(|from| apart(from) >= LONGEST_KEYFRAME_S) {
            self.since_keyframe = 0;
        }
        if self.since_keyframe == 0 && !self.sinks.is_empty() {
            self.hold_back(state.step, SinkItem::Keyframe(Box::new(state.keyframe())));
            self.keyframe_step = Some(state.step);
        }
        self.since_keyframe = (self.since_keyframe + 1) % FRAMES_PER_KEYFRAME;
    }

    fn hold_back(&mut self, step: u64, item: SinkItem) {
        self.held.push_back((step, item));
    }

    /// Repeats the run from `start` and records `from` .. `until` in place of the held items: every `dense` steps, and
    /// every `sparse` steps like the run around it.
    fn rerecord(&mut self, start: &State, from: u64, until: u64, [dense, sparse]: [u64; 2]) -> anyhow::Result<()> {
        let (model, mut state) = (self.model, start.clone());
        let mut scratch = Scratch::new(model);
        let in_window = |step: u64| (from..until).contains(&step);
        self.held
            .retain(|(step, item)| !(in_window(*step) && matches!(item, SinkItem::Frame(_) | SinkItem::Keyframe(_))));
        while state.step < until {
            scheme::evaluate(model, &state, &mut scratch)?;
            let on_grid = state.step.is_multiple_of(dense) || state.step.is_multiple_of(sparse);
            if in_window(state.step) && (state.step == from || on_grid) {
                let frame = self.camera.take(model, &state, &scratch);
                self.held.push_back((state.step, SinkItem::Frame(Box::new(frame))));
                let number = (state.step - from) / dense;
                if number.is_multiple_of(FRAMES_PER_KEYFRAME) && !self.sinks.is_empty() {
                    self.held.push_back((state.step, SinkItem::Keyframe(Box::new(state.keyframe()))));
                }
            }
            scheme::advance(model, &mut state, &mut scratch);
        }
        self.held.make_contiguous().sort_by_key(|(step, _)| *step);
        Ok(())
    }

    /// Passes on the items that no window can change any more.
    fn release_items(&mut self, step: u64) -> anyhow::Result<()> {
        while self.held.front().is_some_and(|(at, _)| self.hold_steps == 0 || at.saturating_add(self.hold_steps) < step)
        {
            let Some((_, item)) = self.held.pop_front() else { break };
            self.frames += u64::from(matches!(item, SinkItem::Frame(_)));
            for sink in self.sinks.iter_mut() {
                match &item {
                    SinkItem::Frame(frame) => sink.frame(frame)?,
                    SinkItem::Keyframe(keyframe) => sink.keyframe(keyframe)?,
                    SinkItem::Event(event) => sink.event(event)?,
                    SinkItem::Impact(impact) => sink.impact(impact)?,
                }
            }
            if let SinkItem::Frame(frame) = item {
                self.camera.give_back(*frame);
            }
        }
        Ok(())
    }
}

/// Energies of a run as JSON has them; stored: at its first and at its last frame [J].
#[doc(hidden)]
pub fn energy_json(e: &Energy, [stored_first_j, stored_last_j]: [f64; 2]) -> serde_json::Value {
    let put_in_j = e.put_in_j();
    let error_fraction = if put_in_j.abs() > 0.0 { e.error_j / put_in_j } else { 0.0 };
    serde_json::json!({
        "work_in_j": put_in_j,
        "work_out_j": e.work_out_j,
        "dissipated_j": e.lost_j(),
        "stored_change_j": stored_last_j - stored_first_j,
        "error_j": e.error_j,
        "error_fraction": error_fraction,
        "dissipated_by": e
            .accounts()
            .filter(|(account, _)| account.kind == ColumnKind::Lost)
            .map(|(account, value)| (account.name.trim_start_matches("lost_").into(), value.into()))
            .collect::<serde_json::Map<_, _>>(),
    })
}

/// A first contact as an event.
pub fn touch_event(impact: &Impact, header: &Header) -> Event {
    Event {
        step: impact.step,
        t_s: impact.t_s,
        kind: "first_touch".into(),
        text: format!(
            "{} at {:.3} m/s, t = {:.4} ms",
            touch_text(impact.link, impact.feature, impact.body, Some((impact.tooth, impact.segment)), header),
            impact.approach_speed_m_s,
            impact.t_s * 1e3
        ),
        link: impact.link,
        body: impact.body,
        value: impact.approach_speed_m_s,
    }
}

/// The contact partners in words.
pub fn touch_text(link: u32, feature: u32, body: u32, place: Option<(u32, u32)>, header: &Header) -> String {
    let info = header.bodies.get(body as usize);
    let path = info.map_or("?", |b| b.path.as_str());
    let place = match (place, info.is_some_and(|b| b.rotor)) {
        (Some((tooth, segment)), true) => format!(" tooth gap {tooth}, {}", Segment::name(segment)),
        (Some((_, segment)), false) => format!(", {}", Segment::name(segment)),
        (None, _) => String::new(),
    };
    format!("link {link} ({}) touches {path}{place}", Feature::name(feature))
}

/// A hit as an event.
pub fn hit_event(hit: &Hit, header: &Header) -> Event {
    let (link, body) = match hit.subject {
        Subject::Contact { link, body, .. } => (link, body),
        Subject::Link(link) => (link, 0),
        Subject::Joint(_) | Subject::Drive => (0, 0),
    };
    Event {
        step: hit.step,
        t_s: hit.t_s,
        kind: "break".into(),
        text: format!("{}, t = {:.4} ms", hit_text(hit, header), hit.t_s * 1e3),
        link,
        body,
        value: 0.0,
    }
}

/// The object that fulfilled a breakpoint, in words.
pub fn hit_text(hit: &Hit, header: &Header) -> String {
    match (hit.subject, hit.impact) {
        (Subject::Contact { link, feature, body }, Some(impact)) => {
            let place = Some((impact.tooth, impact.segment));
            let text = touch_text(link, feature, body, place, header);
            format!("{text} at {:.3} m/s", impact.approach_speed_m_s)
        }
        (Subject::Contact { link, feature, body }, None) => touch_text(link, feature, body, None, header),
        (Subject::Link(link), _) => format!("link {link}"),
        (Subject::Joint(joint), _) => format!("joint {joint}"),
        (Subject::Drive, _) => "the drive".to_string(),
    }
}
