//! The claims of four papers on timing chains, each held against drives like theirs: what was run, what it gave, and whether the claim stands.
//!
//! The papers' figures are lost and they print few numbers, so that the drives hold many assumed ones: a trend that is reproduced says that a drive like
//! the paper's does so. A claim may not be tuned into place: numbers that were chosen to meet one claim stand in the drive file as such, and that claim
//! does not count as a test.

mod cali;
pub mod facts;
mod fritz;
pub mod laboratory;
mod lin;
pub mod probes;
mod schaffner;
mod schaffner_engine;

use laboratory::{ClaimTrial, Laboratory, Unanswered};
use serde::Serialize;

/// A paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Paper {
    Cali,
    Schaffner,
    Fritz,
    Lin,
}

impl Paper {
    pub const ALL: [Paper; 4] = [Paper::Cali, Paper::Schaffner, Paper::Fritz, Paper::Lin];

    /// By which it is chosen.
    pub fn name(self) -> &'static str {
        match self {
            Paper::Cali => "cali",
            Paper::Schaffner => "schaffner",
            Paper::Fritz => "fritz",
            Paper::Lin => "lin",
        }
    }

    pub fn title(self) -> &'static str {
        match self {
            Paper::Cali => {
                "Calì, Sequenzia, Oliveri, Fatuzzo: timing drive of a V12 engine, silent and roller chains, meshing angles"
            }
            Paper::Schaffner => {
                "Schaffner, Sopouch, Priebsch: bush, silent and abutment chains in a three-cylinder engine"
            }
            Paper::Fritz => "Fritz, Kell, Pfeiffer: roller chain of a four-cylinder engine, forces of a link",
            Paper::Lin => "Lin, Hwang: silent chain of a V6 engine with a hydraulic tensioner",
        }
    }
}

/// What became of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum ClaimVerdict {
    /// The number is met.
    Reproduced,
    /// Its sign or its order is met; its size is not printed, or hangs on assumed numbers.
    Trend,
    NotReproduced,
    /// The paper's own numbers exclude each other.
    ContradictsItself,
    /// Something is missing that the check needs.
    NotCheckable,
}

impl ClaimVerdict {
    pub const ALL: [ClaimVerdict; 5] = [
        ClaimVerdict::Reproduced,
        ClaimVerdict::Trend,
        ClaimVerdict::NotReproduced,
        ClaimVerdict::ContradictsItself,
        ClaimVerdict::NotCheckable,
    ];

    pub fn name(self) -> &'static str {
        match self {
            ClaimVerdict::Reproduced => "reproduced",
            ClaimVerdict::Trend => "trend reproduced",
            ClaimVerdict::NotReproduced => "not reproduced",
            ClaimVerdict::ContradictsItself => "contradicts itself",
            ClaimVerdict::NotCheckable => "not checkable",
        }
    }

    /// A trend that holds or does not.
    fn trend(holds: bool) -> ClaimVerdict {
        if holds { ClaimVerdict::Trend } else { ClaimVerdict::NotReproduced }
    }

    /// A number that is met or not.
    fn number(holds: bool) -> ClaimVerdict {
        if holds { ClaimVerdict::Reproduced } else { ClaimVerdict::NotReproduced }
    }
}

/// A curve of a picture.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlottedCurve {
    pub name: String,
    pub points: Vec<(f64, f64)>,
}

/// A picture: curves over one axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plot {
    pub x: String,
    pub y: String,
    pub curves: Vec<PlottedCurve>,
}

/// What was found about a claim.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClaimAnswer {
    pub verdict: ClaimVerdict,
    /// What was measured, with numbers and units.
    pub measured: String,
    /// How it was judged, or why it is not reproduced, or what is missing.
    pub why: String,
    pub plot: Option<Plot>,
}

impl ClaimAnswer {
    fn new(verdict: ClaimVerdict, measured: impl Into<String>, why: impl Into<String>) -> ClaimAnswer {
        ClaimAnswer { verdict, measured: measured.into(), why: why.into(), plot: None }
    }

    /// What stands behind the rule where it is not met.
    fn because(mut self, reason: &str) -> ClaimAnswer {
        if matches!(self.verdict, ClaimVerdict::NotReproduced) {
            self.why = format!("{}. {reason}", self.why);
        }
        self
    }

    fn with_plot(mut self, x: &str, y: &str, curves: Vec<(&str, Vec<(f64, f64)>)>) -> ClaimAnswer {
        let curves = curves.into_iter().map(|(name, points)| PlottedCurve { name: name.into(), points }).collect();
        self.plot = Some(Plot { x: x.into(), y: y.into(), curves });
        self
    }
}

/// How a claim is answered.
type Experiment = fn(&Laboratory) -> Result<ClaimAnswer, Unanswered>;

/// A claim of a paper.
pub struct PaperClaim {
    /// A letter for the paper, and a number.
    pub id: &'static str,
    pub paper: Paper,
    /// What is claimed, with its numbers.
    pub claim: &'static str,
    experiment: Experiment,
}

/// All claims, paper by paper.
pub fn claims() -> Vec<PaperClaim> {
    let of = |paper: Paper, rows: &[(&'static str, &'static str, Experiment)]| -> Vec<PaperClaim> {
        rows.iter().map(|(id, claim, experiment)| PaperClaim { id, paper, claim, experiment: *experiment }).collect()
    };
    let mut all = of(Paper::Cali, &cali::CLAIMS);
    all.extend(of(Paper::Schaffner, &schaffner_engine::CLAIMS));
    all.extend(of(Paper::Schaffner, &schaffner::CLAIMS));
    all.extend(of(Paper::Fritz, &fritz::CLAIMS));
    all.extend(of(Paper::Lin, &lin::CLAIMS));
    all
}

/// A claim with its answer.
#[derive(Clone, Debug, Serialize)]
pub struct AnsweredClaim {
    pub id: &'static str,
    pub paper: Paper,
    pub claim: &'static str,
    #[serde(flatten)]
    pub answer: ClaimAnswer,
    /// What it was answered by, as commands of pitchline; the first of them.
    pub ran: Vec<String>,
    /// How many trials there were.
    pub trials: usize,
    /// A trial broke down, so that the claim could not be judged.
    pub is_broken: bool,
}

/// Commands that are printed of a claim.
const COMMANDS: usize = 3;

impl PaperClaim {
    /// Its answer, or None while trials are missing: the laboratory then wants them.
    pub fn answer(&self, lab: &Laboratory) -> Option<AnsweredClaim> {
        let _earlier = lab.take_asked();
        let mut is_broken = false;
        let answer = match (self.experiment)(lab) {
            Ok(mut answer) => {
                let words = answer.measured.split(|c: char| !c.is_alphanumeric());
                if words.into_iter().any(|word| word == "NaN" || word == "inf") {
                    answer.verdict = ClaimVerdict::NotCheckable;
                    answer.why += "; a number could not be measured";
                }
                answer
            }
            Err(Unanswered::Waiting) => return None,
            Err(Unanswered::Broken(why)) => {
                is_broken = true;
                ClaimAnswer::new(ClaimVerdict::NotCheckable, "a run broke down", why)
            }
        };
        let asked = lab.take_asked();
        let ran = asked.iter().take(COMMANDS).map(ClaimTrial::command).collect();
        Some(AnsweredClaim {
            id: self.id,
            paper: self.paper,
            claim: self.claim,
            answer,
            ran,
            trials: asked.len(),
            is_broken,
        })
    }
}

/// Numbers as text, `a, b, c`.
fn list(values: &[f64], digits: usize) -> String {
    values.iter().map(|v| format!("{v:.digits$}")).collect::<Vec<_>>().join(", ")
}

/// Where a curve is largest inside of its ends: x, with a parabola through the largest point and its neighbours; NaN where it is largest at an end. And
/// how large.
fn peak_of(points: &[(f64, f64)]) -> (f64, f64) {
    let points: Vec<(f64, f64)> = points.iter().copied().filter(|p| p.0.is_finite() && p.1.is_finite()).collect();
    let Some(top) = (0..points.len()).max_by(|a, b| points[*a].1.total_cmp(&points[*b].1)) else {
        return (f64::NAN, f64::NAN);
    };
    if top == 0 || top + 1 == points.len() {
        return (f64::NAN, points[top].1);
    }
    let [(x0, y0), (x1, y1), (x2, y2)] = [points[top - 1], points[top], points[top + 1]];
    let (d0, d2) = ((y1 - y0) / (x1 - x0), (y2 - y1) / (x2 - x1));
    if d0 - d2 <= 0.0 {
        return points[top];
    }
    // The slope falls linearly between the middles of the two intervals.
    let (m0, m2) = (0.5 * (x0 + x1), 0.5 * (x1 + x2));
    (m0 + d0 / (d0 - d2) * (m2 - m0), y1)
}

/// A place of [`peak_of`] as text.
fn place(x: f64, unit: &str) -> String {
    if x.is_finite() { format!("{x:.0} {unit}") } else { "an end of the sweep".into() }
}

/// The smallest; NaN where one is none.
fn least(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(f64::INFINITY, |low, v| if low.is_nan() || !v.is_finite() { f64::NAN } else { low.min(v) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_claim_is_there_once() {
        let all = claims();
        assert_eq!(all.len(), 73);
        for (paper, letter, count) in
            [(Paper::Cali, 'C', 27), (Paper::Schaffner, 'S', 28), (Paper::Fritz, 'F', 10), (Paper::Lin, 'L', 8)]
        {
            for number in 1..=count {
                let id = format!("{letter}{number:02}");
                assert_eq!(all.iter().filter(|c| c.id == id && c.paper == paper).count(), 1, "{id}");
            }
        }
    }

    #[test]
    fn peak_of_a_parabola_is_its_top() {
        let points: Vec<(f64, f64)> = [0.0, 1.0, 2.5, 3.0].iter().map(|x| (*x, -(x - 1.8) * (x - 1.8))).collect();
        assert!((peak_of(&points).0 - 1.8).abs() < 1e-12);
    }
}
