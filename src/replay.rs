//! Replay: a recording contains its drive and, at intervals, its whole State. Any part of it can therefore be simulated
//! again to the bit, observed step by step, or continued.

use crate::assemble::{AssemblyError, assemble, compile};
use crate::drive::Drive;
use crate::impacts::{ImpactWatch, WATCHED_PERIODS};
use crate::integrate::explicit::Scratch;
use crate::integrate::scheme;
use crate::model::Model;
use crate::recording::capture::{self, Camera};
use crate::recording::frame::{BodyInfo, Energy, Frame, Header, Keyframe, Parent};
use crate::recording::reader::{Entry, Flow, Reader, WHOLE, Wanted};
use crate::state::State;
use anyhow::{Context, anyhow, bail, ensure};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// A recording and the model of its drive.
pub struct Replay {
    pub reader: Reader,
    pub drive: Drive,
    pub model: Model,
    /// Energies at which its ledger starts.
    pub origin: Option<Energy>,
}

/// A State that was reached by replay.
pub struct Visit {
    pub state: State,
    pub scratch: Scratch,
    /// Has observed every step since the keyframe.
    pub impacts: ImpactWatch,
    /// Step of that keyframe.
    pub since: u64,
}

impl Replay {
    /// Opens a recording and compiles its drive.
    pub fn open(path: &Path) -> anyhow::Result<Replay> {
        let mut reader = Reader::open(path)?;
        let drive = drive_of(path, reader.header(), &[])?;
        let model = compile(&drive).map_err(|e| cannot_compile(path, &e))?.model;
        let (recorded, ours) = (reader.header().step_s, model.step_s);
        ensure!(
            recorded == ours,
            "{}: recorded by {} with a step of {:.6} us, and this program takes {:.6} us for its drive; record it anew",
            path.display(),
            reader.header().program,
            recorded * 1e6,
            ours * 1e6
        );
        fits(path, reader.header(), &drive, &model)?;
        let origin = match reader.header().ledger_origin {
            Some(origin) => Some(origin),
            None => first_origin(&mut reader, &model)?,
        };
        Ok(Replay { reader, drive, model, origin })
    }

    pub fn header(&self) -> &Header {
        self.reader.header()
    }

    pub fn camera(&self) -> Camera {
        Camera::since(self.origin)
    }

    /// Step nearest to a time.
    pub fn step_at(&self, t_s: f64) -> u64 {
        (t_s / self.model.step_s).round() as u64
    }

    /// The State at `step`, simulated from the keyframe before it. `look` is called for every evaluated step, including
    /// that of the keyframe. The step itself is neither evaluated nor passed to `look`.
    pub fn visit(&mut self, step: u64, mut look: impl FnMut(&State, &Scratch)) -> anyhow::Result<Visit> {
        let path = self.reader.path().display().to_string();
        // Starts early enough to know which parts have been free for long enough to have an impact.
        let before = ImpactWatch::new(&self.model).period_steps() * WATCHED_PERIODS * 2.0;
        let mut keyframe = self.keyframe(step.saturating_sub(before as u64))?;
        if keyframe.is_none() {
            keyframe = self.keyframe(step)?;
        }
        let t_ms = step as f64 * self.model.step_s * 1e3;
        let keyframe = keyframe.with_context(|| format!("{path} holds no keyframe before {t_ms:.6} ms"))?;
        let mut state = resting(&self.model);
        state.restore(&keyframe).map_err(|e| anyhow!("{path}: the keyframe of step {}: {e}", keyframe.step))?;
        let mut scratch = Scratch::new(&self.model);
        let mut impacts = if keyframe.step == 0 {
            ImpactWatch::new(&self.model)
        } else {
            ImpactWatch::for_continued_run(&self.model, keyframe.step)
        };
        while state.step < step {
            scheme::evaluate(&self.model, &state, &mut scratch)?;
            impacts.observe(&self.model, &state, &scratch);
            look(&state, &scratch);
            scheme::advance(&self.model, &mut state, &mut scratch);
        }
        // Earlier impacts are already in the recording.
        impacts.take_touched();
        impacts.take_done();
        Ok(Visit { state, scratch, impacts, since: keyframe.step })
    }

    /// The last keyframe at or before a step.
    fn keyframe(&mut self, step: u64) -> anyhow::Result<Option<Keyframe>> {
        // Half a step later, because keyframes are found by their time in nanoseconds.
        let at = |half: f64| (step as f64 + half) * self.model.step_s;
        let keyframe = self.reader.keyframe_before(at(0.5))?;
        if keyframe.as_ref().is_some_and(|k| k.step > step) {
            return self.reader.keyframe_before(at(-0.5));
        }
        Ok(keyframe)
    }

    /// The frame of a step, simulated again from the keyframe before.
    pub fn frame_of_step(&mut self, step: u64) -> anyhow::Result<Frame> {
        let mut visit = self.visit(step, |_, _| ())?;
        scheme::evaluate(&self.model, &visit.state, &mut visit.scratch)?;
        Ok(self.camera().take(&self.model, &visit.state, &visit.scratch))
    }

    /// Origin of a recording that is cut out of this one or continues it.
    pub fn parent(&self, state: &State, changed: bool) -> Parent {
        let name = self.reader.path().file_name().map(|n| n.to_string_lossy().into_owned());
        Parent {
            recording: name.unwrap_or_default(),
            step: state.step,
            t_s: state.step as f64 * self.model.step_s,
            state_hash: state.hash(),
            changed,
        }
    }
}

/// Checks that the links and bodies of the header are those of its drive.
fn fits(path: &Path, header: &Header, drive: &Drive, model: &Model) -> anyhow::Result<()> {
    let shape = |b: &BodyInfo| (b.kind, b.rotor, b.teeth);
    let bodies = header.bodies.iter().map(shape).eq(capture::bodies(drive, model).iter().map(shape));
    ensure!(
        bodies && header.links.len() == model.chain.n_links,
        "{} is damaged: its links, sprockets and guides are not those of its drive",
        path.display()
    );
    Ok(())
}

/// The drive of a recording, with further overrides.
pub fn drive_of(path: &Path, header: &Header, overrides: &[String]) -> anyhow::Result<Drive> {
    if header.is_merged() {
        bail!("{} holds several drives side by side; record each on its own to run it again", path.display());
    }
    let all: Vec<String> = header.overrides.iter().chain(overrides).cloned().collect();
    Drive::parse(&header.drive_name, &header.drive_text, &all)
        .map_err(|report| anyhow!("{}: its drive cannot be read\n{report}", path.display()))
}

fn cannot_compile(path: &Path, e: &AssemblyError) -> anyhow::Error {
    anyhow!("{}: its drive cannot be compiled\n{e}", path.display())
}

/// A State of the right size.
pub fn resting(model: &Model) -> State {
    State::at_rest(&model.layout())
}

/// Start of the energy ledger at the first keyframe, for recordings that do not state it.
fn first_origin(reader: &mut Reader, model: &Model) -> anyhow::Result<Option<Energy>> {
    let Some(keyframe) = reader.first_keyframe()? else { return Ok(None) };
    let mut state = resting(model);
    state.restore(&keyframe).map_err(|e| anyhow!("{}: the first keyframe: {e}", reader.path().display()))?;
    Ok(Some(crate::recording::capture::ledger_at(model, &state)?))
}

/// Result of a verification.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Verdict {
    pub frames: u64,
    pub keyframes: u64,
    /// Frames between the first and the last that should have been recorded but are missing.
    pub missing_frames: u64,
    /// Frames and keyframes that the run does not reproduce.
    pub mismatches: u64,
    /// True: the drive was assembled anew and gave the first State; false: the recording begins with a keyframe of its
    /// parent.
    pub assembled: bool,
    pub first: Option<Mismatch>,
    pub state_hash: String,
}

/// The first difference.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Mismatch {
    /// Number of the frame in the recording.
    pub frame: u64,
    pub step: u64,
    pub t_s: f64,
    /// The value that differs, in both versions.
    pub what: String,
}

/// Runs the recorded drive again and compares every frame and keyframe, to the bit. None: interrupted.
pub fn verify(
    replay: &mut Replay,
    stop: &AtomicBool,
    mut progress: impl FnMut(u64),
) -> anyhow::Result<Option<Verdict>> {
    let mut verdict = Verdict::default();
    let first = replay.reader.first_keyframe()?;
    let mut first = first.with_context(|| format!("{} holds no keyframe", replay.reader.path().display()))?;
    let mut state = resting(&replay.model);
    let mut notes: Vec<Mismatch> = Vec::new();
    let mut note = |verdict: &mut Verdict, frame: u64, step: u64, t_s: f64, what: String| {
        verdict.mismatches += 1;
        if notes.is_empty() {
            notes.push(Mismatch { frame, step, t_s, what });
        }
    };
    if replay.header().parent.is_none() {
        let assembly = assemble(&replay.drive).map_err(|e| cannot_compile(replay.reader.path(), &e))?;
        verdict.assembled = true;
        let ours = assembly.state.keyframe();
        if ours != first {
            note(&mut verdict, 0, 0, 0.0, keyframe_difference(&first, &ours, "the drive, assembled anew,"));
            first = ours;
        }
    }
    if let Err(e) = state.restore(&first) {
        // Its columns may still be usable, to see how the run continues.
        note(&mut verdict, 0, first.step, first.step as f64 * replay.model.step_s, format!("the first keyframe: {e}"));
    }
    let (model, mut camera) = (&replay.model, Camera::since(replay.origin));
    let mut scratch = Scratch::new(model);
    let mut evaluated = false;
    let mut stopped = false;
    // Step of the last frame, and steps between two.
    let (mut seen, rhythm) = (None, replay.header().steps_per_frame);
    let wanted = Wanted { frames: true, keyframes: true, ..Wanted::default() };
    replay.reader.each(wanted, WHOLE, |entry| {
        if stop.load(Ordering::Relaxed) {
            stopped = true;
            return Ok(Flow::Enough);
        }
        match entry {
            Entry::Frame(theirs) => {
                while state.step < theirs.step {
                    let due = rhythm > 0 && state.step.is_multiple_of(rhythm);
                    verdict.missing_frames += u64::from(due && seen.is_some_and(|seen| state.step > seen));
                    if stop.load(Ordering::Relaxed) {
                        stopped = true;
                        return Ok(Flow::Enough);
                    }
                    if !std::mem::take(&mut evaluated) {
                        scheme::evaluate(model, &state, &mut scratch)?;
                    }
                    scheme::advance(model, &mut state, &mut scratch);
                }
                if !evaluated {
                    scheme::evaluate(model, &state, &mut scratch)?;
                    evaluated = true;
                }
                let ours = camera.take(model, &state, &scratch);
                if ours != *theirs {
                    let frame = verdict.frames;
                    note(&mut verdict, frame, theirs.step, theirs.t_s, frame_difference(theirs, &ours));
                }
                verdict.frames += 1;
                seen = Some(theirs.step);
                progress(theirs.step);
            }
            Entry::Keyframe(theirs) => {
                verdict.keyframes += 1;
                let ours = state.keyframe();
                if ours != *theirs {
                    let t_s = theirs.step as f64 * model.step_s;
                    let frame = verdict.frames.saturating_sub(1);
                    let what = keyframe_difference(&theirs, &ours, "the run");
                    note(&mut verdict, frame, theirs.step, t_s, what);
                }
            }
            Entry::Head(_) | Entry::Event(_) | Entry::Impact(_) => {}
        }
        Ok(Flow::On)
    })?;
    verdict.first = notes.pop();
    verdict.state_hash = format!("{:016x}", state.hash());
    Ok((!stopped).then_some(verdict))
}

fn keyframe_difference(theirs: &Keyframe, ours: &Keyframe, who: &str) -> String {
    if theirs.step != ours.step {
        return format!("a keyframe of step {} where {who} is at step {}", theirs.step, ours.step);
    }
    for (a, b) in theirs.columns.iter().zip(&ours.columns) {
        if a.name != b.name || a.values.len() != b.values.len() {
            return format!("column `{}` of the keyframe, `{}` of {who}", a.name, b.name);
        }
        if let Some(i) = (0..a.values.len()).find(|i| a.values[*i].to_bits() != b.values[*i].to_bits()) {
            return format!("{}[{i}]: recorded {:e}, {who} gives {:e}", a.name, a.values[i], b.values[i]);
        }
    }
    format!("state hash: recorded {:016x}, {who} gives {:016x}", theirs.state_hash, ours.state_hash)
}

/// The first value that differs between a recorded frame and the recomputed one.
pub fn frame_difference(theirs: &Frame, ours: &Frame) -> String {
    for ((name, a), (_, b)) in theirs.columns().into_iter().zip(ours.columns()) {
        if a.len() != b.len() {
            return format!("{name}: {} rows recorded, the run gives {}", a.len(), b.len());
        }
        if let Some(i) = a.first_difference(&b) {
            return format!("{name}[{i}]: recorded {}, the run gives {}", a.show(i), b.show(i));
        }
    }
    format!("state hash: recorded {:016x}, the run gives {:016x}", theirs.state_hash, ours.state_hash)
}
