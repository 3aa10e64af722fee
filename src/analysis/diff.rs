//! Compares two recordings: when and in which body they first differ, by how much, and how the difference grows.
//!
//! If both have the same step size, frames of the same step are compared bit by bit. Otherwise, or if they share no
//! steps, the second recording is interpolated to the times of the first (poses by cubic Hermite polynomials from
//! positions and velocities, everything else linearly), and differences below [`INTERPOLATED_M`] are ignored.

use crate::recording::columns::ColumnValues;
use crate::recording::frame::{Frame, Header};
use crate::recording::reader::{Cursor, Reader};
use crate::replay::frame_difference;
use crate::units::wrap_angle;

/// Position tolerance if one recording is interpolated [m]: an impact between two frames 50 us apart moves a link by up
/// to some 5 um off the polynomial.
const INTERPOLATED_M: f64 = 10e-6;
/// Rows of the growth table per decade of time.
const ROWS_PER_DECADE: f64 = 3.0;

/// The difference of two recordings.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Difference {
    pub equal: bool,
    /// Differences of their headers: drives, contours, links.
    pub drives: Vec<String>,
    pub frames_compared: u64,
    pub frames_only_in_a: u64,
    pub frames_only_in_b: u64,
    pub interpolated: bool,
    pub first: Option<First>,
    pub growth: Vec<Growth>,
}

/// The first frame that differs.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct First {
    pub frame: u64,
    pub step: u64,
    pub t_s: f64,
    /// `link 12`, or the path of a sprocket.
    pub body: String,
    /// Its displacement there [m]; for a sprocket its rotation [rad].
    pub distance: f64,
    /// First value that differs, in both recordings.
    pub what: String,
}

/// The difference at one instant.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Growth {
    pub t_s: f64,
    /// Largest displacement of any link [m], and that link.
    pub position_m: f64,
    pub link: usize,
    /// Largest difference of the force in any joint [N], and of the chain torque on any sprocket [N m].
    pub joint_force_n: f64,
    pub chain_torque_nm: f64,
}

/// Compares two recordings.
pub fn diff(a: &mut Reader, b: &mut Reader) -> anyhow::Result<Difference> {
    let (header_a, header_b) = (a.header().clone(), b.header().clone());
    let (links_a, links_b) = (header_a.links.len(), header_b.links.len());
    anyhow::ensure!(links_a == links_b, "the drives have {links_a} and {links_b} links: there is nothing to compare");
    let same_step = header_a.step_s == header_b.step_s;
    let mut result =
        Difference { drives: headers(&header_a, &header_b), interpolated: !same_step, ..Difference::default() };
    let (mut a, mut b) = (Cursor::new(a), Cursor::new(b));
    if same_step {
        by_step(&mut a, &mut b, &header_a, &mut result)?;
    }
    result.equal = result.first.is_none()
        && result.drives.is_empty()
        && !result.interpolated
        && result.frames_only_in_a + result.frames_only_in_b == 0;
    if same_step && (result.frames_compared > 0 || (result.frames_only_in_a == 0 || result.frames_only_in_b == 0)) {
        return Ok(result);
    }
    (a, b) = (a.rewound(), b.rewound());
    (result.interpolated, result.frames_only_in_a, result.frames_only_in_b) = (true, 0, 0);
    by_time(&mut a, &mut b, &header_a, &mut result)?;
    // A different step size alone is not a difference of the drives.
    let only_steps = result.drives.iter().all(|l| l.starts_with("step: "));
    result.equal = result.first.is_none() && only_steps && result.frames_compared > 0;
    Ok(result)
}

fn by_step(a: &mut Cursor<'_>, b: &mut Cursor<'_>, header: &Header, result: &mut Difference) -> anyhow::Result<()> {
    let (mut next_a, mut next_b) = (a.next_frame()?, b.next_frame()?);
    let mut frame = 0;
    loop {
        match (&next_a, &next_b) {
            (None, None) => return Ok(()),
            (Some(fa), Some(fb)) if fa.step == fb.step => {
                result.frames_compared += 1;
                if fa != fb {
                    note(result, header, (frame, false), fa, fb);
                }
                (next_a, next_b) = (a.next_frame()?, b.next_frame()?);
                frame += 1;
            }
            (Some(fa), fb) if fb.as_ref().is_none_or(|fb| fa.step < fb.step) => {
                result.frames_only_in_a += 1;
                next_a = a.next_frame()?;
                frame += 1;
            }
            _ => {
                result.frames_only_in_b += 1;
                next_b = b.next_frame()?;
            }
        }
    }
}

fn by_time(a: &mut Cursor<'_>, b: &mut Cursor<'_>, header: &Header, result: &mut Difference) -> anyhow::Result<()> {
    let (mut before, mut after) = (b.next_frame()?, b.next_frame()?);
    let mut frame = 0;
    while let Some(fa) = a.next_frame()? {
        while after.as_ref().is_some_and(|f| f.t_s < fa.t_s) {
            before = after;
            after = b.next_frame()?;
        }
        match (&before, &after) {
            (Some(low), Some(high)) if low.t_s <= fa.t_s => {
                result.frames_compared += 1;
                let between = interpolated(low, high, fa.t_s, fa.step);
                let growth = growth(&fa, &between);
                if growth.position_m > INTERPOLATED_M {
                    note(result, header, (frame, true), &fa, &between);
                }
            }
            _ => result.frames_only_in_a += 1,
        }
        frame += 1;
    }
    Ok(())
}

/// Interpolates poses between two frames, and columns whose rows match in both.
fn interpolated(low: &Frame, high: &Frame, t_s: f64, step: u64) -> Frame {
    let h = high.t_s - low.t_s;
    let u = if h > 0.0 { (t_s - low.t_s) / h } else { 0.0 };
    let (u2, u3) = (u * u, u * u * u);
    let hermite = |p0: f64, v0: f64, p1: f64, v1: f64| {
        (2.0 * u3 - 3.0 * u2 + 1.0) * p0
            + (u3 - 2.0 * u2 + u) * h * v0
            + (3.0 * u2 - 2.0 * u3) * p1
            + (u3 - u2) * h * v1
    };
    let mut f = low.clone();
    (f.t_s, f.step) = (t_s, step);
    f.crank_angle_rad += u * (high.crank_angle_rad - low.crank_angle_rad);
    let linear = |a: &mut f64, b: &f64| *a += u * (b - *a);
    let mut tables = Vec::new();
    high.each_table(|_, columns| tables.push(columns.to_vec()));
    let mut tables = tables.into_iter();
    f.each_table_mut(|table, columns| {
        for (to, from) in columns.iter_mut().zip(tables.next().unwrap_or_default()) {
            if let (true, ColumnValues::F64(from)) = (table.rows.are_fixed(), from) {
                let mut from = from.iter();
                to.each_f64(|a| from.next().into_iter().for_each(|b| linear(a, b)));
            }
        }
    });
    f.sensors.iter_mut().zip(&high.sensors).for_each(|(a, b)| linear(a, b));
    let (a, b) = (&low.links, &high.links);
    for i in 0..a.x_m.len().min(b.x_m.len()) {
        f.links.x_m[i] = hermite(a.x_m[i], a.vx_m_s[i], b.x_m[i], b.vx_m_s[i]);
        f.links.y_m[i] = hermite(a.y_m[i], a.vy_m_s[i], b.y_m[i], b.vy_m_s[i]);
        let turned = a.angle_rad[i] + wrap_angle(b.angle_rad[i] - a.angle_rad[i]);
        f.links.angle_rad[i] = wrap_angle(hermite(a.angle_rad[i], a.omega_rad_s[i], turned, b.omega_rad_s[i]));
    }
    f
}

fn growth(a: &Frame, b: &Frame) -> Growth {
    let (la, lb) = (&a.links, &b.links);
    let mut g = Growth { t_s: a.t_s, position_m: 0.0, link: 0, joint_force_n: 0.0, chain_torque_nm: 0.0 };
    for i in 0..la.x_m.len().min(lb.x_m.len()) {
        let d = libm::hypot(la.x_m[i] - lb.x_m[i], la.y_m[i] - lb.y_m[i]);
        if d > g.position_m {
            (g.position_m, g.link) = (d, i);
        }
    }
    let (ja, jb) = (&a.joints, &b.joints);
    for j in 0..ja.force_x_n.len().min(jb.force_x_n.len()) {
        let d = libm::hypot(ja.force_x_n[j] - jb.force_x_n[j], ja.force_y_n[j] - jb.force_y_n[j]);
        g.joint_force_n = g.joint_force_n.max(d);
    }
    let torques = a.rotors.chain_torque_nm.iter().zip(&b.rotors.chain_torque_nm);
    g.chain_torque_nm = torques.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    g
}

fn note(result: &mut Difference, header: &Header, (number, between): (u64, bool), a: &Frame, b: &Frame) {
    let now = growth(a, b);
    let Some(first) = &result.first else {
        let turned = a.rotors.angle_rad.iter().zip(&b.rotors.angle_rad).map(|(a, b)| (a - b).abs());
        let rotor = turned.enumerate().fold((0, 0.0), |best, (k, d)| if d > best.1 { (k, d) } else { best });
        let (body, distance) = if now.position_m > 0.0 {
            (format!("link {}", now.link), now.position_m)
        } else if rotor.1 > 0.0 {
            (header.coordinates.get(rotor.0).cloned().unwrap_or_else(|| "a sprocket".into()), rotor.1)
        } else {
            (contact_body(header, a, b), 0.0)
        };
        // Between two frames only the poses are reliable.
        let what = if between {
            format!("{body} is {:.3} um off where B stands between two of its frames", 1e6 * distance)
        } else {
            frame_difference(a, b).replace("recorded", "A has").replace("the run gives", "B has")
        };
        result.first = Some(First { frame: number, step: a.step, t_s: a.t_s, body, distance, what });
        result.growth.push(now);
        return;
    };
    // Rows are evenly spaced in the logarithm of the time since the first difference.
    let since = |t_s: f64| (t_s - first.t_s).max(1e-9);
    let last = result.growth.last().map_or(first.t_s, |g| g.t_s);
    if since(now.t_s) >= since(last) * libm::pow(10.0, 1.0 / ROWS_PER_DECADE) {
        result.growth.push(now);
    }
}

/// The body of the first contact that differs.
fn contact_body(header: &Header, a: &Frame, b: &Frame) -> String {
    let n = a.contacts.link.len();
    let differs = |i: &usize| {
        b.contacts.link.get(*i) != Some(&a.contacts.link[*i])
            || b.contacts.normal_force_n.get(*i) != Some(&a.contacts.normal_force_n[*i])
    };
    let row = (0..n).find(differs);
    match row {
        Some(i) => format!(
            "link {} on {}",
            a.contacts.link[i],
            header.bodies.get(a.contacts.body[i] as usize).map_or("?", |b| b.path.as_str())
        ),
        None => "the drive".into(),
    }
}

/// Differences of two headers, one per line.
fn headers(a: &Header, b: &Header) -> Vec<String> {
    let mut lines = Vec::new();
    if a.step_s != b.step_s {
        lines.push(format!("step: {:.4} us in A, {:.4} us in B", a.step_s * 1e6, b.step_s * 1e6));
    }
    let only = |x: &Header, y: &Header| {
        x.overrides.iter().filter(|o| !y.overrides.contains(o)).cloned().collect::<Vec<_>>().join(", ")
    };
    for (name, text) in [("A", only(a, b)), ("B", only(b, a))] {
        if !text.is_empty() {
            lines.push(format!("set only in {name}: {text}"));
        }
    }
    lines.extend(texts(&a.drive_text, &b.drive_text));
    for (i, (la, lb)) in a.links.iter().zip(&b.links).enumerate().filter(|(_, (la, lb))| la != lb).take(10) {
        lines.push(format!(
            "link {i}: {:.3} um longer in B, {:+.3e} kg heavier",
            (lb.pitch_m - la.pitch_m) * 1e6,
            lb.mass_kg - la.mass_kg
        ));
    }
    for (ba, bb) in a.bodies.iter().zip(&b.bodies).filter(|(ba, bb)| ba != bb) {
        if ba.path != bb.path {
            lines.push(format!("a body is called {} in A and {} in B", ba.path, bb.path));
            continue;
        }
        let moved = libm::hypot(ba.x_m - bb.x_m, ba.y_m - bb.y_m);
        if moved > 0.0 || ba.angle_rad != bb.angle_rad {
            let turned = (bb.angle_rad - ba.angle_rad).to_degrees();
            lines.push(format!("{}: moved by {:.3} um, turned by {turned:.2e} deg in B", ba.path, moved * 1e6));
        }
        if ba.outline != bb.outline {
            lines.push(format!("{}: another contour", ba.path));
        }
    }
    lines
}

/// Lines that differ between two drive files, without their common start and end.
fn texts(a: &str, b: &str) -> Vec<String> {
    let (a, b): (Vec<&str>, Vec<&str>) = (a.lines().collect(), b.lines().collect());
    let head = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    let tail = a[head..].iter().rev().zip(b[head..].iter().rev()).take_while(|(x, y)| x == y).count();
    let side = |name: &str, lines: &[&str]| -> Vec<String> {
        lines.iter().take(10).map(|l| format!("drive file, only in {name}: `{}`", l.trim())).collect()
    };
    let (a, b) = (&a[head..a.len() - tail], &b[head..b.len() - tail]);
    side("A", a).into_iter().chain(side("B", b)).collect()
}
