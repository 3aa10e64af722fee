//! Model: a drive compiled into flat arrays, ready to compute and never changed by a step.
//!
//! Link i runs from joint i - 1 (rear) to joint i (front); joint j joins link j to link j + 1; the loop closes. Even links
//! are inner and carry the bushes. Columns are padded with inert links (no inverse mass, far away from everything) to a
//! multiple of the lane width, so that loops over them need no remainder.

mod bearings;
mod blades;
mod chain;
mod mechanism;
mod parts;
mod place;
mod profiles;
mod shafts;
mod spans;
mod valves;

pub use bearings::BearingModel;
pub use blades::BladeModel;
pub use chain::ChainModel;
pub use mechanism::{Ratchet, SliderModel};
pub use parts::runs_through;
use parts::{
    build_bore, build_coordinates, build_end_bodies, build_guides, build_rails, check_clearances, join_end_bodies,
};
use place::route_diag;
pub use place::{PlacedDrive, close, place};
pub use profiles::Profiles;
pub use spans::SpanTerms;

use crate::diag::Report;
use crate::drive::sensors::SensorReads;
use crate::drive::{Drive, Scheme};
use crate::elements::body_frame::BodyFrame;
use crate::elements::contact_law::{ContactLaw, PairRadii};
use crate::elements::coordinate::Coordinate;
use crate::elements::coupling::Coupling;
use crate::elements::driver_motion::DriverMotion;
use crate::elements::hydraulics::Network;
use crate::elements::link_joint::LinkJoint;
use crate::elements::load::{GasLoad, Load, OrderLoad};
use crate::elements::span::ChainSpan;
use crate::geometry::Vec2;
use crate::geometry::chain::LinkShape;
use crate::geometry::guide::StraightGuide;
use crate::geometry::profile::Profile;
use crate::geometry::rail::{Piece, Rail};
use crate::geometry::route::{Pulley, Route};
use crate::geometry::silent_sprocket::SilentSprocket;
use crate::geometry::smartchain::Abutment;
use crate::geometry::sprocket::Sprocket;
use crate::pairs::bush_tooth::ToothedBody;
use crate::pairs::contact_group::{CONTACT_GROUPS, ContactGroup};
use crate::pairs::contour_body::{EndBody, LinkContour};
use crate::pairs::part_part::Touch;
use crate::pairs::plate_guide::GuideBody;
use crate::pairs::plate_rail::RailBody;
use crate::pairs::roller_bush::Bore;
use crate::recording::frame::Segment;
use crate::state::StateLayout;

/// Columns are padded to a multiple of this.
pub const LANE_WIDTH: usize = crate::lanes::LANES;

/// Teeth of a sprocket.
#[derive(Clone, Debug, PartialEq)]
pub enum Toothing {
    /// Seats bushes.
    Iso(Box<Sprocket>),
    /// Bears the flanks of a silent chain.
    Silent(Box<SilentSprocket>),
}

impl Toothing {
    /// Radius of the pitch circle, through the seated pins [m].
    pub fn pitch_radius_m(&self) -> f64 {
        match self {
            Toothing::Iso(s) => s.pitch_radius_m,
            Toothing::Silent(s) => s.pitch_radius_m,
        }
    }

    /// z p / (2 pi) [m].
    pub fn rolling_radius_m(&self) -> f64 {
        match self {
            Toothing::Iso(s) => s.rolling_radius_m(),
            Toothing::Silent(s) => s.rolling_radius_m,
        }
    }

    /// Radius of the bottom of the gaps [m].
    pub fn root_radius_m(&self) -> f64 {
        match self {
            Toothing::Iso(s) => s.root_radius_m,
            Toothing::Silent(s) => s.root_radius_m,
        }
    }

    /// Radius of the tips [m].
    pub fn tip_radius_m(&self) -> f64 {
        match self {
            Toothing::Iso(s) => s.tip_radius_m,
            Toothing::Silent(s) => s.tip_radius_m,
        }
    }

    /// Number of teeth.
    pub fn teeth(&self) -> u32 {
        match self {
            Toothing::Iso(s) => s.spec.teeth,
            Toothing::Silent(s) => s.spec.teeth,
        }
    }

    /// The whole contour in the sprocket's frame.
    pub fn profile(&self) -> Option<Profile> {
        match self {
            Toothing::Iso(s) => s.profile().ok(),
            Toothing::Silent(s) => s.profile().ok(),
        }
    }

    /// Where bushes seat.
    pub fn iso(&self) -> Option<&Sprocket> {
        match self {
            Toothing::Iso(s) => Some(s),
            Toothing::Silent(_) => None,
        }
    }
}

/// A sprocket of the model.
#[derive(Clone, Debug)]
pub struct SprocketModel {
    /// Name in the drive file.
    pub name: String,
    /// Exact tooth gap.
    pub geometry: Toothing,
    /// Index of the chain that runs on it.
    pub chain: usize,
    /// The same as contacts need it: elements by tooth gap, friction, law.
    pub body: ToothedBody,
    /// Its frame: the origin is the axis.
    pub frame: BodyFrame,
    /// What it turns by: index into [`Model::coordinates`].
    pub coordinate: usize,
    /// Speed at which it turns when the chain moves at its nominal speed [rad/s].
    pub nominal_speed_rad_s: f64,
    /// Inertia of its share of a chain without link bodies; zero with links [kg m2].
    pub chain_inertia_kg_m2: f64,
}

/// A guide of the model.
#[derive(Clone, Debug)]
pub struct GuideModel {
    /// Name in the drive file.
    pub name: String,
    /// Index of the chain that runs on it.
    pub chain: usize,
    /// Exact face, in the frame of the drive.
    pub geometry: StraightGuide,
    /// Its frame: the origin is where the face begins.
    pub frame: BodyFrame,
    /// The same as contacts need it.
    pub body: GuideBody,
}

impl GuideModel {
    /// What of the guide lies at `along_m` along its face.
    pub fn segment(&self, along_m: f64) -> Segment {
        let b = &self.body;
        match (along_m < 0.0, along_m > b.length_m, b.length_m > 0.0 && self.geometry.travel > 0.0) {
            (false, false, _) => Segment::GuideFace,
            (true, _, true) | (false, true, false) => Segment::GuideLeadIn,
            _ => Segment::GuideLeadOut,
        }
    }
}

/// A rail of the model.
#[derive(Clone, Debug)]
pub struct RailModel {
    /// Name in the drive file.
    pub name: String,
    /// Index of the chain that runs on it.
    pub chain: usize,
    /// In the frame of its body.
    pub rail: Rail,
    /// The contour as contacts need it.
    pub body: RailBody,
    /// Its frame: turns with the arm that carries it, about the arm's pivot.
    pub frame: BodyFrame,
    /// How it bends; None: it is rigid.
    pub blade: Option<BladeModel>,
    /// Largest distance of its points from the origin of its frame [m].
    pub reach_m: f64,
    /// Corners of a box about it, in its frame.
    pub low: Vec2,
    /// The upper right corner of the box about it, in its frame [m].
    pub high: Vec2,
}

impl RailModel {
    /// How far a point of its frame lies outside the box about it [m].
    pub fn box_distance_m(&self, p: Vec2) -> f64 {
        let outside = |p: f64, low: f64, high: f64| (low - p).max(p - high).max(0.0);
        libm::hypot(outside(p.x, self.low.x, self.high.x), outside(p.y, self.low.y, self.high.y))
    }

    /// What of it one of its pieces is.
    pub fn segment(&self, piece: usize) -> Segment {
        match self.body.pieces.get(piece) {
            Some(Piece::Arc { radius_m, .. }) if *radius_m == 0.0 => Segment::RailEnd,
            Some(Piece::Arc { .. } | Piece::EdgeSupport { .. }) => Segment::RailArc,
            Some(Piece::Line { .. }) | None => Segment::GuideFace,
        }
    }
}

/// An arm of the model.
#[derive(Clone, Debug)]
pub struct ArmModel {
    /// Name in the drive file.
    pub name: String,
    /// Point about which it turns [m].
    pub pivot: Vec2,
    /// What its rails turn by: index into [`Model::coordinates`].
    pub coordinate: usize,
    /// What its back turns by, which tips and stops touch; as its rails, unless the arm gives way.
    pub back: usize,
    /// Angle from where it is drawn at which the loop closes without load, or an estimate of it [rad].
    pub start_rad: f64,
}

/// The whole drive, compiled.
#[derive(Clone, Debug)]
pub struct Model {
    /// Integration step [s].
    pub step_s: f64,
    /// How steps follow one another.
    pub scheme: Scheme,
    /// Columns of the links of all chains.
    pub chain: ChainModel,
    /// What sprockets and arms turn by.
    pub coordinates: Vec<Coordinate>,
    /// Sprockets, in the order in which the chains meet them.
    pub sprockets: Vec<SprocketModel>,
    /// Straight guides.
    pub guides: Vec<GuideModel>,
    /// Tensioner arms.
    pub arms: Vec<ArmModel>,
    /// Curved guides, fixed or on arms.
    pub rails: Vec<RailModel>,
    /// Parts that touch each other and no chain.
    pub touches: Vec<Touch>,
    /// How the rollers of every chain touch their bushes; None: it has none of their own.
    pub bores: Vec<Option<Bore>>,
    /// Plungers of tensioners.
    pub sliders: Vec<SliderModel>,
    /// Pawls of plungers.
    pub ratchets: Vec<Ratchet>,
    /// Oil of tensioners.
    pub oil: Option<Network>,
    /// Loads by laws of the catalogue.
    pub loads: Vec<Load>,
    /// Loads by orders of the driver.
    pub order_loads: Vec<OrderLoad>,
    /// Coordinates on which waves of orders act that are no whole numbers.
    pub fractional_waves: Vec<usize>,
    /// Gas on valves.
    pub gas_loads: Vec<GasLoad>,
    /// Bearings that let sprockets, shafts and rails give way.
    pub bearings: Vec<BearingModel>,
    /// Coordinates of guides and rails that stand on mounts.
    pub mounts: Vec<usize>,
    /// Couplings between what turns.
    pub couplings: Vec<Coupling>,
    /// Spans of chains without link bodies, in the order of the chains.
    pub spans: Vec<ChainSpan>,
    /// How the driver turns; None: at a constant speed, and no load asks for its turn.
    pub driver_motion: Option<DriverMotion>,
    /// Coordinates of shafts without sprockets, then of arms, in the order of the drive.
    turning_parts: Vec<usize>,
    /// For every elastic shaft, coordinates with their weights. The weighted sum is the turn of the free end, less the turn of the body that drives the shaft.
    pub free_ends: Vec<Vec<(usize, f64)>>,
    /// Contour of the links' ends of every chain; None: it has bushes and plate ends only.
    pub contours: Vec<Option<LinkContour>>,
    /// Bodies that the contours of links touch: rings of abutment chains, teeth of silent sprockets.
    pub end_bodies: Vec<EndBody>,
    /// Per sprocket: where the straight path of the joints ends, from the foot of its axis along the arriving span [m].
    pub line_end_m: Vec<f64>,
    /// What its abutments are made from, of every chain; None: no abutment chain.
    pub abutments: Vec<Option<Abutment>>,
    /// Index of the sprocket with the prescribed speed.
    pub driver: usize,
    /// Nominal speed z p n of every chain, forwards positive [m/s].
    pub chain_speeds_m_s: Vec<f64>,
    /// Inner and outer link, of one chain after the other; `row_ranges`: those of each.
    pub rows: Vec<LinkShape>,
    /// Rows of every chain in `rows`.
    pub row_ranges: Vec<std::ops::Range<usize>>,
    /// Route of every chain; none where there are no sprockets.
    pub routes: Vec<Route>,
    /// What every sensor reads, in the order of the drive file.
    pub sensors: Vec<SensorReads>,
}

impl Model {
    /// Compiles a drive with the tightening sprocket moved by `shift_m` from where its loop of nominal links closes.
    pub fn build(drive: &Drive, placed: &PlacedDrive, shift_m: f64) -> Result<Model, Report> {
        let loop_pulleys = placed.loop_pulleys(drive, shift_m);
        let route = Route::new(&loop_pulleys).map_err(|e| drive.places.report(vec![route_diag(drive, &e)]))?;
        let pulleys: Vec<Pulley> = loop_pulleys.iter().filter(|p| !p.is_optional).copied().collect();
        let mut diags = Vec::new();
        let sense = if drive.chain_speed_m_s() < 0.0 { -1.0 } else { 1.0 };
        let bush_radius_m = 0.5 * drive.chain.bush_diameter_m();
        let contact = &drive.tooth_contact;
        let sprockets: Vec<SprocketModel> = drive
            .sprockets
            .iter()
            .zip(&placed.sprockets)
            .zip(&pulleys)
            .enumerate()
            .map(|(coordinate, ((spec, geometry), pulley))| {
                let nominal = drive.chain_speed_m_s() / geometry.rolling_radius_m() * pulley.wrap.sign();
                let (law, friction, stick) = (contact.law, contact.friction, contact.stick_speed_m_s);
                SprocketModel {
                    name: spec.name.clone(),
                    geometry: geometry.clone(),
                    chain: 0,
                    body: match geometry {
                        Toothing::Iso(s) => ToothedBody::new(s, bush_radius_m, law, friction, stick),
                        Toothing::Silent(_) => ToothedBody::without_seats(law, friction, stick),
                    },
                    frame: BodyFrame::turning(pulley.centre, coordinate),
                    coordinate,
                    nominal_speed_rad_s: nominal,
                    chain_inertia_kg_m2: 0.0,
                }
            })
            .collect();
        let mut coordinates = build_coordinates(drive, &sprockets, sense);
        let arms = mechanism::build_arms(drive, placed, &mut coordinates);
        let rails = build_rails(drive, placed, &arms);
        let mut touches = mechanism::build_stops(drive, &arms);
        let sliders = mechanism::build_sliders(drive, &arms, &mut coordinates, &mut touches);
        let guides = build_guides(drive, &route, placed);
        let end_bodies = build_end_bodies(drive, placed, &sprockets, &guides, sense);
        check_clearances(drive, &sprockets, (&guides, &rails, &arms), &mut diags);
        if !diags.is_empty() {
            return Err(drive.places.report(diags));
        }
        let joint = LinkJoint {
            stiffness_n_per_m: drive.joint.stiffness_n_per_m * (1.0 + drive.effects.joint_stiffness_share),
            damping_n_s_per_m: (drive.joint.damping_n_s_per_m + drive.effects.joint_damping_n_s_per_m).max(0.0),
            clearance_m: drive.joint.clearance_m + drive.effects.joint_clearance_m,
            friction_arm_m: (drive.joint.friction + drive.effects.pin_friction) * 0.5 * drive.chain.pin_diameter_m(),
            stick_speed_rad_s: drive.joint.stick_speed_rad_s,
        };
        let mut chain = ChainModel::new(drive.links, &placed.rows, joint, LANE_WIDTH);
        if drive.scatter.pitch_m > 0.0 {
            chain.scatter(drive.scatter.pitch_m, drive.scatter.seed);
        }
        for e in &drive.effects.pitch_errors {
            chain.lengthen(chain.lane_of(e.link), e.length_m);
        }
        for e in &drive.effects.link_masses {
            chain.weigh(chain.lane_of(e.link), 1.0 + e.mass_share, 1.0 + e.inertia_share);
        }
        let (all_m, half_m) = (drive.effects.elongation_m, 0.5 * drive.effects.alternate_m);
        if all_m != 0.0 || half_m != 0.0 {
            // Even links are inner.
            let lanes: Vec<usize> = chain.links().collect();
            lanes.iter().for_each(|i| chain.lengthen(*i, if i % 2 == 0 { all_m + half_m } else { all_m - half_m }));
        }
        let tight = drive.effects.tight_joints.iter().filter(|t| t.torque_nm > 0.0);
        for t in tight {
            // Two of one joint are one that is as tight as both.
            match chain.tight.iter_mut().find(|(joint, _)| *joint == t.joint) {
                Some((_, torque_nm)) => *torque_nm += t.torque_nm,
                None => chain.tight.push((t.joint, t.torque_nm)),
            }
        }
        Ok(Model {
            step_s: f64::NAN,
            scheme: drive.run.scheme,
            chain,
            coordinates,
            sprockets,
            guides,
            arms,
            rails,
            touches,
            sliders,
            ratchets: Vec::new(),
            oil: None,
            loads: Vec::new(),
            order_loads: Vec::new(),
            fractional_waves: Vec::new(),
            gas_loads: Vec::new(),
            couplings: Vec::new(),
            spans: Vec::new(),
            bearings: Vec::new(),
            mounts: Vec::new(),
            driver_motion: None,
            turning_parts: Vec::new(),
            free_ends: Vec::new(),
            bores: vec![build_bore(drive, &placed.rows)],
            contours: vec![placed.contour.clone()],
            end_bodies,
            line_end_m: placed.line_end_m.clone(),
            abutments: vec![placed.abutment.clone()],
            driver: drive.driver(),
            chain_speeds_m_s: vec![drive.chain_speed_m_s()],
            row_ranges: std::iter::once(0..placed.rows.len()).collect(),
            rows: placed.rows.clone(),
            routes: vec![route],
            sensors: drive.sensors.iter().map(|s| s.reads).collect(),
        })
    }

    /// The same drive, as its scheme takes it: where bushes, teeth and parts are rigid, their laws give no force.
    #[must_use]
    pub fn for_its_scheme(mut self) -> Model {
        if let Scheme::Moreau { .. } = self.scheme {
            self.sprockets.iter_mut().for_each(|s| s.body.law = ContactLaw::NONE);
            self.touches.iter_mut().for_each(|t| t.law = ContactLaw::NONE);
        }
        self
    }

    /// The same drive, stepped by another scheme.
    pub fn stepped_by(&self, scheme: Scheme, step_s: f64) -> Model {
        Model { scheme, step_s, ..self.clone() }
    }

    /// Chain without sprockets and guides, for rings and spans on their own.
    pub fn chain_only(n_links: usize, rows: Vec<LinkShape>, joint: LinkJoint, step_s: f64) -> Model {
        Model {
            step_s,
            scheme: Scheme::Leapfrog,
            chain: ChainModel::new(n_links, &rows, joint, LANE_WIDTH),
            coordinates: Vec::new(),
            sprockets: Vec::new(),
            guides: Vec::new(),
            arms: Vec::new(),
            rails: Vec::new(),
            touches: Vec::new(),
            sliders: Vec::new(),
            ratchets: Vec::new(),
            oil: None,
            loads: Vec::new(),
            order_loads: Vec::new(),
            fractional_waves: Vec::new(),
            gas_loads: Vec::new(),
            couplings: Vec::new(),
            spans: Vec::new(),
            bearings: Vec::new(),
            mounts: Vec::new(),
            driver_motion: None,
            turning_parts: Vec::new(),
            free_ends: Vec::new(),
            bores: vec![None],
            contours: vec![None],
            end_bodies: Vec::new(),
            line_end_m: Vec::new(),
            abutments: vec![None],
            driver: 0,
            chain_speeds_m_s: vec![0.0],
            row_ranges: std::iter::once(0..rows.len()).collect(),
            rows,
            routes: Vec::new(),
            sensors: Vec::new(),
        }
    }

    /// The chains of a drive in one model, each compiled alone. A shaft turns by what the first chain on it gives it.
    pub fn join(drive: &Drive, alone: Vec<Model>) -> Model {
        let chain = ChainModel::join(&alone.iter().map(|m| m.chain.clone()).collect::<Vec<_>>());
        let mut joined = Model {
            chain,
            coordinates: Vec::new(),
            sprockets: Vec::new(),
            guides: Vec::new(),
            arms: Vec::new(),
            rails: Vec::new(),
            touches: Vec::new(),
            bores: Vec::new(),
            sliders: Vec::new(),
            contours: Vec::new(),
            end_bodies: Vec::new(),
            line_end_m: Vec::new(),
            abutments: Vec::new(),
            spans: Vec::new(),
            driver: drive.driver(),
            chain_speeds_m_s: Vec::new(),
            rows: Vec::new(),
            row_ranges: Vec::new(),
            routes: Vec::new(),
            sensors: drive.sensors.iter().map(|s| s.reads).collect(),
            ..alone[0].clone()
        };
        let mut of_shaft = vec![None; drive.shafts.len()];
        for (chain, model) in alone.iter().enumerate() {
            for s in &model.sprockets {
                let shaft = drive.sprockets[joined.sprockets.len()].shaft;
                let own = &model.coordinates[s.coordinate];
                let coordinate = match shaft.and_then(|k| of_shaft[k]) {
                    Some(coordinate) => coordinate,
                    None => {
                        let path = shaft.map_or(own.path.clone(), |k| format!("shafts.{}", drive.shafts[k].name));
                        joined.coordinates.push(Coordinate { path, reach_m: 0.0, ..own.clone() });
                        joined.coordinates.len() - 1
                    }
                };
                if let Some(k) = shaft {
                    of_shaft[k] = Some(coordinate);
                }
                joined.coordinates[coordinate].add_inertia(s.chain_inertia_kg_m2);
                let reach_m = &mut joined.coordinates[coordinate].reach_m;
                *reach_m = reach_m.max(own.reach_m);
                let frame = BodyFrame::turning(s.frame.origin, coordinate);
                joined.sprockets.push(SprocketModel { chain, frame, coordinate, ..s.clone() });
            }
        }
        joined.end_bodies = join_end_bodies(&joined, &alone);
        joined.spans = spans::join_spans(drive, &joined, &alone);
        // What turns stands before what slides: behind the sprockets' coordinates come those of all arms, then those of all sliders.
        let n_arms: usize = alone.iter().map(|m| m.arms.len()).sum();
        let mut next_slider = joined.coordinates.len() + n_arms;
        let mut sliding = Vec::new();
        for (chain, model) in alone.into_iter().enumerate() {
            let (first_arm, first_slider) = (joined.coordinates.len(), next_slider);
            let (sprockets, arms) = (model.sprockets.len(), model.arms.len());
            let moved = |q: usize| {
                let own = q - sprockets;
                if own < arms { first_arm + own } else { first_slider + own - arms }
            };
            let mut own = model.coordinates.into_iter().skip(sprockets);
            joined.coordinates.extend(own.by_ref().take(arms));
            sliding.extend(own);
            next_slider += model.sliders.len();
            let sliders = model.sliders.into_iter();
            joined.sliders.extend(sliders.map(|s| SliderModel { coordinate: moved(s.coordinate), ..s }));
            joined.arms.extend(model.arms.into_iter().map(|a| ArmModel {
                coordinate: moved(a.coordinate),
                back: moved(a.back),
                ..a
            }));
            joined.guides.extend(model.guides.into_iter().map(|g| GuideModel { chain, ..g }));
            let rails = model.rails.into_iter();
            joined.rails.extend(rails.map(|r| {
                let frame = BodyFrame { turn: r.frame.turn.map(moved), ..r.frame };
                RailModel { chain, frame, ..r }
            }));
            joined.touches.extend(model.touches.into_iter().map(|t| Touch { shape: t.shape.renumbered(moved), ..t }));
            joined.bores.extend(model.bores);
            joined.contours.extend(model.contours);
            joined.line_end_m.extend(model.line_end_m);
            joined.abutments.extend(model.abutments);
            joined.chain_speeds_m_s.extend(model.chain_speeds_m_s);
            let first_row = joined.rows.len();
            joined.rows.extend(model.rows);
            joined.row_ranges.push(first_row..joined.rows.len());
            joined.routes.extend(model.routes);
        }
        joined.coordinates.extend(sliding);
        joined
    }

    /// Nominal speed of the first chain, forwards positive [m/s].
    pub fn chain_speed_m_s(&self) -> f64 {
        self.chain_speeds_m_s.first().copied().unwrap_or(0.0)
    }

    /// Row of the link in a lane.
    pub fn row_of(&self, lane: usize) -> usize {
        let k = self.chain.loop_of(lane);
        let rows = &self.row_ranges[k];
        rows.start + (lane - self.chain.loops[k].start) % rows.len()
    }

    /// Route of the chain that runs on a sprocket, and the sprocket's place in it.
    pub fn route_at(&self, sprocket: usize) -> Option<(&Route, usize)> {
        let chain = self.sprockets.get(sprocket)?.chain;
        let first = self.sprockets.iter().position(|s| s.chain == chain)?;
        Some((self.routes.get(chain)?, sprocket - first))
    }

    /// The frame of a body of frames that moves; None: it stands still.
    pub fn moving_frame(&self, body: usize) -> Option<&BodyFrame> {
        let of_guide = || self.guides.get(body.checked_sub(self.sprockets.len())?).map(|g| &g.frame);
        let of_rail = || self.rails.get(body.checked_sub(self.first_rail())?).map(|r| &r.frame);
        let frame = self.sprockets.get(body).map(|s| &s.frame).or_else(of_guide).or_else(of_rail)?;
        (frame.turn.is_some() || !frame.shifts.is_empty()).then_some(frame)
    }

    /// Path in the drive file of a body of frames.
    pub fn body_path(&self, body: usize) -> String {
        let guide =
            || self.guides.get(body.checked_sub(self.sprockets.len())?).map(|g| format!("guides.fixed.{}", g.name));
        let rail = || self.rails.get(body.checked_sub(self.first_rail())?).map(|r| format!("guides.rail.{}", r.name));
        let sprocket = self.sprockets.get(body).map(|s| format!("sprockets.{}", s.name));
        sprocket.or_else(guide).or_else(rail).unwrap_or_else(|| format!("body {body}"))
    }

    /// Index of the first rail among the bodies of frames: they follow sprockets and guides.
    pub fn first_rail(&self) -> usize {
        self.sprockets.len() + self.guides.len()
    }

    /// Lengths of the columns of its State.
    pub fn layout(&self) -> StateLayout {
        StateLayout {
            loops: self.chain.loops.clone(),
            rollers: self.chain.rollers.clone(),
            padded_len: self.chain.padded,
            n_coordinates: self.coordinates.len(),
            has_losses: self.has_losses(),
            has_shaft_losses: self.has_shaft_losses(),
            contact_groups: self.contact_groups(),
            has_span_losses: self.has_span_losses(),
            n_touches: self.touches.len(),
            n_oil: self.oil.as_ref().map_or([0; 3], Network::lengths),
        }
    }

    /// Which groups of contacts there are, in the order of [`ContactGroup::ALL`]. All drives keep a memory of bushes.
    pub fn contact_groups(&self) -> [bool; CONTACT_GROUPS] {
        let on_guides = |side: usize| self.guides.iter().any(|g| g.body.side == side && g.body.touches_plates);
        let on_rails = |side: usize| self.rails.iter().any(|r| r.body.side == side);
        let on_bodies = |set: usize| self.end_bodies.iter().any(|b| b.set == set);
        ContactGroup::ALL.map(|part| match part {
            ContactGroup::Bushes => true,
            ContactGroup::Guides(set) => on_guides(set / 2),
            ContactGroup::Rails(set) => on_rails(set / 3),
            ContactGroup::Contours(set) => on_bodies(set / 2),
        })
    }

    /// Whether links of any chain have a contour of their own.
    #[inline(always)]
    pub fn has_contours(&self) -> bool {
        self.contours.iter().any(Option::is_some)
    }
}

/// Radii of the flank contact, for laws that depend on them; of a layer those of the seat, in which a bush lies with all its width.
pub fn flank_radii(s: &SprocketModel) -> PairRadii {
    if matches!(s.body.law, ContactLaw::Winkler(_)) {
        return PairRadii { bush_m: s.body.bush_radius_m, body_m: -s.body.bush_radius_m };
    }
    PairRadii { bush_m: s.body.bush_radius_m, body_m: s.body.flank_radius_m }
}
