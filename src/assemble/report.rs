//! What assembling found, and why a drive could not be assembled.

use crate::diag::Report;
use crate::drive::Drive;
use crate::drive::valves::ValveSpec;
use crate::elements::span::ChainSpan;
use crate::integrate::StepError;
use crate::statics::Configuration;
use crate::units::RPM;

/// What assembling found.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct AssemblyReport {
    /// The tightening sprockets of all chains; none of those that an arm tightens.
    pub moved: Vec<MovedAxis>,
    /// Arms under load at rest.
    pub arms: Vec<RestingArm>,
    /// Sliders likewise.
    pub sliders: Vec<RestingSlider>,
    /// Mean tension of the first chain at rest, unloaded, over one tooth period [N]; its lowest and highest value there.
    pub preload_n: f64,
    /// Lowest mean tension over one tooth period [N].
    pub preload_low_n: f64,
    /// Highest mean tension over one tooth period [N].
    pub preload_high_n: f64,
    /// The same of every chain of a drive that has several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub preloads: Vec<ChainPreload>,
    /// Springs of valves.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub valves: Vec<ValveReport>,
    /// Spans of chains without links.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub spans: Vec<SpanReport>,
    /// Tension of the loaded loop at rest [N]: mean over a tooth period; highest and lowest joint at its start.
    pub static_mean_tension_n: f64,
    /// Highest tension of a joint [N].
    pub static_max_tension_n: f64,
    /// Lowest tension of a joint [N].
    pub static_min_tension_n: f64,
    /// Largest unbalanced force of the static solution [N], and its iterations.
    pub residual_n: f64,
    /// Newton iterations of the static solution.
    pub iterations: usize,
    /// Step taken, largest allowed, and what bounds it.
    pub step_s: f64,
    /// Largest step that the scheme bears [s].
    pub step_bound_s: f64,
    /// What bounds the step, in words.
    pub step_bound_cause: String,
    /// Per free sprocket: peak-to-peak of the speed averaged over tooth periods, relative to nominal, while settling.
    pub stillness: Vec<f64>,
    /// Slowest over the last half of settling: drift of the mean tension of the loop, relative.
    pub tension_drift: f64,
}

/// How fast the springs of valves let their cams turn.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ValveReport {
    /// Name of the valves.
    pub valves: String,
    /// The sprocket that turns their cams.
    pub shaft: String,
    /// Nominal speed of the cams [rad/s].
    pub speed_rad_s: f64,
    /// Speed from which a rigid follower leaves its cam [rad/s]; None: at any speed it stays.
    pub floats_at_rad_s: Option<f64>,
}

impl ValveReport {
    pub(super) fn of(drive: &Drive, spec: &ValveSpec) -> ValveReport {
        let floats_at_rad_s = Some(spec.with_effects(&drive.effects).floats_at_rad_s()).filter(|w| w.is_finite());
        let (sprocket, speed_rad_s) = (&drive.sprockets[spec.sprocket], drive.nominal_speed_rad_s(spec.sprocket).abs());
        ValveReport { valves: spec.name.clone(), shaft: sprocket.name.clone(), speed_rad_s, floats_at_rad_s }
    }

    fn line(&self) -> String {
        let cam = format!("`{}` turns at {:.0} 1/min", self.shaft, self.speed_rad_s / RPM);
        match self.floats_at_rad_s {
            Some(w) => {
                format!("valves {} = on their cams, as rigid parts, below {:.0} 1/min; {cam}", self.valves, w / RPM)
            }
            None => format!("valves {} = on their cams at any speed; {cam}", self.valves),
        }
    }
}

/// A span of a chain without links.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct SpanReport {
    /// `chains.NAME.spans.FROM-TO`.
    pub span: String,
    /// Length of the straight span [m].
    pub length_m: f64,
    /// Stiffness [N/m].
    pub stiffness_n_per_m: f64,
    /// Damping [N s/m].
    pub damping_n_s_per_m: f64,
    /// Tension under load at rest [N].
    pub static_tension_n: f64,
}

/// Axis of a sprocket that was moved [m].
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MovedAxis {
    /// Name of the sprocket.
    pub sprocket: String,
    /// x of its axis [m].
    pub x_m: f64,
    /// y of its axis [m].
    pub y_m: f64,
}

/// Where an arm rests, from the position in which it is drawn [rad], and the torque of its spring there [N m].
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RestingArm {
    /// Name of the arm.
    pub arm: String,
    /// Angle from where it is drawn, counterclockwise positive [rad].
    pub angle_rad: f64,
    /// Torque of its spring on it there [N m].
    pub spring_torque_nm: f64,
    /// The stop that it rests on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop: Option<RestingStop>,
}

/// A stop that bears what rests on it.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RestingStop {
    /// Key of the stop in the drive file.
    pub key: String,
    /// Force that it bears [N].
    pub force_n: f64,
    /// How far beyond it what rests on it would stand without it [m]; at an arm, where the stop is. None: there is no rest without it.
    pub beyond_m: Option<f64>,
}

impl RestingStop {
    /// What a line of a report says of it; nothing where nothing rests on a stop.
    fn words(stop: &Option<RestingStop>) -> String {
        let Some(RestingStop { key, force_n, beyond_m }) = stop else { return String::new() };
        let beyond = beyond_m.map_or(String::new(), |m| format!(", and would stand {:.3} mm beyond it", m * 1e3));
        format!("; it rests on its stop `{key}` with {force_n:.2} N{beyond}")
    }
}

/// Where a slider rests, from where it is drawn [m], and the force of its tip there [N].
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RestingSlider {
    /// Name of the slider.
    pub slider: String,
    /// Distance from where it is drawn, outwards positive [m].
    pub position_m: f64,
    /// Force with which its tip presses [N].
    pub tip_force_n: f64,
    /// The stop that it rests on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop: Option<RestingStop>,
}

/// Mean tension of a chain at rest, unloaded, over one tooth period [N], and its lowest and highest value there.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ChainPreload {
    /// Name of the chain.
    pub chain: String,
    /// Mean over the tooth period [N].
    pub mean_n: f64,
    /// Lowest value [N].
    pub low_n: f64,
    /// Highest value [N].
    pub high_n: f64,
}

impl ChainPreload {
    pub(super) fn of(chain: String, tensions_n: &[f64]) -> ChainPreload {
        ChainPreload {
            chain,
            mean_n: tensions_n.iter().sum::<f64>() / tensions_n.len() as f64,
            low_n: tensions_n.iter().copied().fold(f64::INFINITY, f64::min),
            high_n: tensions_n.iter().copied().fold(0.0, f64::max),
        }
    }

    /// Its line of a report.
    fn line(&self) -> String {
        let of = if self.chain.is_empty() { String::new() } else { format!("of chain {} ", self.chain) };
        let ChainPreload { mean_n, low_n, high_n, .. } = self;
        format!("preload {of}at rest = {mean_n:.1} N (mean of a tooth period, {low_n:.1} to {high_n:.1} N)")
    }
}

impl SpanReport {
    pub(super) fn of(span: &ChainSpan, at: &Configuration) -> SpanReport {
        SpanReport {
            span: span.path.clone(),
            length_m: span.length_m,
            stiffness_n_per_m: span.stiffness_n_per_m,
            damping_n_s_per_m: span.damping_n_s_per_m,
            static_tension_n: span.spring_n(span.elongation(span.ends.map(|k| at.coordinates[k]))),
        }
    }
}

impl AssemblyReport {
    /// `key = value unit`, for people and for the header of recordings.
    pub fn lines(&self) -> Vec<String> {
        let axis = |m: &MovedAxis| format!("axis of {} = ({:.4}, {:.4}) mm", m.sprocket, m.x_m * 1e3, m.y_m * 1e3);
        let mut lines: Vec<String> = self.moved.iter().map(axis).collect();
        lines.extend(self.arms.iter().map(|a| {
            let degrees = a.angle_rad.to_degrees();
            let spring = match a.spring_torque_nm {
                0.0 => String::new(),
                torque => format!(", its spring {torque:.4} N m"),
            };
            format!("arm {} = {degrees:.4} deg from its drawn position{spring}{}", a.arm, RestingStop::words(&a.stop))
        }));
        lines.extend(self.sliders.iter().map(|s| {
            let (mm, force) = (s.position_m * 1e3, s.tip_force_n);
            let stop = RestingStop::words(&s.stop);
            format!("slider {} = {mm:.4} mm from its drawn position, its tip {force:.2} N{stop}", s.slider)
        }));
        let first = || ChainPreload {
            chain: String::new(),
            mean_n: self.preload_n,
            low_n: self.preload_low_n,
            high_n: self.preload_high_n,
        };
        match self.preloads.as_slice() {
            [] => lines.push(first().line()),
            several => lines.extend(several.iter().map(ChainPreload::line)),
        }
        lines.extend(self.valves.iter().map(ValveReport::line));
        lines.extend(self.spans.iter().map(|s| {
            let (mm, tension_n) = (s.length_m * 1e3, s.static_tension_n);
            let (stiffness, damping) = (s.stiffness_n_per_m, s.damping_n_s_per_m);
            format!("{} = {tension_n:.1} N under load; {mm:.3} mm, {stiffness:.4e} N/m, {damping:.3} N s/m", s.span)
        }));
        lines.extend([
            format!(
                "static tension under load = {:.1} N (mean; {:.1} to {:.1} N)",
                self.static_mean_tension_n, self.static_min_tension_n, self.static_max_tension_n
            ),
            format!("static residual = {:.1e} N after {} iterations", self.residual_n, self.iterations),
            format!(
                "step = {:.3} us (bound {:.3} us: {})",
                self.step_s * 1e6,
                self.step_bound_s * 1e6,
                self.step_bound_cause
            ),
        ]);
        for still in &self.stillness {
            lines.push(format!(
                "stillness after run-in = {:.4} % of the free sprocket's speed, peak to peak",
                still * 100.0
            ));
        }
        lines.push(format!("drift of the mean tension while settling = {:.2} %", self.tension_drift * 100.0));
        lines
    }
}

/// Why a drive could not be assembled.
#[derive(Debug)]
pub enum AssemblyError {
    /// The drive's mistake: points into the file.
    Input(Report),
    /// No equilibrium.
    Statics {
        /// Which chain or arm.
        what: String,
        /// Largest unbalanced force that remained [N].
        residual_n: f64,
        /// Newton iterations until then.
        iterations: usize,
    },
    /// Broke down while running in.
    RunIn(StepError),
}

impl std::fmt::Display for AssemblyError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            AssemblyError::Input(report) => write!(f, "{report}"),
            AssemblyError::Statics { what, residual_n, iterations } => write!(
                f,
                "{what}: no static equilibrium (residual {residual_n:.3e} N after {iterations} iterations)\n\
                 help: raise the preload (`preload.tension_n`, or the arm's spring), lower the load, or check that teeth and rails can \
                 carry the chain where they stand"
            ),
            AssemblyError::RunIn(e) => write!(f, "while running in: {e}"),
        }
    }
}

impl std::error::Error for AssemblyError {}
