//! Followers that leave their cams while these lift them: a valve train that is too fast for its springs.

use crate::integrate::explicit::Scratch;
use crate::model::Model;
use crate::pairs::part_part::TouchShape;
use crate::recording::frame::Event;
use crate::state::State;

/// What one valve did.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LiftOff {
    /// Its path in the drive file.
    pub valve: String,
    /// How often it left its cam.
    pub count: u64,
    /// When it first left its cam [s].
    pub first_s: f64,
    /// The longest time for which it flew [s].
    pub longest_s: f64,
    /// Largest gap while it flew [m].
    pub widest_m: f64,
}

/// Looks at every step whether followers are on their cams.
pub struct LiftOffWatch {
    cams: Vec<WatchedCam>,
}

struct WatchedCam {
    touch: usize,
    valve: String,
    /// The sprocket that turns with the cam.
    sprocket: u32,
    /// None: not looked at yet.
    began_in_flight: Option<bool>,
    /// Step at which it left its cam; None while it is on it.
    since: Option<u64>,
    found: Option<LiftOff>,
}

/// Least share of the full lift at which a follower should be on its cam: below it lash, yielding and ramps decide.
const LEAST_LIFT: f64 = 0.02;

impl LiftOffWatch {
    /// Watches all cams of a model.
    pub fn new(model: &Model) -> LiftOffWatch {
        let cams = model.touches.iter().enumerate().filter(|(_, t)| matches!(t.shape, TouchShape::Cam(_)));
        let watched = |(touch, t): (usize, &crate::pairs::part_part::Touch)| WatchedCam {
            touch,
            valve: t.path.strip_suffix(".cam").unwrap_or(&t.path).to_string(),
            began_in_flight: None,
            sprocket: model.sprockets.iter().position(|s| t.shape.turns_with(s.coordinate)).unwrap_or(0) as u32,
            since: None,
            found: None,
        };
        LiftOffWatch { cams: cams.map(watched).collect() }
    }

    /// Looks at a node; returns what begins there.
    pub fn observe(&mut self, model: &Model, state: &State, scratch: &Scratch) -> Vec<Event> {
        let mut events = Vec::new();
        for watched in &mut self.cams {
            let TouchShape::Cam(cam) = &model.touches[watched.touch].shape else { continue };
            let lift_m = match scratch.touches().normal_force[watched.touch] > 0.0 {
                true => 0.0,
                false => cam.lift(cam.turn(&state.coordinates.angle)).lift_m,
            };
            let t_s = state.step as f64 * model.step_s;
            if lift_m - cam.lash_m <= LEAST_LIFT * cam.law.full_m() {
                (watched.since, watched.began_in_flight) = (None, Some(false));
                continue;
            }
            // What flies where the watch begins had left its cam before.
            if *watched.began_in_flight.get_or_insert(true) {
                continue;
            }
            let gap_m = state.coordinates.angle[cam.follower] / cam.ratio + cam.lash_m - lift_m;
            let found = watched.found.get_or_insert_with(|| LiftOff {
                valve: watched.valve.clone(),
                count: 0,
                first_s: t_s,
                longest_s: 0.0,
                widest_m: 0.0,
            });
            if watched.since.is_none() {
                watched.since = Some(state.step);
                found.count += 1;
                events.push(Event {
                    step: state.step,
                    t_s,
                    kind: "lift_off".into(),
                    text: format!(
                        "{} leaves its cam at {:.3} mm of lift, t = {:.4} ms",
                        watched.valve,
                        lift_m * 1e3,
                        t_s * 1e3
                    ),
                    link: 0,
                    body: watched.sprocket,
                    value: lift_m,
                });
            }
            let since = watched.since.unwrap_or(state.step);
            found.longest_s = found.longest_s.max((state.step - since) as f64 * model.step_s);
            found.widest_m = found.widest_m.max(gap_m);
        }
        events
    }

    /// Valves that left their cams.
    pub fn into_found(self) -> Vec<LiftOff> {
        self.cams.into_iter().filter_map(|cam| cam.found).collect()
    }
}

impl LiftOff {
    /// In words.
    pub fn text(&self) -> String {
        let times = if self.count == 1 { "once".to_string() } else { format!("{} times", self.count) };
        format!(
            "{} left its cam {times}, first at {:.3} ms; it flew for up to {:.3} ms, {:.4} mm from it",
            self.valve,
            self.first_s * 1e3,
            self.longest_s * 1e3,
            self.widest_m * 1e3
        )
    }
}
