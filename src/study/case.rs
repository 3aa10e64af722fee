//! One case: a drive assembled and run, and what its responses are taken from.
//!
//! What a case gives is a tree of numbers, as `run --json` and `compare --json` print them, and the signals that responses ask for. A number
//! is named by its path: `run.energy.work_in_j`, `assembly.step_s`, `compare.kinds.bush.peak_window_n`; an element of a list by whatever names it
//! (`kinds.bush`, `touches.driver`), or by its place.

use crate::analysis::order_spectrum::{AngleRecord, AngleRecorder};
use crate::analysis::signal::Signal;
use crate::assemble::{Assembly, AssemblyError, SharedParts, assemble_sharing};
use crate::compare::{CompareError, DriverWatch};
use crate::diag::{Report, last_name};
use crate::drive::Drive;
use crate::impacts::ImpactWatch;
use crate::integrate::explicit::Scratch;
use crate::integrate::scheme;
use crate::recording::capture::{self, Camera};
use crate::recording::frame::{Frame, Header, Impact};
use crate::simulate::{LiftOffWatch, RunLength, energy_json};
use crate::statistics::median;
use serde_json::{Value, json};

/// What the responses of a study ask a run for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CaseNeeds {
    /// What `compare` observes.
    pub compare: bool,
    /// Impacts of the whole run.
    pub impacts: bool,
    /// Signals, by their names.
    pub signals: Vec<String>,
    /// Impacts before it do not count [s].
    pub impacts_from_s: f64,
}

/// What a run gave.
pub struct CaseFacts {
    /// Sections `run`, `assembly`, `compare`, `impacts`.
    pub tree: Value,
    /// In the order of [`CaseNeeds::signals`].
    pub signals: Vec<AngleRecord>,
    /// XXH3-64 of the last State.
    pub state_hash: u64,
}

/// Duration of a case, and time between two looks at its signals [s].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaseLength {
    pub duration_s: f64,
    pub every_s: f64,
}

/// Why a case has no responses: its text, in a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CaseError(pub String);

impl From<&Report> for CaseError {
    fn from(report: &Report) -> CaseError {
        CaseError(report.diags.iter().map(|d| d.title.as_str()).collect::<Vec<_>>().join("; "))
    }
}

impl From<AssemblyError> for CaseError {
    fn from(e: AssemblyError) -> CaseError {
        match &e {
            AssemblyError::Input(report) => report.into(),
            AssemblyError::Statics { .. } => CaseError(format!("the drive cannot be assembled: {e}")),
            AssemblyError::RunIn(_) => CaseError(e.to_string()),
        }
    }
}

/// Assembles and runs a drive. The same drive gives the same bits on every processor.
///
/// # Errors
/// It cannot be assembled, breaks down, or lacks what is asked for.
pub fn run_case(
    drive: &Drive,
    needs: &CaseNeeds,
    length: CaseLength,
    shared: &SharedParts,
) -> Result<CaseFacts, CaseError> {
    run_watched(drive, needs, length, shared, None)
}

/// What is shown every frame of a run; false ends it.
pub type FrameWatch<'a> = dyn FnMut(&Frame, &Header) -> bool + 'a;

/// As [`run_case`]; `watch` sees every frame.
///
/// # Errors
/// As [`run_case`], or `watch` ended it.
pub fn run_watched(
    drive: &Drive,
    needs: &CaseNeeds,
    length: CaseLength,
    shared: &SharedParts,
    mut watch: Option<&mut FrameWatch<'_>>,
) -> Result<CaseFacts, CaseError> {
    let Assembly { model, mut state, report } = assemble_sharing(drive, shared)?;
    let span = RunLength::new(length.duration_s, length.every_s, model.step_s);
    let mut header = capture::header(drive, &model, &report, span.steps_per_frame);
    header.ledger_origin = Some(capture::ledger_at(&model, &state).map_err(|e| CaseError(e.to_string()))?);
    let mut recorders = recorders(&needs.signals, &header)?;
    let mut scratch = Scratch::new(&model);
    let mut camera = Camera::since(header.ledger_origin);
    let mut driver = needs.compare.then(|| DriverWatch::new(&model));
    let mut struck = (needs.impacts && driver.is_none()).then(|| ImpactWatch::new(&model));
    let mut lift_offs = LiftOffWatch::new(&model);
    let mut impacts = Vec::new();
    let (mut stored_first_j, mut energy) = (0.0, None);
    for step in 0..=span.steps {
        scheme::evaluate(&model, &state, &mut scratch).map_err(|e| CaseError(e.to_string()))?;
        if let Some(driver) = &mut driver {
            driver.observe(&model, &state, &scratch);
        }
        if let Some(struck) = &mut struck {
            struck.observe(&model, &state, &scratch);
            struck.take_touched();
            impacts.extend(struck.take_done());
        }
        lift_offs.observe(&model, &state, &scratch);
        let is_seen = (!recorders.is_empty() || watch.is_some()) && step.is_multiple_of(span.steps_per_frame);
        if is_seen || step == 0 || step == span.steps {
            let frame = camera.take(&model, &state, &scratch);
            if step == 0 {
                stored_first_j = frame.energy.stored_j();
            }
            energy = Some(frame.energy);
            if is_seen {
                recorders.iter_mut().for_each(|r| r.add(&frame, &header));
                if let Some(watch) = &mut watch
                    && !watch(&frame, &header)
                {
                    return Err(CaseError("it was interrupted".into()));
                }
            }
            camera.give_back(frame);
        }
        if step < span.steps {
            scheme::advance(&model, &mut state, &mut scratch);
        }
    }
    let mut tree = serde_json::Map::new();
    let energy = energy.unwrap_or_default();
    tree.insert(
        "run".into(),
        json!({
            "simulated_s": span.steps as f64 * model.step_s,
            "step_s": model.step_s,
            "steps": span.steps,
            "energy": energy_json(&energy, [stored_first_j, energy.stored_j()]),
            "lift_offs": lift_offs.into_found(),
        }),
    );
    tree.insert("assembly".into(), json!(report));
    if let Some(mut driver) = driver {
        let watched = driver.finish(drive, &model, &header).map_err(|e| match e {
            CompareError::Drive(report) => CaseError::from(&report),
            other => CaseError(other.to_string().replace("\nhelp:", ";")),
        })?;
        tree.insert("compare".into(), json!(watched.summary));
        impacts = driver.impacts;
    }
    if let Some(mut struck) = struck {
        impacts.extend(struck.finish());
    }
    if needs.impacts {
        impacts.retain(|impact| impact.t_s >= needs.impacts_from_s);
        tree.insert("impacts".into(), impacts_json(&impacts, &header));
    }
    let signals = recorders.into_iter().map(|r| r.finish(&header)).collect();
    Ok(CaseFacts { tree: Value::Object(tree), signals, state_hash: state.hash() })
}

/// A recorder for each signal.
fn recorders(signals: &[String], header: &Header) -> Result<Vec<AngleRecorder>, CaseError> {
    let of = |name: &String| {
        let signal = Signal::find(name, header)
            .map_err(|e| CaseError(e.to_string().replace("\nhelp:", ";").replace("recording", "drive")))?;
        Ok(AngleRecorder::new(signal, header))
    };
    signals.iter().map(of).collect()
}

/// Impacts of the whole run, over all bodies and for each.
fn impacts_json(impacts: &[Impact], header: &Header) -> Value {
    let of = |own: &[&Impact]| {
        let largest = |f: &dyn Fn(&Impact) -> f64| own.iter().map(|i| f(i)).fold(0.0, f64::max);
        json!({
            "count": own.len(),
            "approach_speed_max_m_s": largest(&|i| i.approach_speed_m_s),
            "approach_speed_p50_m_s": median(own.iter().map(|i| i.approach_speed_m_s)),
            "peak_force_max_n": largest(&|i| i.peak_force_n),
            "impulse_max_n_s": largest(&|i| i.impulse_n_s),
            "impulse_sum_n_s": own.iter().map(|i| i.impulse_n_s).sum::<f64>(),
        })
    };
    let mut all = of(&impacts.iter().collect::<Vec<_>>());
    let bodies: Vec<Value> = header
        .bodies
        .iter()
        .enumerate()
        .map(|(k, body)| {
            let mut own = of(&impacts.iter().filter(|i| i.body as usize == k).collect::<Vec<_>>());
            if let Some(own) = own.as_object_mut() {
                own.insert("body".into(), json!(body.path));
            }
            own
        })
        .collect();
    if let Some(all) = all.as_object_mut() {
        all.insert("bodies".into(), Value::Array(bodies));
    }
    all
}

/// The number at a path; None where there is nothing, or no number.
pub fn number_at(tree: &Value, path: &str) -> Option<f64> {
    let mut here = tree;
    for word in path.split('.') {
        here = match here {
            Value::Object(map) => map.get(word)?,
            Value::Array(items) => items
                .iter()
                .find(|item| names_of(item).any(|name| name == word || last_name(name) == word))
                .or_else(|| items.get(word.parse::<usize>().ok()?))?,
            Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => return None,
        };
    }
    match here {
        Value::Number(x) => x.as_f64(),
        Value::Bool(is) => Some(f64::from(u8::from(*is))),
        Value::Null | Value::String(_) | Value::Array(_) | Value::Object(_) => None,
    }
}

/// Whether a number may stand at a path whose value is missing: infinite ones and those that could not be measured are null.
pub fn is_known(tree: &Value, path: &str) -> bool {
    number_at(tree, path).is_some() || paths(tree).iter().any(|known| known == path)
}

/// Texts of an object, by which it is named.
fn names_of(item: &Value) -> impl Iterator<Item = &str> {
    item.as_object().into_iter().flatten().filter_map(|(_, value)| value.as_str())
}

/// Paths of all numbers and of what is null, in order.
pub fn paths(tree: &Value) -> Vec<String> {
    let mut all = Vec::new();
    add_paths(tree, String::new(), &mut all);
    all
}

fn add_paths(here: &Value, path: String, all: &mut Vec<String>) {
    let below = |word: &str| if path.is_empty() { word.to_string() } else { format!("{path}.{word}") };
    match here {
        Value::Object(map) => map.iter().for_each(|(key, value)| add_paths(value, below(key), all)),
        Value::Array(items) => {
            for (i, item) in items.iter().enumerate() {
                let name = names_of(item).next().map_or_else(|| i.to_string(), |name| last_name(name).to_string());
                add_paths(item, below(&name), all);
            }
        }
        Value::Number(_) | Value::Bool(_) | Value::Null => all.push(path),
        Value::String(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_found_by_names_and_places() {
        let tree = json!({"kinds": [{"kind": "bush", "peak_n": 3.5}, {"kind": "guide", "peak_n": null}], "list": [1, 2], "is": true,
            "touches": [{"body": "sprockets.driver", "n": 4}]});
        assert_eq!(number_at(&tree, "kinds.bush.peak_n"), Some(3.5));
        assert_eq!(number_at(&tree, "list.1"), Some(2.0));
        assert_eq!(number_at(&tree, "is"), Some(1.0));
        assert_eq!(number_at(&tree, "touches.driver.n"), Some(4.0));
        assert_eq!(number_at(&tree, "kinds.guide.peak_n"), None);
        assert!(is_known(&tree, "kinds.guide.peak_n") && !is_known(&tree, "kinds.ring.peak_n"));
        assert_eq!(number_at(&tree, "kinds"), None);
        assert!(paths(&tree).contains(&"touches.driver.n".to_string()));
    }
}
