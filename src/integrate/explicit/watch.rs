//! What a step keeps beside its forces for observers of every step: segments, extremes of its contacts, and which of them there
//! are. Nothing of it is kept unasked, and nothing of it enters a force.
//!
//! All of it is noted where a block of contacts has just been computed and its values are at hand: a second walk over
//! columns took as many instructions and more time (penetrations 9 % of a run and not 1). Sums are worked on as local values: a
//! compiler cannot know that they do not overlap the lanes, and would add them up one by one.

use super::parts::{CONTACT_GROUPS, ContactGroup};
use super::{Scratch, write_block};
use crate::lanes::{LANES, LaneBlock};
use crate::model::Model;
use crate::pairs::bush_tooth::Lanes;

/// What is asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RequiredData {
    /// Segments of what lanes touch.
    pub segments: bool,
    pub extremes: Vec<Extreme>,
    /// Parts of which a number is asked that changes with the set of lanes that touch.
    pub sets: Vec<ContactGroups>,
}

impl RequiredData {
    /// All that this or another asks for.
    pub fn union(mut self, other: RequiredData) -> RequiredData {
        self.segments |= other.segments;
        for extreme in other.extremes {
            if !self.extremes.contains(&extreme) {
                self.extremes.push(extreme);
            }
        }
        for set in other.sets {
            if !self.sets.contains(&set) {
                self.sets.push(set);
            }
        }
        self
    }
}

/// A set of parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ContactGroups(u32);

impl ContactGroups {
    pub fn has(self, part: ContactGroup) -> bool {
        self.0 & (1 << part.index()) != 0
    }
}

impl FromIterator<ContactGroup> for ContactGroups {
    fn from_iter<I: IntoIterator<Item = ContactGroup>>(parts: I) -> ContactGroups {
        ContactGroups(parts.into_iter().fold(0, |all, part| all | (1 << part.index())))
    }
}

/// The largest of a value among all that touch: of `sign` times it, or times its size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extreme {
    pub value: ContactValue,
    /// 1, or -1 where the smallest is meant.
    pub sign: f64,
    pub absolute: bool,
    pub parts: ContactGroups,
}

/// A value that every contact has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactValue {
    /// [m]
    Penetration,
    /// [m/s]
    ApproachSpeed,
    /// Closing speed [m/s].
    NormalSpeed,
    /// In steps.
    Age,
    /// [N]
    NormalForce,
    TangentialForce,
    /// [m/s]
    TangentialSpeed,
}

/// Everything that is kept.
pub(super) struct ObservedStep {
    /// A [`Segment`](crate::recording::frame::Segment) as a number.
    segments: Option<[Vec<f64>; CONTACT_GROUPS]>,
    extremes: Vec<(Extreme, LaneBlock)>,
    sets: Vec<(ContactGroups, LaneBlock)>,
    /// A number for every lane of every part.
    keys: Vec<f64>,
    padded: usize,
}

/// A block of contacts that has just been computed.
pub(super) struct ContactBlock<'a> {
    pub(super) part: ContactGroup,
    pub(super) at: usize,
    pub(super) lanes: &'a Lanes,
}

impl Extreme {
    #[inline(always)]
    fn record(&self, most: &mut LaneBlock, b: &ContactBlock, own: impl Fn(usize) -> bool) {
        let l = b.lanes;
        let values = match self.value {
            ContactValue::Penetration => &l.penetration,
            ContactValue::ApproachSpeed => &l.approach,
            ContactValue::NormalSpeed => &l.rate,
            ContactValue::Age => &l.age,
            ContactValue::NormalForce => &l.normal_force,
            ContactValue::TangentialForce => &l.tangential_force,
            ContactValue::TangentialSpeed => &l.slide,
        };
        let bits = if self.absolute { u64::MAX >> 1 } else { u64::MAX };
        let mut now = *most;
        for i in 0..LANES {
            let value = self.sign * f64::from_bits(values[i].to_bits() & bits);
            let value = if l.age[i] > 0.0 { value } else { f64::NEG_INFINITY };
            let value = if own(i) { value } else { f64::NEG_INFINITY };
            now[i] = if value > now[i] { value } else { now[i] };
        }
        *most = now;
    }
}

impl ObservedStep {
    fn new(model: &Model, wanted: &RequiredData) -> ObservedStep {
        let padded = model.chain.padded;
        // Distinct whole numbers below 2^40: their sums are exact, and those of sets that follow each other practically never
        // equal.
        let key = |i: usize| ((i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 24) as f64;
        let keys = if wanted.sets.is_empty() { 0 } else { CONTACT_GROUPS * padded };
        ObservedStep {
            segments: wanted.segments.then(|| std::array::from_fn(|_| vec![0.0; padded])),
            extremes: wanted.extremes.iter().map(|e| (*e, [f64::NEG_INFINITY; LANES])).collect(),
            sets: wanted.sets.iter().map(|s| (*s, [0.0; LANES])).collect(),
            keys: (0..keys).map(key).collect(),
            padded,
        }
    }

    /// Before a step.
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        let zero = [0.0; LANES];
        for (_, most) in &mut self.extremes {
            *most = [f64::NEG_INFINITY; LANES];
        }
        for (_, sum) in &mut self.sets {
            *sum = zero;
        }
    }

    pub(super) fn wants_segments(&self) -> bool {
        self.segments.is_some()
    }

    /// Segments of a block, before it is noted.
    #[inline(always)]
    pub(super) fn record_segments(
        &mut self,
        part: ContactGroup,
        at: usize,
        segments: LaneBlock,
        own: Option<&[bool; LANES]>,
    ) {
        let Some(all) = &mut self.segments else { return };
        let column = &mut all[part.index()];
        match own {
            None => write_block(column, at, segments),
            Some(own) => {
                for i in (0..LANES).filter(|i| own[*i]) {
                    column[at + i] = segments[i];
                }
            }
        }
    }

    /// A block of contacts; of some of its lanes only, where it is another body's too or ends behind the last link.
    #[inline(always)]
    pub(super) fn record(&mut self, b: &ContactBlock, own: Option<&[bool; LANES]>) {
        match own {
            None => self.record_lanes(b, |_| true),
            Some(own) => self.record_lanes(b, |i| own[i]),
        }
    }

    #[inline(always)]
    fn record_lanes(&mut self, b: &ContactBlock, own: impl Fn(usize) -> bool + Copy) {
        for (extreme, most) in &mut self.extremes {
            if extreme.parts.has(b.part) {
                extreme.record(most, b, own);
            }
        }
        let first = b.part.index() * self.padded + b.at;
        for (parts, sum) in &mut self.sets {
            if !parts.has(b.part) {
                continue;
            }
            let (age, depth, force) = (b.lanes.age, b.lanes.penetration, b.lanes.normal_force);
            let (mut now, mut keys) = (*sum, [0.0; LANES]);
            keys.copy_from_slice(&self.keys[first..first + LANES]);
            if let Some(segments) = &self.segments {
                let segments = &segments[b.part.index()][b.at..b.at + LANES];
                for i in 0..LANES {
                    keys[i] *= 1.0 + segments[i];
                }
            }
            for i in 0..LANES {
                keys[i] = if age[i] > 0.0 { keys[i] } else { 0.0 };
                keys[i] = if own(i) { keys[i] } else { 0.0 };
            }
            for i in 0..LANES {
                // As Scratch::is_contact.
                let most = if depth[i] > force[i] { depth[i] } else { force[i] };
                now[i] += if most > 0.0 { keys[i] } else { 0.0 };
            }
            *sum = now;
        }
    }
}

impl Scratch {
    /// From the next evaluation on, keeps what is wanted.
    pub fn require(&mut self, model: &Model, wanted: &RequiredData) {
        self.watched = (*wanted != RequiredData::default()).then(|| Box::new(ObservedStep::new(model, wanted)));
    }

    /// Segments of what a part touches, where they are asked for.
    pub fn segments(&self, part: ContactGroup) -> Option<&[f64]> {
        Some(&self.watched.as_deref()?.segments.as_ref()?[part.index()])
    }

    /// An extreme, where it is asked for and the forces that were watched are those of the node.
    pub fn extreme(&self, of: &Extreme) -> Option<f64> {
        if self.adds_forces {
            return None;
        }
        let watched = self.watched.as_deref()?;
        let (_, most) = watched.extremes.iter().find(|(e, _)| e == of)?;
        Some(most.iter().fold(f64::NEG_INFINITY, |most, v| if *v > most { *v } else { most }))
    }

    /// A number that changes with the set of lanes of these parts that touch, and with the segments where those are asked for.
    pub fn set(&self, of: ContactGroups) -> Option<f64> {
        let (_, sum) = self.watched.as_deref()?.sets.iter().find(|(parts, _)| *parts == of)?;
        Some(sum.iter().sum())
    }
}
