//! Place and depth of every tooth gap, and the form of all, from where links touch.
//!
//! Every contact tells a point s of the contour and its normal n there, in the frame of the sprocket turned back by its gap's angle. The
//! contour is known by its support h = s . n over the direction theta of n: of an arc h = A + B cos(theta) + C sin(theta), with A its radius
//! (negative: concave) and (B, C) its centre. All gaps of a sprocket share one such arc for each of their segments; a gap that lies beside
//! its place by (outward, sideways) has h larger by outward cos(theta) + sideways sin(theta). An eccentric sprocket is one whose gaps all lie
//! beside their places by one vector of the sprocket. Rings and what they carry are told the same way, over the whole turn.
//!
//! A gap that no link touches tells nothing of its contour; the joints that run over it tell how far they sink into it.

use super::least_squares::{NormalEquations, Solution};
use super::links::JointPass;
use super::{ContactLawFit, ContactLawSums, Estimate, Topology};
use crate::recording::frame::{Feature, Frame, Header, Segment};
use crate::statistics::{median, middle};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Contacts of a gap from which its place is told.
const SAMPLES: usize = 8;
/// Share of each column that holds unknowns at zero which the samples do not tell: lines have one direction only. Of common arcs, and of
/// the sideways shift of single gaps, whose links may come to rest at one spot: what cannot be told apart counts as depth.
const RIDGE: f64 = 1e-9;
const SIDEWAYS_RIDGE: f64 = 1e-4;
/// Gaps that must share an arc: what fewer touch is no common form.
const SHARED_BY: usize = 4;
/// Spread of the normals from which the radius of an arc is told [rad].
const SPREAD_RAD: f64 = 0.05;
/// A ring is round if its points lie on a circle within this [m].
const ROUND_M: f64 = 0.5e-6;
/// Share of the scatter of gaps that a wave must have to be one. assumed: most of it.
const WAVE: f64 = 0.5;
/// A gap is compared with those that lie within this robust deviation of the others [m]; the others do not form the common arc.
const ODD_M: f64 = 2e-6;
/// Most passes in which odd gaps and eccentricity are taken out of the common arcs. Places along the turn and the arcs' centres are told by much the
/// same normals, and settle slowly.
const PASSES: usize = 400;
/// As many where a gap has fewer contacts than this in the median: what few contacts hardly tell would drift far off its place.
const FEW_PASSES: usize = 5;
const MANY_SAMPLES: f64 = 100.0;
/// Way of a gap in a pass below which all has settled [m].
const SETTLED_M: f64 = 1e-9;
/// Joints this much nearer to the axis than the pitch line [pitches], or further, lie on the sprocket. assumed: a
/// chord of a polygon of 18 teeth and more lies 0.05 pitches inside its circle, the next joint of a span further.
const NEAR: f64 = 0.2;
/// Unknowns of a ring's support over a turn: a constant, cosine and sine of once a turn, and of once, twice, three times a tooth.
const RING_UNKNOWNS: usize = 9;

type ArcSums = NormalEquations<3>;

/// Sums over the contacts of one sprocket.
#[derive(Clone, Debug, Default)]
struct SprocketSums {
    /// Sums for the arc that each segment of each gap lies on, by gap and segment.
    arcs: BTreeMap<(u32, u32), ArcSums>,
    /// Sum of the points that links touch, in the frame of their gap, and their number; by segment.
    points: BTreeMap<u32, ([f64; 2], usize)>,
    ring: NormalEquations<RING_UNKNOWNS>,
    /// The same without waves.
    circle: ArcSums,
    /// Contacts with teeth, and with the ring.
    law: ContactLawSums,
    ring_law: ContactLawSums,
    /// Friction over normal force of contacts with teeth that slide.
    friction: NormalEquations<1>,
    /// Frames in which a bush or a flank pushes in a gap, by gap.
    seated: Vec<usize>,
    /// Frames in which a joint lies over it.
    over: Vec<usize>,
    /// Least distance of such a joint from the axis [m].
    lowest_m: Vec<f64>,
    /// Angle in the first frame, and in the last [rad].
    turned: Option<(f64, f64)>,
    has_seats: bool,
}

/// A tooth gap.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GapFit {
    /// How far it lies beside its place, against the median of all gaps and less eccentricity [m].
    pub outward_m: Option<Estimate>,
    pub sideways_m: Option<Estimate>,
    /// Frames in which something pushes in it, over frames in which a joint lies over it.
    pub seated: usize,
    pub over: usize,
    /// Least radius of a joint over it, against the median of all gaps [m].
    pub sinks_m: f64,
}

/// A part of the contour that all gaps share, where links touch it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchedForm {
    /// A [`Segment`].
    pub segment: u32,
    /// Radius (negative: concave) and centre in the frame of gap 0 [m].
    pub arc: [f64; 3],
    /// Mean of the points that were touched, in the frame of gap 0 [m].
    pub point_m: [f64; 2],
    /// Mean direction of the normals, and their standard deviation [rad].
    pub direction_rad: f64,
    pub spread_rad: f64,
    pub samples: usize,
}

impl TouchedForm {
    /// Points of the contour with their normals: in the middle of where it is touched, and to both sides where the normals spread enough to
    /// tell the arc.
    pub fn places(&self) -> Vec<([f64; 2], [f64; 2])> {
        let [radius, x, y] = self.arc;
        let (sin, cos) = crate::units::sin_cos(self.direction_rad);
        // Along the normal as the arc says, across it where the points lie.
        let (along, across) = (radius + x * cos + y * sin, self.point_m[1] * cos - self.point_m[0] * sin);
        let mut places = vec![([along * cos - across * sin, along * sin + across * cos], [cos, sin])];
        if self.spread_rad >= SPREAD_RAD {
            places.extend([-1.0, 1.0].map(|turn| {
                let (sin, cos) = crate::units::sin_cos(self.direction_rad + turn * self.spread_rad);
                ([x + radius * cos, y + radius * sin], [cos, sin])
            }));
        }
        places
    }

    /// Radius, where the normals spread enough to tell it [m].
    pub fn radius_m(&self) -> Option<f64> {
        (self.spread_rad >= SPREAD_RAD).then_some(self.arc[0].abs())
    }
}

/// A wave of the gaps' places round a sprocket.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlaceWave {
    /// Waves a turn.
    pub order: usize,
    pub amplitude_m: f64,
}

/// The toothing of a sprocket.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SprocketFit {
    pub gaps: Vec<GapFit>,
    /// Turns from the first frame to the last.
    pub turns: f64,
    /// Size [m] and direction [rad], from gap 0 counterclockwise, of where its gaps lie beside its axis.
    pub eccentricity_m: Option<Estimate>,
    pub eccentric_towards_rad: f64,
    /// What all gaps share, by segment.
    pub forms: Vec<TouchedForm>,
    /// The wave that the places of the gaps along the turn follow, where there is one.
    pub wave: Option<PlaceWave>,
    /// Radius of the seats' arc, where normals spread enough to tell it [m].
    pub seat_radius_m: Option<Estimate>,
    /// The contact law, fitted to all contacts with teeth.
    pub law: ContactLawFit,
    /// Friction coefficient of contacts with teeth.
    pub friction: Option<Estimate>,
    pub ring_law: ContactLawFit,
    pub ring_radius_m: Option<Estimate>,
    pub ring_eccentricity_m: Option<Estimate>,
    pub ring_towards_rad: f64,
}

/// Sums over all sprockets, in the order of `Header::bodies`.
#[derive(Clone, Debug)]
pub struct GapPass {
    sprockets: Vec<SprocketSums>,
}

impl GapPass {
    pub fn new(header: &Header) -> GapPass {
        let of = |teeth: u32| SprocketSums {
            seated: vec![0; teeth as usize],
            over: vec![0; teeth as usize],
            lowest_m: vec![f64::INFINITY; teeth as usize],
            ..SprocketSums::default()
        };
        GapPass { sprockets: header.bodies.iter().filter(|b| b.rotor).map(|b| of(b.teeth)).collect() }
    }

    pub fn take(&mut self, frame: &Frame, header: &Header, joints: &JointPass, topology: &Topology) {
        let c = &frame.contacts;
        for (body, (sums, info)) in self.sprockets.iter_mut().zip(&header.bodies).enumerate() {
            let (origin, angle) = info.pose(frame);
            sums.turned = Some((sums.turned.map_or(angle, |(first, _)| first), angle));
            for row in (0..c.link.len()).filter(|row| c.body[*row] as usize == body) {
                let in_gap = c.tooth[row] < info.teeth;
                if c.penetration_m[row] <= 0.0 || !in_gap {
                    continue;
                }
                let n = [c.normal_x[row], c.normal_y[row]];
                let s = [c.point_body_x_m[row] - origin[0], c.point_body_y_m[row] - origin[1]];
                let support = s[0] * n[0] + s[1] * n[1];
                let direction = crate::units::atan2(n[1], n[0]) - angle;
                let is_ring = c.segment[row] == Segment::Ring as u32;
                // A force that would pull is clipped at zero, and does not follow the law.
                if c.instant_force_n[row] > 0.0 {
                    let law = if is_ring { &mut sums.ring_law } else { &mut sums.law };
                    law.add(c.penetration_m[row], c.normal_speed_m_s[row], c.instant_force_n[row]);
                }
                if !is_ring && !c.stick[row] && c.normal_force_n[row] > 0.0 {
                    sums.friction.add([c.normal_force_n[row]], c.tangential_force_n[row].abs());
                }
                if is_ring {
                    let waves = ring_waves(direction, info.teeth);
                    sums.ring.add(waves, support);
                    sums.circle.add([1.0, waves[1], waves[2]], support);
                    continue;
                }
                let theta = direction - 2.0 * PI * f64::from(c.tooth[row]) / f64::from(info.teeth);
                let (sin, cos) = crate::units::sin_cos(theta);
                sums.arcs.entry((c.tooth[row], c.segment[row])).or_default().add([1.0, cos, sin], support);
                let (sum, count) = sums.points.entry(c.segment[row]).or_default();
                let (turn_sin, turn_cos) = crate::units::sin_cos(theta - crate::units::atan2(n[1], n[0]));
                *sum = [sum[0] + s[0] * turn_cos - s[1] * turn_sin, sum[1] + s[0] * turn_sin + s[1] * turn_cos];
                *count += 1;
                sums.seated[c.tooth[row] as usize] += 1;
                sums.has_seats |= c.feature[row] <= Feature::FrontBush as u32 || Feature::is_roller(c.feature[row]);
            }
            sums.look_at_joints(frame, (origin, angle, info.teeth), joints, topology);
        }
    }

    pub fn fits(&self) -> Vec<SprocketFit> {
        self.sprockets.iter().map(SprocketSums::fit).collect()
    }
}

fn ring_waves(direction_rad: f64, teeth: u32) -> [f64; RING_UNKNOWNS] {
    let wave = |order: f64| crate::units::sin_cos(order * direction_rad);
    let z = f64::from(teeth);
    let (s1, c1) = wave(1.0);
    let ((sz, cz), (s2, c2), (s3, c3)) = (wave(z), wave(2.0 * z), wave(3.0 * z));
    [1.0, c1, s1, cz, sz, c2, s2, c3, s3]
}

impl SprocketSums {
    /// Which joints lie over which gap, and how near to the axis.
    fn look_at_joints(
        &mut self,
        frame: &Frame,
        (origin, angle, teeth): ([f64; 2], f64, u32),
        joints: &JointPass,
        topology: &Topology,
    ) {
        if teeth == 0 {
            return;
        }
        let pitch_rad = 2.0 * PI / f64::from(teeth);
        let half_sin = crate::units::sin_cos(0.5 * pitch_rad).0;
        for (i, chain) in topology.chain.iter().enumerate() {
            let pitch_m = topology.pitch_m[*chain];
            let pitch_radius_m = 0.5 * pitch_m / half_sin;
            let at = joints.front_end(frame, i);
            let radius = libm::hypot(at[0] - origin[0], at[1] - origin[1]);
            if (radius - pitch_radius_m).abs() > NEAR * pitch_m {
                continue;
            }
            let turned = (crate::units::atan2(at[1] - origin[1], at[0] - origin[0]) - angle) / pitch_rad;
            let off = turned - libm::round(turned);
            if off.abs() > NEAR {
                continue;
            }
            let gap = libm::round(turned).rem_euclid(f64::from(teeth)) as usize;
            if let (Some(over), Some(lowest)) = (self.over.get_mut(gap), self.lowest_m.get_mut(gap)) {
                *over += 1;
                *lowest = lowest.min(radius);
            }
        }
    }

    /// The arc that all gaps share in a segment, without those that lie elsewhere; `beside`: how far each gap lies beside its place, by the
    /// sprocket's eccentricity and by itself.
    fn common(&self, odd: &[bool], beside: &[[f64; 2]]) -> BTreeMap<u32, [f64; 3]> {
        self.common_sums(odd, beside).into_iter().filter_map(|(s, arc)| Some((s, arc.solve(RIDGE)?.value))).collect()
    }

    fn common_sums(&self, odd: &[bool], beside: &[[f64; 2]]) -> BTreeMap<u32, ArcSums> {
        let (mut sums, mut gaps): (BTreeMap<u32, ArcSums>, BTreeMap<u32, usize>) = Default::default();
        for ((gap, segment), arc) in self.arcs.iter().filter(|((gap, _), _)| !odd[*gap as usize]) {
            let (mut own, e) = (*arc, beside[*gap as usize]);
            own.xy = std::array::from_fn(|i| arc.xy[i] - e[0] * arc.xx[i][1] - e[1] * arc.xx[i][2]);
            sums.entry(*segment).or_default().join(&own);
            *gaps.entry(*segment).or_default() += 1;
        }
        sums.retain(|segment, _| gaps.get(segment).is_some_and(|n| *n >= SHARED_BY));
        sums
    }

    /// How far each gap lies beside the common arcs: outwards, sideways, as sums of their equations.
    fn shift(&self, gap: u32, common: &BTreeMap<u32, [f64; 3]>) -> NormalEquations<2> {
        let mut shift = NormalEquations::<2>::default();
        for ((_, segment), arc) in self.arcs.range((gap, 0)..=(gap, u32::MAX)) {
            let Some(p) = common.get(segment) else { continue };
            // A gap's shift explains what the common arc p leaves of the support: h - p . (1, cos, sin), on the columns cos and sin.
            let left = |i: usize| arc.xy[i] - (0..3).map(|k| p[k] * arc.xx[k][i]).sum::<f64>();
            for i in 0..2 {
                for j in 0..2 {
                    shift.xx[i][j] += arc.xx[i + 1][j + 1];
                }
                shift.xy[i] += left(i + 1);
            }
            let whole = |i: usize, j: usize| p[i] * p[j] * arc.xx[i][j];
            let squares: f64 = (0..3).flat_map(|i| (0..3).map(move |j| (i, j))).map(|(i, j)| whole(i, j)).sum();
            shift.yy += arc.yy - 2.0 * (0..3).map(|k| p[k] * arc.xy[k]).sum::<f64>() + squares;
            shift.samples += arc.samples;
        }
        shift
    }

    fn fit(&self) -> SprocketFit {
        let teeth = self.seated.len();
        let mut odd = vec![false; teeth];
        let mut eccentric: Option<Solution<2>> = None;
        let (mut shifts, mut common) = (vec![None; teeth], BTreeMap::new());
        let mut beside = vec![[0.0; 2]; teeth];
        let samples = median(self.seated.iter().filter(|n| **n > 0).map(|n| *n as f64));
        for _ in 0..if samples < MANY_SAMPLES { FEW_PASSES } else { PASSES } {
            common = self.common(&odd, &beside);
            let sums: Vec<NormalEquations<2>> = (0..teeth).map(|g| self.shift(g as u32, &common)).collect();
            eccentric = eccentricity(&sums, &odd);
            let ways: Vec<[f64; 2]> =
                (0..teeth).map(|g| eccentric.map_or([0.0; 2], |e| seen_from(e.value, g, teeth))).collect();
            let own =
                |(s, way): (&NormalEquations<2>, &[f64; 2])| (s.samples >= SAMPLES).then(|| held(s, *way).solve(0.0));
            shifts = sums.iter().zip(&ways).map(own).map(Option::flatten).collect();
            let middle_of = |i: usize| median(shifts.iter().flatten().map(|s| s.value[i]));
            let centre = [middle_of(0), middle_of(1)];
            let mut moved_m = 0.0_f64;
            for ((beside, shift), way) in beside.iter_mut().zip(&shifts).zip(&ways) {
                let own = shift.map_or([0.0; 2], |s| [s.value[0] - centre[0], s.value[1] - centre[1]]);
                let next = [way[0] + own[0], way[1] + own[1]];
                moved_m = moved_m.max((next[0] - beside[0]).abs()).max((next[1] - beside[1]).abs());
                *beside = next;
            }
            let outward: Vec<f64> = shifts.iter().flatten().map(|s| s.value[0]).collect();
            let (centre, scatter) = middle(&outward);
            let odd_before = odd.clone();
            for (g, shift) in shifts.iter().enumerate() {
                odd[g] = shift.is_some_and(|s| (s.value[0] - centre).abs() > (6.0 * scatter).max(ODD_M));
            }
            if moved_m < SETTLED_M && odd == odd_before {
                break;
            }
        }
        let forms = self.common_sums(&odd, &beside);
        let forms = forms.iter().filter_map(|(segment, sums)| {
            let (sum, count) = self.points.get(segment)?;
            let point = sum.map(|v| v / *count as f64);
            form(*segment, sums, common.get(segment)?, point)
        });
        let forms = forms.collect();
        self.told(&shifts, eccentric.map(|e| (e, self.samples())), forms)
    }

    fn samples(&self) -> usize {
        self.seated.iter().sum()
    }

    fn told(
        &self,
        shifts: &[Option<Solution<2>>],
        eccentric: Option<(Solution<2>, usize)>,
        forms: Vec<TouchedForm>,
    ) -> SprocketFit {
        let middle_of = |i: usize| median(shifts.iter().flatten().map(|s| s.value[i]));
        let (outward, sideways) = (middle_of(0), middle_of(1));
        let lowest = median(self.lowest_m.iter().copied().filter(|r| r.is_finite()));
        let gap = |(g, shift): (usize, &Option<Solution<2>>)| {
            let of = |i: usize, centre: f64| {
                let samples = self.seated[g];
                shift.map(|s| Estimate { value: s.value[i] - centre, error: s.error[i], samples })
            };
            GapFit {
                outward_m: of(0, outward),
                sideways_m: of(1, sideways),
                seated: self.seated[g],
                over: self.over[g],
                sinks_m: self.lowest_m[g] - lowest,
            }
        };
        let friction = self.friction.solve(0.0).filter(|_| self.friction.samples >= SAMPLES);
        let ring = self.ring.solve(0.0);
        let circle = self.circle.solve(0.0).filter(|c| c.residual <= ROUND_M);
        let seat = forms.iter().find(|f| f.segment == Segment::Seat as u32).filter(|_| self.has_seats);
        let seat = seat.and_then(|f| Some(Estimate { value: f.radius_m()?, error: 0.0, samples: f.samples }));
        SprocketFit {
            gaps: shifts.iter().enumerate().map(gap).collect(),
            turns: self.turned.map_or(0.0, |(first, last)| (last - first).abs() / (2.0 * PI)),
            eccentricity_m: eccentric.map(|(e, samples)| Estimate {
                value: libm::hypot(e.value[0], e.value[1]),
                error: libm::hypot(e.error[0], e.error[1]),
                samples,
            }),
            eccentric_towards_rad: eccentric.map_or(0.0, |(e, _)| crate::units::atan2(e.value[1], e.value[0])),
            wave: wave(shifts, sideways),
            seat_radius_m: seat,
            forms,
            law: self.law.fit(),
            friction: friction.map(|f| Estimate::of(&f, 0, self.friction.samples)),
            ring_law: self.ring_law.fit(),
            ring_radius_m: circle.map(|c| Estimate::of(&c, 0, self.circle.samples)),
            ring_eccentricity_m: ring.map(|r| Estimate {
                value: libm::hypot(r.value[1], r.value[2]),
                error: libm::hypot(r.error[1], r.error[2]),
                samples: self.ring.samples,
            }),
            ring_towards_rad: ring.map_or(0.0, |r| crate::units::atan2(r.value[2], r.value[1])),
        }
    }
}

/// The common arc of a segment, with where it is touched.
fn form(segment: u32, sums: &ArcSums, arc: &[f64; 3], point_m: [f64; 2]) -> Option<TouchedForm> {
    let n = sums.samples as f64;
    let (cos, sin) = (sums.xx[0][1] / n, sums.xx[0][2] / n);
    // Normals that spread little have a mean of nearly unit length: what it lacks is half their variance.
    let spread_rad = (2.0 * (1.0 - libm::hypot(cos, sin))).max(0.0).sqrt();
    let direction_rad = crate::units::atan2(sin, cos);
    let samples = sums.samples;
    (samples >= SAMPLES).then_some(TouchedForm { segment, arc: *arc, point_m, direction_rad, spread_rad, samples })
}

/// The wave that most of the scatter of the gaps' places along the turn belongs to; None where there is none, or gaps are unknown.
fn wave(shifts: &[Option<Solution<2>>], centre: f64) -> Option<PlaceWave> {
    let places: Vec<f64> = shifts.iter().map(|s| s.map(|s| s.value[1] - centre)).collect::<Option<_>>()?;
    let n = places.len() as f64;
    let mean = places.iter().sum::<f64>() / n;
    let variance = places.iter().map(|p| (p - mean) * (p - mean)).sum::<f64>() / n;
    let of = |order: usize| {
        let sum = places.iter().enumerate().fold([0.0; 2], |sum, (g, p)| {
            let (sin, cos) = crate::units::sin_cos(2.0 * PI * (order * g) as f64 / n);
            [sum[0] + p * cos, sum[1] + p * sin]
        });
        PlaceWave { order, amplitude_m: 2.0 / n * libm::hypot(sum[0], sum[1]) }
    };
    let largest = (2..places.len().div_ceil(2)).map(of).max_by(|a, b| a.amplitude_m.total_cmp(&b.amplitude_m))?;
    (0.5 * largest.amplitude_m * largest.amplitude_m >= WAVE * variance).then_some(largest)
}

/// The equations of what is left of one gap's shift beside a known way; sideways it is held near zero.
fn held(shift: &NormalEquations<2>, way: [f64; 2]) -> NormalEquations<2> {
    let mut left = *shift;
    let pulled: [f64; 2] = std::array::from_fn(|i| shift.xx[i][0] * way[0] + shift.xx[i][1] * way[1]);
    left.xy = std::array::from_fn(|i| shift.xy[i] - pulled[i]);
    left.yy += (0..2).map(|i| way[i] * (pulled[i] - 2.0 * shift.xy[i])).sum::<f64>();
    left.xx[1][1] += SIDEWAYS_RIDGE * shift.samples as f64;
    left
}

/// A vector of the sprocket, as a gap sees it: outwards, sideways.
fn seen_from(vector: [f64; 2], gap: usize, teeth: usize) -> [f64; 2] {
    let (sin, cos) = crate::units::sin_cos(2.0 * PI * gap as f64 / teeth as f64);
    [vector[0] * cos + vector[1] * sin, vector[1] * cos - vector[0] * sin]
}

/// The vector by which all gaps lie beside the axis.
fn eccentricity(sums: &[NormalEquations<2>], odd: &[bool]) -> Option<Solution<2>> {
    let mut all = NormalEquations::<2>::default();
    let teeth = sums.len();
    for (g, shift) in sums.iter().enumerate().filter(|(g, s)| !odd[*g] && s.samples >= SAMPLES) {
        let (to, across) = (seen_from([1.0, 0.0], g, teeth), seen_from([0.0, 1.0], g, teeth));
        let columns = [to, across];
        let mut own = NormalEquations::<2> { yy: shift.yy, samples: shift.samples, ..NormalEquations::default() };
        for i in 0..2 {
            for j in 0..2 {
                own.xx[i][j] =
                    (0..2).map(|a| (0..2).map(|b| columns[i][a] * shift.xx[a][b] * columns[j][b]).sum::<f64>()).sum();
            }
            own.xy[i] = columns[i][0] * shift.xy[0] + columns[i][1] * shift.xy[1];
        }
        all.join(&own);
    }
    let usable = sums.iter().filter(|s| s.samples >= SAMPLES).count();
    (2 * usable > teeth).then(|| all.solve(RIDGE)).flatten()
}
