//! The largest step that the explicit scheme bears.
//!
//! ```text
//! contact           h <= 0.95 / sqrt(k w)      accuracy: three steps in half a period of the contact oscillator
//! contact damping   h <= 0.75 / (c w)          accuracy: the series of the mean force takes c w h as small
//! the same, growing h <= 1 / sqrt(k w + (c w/1.15)^2)  c where it grows with the load: at the larger of the load at rest and that of an impact
//!                                              at the driver's highest speed
//! pin damping       h <= 1.00 / (c_j 4 w_j)    accuracy: peaks are right to 0.8 % there
//! pin stiffness     h <= 1.00 / sqrt(k_j 4 w_j)  the second evaluation of the joints lifts stability to 3.46
//! roller            h <= 0.95 / sqrt((k_t + k_b)/m), 0.75 m/(c_t + c_b)   between tooth and bush
//! arm, its contacts  h <= 0.95 / sqrt(N k d^2/J)   N plates on its rails at a time, d the distance of the furthest from the pivot
//! axis on a bearing h <= 0.95 / sqrt(N k/m)    N contacts on it at a time; blade: N plates, m its whole mass; springs of both like couplings
//! film              h <= 0.75 / (drag/J)       drag on its shaft at 0.95 of the clearance
//! couplings         h <= 0.95 / sqrt(k w), 0.75 / (c w); loads 0.75 / (dQ/dv w): w of the coordinates
//! oil               h <= 0.95 / sqrt(k_h/m)    k_h = B A^2/V of closed chambers, plungers at their low stops
//! abutments         h <= 0.92 of where links with several contacts begin to chatter: integrate::link_row
//! ```
//! w = 1/m + l^2/J, the inverse effective mass of a link's end; w_j = max(1/m, l^2/J) of the lightest link. The constants of
//! the first three lines are measured: see tests/convergence.rs, which holds the errors they stand for. Abutments roll on
//! without impact, so that their chain has peaks as right at longer steps: 1.28 and 1.45 in the first and third line.

use super::link_row::{self, ContactRow, RowContact, RowLink};
use crate::elements::body_frame::BodyFrame;
use crate::elements::contact_law::{ContactLaw, PairRadii, WinklerFoundation};
use crate::elements::coordinate::Coordinate;
use crate::model::{Model, flank_radii};
use crate::pairs::contour_body::{EndBody, LinkContour};
use crate::pairs::part_part::TouchShape;
use crate::pairs::roller_bush::Bore;
use std::f64::consts::PI;

/// What a contact is loaded with where its law is to be accurate.
#[derive(Clone, Copy)]
struct ContactLoad {
    /// Closing speed of its impacts [m/s].
    speed_m_s: f64,
    /// Force that it bears at rest [N].
    rest_n: f64,
}

/// Loads of the contacts of one chain.
#[derive(Clone, Copy)]
struct ChainLoads {
    on_teeth: ContactLoad,
    on_guides: ContactLoad,
    on_abutments: ContactLoad,
}

/// One bound and where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct StepBound {
    pub step_s: f64,
    pub cause: String,
}

/// Force up to which nonlinear laws are kept accurate [N]: peaks of the bush chain are some 1000 N.
const PEAK_FORCE_N: f64 = 1000.0;

const CONTACT: f64 = 0.95;
const CONTACT_DAMPING: f64 = 0.75;
/// Divisor of c w in the bound for dampers that grow with the load. measured on the bush chain, restitutions 0.3, 0.4, 0.5, 0.6 and 0.7: the step h at
/// which the largest peak is 1 % wrong follows 1/h^2 = 0.901 k w + 0.756 (c w)^2. The bound takes k w + (c w/1.15)^2, whose steps are shorter:
/// the peak is then at most 0.75 % wrong.
const GROWING_DAMPING: f64 = 1.15;
const PIN_DAMPING: f64 = 1.0;
const PIN_STIFFNESS: f64 = 1.0;
/// Chains with abutments take these two instead: the peaks of the bundled one are then right to 0.6 %.
const CONTACT_OF_ABUTMENTS: f64 = 1.28;
const PIN_DAMPING_WITH_ABUTMENTS: f64 = 1.45;
/// Share of the step at which the linearised scheme grows: friction, tension and links that differ are not in it. In whole drives
/// chatter began at 1.08 times that step or more.
const STABLE_SHARE: f64 = 0.92;
/// Step by which it is looked for, and halvings of that step.
const STABLE_SEARCH: f64 = 0.95;
const REFINEMENTS: u32 = 4;
/// Share of the other bounds at which the search ends, whatever grows there: the step is a fortieth of any period.
const MIN_SEARCHED: f64 = 0.1;

/// Speed at which teeth strike bushes, rollers and flanks, guides strike plates, and abutments close, as shares of pitch times the speed of the
/// fastest sprocket: the first is the speed of a bush on a tooth that the span runs up to; the others are measured on bundled drives.
const SPEED_ON_TEETH: f64 = 1.0;
const SPEED_ON_GUIDES: f64 = 0.4;
const SPEED_OF_ABUTMENTS: f64 = 0.1;
/// Speed at which parts of tensioners strike each other [m/s]. assumed
const SPEED_OF_PARTS_M_S: f64 = 1.0;
/// Forces that rest on teeth, on guides and on abutments without any impact [N]. assumed: tensions of timing chains of 8 mm pitch
const REST_ON_TEETH_N: f64 = 300.0;
const REST_ON_GUIDES_N: f64 = 100.0;
const REST_ON_ABUTMENTS_N: f64 = 150.0;

/// Share of the clearance at which the drag of films bounds the step. assumed: films bear up to 0.95 of it.
const DRAG_ECCENTRICITY: f64 = 0.95;

/// The smallest of all bounds.
pub fn step_bound(model: &Model) -> StepBound {
    let mut bounds: Vec<StepBound> = with_links(model).flat_map(|chain| chain_bounds(model, chain)).collect();
    bounds.extend(shaft_bounds(model));
    bounds.extend(bearing_bounds(model));
    let nowhere = vec![0.0; model.coordinates.len()];
    // At their low stops, where the oil is stiffest.
    let mut lowest = nowhere.clone();
    for touch in &model.touches {
        if let TouchShape::Stop { coordinate, limit, sense: -1.0, .. } = touch.shape {
            lowest[coordinate] = limit;
        }
    }
    for s in &model.sliders {
        let Some(oil) = &model.oil else { break };
        let stiffness =
            oil.stiffness_n_per_m(s.coordinate, &lowest) * model.coordinates[s.coordinate].inverse_inertia();
        if stiffness > 0.0 {
            let cause = format!("oil behind slider {}", s.name);
            bounds.push(StepBound { step_s: CONTACT / libm::sqrt(stiffness), cause });
        }
    }
    for cam in model.cams().filter(|cam| cam.valve != cam.follower) {
        let Some(oil) = &model.oil else { break };
        // Its oil is stiffest where the plunger has gone in.
        let ways = model.touches.iter().filter_map(|t| match t.shape {
            TouchShape::Between { back, limit_m, .. } if back == cam.follower => Some(limit_m),
            TouchShape::Between { .. } | TouchShape::Stop { .. } | TouchShape::Tip { .. } | TouchShape::Cam(_) => None,
        });
        let mut inside = nowhere.clone();
        inside[cam.valve] = ways.fold(0.0, f64::min);
        let by = |k: usize| oil.stiffness_n_per_m(k, &inside) * model.coordinates[k].inverse_inertia();
        let stiffness = by(cam.valve) + by(cam.follower);
        if stiffness > 0.0 {
            let cause = format!("oil of {}", model.coordinates[cam.follower].path);
            bounds.push(StepBound { step_s: CONTACT / libm::sqrt(stiffness), cause });
        }
    }
    for touch in &model.touches {
        let gap = touch.shape.gap(&nowhere);
        // Where it lifts fastest.
        let steepest = match &touch.shape {
            TouchShape::Cam(cam) => cam.law.sweep(200).map(|a| cam.law.at(a).slope_m.abs()).fold(0.0, f64::max),
            TouchShape::Stop { .. } | TouchShape::Between { .. } | TouchShape::Tip { .. } => 0.0,
        };
        let slope = [gap.slope[0], if steepest > 0.0 { steepest } else { gap.slope[1] }];
        let inverse = |(k, weight): (usize, f64)| weight * weight * model.coordinates[k].inverse_inertia();
        let by = |i: usize| slope[i].powi(2) * touch.shape.parts_of(&gap, i).map(inverse).sum::<f64>();
        let load = ContactLoad { speed_m_s: SPEED_OF_PARTS_M_S, rest_n: PEAK_FORCE_N };
        bounds.extend(contact_bounds(&touch.path, (&touch.law, touch.radii, load), by(0) + by(1)));
    }
    let smallest = |a: StepBound, b: StepBound| if b.step_s < a.step_s { b } else { a };
    let accurate = bounds.into_iter().reduce(smallest).expect("the joints always give a bound");
    with_links(model).fold(accurate, |bound, chain| abutments_bound(model, chain, bound))
}

/// Chains whose links are bodies.
fn with_links(model: &Model) -> impl Iterator<Item = usize> + '_ {
    (0..model.chain.loops.len()).filter(|chain| !model.chain.loops[*chain].is_empty())
}

/// Largest value of the links of a chain.
fn largest(model: &Model, chain: usize, of: impl Fn(usize) -> f64) -> f64 {
    model.chain.loops[chain].clone().map(of).fold(0.0, f64::max)
}

/// Loads of the contacts of a chain at the highest speed of its driver.
fn chain_loads(model: &Model, chain: usize) -> ChainLoads {
    let pitch_m = 2.0 * model.chain.lever[model.chain.loops[chain].start];
    let own = model.sprockets.iter().filter(|s| s.chain == chain).map(|s| s.nominal_speed_rad_s.abs());
    let share = model
        .driver_motion
        .as_ref()
        .map_or(1.0, |driver| driver.highest_speed_rad_s() / model.sprockets[model.driver].nominal_speed_rad_s.abs());
    let speed_m_s = pitch_m * share * own.fold(0.0, f64::max);
    let load = |of_speed: f64, rest_n: f64| ContactLoad { speed_m_s: of_speed * speed_m_s, rest_n };
    ChainLoads {
        on_teeth: load(SPEED_ON_TEETH, REST_ON_TEETH_N),
        on_guides: load(SPEED_ON_GUIDES, REST_ON_GUIDES_N),
        on_abutments: load(SPEED_OF_ABUTMENTS, REST_ON_ABUTMENTS_N),
    }
}

/// Longest lever of a normal force on the contour of a chain's links [m].
fn contour_arm_m(model: &Model, chain: usize, contour: &LinkContour) -> f64 {
    contour.longest_arm_m(model.chain.lever[model.chain.loops[chain].start])
}

/// Bounds of the contacts and joints of one chain.
fn chain_bounds(model: &Model, chain: usize) -> Vec<StepBound> {
    let (c, joint) = (&model.chain, &model.chain.joints[chain]);
    let end_mobility = largest(model, chain, |i| c.inverse_mass[i] + c.lever[i].powi(2) * c.inverse_inertia[i]);
    let has_abutments = matches!(model.contours[chain], Some(LinkContour::Abutments { .. }));
    let loads = chain_loads(model, chain);
    let mut bounds = Vec::new();
    let bush_mobility =
        largest(model, chain, |j| c.bush_inverse_mass[j] + c.bush_lever[j].powi(2) * c.bush_inverse_inertia[j]);
    for s in model.sprockets.iter().filter(|s| s.chain == chain && s.geometry.iso().is_some()) {
        let (name, radii) = (format!("sprockets.{}", s.name), flank_radii(s));
        // All bushes on its teeth push the axis at once.
        bounds.extend(body_bounds(
            model,
            &name,
            (&s.body.law, radii, loads.on_teeth),
            bush_mobility,
            &s.frame,
            f64::from(s.geometry.teeth()),
        ));
    }
    if let Some(bore) = &model.bores[chain] {
        bounds.extend(roller_bounds(model, chain, bore, loads.on_teeth));
    }
    if let Some(contour) = &model.contours[chain] {
        let arm = contour_arm_m(model, chain, contour);
        let contour_mobility = largest(model, chain, |i| c.inverse_mass[i] + arm * arm * c.inverse_inertia[i]);
        let load = if has_abutments { loads.on_abutments } else { loads.on_teeth };
        for b in model.end_bodies.iter().filter(|b| b.chain == chain) {
            let radii = PairRadii { bush_m: arm, body_m: f64::INFINITY };
            let longer = if has_abutments { CONTACT_OF_ABUTMENTS / CONTACT } else { 1.0 };
            bounds.extend(longer_bounds(&b.name, (&b.law, radii, load), contour_mobility, longer));
            let own = axis_mobility(model, &b.frame);
            if own > 0.0 {
                // Both ends of all links that can lie on it push the axis at once.
                let ends = 2.0 * (2.0 * PI * b.distance_bound_m(arm) / (2.0 * c.lever[c.loops[chain].start]) + 1.0);
                let name = format!("{} on its bearing", b.name);
                bounds.extend(contact_bounds(&name, (&b.law, radii, load), contour_mobility + ends * own));
            }
        }
    }
    for g in model.guides.iter().filter(|g| g.chain == chain && g.body.touches_plates) {
        let radii = PairRadii { bush_m: g.body.plate_radius_m, body_m: f64::INFINITY };
        let ends = g.body.length_m / c.lever[c.loops[chain].start] + 2.0;
        bounds.extend(body_bounds(
            model,
            &format!("guides.fixed.{}", g.name),
            (&g.body.law, radii, loads.on_guides),
            end_mobility,
            &g.frame,
            ends,
        ));
    }
    bounds.extend(rail_bounds(model, chain, end_mobility, loads.on_guides));
    let joint_mobility = largest(model, chain, |i| c.inverse_mass[i].max(c.lever[i].powi(2) * c.inverse_inertia[i]));
    if joint.damping_n_s_per_m > 0.0 {
        let share = if has_abutments { PIN_DAMPING_WITH_ABUTMENTS } else { PIN_DAMPING };
        bounds.push(StepBound {
            step_s: share / (joint.damping_n_s_per_m * 4.0 * joint_mobility),
            cause: "damping of the joints (chain.joint)".into(),
        });
    }
    bounds.push(StepBound {
        step_s: PIN_STIFFNESS / libm::sqrt(joint.stiffness_n_per_m * 4.0 * joint_mobility),
        cause: "stiffness of the joints (chain.joint)".into(),
    });
    bounds
}

/// Bounds of rollers: on their bushes, and between a bush and a tooth, where both springs and both dampers hold the roller.
fn roller_bounds(model: &Model, chain: usize, bore: &Bore, load: ContactLoad) -> Vec<StepBound> {
    let c = &model.chain;
    let of_roller = |i: usize| c.inverse_mass[i];
    let mobility = c.rollers[chain].clone().map(of_roller).fold(0.0, f64::max);
    let of_bush =
        largest(model, chain, |j| c.bush_inverse_mass[j] + c.bush_lever[j].powi(2) * c.bush_inverse_inertia[j]);
    let on_bush = (&bore.law, bore.radii(), load);
    let mut bounds = contact_bounds("rollers on their bushes", on_bush, mobility + of_bush).to_vec();
    for s in model.sprockets.iter().filter(|s| s.chain == chain && s.geometry.iso().is_some()) {
        let sum =
            |of: &dyn Fn(&ContactLaw, PairRadii) -> f64| of(&s.body.law, flank_radii(s)) + of(&bore.law, bore.radii());
        let stiffness = sum(&|law, radii| law.stiffness_at(PEAK_FORCE_N, radii));
        let damping = sum(&|law, radii| law.damping_at(damping_load_n((law, radii), mobility, load))).max(1e-9);
        let grows = s.body.law.grows() || bore.law.grows();
        let at = format!("rollers between bushes and sprockets.{}", s.name);
        bounds.extend([
            StepBound {
                step_s: CONTACT / libm::sqrt(stiffness * mobility),
                cause: format!("contact stiffness of {at}"),
            },
            StepBound {
                step_s: damping_step(grows, stiffness * mobility, damping * mobility),
                cause: format!("contact damping of {at}"),
            },
        ]);
    }
    bounds
}

/// Bounds of plates on the rails of a chain.
fn rail_bounds(model: &Model, chain: usize, end_mobility: f64, load: ContactLoad) -> Vec<StepBound> {
    let mut bounds = Vec::new();
    let pitch_m = 2.0 * model.chain.lever[model.chain.loops[chain].start];
    for rail in model.rails.iter().filter(|r| r.chain == chain) {
        let radii = PairRadii { bush_m: rail.body.plate_radius_m, body_m: f64::INFINITY };
        let of_turn = rail.frame.turn.map_or(0.0, |q| rail.reach_m.powi(2) * model.coordinates[q].inverse_inertia());
        let of_frame = of_turn + axis_mobility(model, &rail.frame);
        // One plate may stand where all modes are largest. Of all plates, evenly over the blade, every mode sees its mean square, which over its mass
        // is one over the blade's.
        let of_modes: f64 = rail.blade.iter().flat_map(|b| &b.shape.modes).map(|m| 1.0 / m.mass_kg).sum();
        let of_all = of_frame + rail.blade.as_ref().map_or(0.0, |b| 1.0 / b.shape.mass_kg);
        let name = format!("guides.rail.{}", rail.name);
        let pair = (&rail.body.law, radii, load);
        bounds.extend(contact_bounds(&name, pair, end_mobility + of_frame + of_modes));
        // All plates that can lie on it push the arm at once.
        let length_m: f64 = rail.rail.profile.elements().iter().map(|e| e.length_m()).sum();
        let plates = length_m / pitch_m + 1.0;
        if of_all > 0.0 {
            let on = if of_turn > 0.0 { "on its arm" } else { "as it gives way" };
            bounds.extend(contact_bounds(&format!("{name} {on}"), pair, plates * of_all));
        }
    }
    bounds
}

/// Bounds of a contact with a body whose axis may give way, and of all `most` of them that push the axis at once.
fn body_bounds(
    model: &Model,
    name: &str,
    pair: (&ContactLaw, PairRadii, ContactLoad),
    mobility: f64,
    frame: &BodyFrame,
    most: f64,
) -> Vec<StepBound> {
    let own = axis_mobility(model, frame);
    let mut bounds = contact_bounds(name, pair, mobility + own).to_vec();
    if own > 0.0 {
        bounds.extend(contact_bounds(&format!("{name} on its bearing"), pair, most * own));
    }
    bounds
}

/// Largest inverse mass with which the axis of a frame gives way in any direction [1/kg].
fn axis_mobility(model: &Model, frame: &BodyFrame) -> f64 {
    let [xx, xy, yy] = frame.mobility(&model.coordinates).inverse_mass;
    0.5 * (xx + yy) + libm::hypot(0.5 * (xx - yy), xy)
}

/// Bounds of the springs of bearings, mounts of guides and modes of blades, and of the drag of films. Dampers, and films against the way of the axis, are
/// taken implicitly.
fn bearing_bounds(model: &Model) -> Vec<StepBound> {
    let ways = model.bearings.iter().flat_map(|b| b.ways);
    let modes = model.rails.iter().flat_map(|r| r.blade.iter().flat_map(|b| b.modes()));
    let springs = ways
        .chain(model.mounts.iter().copied())
        .chain(modes)
        .map(|k| &model.coordinates[k])
        .filter(|c| c.spring.stiffness > 0.0);
    let bound = |c: &Coordinate| StepBound {
        step_s: CONTACT / libm::sqrt(c.spring.stiffness * c.inverse_inertia()),
        cause: c.path.clone(),
    };
    let drags = model.bearings.iter().filter_map(|b| {
        let (film, turn) = b.film.as_ref()?;
        let rate = film.drag_nm_s(DRAG_ECCENTRICITY) * model.coordinates[*turn].inverse_inertia();
        (rate > 0.0).then(|| StepBound { step_s: CONTACT_DAMPING / rate, cause: format!("drag of {}", b.path) })
    });
    springs.map(bound).chain(drags).collect()
}

/// Bounds of couplings and loads.
fn shaft_bounds(model: &Model) -> Vec<StepBound> {
    let mut bounds = Vec::new();
    for c in &model.couplings {
        let mobility: f64 = c.ends.iter().map(|k| model.coordinates[*k].inverse_inertia()).sum();
        let (stiffness, damping) = (c.stiffness_nm_per_rad * mobility, c.damping_nm_s_per_rad * mobility);
        if stiffness > 0.0 {
            bounds.push(StepBound { step_s: CONTACT / libm::sqrt(stiffness), cause: c.path.clone() });
        }
        if damping > 0.0 {
            bounds.push(StepBound { step_s: CONTACT_DAMPING / damping, cause: c.path.clone() });
        }
    }
    for chain in 0..model.chain.loops.len() {
        // No frequency of the spans of a chain is above the sum of theirs.
        let (mut stiffness, mut damping) = (0.0, 0.0);
        for s in model.spans.iter().filter(|s| s.chain == chain) {
            let mobility = |i: usize| s.radii_m[i].powi(2) * model.coordinates[s.ends[i]].inverse_inertia();
            stiffness += s.stiffness_n_per_m * (mobility(0) + mobility(1));
            damping += s.damping_n_s_per_m * (mobility(0) + mobility(1));
        }
        let cause = || {
            let path = model.spans.iter().find(|s| s.chain == chain).map_or("", |s| &s.path);
            format!("spans of {}", path.split(".spans").next().unwrap_or(path))
        };
        if stiffness > 0.0 {
            bounds.push(StepBound { step_s: CONTACT / libm::sqrt(stiffness), cause: cause() });
        }
        if damping > 0.0 {
            bounds.push(StepBound { step_s: CONTACT_DAMPING / damping, cause: cause() });
        }
    }
    for l in &model.loads {
        let coordinate = &model.coordinates[l.coordinate];
        let rate = l.steepest(coordinate.nominal_speed_rad_s) * coordinate.inverse_inertia();
        if rate > 0.0 {
            bounds.push(StepBound { step_s: CONTACT_DAMPING / rate, cause: l.path.clone() });
        }
    }
    bounds
}

/// `accurate`, or what abutments of a chain on one or two of their bodies bear, if that is less.
fn abutments_bound(model: &Model, chain: usize, accurate: StepBound) -> StepBound {
    let (c, joint) = (&model.chain, &model.chain.joints[chain]);
    let Some(contour @ LinkContour::Abutments { .. }) = &model.contours[chain] else { return accurate };
    let link = &RowLink {
        inverse_mass: largest(model, chain, |i| c.inverse_mass[i]),
        inverse_inertia: largest(model, chain, |i| c.inverse_inertia[i]),
        lever_m: largest(model, chain, |i| c.lever[i]),
        arm_m: contour_arm_m(model, chain, contour),
        joint_stiffness_n_per_m: joint.stiffness_n_per_m,
        joint_damping_n_s_per_m: joint.damping_n_s_per_m,
    };
    let load = chain_loads(model, chain).on_abutments;
    let bodies: Vec<&EndBody> = model.end_bodies.iter().filter(|b| b.chain == chain).collect();
    let mut bound = accurate;
    let mut looked_at = Vec::new();
    for (i, p) in bodies.iter().enumerate() {
        for q in bodies[i..].iter().filter(|q| q.set != p.set || q.body == p.body) {
            let radii = PairRadii { bush_m: link.arm_m, body_m: f64::INFINITY };
            let mobility = link.inverse_mass + link.arm_m * link.arm_m * link.inverse_inertia;
            let law = |b: &EndBody| {
                let damping = b.law.damping_at(damping_load_n((&b.law, radii), mobility, load));
                (b.law.stiffness_at(PEAK_FORCE_N, radii), damping)
            };
            let (laws, two_bodies) = ([law(p), law(q)], p.body != q.body);
            if looked_at.contains(&(laws, two_bodies)) {
                continue;
            }
            looked_at.push((laws, two_bodies));
            for row in rows(laws, two_bodies) {
                let step_s = largest_stable_step(link, &row, bound.step_s / STABLE_SHARE);
                if STABLE_SHARE * step_s < bound.step_s {
                    let between = if two_bodies { format!(" and {}", q.name) } else { String::new() };
                    let cause = format!("chatter of abutments between {}{between}", p.name);
                    bound = StepBound { step_s: STABLE_SHARE * step_s, cause };
                }
            }
        }
    }
    bound
}

/// The largest step up to `most_s` at which the row does not grow.
fn largest_stable_step(link: &RowLink, row: &ContactRow, most_s: f64) -> f64 {
    let mut stable_s = most_s;
    while link_row::grows(link, row, stable_s) && stable_s > MIN_SEARCHED * most_s {
        stable_s *= STABLE_SEARCH;
    }
    if stable_s == most_s {
        return most_s;
    }
    let mut growing_s = stable_s / STABLE_SEARCH;
    for _ in 0..REFINEMENTS {
        let middle_s = 0.5 * (stable_s + growing_s);
        *(if link_row::grows(link, row, middle_s) { &mut growing_s } else { &mut stable_s }) = middle_s;
    }
    stable_s
}

/// Links on their way from a body with the second law to one with the first: one link touches both, with its front end or with its
/// rear end. Else links that lie on one body.
fn rows([p, q]: [(f64, f64); 2], two_bodies: bool) -> Vec<ContactRow> {
    let on = |front: bool, (stiffness_n_per_m, damping_n_s_per_m): (f64, f64)| RowContact {
        front,
        stiffness_n_per_m,
        damping_n_s_per_m,
    };
    let (on_p, on_q) = (vec![on(true, p), on(false, p)], vec![on(true, q), on(false, q)]);
    if !two_bodies {
        return vec![vec![on_p; 4]];
    }
    let with_front = vec![on(true, p), on(true, q), on(false, q)];
    let with_rear = vec![on(true, p), on(false, p), on(false, q)];
    [with_front, with_rear].map(|both| vec![on_q.clone(), both, on_p.clone(), on_p.clone()]).to_vec()
}

/// Load at which the damping of a law bounds the step [N]. That of the Hunt-Crossley law grows with the load. An impact at the speed v reaches
/// k d = sqrt(2 k/w (l - ln(1 + l)))/chi with l = chi v, at its deepest.
fn damping_load_n((law, radii): (&ContactLaw, PairRadii), mobility: f64, load: ContactLoad) -> f64 {
    match *law {
        ContactLaw::HuntCrossley { damping_s_per_m: chi, .. }
        | ContactLaw::Winkler(WinklerFoundation { damping_s_per_m: chi, .. })
            if chi > 0.0 =>
        {
            let stiffness_n_per_m = law.stiffness_at(PEAK_FORCE_N, radii);
            let l = chi * load.speed_m_s;
            let impact_n = libm::sqrt(2.0 * stiffness_n_per_m / mobility * (l - libm::log1p(l))) / chi;
            load.rest_n.max(impact_n)
        }
        ContactLaw::HuntCrossley { .. }
        | ContactLaw::Linear { .. }
        | ContactLaw::HertzLine(_)
        | ContactLaw::Winkler(_)
        | ContactLaw::Power { .. } => PEAK_FORCE_N,
    }
}

fn contact_bounds(name: &str, pair: (&ContactLaw, PairRadii, ContactLoad), mobility: f64) -> [StepBound; 2] {
    longer_bounds(name, pair, mobility, 1.0)
}

/// Bounds of a contact whose spring bears steps so many times as long.
fn longer_bounds(
    name: &str,
    (law, radii, load): (&ContactLaw, PairRadii, ContactLoad),
    mobility: f64,
    longer: f64,
) -> [StepBound; 2] {
    let stiffness = law.stiffness_at(PEAK_FORCE_N, radii) * mobility / (longer * longer);
    let damping = law.damping_at(damping_load_n((law, radii), mobility, load)).max(1e-9) * mobility;
    [
        StepBound { step_s: CONTACT / libm::sqrt(stiffness), cause: format!("contact stiffness at {name}") },
        StepBound {
            step_s: damping_step(law.grows(), stiffness, damping),
            cause: format!("contact damping at {name}"),
        },
    ]
}

/// Step that a damper bears, from k w [1/s2] and c w [1/s].
fn damping_step(grows: bool, stiffness_per_s2: f64, damping_per_s: f64) -> f64 {
    if grows {
        1.0 / libm::sqrt(stiffness_per_s2 + (damping_per_s / GROWING_DAMPING).powi(2))
    } else {
        CONTACT_DAMPING / damping_per_s
    }
}

/// The bound rounded down to two digits: the step that is taken when none is asked for.
pub fn default_step(bound: &StepBound) -> f64 {
    let decade = libm::pow(10.0, libm::floor(libm::log10(bound.step_s)) - 1.0);
    libm::floor(bound.step_s / decade * (1.0 + 1e-12)) * decade
}
