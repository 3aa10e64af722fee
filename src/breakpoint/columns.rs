//! Whole columns of a step against a bound, a block of lanes at a time: whether any contact, link or joint can fulfil a
//! comparison, and what frames compute at their contacts (sliding, friction, torque) from what the step has kept.

use super::quantities::{Quantity, Scope, What};
use super::scratch::StepValues;
use super::{Operator, SLACK};
use crate::elements::contact_law::{ContactLaw, PairRadii};
use crate::elements::end_contact::EndBody;
use crate::elements::tooth_contact::{Column, LANES, blocks, take};
use crate::integrate::Look;
use crate::integrate::explicit::{MOST_SPROCKETS, Part, Touches, linear_force};
use crate::model::{GuideModel, Model, SprocketModel};

/// Uncertainty of sliding speeds [m/s] and of forces and torques [N, N m] beside [`SLACK`]: rounding of what they are
/// differences of.
pub(super) const SPEED_BLUR_M_S: f64 = 1e-11;
pub(super) const FORCE_BLUR: f64 = 1e-8;
/// Of `1 - cos` of an angle: how far (cos, sin) may be from a unit vector.
const COSINE_BLUR: f64 = 1e-6;

/// Values that fulfil a comparison, made wider by what is uncertain: on one side of a bound.
#[derive(Clone, Copy)]
pub(super) struct Band {
    /// 1: at or above; -1: at or below.
    sign: f64,
    threshold: f64,
    /// Bits of a value that are compared: without the sign where its size is meant.
    bits: u64,
}

impl Band {
    /// None: too few or too many values fulfil it for a look at all of them to pay.
    pub(super) fn new(operator: Operator, bound: f64, absolute: bool, blur: f64) -> Option<Band> {
        let sign = match operator {
            Operator::Above | Operator::AtLeast => 1.0,
            Operator::Below | Operator::AtMost => -1.0,
            Operator::Equal | Operator::Unequal => return None,
        };
        let threshold = sign * bound - (2.0 * SLACK * bound.abs() + blur);
        Some(Band { sign, threshold, bits: if absolute { u64::MAX >> 1 } else { u64::MAX } })
    }

    /// For the squares of what is never negative.
    fn squared(self) -> Band {
        let bound = self.sign * self.threshold;
        let threshold = if bound > 0.0 { self.sign * bound * bound } else { 0.0 };
        // Nothing is below a negative bound.
        let threshold = if bound < 0.0 && self.sign < 0.0 { f64::INFINITY } else { threshold };
        Band { threshold, ..self }
    }

    /// For [`rising`] of angles.
    fn risen(self) -> Band {
        let bound = self.sign * self.threshold;
        let at = if bound.abs() > std::f64::consts::PI { f64::INFINITY } else { 1.0 - libm::cos(bound) };
        Band { threshold: self.sign * libm::copysign(at, bound) - COSINE_BLUR, ..self }
    }

    /// Counts in `found`, lane by lane, in block `b` of `n` links: sums of ones vectorise where a reduction to one bit does not.
    #[inline(always)]
    fn count_links(self, values: &Column, b: usize, n: usize, found: &mut Column) {
        if (b + 1) * LANES <= n {
            self.count(values, &[1.0; LANES], found);
        } else {
            self.count(values, &real(b * LANES, n), found);
        }
    }

    #[inline(always)]
    fn count_all(self, values: &[Column], n: usize, found: &mut Column) {
        for (b, values) in values.iter().enumerate() {
            self.count_links(values, b, n, found);
        }
    }

    /// A value as the threshold is meant.
    pub(super) fn of(self, value: f64) -> f64 {
        self.sign * f64::from_bits(value.to_bits() & self.bits)
    }

    /// Whether values may be in the band, of which the largest on its side is `most`, or `blur` more.
    pub(super) fn is_reached_by(self, most: f64, blur: f64) -> bool {
        most + blur >= self.threshold
    }

    /// Where `counts` is 1.
    #[inline(always)]
    fn count(self, values: &Column, counts: &Column, found: &mut Column) {
        for i in 0..LANES {
            let v = f64::from_bits(values[i].to_bits() & self.bits);
            found[i] += if self.sign * v >= self.threshold { counts[i] } else { 0.0 };
        }
    }
}

/// Rises with the angle of a unit vector from -2 to 2 while that goes from -pi to pi: cheaper than the angle.
#[inline(always)]
fn rising(cos: f64, sin: f64) -> f64 {
    if sin < 0.0 { cos - 1.0 } else { 1.0 - cos }
}

/// [`StepValues::reaches`] of a quantity.
pub(super) struct Reach<'a>(pub(super) &'a StepValues<'a>, pub(super) &'a Quantity, pub(super) Band);

impl Look for Reach<'_> {
    type Seen = Option<Column>;

    #[inline(always)]
    fn look(self) -> Option<Column> {
        self.0.reaches(self.1, self.2)
    }
}

/// [`StepValues::chain_torques`].
pub(super) struct Torques<'a>(pub(super) &'a StepValues<'a>);

/// Torques of the chain on the sprockets, and how uncertain they are [N m].
pub(super) type ChainTorques = ([f64; MOST_SPROCKETS], f64);

impl Look for Torques<'_> {
    type Seen = Option<ChainTorques>;

    #[inline(always)]
    fn look(self) -> Option<ChainTorques> {
        self.0.chain_torques()
    }
}

/// Of the next link each, the first one after the last of `n`; lanes behind that hold anything.
#[inline(always)]
fn next_block(column: &[f64], at: usize, n: usize) -> Column {
    if at + LANES < n {
        return take(column, at + 1);
    }
    let mut out = [0.0; LANES];
    out[..LANES - 1].copy_from_slice(&column[at + 1..at + LANES]);
    out[n - 1 - at] = column[0];
    out
}

/// 1 in lanes of links, 0 in those behind the last.
#[inline(always)]
fn real(at: usize, n: usize) -> Column {
    let mut out = [1.0; LANES];
    if at + LANES > n {
        for i in 0..LANES {
            out[i] = if at + i < n { 1.0 } else { 0.0 };
        }
    }
    out
}

/// Law and friction between a part and what it touches. Effects change them guide by guide.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Pairing {
    pub(super) law: ContactLaw,
    pub(super) mu: f64,
    pub(super) stick_speed_m_s: f64,
}

impl Pairing {
    fn of_sprocket(s: &SprocketModel) -> Pairing {
        Pairing { law: s.body.law, mu: s.body.friction, stick_speed_m_s: s.body.stick_speed_m_s }
    }

    fn of_guide(g: &GuideModel) -> Pairing {
        Pairing { law: g.body.law, mu: g.body.friction, stick_speed_m_s: g.body.stick_speed_m_s }
    }

    fn of_end(b: &EndBody) -> Pairing {
        Pairing { law: b.law, mu: b.friction, stick_speed_m_s: b.stick_speed_m_s }
    }

    /// Of everything that a part can touch; None: they differ from body to body.
    pub(super) fn one(model: &Model, part: Part) -> Option<Pairing> {
        let all: Vec<Pairing> = match part {
            Part::Bushes => model.sprockets.iter().map(Pairing::of_sprocket).collect(),
            Part::Guides(_) => model.guides.iter().map(Pairing::of_guide).collect(),
            Part::Contours(_) => model.end_bodies.iter().filter(|b| part.is_set(b.set)).map(Pairing::of_end).collect(),
        };
        let first = *all.first()?;
        all.iter().all(|other| *other == first).then_some(first)
    }

    /// Between a part and a body (an index as in frames).
    pub(super) fn with(m: &Model, part: Part, body: usize) -> Option<Pairing> {
        match part {
            Part::Bushes => m.sprockets.get(body).map(Pairing::of_sprocket),
            Part::Guides(_) => m.guides.get(body.checked_sub(m.sprockets.len())?).map(Pairing::of_guide),
            Part::Contours(_) => {
                m.end_bodies.iter().find(|b| part.is_set(b.set) && b.body == body).map(Pairing::of_end)
            }
        }
    }
}

impl StepValues<'_> {
    /// How often, lane by lane, a quantity of any contact, link or joint is in a band; None: not looked at as a column.
    #[inline(always)]
    fn reaches(&self, quantity: &Quantity, band: Band) -> Option<Column> {
        let mut found = [0.0; LANES];
        let n = self.model.chain.n_links;
        match quantity.scope {
            Scope::Contact => {
                for part in self.parts {
                    self.contacts_reach(*part, quantity.what, band, &mut found)?;
                }
            }
            Scope::Link => self.links_reach(quantity.what, band, &mut found)?,
            Scope::Joint => {
                let (x, y, torque) = self.scratch.joint_columns();
                if quantity.what == What::Force {
                    let (x, y) = (self.lanes(&x[1..]), self.lanes(&y[1..]));
                    let band = band.squared();
                    for b in 0..x.len() {
                        let mut square = [0.0; LANES];
                        for k in 0..LANES {
                            square[k] = x[b][k] * x[b][k] + y[b][k] * y[b][k];
                        }
                        band.count_links(&square, b, n, &mut found);
                    }
                } else {
                    band.count_all(self.lanes(&torque[1..]), n, &mut found);
                }
            }
            Scope::Impact | Scope::Sprocket | Scope::Energy | Scope::Run => return None,
        }
        Some(found)
    }

    /// All blocks of a column of links or joints.
    #[inline(always)]
    fn lanes<'c>(&self, column: &'c [f64]) -> &'c [Column] {
        blocks(column, self.model.chain.padded / LANES)
    }

    /// [`StepValues::reaches`] of links.
    #[inline(always)]
    fn links_reach(&self, what: What, band: Band, found: &mut Column) -> Option<()> {
        let (l, s, half) = (&self.state.links, self.scratch, 0.5 * self.model.step_s);
        let n = self.model.chain.n_links;
        match what {
            What::Tension => {
                let (x, y, _) = s.joint_columns();
                let (x0, x1) = (self.lanes(x), self.lanes(&x[1..]));
                let (y0, y1) = (self.lanes(y), self.lanes(&y[1..]));
                let (cos, sin) = (self.lanes(&l.cos), self.lanes(&l.sin));
                for b in 0..cos.len() {
                    let mut pull = [0.0; LANES];
                    for k in 0..LANES {
                        pull[k] = -0.5 * ((x0[b][k] + x1[b][k]) * cos[b][k] + (y0[b][k] + y1[b][k]) * sin[b][k]);
                    }
                    band.count_links(&pull, b, n, found);
                }
            }
            What::Speed => {
                let band = band.squared();
                let (u, v) = (self.lanes(&l.vx), self.lanes(&l.vy));
                let (ax, ay) = (self.lanes(&s.ax), self.lanes(&s.ay));
                for b in 0..u.len() {
                    let mut square = [0.0; LANES];
                    for k in 0..LANES {
                        let (u, v) = (u[b][k] + half * ax[b][k], v[b][k] + half * ay[b][k]);
                        square[k] = u * u + v * v;
                    }
                    band.count_links(&square, b, n, found);
                }
            }
            What::VelocityX => self.rates_reach((&l.vx, &s.ax), band, found),
            What::VelocityY => self.rates_reach((&l.vy, &s.ay), band, found),
            What::Omega => self.rates_reach((&l.omega, &s.alpha), band, found),
            What::X => band.count_all(self.lanes(&l.x), n, found),
            What::Y => band.count_all(self.lanes(&l.y), n, found),
            What::Angle => {
                let band = band.risen();
                let (cos, sin) = (self.lanes(&l.cos), self.lanes(&l.sin));
                for b in 0..cos.len() {
                    let mut risen = [0.0; LANES];
                    for k in 0..LANES {
                        risen[k] = rising(cos[b][k], sin[b][k]);
                    }
                    band.count_links(&risen, b, n, found);
                }
            }
            _ => return None,
        }
        Some(())
    }

    /// Velocities at the node.
    #[inline(always)]
    fn rates_reach(&self, (v, a): (&[f64], &[f64]), band: Band, found: &mut Column) {
        let (v, a, half) = (self.lanes(v), self.lanes(a), 0.5 * self.model.step_s);
        for b in 0..v.len() {
            let mut at_node = [0.0; LANES];
            for k in 0..LANES {
                at_node[k] = v[b][k] + half * a[b][k];
            }
            band.count_links(&at_node, b, self.model.chain.n_links, found);
        }
    }

    /// What slides; None: not known as a column for this part.
    #[inline(always)]
    fn contacts_reach(&self, part: Part, what: What, band: Band, found: &mut Column) -> Option<()> {
        if !matches!(what, What::TangentialSpeed | What::TangentialForce | What::Stick) {
            return None;
        }
        let pairing = self.one(part)?;
        let law = match pairing.law {
            ContactLaw::Linear { stiffness_n_per_m, damping_n_s_per_m } => (stiffness_n_per_m, damping_n_s_per_m),
            _ if what == What::TangentialForce => return None,
            _ => (0.0, 0.0),
        };
        let contacts = Contacts::new(self, part, self.scratch.touches(part)?, pairing);
        let (depth, rate) = (self.lanes(self.scratch.depths(part)), self.lanes(self.scratch.closing_speeds(part)));
        let ages = self.lanes(&self.scratch.memory(part).age);
        let busy = self.scratch.touching_blocks(part);
        for b in 0..ages.len() {
            if busy.get(b) == Some(&0) || !any_touching(&ages[b]) {
                continue;
            }
            let mut touching = [0.0; LANES];
            for i in 0..LANES {
                touching[i] = if ages[b][i] > 0.0 { 1.0 } else { 0.0 };
            }
            let slide = contacts.slide(b);
            match what {
                What::TangentialSpeed => band.count(&slide, &touching, found),
                What::TangentialForce => {
                    let normal = normal_force(law, &depth[b], &rate[b]);
                    band.count(&contacts.friction(&normal, &slide), &touching, found);
                }
                _ => {
                    let unsure = 2.0 * SLACK * contacts.stick_speed + SPEED_BLUR_M_S;
                    for bound in [contacts.stick_speed - unsure, contacts.stick_speed + unsure] {
                        let mut sticks = [0.0; LANES];
                        for i in 0..LANES {
                            sticks[i] = if slide[i].abs() < bound { 1.0 } else { 0.0 };
                        }
                        band.count(&sticks, &touching, found);
                    }
                }
            }
        }
        Some(())
    }

    /// As frames add them up from the forces of the node; None: not known here.
    #[inline(always)]
    fn chain_torques(&self) -> Option<ChainTorques> {
        let mut sums = [[0.0; LANES]; MOST_SPROCKETS];
        let mut sizes = [0.0; LANES];
        let n = self.model.chain.n_links;
        let sums_of = sums.get_mut(..self.model.sprockets.len())?;
        for part in self.all_parts.iter().filter(|p| p.turns(self.model)) {
            let pairing = self.one(*part)?;
            let ContactLaw::Linear { stiffness_n_per_m, damping_n_s_per_m } = pairing.law else { return None };
            let law = (stiffness_n_per_m, damping_n_s_per_m);
            let t = self.scratch.touches(*part)?;
            let contacts = Contacts::new(self, *part, t, pairing);
            let ages = self.lanes(&self.scratch.memory(*part).age);
            let depth = self.lanes(self.scratch.depths(*part));
            let rate = self.lanes(self.scratch.closing_speeds(*part));
            let offset = self.lanes(&t.offset);
            for b in 0..ages.len() {
                if !any_touching(&ages[b]) {
                    continue;
                }
                let normal = normal_force(law, &depth[b], &rate[b]);
                let friction = contacts.friction(&normal, &contacts.slide(b));
                let (nx, ny) = (contacts.normal_x[b], contacts.normal_y[b]);
                let (x, y, radius) = (contacts.x[b], contacts.y[b], contacts.radius[b]);
                let (rotor, offset, age) = (contacts.rotor[b], offset[b], ages[b]);
                let real = real(b * LANES, n);
                let mut torque = [0.0; LANES];
                for i in 0..LANES {
                    let (fx, fy) = (normal[i] * nx[i] - friction[i] * ny[i], normal[i] * ny[i] + friction[i] * nx[i]);
                    let all = y[i] * fx - x[i] * fy + radius[i] * friction[i] + offset[i] * normal[i];
                    let arm = 1e-9 * (x[i].abs() + y[i].abs());
                    let touching = (age[i] > 0.0) & (real[i] > 0.0);
                    torque[i] = if touching { all } else { 0.0 };
                    sizes[i] += if touching { normal[i] * arm } else { 0.0 };
                }
                for (k, sum) in sums_of.iter_mut().enumerate() {
                    for i in 0..LANES {
                        sum[i] += if rotor[i] == k as f64 { torque[i] } else { 0.0 };
                    }
                }
            }
        }
        let total = |lanes: Column| lanes.iter().sum::<f64>();
        Some((sums.map(total), total(sizes) + FORCE_BLUR))
    }

    /// Law and friction of everything that a part can touch; None: they differ from body to body.
    fn one(&self, part: Part) -> Option<&Pairing> {
        let at = self.all_parts.iter().position(|p| *p == part)?;
        self.pairings[at].as_ref()
    }

    /// Of what one lane touches.
    pub(super) fn pairing(&self, part: Part, lane: usize) -> Option<Pairing> {
        Pairing::with(self.model, part, self.scratch.partner(self.model, part, lane)?.0)
    }

    /// Of one contact; None: the law needs radii that the step has not kept.
    pub(super) fn normal_force(&self, part: Part, lane: usize) -> Option<f64> {
        let law = self.pairing(part, lane)?.law;
        let touches = self.scratch.touches(part);
        if matches!(law, ContactLaw::HertzLine(_)) && touches.is_none() {
            return None;
        }
        let radii = touches.map_or(PairRadii { bush_m: f64::NAN, body_m: f64::NAN }, |t| PairRadii {
            bush_m: t.radius[lane],
            body_m: t.body_radius[lane],
        });
        let approach = self.scratch.memory(part).approach[lane];
        Some(law.force(self.scratch.depth(part, lane), self.scratch.closing_speed(part, lane), approach, radii))
    }

    /// Sliding speed of one contact.
    pub(super) fn slide_of(&self, part: Part, lane: usize) -> Option<f64> {
        let pairing = self.pairing(part, lane)?;
        Some(Contacts::new(self, part, self.scratch.touches(part)?, &pairing).slide(lane / LANES)[lane % LANES])
    }
}

/// Of a linear law (stiffness, damping).
#[inline(always)]
fn normal_force((k, c): (f64, f64), depth: &Column, rate: &Column) -> Column {
    let mut force = [0.0; LANES];
    for i in 0..LANES {
        force[i] = linear_force(k, c, depth[i], rate[i]);
    }
    force
}

#[inline(always)]
fn any_touching(age: &Column) -> bool {
    let mut any = 0_u64;
    for i in 0..LANES {
        any |= u64::from(age[i] > 0.0);
    }
    any != 0
}

/// What frames compute at the contacts of a part, from what the step has kept of them and the velocities that its last
/// accelerations give at the node.
struct Contacts<'a> {
    values: &'a StepValues<'a>,
    /// vx, vy, omega, and what they gain in a second; heading.
    motion: [&'a [Column]; 8],
    /// Of the links behind the joints, where bushes may be theirs.
    behind: Option<[&'a [f64]; 8]>,
    on_front: &'a [Column],
    lever: &'a [Column],
    /// Of the lever.
    sign: f64,
    normal_x: &'a [Column],
    normal_y: &'a [Column],
    x: &'a [Column],
    y: &'a [Column],
    radius: &'a [Column],
    rotor: &'a [Column],
    mu: f64,
    stick_speed: f64,
}

impl<'a> Contacts<'a> {
    #[inline(always)]
    fn new(values: &'a StepValues<'a>, part: Part, t: &'a Touches, pairing: &Pairing) -> Contacts<'a> {
        let (l, s, c) = (&values.state.links, values.scratch, &values.model.chain);
        let columns: [&[f64]; 8] = [&l.vx, &l.vy, &l.omega, &s.ax, &s.ay, &s.alpha, &l.cos, &l.sin];
        let bushes = part == Part::Bushes;
        Contacts {
            values,
            motion: columns.map(|column| values.lanes(column)),
            behind: bushes.then_some(columns),
            on_front: values.lanes(&c.bush_on_front[1..]),
            lever: values.lanes(if bushes { &c.bush_lever } else { &c.lever }),
            sign: if part.is_front() { 1.0 } else { -1.0 },
            normal_x: values.lanes(&t.normal_x),
            normal_y: values.lanes(&t.normal_y),
            x: values.lanes(&t.x),
            y: values.lanes(&t.y),
            radius: values.lanes(&t.radius),
            rotor: values.lanes(&t.rotor),
            mu: pairing.mu,
            stick_speed: pairing.stick_speed_m_s,
        }
    }

    /// Sliding speeds of block `b` [m/s].
    #[inline(always)]
    fn slide(&self, b: usize) -> Column {
        let half = 0.5 * self.values.model.step_s;
        let [vx, vy, omega, ax, ay, alpha, cos, sin] = [
            self.of(0, b),
            self.of(1, b),
            self.of(2, b),
            self.of(3, b),
            self.of(4, b),
            self.of(5, b),
            self.of(6, b),
            self.of(7, b),
        ];
        let (nx, ny, x, y) = (self.normal_x[b], self.normal_y[b], self.x[b], self.y[b]);
        let (radius, lever) = (self.radius[b], self.lever[b]);
        let turning = self.turning(b);
        let mut slide = [0.0; LANES];
        for i in 0..LANES {
            let lever = self.sign * lever[i];
            let w = omega[i] + half * alpha[i];
            let u = vx[i] + half * ax[i] - w * lever * sin[i];
            let v = vy[i] + half * ay[i] + w * lever * cos[i];
            let outward = x[i] * nx[i] + y[i] * ny[i];
            slide[i] = v * nx[i] - u * ny[i] - w * radius[i] - turning[i] * (outward - radius[i]);
        }
        slide
    }

    /// Column `c` of the motion, of the links that carry block `b`.
    #[inline(always)]
    fn of(&self, c: usize, b: usize) -> Column {
        let front = self.motion[c][b];
        let Some(behind) = &self.behind else { return front };
        let rear = next_block(behind[c], b * LANES, self.values.model.chain.n_links);
        let on_front = self.on_front[b];
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            out[i] = if on_front[i] != 0.0 { front[i] } else { rear[i] };
        }
        out
    }

    /// Speeds of the bodies that block `b` touches [rad/s].
    #[inline(always)]
    fn turning(&self, b: usize) -> Column {
        let values = self.values;
        let mut turning = [0.0; LANES];
        if self.behind.is_none() && self.rotor[b] == [-1.0; LANES] {
            return turning;
        }
        for k in 0..values.model.sprockets.len() {
            let speed = values.state.rotors.omega[k] + 0.5 * values.model.step_s * values.scratch.rotor_alpha[k];
            for i in 0..LANES {
                turning[i] = if self.rotor[b][i] == k as f64 { speed } else { turning[i] };
            }
        }
        turning
    }

    /// Friction forces on the link [N].
    #[inline(always)]
    fn friction(&self, normal: &Column, slide: &Column) -> Column {
        let mut friction = [0.0; LANES];
        for i in 0..LANES {
            let ratio = slide[i] / self.stick_speed;
            let ratio = if ratio > 1.0 { 1.0 } else { ratio };
            let ratio = if ratio < -1.0 { -1.0 } else { ratio };
            friction[i] = -self.mu * normal[i] * ratio;
        }
        friction
    }
}
