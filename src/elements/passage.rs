//! What oil flows through: orifices, annular gaps, check balls.
//!
//! ```text
//! orifice      Q = C_d A sqrt(2/rho) dp / (dp^2 + dp_c^2)^(1/4),  dp_c = (rho/2) (Re_c mu / (rho D C_d))^2
//! annular leak Q = pi d c^3 (1 + 1.5 e^2) dp / (12 mu l) + b v,   b = pi d c / 2
//! check ball   orifice of A(x) = 1/sqrt(1/A_slit^2 + 1/A_seat^2), A_slit = pi r s (1 + R/D),  and + b v,
//!              b = pi r^2 - 2 C_d A_slit (A/A_slit)^2 r/D
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
}

/// A round hole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orifice {
    pub diameter_m: f64,
    pub discharge: f64,
    pub transition_reynolds: f64,
}

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
        }
    }

    /// The coordinate of a wall that moves along it, and its b [m2].
    pub fn wall(&self, q: &[f64]) -> Option<(usize, f64)> {
        match self {
            FlowLaw::Orifice(_) => None,
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
