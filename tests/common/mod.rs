//! Shared by several tests: assembling the bundled drive with overrides, watching a run step by step, engagements.
#![allow(dead_code)] // each test file uses its own part

use pitchline::assemble::{Assembly, assemble};
use pitchline::drive::{BUNDLED, Drive};
use pitchline::elements::contact_law::{ContactLaw, PeakMeter};
use pitchline::integrate::explicit::{self, Scratch};
use pitchline::model::Model;
use pitchline::recording::frame::{Contacts, Feature};
use pitchline::state::State;
use std::collections::BTreeMap;

/// The bundled 20/40 drive, `path=value` overrides applied.
pub fn drive(overrides: &[&str]) -> Drive {
    bundled(BUNDLED[0].0, overrides)
}

/// A bundled drive with overrides.
pub fn bundled(name: &str, overrides: &[&str]) -> Drive {
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_string()).collect();
    let (name, text) = BUNDLED.iter().find(|b| b.0 == name).expect("a bundled drive");
    match Drive::parse(name, text, &overrides) {
        Ok(drive) => drive,
        Err(report) => panic!("{report}"),
    }
}

/// The same without its guides.
pub fn drive_without_guides(overrides: &[&str]) -> Drive {
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_string()).collect();
    let text = BUNDLED[0].1;
    let cut = text.find("# Straight guides").expect("the guides come last");
    match Drive::parse("bush-20-40", &text[..cut], &overrides) {
        Ok(drive) => drive,
        Err(report) => panic!("{report}"),
    }
}

pub const NO_FRICTION: [&str; 3] =
    ["contact.sprocket.friction=0", "contact.guide.friction=0", "chain.joint.friction=0"];

pub fn assembled(drive: &Drive) -> Assembly {
    match assemble(drive) {
        Ok(assembly) => assembly,
        Err(e) => panic!("{e}"),
    }
}

/// Runs `steps` steps and passes every node to `look`.
pub fn watch(model: &Model, state: &mut State, steps: u64, mut look: impl FnMut(&State, &Scratch)) {
    let mut scratch = Scratch::new(model);
    for _ in 0..steps {
        explicit::evaluate(model, state, &mut scratch).expect("the run holds");
        look(state, &scratch);
        explicit::advance(model, state, &mut scratch);
    }
}

/// The same State for another step size: velocities belong to half a step before the positions.
pub fn for_step(state: &State, old_step_s: f64, new_step_s: f64) -> State {
    let mut state = state.clone();
    state.restep(old_step_s, new_step_s);
    state
}

/// One engagement of a bush with a sprocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Engagement {
    pub link: u32,
    pub front: bool,
    pub start_s: f64,
    /// Approach speed at first contact [m/s].
    pub approach: f64,
    /// Normal of the tooth at the contact.
    pub normal: (f64, f64),
    /// Sliding speed along the tooth at first contact [m/s].
    pub slide: f64,
    /// Largest normal force within two tooth periods [N], between nodes as well as at them.
    pub peak: f64,
}

/// Collects engagements on one body from the contacts of every step.
pub struct EngagementWatch {
    body: u32,
    window_s: f64,
    law: ContactLaw,
    step_s: f64,
    open: BTreeMap<(u32, u32), Follow>,
    last_seen: BTreeMap<(u32, u32), f64>,
    pub done: Vec<Engagement>,
}

/// An engagement being watched.
struct Follow {
    engagement: Engagement,
    meter: PeakMeter,
    now: Option<(f64, f64)>,
}

impl EngagementWatch {
    pub fn new(body: u32, tooth_period_s: f64, law: ContactLaw, step_s: f64) -> EngagementWatch {
        let (open, last_seen) = (BTreeMap::new(), BTreeMap::new());
        EngagementWatch { body, window_s: 2.0 * tooth_period_s, law, step_s, open, last_seen, done: Vec::new() }
    }

    pub fn look(&mut self, t_s: f64, c: &Contacts) {
        for follow in self.open.values_mut() {
            follow.now = None;
        }
        for i in 0..c.link.len() {
            if c.body[i] != self.body || c.feature[i] > Feature::FrontBush as u32 {
                continue;
            }
            let key = (c.link[i], c.feature[i]);
            // A new engagement if the bush was off this sprocket for two tooth periods.
            let fresh = self.last_seen.get(&key).is_none_or(|last| t_s - last > self.window_s);
            self.last_seen.insert(key, t_s);
            if fresh {
                let engagement = Engagement {
                    link: c.link[i],
                    front: c.feature[i] == Feature::FrontBush as u32,
                    start_s: t_s,
                    approach: c.approach_speed_m_s[i],
                    normal: (c.normal_x[i], c.normal_y[i]),
                    slide: c.tangential_speed_m_s[i],
                    peak: 0.0,
                };
                self.open.insert(key, Follow { engagement, meter: PeakMeter::default(), now: None });
            }
            if let Some(follow) = self.open.get_mut(&key) {
                follow.now = Some((c.penetration_m[i], c.normal_speed_m_s[i]));
            }
        }
        let window = self.window_s;
        for follow in self.open.values_mut() {
            let approach = follow.engagement.approach;
            let top = follow.meter.peak_since(&self.law, follow.now, approach, self.step_s, 0.0).expect("no Hertz law");
            follow.engagement.peak = follow.engagement.peak.max(top);
        }
        let ended = |f: &Follow| t_s - f.engagement.start_s > window;
        self.done.extend(self.open.values().filter(|f| ended(f)).map(|f| f.engagement));
        self.open.retain(|_, f| !ended(f));
    }
}
