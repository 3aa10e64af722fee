//! Derives a lumped drive from one with link bodies: the same shafts, loads and sensors, spans as springs.
//!
//! The loop is linearised at rest under its load (closed contacts, no friction) and condensed to its shafts, see
//! [`crate::statics::condensed`]. Spans that join the same two sprockets share their common stiffness in inverse
//! proportion to their lengths. The links' inertia is that of the condensed shapes, with rows summed. The damping of a
//! span is that of its joints in series.

use crate::assemble::{AssemblyError, at_rest};
use crate::drive::sensors::SensorReads;
use crate::drive::{Drive, OuterSpec};
use crate::geometry::route::Wrap;
use crate::model::Model;
use crate::statics::{CondensedModel, Equilibrium, condensed};
use std::fmt::Write;

/// A span of the lumped drive.
#[derive(Clone, Debug, PartialEq)]
pub struct LumpedSpan {
    pub name: String,
    /// Indices of the sprocket that it leaves, and of the one that it reaches.
    pub between: (usize, usize),
    pub stiffness_n_per_m: f64,
    pub damping_n_s_per_m: f64,
    /// Links at its ends, counted along the loop from the anchor.
    pub links: (f64, f64),
}

/// Components of a lumped drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Lumping {
    /// Rolling radius of every sprocket [m].
    pub radius_m: Vec<f64>,
    /// Inertia of every sprocket including its share of the chain [kg m2].
    pub inertia_kg_m2: Vec<f64>,
    pub spans: Vec<LumpedSpan>,
}

/// Why a drive has no lumped form.
#[derive(Debug)]
pub enum LumpError {
    Assembly(AssemblyError),
    /// Explains the reason.
    Form(String),
}

/// Condenses a drive.
pub fn lumping(drive: &Drive) -> Result<(Lumping, Model, Equilibrium), LumpError> {
    if let Some(s) = drive.sprockets.iter().find(|s| s.wrap == Wrap::Outside) {
        return Err(LumpError::Form(format!(
            "sprocket `{}` is wrapped outside: spans with crossed ends are not lumped",
            s.name
        )));
    }
    if !drive.valves.is_empty() {
        return Err(LumpError::Form("valve trains are not lumped: give their torque as `[loads.orders.NAME]`".into()));
    }
    if !drive.elastic_shafts.is_empty() {
        return Err(LumpError::Form("elastic shafts are not lumped: give the sprocket their whole inertia".into()));
    }
    let gives_way = !drive.bearings.is_empty() || drive.effects.mounts().next().is_some();
    if !drive.arms.is_empty() || !drive.rails.is_empty() || gives_way || drive.chains() > 1 {
        let text = "arms, rails, bearings, mounts of guides and several chains are not lumped yet: spans of a lumped drive run straight between two sprockets that stand";
        return Err(LumpError::Form(text.into()));
    }
    let (model, equilibrium) = at_rest(drive).map_err(LumpError::Assembly)?;
    let soft = || LumpError::Form("the links at rest have no stiffness of their own".to_string());
    let CondensedModel { stiffness, inertia } = condensed(&model, &equilibrium.configuration).ok_or_else(soft)?;
    let route = model.routes.first().ok_or_else(soft)?;
    let n = model.sprockets.len();
    // Without slip the shafts turn by the chain's travel over their rolling radius.
    let radius_m: Vec<f64> = model.sprockets.iter().map(|s| s.geometry.rolling_radius_m()).collect();
    let spans = model
        .span_stiffness(drive, &stiffness)
        .into_iter()
        .enumerate()
        .map(|(a, stiffness_n_per_m)| {
            let b = (a + 1) % n;
            let joint = &drive.joint;
            let from = (route.span_start_m(a) - route.anchor_m()).rem_euclid(route.length_m()) / drive.chain.pitch_m();
            LumpedSpan {
                name: format!("{}-{}", model.sprockets[a].name, model.sprockets[b].name),
                between: (a, b),
                stiffness_n_per_m,
                damping_n_s_per_m: stiffness_n_per_m * joint.damping_n_s_per_m / joint.stiffness_n_per_m,
                links: (from, from + route.path_to_next_sprocket_m(a) / drive.chain.pitch_m()),
            }
        })
        .collect();
    let inertia_kg_m2 = (0..n).map(|a| inertia.row(a).iter().sum()).collect();
    Ok((Lumping { radius_m, inertia_kg_m2, spans }, model, equilibrium))
}

/// The lumped drive's file.
pub fn lumped_text(drive: &Drive, l: &Lumping) -> String {
    let mut t = String::new();
    let name = |k: usize| drive.sprockets[k].name.as_str();
    let mut write = || -> std::fmt::Result {
        writeln!(t, "# Derived from `{}`: its loop condensed to the shafts, at rest under the load.", drive.name)?;
        writeln!(
            t,
            "title = \"{}, lumped\"\nfidelity = \"lumped\"\n",
            drive.title.replace('\\', "\\\\").replace('"', "\\\"")
        )?;
        for (k, s) in drive.sprockets.iter().enumerate() {
            writeln!(t, "[rotors.{}]\nteeth = {}", s.name, s.teeth)?;
            match s.outer {
                OuterSpec::Speed { speed_rad_s } => {
                    writeln!(
                        t,
                        "\n[speeds.constant.{}]\nspeed_rpm = {:?}\n",
                        s.name,
                        speed_rad_s.abs() / crate::units::RPM
                    )?;
                }
                OuterSpec::Load { inertia_kg_m2, torque_nm } => {
                    writeln!(
                        t,
                        "inertia_kg_m2 = {:?} # {inertia_kg_m2:?} and its share of the chain",
                        l.inertia_kg_m2[k]
                    )?;
                    writeln!(t, "\n[loads.constant.{}]\ntorque_nm = {torque_nm:?}\n", s.name)?;
                }
            }
        }
        writeln!(t, "[chain]\nlinks = {}\nleader = \"{}\"\n", drive.links, name(drive.driver()))?;
        for s in &l.spans {
            // A chain that runs forwards pulls from the sprocket that it reaches: the span is stretched when that one
            // is ahead.
            let (a, b) = s.between;
            writeln!(t, "[spans.{}]\nbetween = [\"{}\", \"{}\"]", s.name, name(b), name(a))?;
            writeln!(t, "from_radius_mm = {:?}\nto_radius_mm = {:?}", 1e3 * l.radius_m[b], 1e3 * l.radius_m[a])?;
            writeln!(
                t,
                "stiffness_n_per_m = {:?}\ndamping_n_s_per_m = {:?}",
                s.stiffness_n_per_m, s.damping_n_s_per_m
            )?;
            writeln!(t, "from_link = {:.3}\nto_link = {:.3}\n", s.links.0, s.links.1)?;
        }
        let mut seen = false;
        for s in &drive.sensors {
            // All others read what a lumped drive has not.
            let line = if let SensorReads::Span(k) = s.reads {
                format!("span = \"{}\"\n", l.spans[k].name)
            } else if let SensorReads::Angle(k)
            | SensorReads::Speed(k)
            | SensorReads::Acceleration(k)
            | SensorReads::Torque(k) = s.reads
            {
                if name(k) == s.name { String::new() } else { format!("body = \"{}\"\n", name(k)) }
            } else {
                continue;
            };
            seen = true;
            writeln!(t, "[{}]\n{line}gain = {:?}\n", s.path, s.gain)?;
        }
        if !seen {
            let free = (0..drive.sprockets.len()).find(|k| *k != drive.driver()).unwrap_or(0);
            writeln!(t, "[sensors.tachometer.{}]", name(free))?;
        }
        Ok(())
    };
    // Writing into a String never fails.
    let _ = write();
    t
}
