//! Assembly: the loop is put on, closed, tightened, loaded, given consistent speeds, and run in.
//!
//! 1. The chain is laid on its route and the tightening sprocket moved until the mean tension of the loop at rest, without
//!    load and without effects, is the preload (mean over one tooth period of the driver: the loop of a polygon drive has no constant length).
//! 2. Under load, static equilibrium by [`crate::statics`]; its residual is reported.
//! 3. Speeds: the derivative of that equilibrium with respect to the driver's angle, times the driver's speed: consistent
//!    with every joint and contact.
//! 4. Run-in: a consistent start still rings at the torsional mode, so extra damping is applied and faded out, then the drive
//!    settles without it. How still it is afterwards is reported. Then the clock is set to zero.

mod report;
mod shared;
mod start;
mod travel;

pub use report::{
    AssemblyError, AssemblyReport, ChainPreload, MovedAxis, RestingArm, RestingSlider, RestingStop, SpanReport,
    ValveReport,
};
pub use shared::SharedParts;
pub use start::resting_state;
use start::{moving_state, wrap_angles};
use travel::{check_travel, place_tips, resting_arms, resting_sliders};

use crate::drive::{ChainFidelity, Drive, Effects, PreloadSpec, Scheme};
use crate::geometry::route::Route;
use crate::geometry::{Vec2, cross, rotated, unit};
use crate::integrate::explicit::{self, RunIn, Scratch, WINDOW_MARGIN_M};
use crate::integrate::scheme;
use crate::integrate::step_bound::{StepBound, default_step, step_bound};
use crate::integrate::{Isa, StepError};
use crate::model::{Model, PlacedDrive, Profiles, SpanTerms, close, place};
use crate::pairs::part_part::TouchShape;
use crate::state::{FAR_AWAY_M, State};
use crate::statics::{Configuration, Equilibrium, condensed, equilibrium, forces_on};
use crate::units::RPM;
use std::f64::consts::PI;

/// A drive ready to run.
pub struct Assembly {
    /// The compiled drive, with its axes where they were moved to.
    pub model: Model,
    /// The state at step 0, after run-in and settling.
    pub state: State,
    /// How it was assembled.
    pub report: AssemblyReport,
}

/// Phases of the driver over one tooth period at which the preload is averaged.
const PRELOAD_PHASES: u32 = 4;
/// The mean preload is met to this fraction.
const PRELOAD_TOLERANCE: f64 = 1e-4;

/// Compiles and assembles a drive: moves axes until the preload is met, finds the static equilibrium under load, runs in.
///
/// # Errors
/// See [`AssemblyError`].
pub fn assemble(drive: &Drive) -> Result<Assembly, AssemblyError> {
    assemble_with(drive, Isa::detect())
}

#[doc(hidden)]
/// A drive tightened and compiled, without the State that assembling ends in.
pub struct Compiled {
    /// The compiled drive.
    pub model: Model,
    bound: StepBound,
    /// Step with which the drive is run in [s].
    run_in_step_s: f64,
    /// Mean tension of every chain at rest over the phases of its driver [N].
    tensions_n: Vec<Vec<f64>>,
}

/// Compiles a drive up to its Model: for runs that go on from a recorded State.
pub fn compile(drive: &Drive) -> Result<Compiled, AssemblyError> {
    let compiled = compile_with(drive, None)?;
    Ok(Compiled { model: compiled.model.for_its_scheme(), ..compiled })
}

fn compile_with(drive: &Drive, shared: Option<&SharedParts>) -> Result<Compiled, AssemblyError> {
    let (mut models, mut tensions_n) = (Vec::new(), Vec::new());
    for chain in 0..drive.chains() {
        let (model, own_n) = compile_alone(&drive.single_chain(chain), shared)?;
        models.push(model);
        tensions_n.push(own_n);
    }
    let mut model = if models.len() == 1 { models.remove(0) } else { Model::join(drive, models) };
    add_mechanisms(&mut model, drive);
    let bound = step_bound(&model);
    let step_s = choose_step(drive, &model, &bound)?;
    // A drive is run in by the leapfrog, whatever scheme it is recorded with.
    let run_in_step_s = if model.scheme == Scheme::Leapfrog { step_s } else { default_step(&bound) };
    model.step_s = run_in_step_s;
    turn_cams(&mut model, drive)?;
    model.step_s = step_s;
    Ok(Compiled { model, bound, run_in_step_s, tensions_n })
}

/// One chain of a drive, tightened, and its mean tension at rest over the phases of its driver [N].
fn compile_alone(drive: &Drive, shared: Option<&SharedParts>) -> Result<(Model, Vec<f64>), AssemblyError> {
    let profiles = shared.map_or_else(|| Profiles::new(drive), |shared| shared.profiles(drive));
    let placed = profiles.and_then(|p| close(drive, p)).map_err(AssemblyError::Input)?;
    if drive.fidelity == ChainFidelity::Spans {
        // Tightened with its links, which then leave their tension to the spans.
        let linked = Drive { fidelity: ChainFidelity::Links, ..drive.clone() };
        let (model, tensions_n) = compile_alone(&linked, shared)?;
        let terms = spans_under_load(&model, &linked)?;
        return Ok((model.with_fidelity(drive, &terms).map_err(AssemblyError::Input)?, tensions_n));
    }
    // The preload is set on the drive as it should be: what departs from that comes later, and changes the tension.
    let key = shared.map(|_| SharedParts::key(drive));
    let known = shared.zip(key.as_ref()).and_then(|(shared, key)| shared.tightened(key));
    let (shift, tensions_n) = match (known, drive.effects == Effects::default()) {
        (Some(known), _) => known,
        (None, true) => tighten(drive, &placed)?,
        (None, false) => {
            let ideal = Drive { effects: Effects::default(), ..drive.clone() };
            tighten(&ideal, &place(&ideal).map_err(AssemblyError::Input)?)?
        }
    };
    if let Some((shared, key)) = shared.zip(key) {
        shared.keep_tightened(key, (shift, tensions_n.clone()));
    }
    Ok((Model::build(drive, &placed, shift).map_err(AssemblyError::Input)?, tensions_n))
}

/// What the spans of a chain with links do at rest under the load, in the mean over the phases of its driver: the preload is set so too.
fn spans_under_load(model: &Model, drive: &Drive) -> Result<SpanTerms, AssemblyError> {
    let mut model = model.clone();
    let sense = drive.chain_speed_m_s().signum();
    for (s, spec) in model.sprockets.iter().zip(&drive.sprockets) {
        model.coordinates[s.coordinate].rest_load -= spec.passes_on_nm * sense * spec.wrap.sign();
    }
    let no_stiffness = || AssemblyError::Statics {
        what: "the links at rest have no stiffness of their own".into(),
        residual_n: f64::NAN,
        iterations: 0,
    };
    let mut mean = SpanTerms { tension_n: 0.0, stiffness_n_per_m: vec![0.0; model.sprockets.len()] };
    let share = 1.0 / f64::from(PRELOAD_PHASES);
    for phase in 0..PRELOAD_PHASES {
        let rest = rest_configuration(&model, drive, f64::from(phase) * share)?;
        let unloaded = solve(&model, rest, 0.0, "tightening the loop")?;
        let loaded = solve(&model, unloaded.configuration, 1.0, "loading the drive")?;
        mean.tension_n += share * mean_of_spans(&model, drive, &loaded);
        let condensed = condensed(&model, &loaded.configuration).ok_or_else(no_stiffness)?;
        let own = model.span_stiffness(drive, &condensed.stiffness);
        mean.stiffness_n_per_m.iter_mut().zip(own).for_each(|(sum, own)| *sum += share * own);
    }
    Ok(mean)
}

/// Tension that all spans would have if none were longer than the others [N]: the mean of their tensions, each weighted with its length.
fn mean_of_spans(model: &Model, drive: &Drive, loaded: &Equilibrium) -> f64 {
    let pitch_m = drive.chain.pitch_m();
    let (mut sum, mut weights) = (0.0, 0.0);
    for k in 0..model.sprockets.len() {
        let Some((route, place)) = model.route_at(k) else { continue };
        let span = route.span_after(place);
        for joint in model.chain.links() {
            let (centre, heading) = loaded.configuration.links[joint];
            let from = centre + unit(heading) * model.chain.lever[joint] - span.start;
            let (along_m, aside_m) = (from.dot(&span.direction), cross(span.direction, from));
            if aside_m.abs() < 0.5 * pitch_m && (pitch_m..span.length_m - pitch_m).contains(&along_m) {
                (sum, weights) = (sum + loaded.tensions_n[joint], weights + 1.0);
            }
        }
    }
    if weights > 0.0 { sum / weights } else { drive.preload.tension_n() }
}

/// Compiles a drive whose tightening sprocket stays where it is in another model: for runs that go on with other values.
pub fn compile_in_place(drive: &Drive, other: &Model) -> Result<Model, AssemblyError> {
    let mut models = Vec::new();
    for chain in 0..drive.chains() {
        let (own, first) = (drive.single_chain(chain), drive.sprockets_of(chain).start);
        let placed = place(&own).map_err(AssemblyError::Input)?;
        let shift = match own.preload {
            PreloadSpec::Sprocket { moves, .. } => other
                .sprockets
                .get(first + moves)
                .map_or(0.0, |s| (s.frame.origin - placed.pulleys[moves].centre).dot(&placed.direction)),
            PreloadSpec::Arm(_) | PreloadSpec::Blade => 0.0,
        };
        // With joints of another stiffness the spans change as these do; what teeth share in them stays.
        let spans = other.spans.iter().filter(|s| s.chain == chain);
        let joint = other.chain.joints.get(chain).map_or(own.joint.stiffness_n_per_m, |j| j.stiffness_n_per_m);
        let stiffer = own.joint.stiffness_n_per_m / joint;
        let terms = SpanTerms {
            tension_n: spans.clone().next().map_or(own.preload.tension_n(), |s| s.preload_n),
            stiffness_n_per_m: spans.map(|s| s.of_links_n_per_m * stiffer).collect(),
        };
        let with_links = Model::build(&own, &placed, shift);
        models.push(with_links.and_then(|model| model.with_fidelity(&own, &terms)).map_err(AssemblyError::Input)?);
    }
    let mut model = if models.len() == 1 { models.remove(0) } else { Model::join(drive, models) };
    add_mechanisms(&mut model, drive);
    model.step_s = choose_step(drive, &model, &step_bound(&model))?;
    // Cams stay where they are on their shafts.
    model.take_cams(other);
    Ok(model.for_its_scheme())
}

/// What a drive has besides its chains.
fn add_mechanisms(model: &mut Model, drive: &Drive) {
    model.add_shafts(drive);
    model.add_valves(drive);
    model.add_oil(drive);
    model.add_ratchets(drive);
    model.add_bearings(drive);
    model.add_blades(drive);
}

/// Sets the cams on their shafts: as the shafts are drawn, and turn until the recording begins.
fn turn_cams(model: &mut Model, drive: &Drive) -> Result<(), AssemblyError> {
    if drive.valves.is_empty() {
        return Ok(());
    }
    let stands = rest_configuration(model, drive, 0.0)?;
    let (damped, settling) = run_in_steps(drive, model.step_s);
    let run_in_s = (damped + settling) as f64 * model.step_s;
    model.set_cams(drive, &stands.coordinates, run_in_s);
    Ok(())
}

/// Steps with the extra damping of the run-in, and after it.
fn run_in_steps(drive: &Drive, step_s: f64) -> (u64, u64) {
    let steps = |time_s: f64| (time_s / step_s).ceil() as u64;
    (steps(drive.run.run_in_s), steps(drive.run.settle_s))
}

/// A drive at rest under its load: its model, and the equilibrium.
pub fn at_rest(drive: &Drive) -> Result<(Model, Equilibrium), AssemblyError> {
    let Compiled { model, .. } = compile_with(drive, None)?;
    let rest = rest_configuration(&model, drive, 0.0)?;
    let unloaded = solve(&model, rest, 0.0, "tightening the loop")?;
    check_rails(drive, &model, &unloaded)?;
    let loaded = solve(&model, unloaded.configuration, 1.0, "loading the drive")?;
    let loaded = float_journals(drive, &model, loaded)?;
    Ok((model, loaded))
}

/// Moves journals to where their films bear the chain at the nominal speed, and finds the equilibrium anew until both agree.
fn float_journals(drive: &Drive, model: &Model, at: Equilibrium) -> Result<Equilibrium, AssemblyError> {
    if !model.has_films() {
        return Ok(at);
    }
    let mut at = at;
    for _ in 0..FLOAT_ITERATIONS {
        let mut moved_m = 0.0_f64;
        for bearing in &model.bearings {
            let Some((film, turn)) = &bearing.film else { continue };
            let forces = forces_on(model, &at.configuration, bearing.ways.to_vec());
            let load = bearing.to_world([forces[0], forces[1]]);
            let speed_rad_s = model.coordinates[*turn].nominal_speed_rad_s;
            let Some(way) = film.locus(load, speed_rad_s) else {
                let (title, help) = if speed_rad_s == 0.0 {
                    (
                        "its shaft stands still, and a film bears nothing then".to_string(),
                        "take `[bearings.elastic.NAME]`",
                    )
                } else {
                    (
                        format!("its film cannot bear {:.0} N at {:.0} rpm", load.norm(), speed_rad_s / RPM),
                        "make the bearing longer or its clearance smaller, or take a thicker oil",
                    )
                };
                let help = help.to_string();
                let diag = drive.places.error(&bearing.path, title, Some(help));
                return Err(AssemblyError::Input(drive.places.report(vec![diag])));
            };
            let ways = [way.dot(&bearing.direction), cross(bearing.direction, way)];
            for (k, to) in bearing.ways.into_iter().zip(ways) {
                moved_m = moved_m.max((to - at.configuration.coordinates[k]).abs());
                at.configuration.coordinates[k] = to;
            }
        }
        at = solve(model, at.configuration, 1.0, "loading the drive on its bearings")?;
        if moved_m < FLOAT_TOLERANCE_M {
            return Ok(at);
        }
    }
    Err(AssemblyError::Statics {
        what: "bearings and chain find no common rest".into(),
        residual_n: at.residual_n,
        iterations: FLOAT_ITERATIONS,
    })
}

/// Rounds of bearings and chain; each gains two digits and more, because films are stiffer than chains.
const FLOAT_ITERATIONS: usize = 50;
/// Way of a journal in the last round [m].
const FLOAT_TOLERANCE_M: f64 = 1e-12;

/// As [`assemble`], with a given vector unit.
pub fn assemble_with(drive: &Drive, isa: Isa) -> Result<Assembly, AssemblyError> {
    assemble_from(drive, isa, None)
}

/// As [`assemble`], to the bit, with what other drives have in common with this one taken from them.
///
/// # Errors
/// See [`AssemblyError`].
pub fn assemble_sharing(drive: &Drive, shared: &SharedParts) -> Result<Assembly, AssemblyError> {
    assemble_from(drive, Isa::detect(), Some(shared))
}

fn assemble_from(drive: &Drive, isa: Isa, shared: Option<&SharedParts>) -> Result<Assembly, AssemblyError> {
    let Compiled { model, bound, run_in_step_s, tensions_n } = compile_with(drive, shared)?;
    let rest = rest_configuration(&model, drive, 0.0)?;
    let unloaded = solve(&model, rest, 0.0, "tightening the loop")?;
    check_rails(drive, &model, &unloaded)?;
    let loaded = solve(&model, unloaded.configuration, 1.0, "loading the drive")?;
    let loaded = float_journals(drive, &model, loaded)?;
    check_rails(drive, &model, &loaded)?;
    let mut state = moving_state(&model, &loaded)?;
    let (stillness, tension_drift) = if model.scheme == Scheme::Leapfrog {
        run_in(drive, &model, &mut state, isa).map_err(AssemblyError::RunIn)?
    } else {
        let leapfrog = model.stepped_by(Scheme::Leapfrog, run_in_step_s);
        let steadiness = run_in(drive, &leapfrog, &mut state, isa).map_err(AssemblyError::RunIn)?;
        let recorded = model.clone().for_its_scheme();
        scheme::convert(&leapfrog, &recorded, &mut state, isa).map_err(AssemblyError::RunIn)?;
        steadiness
    };
    let mean = |t: &[f64]| t.iter().sum::<f64>() / t.len() as f64;
    // Under load over a tooth period too, as the preload.
    let mut loaded_means = vec![mean(&loaded.tensions_n)];
    for phase in 1..PRELOAD_PHASES {
        let rest = rest_configuration(&model, drive, f64::from(phase) / f64::from(PRELOAD_PHASES))?;
        let unloaded = solve(&model, rest, 0.0, "tightening the loop")?;
        let loaded = solve(&model, unloaded.configuration, 1.0, "loading the drive")?;
        loaded_means.push(mean(&float_journals(drive, &model, loaded)?.tensions_n));
    }
    let axis = |preload: &PreloadSpec| match *preload {
        PreloadSpec::Sprocket { moves, .. } => {
            let (centre, sprocket) = (model.sprockets[moves].frame.origin, drive.sprockets[moves].name.clone());
            Some(MovedAxis { sprocket, x_m: centre.x, y_m: centre.y })
        }
        PreloadSpec::Arm(_) | PreloadSpec::Blade => None,
    };
    let moved = (0..drive.chains()).filter_map(|chain| axis(drive.preload_of(chain))).collect();
    let first = ChainPreload::of(String::new(), &tensions_n[0]);
    let preloads = drive.chain_names.iter().zip(&tensions_n).map(|(name, own)| ChainPreload::of(name.clone(), own));
    let preloads = if drive.chains() > 1 { preloads.collect() } else { Vec::new() };
    let report = AssemblyReport {
        moved,
        arms: resting_arms(&model, &loaded.configuration),
        sliders: resting_sliders(&model, &loaded.configuration),
        preload_n: first.mean_n,
        preload_low_n: first.low_n,
        preload_high_n: first.high_n,
        preloads,
        valves: drive.valves.iter().map(|spec| ValveReport::of(drive, spec)).collect(),
        spans: model.spans.iter().map(|s| SpanReport::of(s, &loaded.configuration)).collect(),
        static_mean_tension_n: mean(&loaded_means),
        static_max_tension_n: loaded.tensions_n.iter().copied().fold(0.0, f64::max),
        static_min_tension_n: loaded.tensions_n.iter().copied().fold(f64::INFINITY, f64::min),
        residual_n: loaded.residual_n,
        iterations: loaded.iterations,
        step_s: model.step_s,
        step_bound_s: bound.step_s,
        step_bound_cause: bound.cause,
        stillness,
        tension_drift,
    };
    Ok(Assembly { model: model.for_its_scheme(), state, report })
}

/// No chain at rest may run through a rail, nor lie loose under an arm whose spring turns it away.
fn check_rails(drive: &Drive, model: &Model, at: &Equilibrium) -> Result<(), AssemblyError> {
    let refuse = |path: String, title: String, help: &str| {
        Err(AssemblyError::Input(drive.places.report(vec![drive.places.error(&path, title, Some(help.into()))])))
    };
    for rail in &model.rails {
        let angle = rail.frame.angle_at(&at.configuration.coordinates);
        let origin = rail.frame.origin_at(&at.configuration.coordinates);
        let bent_m = rail.most_bent_m(&at.configuration.coordinates);
        for link in model.chain.loops[rail.chain].clone() {
            let (p, heading) = at.configuration.links[link];
            let (centre, along) = (rotated(p - origin, -angle), unit(heading - angle));
            let lever_m = model.chain.lever[link];
            if rail.box_distance_m(centre) > lever_m + rail.body.plate_radius_m + bent_m {
                continue;
            }
            // A plate is not deeper in a rail than contacts let it; whatever is, stands on its other side.
            let looks = (0..=AXIS_EVALUATIONS)
                .map(|i| centre + along * (lever_m * (2.0 * f64::from(i) / f64::from(AXIS_EVALUATIONS) - 1.0)));
            let nearest_m = looks.map(|q| rail.rail.profile.closest(q).distance_m.abs()).fold(f64::INFINITY, f64::min);
            if nearest_m < rail.body.plate_radius_m - DEEPEST_AT_REST_M - bent_m {
                let number = model.chain.number_of(link);
                return refuse(
                    format!("guides.rail.{}", rail.name),
                    format!(
                        "the chain runs through rail `{}`: link {number} lies {:.3} mm in it",
                        rail.name,
                        (rail.body.plate_radius_m - nearest_m) * 1e3
                    ),
                    "check its side, its place and its heading; or press it in less",
                );
            }
        }
    }
    let mut first = 0;
    for chain in 0..drive.chains() {
        let own = first..first + drive.link_bodies_of(chain);
        first = own.end;
        if drive.fidelity_of(chain) == ChainFidelity::Spans {
            continue;
        }
        let tension_n = at.tensions_n[own].iter().copied().fold(0.0, f64::max);
        if *drive.preload_of(chain) == PreloadSpec::Blade && tension_n < MIN_TENSION_N {
            let blade = model.rails.iter().find(|r| r.chain == chain && r.blade.is_some());
            return refuse(
                blade.map_or_else(|| "preload.moves".into(), |r| format!("guides.rail.{}.bending", r.name)),
                "the blade does not tighten the chain".into(),
                "give it `free_radii_mm` that are more curved than it is drawn",
            );
        }
        if let PreloadSpec::Arm(arm) = *drive.preload_of(chain)
            && tension_n < MIN_TENSION_N
        {
            let name = &drive.arms[arm].name;
            return refuse(
                format!("arms.{name}.spring_torque_nm"),
                format!("the spring of arm `{name}` does not tighten the chain"),
                "its torque is counterclockwise positive: turn its sign, or make it larger; or press it with a slider",
            );
        }
    }
    Ok(())
}

/// Places of a link's axis that are looked at.
const AXIS_EVALUATIONS: u32 = 16;
/// Deepest overlap of plate and rail that contacts give at rest [m]. assumed: kilonewtons on 1e7 N/m.
const DEEPEST_AT_REST_M: f64 = 0.3e-3;
/// A chain whose largest tension under load is less is not tightened [N].
const MIN_TENSION_N: f64 = 0.1;

/// The step asked for, or the bound's. The leapfrog is refused one above the bound, with the number that would do; other schemes one in
/// which the chain moves further than contacts are looked for, and what they cannot solve.
fn choose_step(drive: &Drive, model: &Model, bound: &StepBound) -> Result<f64, AssemblyError> {
    let would_do = default_step(bound);
    let refused = |path: &str, title: String, help: String| {
        Err(AssemblyError::Input(drive.places.report(vec![drive.places.error(path, title, Some(help))])))
    };
    if let Scheme::Hht { .. } | Scheme::Moreau { .. } = model.scheme
        && model.chain.has_rollers()
    {
        let title = "this `run.scheme` does not solve rollers that are bodies of their own".to_string();
        return refused(
            "run.scheme",
            title,
            "take `chain.bush.rollers.body` = \"link\", or another scheme".to_string(),
        );
    }
    let seats_bushes =
        model.sprockets.iter().any(|s| s.geometry.iso().is_some()) && model.chain.links().next().is_some();
    let lifts = model.touches.iter().any(|t| matches!(t.shape, TouchShape::Cam(_)));
    if let Scheme::Moreau { .. } = model.scheme
        && (model.has_films() || lifts)
    {
        let title = "`run.scheme` = \"moreau\" does not solve films of bearings and valves".to_string();
        return refused("run.scheme", title, "take another scheme".to_string());
    }
    if let Scheme::Moreau { .. } = model.scheme
        && !seats_bushes
        && model.touches.is_empty()
    {
        let title = "`run.scheme` = \"moreau\": no bush touches a tooth, and no part another one".to_string();
        return refused("run.scheme", title, "contours of links keep their laws; take another scheme".to_string());
    }
    let fastest_m_s = model.chain_speeds_m_s.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let farthest_s = (FARTHEST_STEP_M / fastest_m_s.max(1e-3)).min(LONGEST_STEP_S);
    match (drive.run.step_s, model.scheme) {
        (None, _) => Ok(would_do),
        (Some(step), Scheme::Leapfrog | Scheme::Moreau { .. }) if step <= bound.step_s => Ok(step),
        (Some(step), Scheme::Leapfrog | Scheme::Moreau { .. }) => {
            let title = format!("`run.step_us` = {} is too large for this drive", step * 1e6);
            let help = format!("{:.3} us would do; the bound comes from the {}", would_do * 1e6, bound.cause);
            refused("run.step_us", title, help)
        }
        (Some(step), _) if step <= farthest_s => Ok(step),
        (Some(step), _) => {
            let title = format!("`run.step_us` = {}: the chain moves too far in a step", step * 1e6);
            refused("run.step_us", title, format!("at most {:.1} us at this speed", farthest_s * 1e6))
        }
    }
}

/// Longest step of a scheme that bears any [s]: 2^-20 of it is still a moment to contacts.
const LONGEST_STEP_S: f64 = 2e-4;
/// Way of a chain in a step of a scheme that bears any [m]: contacts are looked for once, about where it may end.
const FARTHEST_STEP_M: f64 = 0.2 * WINDOW_MARGIN_M;

/// Displacement of the tightening sprocket at which the mean tension is the preload, and the tensions over the phases.
fn tighten(drive: &Drive, placed: &PlacedDrive) -> Result<(f64, Vec<f64>), AssemblyError> {
    let target = drive.preload.tension_n();
    let tensions_at = |shift: f64| -> Result<Vec<f64>, AssemblyError> {
        let mut model = Model::build(drive, placed, shift).map_err(AssemblyError::Input)?;
        model.add_bearings(drive);
        model.add_blades(drive);
        (0..PRELOAD_PHASES)
            .map(|phase| {
                let rest = rest_configuration(&model, drive, f64::from(phase) / f64::from(PRELOAD_PHASES))?;
                let found = solve(&model, rest.clone(), 0.0, "tightening the loop");
                let e = check_travel(drive, &model, rest, found)?;
                Ok(e.tensions_n.iter().sum::<f64>() / e.tensions_n.len() as f64)
            })
            .collect()
    };
    let mean = |t: &[f64]| t.iter().sum::<f64>() / t.len() as f64;
    let mut shift = 0.0;
    let mut tensions = tensions_at(shift)?;
    if let PreloadSpec::Arm(_) | PreloadSpec::Blade = drive.preload {
        return Ok((shift, tensions));
    }
    // Two spans become longer by the shift; the loop is links in series, its contacts soften it.
    let mut slope = drive.joint.stiffness_n_per_m / drive.links as f64;
    for _ in 0..40 {
        let error_n = mean(&tensions) - target;
        if error_n.abs() <= PRELOAD_TOLERANCE * target.max(1.0) {
            return Ok((shift, tensions));
        }
        let next = shift - (error_n / slope).clamp(-0.5e-3, 0.5e-3);
        let next_tensions = tensions_at(next)?;
        let measured = (mean(&next_tensions) - mean(&tensions)) / (next - shift);
        if measured > 0.0 {
            slope = measured;
        }
        (shift, tensions) = (next, next_tensions);
    }
    Err(AssemblyError::Statics {
        what: format!("the preload of {target} N is not reached (got {:.1} N)", mean(&tensions)),
        residual_n: (mean(&tensions) - target).abs(),
        iterations: 40,
    })
}

fn solve(model: &Model, start: Configuration, load: f64, what: &str) -> Result<Equilibrium, AssemblyError> {
    equilibrium(model, start, load).map_err(|e| AssemblyError::Statics {
        what: what.to_string(),
        residual_n: e.residual_n,
        iterations: e.iterations,
    })
}

/// All chains laid on their routes with pitches that close, the driver turned by `phase` of a tooth period. A chain on a shaft that one
/// before it turns is laid so that its teeth stand as that shaft does.
fn rest_configuration(model: &Model, drive: &Drive, phase: f64) -> Result<Configuration, AssemblyError> {
    let no_route = || AssemblyError::Statics { what: "no route".into(), residual_n: f64::NAN, iterations: 0 };
    let mut links = vec![(Vec2::new(FAR_AWAY_M, 0.0), 0.0); model.chain.lanes];
    let mut coordinates: Vec<Option<f64>> = vec![None; model.coordinates.len()];
    for arm in &model.arms {
        coordinates[arm.coordinate] = Some(arm.start_rad);
    }
    for (chain, own) in model.chain.loops.iter().enumerate() {
        let route = model.routes.get(chain).ok_or_else(no_route)?;
        let pitch_m = drive.chain_of(chain).pitch_m();
        if drive.fidelity_of(chain) == ChainFidelity::Spans {
            turn_by_spans(model, chain, phase * pitch_m, &mut coordinates);
            continue;
        }
        let sprockets = drive.sprockets_of(chain);
        let mut laid = lay_chain(route, own.len(), pitch_m, phase);
        let known = |k: &usize| coordinates[model.sprockets[*k].coordinate].is_some();
        if let Some(k) = sprockets.clone().find(known) {
            let s = &model.sprockets[k];
            let stands = coordinates[s.coordinate].unwrap_or(0.0);
            let tooth_rad = 2.0 * PI / f64::from(s.geometry.teeth());
            let sense = drive.sprockets[k].wrap.sign();
            let ahead = sense * (stands - laid.angles[k - sprockets.start]) / tooth_rad;
            laid = lay_chain(route, own.len(), pitch_m, phase + ahead - libm::floor(ahead));
        }
        for (pose, lane) in laid.links.into_iter().zip(own.clone()) {
            links[lane] = pose;
        }
        for (k, angle) in sprockets.zip(laid.angles) {
            coordinates[model.sprockets[k].coordinate].get_or_insert(angle);
        }
    }
    // Shafts behind couplings stand as what turns them.
    for _ in 0..model.couplings.len() {
        for c in &model.couplings {
            let [a, b] = c.ends;
            let stands = coordinates[a].or(coordinates[b]);
            (coordinates[a], coordinates[b]) = (coordinates[a].or(stands), coordinates[b].or(stands));
        }
    }
    let mut coordinates: Vec<f64> = coordinates.into_iter().map(|q| q.unwrap_or(0.0)).collect();
    place_tips(model, &mut coordinates);
    Ok(Configuration { links, coordinates })
}

/// Sprockets of a chain of spans turned by the same length of chain: that of the one that is known, or `travel_m`.
fn turn_by_spans(model: &Model, chain: usize, travel_m: f64, coordinates: &mut [Option<f64>]) {
    let ends = || model.spans.iter().filter(|s| s.chain == chain).map(|s| (s.ends[0], s.radii_m[0]));
    let known = ends().find_map(|(k, radius_m)| coordinates[k].map(|q| q * radius_m));
    let travel_m = known.unwrap_or(travel_m);
    for (k, radius_m) in ends() {
        coordinates[k].get_or_insert(travel_m / radius_m);
    }
}

/// A chain laid on its route: poses of its links, angles of its sprockets.
struct LaidChain {
    links: Vec<(Vec2, f64)>,
    angles: Vec<f64>,
}

fn lay_chain(route: &Route, n: usize, pitch_m: f64, phase: f64) -> LaidChain {
    let start = route.anchor_m() + phase * pitch_m;
    // Pitch at which n chords close the loop: secant on the overshoot.
    let joints_at = |pitch: f64| {
        let mut joints = Vec::with_capacity(n);
        let mut s = start;
        for _ in 0..n {
            joints.push(s);
            s = route.next_joint_m(s, pitch);
        }
        (joints, s - start - route.length_m())
    };
    let mut pitch = pitch_m;
    let (mut joints, mut overshoot_m) = joints_at(pitch);
    for _ in 0..20 {
        if overshoot_m.abs() < 1e-13 {
            break;
        }
        pitch -= overshoot_m / n as f64;
        (joints, overshoot_m) = joints_at(pitch);
    }
    let points: Vec<Vec2> = joints.iter().map(|s| route.at(*s).0).collect();
    let links = (0..n)
        .map(|i| {
            let (rear, front) = (points[(i + n - 1) % n], points[i]);
            let d = front - rear;
            ((front + rear) * 0.5, crate::units::atan2(d.y, d.x))
        })
        .collect();
    let angles = (0..route.sprockets())
        .map(|k| {
            // The joint nearest to the middle of the wrap sits in a gap.
            let middle = 0.5 * (route.wrap_start_m(k) + route.span_start_m(k));
            let total = route.length_m();
            let off = |s: f64| {
                let d = (s - middle) / total;
                ((d - libm::round(d)) * total).abs()
            };
            let seated = joints.iter().copied().min_by(|a, b| off(*a).total_cmp(&off(*b))).unwrap_or(middle);
            route.angle_about(k, seated)
        })
        .collect();
    LaidChain { links, angles }
}

/// Rate at which links are drawn to the chain speed [1/s]: half critical for transverse modes of some 100 Hz.
const LINK_RATE_PER_S: f64 = 600.0;
/// Rate at which free sprockets are drawn to their speed [1/s]: half critical for a torsional mode of some 240 Hz.
const ROTOR_RATE_PER_S: f64 = 1500.0;

/// Runs in and settles; returns stillness per free sprocket and drift of the mean tension. Sets the clock to zero.
fn run_in(drive: &Drive, model: &Model, state: &mut State, isa: Isa) -> Result<(Vec<f64>, f64), StepError> {
    let mut scratch = Scratch::with_isa(model, isa);
    let h = model.step_s;
    let (damped, settle) = run_in_steps(drive, h);
    let steps_before = damped + settle;
    for i in 0..damped {
        // Fades out with zero slope, so that its end does not ring.
        let left = 1.0 - i as f64 / damped as f64;
        let fade = left * left * (3.0 - 2.0 * left);
        scratch.run_in =
            RunIn { link_rate_per_s: LINK_RATE_PER_S * fade, rotor_rate_per_s: ROTOR_RATE_PER_S * fade, steps_before };
        explicit::step(model, state, &mut scratch)?;
    }
    scratch.run_in = RunIn { steps_before, ..RunIn::OFF };
    let mut watch = SteadinessMonitor::new(model);
    for _ in 0..settle {
        explicit::step(model, state, &mut scratch)?;
        watch.observe(model, state, &scratch);
    }
    state.step = 0;
    state.clear_ledger();
    // Angles are counted from the start of the recording; cosine and sine stay as they are.
    wrap_angles(model, &mut state.coordinates.angle);
    Ok(watch.result(model))
}

/// Averages speeds and tension over tooth periods of the driver.
struct SteadinessMonitor {
    steps_per_tooth: f64,
    seen: u64,
    sums: Vec<f64>,
    tension: f64,
    means: Vec<Vec<f64>>,
    tension_means: Vec<f64>,
    count: u64,
}

impl SteadinessMonitor {
    fn new(model: &Model) -> SteadinessMonitor {
        let driver = &model.sprockets[model.driver];
        let period = 2.0 * PI / (driver.nominal_speed_rad_s.abs() * f64::from(driver.geometry.teeth()));
        SteadinessMonitor {
            steps_per_tooth: period / model.step_s,
            seen: 0,
            sums: vec![0.0; model.sprockets.len()],
            tension: 0.0,
            means: vec![Vec::new(); model.sprockets.len()],
            tension_means: Vec::new(),
            count: 0,
        }
    }

    fn observe(&mut self, model: &Model, state: &State, scratch: &Scratch) {
        for (sum, sprocket) in self.sums.iter_mut().zip(&model.sprockets) {
            *sum += state.coordinates.omega[sprocket.coordinate];
        }
        let forces = model.chain.links().map(|j| scratch.joint_force(j));
        self.tension += forces.map(|(x, y, _)| libm::hypot(x, y)).sum::<f64>() / model.chain.n_links as f64;
        self.seen += 1;
        self.count += 1;
        if self.seen as f64 >= (self.tension_means.len() + 1) as f64 * self.steps_per_tooth {
            for (mean, sum) in self.means.iter_mut().zip(&mut self.sums) {
                mean.push(*sum / self.count as f64);
                *sum = 0.0;
            }
            self.tension_means.push(self.tension / self.count as f64);
            self.tension = 0.0;
            self.count = 0;
        }
    }

    fn result(&self, model: &Model) -> (Vec<f64>, f64) {
        let spread = |values: &[f64]| {
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            if values.is_empty() { 0.0 } else { high - low }
        };
        let stillness = model
            .sprockets
            .iter()
            .zip(&self.means)
            .filter(|(s, _)| model.coordinates[s.coordinate].is_free() && s.nominal_speed_rad_s != 0.0)
            .map(|(s, means)| spread(means) / s.nominal_speed_rad_s.abs())
            .collect();
        let mean = self.tension_means.iter().sum::<f64>() / self.tension_means.len().max(1) as f64;
        (stillness, if mean > 0.0 { spread(&self.tension_means) / mean } else { 0.0 })
    }
}
