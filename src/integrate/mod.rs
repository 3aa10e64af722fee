//! Time integration: an explicit scheme, its step rule, and the kernels for each vector unit; other schemes to compare it with.

mod cyclic_blocks;
pub mod explicit;
mod implicit;
mod instant;
mod link_row;
mod predictor;
mod rigid;
pub mod scheme;
pub mod step_bound;

/// Which instructions the kernels are compiled for. All give the same bits: no fused multiply-add, no approximate
/// reciprocals, sums in a fixed order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Isa {
    /// What every x86-64 has; the only path elsewhere.
    Baseline,
    Avx2,
    Avx512,
}

impl Isa {
    /// The widest one that this machine has.
    pub fn detect() -> Isa {
        Isa::available().pop().unwrap_or(Isa::Baseline)
    }

    /// All that this machine has, narrowest first.
    pub fn available() -> Vec<Isa> {
        #[cfg(target_arch = "x86_64")]
        {
            let mut found = vec![Isa::Baseline];
            if std::is_x86_feature_detected!("avx2") {
                found.push(Isa::Avx2);
            }
            if std::is_x86_feature_detected!("avx512f")
                && std::is_x86_feature_detected!("avx512vl")
                && std::is_x86_feature_detected!("avx512dq")
            {
                found.push(Isa::Avx512);
            }
            found
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            vec![Isa::Baseline]
        }
    }
}

/// Loops over columns, run in every step.
pub trait VectorKernel {
    type Output;
    /// To be marked `inline(always)`: what a vector unit runs is compiled with all that is inlined here. (A closure or a function
    /// passed as a value may be left outside, and then takes four times as long.)
    fn run(self) -> Self::Output;
}

/// Runs a kernel that is compiled for a vector unit.
#[inline(always)]
pub fn vectorised<L: VectorKernel>(isa: Isa, of: L) -> L::Output {
    match isa {
        Isa::Baseline => of.run(),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the variants other than Baseline are only made where the machine has the features (Isa::available).
        Isa::Avx2 => unsafe { with_avx2(of) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        Isa::Avx512 => unsafe { with_avx512(of) },
        #[cfg(not(target_arch = "x86_64"))]
        _ => of.run(),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<L: VectorKernel>(of: L) -> L::Output {
    of.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq")]
fn with_avx512<L: VectorKernel>(of: L) -> L::Output {
    of.run()
}

/// A run that cannot go on: where and when. The State is left as it was before the step.
#[derive(Clone, Debug, PartialEq)]
pub struct StepError {
    pub t_s: f64,
    /// e.g. `link 12` or `joint 3`.
    pub element: String,
    pub kind: StepErrorKind,
}

/// What went wrong.
#[derive(Clone, Debug, PartialEq)]
pub enum StepErrorKind {
    /// A value is no finite number.
    NotFinite,
    /// A joint has come apart by this much [m].
    Torn { stretch_m: f64 },
    /// A step of the scheme has no solution; what its last try leaves of speeds [m/s].
    Unsolved { residual_m_s: f64 },
    /// Journal and bore of a plain bearing touch: what is left of the film [m].
    FilmBroken { film_m: f64 },
}

impl std::fmt::Display for StepError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the run broke down at t = {:.6} ms in {}: ", self.t_s * 1e3, self.element)?;
        match self.kind {
            StepErrorKind::NotFinite => write!(f, "a value is no finite number")?,
            StepErrorKind::Torn { stretch_m } => write!(f, "the joint is stretched by {:.3} mm", stretch_m * 1e3)?,
            StepErrorKind::Unsolved { residual_m_s } => {
                return write!(
                    f,
                    "its step has no solution, {:.3} um/s are left; try a smaller step (run.step_us), or a contact law whose force begins \
                     at zero",
                    residual_m_s * 1e6
                );
            }
            StepErrorKind::FilmBroken { film_m } => {
                return write!(
                    f,
                    "its film is {:.3} um thin, and the model has no contact of journal and bore; make the bearing longer or its \
                     clearance smaller, take a thicker oil, or lower the load",
                    film_m * 1e6
                );
            }
        }
        write!(
            f,
            "; look at the frames before it, and try a smaller step (run.step_us) or less extreme contact parameters"
        )
    }
}

impl std::error::Error for StepError {}
