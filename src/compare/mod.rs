//! Compares several drives: runs them at one step, observes the driver, judges the impacts, and records them together.
//!
//! All numbers refer to engagements on the driver, in its tooth periods T (u as in [`crate::engagement`]). First
//! contact is that of the tooth contact of a chain (bush or trailing flank) and, for an abutment chain, of every kind
//! separately. rho v^2 is subtracted from the tension, because links are pressed onto a sprocket by T - rho v^2.

pub mod headline;
pub mod laws;
pub mod merge;
pub mod spectrum;

use crate::assemble::{Assembly, AssemblyError, assemble};
use crate::diag::Report;
use crate::drive::{ChainFidelity, ChainPart, Drive};
use crate::elements::contact_law::ContactLaw;
use crate::engagement::{ContactKind, EngagementWatch, KINDS, Pass};
use crate::impacts::ImpactWatch;
use crate::integrate::explicit::Scratch;
use crate::integrate::{StepError, scheme};
use crate::model::Model;
use crate::pairs::contour_body::LinkContour;
use crate::recording::capture::{self, Camera};
use crate::recording::frame::{BodyInfo, Event, Feature, Frame, Header, Impact, RISE_FROM_SHARE};
use crate::simulate::{RunLength, SLOWEST_EVENT_M_S, touch_event};
use crate::state::State;
use crate::statistics::median;
use spectrum::{Spectrum, SpeedLog};
use std::sync::atomic::{AtomicBool, Ordering};

/// Engagement window [T].
pub const WINDOW_T: (f64, f64) = (-2.0, 3.0);

/// Duration of the runs, and the part that is recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    pub duration_s: f64,
    /// Recorded from the start on.
    pub recorded_s: f64,
    pub every_s: f64,
}

/// Results of one drive.
pub struct Run {
    pub name: String,
    pub title: String,
    pub header: Header,
    pub frames: Vec<Frame>,
    pub events: Vec<Event>,
    /// Impacts of the recorded part, in the order in which they end.
    pub impacts: Vec<Impact>,
    pub passes: Vec<Pass>,
    pub summary: DriveSummary,
    /// Spectrum of the first sprocket that turns freely; None if there is none, or if the run is shorter than two
    /// revolutions of the driver.
    pub spectrum: Option<Spectrum>,
}

/// Statistics of one kind of contact over all passes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct KindSummary {
    pub kind: ContactKind,
    /// Passes in which it made contact.
    pub passes: usize,
    /// u of first contact, median [T].
    pub first_touch_t: f64,
    /// Approach speed at first contact [m/s].
    pub approach_median_m_s: f64,
    pub approach_max_m_s: f64,
    /// Largest force in the engagement window, over the whole lap, and from two pitches before the end of the wrap on
    /// [N].
    pub peak_window_n: f64,
    pub peak_lap_n: f64,
    pub peak_exit_n: f64,
    /// Mean over the second pitch [N].
    pub second_pitch_n: f64,
    /// 10 to 90 % of the first force rise, median [T]; NaN where the law's force jumps at the touch by more than a tenth of the peak.
    pub rise_t: f64,
}

/// Results of a run.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct DriveSummary {
    pub drive: String,
    #[serde(flatten)]
    pub headline: headline::Headline,
    pub step_s: f64,
    pub passes: usize,
    pub kinds: Vec<KindSummary>,
    /// Tight span: mean tension, and amplitudes at orders z/2 and z of the driver [N].
    pub tight_tension_n: f64,
    pub tension_half_order_n: f64,
    pub tension_tooth_order_n: f64,
    /// rho v^2 [N].
    pub centrifugal_tension_n: f64,
    /// p omega of the driver: the speed at which a link turns onto it [m/s].
    pub turning_speed_m_s: f64,
    /// Tooth-order speed variation of the tight span, peak to peak over its mean.
    pub speed_ripple: f64,
    /// Amplitudes of the driven sprocket's speed at orders z/2 and z of the driver, over its mean.
    pub driven_speed_half_order: Option<f64>,
    pub driven_speed_tooth_order: Option<f64>,
    /// Impacts on every body over the whole loop, including links that leave a sprocket and land again.
    pub touches: Vec<BodyTouches>,
    /// Share of passes with guide, ring, bush and both abutments in this order; abutment chains only.
    pub sequence: Option<f64>,
    /// Relative difference (even - odd) / (even + odd) of the seating forces in the first pitch after seating.
    pub odd_even_asymmetry: f64,
    /// u of first contact with the teeth, even minus odd links, medians [T].
    pub odd_even_first_touch_t: f64,
}

/// First contacts on one body after two tooth periods without contact (see [`crate::impacts`]).
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct BodyTouches {
    pub body: String,
    pub touches: usize,
    /// The fastest one: part of the link, approach speed [m/s], and its peak force [N].
    pub part: &'static str,
    pub approach_max_m_s: f64,
    pub peak_there_n: f64,
    pub approach_p50_m_s: f64,
}

/// Why a comparison ended early.
#[derive(Debug)]
pub enum CompareError {
    Assembly {
        drive: String,
        error: AssemblyError,
    },
    Step {
        drive: String,
        error: StepError,
    },
    Drive(Report),
    /// No link passed the driver of this drive.
    NothingSeen {
        drive: String,
    },
    /// The chain on the driver has spans in place of links.
    NoLinks {
        drive: String,
    },
    Interrupted,
}

impl std::fmt::Display for CompareError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            CompareError::Assembly { drive, error } => write!(f, "{drive} cannot be assembled: {error}"),
            CompareError::Step { drive, error } => write!(f, "{drive}: {error}"),
            CompareError::Drive(report) => write!(f, "{report}"),
            CompareError::NothingSeen { drive } => write!(
                f,
                "{drive}: no link passed the driver in this time\n\
                 help: a pass takes the wrap and six pitches, make `--duration` longer; drives must run forwards \
                 (`speed_rpm` above 0) with the driver inside the loop"
            ),
            CompareError::NoLinks { drive } => write!(
                f,
                "{drive}: the chain on its driver has spans in place of links, and `compare` watches links pass the driver\n\
                 help: set `fidelity = \"links\"` in the table of this chain"
            ),
            CompareError::Interrupted => write!(f, "interrupted: nothing was compared"),
        }
    }
}

impl std::error::Error for CompareError {}

/// Assembles and runs all drives, each on its own thread, at the smallest of their steps.
pub fn run(drives: &[Drive], plan: Plan, stop: &AtomicBool) -> Result<Vec<Run>, CompareError> {
    if let Some(drive) = drives.iter().find(|d| !has_links_on_its_driver(d)) {
        return Err(CompareError::NoLinks { drive: drive.name.clone() });
    }
    let assembled = in_parallel(drives.iter().collect(), |drive: &Drive| {
        assemble(drive).map_err(|error| CompareError::Assembly { drive: drive.name.clone(), error })
    })?;
    let step_s = assembled.iter().map(|a| a.model.step_s).fold(f64::INFINITY, f64::min);
    let jobs: Vec<(&Drive, Assembly)> = drives.iter().zip(assembled).collect();
    in_parallel(jobs, |(drive, mut assembly)| {
        assembly.state.restep(assembly.model.step_s, step_s);
        assembly.model.step_s = step_s;
        run_one(drive, assembly, plan, stop)
    })
}

/// Runs every job on its own thread; returns the first error in the order of the jobs.
fn in_parallel<J: Send, R: Send>(
    jobs: Vec<J>,
    work: impl Fn(J) -> Result<R, CompareError> + Sync,
) -> Result<Vec<R>, CompareError> {
    let work = &work;
    std::thread::scope(|scope| {
        let threads: Vec<_> = jobs.into_iter().map(|job| scope.spawn(move || work(job))).collect();
        threads.into_iter().map(|t| t.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))).collect()
    })
}

/// What a comparison observes of one drive: passes over its driver, impacts, the speed of what turns freely.
pub struct DriverWatch {
    passes: EngagementWatch,
    struck: ImpactWatch,
    /// Impacts that are over, in the order in which they end.
    pub impacts: Vec<Impact>,
    speeds: SpeedLog,
    free: Option<usize>,
}

impl DriverWatch {
    pub fn new(model: &Model) -> DriverWatch {
        DriverWatch {
            passes: EngagementWatch::new(model, model.driver),
            struck: ImpactWatch::new(model),
            impacts: Vec::new(),
            speeds: SpeedLog::default(),
            free: model.sprockets.iter().position(|s| model.coordinates[s.coordinate].is_free()),
        }
    }

    /// Observes an evaluated step; returns the impacts that begin there.
    pub fn observe(&mut self, model: &Model, state: &State, scratch: &Scratch) -> Vec<Impact> {
        self.passes.observe(model, state, scratch);
        self.struck.observe(model, state, scratch);
        self.impacts.extend(self.struck.take_done());
        if let Some(k) = self.free {
            self.speeds.add(state.coordinates.angle[model.driver].abs(), state.coordinates.omega[k]);
        }
        self.struck.take_touched()
    }

    /// The results, once the last step was observed; `header` names the bodies.
    ///
    /// # Errors
    /// No link passed the driver.
    pub fn finish(&mut self, drive: &Drive, model: &Model, header: &Header) -> Result<Watched, CompareError> {
        self.impacts.extend(self.struck.finish());
        if self.passes.done.is_empty() {
            return Err(CompareError::NothingSeen { drive: drive.name.clone() });
        }
        let teeth = f64::from(model.sprockets[model.driver].geometry.teeth());
        let spectrum = self.speeds.spectrum(3.25 * teeth);
        let mut summary = summarise(drive, model, &self.passes);
        summary.touches = touches(&self.impacts, header, 2.0 * self.passes.period_s());
        summary.driven_speed_half_order = spectrum.as_ref().and_then(|s| s.at(0.5 * teeth));
        summary.driven_speed_tooth_order = spectrum.as_ref().and_then(|s| s.at(teeth));
        Ok(Watched { summary, spectrum, passes: std::mem::take(&mut self.passes.done) })
    }
}

/// What [`DriverWatch::finish`] gives.
pub struct Watched {
    pub summary: DriveSummary,
    /// See [`Run::spectrum`].
    pub spectrum: Option<Spectrum>,
    pub passes: Vec<Pass>,
}

/// Whether links pass the driver of a drive: a chain of spans has none.
pub fn has_links_on_its_driver(drive: &Drive) -> bool {
    let is_driving = |chain: &usize| drive.sprockets_of(*chain).contains(&drive.driver());
    (0..drive.chains()).filter(is_driving).all(|chain| drive.fidelity_of(chain) == ChainFidelity::Links)
}

fn run_one(drive: &Drive, assembly: Assembly, plan: Plan, stop: &AtomicBool) -> Result<Run, CompareError> {
    let Assembly { model, mut state, report } = assembly;
    let mut scratch = Scratch::new(&model);
    let mut watch = DriverWatch::new(&model);
    let span = RunLength::new(plan.duration_s, plan.every_s, model.step_s);
    let header = capture::header(drive, &model, &report, span.steps_per_frame);
    let recorded = (plan.recorded_s / model.step_s) as u64;
    let (mut frames, mut events) = (Vec::new(), Vec::new());
    let mut camera = Camera::default();
    for step in 0..=span.steps {
        if stop.load(Ordering::Relaxed) {
            return Err(CompareError::Interrupted);
        }
        scheme::evaluate(&model, &state, &mut scratch)
            .map_err(|error| CompareError::Step { drive: drive.name.clone(), error })?;
        let touched = watch.observe(&model, &state, &scratch);
        if step <= recorded {
            let told = touched.iter().filter(|i| i.approach_speed_m_s > SLOWEST_EVENT_M_S);
            events.extend(told.map(|i| touch_event(i, &header)));
        }
        if step <= recorded && step.is_multiple_of(span.steps_per_frame) {
            let frame = camera.take(&model, &state, &scratch);
            frames.push(frame);
        }
        scheme::advance(&model, &mut state, &mut scratch);
    }
    let Watched { summary, spectrum, passes } = watch.finish(drive, &model, &header)?;
    let mut impacts = watch.impacts;
    impacts.retain(|i| i.step <= recorded);
    let (name, title) = (drive.name.clone(), drive.title.clone());
    Ok(Run { name, title, header, frames, events, impacts, passes, summary, spectrum })
}

fn summarise(drive: &Drive, model: &Model, watch: &EngagementWatch) -> DriveSummary {
    let passes = &watch.done;
    let teeth = f64::from(model.sprockets[model.driver].geometry.teeth());
    let exit_from = model
        .route_at(model.driver)
        .map_or(0.0, |(r, k)| r.wrap(k).sweep_rad.abs() / (2.0 * std::f64::consts::PI) * teeth - 2.0);
    let kinds = KINDS
        .iter()
        .filter(|k| passes.iter().any(|p| p.first_touch[**k as usize].is_some()))
        .map(|k| summarise_kind(*k, driver_law(drive, *k), passes, exit_from))
        .collect();
    let (mean, half, full) = watch.tension_n();
    let driven = model.sprockets[model.driver].chain;
    let (chain, contour) = (model.chain.loops[driven].clone(), &model.contours[driven]);
    let pitch = 2.0 * model.chain.lever[chain.start];
    let per_length = model.chain.mass[chain.clone()].iter().sum::<f64>() / (chain.len() as f64 * pitch);
    let mut summary = DriveSummary {
        drive: drive.name.clone(),
        headline: headline::Headline::default(),
        step_s: model.step_s,
        passes: passes.len(),
        kinds,
        tight_tension_n: mean,
        tension_half_order_n: half,
        tension_tooth_order_n: full,
        centrifugal_tension_n: per_length * model.chain_speed_m_s().powi(2),
        turning_speed_m_s: pitch * model.sprockets[model.driver].nominal_speed_rad_s.abs(),
        speed_ripple: watch.speed_ripple(),
        touches: Vec::new(),
        driven_speed_half_order: None,
        driven_speed_tooth_order: None,
        sequence: matches!(contour, Some(LinkContour::Abutments { .. })).then(|| sequence(passes)),
        odd_even_asymmetry: asymmetry(passes),
        odd_even_first_touch_t: odd_even_first_touch(passes),
    };
    summary.headline = headline::headline(&summary, passes, watch.period_s(), exit_from + 2.0);
    summary
}

/// Impacts by body, without those of the start of the run.
fn touches(impacts: &[Impact], header: &Header, from_s: f64) -> Vec<BodyTouches> {
    let of_body = |(k, body): (usize, &BodyInfo)| {
        let own: Vec<&Impact> = impacts.iter().filter(|i| i.body as usize == k && i.t_s >= from_s).collect();
        let fastest = own.iter().max_by(|a, b| a.approach_speed_m_s.total_cmp(&b.approach_speed_m_s))?;
        Some(BodyTouches {
            body: body.path.clone(),
            touches: own.len(),
            part: Feature::name(fastest.feature),
            approach_max_m_s: fastest.approach_speed_m_s,
            peak_there_n: fastest.peak_force_n,
            approach_p50_m_s: median(own.iter().map(|i| i.approach_speed_m_s)),
        })
    };
    header.bodies.iter().enumerate().filter_map(of_body).collect()
}

/// Contact law of a kind of contact on the driver and its guide.
fn driver_law(drive: &Drive, kind: ContactKind) -> ContactLaw {
    let chain = drive.sprockets[drive.driver()].chain;
    let of = |part: &ChainPart| (part.tooth_contact, part.ring_contact, part.guide_contact);
    let first = (drive.tooth_contact, drive.ring_contact, drive.guide_contact);
    let (tooth, ring, guide) = chain.checked_sub(1).map_or(first, |k| of(&drive.more[k]));
    match kind {
        ContactKind::RingFront | ContactKind::RingRear => ring.law,
        ContactKind::Guide => guide.law,
        ContactKind::Bush | ContactKind::FlankLeading | ContactKind::FlankTrailing | ContactKind::InnerFlank => {
            tooth.law
        }
    }
}

fn summarise_kind(kind: ContactKind, law: ContactLaw, passes: &[Pass], exit_from: f64) -> KindSummary {
    let touched: Vec<(f64, f64)> = passes.iter().filter_map(|p| p.first_touch[kind as usize]).collect();
    let largest = |from: f64, to: f64| passes.iter().map(|p| p.peak(kind, from, to)).fold(0.0, f64::max);
    let speeds = || touched.iter().map(|t| t.1);
    let own_rise = |p: &Pass| {
        let touch_n = law.touch_force_n(p.first_touch[kind as usize]?.1);
        (touch_n <= RISE_FROM_SHARE * p.peak(kind, WINDOW_T.0, 2.5)).then(|| p.rise(kind, WINDOW_T.0, 2.5))?
    };
    KindSummary {
        kind,
        passes: touched.len(),
        first_touch_t: median(touched.iter().map(|t| t.0)),
        approach_median_m_s: median(speeds()),
        approach_max_m_s: speeds().fold(0.0, f64::max),
        peak_window_n: largest(WINDOW_T.0, WINDOW_T.1),
        peak_lap_n: largest(f64::NEG_INFINITY, f64::INFINITY),
        peak_exit_n: largest(exit_from, f64::INFINITY),
        second_pitch_n: median(passes.iter().map(|p| p.mean(kind, 1.0, 2.0))),
        rise_t: median(passes.iter().filter_map(own_rise)),
    }
}

/// Share of passes with contacts of guide, ring, bush and rear abutment in this order.
fn sequence(passes: &[Pass]) -> f64 {
    let order = [ContactKind::Guide, ContactKind::RingFront, ContactKind::Bush, ContactKind::RingRear];
    let right = |p: &&Pass| {
        let at: Vec<Option<f64>> = order.iter().map(|k| p.first_touch[*k as usize].map(|t| t.0)).collect();
        at.windows(2).all(|w| matches!(w, [Some(a), Some(b)] if a < b))
    };
    passes.iter().filter(right).count() as f64 / passes.len().max(1) as f64
}

/// Median u of first contact with the teeth, even minus odd links.
fn odd_even_first_touch(passes: &[Pass]) -> f64 {
    let of = |odd: usize| {
        let tooth = [ContactKind::Bush, ContactKind::FlankTrailing];
        let first = |p: &Pass| tooth.into_iter().find_map(|k| p.first_touch[k as usize]).map(|t| t.0);
        median(passes.iter().filter(|p| p.link % 2 == odd).filter_map(first))
    };
    of(0) - of(1)
}

/// (even - odd) / (even + odd) of the mean tooth force over u = 1 to 2.
fn asymmetry(passes: &[Pass]) -> f64 {
    let tooth = [ContactKind::Bush, ContactKind::FlankTrailing];
    let mean = |odd: usize| {
        let of: Vec<f64> = passes
            .iter()
            .filter(|p| p.link % 2 == odd)
            .filter_map(|p| {
                let kind = tooth.into_iter().find(|k| p.first_touch[*k as usize].is_some())?;
                // From the same position in the pitch for both, not from their own first contacts.
                Some(p.mean(kind, 1.0, 2.0))
            })
            .collect();
        of.iter().sum::<f64>() / of.len().max(1) as f64
    };
    let (even, odd) = (mean(0), mean(1));
    if even + odd > 0.0 { (even - odd) / (even + odd) } else { 0.0 }
}

impl DriveSummary {
    /// The contact that seats a link in the teeth.
    pub fn tooth(&self) -> Option<&KindSummary> {
        self.kinds.iter().find(|k| matches!(k.kind, ContactKind::Bush | ContactKind::FlankTrailing))
    }

    /// Highest approach speed at first contact of any kind on the driver [m/s].
    pub fn fastest_touch_m_s(&self) -> f64 {
        self.kinds.iter().map(|k| k.approach_max_m_s).fold(0.0, f64::max)
    }

    /// Largest force of any contact on the driver and its guide in the engagement window, and over the lap [N].
    pub fn largest_n(&self) -> (f64, f64) {
        let of = |f: &dyn Fn(&KindSummary) -> f64| self.kinds.iter().map(f).fold(0.0, f64::max);
        (of(&|k| k.peak_window_n), of(&|k| k.peak_lap_n))
    }

    pub fn kind(&self, kind: ContactKind) -> Option<&KindSummary> {
        self.kinds.iter().find(|k| k.kind == kind)
    }
}

/// A claim and the measured result.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Claim {
    /// Concerns another chain, for contrast; it does not count in the verdict on the abutment chain.
    pub contrast: bool,
    pub claim: String,
    pub measured: String,
    pub holds: bool,
}

/// Impact-free engagement of every abutment chain, contrasted with the other drives; None if there is no abutment
/// chain.
pub fn verdict(summaries: &[&DriveSummary]) -> Option<Vec<Claim>> {
    let abutments: Vec<&&DriveSummary> = summaries.iter().filter(|s| s.sequence.is_some()).collect();
    let first = abutments.first()?;
    let mut claims: Vec<Claim> = abutments.iter().flat_map(|s| own_claims(s)).collect();
    for other in summaries.iter().filter(|s| s.sequence.is_none()) {
        claims.extend(contrasts(first, other));
    }
    Some(claims)
}

fn own_claims(smart: &DriveSummary) -> Vec<Claim> {
    let speed = smart.turning_speed_m_s;
    let pressing = smart.tight_tension_n - smart.centrifugal_tension_n;
    let fastest = smart.fastest_touch_m_s();
    let (window, lap) = smart.largest_n();
    let ring = smart.kind(ContactKind::RingFront).map_or(f64::NAN, |k| k.peak_window_n);
    let rise = smart.tooth().map_or(f64::NAN, |k| k.rise_t);
    let order = smart.sequence.unwrap_or(0.0);
    let claim = |text: &str, holds: bool, measured: String| Claim {
        contrast: false,
        claim: format!("{}: {text}", smart.drive),
        measured,
        holds,
    };
    let mut claims = vec![
        claim(
            "every first touch on the driver is slower than 3 % of p omega",
            fastest <= 0.03 * speed,
            format!("{fastest:.4} m/s, {:.1} % of {speed:.3} m/s", 100.0 * fastest / speed),
        ),
        claim("no contact exceeds 130 N while a link engages", window <= 130.0, format!("{window:.1} N")),
        claim("no contact exceeds 150 N over the whole lap", lap <= 150.0, format!("{lap:.1} N")),
        claim(
            "the ring carries at most 0.30 of T - rho v^2",
            ring <= 0.30 * pressing,
            format!("{ring:.1} N, {:.3} of {pressing:.0} N", ring / pressing),
        ),
        claim(
            "guide, ring, bush, both abutments, in this order, in 99 % of passes",
            order >= 0.99,
            format!("{:.1} % of {}", 100.0 * order, smart.passes),
        ),
        claim(
            "tooth-order speed ripple of the tight span below 0.15 %",
            smart.speed_ripple < 1.5e-3,
            format!("{:.3} %", 100.0 * smart.speed_ripple),
        ),
    ];
    // Not where the force jumps at the touch by the law's damper.
    if rise.is_finite() {
        let text = "the tooth force builds up over at least 0.2 tooth periods";
        claims.insert(4, claim(text, rise >= 0.2, format!("{rise:.2} T")));
    }
    claims
}

fn contrasts(smart: &DriveSummary, other: &DriveSummary) -> Vec<Claim> {
    let Some(tooth) = other.tooth() else { return Vec::new() };
    let (fastest, rise) = (smart.fastest_touch_m_s(), smart.tooth().map_or(f64::NAN, |k| k.rise_t));
    let (strikes, speed) = (tooth.approach_median_m_s, other.turning_speed_m_s);
    let (times, rises) = (strikes / fastest, rise / tooth.rise_t);
    // A bush lands on a seat, a flank rolls onto a flank: expected from the kinematics of both.
    let told = rises.is_finite();
    let (faster, sharper) = if tooth.kind == ContactKind::Bush { (20.0, 30.0) } else { (5.0, 10.0) };
    let claim = |text: String, holds: bool, measured: String| Claim {
        contrast: true,
        claim: format!("{}: {text}", other.drive),
        measured,
        holds,
    };
    vec![
        claim(
            "strikes its teeth at more than 10 % of p omega".into(),
            strikes > 0.1 * speed,
            format!(
                "{strikes:.3} m/s, {:.0} % and {times:.0} times as fast as {} touches",
                100.0 * strikes / speed,
                smart.drive
            ),
        ),
        if told {
            claim(
                format!(
                    "at least {faster} times as fast as {}, and its teeth are loaded {sharper} times faster",
                    smart.drive
                ),
                times >= faster && rises >= sharper,
                format!("{times:.0} times; {rises:.0} times, in {:.3} T", tooth.rise_t),
            )
        } else {
            claim(
                format!("at least {faster} times as fast as {}", smart.drive),
                times >= faster,
                format!(
                    "{times:.0} times; how fast its teeth are loaded is set by its contact law, whose force jumps at the touch"
                ),
            )
        },
    ]
}
