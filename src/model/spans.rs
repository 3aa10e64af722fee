//! Chains without link bodies: their spans, and what of their mass turns with the sprockets.

use super::{ChainModel, Model};
use crate::drive::{ChainFidelity, Drive};
use crate::elements::span::ChainSpan;

/// Links that stretch with a span on its two sprockets together, half a link on each: the joint on which a link seats bears on its tooth.
const LINKS_ON_SPROCKETS: f64 = 1.0;

impl Model {
    /// The model of one chain, its links taken off where the drive says so: spans stand in their place, and the mass of the whole chain turns
    /// with its sprockets, that of a wrap and of half of both spans with each. At a constant speed that is the kinetic energy of all links moving
    /// along the pitch line. `tension_n`: of its spans where none is longer than the others.
    pub fn with_fidelity(mut self, drive: &Drive, tension_n: f64) -> Model {
        let Some(route) = self.routes.first().filter(|_| drive.fidelity == ChainFidelity::Spans) else { return self };
        let n = self.sprockets.len();
        let mass_per_m = self.chain.mass.iter().sum::<f64>() / route.length_m();
        let joint = self.chain.joints[0];
        let radius_m = |k: usize| self.sprockets[k].geometry.rolling_radius_m();
        let span = |a: usize| {
            let b = (a + 1) % n;
            let length_m = route.path_to_next_sprocket_m(a);
            let joints = length_m / drive.chain.pitch_m() + LINKS_ON_SPROCKETS;
            ChainSpan {
                path: String::new(),
                chain: 0,
                sprockets: [a, b],
                ends: [a, b].map(|k| self.sprockets[k].coordinate),
                radii_m: [a, b].map(|k| radius_m(k) * drive.sprockets[k].wrap.sign()),
                length_m,
                stiffness_n_per_m: joint.stiffness_n_per_m / joints,
                damping_n_s_per_m: joint.damping_n_s_per_m / joints,
                preload_n: tension_n,
            }
        };
        let spans: Vec<ChainSpan> = (0..n).map(span).collect();
        let shares = (0..n).map(|k| {
            let wrap_m = (route.span_start_m(k) - route.wrap_start_m(k)).rem_euclid(route.length_m());
            let around_m = wrap_m + 0.5 * (spans[k].length_m + spans[(k + n - 1) % n].length_m);
            mass_per_m * around_m * radius_m(k) * radius_m(k)
        });
        let shares: Vec<f64> = shares.collect();
        for (sprocket, share) in self.sprockets.iter_mut().zip(shares) {
            sprocket.chain_inertia_kg_m2 = share;
        }
        self.chain = ChainModel::without_links(joint);
        self.contours.fill(None);
        self.end_bodies.clear();
        self.spans = spans;
        self
    }

    /// Whether dampers of spans lose energy.
    pub fn has_span_losses(&self) -> bool {
        self.spans.iter().any(|s| s.damping_n_s_per_m > 0.0)
    }

    /// Whether whole turns of a coordinate count: a span, on it or behind couplings, is as long as what its sprockets have turned.
    pub fn counts_turns(&self, coordinate: usize) -> bool {
        let first = self.first_coupled(coordinate);
        self.spans.iter().flat_map(|s| s.ends).any(|k| self.first_coupled(k) == first)
    }
}

/// The spans of all chains: their sprockets and coordinates are those of the joined model, whose sprockets are there already.
pub(super) fn join_spans(drive: &Drive, joined: &Model, alone: &[Model]) -> Vec<ChainSpan> {
    let mut spans = Vec::new();
    for (chain, model) in alone.iter().enumerate() {
        let first = drive.sprockets_of(chain).start;
        spans.extend(model.spans.iter().map(|s| {
            let sprockets = s.sprockets.map(|k| first + k);
            ChainSpan { chain, sprockets, ends: sprockets.map(|k| joined.sprockets[k].coordinate), ..s.clone() }
        }));
    }
    for (span, path) in spans.iter_mut().zip(drive.span_paths()) {
        span.path = path;
    }
    spans
}
