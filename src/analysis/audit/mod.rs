//! What a recording itself says of every part of its drive: measured from poses, forces and accelerations in the frames.
//!
//! Two passes over the frames. The first finds mass, moment of inertia and arms of every link from the balance on it; the second, with these
//! arms, joints, tooth gaps, guides and spans. Nothing is read from the drive's text. What the header declares is only compared with.
//! A number of a part is a [`Measured`]; what is measured of which part is a row of [`measures`].

mod contours;
pub mod findings;
pub mod gaps;
pub mod guides;
pub mod least_squares;
pub mod links;
pub mod measures;
pub mod spans;

use crate::recording::frame::{Frame, Header};
use crate::recording::reader::{Entry, Flow, Reader, WHOLE, Wanted};
use gaps::{GapPass, SprocketFit};
use guides::{GuideFit, GuidePass};
use least_squares::{NormalEquations, Solution};
use links::{JointFit, JointPass, LinkFit, LinkSums};
use spans::{SpanFit, SpanPass};
use std::ops::Range;

pub use findings::{Finding, compared, findings};
pub use measures::{AuditPart, Measured, measured};

/// Most frames that are looked at; of longer recordings every second, third and so on.
const MOST_FRAMES: u64 = 20_000;

/// A measured number.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Estimate {
    pub value: f64,
    /// Standard error of the fit.
    pub error: f64,
    /// Frames, or contacts in frames, from which it comes.
    pub samples: usize,
}

/// Contacts from which a contact law is told, and the largest share of a stiffness that its error may be.
const CONTACTS: usize = 20;
const LAW_ERROR: f64 = 0.1;

/// Sums over contacts for two laws: a constant damper beside the spring, k d + c d', and one that grows with the load, k d (1 + chi d').
#[derive(Clone, Debug, Default)]
pub struct ContactLawSums {
    constant: NormalEquations<2>,
    growing: NormalEquations<2>,
}

/// The law that fits the contacts better.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactLawFit {
    /// k
    pub stiffness_n_per_m: Option<Estimate>,
    /// c; None where the damper grows.
    pub damping_n_s_per_m: Option<Estimate>,
    /// chi; None where the damper is constant.
    pub load_damping_s_per_m: Option<Estimate>,
}

impl ContactLawSums {
    pub fn add(&mut self, depth_m: f64, closing_m_s: f64, force_n: f64) {
        self.constant.add([depth_m, closing_m_s], force_n);
        self.growing.add([depth_m, depth_m * closing_m_s], force_n);
    }

    pub fn samples(&self) -> usize {
        self.constant.samples
    }

    /// Nothing where the contacts do not tell, or seem to give energy.
    pub fn fit(&self) -> ContactLawFit {
        let of = |sums: &NormalEquations<2>| {
            let law = sums.solve(0.0).filter(|l| sums.samples >= CONTACTS && l.error[0] < LAW_ERROR * l.value[0]);
            law.filter(|l| l.value[1] > -2.0 * l.error[1])
        };
        let (constant, growing) = (of(&self.constant), of(&self.growing));
        let grows = growing.is_some_and(|g| constant.is_none_or(|c| g.residual < c.residual));
        let estimate = |law: Option<Solution<2>>, i: usize| law.map(|l| Estimate::of(&l, i, self.samples()));
        if !grows {
            let (stiffness_n_per_m, damping_n_s_per_m) = (estimate(constant, 0), estimate(constant, 1));
            return ContactLawFit { stiffness_n_per_m, damping_n_s_per_m, load_damping_s_per_m: None };
        }
        let per_stiffness = growing.map(|l| {
            let [k, both] = l.value;
            let error = libm::hypot(l.error[1] / k, both * l.error[0] / (k * k));
            Estimate { value: both / k, error, samples: self.samples() }
        });
        ContactLawFit {
            stiffness_n_per_m: estimate(growing, 0),
            damping_n_s_per_m: None,
            load_damping_s_per_m: per_stiffness,
        }
    }
}

impl Estimate {
    fn of<const N: usize>(solution: &Solution<N>, i: usize, samples: usize) -> Estimate {
        Estimate { value: solution.value[i], error: solution.error[i], samples }
    }
}

/// How links hang together, from the header.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Topology {
    /// Link ahead and link behind.
    pub ahead: Vec<usize>,
    pub behind: Vec<usize>,
    /// Links of one row are alike: their outline in the header.
    pub row: Vec<u32>,
    /// Chain of every link.
    pub chain: Vec<usize>,
    /// Mean pitch that the header declares of every chain: it tells which joints lie near a sprocket [m].
    pub pitch_m: Vec<f64>,
    /// Whether the first chain runs towards the link ahead.
    pub forwards: bool,
    /// The link whose bush carries each roller, and whether at its front.
    pub rollers: Vec<(usize, bool)>,
}

impl Topology {
    pub fn of(header: &Header) -> Topology {
        let n = header.links.len();
        let ahead: Vec<usize> = header.links.iter().map(|l| (l.ahead as usize).min(n.saturating_sub(1))).collect();
        let mut behind = vec![0; n];
        ahead.iter().enumerate().for_each(|(i, to)| behind[*to] = i);
        let chains = header.chains();
        let pitch_m = |links: &Range<usize>| header.links[links.clone()].iter().map(|l| l.pitch_m).sum::<f64>();
        let mean_m = |links: Range<usize>| pitch_m(&links) / links.len().max(1) as f64;
        Topology {
            ahead,
            behind,
            row: header.links.iter().map(|l| l.outline).collect(),
            chain: chains.iter().enumerate().flat_map(|(k, links)| links.clone().map(move |_| k)).collect(),
            pitch_m: chains.into_iter().map(mean_m).collect(),
            forwards: header.chain_speed_m_s >= 0.0,
            rollers: header.rollers.iter().map(|r| (r.link as usize, r.link == r.joint)).collect(),
        }
    }
}

/// All that the frames of a recording tell.
#[derive(Clone, Debug, Default)]
pub struct Audit {
    /// Frames that were looked at, of all; from the first to the last [s].
    pub frames: u64,
    pub every: u64,
    pub from_s: f64,
    pub to_s: f64,
    /// Between two frames that were looked at [s].
    pub interval_s: f64,
    pub links: Vec<LinkFit>,
    pub joints: Vec<JointFit>,
    pub sprockets: Vec<SprocketFit>,
    pub guides: Vec<GuideFit>,
    pub spans: SpanFit,
    /// What could not be measured, with what it takes.
    pub lacking: Vec<String>,
}

/// Why a recording cannot be audited.
#[derive(Clone, Debug, PartialEq)]
pub enum AuditError {
    /// Frames that there are, and needed.
    Short { frames: u64, needed: u64 },
    /// It holds no forces.
    Forceless,
}

/// Fewest frames: three unknowns of a link want more equations than unknowns.
const FEWEST_FRAMES: u64 = 12;

/// Audits a recording.
///
/// # Errors
/// The recording cannot be read; or, as the inner error, it is too short or holds no forces.
pub fn audit(reader: &mut Reader) -> anyhow::Result<Result<Audit, AuditError>> {
    let header = reader.header().clone();
    let topology = Topology::of(&header);
    let total = reader.heads()?.len() as u64;
    if total < FEWEST_FRAMES {
        return Ok(Err(AuditError::Short { frames: total, needed: FEWEST_FRAMES }));
    }
    let every = total.div_ceil(MOST_FRAMES);
    let mut sums = LinkSums::new(header.links.len());
    let (mut frames, mut from_s, mut to_s) = (0, 0.0, 0.0);
    each_frame(reader, every, |frame| {
        sums.take(frame, &topology);
        if frames == 0 {
            from_s = frame.t_s;
        }
        (frames, to_s) = (frames + 1, frame.t_s);
    })?;
    if sums.largest_force_n == 0.0 {
        return Ok(Err(AuditError::Forceless));
    }
    let links = sums.fits();
    let mut joints = JointPass::new(&sums, &links, &topology);
    let (mut gaps, mut guides, mut spans) = (GapPass::new(&header), GuidePass::new(&header), SpanPass::default());
    each_frame(reader, every, |frame| {
        joints.take(frame, &topology);
        gaps.take(frame, &header, &joints, &topology);
        guides.take(frame, &header);
        spans.take(frame, &header, &topology);
    })?;
    let mut audit = Audit {
        frames,
        every,
        from_s,
        to_s,
        interval_s: (to_s - from_s) / (frames.max(2) - 1) as f64,
        links,
        joints: joints.fits(),
        sprockets: gaps.fits(),
        guides: guides.fits(&header),
        spans: spans.fit(),
        lacking: Vec::new(),
    };
    audit.lacking = measures::lacking(&audit, &header);
    Ok(Ok(audit))
}

fn each_frame(reader: &mut Reader, every: u64, mut take: impl FnMut(&Frame)) -> anyhow::Result<()> {
    let mut number = 0;
    reader.each(Wanted { frames: true, ..Wanted::default() }, WHOLE, |entry| {
        if let Entry::Frame(frame) = entry {
            if number % every == 0 {
                take(frame);
            }
            number += 1;
        }
        Ok(Flow::On)
    })
}
