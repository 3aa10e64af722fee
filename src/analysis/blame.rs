//! Which part is to blame for what stands out among impacts: what frames measure of the parts near it.
//!
//! An impact tells where a fault shows. Tension carries it on: a heavy link disturbs the arrival of links up to [`LINKS`] ahead of it, a gap that
//! lies off its place disturbs the ones beside it, and a loose joint in all of the chain makes single links stand out by chance. Frames measure
//! parts, one by one ([`super::audit`]). So a suspect is the odd part that is measured nearest to it; else what is measured odd of its body; else
//! what all parts of the drive share. Without any of these it stays what impacts say, unless its own place or length is measured to be right: then
//! something else than this part makes it stand out, such as loads that vary.

use super::audit::measures::{MeasureKind, OUTWARD, PITCH};
use super::audit::{AuditPart, Finding, Measured};
use super::suspects::{FoundSuspects, Suspect};
use crate::recording::frame::Header;
use crate::recording::places::Loops;

/// How far a part lies from the impacts in which it shows, at most: links or joints, and tooth gaps. Measured in drives with one planted fault: 2 and 1.
const LINKS: u32 = 3;
const GAPS: u32 = 2;

/// How directly a finding tells of a suspect; the smallest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Nearness {
    Part(u32),
    /// It stands out among the shadows.
    Shadow,
    Body,
    Drive,
}

/// Names the measured part behind every suspect. Suspects behind which the same part stands are one. Those with a measured cause come first; those that
/// are measured to be healthy are listed apart.
#[must_use]
pub fn with_causes(
    mut found: FoundSuspects,
    (findings, measured): (&[Finding], &[Measured]),
    header: &Header,
) -> FoundSuspects {
    let loops = Loops::new(header);
    let mut named: Vec<Suspect> = Vec::new();
    let mut left = Vec::new();
    for suspect in found.suspects {
        let near = |f: &Finding| Some((nearness(&suspect, f, header, &loops)?, f.clone()));
        // Findings come in the order of their weight.
        let nearest =
            findings.iter().filter(|f| f.kind > MeasureKind::Consequence).filter_map(near).min_by_key(|n| n.0);
        let Some((nearness, cause)) = nearest else {
            left.push(suspect);
            continue;
        };
        let same = |s: &&mut Suspect| s.cause.as_ref().is_some_and(|c| c.part == cause.part);
        match named.iter_mut().find(same) {
            Some(first) => {
                first.shadows.push(suspect.place);
                first.shadows.extend(suspect.shadows);
            }
            None => named.push(caused(suspect, nearness, cause)),
        }
    }
    let (healthy, left): (Vec<Suspect>, Vec<Suspect>) =
        left.into_iter().partition(|s| is_measured(s, measured, header));
    named.extend(left);
    (found.suspects, found.healthy) = (named, healthy);
    found
}

/// Whether the place of a gap, or the length of a link, is known well enough to be found odd.
fn is_measured(suspect: &Suspect, measured: &[Measured], header: &Header) -> bool {
    let body = header.bodies.iter().position(|b| b.path == suspect.body);
    let (part, measure) = match (body, suspect.tooth, suspect.link) {
        (Some(body), Some(gap), _) => (AuditPart::Gap(body, gap), &OUTWARD),
        (_, None, Some(link)) => (AuditPart::Link(link as usize), &PITCH),
        _ => return false,
    };
    measured.iter().any(|m| m.part == part && m.measure == measure && m.estimate.error < measure.least)
}

/// The suspect as the part that is measured to be odd.
fn caused(suspect: Suspect, nearness: Nearness, cause: Finding) -> Suspect {
    let number = |n: Option<usize>| n.and_then(|n| u32::try_from(n).ok());
    let kind = match nearness {
        Nearness::Part(_) | Nearness::Shadow if cause.tooth.is_some() => "tooth",
        Nearness::Part(_) | Nearness::Shadow if cause.link.is_some() => "link",
        Nearness::Part(_) | Nearness::Shadow => "joint",
        Nearness::Body => "body",
        Nearness::Drive => "drive",
    };
    Suspect {
        kind,
        tooth: cause.tooth,
        link: number(cause.link),
        joint: number(cause.joint),
        cause: Some(cause),
        ..suspect
    }
}

fn nearness(suspect: &Suspect, finding: &Finding, header: &Header, loops: &Loops) -> Option<Nearness> {
    let within = |a: u32, b: u32, (first, count): (u32, u32)| {
        let apart = (a.wrapping_sub(first) % count + count - b.wrapping_sub(first) % count) % count;
        apart.min(count - apart)
    };
    let body = header.bodies.iter().find(|b| b.path == suspect.body)?;
    let part = finding.link.or(finding.joint).and_then(|n| u32::try_from(n).ok());
    match (finding.tooth, part, &finding.body) {
        (Some(gap), _, of) => {
            if of.as_ref() != Some(&suspect.body) {
                return None;
            }
            let apart = suspect.tooth.map(|own| within(own, gap, (0, body.teeth.max(1))));
            let near = apart.filter(|apart| *apart <= GAPS).map(Nearness::Part);
            near.or_else(|| suspect.shadows.contains(&format!("tooth gap {gap}")).then_some(Nearness::Shadow))
        }
        (None, Some(part), _) => {
            // Link i ends at joint i: both are numbered along the chain alike.
            let own = suspect.link.or(suspect.joint)?;
            let chain = loops.of(own);
            let inside = loops.of(part) == chain;
            let apart = within(own, part, chain);
            (inside && apart <= LINKS).then_some(Nearness::Part(apart))
        }
        (None, None, Some(of)) => (*of == suspect.body).then_some(Nearness::Body),
        (None, None, None) => Some(Nearness::Drive),
    }
}
