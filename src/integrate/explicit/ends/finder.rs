//! Where contours of links touch bodies, for those who look without a step: equilibria, frames, explanations.

use super::super::{LANES, Scratch};
use super::query::{Cache, Poses, Query, QueryResult};
use super::{BodyInStep, EndSources, LinkSources, from_origin, was_touching};
use crate::geometry::Vec2;
use crate::integrate::{Isa, VectorKernel, vectorised};
use crate::lanes::{LaneBlock, any, blocks, mask};
use crate::model::Model;
use crate::pairs::arc_lanes::{EndContactLanes, NO_CONTACT_M};
use crate::pairs::contact_group::ContactGroup;
use crate::pairs::contour_body::{EndBody, EndTouch, LinkContour};
use crate::state::State;

/// Finds where contours of links touch bodies, outside of a step: for equilibria. Remembers what ends faced last, which changes no bit.
pub(crate) struct EndFinder {
    isa: Isa,
    /// By body, block of the links of its chain, and end.
    caches: Vec<Vec<[Cache; 2]>>,
}

/// Where links are to be looked at: centres and directions, padded to whole blocks.
pub(crate) struct LinkPoses {
    x: Vec<LaneBlock>,
    y: Vec<LaneBlock>,
    cos: Vec<LaneBlock>,
    sin: Vec<LaneBlock>,
}

impl LinkPoses {
    /// `of(i)`: centre, cosine and sine of the heading of link `i`.
    pub(crate) fn new(n: usize, of: impl Fn(usize) -> (Vec2, f64, f64)) -> LinkPoses {
        let count = n.div_ceil(LANES);
        let far_away = [crate::state::FAR_AWAY_M; LANES];
        let (zero, one) = ([0.0; LANES], [1.0; LANES]);
        let mut out =
            LinkPoses { x: vec![far_away; count], y: vec![zero; count], cos: vec![one; count], sin: vec![zero; count] };
        for i in 0..n {
            let (at, lane) = (i / LANES, i % LANES);
            let (centre, cos, sin) = of(i);
            (out.x[at][lane], out.y[at][lane]) = (centre.x, centre.y);
            (out.cos[at][lane], out.sin[at][lane]) = (cos, sin);
        }
        out
    }
}

/// A query of one block, run with a vector unit.
struct BlockQuery<'a> {
    query: Query<'a>,
    contour: &'a LinkContour,
    cache: &'a mut Cache,
}

impl VectorKernel for BlockQuery<'_> {
    type Output = Option<EndContactLanes>;

    #[inline(always)]
    fn run(self) -> Option<EndContactLanes> {
        let mut found = EndContactLanes::none();
        match self.cache.touches(&self.query, self.contour, &mut found) {
            QueryResult::Near => Some(found),
            QueryResult::Apart(_) => None,
        }
    }
}

impl EndFinder {
    pub(crate) fn new(model: &Model) -> EndFinder {
        let of_body = |body: &EndBody| {
            let blocks = model.chain.blocks_of(body.chain);
            blocks.map(|block| [true, false].map(|front| Cache::new(model, body, block, front))).collect()
        };
        EndFinder { isa: Isa::detect(), caches: model.end_bodies.iter().map(of_body).collect() }
    }

    /// Tells link, whether it is its front end, and touch of every end that is nearer than `far_m` to body `k`, whose angle has cosine
    /// and sine `rotor` and which stands at `origin`.
    pub(crate) fn find(
        &mut self,
        model: &Model,
        (k, origin, rotor): (usize, Vec2, (f64, f64)),
        poses: &LinkPoses,
        far_m: f64,
        mut tell: impl FnMut(usize, bool, EndTouch),
    ) {
        let body = &model.end_bodies[k];
        let Some(contour) = &model.contours[body.chain] else { return };
        let levers = &model.chain.lever;
        for (at, caches) in model.chain.blocks_of(body.chain).zip(&mut self.caches[k]) {
            let (x, y, cos, sin) = (&poses.x[at], &poses.y[at], &poses.cos[at], &poses.sin[at]);
            let (from_x, from_y) = from_origin(origin, x, y);
            let within = |i: usize| {
                let link = at * LANES + i;
                let centre = Vec2::new(from_x[i], from_y[i]);
                mask(model.chain.is_link(link) && body.within_reach(centre, levers[link]))
            };
            let own = std::array::from_fn(within);
            if !any(&own) {
                continue;
            }
            for (cache, front) in caches.iter_mut().zip([true, false]) {
                let lever = |i: usize| if front { levers[at * LANES + i] } else { 0.0 - levers[at * LANES + i] };
                let joint_x = std::array::from_fn(|i| x[i] + lever(i) * cos[i]);
                let joint_y = std::array::from_fn(|i| y[i] + lever(i) * sin[i]);
                let query = Query {
                    body,
                    front,
                    rotor,
                    far_m,
                    extent_m: 0.0,
                    details: true,
                    own: &own,
                    poses: Poses { x: from_x, y: from_y, cos, sin },
                    origin,
                    joint_x: &joint_x,
                    joint_y: &joint_y,
                };
                if let Some(found) = vectorised(self.isa, BlockQuery { query, contour, cache }) {
                    for i in (0..LANES).filter(|i| found.penetration[*i] != NO_CONTACT_M) {
                        tell(at * LANES + i, front, found.touch(i));
                    }
                }
            }
        }
    }
}

impl Scratch {
    /// Tells link, whether it is its front end, and touch of every end that touches body `k` at this node or may within the step, of blocks
    /// in which something touches, or of the block of link `only`: the step has found them, they are looked at once more for what it does
    /// not keep.
    pub(crate) fn end_touches(
        &self,
        model: &Model,
        state: &State,
        k: usize,
        only: Option<usize>,
        mut tell: impl FnMut(usize, bool, EndTouch),
    ) {
        let body = &model.end_bodies[k];
        let Some(contour) = &model.contours[body.chain] else { return };
        let (count, first_block) = (model.chain.padded / LANES, model.chain.blocks_of(body.chain).start);
        let far_m = super::closable_gap_m(model, self.fastest_m_s);
        let links = LinkSources::new(model, state, (&self.omega, &self.wrapped), count);
        let of_chain = (model, contour, self.contour_extents_m[body.chain]);
        let meeting = BodyInStep::new(of_chain, state, body, (self.fastest_m_s, true));
        let near = self.end_windows[k].iter().flat_map(|w| w.start / LANES..(w.end / LANES).min(count));
        for at in near.filter(|at| only.is_none_or(|link| link / LANES == *at)) {
            for (rear, sign, ends) in [(0, 1.0, &self.front), (1, -1.0, &self.rear)] {
                let end = &self.end_blocks[k][at - first_block][rear];
                let ages = blocks(&self.contacts[ContactGroup::Contours(2 * body.set + rear).index()].age, count);
                if !was_touching(&ages[at], &end.own) {
                    continue;
                }
                let ends = EndSources::new(ends, sign, count);
                let query = Query::new(&links, far_m, &meeting, (&ends, at), &end.own);
                let mut cache = end.cache.clone();
                if let Some(found) = vectorised(self.isa, BlockQuery { query, contour, cache: &mut cache }) {
                    for i in (0..LANES).filter(|i| found.penetration[*i] != NO_CONTACT_M) {
                        tell(at * LANES + i, rear == 0, found.touch(i));
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assemble::at_rest;
    use crate::drive::{BUNDLED, Drive};
    use crate::pairs::contour_body::{FAR_M, LinkPose};
    use crate::units::sin_cos;

    /// Over two links and on near-rigid parts, besides the bundled drives.
    const OVER_TWO_LINKS: [&str; 6] = [
        "chain.smartchain.handover=two_links",
        "sprockets.driven.teeth=20",
        "sprockets.driven.x_mm=240",
        "sprockets.driven.root_relief_um=30",
        "chain.smartchain.links=80",
        "loads.constant.driven.torque_nm=10",
    ];

    #[test]
    fn ends_are_found_where_the_search_that_knows_nothing_finds_them() {
        let mut seed = 0x2545_f491_4f6c_dd1d_u64;
        let mut random = || {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        for (name, sets) in
            [("silent-20-40", &[][..]), ("smartchain-20-40", &[]), ("smartchain-20-40", &OVER_TWO_LINKS)]
        {
            let text = BUNDLED.iter().find(|b| b.0 == name).expect("a bundled drive").1;
            let sets: Vec<String> = sets.iter().map(|s| (*s).to_string()).collect();
            let drive = Drive::parse(name, text, &sets).unwrap_or_else(|e| panic!("{e}"));
            let (model, rest) = at_rest(&drive).unwrap_or_else(|e| panic!("{e}"));
            let (n, contour) = (model.chain.n_links, model.contours[0].as_ref().expect("contours"));
            let mut finder = EndFinder::new(&model);
            let (mut compared, mut farthest_m) = (0, 0.0_f64);
            for round in 0..200 {
                // From micrometres and a thousandth of a radian to a good part of a link.
                let spread = if round % 4 == 0 { 1e-3 } else { 2e-5 };
                let moved: Vec<(Vec2, f64, f64)> = rest
                    .configuration
                    .links
                    .iter()
                    .map(|(p, heading)| {
                        let (sin, cos) = sin_cos(heading + spread * 50.0 * random());
                        (p + Vec2::new(random(), random()) * spread, cos, sin)
                    })
                    .collect();
                let poses = LinkPoses::new(n, |i| moved[i]);
                for (k, body) in model.end_bodies.iter().enumerate() {
                    let angle =
                        body.frame.turn.map_or(0.0, |r| rest.configuration.coordinates[r] + spread * 10.0 * random());
                    let (sin, cos) = sin_cos(angle);
                    let mut found = std::collections::BTreeMap::new();
                    finder.find(&model, (k, body.frame.origin, (cos, sin)), &poses, FAR_M, |link, front, touch| {
                        found.insert((link, front), touch);
                    });
                    for (link, (p, cos_link, sin_link)) in moved.iter().enumerate() {
                        for front in [true, false] {
                            let lever = model.chain.lever[link];
                            let pose = LinkPose {
                                centre: p - body.frame.origin,
                                cos: *cos_link,
                                sin: *sin_link,
                                lever: if front { lever } else { -lever },
                                front,
                                row: link % model.rows.len(),
                            };
                            let within = body.within_reach(pose.centre, lever);
                            let exact = within.then(|| body.touch(contour, &pose, (cos, sin), FAR_M)).flatten();
                            let exact = exact.filter(|touch| touch.penetration_m > -FAR_M);
                            let own = found.get(&(link, front));
                            let at = format!("{name}, {}, link {link}, round {round}: {own:?}, {exact:?}", body.name);
                            assert_eq!(own.is_some(), exact.is_some(), "{at}");
                            let (Some(own), Some(exact)) = (own, exact) else { continue };
                            let off_m = (own.penetration_m - exact.penetration_m).abs();
                            assert!(off_m < 3e-15, "{off_m:e} m off: {at}");
                            // In hollows the search stops at 3e-7 rad, where the gap is right to rounding.
                            let rounding_rad = if exact.body_radius_m < 0.0 { 1e-7 } else { 1e-12 };
                            assert!((own.normal - exact.normal).norm() < rounding_rad, "{at}");
                            assert!((own.point - exact.point).norm() < rounding_rad * 10e-3, "{at}");
                            assert_eq!(own.body_radius_m, exact.body_radius_m, "{at}");
                            assert_eq!(own.link_radius_m, exact.link_radius_m, "{at}");
                            assert_eq!((own.tooth, own.segment), (exact.tooth, exact.segment), "{at}");
                            farthest_m = farthest_m.max(off_m);
                            compared += 1;
                        }
                    }
                }
            }
            println!("{name}: {compared} touches, none off by more than {farthest_m:.1e} m");
            assert!(compared > 10_000);
        }
    }

    /// No motion shorter than the clearance of an end makes it touch.
    #[test]
    fn flanks_touch_nothing_within_their_clearance() {
        let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
        let mut random = || {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let text = BUNDLED.iter().find(|b| b.0 == "silent-20-40").expect("a bundled drive").1;
        let drive = Drive::parse("silent-20-40", text, &[]).unwrap_or_else(|e| panic!("{e}"));
        let (model, rest) = at_rest(&drive).unwrap_or_else(|e| panic!("{e}"));
        let contour = model.contours[0].as_ref().expect("flanks");
        let (n, extent_m) = (model.chain.n_links, contour.extent_m().max(model.chain.lever[0]));
        let (mut compared, mut closest) = (0, f64::INFINITY);
        for round in 0..400 {
            let spread = if round % 2 == 0 { 2e-3 } else { 2e-4 };
            let moved: Vec<(Vec2, f64)> = rest.configuration.links[..n]
                .iter()
                .map(|(p, heading)| (p + Vec2::new(random(), random()) * spread, heading + spread * 100.0 * random()))
                .collect();
            for body in &model.end_bodies {
                let rotor = body.frame.turn.map_or((1.0, 0.0), |r| {
                    let (sin, cos) = sin_cos(rest.configuration.coordinates[r]);
                    (cos, sin)
                });
                let columns = |of: &dyn Fn(usize) -> f64| -> LaneBlock { std::array::from_fn(of) };
                for at in 0..n / LANES {
                    let place = |i: usize| moved[at * LANES + i];
                    let (x, y) = (
                        columns(&|i| place(i).0.x - body.frame.origin.x),
                        columns(&|i| place(i).0.y - body.frame.origin.y),
                    );
                    let (cos, sin) = (columns(&|i| sin_cos(place(i).1).1), columns(&|i| sin_cos(place(i).1).0));
                    for front in [true, false] {
                        let sign = if front { 1.0 } else { -1.0 };
                        let lever = |i: usize| sign * model.chain.lever[at * LANES + i];
                        let joint_x = columns(&|i| x[i] + body.frame.origin.x + lever(i) * cos[i]);
                        let joint_y = columns(&|i| y[i] + body.frame.origin.y + lever(i) * sin[i]);
                        let own = [u64::MAX; LANES];
                        let poses = Poses { x, y, cos: &cos, sin: &sin };
                        let query = Query {
                            body,
                            front,
                            rotor,
                            far_m: 1e-9,
                            extent_m,
                            details: false,
                            own: &own,
                            poses,
                            origin: body.frame.origin,
                            joint_x: &joint_x,
                            joint_y: &joint_y,
                        };
                        let mut cache = Cache::new(&model, body, at, front);
                        let mut found = EndContactLanes::none();
                        _ = cache.touches(&query, contour, &mut found);
                        let Cache::Flanks(flanks) = &cache else { panic!("flanks") };
                        let clear = crate::integrate::explicit::flanks::gaps(&query, flanks).at_least_m;
                        for i in 0..LANES {
                            let link = at * LANES + i;
                            let touch = |centre: Vec2, heading: f64| {
                                let (sin, cos) = sin_cos(heading);
                                let row = link % model.rows.len();
                                let pose = LinkPose { centre, cos, sin, lever: lever(i), front, row };
                                body.touch(contour, &pose, rotor, 0.0).map_or(f64::NEG_INFINITY, |t| t.penetration_m)
                            };
                            let (centre, heading) = (place(i).0 - body.frame.origin, place(i).1);
                            if clear[i] <= 0.0 || clear[i] > 2e-3 {
                                continue;
                            }
                            // All of the way in one direction, or part of it and a turn for the rest.
                            for _ in 0..4 {
                                let share = random() + 0.5;
                                let (sin, cos) = sin_cos(7.0 * random());
                                let way = Vec2::new(cos, sin) * (clear[i] * share * 0.999);
                                let turn = clear[i] * (1.0 - share) * 0.999 / extent_m
                                    * if random() < 0.0 { -1.0 } else { 1.0 };
                                let depth = touch(centre + way, heading + turn);
                                assert!(
                                    depth <= 0.0,
                                    "{}, link {link}: clear by {:e}, {depth:e} deep",
                                    body.name,
                                    clear[i]
                                );
                                compared += 1;
                            }
                            closest = closest.min(clear[i]);
                        }
                    }
                }
            }
        }
        println!("{compared} motions, the shortest clearance {closest:e} m");
        assert!(compared > 50_000);
    }
}
