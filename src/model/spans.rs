//! Chains without link bodies: their spans, and what of their mass turns with the sprockets.

use super::{ChainModel, Model};
use crate::diag::Report;
use crate::drive::{ChainFidelity, Drive};
use crate::effects::span_stiffness;
use crate::elements::span::ChainSpan;
use nalgebra::DMatrix;

/// What spans take over from the links that they stand for.
#[derive(Clone, Debug, PartialEq)]
pub struct SpanTerms {
    /// Tension that all spans have where none is longer than the others [N].
    pub tension_n: f64,
    /// Stiffness of each span [N/m], with the joints and teeth of the wraps beside it. Spans are in the order of the sprockets that they leave.
    pub stiffness_n_per_m: Vec<f64>,
}

impl Model {
    /// Stiffness of each span out of the torques that turning one sprocket causes on the others, links at rest [N/m]. Spans that join the same two
    /// sprockets share theirs in inverse proportion to their lengths.
    pub fn span_stiffness(&self, drive: &Drive, torques: &DMatrix<f64>) -> Vec<f64> {
        let Some(route) = self.routes.first() else { return Vec::new() };
        let n = self.sprockets.len();
        // Without slip the shafts turn by the chain's travel over their rolling radius.
        let radius_m = |k: usize| self.sprockets[k].geometry.rolling_radius_m() * drive.sprockets[k].wrap.sign();
        let stiffness = |a: usize| {
            let b = (a + 1) % n;
            // All spans that join these two.
            let joining = |i: usize| (i, (i + 1) % n) == (a, b) || ((i + 1) % n, i) == (a, b);
            let shares: f64 = (0..n).filter(|i| joining(*i)).map(|i| 1.0 / route.path_to_next_sprocket_m(i)).sum();
            let torque = torques[(self.sprockets[a].coordinate, self.sprockets[b].coordinate)];
            let together = -torque / (radius_m(a) * radius_m(b));
            together / route.path_to_next_sprocket_m(a) / shares
        };
        (0..n).map(stiffness).collect()
    }

    /// The model of one chain, its links taken off where the drive says so: spans stand in their place, and the mass of the whole chain turns
    /// with its sprockets, that of a wrap and of half of both spans with each. At a constant speed that is the kinetic energy of all links moving
    /// along the pitch line. The damper of a span is that of its joints in series. Numbers that the drive gives take the place of these; its
    /// effects on spans add to them.
    ///
    /// # Errors
    /// The effects leave a span no stiffness.
    pub fn with_fidelity(mut self, drive: &Drive, terms: &SpanTerms) -> Result<Model, Report> {
        let Some(route) = self.routes.first().filter(|_| drive.fidelity == ChainFidelity::Spans) else {
            return Ok(self);
        };
        let n = self.sprockets.len();
        let mass_per_m = self.chain.mass.iter().sum::<f64>() / route.length_m();
        let joint = self.chain.joints[0];
        let radius_m = |k: usize| self.sprockets[k].geometry.rolling_radius_m();
        let span = |(a, of_links_n_per_m): (usize, f64)| {
            let b = (a + 1) % n;
            let name = format!("{}-{}", drive.sprockets[a].name, drive.sprockets[b].name);
            let given = drive.spans.iter().find(|s| s.name == name);
            let effects = drive.effects.spans.iter().filter(|e| e.span == name);
            let own_n_per_m = given.and_then(|g| g.stiffness_n_per_m).unwrap_or(of_links_n_per_m);
            let own_n_s_per_m = given.and_then(|g| g.damping_n_s_per_m);
            let own_n_s_per_m =
                own_n_s_per_m.unwrap_or(own_n_per_m * joint.damping_n_s_per_m / joint.stiffness_n_per_m);
            let more_n_per_m: f64 = effects.clone().map(|e| e.stiffness_n_per_m).sum();
            let more_n_s_per_m: f64 = effects.map(|e| e.damping_n_s_per_m).sum();
            ChainSpan {
                path: String::new(),
                chain: 0,
                sprockets: [a, b],
                ends: [a, b].map(|k| self.sprockets[k].coordinate),
                radii_m: [a, b].map(|k| radius_m(k) * drive.sprockets[k].wrap.sign()),
                length_m: route.path_to_next_sprocket_m(a),
                of_links_n_per_m,
                own_n_per_m,
                own_n_s_per_m,
                stiffness_n_per_m: own_n_per_m + more_n_per_m,
                damping_n_s_per_m: own_n_s_per_m + more_n_s_per_m,
                preload_n: terms.tension_n,
            }
        };
        let spans: Vec<ChainSpan> = terms.stiffness_n_per_m.iter().copied().enumerate().map(span).collect();
        if let Some((k, s)) = spans.iter().enumerate().find(|(_, s)| s.stiffness_n_per_m <= 0.0) {
            let name = format!("{}-{}", drive.sprockets[k].name, drive.sprockets[(k + 1) % n].name);
            let title = format!("the stiffness of span `{name}` would be {:.3e} N/m", s.stiffness_n_per_m);
            let help = format!("take less than the {:.3e} N/m that it has", s.own_n_per_m);
            let path = span_stiffness::ROW.path(&name, "stiffness_n_per_m");
            return Err(drive.places.report(vec![drive.places.error(&path, title, Some(help))]));
        }
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
        Ok(self)
    }

    /// Whether dampers of spans lose energy.
    pub fn has_span_losses(&self) -> bool {
        self.spans.iter().any(|s| s.damping_n_s_per_m > 0.0)
    }

    /// Whether whole turns of a coordinate count: a span, on it or behind couplings, is as long as what its sprockets have turned; and waves of
    /// orders that are no whole numbers come back after several turns.
    pub fn counts_turns(&self, coordinate: usize) -> bool {
        let first = self.first_coupled(coordinate);
        let of_waves = self.fractional_waves.iter().any(|k| self.first_coupled(*k) == first);
        of_waves || self.spans.iter().flat_map(|s| s.ends).any(|k| self.first_coupled(k) == first)
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
