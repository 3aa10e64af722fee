//! Arms, sliders, their touches and oil in frames and headers: what they do, and what is drawn of them.
//!
//! A drive file says of an arm where its pivot, its rails and its pads are, and of a plunger its tip, its bore, its stops and the room behind it.
//! Outlines are made of these; what is drawn besides (walls, the length of a plunger in its bore, the width of a pad) is a picture's, and has no
//! part in what is computed. A check valve has no place in the file: its ball is drawn at the bottom of the bore that it fills or empties.

use super::{fill, outline_element};
use crate::drive::Drive;
use crate::drive::mechanism::{ChamberSpec, OilSpec, PassageLaw, RatchetSpec, SliderSpec};
use crate::elements::hydraulics::PassageEnd;
use crate::geometry::profile::Element;
use crate::geometry::{Vec2, cross, perp, unit};
use crate::integrate::explicit::{Scratch, shafts, touches};
use crate::model::{ArmModel, Model};
use crate::pairs::part_part::{Pad, TouchShape};
use crate::recording::frame::{
    BodyInfo, BodyKind, Chambers, Header, Outline, OutlineCircle, OutlineElement, Passages, Sliders, Spans, Touches,
};
use crate::state::State;
use std::f64::consts::{FRAC_PI_2, PI};

/// As a pivot is drawn [m].
const PIVOT_RADIUS_M: f64 = 3e-3;
/// Width of a pad as it is drawn, and wall of a housing: in radii of the tip and of the plunger.
const PAD_WIDTH: f64 = 1.5;
const WALL: f64 = 0.35;
/// Teeth of a ratchet: their height over pitch and over the plunger's radius, and most that are drawn.
const TOOTH_OF_PITCH: f64 = 0.4;
const TOOTH_OF_RADIUS: f64 = 0.2;
const MOST_DRAWN_TEETH: f64 = 200.0;
/// Deepest chamber that is drawn as deep as it is, in radii of the plunger.
const DEEPEST: f64 = 8.0;

/// Rows of what slides: sliders, valves with the masses of their springs, check balls, ways of bearings and blades.
pub(super) fn fill_sliders(model: &Model, state: &State, scratch: &Scratch, sliders: &mut Sliders) {
    let first = model.n_turning();
    let q = &state.coordinates;
    let rows = first..model.coordinates.len();
    let speed = |k: usize| q.omega[k] + 0.5 * model.step_s * scratch.coordinate_alpha()[k];
    let forces: Vec<_> = rows.clone().map(|k| touches::sliding_forces(model, state, scratch, k)).collect();
    fill(&mut sliders.position_m, rows.clone().map(|k| q.angle[k]));
    fill(&mut sliders.speed_m_s, rows.clone().map(speed));
    fill(&mut sliders.acceleration_m_s2, rows.clone().map(|k| scratch.coordinate_alpha()[k]));
    fill(&mut sliders.spring_force_n, forces.iter().map(|f| f.spring_n));
    fill(&mut sliders.oil_force_n, forces.iter().map(|f| f.oil_n));
    fill(&mut sliders.touch_force_n, forces.iter().map(|f| f.touch_n));
    fill(&mut sliders.chain_force_n, rows.map(|k| scratch.chain_torque[k]));
}

/// Rows of parts that may touch each other.
pub(super) fn fill_touches(model: &Model, state: &State, scratch: &Scratch, into: &mut Touches) {
    let now = scratch.touches();
    let gaps = || model.touches.iter().map(|t| t.shape.gap(&state.coordinates.angle));
    fill(&mut into.gap_m, gaps().map(|g| g.gap_m));
    fill(&mut into.normal_force_n, now.normal_force.iter().copied());
    fill(&mut into.tangential_force_n, now.tangential_force.iter().copied());
    fill(&mut into.approach_speed_m_s, now.approach.iter().copied());
    fill(&mut into.age_s, now.age.iter().map(|steps| steps * model.step_s));
    fill(&mut into.x_m, gaps().map(|g| g.point.x));
    fill(&mut into.y_m, gaps().map(|g| g.point.y));
    fill(&mut into.normal_x, gaps().map(|g| g.normal.x));
    fill(&mut into.normal_y, gaps().map(|g| g.normal.y));
}

/// Rows of chambers, then of reservoirs, and of passages.
pub(super) fn fill_oil(
    model: &Model,
    state: &State,
    scratch: &Scratch,
    (chambers, passages): (&mut Chambers, &mut Passages),
) {
    let q = &state.coordinates;
    let Some(oil) = &model.oil else {
        *chambers = Chambers::default();
        *passages = Passages::default();
        return;
    };
    let speed = |k: usize| q.omega[k] + 0.5 * model.step_s * scratch.coordinate_alpha()[k];
    fill(&mut passages.flow_m3_s, (0..oil.passages.len()).map(|e| oil.flow_m3_s(e, &q.angle, &speed, &state.oil)));
    fill(&mut passages.pressure_drop_pa, oil.passages.iter().map(|p| oil.drop_pa(p, &state.oil.pressure_pa)));
    let reservoirs = oil.reservoirs.iter().map(|r| r.pressure_pa);
    fill(&mut chambers.pressure_pa, state.oil.pressure_pa.iter().copied().chain(reservoirs));
    let volumes = (0..oil.chambers.len()).map(|i| oil.volume_m3(i, &q.angle));
    fill(&mut chambers.volume_m3, volumes.chain(oil.reservoirs.iter().map(|_| 0.0)));
    let flows = &passages.flow_m3_s;
    fill(&mut chambers.inflow_m3_s, oil.ends().map(|end| oil.inflow_m3_s(end, |e| flows[e])));
}

/// Rows of spans of chains without links.
pub(super) fn fill_spans(model: &Model, state: &State, into: &mut Spans) {
    let now = || model.spans.iter().map(|s| shafts::span_at(model, state, s));
    fill(&mut into.tension_n, now().map(|n| n.tension_n));
    fill(&mut into.elongation_m, now().map(|n| n.elongation_m));
    fill(&mut into.power_w, now().map(|n| n.power_w));
}

/// Paths of the rows above, into a header.
pub(super) fn name_rows(model: &Model, header: &mut Header) {
    header.sliders = model.coordinates[model.n_turning()..].iter().map(|c| c.path.clone()).collect();
    header.spans = model.spans.iter().map(|s| s.path.clone()).collect();
    header.touches = model.touches.iter().map(|t| t.path.clone()).collect();
    let Some(oil) = &model.oil else { return };
    header.chambers = oil
        .ends()
        .map(|end| match end {
            PassageEnd::Chamber(i) => format!("chambers.{}", oil.chambers[i].name),
            PassageEnd::Reservoir(i) => format!("reservoirs.{}", oil.reservoirs[i].name),
        })
        .collect();
    header.passages = oil.passages.iter().map(|p| p.path.clone()).collect();
}

/// Chains without links, drawn where they run: lines along their spans, arcs on the pitch circles.
pub(super) fn chains_of_spans(drive: &Drive, model: &Model) -> Vec<BodyInfo> {
    let of = |chain: usize| {
        let (route, name) = (model.routes.get(chain)?, drive.chain_names.get(chain)?);
        let mut elements = Vec::new();
        for k in 0..route.sprockets() {
            let (leaving, wrap) = (route.span_after(k), route.wrap(k));
            let (start_rad, sweep_rad) = (wrap.start_rad, wrap.sweep_rad);
            let arc = Element::Arc { centre: wrap.centre, radius_m: wrap.radius_m, start_rad, sweep_rad };
            let end = leaving.start + leaving.direction * leaving.length_m;
            elements.extend([arc, Element::Line { start: leaving.start, end }]);
        }
        let elements = elements.iter().map(outline_element).collect();
        Some(BodyInfo {
            path: format!("chains.{name}"),
            kind: BodyKind::Chain as u32,
            outline: Some(Outline { name: name.clone(), elements, ..Outline::default() }),
            ..BodyInfo::default()
        })
    };
    let with_spans = |chain: &usize| model.spans.iter().any(|s| s.chain == *chain);
    (0..drive.chains()).filter(with_spans).filter_map(of).collect()
}

/// Ends of the way of a coordinate [rad, m].
fn stops(model: &Model, coordinate: usize) -> [Option<f64>; 2] {
    [-1.0, 1.0].map(|wanted| {
        model.touches.iter().find_map(|t| match t.shape {
            TouchShape::Stop { coordinate: own, limit, sense, .. } if own == coordinate && sense == wanted => {
                Some(limit)
            }
            TouchShape::Stop { .. } | TouchShape::Between { .. } | TouchShape::Tip { .. } | TouchShape::Cam(_) => None,
        })
    })
}

/// Arms, then plungers in their housings, then check balls.
pub(super) fn bodies(drive: &Drive, model: &Model) -> Vec<BodyInfo> {
    let mut all: Vec<BodyInfo> = model.arms.iter().map(|arm| arm_body(model, arm)).collect();
    let mut balls = Vec::new();
    for slider in &model.sliders {
        let Some(spec) = drive.sliders.iter().find(|s| s.name == slider.name) else { continue };
        let plunger = Plunger::of(spec, drive.oil.as_ref());
        let [low_stop, high_stop] = stops(model, slider.coordinate);
        let row = |coordinate: usize| Some((coordinate - model.n_turning()) as u32);
        let placed = |at: Vec2, path: String, kind: BodyKind, outline: Outline| {
            let place = spec.centre + plunger.to_world(at);
            BodyInfo {
                path,
                x_m: place.x,
                y_m: place.y,
                angle_rad: spec.direction_rad,
                outline: Some(outline),
                kind: kind as u32,
                ..BodyInfo::default()
            }
        };
        let path = format!("sliders.{}", spec.name);
        let housing = plunger.housing(&spec.name);
        all.push(placed(Vec2::zeros(), format!("housings.{}_housing", spec.name), BodyKind::Housing, housing));
        all.push(BodyInfo {
            slider: row(slider.coordinate),
            low_stop,
            high_stop,
            ..placed(Vec2::zeros(), path, BodyKind::Slider, plunger.rod(&spec.name))
        });
        for ball in plunger.balls(drive.oil.as_ref()) {
            let drawn = balls.iter().any(|b: &BodyInfo| b.path == ball.path);
            let coordinate = model.coordinates.iter().position(|c| c.path == ball.path);
            let Some(coordinate) = coordinate.filter(|_| !drawn) else { continue };
            let [low_stop, high_stop] = stops(model, coordinate);
            let circle = OutlineCircle { x_m: 0.0, y_m: 0.0, radius_m: ball.radius_m };
            let outline = Outline { name: ball.path.clone(), circles: vec![circle], ..Outline::default() };
            let body = placed(ball.centre, ball.path, BodyKind::Ball, outline);
            let angle_rad = body.angle_rad + if ball.outwards { PI } else { 0.0 };
            balls.push(BodyInfo { angle_rad, slider: row(coordinate), low_stop, high_stop, ..body });
        }
    }
    all.extend(balls);
    all
}

/// An arm in the frame of its pivot: its rails, its pads from the rails' end back to their start, and its pivot. A pad that does not lie between
/// rails and pivot, because the plunger presses beside the chain, is joined to the pivot alone.
fn arm_body(model: &Model, arm: &ArmModel) -> BodyInfo {
    let rails = || model.rails.iter().filter(|r| r.frame.turn == Some(arm.coordinate));
    let mut elements: Vec<Element> = rails().flat_map(|r| r.rail.profile.elements().iter().copied()).collect();
    let (from, along) = match (elements.first(), elements.last()) {
        (Some(first), Some(last)) => (first.start(), last.end() - first.start()),
        (None, None) | (Some(_), None) | (None, Some(_)) => (Vec2::zeros(), Vec2::new(1.0, 0.0)),
    };
    let mut pads: Vec<Element> =
        model.touches.iter().filter_map(|t| pad_of(&t.shape, arm.back)).map(|p| facing_back(p, along)).collect();
    pads.sort_by(|a, b| b.start().dot(&along).total_cmp(&a.start().dot(&along)));
    let side = |p: Vec2| cross(along, p - from);
    let is_between = |pad: &Element| [pad.start(), pad.end()].iter().all(|p| side(*p) * side(Vec2::zeros()) > 0.0);
    let (between, beside): (Vec<Element>, Vec<Element>) = pads.into_iter().partition(is_between);
    elements.extend(between);
    let pivot = Element::Line { start: Vec2::zeros(), end: Vec2::zeros() };
    elements.extend(beside.into_iter().flat_map(|pad| [pivot, pad]));
    let [low_stop, high_stop] = stops(model, arm.back);
    BodyInfo {
        path: format!("arms.{}", arm.name),
        coordinate: Some(arm.coordinate as u32),
        x_m: arm.pivot.x,
        y_m: arm.pivot.y,
        outline: Some(Outline {
            name: arm.name.clone(),
            closed: !elements.is_empty(),
            elements: joined(&elements, Some(Vec2::zeros())),
            circles: vec![OutlineCircle { x_m: 0.0, y_m: 0.0, radius_m: PIVOT_RADIUS_M }],
        }),
        kind: BodyKind::Arm as u32,
        low_stop,
        high_stop,
        ..BodyInfo::default()
    }
}

/// What the tip of a slider rests on, in the frame of this arm; None: of another.
fn pad_of(shape: &TouchShape, coordinate: usize) -> Option<Element> {
    let &TouchShape::Tip { centre, radius_m, arm, pivot, pad, .. } = shape else { return None };
    if arm != coordinate {
        return None;
    }
    let half_m = 0.5 * PAD_WIDTH * radius_m;
    Some(match pad {
        Pad::Flat { normal, offset_m } => {
            let tip = centre - pivot;
            let foot = tip - normal * (normal.dot(&tip) - offset_m);
            let side = perp(normal) * half_m;
            Element::Line { start: foot - side, end: foot + side }
        }
        Pad::Round { centre: middle, radius_m } => {
            let towards = centre - pivot - middle;
            let half_rad = f64::min(half_m / radius_m, FRAC_PI_2);
            let start_rad = libm::atan2(towards.y, towards.x) - half_rad;
            Element::Arc { centre: middle, radius_m, start_rad, sweep_rad: 2.0 * half_rad }
        }
    })
}

/// An element from the side to which a direction points to the other.
fn facing_back(element: Element, along: Vec2) -> Element {
    if (element.start() - element.end()).dot(&along) >= 0.0 {
        return element;
    }
    match element {
        Element::Line { start, end } => Element::Line { start: end, end: start },
        Element::Arc { centre, radius_m, start_rad, sweep_rad } => {
            Element::Arc { centre, radius_m, start_rad: start_rad + sweep_rad, sweep_rad: -sweep_rad }
        }
    }
}

/// Elements with lines between those that do not meet; closed, over a last point where one is given.
fn joined(elements: &[Element], last: Option<Vec2>) -> Vec<OutlineElement> {
    /// Up to here two ends are one [m].
    const SAME_M: f64 = 1e-9;
    let mut all = Vec::new();
    let Some(first) = elements.first() else { return all };
    let line = |start: Vec2, end: Vec2| Element::Line { start, end };
    let mut at = first.start();
    for element in elements {
        if (element.start() - at).norm() > SAME_M {
            all.push(outline_element(&line(at, element.start())));
        }
        if element.length_m() > SAME_M {
            all.push(outline_element(element));
        }
        at = element.end();
    }
    for end in last.into_iter().chain([first.start()]).filter(|end| (end - at).norm() > SAME_M).collect::<Vec<_>>() {
        all.push(outline_element(&line(at, end)));
        at = end;
    }
    all
}

/// A plunger as it is drawn: its frame has its origin in the centre of the tip and its x-axis along its way.
struct Plunger<'a> {
    spec: &'a SliderSpec,
    /// Its chamber, where it has one.
    chamber: Option<&'a str>,
    /// Half of its diameter.
    radius_m: f64,
    /// Where its straight side ends behind the tip.
    shoulder_m: f64,
    /// Its length behind the centre of the tip.
    length_m: f64,
    /// Where its bore begins and ends.
    mouth_m: f64,
    bottom_m: f64,
}

/// A check ball in the frame of its plunger.
struct DrawnBall {
    path: String,
    centre: Vec2,
    radius_m: f64,
    /// Opens away from the plunger.
    outwards: bool,
}

impl Plunger<'_> {
    fn of<'a>(spec: &'a SliderSpec, oil: Option<&'a OilSpec>) -> Plunger<'a> {
        let piston = |c: &ChamberSpec| c.pistons.iter().find(|p| p.slider == spec.name).map(|p| p.bore_m);
        let chamber = oil.and_then(|o| o.chambers.iter().find(|c| piston(c).is_some()));
        let bore_m = chamber.and_then(piston);
        let (tip_m, radius_m) = (spec.tip_radius_m, 0.5 * bore_m.unwrap_or(2.0 * spec.tip_radius_m));
        let shoulder_m = if tip_m > radius_m { libm::sqrt(tip_m * tip_m - radius_m * radius_m) } else { 0.0 };
        let (low_m, high_m) = (spec.low_m.unwrap_or(-radius_m), spec.high_m.unwrap_or(radius_m));
        let guided_m = oil.and_then(|o| {
            o.passages.iter().find_map(|p| match &p.law {
                PassageLaw::Leak { gap, slider: Some(name) } if *name == spec.name => Some(gap.length_m),
                PassageLaw::Leak { .. } | PassageLaw::Orifice { .. } | PassageLaw::Check(_) | PassageLaw::Pipe(_) => {
                    None
                }
            })
        });
        // At its low stop the side has just gone into the bore; at its high stop as much of it is still in there as leaks along it.
        let mouth_m = low_m + shoulder_m;
        let length_m = high_m - mouth_m + guided_m.unwrap_or(2.0 * radius_m);
        let room_m = chamber.map_or(0.0, |c| c.volume_m3 / (PI * radius_m * radius_m));
        let deepest_m = f64::max(DEEPEST * radius_m, radius_m - low_m);
        let depth_m = if chamber.is_some() { f64::min(room_m, deepest_m) } else { radius_m - low_m };
        Plunger {
            spec,
            chamber: chamber.map(|c| c.name.as_str()),
            radius_m,
            shoulder_m,
            length_m,
            mouth_m,
            bottom_m: -length_m - depth_m,
        }
    }

    fn to_world(&self, v: Vec2) -> Vec2 {
        let along = unit(self.spec.direction_rad);
        along * v.x + perp(along) * v.y
    }

    fn wall_m(&self) -> f64 {
        WALL * self.radius_m
    }

    fn rod(&self, name: &str) -> Outline {
        let (r, tip_m, shoulder, back) = (self.radius_m, self.spec.tip_radius_m, self.shoulder_m, -self.length_m);
        let half_rad = if tip_m > r { libm::asin(r / tip_m) } else { FRAC_PI_2 };
        let tip =
            Element::Arc { centre: Vec2::zeros(), radius_m: tip_m, start_rad: -half_rad, sweep_rad: 2.0 * half_rad };
        let side = |y: f64| Element::Line { start: Vec2::new(back, y), end: Vec2::new(shoulder, y) };
        let upper = facing_back(side(r), Vec2::new(1.0, 0.0));
        let upper = if self.spec.ratchet.is_some() { self.rack() } else { vec![upper] };
        Outline {
            name: name.to_string(),
            elements: joined(&[vec![side(-r), tip], upper].concat(), None),
            closed: true,
            circles: Vec::new(),
        }
    }

    /// Height of a ratchet's teeth as they are drawn.
    fn tooth_m(&self, ratchet: &RatchetSpec) -> f64 {
        f64::min(TOOTH_OF_PITCH * ratchet.pitch_m, TOOTH_OF_RADIUS * self.radius_m)
    }

    /// The side with the teeth of a ratchet, from the tip backwards: faces that the pawl in the mouth of the bore holds, where the plunger has gone back by
    /// the backlash behind one, and ramps that lift it.
    fn rack(&self) -> Vec<Element> {
        let Some(ratchet) = self.spec.ratchet else { return Vec::new() };
        let (pitch_m, depth_m, r) = (ratchet.pitch_m, self.tooth_m(&ratchet), self.radius_m);
        let first_m = self.mouth_m + ratchet.backlash_m;
        let (front, back) = (self.shoulder_m, -self.length_m);
        let highest = libm::floor((front - pitch_m - first_m) / pitch_m);
        let lowest = libm::ceil((back - first_m) / pitch_m).max(highest - MOST_DRAWN_TEETH);
        let mut faces = vec![highest];
        while faces.last().is_some_and(|k| k - 1.0 >= lowest) {
            faces.extend(faces.last().map(|k| k - 1.0));
        }
        let ramp = |k: f64| {
            let x = first_m + k * pitch_m;
            Element::Line { start: Vec2::new(x + pitch_m, r - depth_m), end: Vec2::new(x, r) }
        };
        let corner = |x: f64| Element::Line { start: Vec2::new(x, r), end: Vec2::new(x, r) };
        let ramps = faces.into_iter().filter(|k| *k >= lowest).map(ramp);
        std::iter::once(corner(front)).chain(ramps).chain([corner(back)]).collect()
    }

    /// The end of the pawl, in the mouth of the bore.
    fn pawl(&self) -> Option<OutlineCircle> {
        let radius_m = 0.5 * self.tooth_m(&self.spec.ratchet?);
        Some(OutlineCircle { x_m: self.mouth_m - radius_m, y_m: self.radius_m - radius_m, radius_m })
    }

    fn housing(&self, name: &str) -> Outline {
        let (inner, outer) = (self.radius_m, self.radius_m + self.wall_m());
        let (mouth, bottom, back) = (self.mouth_m, self.bottom_m, self.bottom_m - self.wall_m());
        let corners = [
            (mouth, inner),
            (bottom, inner),
            (bottom, -inner),
            (mouth, -inner),
            (mouth, -outer),
            (back, -outer),
            (back, outer),
            (mouth, outer),
        ]
        .map(|(x, y)| Vec2::new(x, y));
        let sides: Vec<Element> =
            corners.windows(2).map(|ends| Element::Line { start: ends[0], end: ends[1] }).collect();
        Outline {
            name: format!("{name} housing"),
            elements: joined(&sides, None),
            closed: true,
            circles: self.pawl().into_iter().collect(),
        }
    }

    /// Balls of the check valves of its chamber, and of chambers behind that, side by side at its bottom.
    fn balls(&self, oil: Option<&OilSpec>) -> Vec<DrawnBall> {
        let (Some(oil), Some(chamber)) = (oil, self.chamber) else { return Vec::new() };
        let behind = chambers_behind(oil, chamber);
        let own: Vec<_> = oil
            .passages
            .iter()
            .filter(|p| p.ends.iter().any(|end| behind.contains(&end.as_str())))
            .filter_map(|p| match p.law {
                PassageLaw::Check(ball) => Some((p, ball)),
                PassageLaw::Orifice { .. } | PassageLaw::Leak { .. } | PassageLaw::Pipe(_) => None,
            })
            .collect();
        let widest_m = own.iter().map(|(_, ball)| 2.2 * ball.ball_radius_m).fold(0.0, f64::max);
        let middle = 0.5 * (own.len() as f64 - 1.0);
        own.iter()
            .enumerate()
            .map(|(i, (passage, ball))| {
                let outwards = !behind.contains(&passage.ends[1].as_str());
                let (r, seat) = (ball.ball_radius_m, ball.seat_radius_m);
                let above_m = libm::sqrt(f64::max(r * r - seat * seat, 0.0));
                let x = if outwards { self.bottom_m - self.wall_m() - above_m } else { self.bottom_m + above_m };
                let centre = Vec2::new(x, (i as f64 - middle) * widest_m);
                DrawnBall { path: passage.path.clone(), centre, radius_m: r, outwards }
            })
            .collect()
    }
}

/// A chamber, and those that passages join with it.
fn chambers_behind<'a>(oil: &'a OilSpec, chamber: &'a str) -> Vec<&'a str> {
    let is_chamber = |name: &str| oil.chambers.iter().any(|c| c.name == name);
    let mut found = vec![chamber];
    for _ in 0..oil.chambers.len() {
        for p in &oil.passages {
            let [a, b] = [0, 1].map(|end| p.ends[end].as_str());
            for (from, to) in [(a, b), (b, a)] {
                if found.contains(&from) && is_chamber(to) && !found.contains(&to) {
                    found.push(to);
                }
            }
        }
    }
    found
}
