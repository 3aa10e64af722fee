//! Stability of links that lie with several contacts on bodies: the scheme, linearised about closed contacts, for a short row.
//!
//! A row of alike links on a line, the last joined to the first, each free to move across the line and to turn; contacts push across
//! it. One step of `integrate::explicit` then is a matrix; where its powers grow, contacts chatter that lie still in truth.
//! ```text
//! joint j          F = k u + c u', u = (y + l t)_j - (y - l t)_(j+1); on link j + 1 at its rear end, on j at its front end
//! contact at s a   penetration d = -(y + s a t), s = +-1; its mean force as in contact_law, of the closed contact
//! ```
//! Contacts of a link are solved for one after the other (`pairs::contour_forces`). Friction and tension are left out: they turn
//! links by far less than contacts do. So are bushes in their gaps: of drives with teeth twice as stiff as rings and four times as
//! damped none chattered. Held against runs of whole drives: tests/convergence.rs.

use crate::elements::contact_law::{self, StepInput};

/// Links of a row, all alike.
#[derive(Clone, Copy, Debug)]
pub(super) struct RowLink {
    pub inverse_mass: f64,
    pub inverse_inertia: f64,
    /// Distance of the joints from the link's centre [m].
    pub lever_m: f64,
    /// Lever of the contacts' normal forces about the link's centre [m].
    pub arm_m: f64,
    pub joint_stiffness_n_per_m: f64,
    pub joint_damping_n_s_per_m: f64,
}

/// One closed contact of a link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RowContact {
    /// At the front end, else at the rear.
    pub front: bool,
    pub stiffness_n_per_m: f64,
    pub damping_n_s_per_m: f64,
}

/// The contacts of every link, in the order in which a step looks at them.
pub(super) type ContactRow = Vec<Vec<RowContact>>;

/// Numbers that a link hands on to its next step, contact forces aside; all scaled to metres.
const PER_LINK: usize = 8;

/// Squarings of the matrix: 2^16 steps, 0.1 s of a run.
const SQUARINGS: u32 = 16;
/// A disturbance that has grown by more in these steps grows by 1e-4 a step: transients, as of a push that becomes a way, grow by
/// less and once.
const LARGEST_GROWTH: f64 = 1e3;

/// Whether a disturbance of the row grows at step `h` [s].
pub(super) fn grows(link: &RowLink, row: &ContactRow, h: f64) -> bool {
    let n = PER_LINK * row.len() + row.iter().map(Vec::len).sum::<usize>();
    let mut matrix = vec![0.0; n * n];
    for column in 0..n {
        let mut unit = vec![0.0; n];
        unit[column] = 1.0;
        for (i, value) in advance(link, row, h, &unit).into_iter().enumerate() {
            matrix[i * n + column] = value;
        }
    }
    // Squared again and again, its size kept apart, so that it neither overflows nor vanishes.
    let mut log_size = 0.0;
    for _ in 0..SQUARINGS {
        matrix = squared(&matrix, n);
        if !matrix.iter().all(|value| value.is_finite()) {
            return true;
        }
        let size = matrix.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        if size == 0.0 {
            return false;
        }
        for value in &mut matrix {
            *value /= size;
        }
        log_size = 2.0 * log_size + libm::log(size);
    }
    log_size > libm::log(LARGEST_GROWTH)
}

/// In a fixed order of sums: libraries take other kernels on other processors.
fn squared(a: &[f64], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n * n];
    for i in 0..n {
        for k in 0..n {
            let factor = a[i * n + k];
            for j in 0..n {
                out[i * n + j] += factor * a[k * n + j];
            }
        }
    }
    out
}

/// One step of the row.
fn advance(link: &RowLink, row: &ContactRow, h: f64, state: &[f64]) -> Vec<f64> {
    let n = row.len();
    let square = h * h;
    // Positions; velocities in the middle of the last step; accelerations of it, and those that its joints gave.
    let at = |k: usize, scale: f64| (0..n).map(|i| state[k * n + i] / scale).collect::<Vec<f64>>();
    let (y, turn) = (at(0, 1.0), at(1, link.arm_m));
    let (vy, omega) = (at(2, h), at(3, link.arm_m * h));
    let (past_ay, past_alpha) = (at(4, square), at(5, link.arm_m * square));
    let (past_jy, past_jt) = (at(6, square), at(7, link.arm_m * square));
    let force_scale = square * link.inverse_mass;
    let mut past_forces = state[PER_LINK * n..].iter().map(|f| f / force_scale);

    let mixed = |a: &[f64], b: &[f64], factor: f64| a.iter().zip(b).map(|(a, b)| a + factor * b).collect::<Vec<f64>>();
    let (jy, jt) = joints(link, [&y, &turn], [&mixed(&vy, &past_ay, 0.5 * h), &mixed(&omega, &past_alpha, 0.5 * h)]);
    let mut forces = Vec::new();
    let (mut ay, mut alpha) = (jy.clone(), jt.clone());
    for (i, contacts) in row.iter().enumerate() {
        let (dy, dt) = (jy[i] - past_jy[i], jt[i] - past_jt[i]);
        let mut at_node = LinkAtNode {
            vy: vy[i] + 0.5 * h * past_ay[i] + 0.25 * h * dy,
            omega: omega[i] + 0.5 * h * past_alpha[i] + 0.25 * h * dt,
            ay: past_ay[i] + dy,
            alpha: past_alpha[i] + dt,
        };
        for contact in contacts {
            let past = past_forces.next().unwrap_or(0.0);
            let arm = if contact.front { link.arm_m } else { -link.arm_m };
            let force = at_node.contact(link, contact, (arm, y[i] + arm * turn[i]), past, h);
            let (to_y, to_turn) = (link.inverse_mass, arm * link.inverse_inertia);
            at_node.ay += to_y * (force - past);
            at_node.alpha += to_turn * (force - past);
            at_node.vy += 0.25 * h * to_y * (force - past);
            at_node.omega += 0.25 * h * to_turn * (force - past);
            ay[i] += to_y * force;
            alpha[i] += to_turn * force;
            forces.push(force * force_scale);
        }
    }
    // Accelerations by contacts, without the predicted ones by joints; and the joints at the mean over the step.
    let (contact_y, contact_t) = (mixed(&ay, &jy, -1.0), mixed(&alpha, &jt, -1.0));
    let mean = [mixed(&y, &ay, square / 12.0), mixed(&turn, &alpha, square / 12.0)];
    let mean_rates = [
        mixed(&mixed(&vy, &ay, 0.25 * h), &past_ay, 0.25 * h),
        mixed(&mixed(&omega, &alpha, 0.25 * h), &past_alpha, 0.25 * h),
    ];
    let (again_y, again_t) = joints(link, [&mean[0], &mean[1]], [&mean_rates[0], &mean_rates[1]]);
    let (ay, alpha) = (mixed(&contact_y, &again_y, 1.0), mixed(&contact_t, &again_t, 1.0));
    let (vy, omega) = (mixed(&vy, &ay, h), mixed(&omega, &alpha, h));
    let (y, turn) = (mixed(&y, &vy, h), mixed(&turn, &omega, h));
    let columns = [
        (y, 1.0),
        (turn, link.arm_m),
        (vy, h),
        (omega, link.arm_m * h),
        (ay, square),
        (alpha, link.arm_m * square),
        (jy, square),
        (jt, link.arm_m * square),
    ];
    columns.iter().flat_map(|(column, scale)| column.iter().map(move |v| v * scale)).chain(forces).collect()
}

/// A link at a node, as its next contact sees it.
struct LinkAtNode {
    vy: f64,
    omega: f64,
    ay: f64,
    alpha: f64,
}

impl LinkAtNode {
    /// Mean force of a contact at lever `arm`, whose end is at `height`.
    fn contact(&self, link: &RowLink, contact: &RowContact, (arm, height): (f64, f64), past: f64, h: f64) -> f64 {
        let mobility = link.inverse_mass + arm * arm * link.inverse_inertia;
        let input = StepInput {
            penetration: -height,
            free_rate: 0.5 * h * mobility * past - (self.vy + arm * self.omega),
            free_acceleration: mobility * past - (self.ay + arm * self.alpha),
            mobility,
            past_force: past,
            approach: 0.0,
            step: h,
        };
        contact_law::closed_step(contact.stiffness_n_per_m, contact.damping_n_s_per_m, input)
    }
}

/// Accelerations of the links by their joints.
fn joints(link: &RowLink, [y, turn]: [&[f64]; 2], [vy, omega]: [&[f64]; 2]) -> (Vec<f64>, Vec<f64>) {
    let (n, l) = (y.len(), link.lever_m);
    let force: Vec<f64> = (0..n)
        .map(|j| {
            let next = (j + 1) % n;
            let offset = (y[j] + l * turn[j]) - (y[next] - l * turn[next]);
            let rate = (vy[j] + l * omega[j]) - (vy[next] - l * omega[next]);
            link.joint_stiffness_n_per_m * offset + link.joint_damping_n_s_per_m * rate
        })
        .collect();
    let before = |i: usize| force[(i + n - 1) % n];
    let ay = (0..n).map(|i| (before(i) - force[i]) * link.inverse_mass).collect();
    let alpha = (0..n).map(|i| -l * (before(i) + force[i]) * link.inverse_inertia).collect();
    (ay, alpha)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(inertia_g_mm2: f64, (stiffness, damping): (f64, f64)) -> RowLink {
        RowLink {
            inverse_mass: 1.0 / 3.2e-3,
            inverse_inertia: 1.0 / (inertia_g_mm2 * 1e-9),
            lever_m: 4e-3,
            arm_m: 7.5e-3,
            joint_stiffness_n_per_m: stiffness,
            joint_damping_n_s_per_m: damping,
        }
    }

    fn on(front: bool, (stiffness_n_per_m, damping_n_s_per_m): (f64, f64)) -> RowContact {
        RowContact { front, stiffness_n_per_m, damping_n_s_per_m }
    }

    fn both(law: (f64, f64)) -> Vec<RowContact> {
        vec![on(true, law), on(false, law)]
    }

    /// Bodies p (in the first place of a step's order) and q: one link touches both, with its front or its rear end.
    fn hand_over(p: (f64, f64), q: (f64, f64), front: bool) -> ContactRow {
        let between = if front {
            vec![on(true, p), on(true, q), on(false, q)]
        } else {
            vec![on(true, p), on(false, p), on(false, q)]
        };
        vec![both(q), between, both(p), both(p)]
    }

    fn limit_s(link: &RowLink, row: &ContactRow, from_s: f64) -> f64 {
        let mut h = from_s;
        while grows(link, row, h) {
            h *= 0.998;
        }
        h
    }

    /// Joints alone bear omega h = sqrt(12), omega^2 = 4 k w of the mode in which neighbours turn against each other: the shift by
    /// h^2/12 a makes of omega^2 what is omega^2 (1 - omega^2 h^2 / 12), which turns negative there.
    #[test]
    fn joints_alone_bear_the_closed_form() {
        let link = link(40.0, (3e7, 0.0));
        let weak = (30.0, 0.0);
        let row: ContactRow = vec![both(weak); 4];
        let mobility = link.lever_m * link.lever_m * link.inverse_inertia;
        let expected = libm::sqrt(12.0 / (4.0 * 3e7 * mobility));
        let found = limit_s(&link, &row, 20e-6);
        assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
    }

    /// Limits found by eigenvalues (numpy) of the same scheme, written down anew from its description.
    #[test]
    fn limits_are_those_of_the_eigenvalues() {
        let default = ((1e8, 75.0), (1e8, 75.0));
        let cases = [
            (link(40.0, (3e7, 300.0)), hand_over(default.0, default.1, true), 3.4077e-6),
            (link(40.0, (3e7, 300.0)), hand_over(default.0, default.1, false), 3.4077e-6),
            (link(40.0, (3e7, 300.0)), vec![both(default.0); 4], 3.4947e-6),
            (link(36.0, (1.7e7, 210.0)), hand_over((4.7e7, 197.0), (1.6e8, 197.0), true), 1.9552e-6),
            (link(29.0, (5.1e7, 20.0)), hand_over((2.9e8, 11.0), (2.7e8, 11.0), false), 1.2945e-6),
            (link(32.0, (9e7, 45.0)), hand_over((1.4e8, 130.0), (9e7, 130.0), true), 1.8770e-6),
        ];
        for (link, row, expected) in cases {
            let found = limit_s(&link, &row, 5e-6);
            assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
        }
    }
}
