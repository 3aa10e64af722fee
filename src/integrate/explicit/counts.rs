//! What looking for contacts costs, by pair of bodies: what a next change of the kernels is measured by.

use super::Scratch;
use crate::lanes::LaneBlock;
use crate::model::Model;
use std::time::Instant;

/// Of one kind of part of the links and one body. A query is one block of [`super::LANES`] ends in one step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PairCounts {
    /// Blocks near the body that were looked at.
    pub queries: u64,
    /// Those that were not, as their gaps were known to be too wide.
    pub skipped: u64,
    /// Those in which something touched or could within the step.
    pub near: u64,
    /// Those whose forces were computed: also such that have just parted.
    pub solved: u64,
    /// Ends that had a normal force.
    pub hits: u64,
    /// Ends whose element of the contour was searched for anew; of bushes, blocks whose tooth gaps were.
    pub searches: u64,
    /// Time in all of this [s], clocks included.
    pub time_s: f64,
}

impl PairCounts {
    /// A query that is done. `solved`: normal forces.
    pub(super) fn record(&mut self, near: bool, solved: Option<&LaneBlock>, begun: Instant) {
        self.queries += 1;
        self.near += u64::from(near);
        self.solved += u64::from(solved.is_some());
        self.hits += solved.into_iter().flatten().filter(|force| **force != 0.0).count() as u64;
        self.time_s += begun.elapsed().as_secs_f64();
    }
}

/// Counts of all pairs, by index of the sprocket, the guide, the rail and the contour's body.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ContactCounts {
    pub(super) bushes: Vec<PairCounts>,
    pub(super) plates: Vec<PairCounts>,
    pub(super) rails: Vec<PairCounts>,
    pub(super) contours: Vec<PairCounts>,
}

/// A pair by its names.
#[derive(Clone, Debug, PartialEq)]
pub struct CountedPair {
    /// `bush`, `plate end`, `plate`, `abutment`, `outer flank` or `inner flank`.
    pub part: &'static str,
    pub body: String,
    pub counts: PairCounts,
}

impl Scratch {
    /// Counts from now on, which takes some time itself. Changes no bit of the results.
    pub fn count_pairs(&mut self, model: &Model) {
        let of = |n: usize| vec![PairCounts::default(); n];
        let (bushes, plates) = (of(model.sprockets.len()), of(model.guides.len()));
        let (rails, contours) = (of(model.rails.len()), of(model.end_bodies.len()));
        self.counts = Some(Box::new(ContactCounts { bushes, plates, rails, contours }));
    }

    /// The counts since [`Scratch::count_pairs`], of the pairs that were looked at.
    pub fn pair_counts(&self, model: &Model) -> Vec<CountedPair> {
        let Some(counts) = &self.counts else { return Vec::new() };
        let bushes = counts.bushes.iter().enumerate().map(|(k, c)| ("bush", &model.sprockets[k].name, *c));
        let plates = counts.plates.iter().enumerate().map(|(k, c)| ("plate end", &model.guides[k].name, *c));
        let rails = counts.rails.iter().enumerate().map(|(k, c)| ("plate", &model.rails[k].name, *c));
        let contours = counts.contours.iter().enumerate().map(|(k, c)| {
            let body = &model.end_bodies[k];
            let searches = self.end_blocks[k].iter().flatten().map(|end| end.searches()).sum();
            (body.part_name(), &body.name, PairCounts { searches, ..*c })
        });
        let all = bushes.chain(plates).chain(rails).chain(contours).filter(|(_, _, c)| c.queries > 0);
        all.map(|(part, body, counts)| CountedPair { part, body: body.clone(), counts }).collect()
    }
}
