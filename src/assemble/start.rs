//! The state in which a drive starts: poses and speeds of an equilibrium, and what its contacts remember.

use super::AssemblyError;
use crate::elements::contact_law::PairRadii;
use crate::elements::hydraulics::Chamber;
use crate::geometry::Vec2;
use crate::integrate::explicit;
use crate::integrate::explicit::ends::{EndFinder, LinkPoses};
use crate::model::{Model, SprocketModel};
use crate::pairs::contact_group::ContactGroup;
use crate::pairs::contour_body::FAR_M;
use crate::pairs::part_part::TouchShape;
use crate::pairs::plate_rail::law_radius_m;
use crate::pairs::roller_bush::RestingBush;
use crate::state::State;
use crate::statics::{Configuration, Equilibrium, guide_touches, rail_touches, sensitivity_to_driver};
use crate::units::{sin_cos, wrap_angle};
use std::f64::consts::PI;

/// The equilibrium set in motion.
pub(super) fn moving_state(model: &Model, at: &Equilibrium) -> Result<State, AssemblyError> {
    let (link_rates, coordinate_rates) =
        sensitivity_to_driver(model, &at.configuration).ok_or(AssemblyError::Statics {
            what: "finding speeds consistent with the driver".into(),
            residual_n: at.residual_n,
            iterations: at.iterations,
        })?;
    let mut state = resting_state(model, &at.configuration);
    remember_contacts(model, &at.configuration, &mut state);
    let omega = model.sprockets[model.driver].nominal_speed_rad_s;
    for (i, rate) in link_rates.iter().enumerate() {
        state.links.vx[i] = rate.x * omega;
        state.links.vy[i] = rate.y * omega;
        state.links.omega[i] = rate.z * omega;
    }
    for (k, rate) in coordinate_rates.iter().enumerate() {
        state.coordinates.omega[k] = rate * omega;
    }
    // Rollers move with the links that carry them, as if they were parts of them.
    for roller in model.chain.all_rollers() {
        let (link, _) = model.chain.bush_carrier(roller);
        let l = &mut state.links;
        let (dx, dy, turning) = (l.x[roller] - l.x[link], l.y[roller] - l.y[link], l.omega[link]);
        (l.vx[roller], l.vy[roller]) = (l.vx[link] - turning * dy, l.vy[link] + turning * dx);
        l.omega[roller] = turning;
    }
    put_followers(model, &mut state);
    if let Some(oil) = &model.oil {
        oil.fill(&at.configuration.coordinates, &mut state.oil);
        // Lifters under lifted valves.
        let under = |c: &Chamber| model.cams().any(|cam| c.pistons.iter().any(|(k, _)| *k == cam.follower));
        for (i, _) in oil.chambers.iter().enumerate().filter(|(_, c)| under(c)) {
            let volume = oil.volume_m3(i, &state.coordinates.angle) / state.oil.oil_m3[i];
            state.oil.pressure_pa[i] = oil.oil.pressure_pa(volume, state.oil.pressure_pa[i]);
        }
    }
    Ok(state)
}

/// Puts followers on their cams, as fast as these lift them, with the force of their springs; those on the base circle stay on their seats. The
/// masses of a spring stand and move in proportion. The oil of a lifter is what it was while the valve was closed; its follower is on its cam all round.
fn put_followers(model: &Model, state: &mut State) {
    for (i, touch) in model.touches.iter().enumerate() {
        let TouchShape::Cam(cam) = &touch.shape else { continue };
        let q = &mut state.coordinates;
        let gap = touch.shape.gap(&q.angle);
        let has_lifter = cam.valve != cam.follower;
        if gap.gap_m >= 0.0 {
            continue;
        }
        let lift_m = match has_lifter {
            true => cam.ratio * cam.lift(cam.turn(&q.angle)).lift_m,
            false => q.angle[cam.follower] - cam.ratio * gap.gap_m,
        };
        let omega = cam.turn(&q.omega);
        let speed = -cam.ratio * gap.slope[1] * omega;
        let bend = cam.ratio * gap.bend[2] * omega * omega;
        let inertia_n = |k: usize| 1.0 / model.coordinates[k].inverse_inertia() * bend;
        let gas_n = model.gas_n(i, cam.turn(&q.angle));
        let rests_n = |valve_m: f64| model.valve_spring_n(cam.valve, valve_m) + gas_n;
        let (mut valve_m, mut force) = (lift_m, rests_n(lift_m) - inertia_n(cam.valve));
        if has_lifter {
            let holds_n = |valve_m: f64| rests_n(valve_m) - if valve_m > 0.0 { inertia_n(cam.valve) } else { 0.0 };
            (valve_m, force) = model.on_lifter(cam, lift_m, holds_n);
            force += model.lifter_preload_n(cam) - inertia_n(cam.follower);
        }
        let valve_speed = if valve_m > 0.0 { speed } else { 0.0 };
        (q.angle[cam.follower], q.omega[cam.follower]) = (lift_m, speed);
        (q.angle[cam.valve], q.omega[cam.valve]) = (valve_m, valve_speed);
        let masses = model.spring_masses(cam.valve);
        let parts = (masses.len() + 1) as f64;
        for (n, k) in masses.enumerate() {
            let share = (n + 1) as f64 / parts;
            (q.angle[k], q.omega[k]) = (share * valve_m, share * valve_speed);
        }
        (state.touches.normal_force[i], state.touches.age[i]) = (cam.ratio * force.max(0.0), 1.0);
    }
}

/// A State with the poses of `q`, at rest.
pub fn resting_state(model: &Model, q: &Configuration) -> State {
    let mut state = State::at_rest(&model.layout());
    for (i, (p, angle)) in q.links.iter().enumerate() {
        let (s, c) = sin_cos(*angle);
        (state.links.x[i], state.links.y[i], state.links.cos[i], state.links.sin[i]) = (p.x, p.y, c, s);
    }
    state.coordinates.angle.copy_from_slice(&q.coordinates);
    wrap_angles(model, &mut state.coordinates.angle);
    model.engage_pawls(&mut state.coordinates.angle);
    for (k, angle) in q.coordinates.iter().enumerate() {
        (state.coordinates.sin[k], state.coordinates.cos[k]) = sin_cos(*angle);
    }
    seat_rollers(model, &mut state);
    state
}

/// Puts rollers onto their bushes: where a tooth holds them off, along the normal that all three centres lie on; else in the middle of their
/// play. Their contacts remember what they bear.
fn seat_rollers(model: &Model, state: &mut State) {
    for roller in model.chain.all_rollers() {
        let (link, front) = model.chain.bush_carrier(roller);
        let p = end_of(model, state, link, front);
        (state.links.x[roller], state.links.y[roller]) = (p.x, p.y);
        (state.links.cos[roller], state.links.sin[roller]) = (1.0, 0.0);
    }
    for sprocket in &model.sprockets {
        let Some(bore) = &model.bores[sprocket.chain] else { continue };
        for roller in model.chain.rollers[sprocket.chain].clone() {
            let l = &mut state.links;
            let Some((force, normal)) =
                resting_contact(model, sprocket, Vec2::new(l.x[roller], l.y[roller]), &state.coordinates.angle)
            else {
                continue;
            };
            let off = normal * (bore.clearance_m + bore.penetration_m(force));
            (l.x[roller], l.y[roller]) = (l.x[roller] + off.x, l.y[roller] + off.y);
            for memory in [&mut state.contacts[ContactGroup::Bushes.index()], &mut state.bores] {
                memory.normal_force[roller] = force;
                memory.age[roller] = 1.0;
            }
        }
    }
}

/// Force of a sprocket on a bush at rest, with its roller where it has one, and the normal out of the tooth.
fn resting_contact(model: &Model, sprocket: &SprocketModel, bush: Vec2, coordinates: &[f64]) -> Option<(f64, Vec2)> {
    let teeth = sprocket.geometry.iso()?;
    let angle = coordinates[sprocket.coordinate];
    let held = RestingBush::new(&sprocket.body, model.bores[sprocket.chain].as_ref());
    let in_frame = crate::geometry::rotated(bush - sprocket.frame.origin_at(coordinates), -angle);
    if in_frame.norm() > teeth.tip_radius_m + held.radius_m {
        return None;
    }
    let hit = crate::pairs::bush_gap::gap_contact(teeth, in_frame, held.radius_m);
    let force = held.elastic(hit.touch.penetration_m, hit.body_radius_m).force_n;
    (force > 0.0).then(|| (force, crate::geometry::rotated(hit.touch.normal, angle)))
}

/// One end of a link.
fn end_of(model: &Model, state: &State, link: usize, front: bool) -> Vec2 {
    let (l, lever) = (&state.links, model.chain.lever[link] * if front { 1.0 } else { -1.0 });
    Vec2::new(l.x[link] + lever * l.cos[link], l.y[link] + lever * l.sin[link])
}

/// Takes whole turns off all that turns; off what couplings join, as many; off what spans join, none.
pub(super) fn wrap_angles(model: &Model, angles: &mut [f64]) {
    let before = angles.to_vec();
    for k in (0..model.n_turning()).filter(|k| !model.counts_turns(*k)) {
        let first = model.first_coupled(k);
        angles[k] = if first == k {
            wrap_angle(before[k])
        } else {
            let turns = libm::round((before[first] - wrap_angle(before[first])) / (2.0 * PI));
            before[k] - turns * (2.0 * PI)
        };
    }
}

/// Puts the static contact forces into the memory of the contacts, as if they had been there the step before: a step removes
/// its own force of the step before from the velocities it finds.
fn remember_contacts(model: &Model, q: &Configuration, state: &mut State) {
    for sprocket in model.sprockets.iter().filter(|s| model.bores[s.chain].is_none()) {
        for joint in model.chain.loops[sprocket.chain].clone() {
            let (link, front) = model.chain.bush_carrier(joint);
            let bush = end_of(model, state, link, front);
            if let Some((force, _)) = resting_contact(model, sprocket, bush, &state.coordinates.angle) {
                let memory = state.memory_mut(ContactGroup::Bushes);
                (memory.normal_force[joint], memory.age[joint]) = (force, 1.0);
            }
        }
    }
    for guide in model.guides.iter().filter(|g| g.body.touches_plates) {
        for touch in guide_touches(model, q, guide) {
            let memory = state.memory_mut(ContactGroup::Guides(2 * guide.body.side + usize::from(!touch.front)));
            memory.normal_force[touch.link] = touch.elastic.force_n;
            memory.age[touch.link] = 1.0;
        }
    }
    for rail in &model.rails {
        for (link, part, touch) in rail_touches(model, q, rail) {
            let radii = PairRadii { bush_m: touch.link_radius_m, body_m: law_radius_m(touch.body_radius_m) };
            let memory = state.memory_mut(ContactGroup::Rails(3 * rail.body.side + part as usize));
            memory.normal_force[link] = rail.body.law.elastic(touch.penetration_m, radii).force_n;
            memory.age[link] = 1.0;
        }
    }
    for (i, touch) in model.touches.iter().enumerate() {
        let gap_m = touch.shape.gap(&q.coordinates).gap_m;
        state.touches.normal_force[i] = touch.law.elastic(-gap_m, touch.radii).force_n;
        state.touches.age[i] = if gap_m < 0.0 { 1.0 } else { 0.0 };
    }
    let mut finder = EndFinder::new(model);
    let l = &state.links;
    let poses = LinkPoses::new(model.chain.lanes, |i| (Vec2::new(l.x[i], l.y[i]), l.cos[i], l.sin[i]));
    for (k, body) in model.end_bodies.iter().enumerate() {
        let motion = body.frame.motion(&explicit::coordinate_columns(model, state));
        finder.find(model, (k, motion.origin, (motion.cos, motion.sin)), &poses, FAR_M, |link, front, touch| {
            let radii = PairRadii { bush_m: touch.link_radius_m, body_m: touch.body_radius_m };
            let force = body.law.elastic(touch.penetration_m, radii).force_n;
            if force > 0.0 {
                let memory = &mut state.contacts[ContactGroup::Contours(2 * body.set + usize::from(!front)).index()];
                memory.normal_force[link] = force;
                memory.age[link] = 1.0;
            }
        });
    }
}
