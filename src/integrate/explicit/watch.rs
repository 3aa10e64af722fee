//! What a step keeps beside its forces for those who look at every step: sums for the ledger of its node, and what touches
//! where. Nothing of it is kept unasked, and nothing of it enters a force.

use super::{Part, Scratch, put};
use crate::elements::contact_law::ContactLaw;
use crate::elements::tooth_contact::{Column, LANES, Lanes};
use crate::model::Model;

/// What is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// [`NodeSums`].
    pub energy: bool,
    /// [`Touches`].
    pub touches: bool,
    /// And their segments.
    pub segments: bool,
}

/// Sums over all links, joints and contacts of a node, lane by lane: added up where the numbers are in registers anyway.
#[derive(Clone, Debug)]
pub struct NodeSums {
    /// Blocks of lanes whose masses are like those of the first; of these, squares of the speeds [m2/s2] and angular
    /// velocities [rad2/s2].
    pub alike: usize,
    pub speed2: Column,
    pub omega2: Column,
    /// Squares of the joints' stretch [m2], beyond the clearance where there is one.
    pub stretch2: Column,
    /// Lost in the joints [W].
    pub pins_w: Column,
    /// Elastic in contacts [J], and lost in them over this step [J].
    pub elastic_j: Column,
    pub lost_j: Column,
    /// False: a contact law has more than a stiffness, and `elastic_j` is not the whole.
    pub linear: bool,
}

/// What lanes of a part touch, valid where their contacts have an age.
#[derive(Clone, Debug)]
pub struct Touches {
    /// Out of the body.
    pub normal_x: Vec<f64>,
    pub normal_y: Vec<f64>,
    /// Joint from the body's origin [m].
    pub x: Vec<f64>,
    pub y: Vec<f64>,
    /// Contact point from the joint, against the normal and along the tangent [m]; of bushes and plate ends the same everywhere.
    pub radius: Vec<f64>,
    pub offset: Vec<f64>,
    /// Of the body there [m].
    pub body_radius: Vec<f64>,
    /// Sprocket the body turns with; -1: at rest.
    pub rotor: Vec<f64>,
    /// A [`Segment`](crate::recording::frame::Segment) as a number.
    pub segment: Vec<f64>,
}

impl NodeSums {
    pub(crate) fn new(model: &Model) -> NodeSums {
        let c = &model.chain;
        let own = |i: usize| (c.mass[i], c.inertia[i], c.inverse_mass[i] == 0.0);
        let like_first = |b: &usize| (0..LANES).all(|k| own(b * LANES + k) == own(k));
        let zero = [0.0; LANES];
        NodeSums {
            alike: (0..c.padded / LANES).take_while(like_first).count(),
            speed2: zero,
            omega2: zero,
            stretch2: zero,
            pins_w: zero,
            elastic_j: zero,
            lost_j: zero,
            linear: true,
        }
    }

    #[inline(always)]
    pub(super) fn clear(&mut self) {
        let zero = [0.0; LANES];
        (self.elastic_j, self.lost_j, self.linear) = (zero, zero, true);
    }

    /// Adds a block of contacts that begins at lane `at` of `n_links`.
    #[inline(always)]
    pub(super) fn add(&mut self, law: &ContactLaw, lanes: &Lanes, at: usize, n_links: usize) {
        if at + LANES <= n_links {
            self.add_where(law, lanes, |_| true);
        } else {
            self.add_where(law, lanes, |i| at + i < n_links);
        }
    }

    /// Of the lanes that are `own`.
    #[inline(always)]
    pub(super) fn add_where(&mut self, law: &ContactLaw, lanes: &Lanes, own: impl Fn(usize) -> bool) {
        let ContactLaw::Linear { stiffness_n_per_m, .. } = *law else {
            self.linear &= (0..LANES).all(|i| lanes.age[i] == 0.0 || !own(i));
            for i in (0..LANES).filter(|i| own(*i)) {
                self.lost_j[i] += lanes.lost_damping[i] + lanes.lost_friction[i];
            }
            return;
        };
        let half = 0.5 * stiffness_n_per_m;
        for i in 0..LANES {
            let d = if lanes.penetration[i] > 0.0 { lanes.penetration[i] } else { 0.0 };
            let elastic = half * d * d;
            let lost = lanes.lost_damping[i] + lanes.lost_friction[i];
            self.elastic_j[i] += if own(i) { elastic } else { 0.0 };
            self.lost_j[i] += if own(i) { lost } else { 0.0 };
        }
    }
}

impl Touches {
    fn new(model: &Model, part: Part) -> Touches {
        let lanes = model.chain.padded;
        let column = || vec![0.0; lanes];
        let (radius_m, rotor) = match part {
            Part::Bushes => (model.sprockets.first().map(|s| s.body.bush_radius_m), 0.0),
            Part::Guides(_) => (model.guides.first().map(|g| g.body.plate_radius_m), -1.0),
            Part::Contours(_) => (None, -1.0),
        };
        Touches {
            normal_x: column(),
            normal_y: column(),
            x: column(),
            y: column(),
            radius: vec![radius_m.unwrap_or(0.0); lanes],
            offset: column(),
            body_radius: column(),
            rotor: vec![rotor; lanes],
            segment: column(),
        }
    }

    /// Keeps a block of lanes.
    #[inline(always)]
    pub(super) fn keep(&mut self, lanes: &Lanes, at: usize) {
        put(&mut self.normal_x, at, lanes.normal_x);
        put(&mut self.normal_y, at, lanes.normal_y);
        put(&mut self.x, at, lanes.x);
        put(&mut self.y, at, lanes.y);
        put(&mut self.body_radius, at, lanes.body_radius);
    }

    /// Those lanes of a block that are `own`.
    pub(super) fn keep_where(&mut self, lanes: &Lanes, at: usize, own: impl Fn(usize) -> bool) {
        for i in (0..LANES).filter(|i| own(*i)) {
            (self.normal_x[at + i], self.normal_y[at + i]) = (lanes.normal_x[i], lanes.normal_y[i]);
            (self.x[at + i], self.y[at + i]) = (lanes.x[i], lanes.y[i]);
            self.body_radius[at + i] = lanes.body_radius[i];
        }
    }
}

impl Scratch {
    /// From the next evaluation on, keeps what is wanted.
    pub fn watch(&mut self, model: &Model, wanted: Wanted) {
        self.sums = wanted.energy.then(|| Box::new(NodeSums::new(model)));
        let columns = || Box::new(Part::ALL.map(|part| Touches::new(model, part)));
        self.touches = (wanted.touches || wanted.segments).then(columns);
        self.segments = wanted.segments;
    }

    /// Sums of the node, where they are asked for.
    pub fn sums(&self) -> Option<&NodeSums> {
        self.sums.as_deref()
    }

    /// What a part touches, where that is asked for.
    pub fn touches(&self, part: Part) -> Option<&Touches> {
        self.touches.as_deref().map(|t| &t[part.index()])
    }
}
