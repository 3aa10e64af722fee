//! Friction that differs by direction: while a body moves, it is dry friction and a constant load together, or an offset of the force that drives it.

use super::report::NamedEffect;
use crate::effects::{constant_torque, coulomb_friction, input_offset};
use crate::machine::{InputKind, Machine};
use serde::Serialize;

/// Coulomb friction and a constant load on one body, or an offset of its input, read as friction that differs by direction: while the body moves, both
/// are the same.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrictionByDirection {
    /// Paths of the friction and of the load or offset.
    pub effects: [String; 2],
    /// Friction against a positive speed.
    pub forwards: f64,
    /// Friction against a negative speed.
    pub backwards: f64,
    /// Unit of both.
    pub unit: String,
}

/// Pairs of accepted effects that are friction by direction as well.
pub(super) fn friction_by_direction(effects: &[NamedEffect], machine: &Machine) -> Vec<FrictionByDirection> {
    let place = |e: &NamedEffect| e.path.rsplit('.').next().map(str::to_string);
    let size = |e: &NamedEffect, key: &str| {
        let own = e.parameters.iter().find(|p| p.path.ends_with(key) && p.record.is_none());
        own.map(|p| p.value)
    };
    let input_of = |e: &NamedEffect| {
        let name = place(e)?;
        machine.inputs.iter().find(|i| i.path.rsplit('.').next() == Some(name.as_str()))
    };
    // What an offset of an input drives its body with.
    let driven = |e: &NamedEffect| match input_of(e)?.kind {
        InputKind::Force(gain) => Some(machine.values.get(gain)? * size(e, "offset")?),
        InputKind::Speed | InputKind::Angle | InputKind::Acceleration => None,
    };
    let of = |(friction, load): (&NamedEffect, &NamedEffect)| {
        let (key, unit) =
            [("torque_nm", "N m"), ("force_n", "N")].into_iter().find(|(key, _)| size(friction, key).is_some())?;
        let friction_size = size(friction, key)?;
        let load_size = if load.name == input_offset::ROW.name { -driven(load)? } else { size(load, key)? };
        // A load beyond the friction drives the body.
        (load_size.abs() < friction_size).then(|| FrictionByDirection {
            effects: [friction.path.clone(), load.path.clone()],
            forwards: friction_size + load_size,
            backwards: friction_size - load_size,
            unit: unit.into(),
        })
    };
    let named = |name: &'static str| effects.iter().filter(move |e| e.name == name);
    let loads = || named(constant_torque::ROW.name).chain(named(input_offset::ROW.name));
    let body_of = |e: &NamedEffect| match e.name == input_offset::ROW.name {
        true => input_of(e).map(|i| machine.bodies[i.body].name.clone()),
        false => place(e),
    };
    let pairs = named(coulomb_friction::ROW.name).flat_map(|f| loads().map(move |l| (f, l)));
    pairs.filter(|(f, l)| place(f) == body_of(l)).filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::super::report::FittedNumber;
    use super::*;

    fn effect_of(name: &str, body: &str, key: &str, value: f64) -> NamedEffect {
        let path = format!("effects.{name}.{body}");
        let number = FittedNumber {
            path: format!("{path}.{key}"),
            record: None,
            value,
            standard_error: 0.01,
            nameplate: None,
            nameplate_z: None,
            at_bound: false,
            determined: true,
            tried: false,
        };
        NamedEffect {
            name: name.into(),
            family: "friction".into(),
            path,
            parameters: vec![number],
            standard_error: 0.01,
            rivals: Vec::new(),
            only_its_law_is_open: true,
            by_order: Vec::new(),
            judge_ratio: [0.5; 3],
            sizes: Vec::new(),
            judged_by_leaving_out: Vec::new(),
            score: 0.0,
            gain: 0.5,
            sham_gain: 0.0,
        }
    }

    #[test]
    fn friction_and_a_smaller_load_on_one_body_are_friction_by_direction() {
        let friction = effect_of("coulomb_friction", "disc", "torque_nm", 1.0);
        let text = "fidelity = \"lumped\"\n[rotors.disc]\ninertia_kg_m2 = 1\n[inputs.torque.drive]\nbody = \"disc\"\ngain_nm_per_unit = 2\n[sensors.tachometer.disc]\n";
        let machine = Machine::parse("disc.toml", text, &[]).unwrap_or_else(|e| panic!("{e}"));
        let by_direction = |effects: &[NamedEffect]| friction_by_direction(effects, &machine);
        let load = |body: &str, value: f64| effect_of("constant_torque", body, "torque_nm", value);
        let found = by_direction(&[load("disc", 0.25), friction.clone()]);
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].forwards, found[0].backwards, found[0].unit.as_str()), (1.25, 0.75, "N m"));
        assert_eq!(found[0].effects, ["effects.coulomb_friction.disc", "effects.constant_torque.disc"]);
        assert!(by_direction(&[load("disc", 1.5), friction.clone()]).is_empty(), "it drives the disc");
        assert!(by_direction(&[load("motor", 0.25), friction]).is_empty(), "on another body");
        let offset = effect_of("input_offset", "drive", "offset", 0.1);
        let found = by_direction(&[offset, effect_of("coulomb_friction", "disc", "torque_nm", 1.0)]);
        assert_eq!((found[0].forwards, found[0].backwards), (0.8, 1.2), "0.2 N m drive the disc forwards");
        let slide = ["coulomb_friction", "constant_torque"].map(|name| effect_of(name, "carriage", "force_n", 3.0));
        assert!(by_direction(&slide[..1]).is_empty());
    }
}
