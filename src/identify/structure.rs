//! Analysis of the structure: orders that coincide by the counts of teeth and links, the detectable size of each
//! effect, and effects that these records cannot distinguish.

use super::candidates::Hypothesis;
use super::screen::{LinearisedBase, ScreeningResult};
use crate::drive::chains::gcd;
use crate::effects::{Effect, Look, Physics, gap_error, named, pitch_error, sprocket_runout, tight_joint};
use crate::machine::{Machine, Target};
use serde::Serialize;

/// Two coinciding periods of a chain drive.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Collision {
    /// The period concerned.
    pub of: String,
    /// It equals a multiple of this.
    pub with: String,
    pub harmonic: u32,
    pub says: String,
}

/// Detection limit of a hypothesis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Detectable {
    pub effect: String,
    /// Parameter, and its size at four standard deviations of the residual, in its unit.
    pub parameter: String,
    pub smallest: f64,
}

/// Two hypotheses that look alike in these records.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IndistinguishablePair {
    pub a: String,
    pub b: String,
    pub angle_deg: f64,
}

/// Collisions of orders by teeth z and links N: exact, from integers.
pub fn collisions(toothed: &[(String, u32)], links: Option<u32>) -> Vec<Collision> {
    let mut found = Vec::new();
    for (name, z) in toothed {
        if z % 2 == 0 {
            found.push(Collision {
                of: "two links".into(),
                with: format!("{name} once per revolution"),
                harmonic: z / 2,
                says: format!(
                    "z = {z} is even: alternate pitch comes back {} times a turn of `{name}`, and cannot be told from a tooth error of that order by order alone",
                    z / 2
                ),
            });
        }
        if let Some(n) = links {
            let g = gcd(u64::from(n), u64::from(*z)) as u32;
            let (loops, turns) = (z / g, n / g);
            if loops == 1 {
                found.push(Collision {
                    of: "chain loop".into(),
                    with: format!("{name} once per revolution"),
                    harmonic: turns,
                    says: format!(
                        "N = {n} is {turns} times z = {z}: one link always meets the same tooth of `{name}`, so that harmonic {turns} of the chain loop is its revolution, and one link or joint cannot be separated from runout or a tooth of `{name}` by order; a chain re-hung by one link would, or one with {} links",
                        n + 1
                    ),
                });
            } else if loops <= 6 {
                found.push(Collision {
                    of: format!("{loops} chain loops"),
                    with: format!("{name}, {turns} revolutions"),
                    harmonic: turns,
                    says: format!("link and tooth of `{name}` meet again after {turns} revolutions, {loops} loops"),
                });
            }
        }
    }
    for (i, (a, za)) in toothed.iter().enumerate() {
        for (b, zb) in &toothed[i + 1..] {
            let (small, large, zs, zl) = if za <= zb { (a, b, za, zb) } else { (b, a, zb, za) };
            if zl % zs == 0 {
                found.push(Collision {
                    of: format!("{large} once per revolution"),
                    with: format!("{small} once per revolution"),
                    harmonic: zl / zs,
                    says: format!(
                        "{zl} teeth are {} times {zs}: order {} of `{large}` is order 1 of `{small}`; only the pattern over channels separates them",
                        zl / zs,
                        zl / zs
                    ),
                });
            }
        }
    }
    found
}

/// Paths of effects all of whose orders are also orders of this effect, because the tooth count divides the link count:
/// a tooth or runout always meets the same links, and one link the same tooth.
pub fn locked_orders(m: &Machine, effect: &Effect, target: Target) -> Vec<String> {
    const ON_SPROCKETS: [&Effect; 2] = [&sprocket_runout::ROW, &gap_error::ROW];
    const ON_LINKS: [&Effect; 2] = [&pitch_error::ROW, &tight_joint::ROW];
    let divides = |b: usize| {
        let teeth = m.bodies[b].teeth.filter(|z| *z > 0);
        teeth.zip(m.chain_at(b)).is_some_and(|(z, chain)| chain.links.is_multiple_of(z))
    };
    let places = |effects: &[&'static Effect]| {
        let of = |e: &&'static Effect| m.targets(e).into_iter().map(|(name, at)| (*e, name, at)).collect::<Vec<_>>();
        let all: Vec<_> = effects.iter().flat_map(of).collect();
        all.into_iter().map(|(e, name, at)| (format!("effects.{}.{name}", e.name), at))
    };
    // Whether this chain passes the teeth of this body.
    let passes = |chain: Target, b: usize| matches!(chain, Target::Chain(c) if m.chains[c].sprockets.contains(&b));
    match target {
        Target::Body(b) if ON_SPROCKETS.contains(&effect) && divides(b) => {
            // Both would mean the same: only the first is returned.
            let on = places(&ON_LINKS).filter(|(_, t)| passes(*t, b));
            on.map(|(path, _)| path).take(1).collect()
        }
        Target::Chain(_) if ON_LINKS.contains(&effect) => {
            // Runout stands for both.
            let meets = |t: Target| matches!(t, Target::Body(b) if divides(b) && passes(target, b));
            places(&ON_SPROCKETS[..1]).filter(|(_, t)| meets(*t)).map(|(path, _)| path).collect()
        }
        Target::Body(_)
        | Target::Spring(_)
        | Target::Input(_)
        | Target::Sensor(_)
        | Target::Chain(_)
        | Target::Part(_)
        | Target::Span(_) => Vec::new(),
    }
}

/// Collisions of orders in every chain of a machine.
pub fn collisions_of(m: &Machine) -> Vec<Collision> {
    if m.chains.is_empty() {
        let all = m.bodies.iter().filter_map(|b| Some((b.name.clone(), b.teeth?)));
        return collisions(&all.collect::<Vec<_>>(), None);
    }
    m.chains.iter().flat_map(|chain| collisions(&m.toothed(chain), Some(chain.links))).collect()
}

/// Detection limit of every hypothesis, once for each effect and place.
pub fn detectable(
    m: &Machine,
    base: &LinearisedBase,
    hypotheses: &[Hypothesis],
    screenings: &[ScreeningResult],
) -> Vec<Detectable> {
    let sigma = libm::sqrt(base.cost() / base.residual.len().max(1) as f64);
    let mut found: Vec<Detectable> = Vec::new();
    for (h, p) in hypotheses.iter().zip(screenings) {
        let (Some(first), Some(column)) = (h.amplitudes().first().copied(), p.columns.first()) else { continue };
        // A hypothesis that is not linear at small values has no slope.
        if h.rows[first].off != 0.0 {
            continue;
        }
        let size = libm::sqrt(column.iter().map(|x| x * x).sum::<f64>());
        let keys = m.keys(h.effect, h.target);
        if size > 0.0 && found.iter().all(|f| f.effect != h.identity()) {
            found.push(Detectable {
                effect: h.identity(),
                parameter: keys[first].0.clone(),
                smallest: 4.0 * sigma / size / h.rows[first].unit,
            });
        }
    }
    found
}

/// Pairs whose columns are nearly parallel, within 15 degrees.
pub fn indistinguishable_pairs(
    hypotheses: &[Hypothesis],
    screenings: &[ScreeningResult],
) -> Vec<IndistinguishablePair> {
    let bases: Vec<(usize, Vec<Vec<f64>>)> = screenings
        .iter()
        .enumerate()
        .filter(|(i, p)| {
            let id = hypotheses[*i].identity();
            !p.columns.is_empty() && (0..*i).all(|j| hypotheses[j].identity() != id)
        })
        .map(|(i, p)| (i, super::fit::orthonormal(&p.columns)))
        .filter(|(_, b)| !b.is_empty())
        .collect();
    let mut found = Vec::new();
    for (n, (i, a)) in bases.iter().enumerate() {
        for (j, b) in &bases[n + 1..] {
            if a.len() != b.len() {
                continue;
            }
            // The smallest share of a unit vector of one subspace that lies in the other.
            let mut least: f64 = 1.0;
            for x in a {
                let held: f64 = b
                    .iter()
                    .map(|y| {
                        let d: f64 = x.iter().zip(y).map(|(x, y)| x * y).sum();
                        d * d
                    })
                    .sum();
                least = least.min(held);
            }
            let angle = libm::acos(libm::sqrt(least.clamp(0.0, 1.0))).to_degrees();
            if angle < 15.0 {
                found.push(IndistinguishablePair {
                    a: hypotheses[*i].identity(),
                    b: hypotheses[*j].identity(),
                    angle_deg: angle,
                });
            }
        }
    }
    found.sort_by(|x, y| x.angle_deg.total_cmp(&y.angle_deg));
    found
}

/// An experiment that would distinguish two effects.
pub fn experiment(a: &str, b: &str) -> String {
    let name = |path: &str| path.split('.').nth(1).unwrap_or(path).split(' ').next().unwrap_or(path).to_string();
    let (a, b) = (name(a), name(b));
    let look = |name: &str| named(name).and_then(|effect| effect.kin.look);
    let is_clock = |name: &str| named(name).is_some_and(|effect| matches!(effect.physics, Physics::OwnClock(_)));
    if is_clock(&a) || is_clock(&b) {
        return "an event that both files show, such as a knock or a common trigger, at both ends of a long record"
            .into();
    }
    use Look::{Chain, Friction, Lag, Marks, OncePerTurn};
    let text = match (look(&a), look(&b)) {
        (Some(Friction), Some(Friction)) => {
            "a record with slow reversals and one at a much higher steady speed: the laws differ most at both ends"
        }
        (Some(OncePerTurn), Some(Marks)) | (Some(Marks), Some(OncePerTurn)) => {
            "a second sensor on the same shaft, or the same run with another inertia on it: an error of marks keeps its share of the interval, what a torque does falls with the inertia; \
             speed alone parts a constant torque from marks, an unbalance not"
        }
        (Some(Marks), Some(Marks)) => {
            "a record at twice the speed: spacing keeps its share of the interval, strength its time"
        }
        (Some(OncePerTurn | Chain), Some(Chain)) | (Some(Chain), Some(OncePerTurn)) => {
            "the chain hung on again, shifted by one link, or a chain with a link count that the teeth do not divide"
        }
        (Some(OncePerTurn), Some(OncePerTurn)) => {
            "the same records at a second speed: unbalance grows with its square, runout and torque stay"
        }
        (Some(Lag), Some(Lag)) => {
            "a sweep of the input up to the highest frequency that the samples show, and a sensor of known response beside this one"
        }
        (Some(Friction | OncePerTurn | Marks | Chain | Lag) | None, _) => {
            return format!(
                "a record in which `{a}` and `{b}` act differently: another speed, load or direction, or a sensor nearer to one of them"
            );
        }
    };
    text.to_string()
}
