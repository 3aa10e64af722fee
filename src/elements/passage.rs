//! What oil flows through: orifices, annular gaps, check balls, pipes.
//!
//! ```text
//! orifice      Q = C_d A sqrt(2/rho) dp / (dp^2 + dp_c^2)^(1/4),  dp_c = (rho/2) (Re_c mu / (rho D C_d))^2
//! annular leak Q = pi d c^3 (1 + 1.5 e^2) dp / (12 mu l) + b v,   b = pi d c / 2
//! check ball   orifice of A(x) = 1/sqrt(1/A_slit^2 + 1/A_seat^2), A_slit = pi r s (1 + R/D),  and + b v,
//!              b = pi r^2 - 2 C_d A_slit (A/A_slit)^2 r/D
//! pipe         Q = A V(dp),  y = D sqrt(2 D dp/(rho L)) rho/mu = Re sqrt(f)
//!              laminar Re = y^2/64;  turbulent Re = -2 y log10(e/(3.7 D) + 2.51/y)   (Colebrook, which holds the pressure's own y)
//! ```
//! Q flows from the first end to the second with dp = p_first - p_second. The orifice is Merritt's (1967, section 3.4): turbulent above dp_c,
//! laminar with C_d = delta sqrt(Re) below, Re_c = (C_d/delta)^2. d, c, l, e: diameter, radial gap, length and relative eccentricity of a
//! plunger in its bore (Merritt, section 2.5). A ball of radius R on an edge of radius r, lifted by x: D = sqrt((h + x)^2 + r^2) from the edge to
//! its centre, h = sqrt(R^2 - r^2), slit s = D - R, frustum of the slit pi s (r + r R/D). The oil flows at its density at ambient pressure.
//!
//! **Walls.** A wall that moves with v along a passage (the plunger's skin, the ball) drags b v through it and feels b dp: the same b, so that the
//! power of the one is that of the other. Of a plunger: half of the gap's area (Couette), with its force on the skin; the shear, mu pi d l v
//! / (c sqrt(1 - e^2)), is a damper of its coordinate. With A the plunger's own area, the gap so makes a piston of the mean diameter. Of a
//! ball: the seat's area less the momentum of the jet (flow force, Merritt, section 5.6, velocity coefficient 1).
//

use super::oil::Oil;
use std::f64::consts::PI;

/// Re_c of a sharp-edged round orifice: (0.611/0.2)^2. Source: Merritt 1967, eq. 3-42.
pub const TRANSITION_REYNOLDS: f64 = 9.3;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FlowLaw {
    Orifice(Orifice),
    /// Conductance [m3/(s Pa)], and the coordinate whose wall moves along it from the first end to the second, with its b [m2].
    Leak {
        conductance: f64,
        wall: Option<(usize, f64)>,
    },
    Check(CheckBall),
    Pipe(Pipe),
}

/// A round hole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orifice {
    pub diameter_m: f64,
    pub discharge: f64,
    pub transition_reynolds: f64,
}

/// A long round pipe that is full of oil. The inertia of its oil and what the flow loses at its ends are left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pipe {
    pub diameter_m: f64,
    pub length_m: f64,
    /// Height of sand grains that are as rough, at most [`ROUGHEST`] of the diameter.
    pub roughness_m: f64,
}

/// Roughest pipe over its diameter: of rougher ones the curve between the two flows could fall.
pub const ROUGHEST: f64 = 0.01;
/// Re sqrt(f) where laminar flow ends, at Re = 2000, and from which on it is turbulent, at about Re = 4000 in a smooth pipe. Between them the flow is
/// not certain: a smooth curve joins both. Source: White, Fluid Mechanics (2011), section 6.6.
const LAMINAR_END: f64 = 357.770_876_399_966_35;
const TURBULENT_FROM: f64 = 800.0;

/// A ball on the edge of a seat; it opens from the first end to the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckBall {
    /// Its lift [m].
    pub coordinate: usize,
    pub seat_radius_m: f64,
    pub ball_radius_m: f64,
    pub discharge: f64,
    pub transition_reynolds: f64,
}

/// Annular gap between a plunger and its bore.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnnularGap {
    pub diameter_m: f64,
    pub gap_m: f64,
    pub length_m: f64,
    /// Distance of the axes over the gap, 0 to below 1.
    pub eccentricity: f64,
}

impl AnnularGap {
    /// [m3/(s Pa)].
    pub fn conductance(&self, viscosity_pa_s: f64) -> f64 {
        let AnnularGap { diameter_m: d, gap_m: c, length_m: l, eccentricity: e } = *self;
        PI * d * c * c * c * (1.0 + 1.5 * e * e) / (12.0 * viscosity_pa_s * l)
    }

    /// b of the moving skin [m2].
    pub fn wall_m2(&self) -> f64 {
        0.5 * PI * self.diameter_m * self.gap_m
    }

    /// Shear of the moving skin [N s/m].
    pub fn damping_n_s_per_m(&self, viscosity_pa_s: f64) -> f64 {
        let AnnularGap { diameter_m: d, gap_m: c, length_m: l, eccentricity: e } = *self;
        viscosity_pa_s * PI * d * l / (c * libm::sqrt(1.0 - e * e))
    }
}

/// Flow at one pressure difference.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PassageFlow {
    /// Without what walls drag [m3/s].
    pub rate_m3_s: f64,
    /// Its derivative by the pressure difference [m3/(s Pa)].
    pub slope: f64,
}

/// Flow through a sharp-edged opening with this area and hydraulic diameter.
fn orifice_flow(
    oil: &Oil,
    area_m2: f64,
    diameter_m: f64,
    (discharge, reynolds): (f64, f64),
    drop_pa: f64,
) -> PassageFlow {
    if area_m2 <= 0.0 {
        return PassageFlow::default();
    }
    let slow = reynolds * oil.viscosity_pa_s / (oil.density_kg_m3 * diameter_m * discharge);
    let transition_pa = 0.5 * oil.density_kg_m3 * slow * slow;
    let square = drop_pa * drop_pa + transition_pa * transition_pa;
    let fourth = libm::sqrt(libm::sqrt(square));
    let scale = discharge * area_m2 * libm::sqrt(2.0 / oil.density_kg_m3);
    PassageFlow {
        rate_m3_s: scale * drop_pa / fourth,
        slope: scale * (1.0 - 0.5 * drop_pa * drop_pa / square) / fourth,
    }
}

/// The opening of a lifted ball: areas of slit and both in series [m2], width of the slit [m], and the jet's share along the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Opening {
    slit_m2: f64,
    area_m2: f64,
    width_m: f64,
    cosine: f64,
}

impl CheckBall {
    fn opening(&self, lift_m: f64) -> Option<Opening> {
        if lift_m <= 0.0 {
            return None;
        }
        let (r, ball) = (self.seat_radius_m, self.ball_radius_m);
        let height = libm::sqrt(ball * ball - r * r) + lift_m;
        let distance = libm::sqrt(height * height + r * r);
        let width_m = distance - ball;
        let slit_m2 = PI * r * width_m * (1.0 + ball / distance);
        let seat_m2 = PI * r * r;
        let area_m2 = slit_m2 * seat_m2 / libm::sqrt(slit_m2 * slit_m2 + seat_m2 * seat_m2);
        Some(Opening { slit_m2, area_m2, width_m, cosine: r / distance })
    }

    /// b of the ball [m2].
    pub fn wall_m2(&self, lift_m: f64) -> f64 {
        let seat_m2 = PI * self.seat_radius_m * self.seat_radius_m;
        let Some(o) = self.opening(lift_m) else { return seat_m2 };
        let share = o.area_m2 / o.slit_m2;
        seat_m2 - 2.0 * self.discharge * o.slit_m2 * share * share * o.cosine
    }

    fn flow(&self, oil: &Oil, lift_m: f64, drop_pa: f64) -> PassageFlow {
        let Some(o) = self.opening(lift_m) else { return PassageFlow::default() };
        let diameter_m = f64::min(2.0 * o.width_m, 2.0 * self.seat_radius_m);
        orifice_flow(oil, o.area_m2, diameter_m, (self.discharge, self.transition_reynolds), drop_pa)
    }
}

impl Pipe {
    /// Logarithm of Re of the turbulent flow, and its derivative by that of y.
    fn turbulent(&self, y: f64) -> (f64, f64) {
        let argument = self.roughness_m / (3.7 * self.diameter_m) + 2.51 / y;
        let re = -2.0 * y * libm::log10(argument);
        (libm::log(re), 1.0 + 2.0 * 2.51 / (argument * std::f64::consts::LN_10 * re))
    }

    fn flow(&self, oil: &Oil, drop_pa: f64) -> PassageFlow {
        let Pipe { diameter_m: d, length_m: l, .. } = *self;
        let area_m2 = 0.25 * PI * d * d;
        let laminar = area_m2 * d * d / (32.0 * oil.viscosity_pa_s * l);
        let kinematic_m2_s = oil.viscosity_pa_s / oil.density_kg_m3;
        let y = d * libm::sqrt(2.0 * d * drop_pa.abs() / (oil.density_kg_m3 * l)) / kinematic_m2_s;
        if y <= LAMINAR_END {
            return PassageFlow { rate_m3_s: laminar * drop_pa, slope: laminar };
        }
        let (log_re, slope) = if y >= TURBULENT_FROM {
            self.turbulent(y)
        } else {
            // Hermite's cubic over log y between the ends of both flows: it rises for all pipes up to the roughest.
            let width = libm::log(TURBULENT_FROM / LAMINAR_END);
            let x = libm::log(y / LAMINAR_END) / width;
            let (from, from_slope) = (libm::log(LAMINAR_END * LAMINAR_END / 64.0), 2.0 * width);
            let (to, to_slope) = self.turbulent(TURBULENT_FROM);
            let (rise, to_slope) = (to - from, to_slope * width);
            let (second, third) = (3.0 * rise - 2.0 * from_slope - to_slope, from_slope + to_slope - 2.0 * rise);
            (
                from + x * (from_slope + x * (second + x * third)),
                (from_slope + x * (2.0 * second + 3.0 * x * third)) / width,
            )
        };
        let rate_m3_s = area_m2 * libm::exp(log_re) * kinematic_m2_s / d;
        // y grows with the root of the pressure.
        PassageFlow { rate_m3_s: rate_m3_s.copysign(drop_pa), slope: 0.5 * slope * rate_m3_s / drop_pa.abs() }
    }
}

impl FlowLaw {
    /// At a pressure difference, coordinates standing at `q`.
    pub fn flow(&self, oil: &Oil, q: &[f64], drop_pa: f64) -> PassageFlow {
        match self {
            FlowLaw::Orifice(o) => {
                let area_m2 = 0.25 * PI * o.diameter_m * o.diameter_m;
                orifice_flow(oil, area_m2, o.diameter_m, (o.discharge, o.transition_reynolds), drop_pa)
            }
            FlowLaw::Leak { conductance, .. } => PassageFlow { rate_m3_s: conductance * drop_pa, slope: *conductance },
            FlowLaw::Check(check) => check.flow(oil, q[check.coordinate], drop_pa),
            FlowLaw::Pipe(pipe) => pipe.flow(oil, drop_pa),
        }
    }

    /// The coordinate of a wall that moves along it, and its b [m2].
    pub fn wall(&self, q: &[f64]) -> Option<(usize, f64)> {
        match self {
            FlowLaw::Orifice(_) | FlowLaw::Pipe(_) => None,
            FlowLaw::Leak { wall, .. } => *wall,
            FlowLaw::Check(check) => Some((check.coordinate, check.wall_m2(q[check.coordinate]))),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests {
    use super::*;

    fn oil() -> Oil {
        Oil { density_kg_m3: 850.0, viscosity_pa_s: 0.02, bulk_modulus_pa: 1.5e9, air_share: 0.0, air_exponent: 1.3 }
    }

    /// The orifice's ends: turbulent C_d A sqrt(2 dp/rho); laminar C_d = 0.2 sqrt(Re), Q = 2 (0.2)^2 A D dp / mu.
    #[test]
    fn orifices_are_turbulent_and_laminar() {
        let (o, oil) = (Orifice { diameter_m: 1e-3, discharge: 0.611, transition_reynolds: 9.332_025 }, oil());
        let area = 0.25 * PI * 1e-6;
        let law = FlowLaw::Orifice(o);
        let turbulent = law.flow(&oil, &[], 1e7).rate_m3_s;
        assert!((turbulent / (0.611 * area * libm::sqrt(2e7 / 850.0)) - 1.0).abs() < 1e-3, "{turbulent:e}");
        let laminar = law.flow(&oil, &[], 1.0).rate_m3_s;
        assert!((laminar / (2.0 * 0.04 * area * 1e-3 / 0.02) - 1.0).abs() < 1e-3, "{laminar:e}");
        for drop in [-2e5, -300.0, 0.0, 5e3, 1e6] {
            let (d, f) = (1e-4 * (f64::abs(drop) + 10.0), |p: f64| law.flow(&oil, &[], p).rate_m3_s);
            let slope = (f(drop + d) - f(drop - d)) / (2.0 * d);
            assert!((law.flow(&oil, &[], drop).slope / slope - 1.0).abs() < 1e-5, "{drop}");
        }
    }

    /// Laminar: Q = pi D^4 dp/(128 mu L). Turbulent: friction factors of Colebrook's equation, solved for f at a given Re by its fixed point, and two
    /// of Moody's chart. The flow rises with the pressure between the two, and its slope is that of differences.
    #[test]
    fn pipes_are_laminar_and_turbulent() {
        let oil = oil();
        let nu = oil.viscosity_pa_s / oil.density_kg_m3;
        let (d, l) = (4e-3_f64, 0.3);
        let drop_of = |re: f64, f: f64| f * l / d * 0.5 * oil.density_kg_m3 * (re * nu / d).powi(2);
        let area = 0.25 * PI * d * d;
        for relative in [0.0, 1e-4, 2e-3, 0.01] {
            let pipe = Pipe { diameter_m: d, length_m: l, roughness_m: relative * d };
            let slow = pipe.flow(&oil, 1e3).rate_m3_s;
            assert!((slow / (PI * d.powi(4) * 1e3 / (128.0 * 0.02 * l)) - 1.0).abs() < 1e-12, "{slow:e}");
            for re in [5e3, 1e4, 1e5, 1e6] {
                let mut f = 0.02_f64;
                for _ in 0..50 {
                    f = (-2.0 * libm::log10(relative / 3.7 + 2.51 / (re * f.sqrt()))).powi(-2);
                }
                let found = pipe.flow(&oil, drop_of(re, f)).rate_m3_s * d / (area * nu);
                assert!((found / re - 1.0).abs() < 1e-9, "Re {re}: {found}");
                assert_eq!(pipe.flow(&oil, -drop_of(re, f)).rate_m3_s, -pipe.flow(&oil, drop_of(re, f)).rate_m3_s);
            }
            let mut before = PassageFlow::default();
            for k in 1..400 {
                let drop = drop_of(1500.0, 64.0 / 1500.0) * 1.02_f64.powi(k);
                let now = pipe.flow(&oil, drop);
                assert!(now.rate_m3_s > before.rate_m3_s && now.slope > 0.0, "{relative}: {drop}");
                let difference = (pipe.flow(&oil, drop * 1.000_01).rate_m3_s - now.rate_m3_s) / (drop * 1e-5);
                assert!((now.slope / difference - 1.0).abs() < 1e-3, "{relative}, {drop}: {} {difference}", now.slope);
                before = now;
            }
        }
        // Moody's chart: f = 0.0309 at Re = 1e4, smooth, and 0.0199 at Re = 1e6, e/D = 1e-3.
        for (re, relative, f) in [(1e4, 0.0, 0.0309), (1e6, 1e-3, 0.0199)] {
            let pipe = Pipe { diameter_m: d, length_m: l, roughness_m: relative * d };
            let found = pipe.flow(&oil, drop_of(re, f)).rate_m3_s * d / (area * nu);
            assert!((found / re - 1.0).abs() < 5e-3, "{found}");
        }
    }

    /// A ball's slit is the frustum between edge and sphere: against the distance of many points of the edge's normal plane.
    #[test]
    fn a_ball_opens_by_its_frustum() {
        let check = CheckBall {
            coordinate: 0,
            seat_radius_m: 2e-3,
            ball_radius_m: 2.5e-3,
            discharge: 0.7,
            transition_reynolds: TRANSITION_REYNOLDS,
        };
        assert_eq!(check.flow(&oil(), 0.0, 1e5), PassageFlow::default());
        assert!((check.wall_m2(-1e-6) / (PI * 4e-6) - 1.0).abs() < 1e-14);
        let o = check.opening(0.4e-3).expect("open");
        // Centre 1.5 mm over the seat when closed: 1.9 mm now.
        let distance = libm::hypot(1.9e-3, 2e-3);
        assert!((o.width_m - (distance - 2.5e-3)).abs() < 1e-15);
        let touching = 2e-3 * 2.5e-3 / distance;
        assert!((o.slit_m2 - PI * o.width_m * (2e-3 + touching)).abs() < 1e-18);
        assert!(o.area_m2 < o.slit_m2 && o.area_m2 < PI * 4e-6);
        // The jet always leaves the oil some force on the ball.
        for lift in [1e-6, 1e-4, 1e-3, 1e-2] {
            assert!(check.wall_m2(lift) > 0.0 && check.wall_m2(lift) < PI * 4e-6, "{lift}");
        }
    }
}
