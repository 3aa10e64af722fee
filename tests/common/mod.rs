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
    without_guides(BUNDLED[0].1, overrides)
}

/// The bundled bush chain in some writing of it, without its guides.
pub fn without_guides(text: &str, overrides: &[&str]) -> Drive {
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_string()).collect();
    let cut = text.find("# Straight guides").expect("the guides come last");
    match Drive::parse("bush-20-40", &text[..cut], &overrides) {
        Ok(drive) => drive,
        Err(report) => panic!("{report}"),
    }
}

/// A drive whose contacts have the linear law with this damping [N s/m], in place of the one whose force begins at zero.
pub fn with_linear_laws(text: &str, damping: f64) -> String {
    let lines = text.lines().map(|line| match line.split_once(" = ") {
        Some((key, _)) if key.trim_end() == "restitution" => format!("damping_n_s_per_m = {damping}\n"),
        Some((key, _)) if key.trim_end() == "restitution_at_m_s" => "\n".to_string(),
        _ => format!("{}\n", line.replace(".hunt_crossley]", ".linear]")),
    });
    lines.collect()
}

pub const NO_FRICTION: [&str; 3] =
    ["contact.sprocket.friction=0", "contact.guide.friction=0", "chain.joint.friction=0"];

pub fn assembled(drive: &Drive) -> Assembly {
    match assemble(drive) {
        Ok(assembly) => assembly,
        Err(e) => panic!("{e}"),
    }
}

/// A keyframe of a run, put into a State of its own: what goes on from it beside the run.
pub fn from_keyframe(assembly: &Assembly) -> Assembly {
    let mut again = Assembly {
        model: assembly.model.clone(),
        state: State::at_rest(&assembly.model.layout()),
        report: assembly.report.clone(),
    };
    again.state.restore(&assembly.state.keyframe()).unwrap_or_else(|e| panic!("{e}"));
    again
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

/// Two stages on a common shaft, 20/40 teeth twice as in the bundled reduction: chains, contacts and straight guides are those of two
/// bundled drives.
pub fn two_stages(first: &str, second: &str) -> String {
    let text_of = |name: &str| BUNDLED.iter().find(|b| b.0 == name).expect("a bundled drive").1;
    // Tables of a drive whose names begin so, each with its lines.
    let tables = |text: &'static str, kinds: &[&str]| -> String {
        let starts = |table: &&str| kinds.iter().any(|kind| table.starts_with(kind));
        text.split("\n[").map(|t| t.trim_end()).filter(starts).map(|t| format!("[{t}\n\n")).collect()
    };
    let stage = |stage: &str, name: &str, [driver, driven]: [&str; 2]| {
        let parts = tables(text_of(name), &["chain.", "contact."]).replace('[', &format!("[chains.{stage}."));
        let guides =
            tables(text_of(name), &["guides.fixed."]).replace("guides.fixed.", &format!("guides.fixed.{stage}_"));
        let renamed =
            guides.replace("\"driver\"", &format!("\"{driver}\"")).replace("\"driven\"", &format!("\"{driven}\""));
        let moves = if stage == "first" { driver } else { driven };
        format!(
            "[chains.{stage}]\nroute = [\"{driver}\", \"{driven}\"]\n\n{parts}[chains.{stage}.preload]\ntension_n = 300\nmoves = \"{moves}\"\n\n\
             {renamed}"
        )
    };
    let relief = |name: &str, um: u32| {
        if name.starts_with("smartchain") { format!("root_relief_um = {um}\n") } else { String::new() }
    };
    let (of_first, of_second) = ([relief(first, 30), relief(first, 62)], [relief(second, 30), relief(second, 62)]);
    format!(
        "title = \"{first}, {second}\"\n\n{}{}\
         [shafts.middle]\ninertia_kg_m2 = 1e-3\n\n\
         [sprockets.driver]\nteeth = 20\nx_mm = -238.6\ny_mm = 0\n{}\n\
         [sprockets.driven]\nshaft = \"middle\"\nteeth = 40\nx_mm = 0\ny_mm = 0\n{}\n\
         [sprockets.pinion]\nshaft = \"middle\"\nteeth = 20\nx_mm = 0\ny_mm = 0\n{}\n\
         [sprockets.output]\nteeth = 40\nx_mm = 0\ny_mm = -238.6\ninertia_kg_m2 = 2e-3\n{}\n\
         [speeds.constant.driver]\nspeed_rpm = 3000\n\n[loads.constant.output]\ntorque_nm = 20\n",
        stage("first", first, ["driver", "driven"]),
        stage("second", second, ["pinion", "output"]),
        of_first[0],
        of_first[1],
        of_second[0],
        of_second[1],
    )
}

/// The abutment chain with an arm whose rail lies on the backs of its links, outside of the slack span.
pub fn abutments_on_a_rail() -> String {
    let text = BUNDLED.iter().find(|b| b.0 == "smartchain-20-40").expect("a bundled drive").1;
    format!(
        "{text}\n[arms.press]\npivot_x_mm = 60\npivot_y_mm = -70\ninertia_kg_m2 = 2e-4\nspring_nm_per_rad = 20\n\
         spring_torque_nm = 0.3\ndamping_nm_s_per_rad = 0.05\n\n\
         [guides.rail.back]\nspan = [\"driver\", \"driven\"]\nside = \"outside\"\narm = \"press\"\n\
         start_x_mm = 56.4626\nstart_y_mm = -36.8914\nheading_deg = 4.5913\n\
         lengths_mm = [10.0, 80.0059, 10.0]\nradii_mm = [60, 2000, 60]\n"
    )
}
