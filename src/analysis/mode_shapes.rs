//! What moves in a mode of a drive, and its motion as frames.

use crate::assemble::resting_state;
use crate::drive::Scheme;
use crate::geometry::{Vec2, perp, unit};
use crate::integrate::explicit::{self, Scratch};
use crate::integrate::{Isa, StepError};
use crate::model::Model;
use crate::recording::capture::Camera;
use crate::recording::frame::{Contacts, Frame};
use crate::statics::{Configuration, Mode};

/// A part of a drive in a mode.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MovingPart {
    /// Path of a coordinate, or links of a sprocket, or of a span with the direction of their motion.
    pub part: String,
    /// Share of the mode's kinetic energy.
    pub share: f64,
}

/// Distance from the pitch line within which links lie on a sprocket, in pitches.
const ON_SPROCKET: f64 = 0.3;

/// Where every link of the chains is: on a sprocket, or between two.
#[derive(Clone, Debug)]
pub struct LinkPlaces {
    /// Names by lane; of spans `FROM-TO`.
    names: Vec<Option<(String, bool)>>,
}

impl LinkPlaces {
    /// At an equilibrium.
    pub fn new(model: &Model, at: &Configuration) -> LinkPlaces {
        let c = &model.chain;
        let mut on: Vec<Option<usize>> = vec![None; c.lanes];
        for (k, sprocket) in model.sprockets.iter().enumerate() {
            let origin = sprocket.frame.origin_at(&at.coordinates);
            for lane in c.loops[sprocket.chain].clone() {
                let pitch_m = 2.0 * c.lever[lane];
                let reach_m = sprocket.geometry.rolling_radius_m() + ON_SPROCKET * pitch_m;
                if (at.links[lane].0 - origin).norm() < reach_m {
                    on[lane] = Some(k);
                }
            }
        }
        let name = |k: Option<usize>| k.map_or("?", |k| model.sprockets[k].name.as_str());
        let mut names = vec![None; c.lanes];
        for l in c.loops.iter().filter(|l| !l.is_empty()) {
            let n = l.len();
            let lane = |i: usize| l.start + i % n;
            for i in 0..n {
                names[lane(i)] = Some(match on[lane(i)] {
                    Some(k) => (name(Some(k)).to_string(), true),
                    None => {
                        let behind = (1..n).find_map(|d| on[lane(i + n - d)]);
                        let ahead = (1..n).find_map(|d| on[lane(i + d)]);
                        (format!("{}-{}", name(behind), name(ahead)), false)
                    }
                });
            }
        }
        LinkPlaces { names }
    }

    /// Links of every span between two sprockets, by lane in the order of the chain, with its name `FROM-TO`. A span has at least two.
    pub fn spans(&self, model: &Model) -> Vec<(String, Vec<usize>)> {
        let mut spans: Vec<(String, Vec<usize>)> = Vec::new();
        for l in model.chain.loops.iter().filter(|l| !l.is_empty()) {
            let is_in_span =
                |lane: usize| self.names[lane].as_ref().filter(|(_, is_wrap)| !is_wrap).map(|(name, _)| name);
            // From a link that no span holds: none is cut where the columns begin.
            let Some(first) = l.clone().find(|lane| is_in_span(*lane).is_none()) else { continue };
            let mut is_open = false;
            for lane in (first..l.end).chain(l.start..first) {
                if let Some(name) = is_in_span(lane) {
                    match spans.last_mut().filter(|_| is_open) {
                        Some((_, lanes)) => lanes.push(lane),
                        None => spans.push((name.clone(), vec![lane])),
                    }
                }
                is_open = is_in_span(lane).is_some();
            }
        }
        spans.retain(|(_, lanes)| lanes.len() > 1);
        spans
    }

    /// Shares of the kinetic energy, the largest first: of what turns or slides by its coordinate; of links on a sprocket together; of links in a span along
    /// it and across it. Rollers count with their links.
    pub fn parts(&self, model: &Model, at: &Configuration, mode: &Mode) -> Vec<MovingPart> {
        let c = &model.chain;
        let mut parts: Vec<MovingPart> = Vec::new();
        let mut add = |part: String, share: f64| match parts.iter_mut().find(|p| p.part == part) {
            Some(p) => p.share += share,
            None => parts.push(MovingPart { part, share }),
        };
        for (coordinate, moved) in model.coordinates.iter().zip(&mode.coordinates) {
            let inverse = coordinate.inverse_inertia();
            if *moved != 0.0 && inverse > 0.0 {
                add(coordinate.path.clone(), moved * moved / inverse);
            }
        }
        for lane in c.links() {
            let Some((name, is_wrap)) = &self.names[lane] else { continue };
            let (d, along) = (mode.links[lane], unit(at.links[lane].1));
            let moved = Vec2::new(d.x, d.y);
            let way = [along, perp(along)].map(|e| c.mass[lane] * moved.dot(&e).powi(2));
            let turning = c.inertia[lane] * d.z * d.z;
            if *is_wrap {
                add(format!("links on {name}"), way[0] + way[1] + turning);
            } else {
                add(format!("span {name} along"), way[0]);
                add(format!("span {name} across"), way[1] + turning);
            }
        }
        let whole: f64 = parts.iter().map(|p| p.share).sum();
        parts.iter_mut().for_each(|p| p.share /= whole);
        parts.sort_by(|a, b| b.share.total_cmp(&a.share));
        parts
    }
}

/// Pitch of the first chain [m]; None: no chain has links.
pub fn pitch_m(model: &Model) -> Option<f64> {
    model.chain.links().next().map(|lane| 2.0 * model.chain.lever[lane])
}

/// Speed of waves across a span of the first chain under a tension [m/s]; None: no chain has links.
pub fn wave_speed_m_s(model: &Model, tension_n: f64) -> Option<f64> {
    let own = model.chain.loops.iter().find(|l| !l.is_empty())?;
    let mass_kg: f64 = own.clone().map(|lane| model.chain.mass[lane]).sum::<f64>() / own.len() as f64;
    Some(libm::sqrt(tension_n.max(0.0) * pitch_m(model)? / mass_kg))
}

/// Longest step for which forces at rest are computed where the drive has another scheme than the leapfrog [s].
const LONGEST_STEP_S: f64 = 1e-6;

/// A mode's motion over whole periods, in real time: frames of the drive at rest whose links and bodies are displaced. Contacts are left out, because the
/// amplitude is for the eye; forces of joints are those at rest.
///
/// # Errors
/// The drive cannot be computed at its equilibrium.
pub fn motion(
    model: &Model,
    at: &Configuration,
    mode: &Mode,
    (amplitude_m, periods, per_period): (f64, u64, u64),
) -> Result<Vec<Frame>, StepError> {
    let state = resting_state(model, at);
    // A step of another scheme may be too long for the means of the leapfrog.
    let leapfrog = model.stepped_by(Scheme::Leapfrog, model.step_s.min(LONGEST_STEP_S));
    let model = if model.scheme == Scheme::Leapfrog { model } else { &leapfrog };
    let mut scratch = Scratch::new(model);
    explicit::evaluate(model, &state, &mut scratch)?;
    let rest = Camera::default().take(model, &state, &scratch);
    let lanes: Vec<usize> = model.chain.links().collect();
    let of_links = lanes.iter().map(|i| libm::hypot(mode.links[*i].x, mode.links[*i].y));
    let reaches = model.coordinates.iter().zip(&mode.coordinates).map(|(c, moved)| (c.reach_m * moved).abs());
    let largest = of_links.chain(reaches).fold(0.0, f64::max);
    let scale = if largest > 0.0 { amplitude_m / largest } else { 0.0 };
    let period_s = 1.0 / mode.frequency_hz();
    let frame = |k: u64| {
        let (s, _) = libm::sincos(std::f64::consts::TAU * k as f64 / per_period as f64);
        let by = scale * s;
        let t_s = period_s * k as f64 / per_period as f64;
        let mut frame = Frame { step: k, t_s, contacts: Contacts::default(), ..rest.clone() };
        for (number, lane) in lanes.iter().enumerate() {
            let d = mode.links[*lane] * by;
            frame.links.x_m[number] += d.x;
            frame.links.y_m[number] += d.y;
            frame.links.angle_rad[number] += d.z;
        }
        for (number, roller) in model.chain.all_rollers().enumerate() {
            let (link, front) = model.chain.bush_carrier(roller);
            let lever_m = model.chain.lever[link] * if front { 1.0 } else { -1.0 };
            let d = mode.links[link] * by;
            let swing = perp(unit(at.links[link].1) * lever_m) * d.z;
            frame.rollers.x_m[number] += d.x + swing.x;
            frame.rollers.y_m[number] += d.y + swing.y;
        }
        for (angle, moved) in frame.rotors.angle_rad.iter_mut().zip(&mode.coordinates) {
            *angle += by * moved;
        }
        let sliding = &mode.coordinates[model.n_turning()..];
        for (way, moved) in frame.sliders.position_m.iter_mut().zip(sliding) {
            *way += by * moved;
        }
        frame.round_to_stored(Isa::detect());
        frame
    };
    Ok((0..=periods * per_period).map(frame).collect())
}
