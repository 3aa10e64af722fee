//! Reading `[effects]` of a drive with links; those on shafts, arms and sliders are read with the loads in `shafts`.

use super::bearings::{BearingLaw, BearingSpec, NARROWEST_FILM_M};
use super::lifters::largest_island;
use super::mechanism::{PassageLaw, PassageSpec, WIDEST_GAP};
use super::reader::TomlTable;
use super::shafts::CouplingSpec;
use super::valves::ValveSpec;
use super::{
    ArmEffect, ArmSpec, Drive, Effects, GapError, GapWave, GuideEffect, GuideMount, LinkMass, OilSpec, PartEffect,
    PassageEffect, PitchError, RailSpec, SpanEffect, TightJoint, sensors,
};
use crate::diag::last_name;
use crate::effects::{
    Effect, On, Parameter, alternate_pitch, arm_compliance, bearing_clearance, blade_stiffness, check_leak,
    coupling_stiffness, gap_error, guide_compliance, guide_friction, joint_clearance, joint_damping, joint_stiffness,
    leak_gap, link_mass, oil_air, oil_viscosity, orifice_diameter, pin_friction, pitch_error, span_damping,
    span_stiffness, sprocket_runout, tight_joint, tooth_pitch_error, valve_spring, wear_elongation,
};
use crate::elements::hydraulics::MAX_PASSAGES;

/// What effects act on, by their names.
#[derive(Clone, Copy)]
pub(super) struct EffectTargets<'a> {
    pub(super) sprockets: &'a [String],
    /// Straight guides.
    pub(super) guides: &'a [&'a str],
    pub(super) rails: &'a [RailSpec],
    pub(super) arms: &'a [ArmSpec],
    pub(super) oil: Option<&'a OilSpec>,
    /// Blades, plain bearings, valves and couplings.
    pub(super) parts: &'a [(On, Vec<String>)],
    /// Of chains of spans.
    pub(super) spans: &'a [String],
}

/// Names of the parts whose numbers effects change: blades, plain bearings, valves, couplings.
pub(super) fn named_parts(
    rails: &[RailSpec],
    bearings: &[BearingSpec],
    valves: &[ValveSpec],
    couplings: &[CouplingSpec],
) -> Vec<(On, Vec<String>)> {
    let named = |path: &str| last_name(path).to_string();
    let plain = bearings.iter().filter(|b| matches!(b.law, BearingLaw::Plain(_)));
    vec![
        (On::Blade, rails.iter().filter(|r| r.bending.is_some()).map(|r| r.name.clone()).collect()),
        (On::Bearing, plain.map(|b| named(&b.path)).collect()),
        (On::Valve, valves.iter().map(|v| v.name.clone()).collect()),
        (On::Coupling, couplings.iter().map(|c| named(&c.path)).collect()),
    ]
}

impl Drive {
    /// Names of the parts of this kind whose numbers effects change.
    pub fn parts_for(&self, on: On) -> Vec<String> {
        let all = named_parts(&self.rails, &self.bearings, &self.valves, &self.train.couplings);
        all.into_iter().filter(|(kind, _)| *kind == on).flat_map(|(_, names)| names).collect()
    }

    /// Least and largest change of a plain bearing's clearance that leave a bearing [m].
    pub fn clearance_range_m(&self, bearing: &str) -> Option<(f64, f64)> {
        let range = |spec: &BearingSpec| match &spec.law {
            BearingLaw::Plain(b) => Some((NARROWEST_FILM_M - b.clearance_m, b.radius_m - b.clearance_m)),
            BearingLaw::Elastic { .. } => None,
        };
        self.bearings.iter().filter(|b| last_name(&b.path) == bearing).find_map(range)
    }
}

/// Effects on sprockets, links, joints, guides, oil, spans and signals.
pub(super) fn read_effects(
    t: &TomlTable<'_>,
    targets: EffectTargets<'_>,
    sensors: &[sensors::SensorSpec],
) -> (Effects, Vec<sensors::SignalSpec>) {
    let mut effects = Effects::default();
    read_gap_effects(t, targets.sprockets, &mut effects);
    read_link_effects(t, &mut effects);
    effects.elongation_m = of_all(t, &wear_elongation::ROW, "chain");
    effects.alternate_m = of_all(t, &alternate_pitch::ROW, "chain");
    effects.pin_friction = of_all(t, &pin_friction::ROW, "chain");
    effects.joint_stiffness_share = of_all(t, &joint_stiffness::ROW, "chain");
    effects.joint_damping_n_s_per_m = of_all(t, &joint_damping::ROW, "chain");
    effects.joint_clearance_m = of_all(t, &joint_clearance::ROW, "chain");
    read_part_effects(t, targets.parts, &mut effects);
    read_guide_effects(t, targets, &mut effects);
    read_arm_effects(t, targets.arms, &mut effects);
    read_oil_effects(t, targets.oil, &mut effects);
    read_span_effects(t, targets.spans, &mut effects);
    let signals = sensors::signals(t, sensors);
    t.finish();
    (effects, signals)
}

/// Effects on sprockets, by their names.
fn read_gap_effects(t: &TomlTable<'_>, sprockets: &[String], effects: &mut Effects) {
    let of = |t: &TomlTable<'_>, name: &str| {
        sprockets.iter().position(|s| s == name).unwrap_or_else(|| {
            t.error(format!("no sprocket is called `{name}`"), Some(format!("sprockets: {}", sprockets.join(", "))));
            0
        })
    };
    let table = t.table(gap_error::ROW.name);
    for (name, t) in table.tables_or_set() {
        let [gap, outward_m] = numbers(&t, &gap_error::ROW);
        effects.gap_errors.push(GapError { sprocket: of(&t, &name), gap: gap as u32, outward_m });
        t.finish();
    }
    table.finish();
    let table = t.table(sprocket_runout::ROW.name);
    for (name, t) in table.tables_or_set() {
        let [amplitude_m, phase_rad] = numbers(&t, &sprocket_runout::ROW);
        effects.gap_waves.push(GapWave { sprocket: of(&t, &name), amplitude_m, phase_rad, order: None });
        t.finish();
    }
    table.finish();
    let table = t.table(tooth_pitch_error::ROW.name);
    for (name, t) in table.tables_or_set() {
        let [amplitude_m, phase_rad, order] = numbers(&t, &tooth_pitch_error::ROW);
        let order = Some(order as u32);
        effects.gap_waves.push(GapWave { sprocket: of(&t, &name), amplitude_m, phase_rad, order });
        t.finish();
    }
    table.finish();
}

/// The parameters of an effect that drives with links have, in SI, in the order of its row: names, units, ranges and defaults
/// are the row's. `slides`: it acts on a body that slides, whose keys are other ones.
pub(super) fn parameters(t: &TomlTable<'_>, effect: &Effect, slides: bool) -> Vec<f64> {
    let value = |p: &Parameter| {
        let key = if slides { p.sliding_key } else { p.key };
        match (p.is_integer(), p.default_for(key)) {
            (false, Some(default)) => t.number(key, p.unit, p.range()).unwrap_or(default * p.unit),
            (false, None) => t.required(key, p.unit, p.range()),
            (true, Some(default)) => t.integer(key, p.low as i64..=p.high as i64).map_or(default, |n| n as f64),
            (true, None) => t.required_integer(key, p.low as i64..=p.high as i64) as f64,
        }
    };
    effect.parameters.iter().filter(|p| !p.lumped_only).map(value).collect()
}

/// As [`parameters`], of an effect that has so many.
fn numbers<const N: usize>(t: &TomlTable<'_>, effect: &Effect) -> [f64; N] {
    let values = parameters(t, effect, false);
    <[f64; N]>::try_from(values).unwrap_or_else(|v| panic!("{} has {} parameters, not {N}", effect.name, v.len()))
}

/// The parameter of an effect on all joints or all oil, `[effects.NAME.chain]`, `[effects.NAME.oil]`; off where the file does not set it.
fn of_all(t: &TomlTable<'_>, effect: &Effect, target: &str) -> f64 {
    let (table, mut value) = (t.table(effect.name), 0.0);
    let all = table.table(target);
    for p in effect.parameters.iter().filter(|p| !p.lumped_only) {
        value = all.number(p.key, p.unit, p.range()).unwrap_or(p.off * p.unit);
    }
    all.finish();
    table.finish();
    value
}

/// Effects on single links and joints; their names are free.
fn read_link_effects(t: &TomlTable<'_>, effects: &mut Effects) {
    let table = t.table(pitch_error::ROW.name);
    for (name, t) in table.tables_or_set() {
        let [link, length_m] = numbers(&t, &pitch_error::ROW);
        effects.pitch_errors.push(PitchError { name, link: link as usize, length_m });
        t.finish();
    }
    table.finish();
    let table = t.table(link_mass::ROW.name);
    for (name, t) in table.tables_or_set() {
        let [link, mass_share, inertia_share] = numbers(&t, &link_mass::ROW);
        effects.link_masses.push(LinkMass { name, link: link as usize, mass_share, inertia_share });
        t.finish();
    }
    table.finish();
    let table = t.table(tight_joint::ROW.name);
    for (name, t) in table.tables_or_set() {
        let [joint, torque_nm] = numbers(&t, &tight_joint::ROW);
        effects.tight_joints.push(TightJoint { name, joint: joint as usize, torque_nm });
        t.finish();
    }
    table.finish();
}

/// Effects on numbers of blades, plain bearings, valves and couplings, by their names.
fn read_part_effects(t: &TomlTable<'_>, parts: &[(On, Vec<String>)], effects: &mut Effects) {
    for effect in [&blade_stiffness::ROW, &bearing_clearance::ROW, &valve_spring::ROW, &coupling_stiffness::ROW] {
        let table = t.table(effect.name);
        for (part, own) in table.tables_or_set() {
            let known: Vec<&str> = parts
                .iter()
                .filter(|(on, _)| *on == effect.on)
                .flat_map(|(_, names)| names)
                .map(String::as_str)
                .collect();
            if !known.contains(&part.as_str()) {
                let help =
                    if known.is_empty() { "there is none".into() } else { format!("there are: {}", known.join(", ")) };
                own.error(format!("`{part}` is not {}", effect.on.label()), Some(help));
            }
            let [size] = numbers(&own, effect);
            effects.parts.push(PartEffect { effect, part, size });
            own.finish();
        }
        table.finish();
    }
}

/// Effects on guides, by their names.
fn read_guide_effects(t: &TomlTable<'_>, targets: EffectTargets<'_>, effects: &mut Effects) {
    for effect in [&guide_friction::ROW, &guide_compliance::ROW] {
        let table = t.table(effect.name);
        for (name, own) in table.tables_or_set() {
            let is_friction = *effect == guide_friction::ROW;
            let rail = targets.rails.iter().find(|r| r.name == name);
            if rail.is_some_and(|r| r.arm.is_some()) && !is_friction {
                let help = "it gives way with the arm: set the spring of what presses on that";
                own.error(format!("rail `{name}` turns with an arm"), Some(help.into()));
            } else if rail.is_some_and(|r| r.bending.is_some()) && !is_friction {
                let help = "hold it softly by `springs_mm` of its bending";
                own.error(format!("rail `{name}` bends, and stands on its supports"), Some(help.into()));
            } else if rail.is_none() && !targets.guides.contains(&name.as_str()) {
                let rails = targets.rails.iter().map(|r| r.name.as_str());
                let known: Vec<&str> = targets.guides.iter().copied().chain(rails).collect();
                own.error(format!("no guide is called `{name}`"), Some(format!("guides: {}", known.join(", "))));
            }
            if is_friction {
                let [friction] = numbers(&own, effect);
                effects.guides.push(GuideEffect { guide: name, friction, mount: None });
            } else {
                let [compliance_m_per_n, mass_kg, damping_ratio] = numbers(&own, effect);
                // One without compliance stands still.
                let mount = (compliance_m_per_n > 0.0).then_some(GuideMount {
                    path: own.path().to_string(),
                    compliance_m_per_n,
                    mass_kg,
                    damping_ratio,
                });
                effects.guides.push(GuideEffect { guide: name, friction: 0.0, mount });
            }
            own.finish();
        }
        table.finish();
    }
}

/// Effects on arms, by their names.
fn read_arm_effects(t: &TomlTable<'_>, arms: &[ArmSpec], effects: &mut Effects) {
    let table = t.table(arm_compliance::ROW.name);
    for (arm, t) in table.tables_or_set() {
        let [compliance_rad_per_nm, back_share, damping_ratio] = numbers(&t, &arm_compliance::ROW);
        if arms.iter().all(|a| a.name != arm) {
            let known: Vec<&str> = arms.iter().map(|a| a.name.as_str()).collect();
            let known = if known.is_empty() { "there is none".into() } else { format!("arms: {}", known.join(", ")) };
            t.error(format!("no arm is called `{arm}`"), Some(known));
        }
        // One without compliance is rigid.
        if compliance_rad_per_nm > 0.0 {
            let path = t.path().to_string();
            effects.arms.push(ArmEffect { path, arm, compliance_rad_per_nm, back_share, damping_ratio });
        }
        t.finish();
    }
    table.finish();
}

/// Effects on oil, and on passages by their names.
fn read_oil_effects(t: &TomlTable<'_>, oil: Option<&OilSpec>, effects: &mut Effects) {
    let own = &mut effects.oil;
    own.air_share = of_all(t, &oil_air::ROW, "oil");
    own.viscosity_share = of_all(t, &oil_viscosity::ROW, "oil");
    if oil.is_none() {
        for table in [&oil_air::ROW, &oil_viscosity::ROW].map(|e| t.table(e.name)).iter().filter(|t| t.is_present()) {
            table.error("the drive has no oil".into(), Some("add `[oil]`, `[chambers]` and `[passages]`".into()));
        }
    }
    for effect in [&leak_gap::ROW, &orifice_diameter::ROW, &check_leak::ROW] {
        let table = t.table(effect.name);
        for (passage, t) in table.tables_or_set() {
            let passages = || oil.iter().flat_map(|o| &o.passages);
            let takes = |law: &PassageLaw| match law {
                PassageLaw::Orifice { .. } => effect.on == On::Orifice,
                PassageLaw::Leak { .. } => effect.on == On::Leak,
                PassageLaw::Check(_) => effect.on == On::Check,
                PassageLaw::Pipe(_) => false,
            };
            let known: Vec<&str> = passages().filter(|p| takes(&p.law)).map(|p| last_name(&p.path)).collect();
            let [size] = numbers(&t, effect);
            if !known.contains(&passage.as_str()) {
                let what = effect.on.label();
                let help =
                    if known.is_empty() { "there is none".into() } else { format!("there are: {}", known.join(", ")) };
                t.error(format!("`{passage}` is not {what}"), Some(help));
            }
            let gap = passages().filter(|p| last_name(&p.path) == passage).find_map(|p| match &p.law {
                PassageLaw::Leak { gap, .. } => Some(gap),
                PassageLaw::Orifice { .. } | PassageLaw::Check(_) | PassageLaw::Pipe(_) => None,
            });
            if gap.is_some_and(|gap| gap.gap_m + size > WIDEST_GAP * gap.diameter_m) {
                let help = "with the declared gap at most a tenth of the diameter";
                t.error_at("gap_um", "the gap is too wide for a flow along a narrow slit".into(), Some(help.into()));
            }
            own.passages.push(PassageEffect { path: t.path().to_string(), passage, size });
            t.finish();
        }
        table.finish();
    }
    let leaks = |p: &PassageSpec| {
        let is_own = |e: &PassageEffect| e.passage == last_name(&p.path);
        matches!(p.law, PassageLaw::Check(_)) && own.passages.iter().any(is_own)
    };
    let [without, passages] =
        oil.map_or([0; 2], |oil| [largest_island(oil, |_| false)[1], largest_island(oil, leaks)[1]]);
    if passages > MAX_PASSAGES && without <= MAX_PASSAGES {
        let title = format!("with these holes {passages} passages are joined: at most {MAX_PASSAGES} are computed");
        t.table(check_leak::ROW.name).error(title, None);
    }
}

/// Effects on spans of chains of spans, by their names.
fn read_span_effects(t: &TomlTable<'_>, spans: &[String], effects: &mut Effects) {
    for effect in [&span_stiffness::ROW, &span_damping::ROW] {
        let table = t.table(effect.name);
        for (name, own) in table.tables_or_set() {
            if spans.iter().all(|s| *s != name) {
                let known = if spans.is_empty() {
                    "only chains with `fidelity = \"spans\"` have spans that effects act on".to_string()
                } else {
                    format!("spans: {}", spans.join(", "))
                };
                own.error(format!("no span is called `{name}`"), Some(known));
            }
            let [more] = numbers(&own, effect);
            let is_stiffness = *effect == span_stiffness::ROW;
            let (stiffness_n_per_m, damping_n_s_per_m) = if is_stiffness { (more, 0.0) } else { (0.0, more) };
            effects.spans.push(SpanEffect { span: name, stiffness_n_per_m, damping_n_s_per_m });
            own.finish();
        }
        table.finish();
    }
}
