//! The loop: step, take frames, hand them to sinks; keyframes, events, interruption.

use crate::integrate::StepError;
use crate::integrate::explicit::{self, Scratch};
use crate::model::Model;
use crate::recording::Sink;
use crate::recording::capture::Camera;
use crate::recording::frame::{Energy, Event, Feature, Frame, Header};
use crate::state::State;
use std::sync::atomic::{AtomicBool, Ordering};

/// A keyframe at least every so many frames.
pub const FRAMES_PER_KEYFRAME: u64 = 1000;
/// First touches slower than this are no events [m/s]: a wrapped bush that lifts off and comes back.
const SLOWEST_EVENT_M_S: f64 = 0.02;

/// How long and how densely.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Steps to take.
    pub steps: u64,
    /// Steps between two frames.
    pub steps_per_frame: u64,
}

impl Span {
    /// Whole steps for a duration and a frame interval [s].
    pub fn new(duration_s: f64, every_s: f64, step_s: f64) -> Span {
        let steps_per_frame = (every_s / step_s * (1.0 + 1e-9)).floor().max(1.0) as u64;
        Span { steps: (duration_s / step_s).round().max(1.0) as u64, steps_per_frame }
    }
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Ending {
    Done,
    /// Stopped from outside after a whole step.
    Interrupted,
    Broke(StepError),
}

/// What a run did.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    pub ending: Ending,
    pub steps: u64,
    pub frames: u64,
    pub state_hash: u64,
    /// At the last frame.
    pub energy: Energy,
    /// Stored energy at the first and at the last frame [J].
    pub stored_first_j: f64,
    pub stored_last_j: f64,
}

/// Runs `span` from `state`, a frame at its first and last step and in between. `stop` ends it after a step; `progress` is
/// told the step number at every frame.
pub fn run(
    model: &Model,
    state: &mut State,
    scratch: &mut Scratch,
    header: &Header,
    span: Span,
    sinks: &mut [Box<dyn Sink>],
    stop: &AtomicBool,
    mut progress: impl FnMut(u64),
) -> anyhow::Result<Summary> {
    let first = state.step;
    let last = first + span.steps;
    let mut camera = Camera::default();
    let mut frames = 0;
    let mut energies: Option<(f64, Energy)> = None;
    let mut take =
        |state: &State, scratch: &Scratch, sinks: &mut [Box<dyn Sink>], frames: &mut u64| -> anyhow::Result<()> {
            let frame = camera.take(model, state, scratch);
            for sink in sinks.iter_mut() {
                sink.frame(&frame)?;
            }
            if frames.is_multiple_of(FRAMES_PER_KEYFRAME) && !sinks.is_empty() {
                let keyframe = state.keyframe();
                for sink in sinks.iter_mut() {
                    sink.keyframe(&keyframe)?;
                }
            }
            for event in first_touches(&frame, header, span.steps_per_frame) {
                for sink in sinks.iter_mut() {
                    sink.event(&event)?;
                }
            }
            let stored_first = energies.map_or(frame.energy.stored_j(), |(stored, _)| stored);
            energies = Some((stored_first, frame.energy));
            *frames += 1;
            progress(frame.step);
            Ok(())
        };
    let mut ending = Ending::Done;
    loop {
        let due = (state.step - first).is_multiple_of(span.steps_per_frame) || state.step == last;
        let interrupted = stop.load(Ordering::Relaxed);
        if let Err(e) = explicit::evaluate(model, state, scratch) {
            ending = Ending::Broke(e);
            break;
        }
        if due || interrupted {
            take(state, scratch, sinks, &mut frames)?;
        }
        if interrupted {
            ending = Ending::Interrupted;
            break;
        }
        if state.step == last {
            break;
        }
        explicit::advance(model, state, scratch);
    }
    let (stored_first_j, energy) = energies.unwrap_or_default();
    Ok(Summary {
        ending,
        steps: state.step - first,
        frames,
        state_hash: state.hash(),
        energy,
        stored_first_j,
        stored_last_j: energy.stored_j(),
    })
}

/// First touches of links with teeth and rings since the frame before.
pub fn first_touches(frame: &Frame, header: &Header, steps_per_frame: u64) -> Vec<Event> {
    let c = &frame.contacts;
    let interval = steps_per_frame as f64 * header.step_s;
    (0..c.link.len())
        .filter(|i| c.age_s[*i] <= interval && c.approach_speed_m_s[*i] > SLOWEST_EVENT_M_S)
        .filter(|i| header.bodies.get(c.body[*i] as usize).is_some_and(|b| b.rotor))
        .map(|i| {
            let t_s = (frame.t_s - c.age_s[i]).max(0.0);
            let body = header.bodies.get(c.body[i] as usize).map_or("?", |b| b.path.as_str());
            let end = Feature::name(c.feature[i]);
            Event {
                step: (t_s / header.step_s).round() as u64,
                t_s,
                kind: "first_touch".into(),
                text: format!(
                    "link {} ({end}) touches {body} tooth gap {} at {:.3} m/s, t = {:.4} ms",
                    c.link[i],
                    c.tooth[i],
                    c.approach_speed_m_s[i],
                    t_s * 1e3
                ),
                link: c.link[i],
                body: c.body[i],
                value: c.approach_speed_m_s[i],
            }
        })
        .collect()
}
