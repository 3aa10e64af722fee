//! Placing effects on a machine: possible targets, keys of the parameters, and added parts.

use super::{Body, BodyMotion, End, InputKind, Machine, PlacedEffect, Reads, Slot, Spring, Target, links};
use crate::effects::{EFFECTS, Effect, Kind, On, Parameter, Physics};

impl Machine {
    /// All possible targets of an effect, with their names.
    pub fn targets(&self, effect: &Effect) -> Vec<(String, Target)> {
        if let Some(linked) = &self.linked {
            return self.targets_on_links(linked, effect);
        }
        if matches!(effect.physics, Physics::LinksOnly) {
            return Vec::new();
        }
        // Parts that were added by effects carry no effects of their own.
        let by_angle = effect.parameters.iter().any(|p| p.kind == Kind::Phase);
        let declared = |path: &str| !path.starts_with("effects.");
        let bodies = |fits: &dyn Fn(&Body) -> bool| {
            let all = self.bodies.iter().enumerate();
            all.filter(|(_, b)| declared(&b.path) && fits(b)).map(|(i, b)| (b.name.clone(), Target::Body(i))).collect()
        };
        let sensors = |fits: &dyn Fn(&Reads) -> bool| {
            let all = self.sensors.iter().enumerate();
            all.filter(|(_, s)| fits(&s.reads)).map(|(i, s)| (s.name.clone(), Target::Sensor(i))).collect()
        };
        let sprung = |i: usize| self.springs.iter().any(|s| s.ends.iter().any(|e| e.body == i));
        match effect.on {
            On::Body => bodies(&|b| b.motion == BodyMotion::Free && !(b.slides && by_angle)),
            // A measured speed already contains its fluctuation.
            On::Prescribed => bodies(&|b| matches!(b.motion, BodyMotion::Constant(_)) && !b.slides),
            On::Sprocket => {
                let all = self.bodies.iter().enumerate();
                all.filter(|(i, b)| b.teeth.is_some() && sprung(*i))
                    .map(|(i, b)| (b.name.clone(), Target::Body(i)))
                    .collect()
            }
            On::Span => {
                let all = self.springs.iter().enumerate().filter(|(_, s)| declared(&s.path));
                all.map(|(i, s)| (s.name.clone(), Target::Spring(i))).collect()
            }
            On::Chain | On::Joints => {
                let located = self.springs.iter().any(|s| s.links.is_some());
                let needs = effect.on == On::Chain;
                if self.chain.is_some() && (located || !needs) {
                    vec![("chain".to_string(), Target::Chain)]
                } else {
                    Vec::new()
                }
            }
            On::Guide => Vec::new(),
            On::Input => {
                let all = self.inputs.iter().enumerate();
                all.filter(|(_, i)| matches!(i.kind, InputKind::Force(_)))
                    .map(|(k, i)| (i.name.clone(), Target::Input(k)))
                    .collect()
            }
            On::Sensor => sensors(&|r| !matches!(r, Reads::Pulses { .. })),
            On::AngleSensor => sensors(&|r| match r {
                Reads::Angle(b) | Reads::Speed(b) => !self.bodies[*b].slides,
                Reads::Acceleration(_)
                | Reads::Pulses { .. }
                | Reads::Tension(_)
                | Reads::Reaction(_)
                | Reads::Span(_)
                | Reads::Link(_)
                | Reads::Guide(_)
                | Reads::Part(_) => false,
            }),
            On::Pickup => sensors(&|r| matches!(r, Reads::Pulses { .. })),
        }
    }

    /// Keys of an effect's parameters on this target, with their rows.
    pub fn keys(&self, effect: &'static Effect, target: Target) -> Vec<(String, &'static Parameter)> {
        let slides = match target {
            Target::Body(b) => self.bodies.get(b).is_some_and(|b| b.slides),
            Target::Spring(_) | Target::Input(_) | Target::Sensor(_) | Target::Chain | Target::Guide(_) => false,
        };
        let mut keys = Vec::new();
        for p in effect.parameters.iter().filter(|p| self.linked.is_none() || links::accepts(effect, p)) {
            let key = if slides { p.sliding_key } else { p.key };
            if p.kind == Kind::PerMark {
                let reads = if let Target::Sensor(s) = target { self.sensors.get(s).map(|s| s.reads) } else { None };
                let marks = if let Some(Reads::Pulses { marks, .. }) = reads { marks } else { 1 };
                for mark in 1..marks.min(super::read::MAX_MARKS) {
                    keys.push((key.replace('#', &mark.to_string()), p));
                }
            } else {
                keys.push((key.to_string(), p));
            }
        }
        keys
    }

    /// The machine with one more effect, its slots at `values` (SI).
    pub fn with_effect(
        &self,
        effect: &'static Effect,
        name: &str,
        target: Target,
        values: &[f64],
    ) -> (Machine, Vec<usize>) {
        let mut m = self.clone();
        let path = format!("effects.{}.{name}", effect.name);
        let keys = self.keys(effect, target);
        let slots: Vec<usize> = keys
            .iter()
            .zip(values)
            .map(|((key, p), value)| {
                m.slots.push(Slot { path: format!("{path}.{key}"), unit: p.unit, low: p.low, high: p.high });
                m.values.push(*value);
                m.slots.len() - 1
            })
            .collect();
        m.attach_effect(effect, path, target, slots.clone());
        (m, slots)
    }

    /// Places an effect whose slots exist; signals pass the effects in the order of the catalogue.
    pub(super) fn attach_effect(&mut self, effect: &'static Effect, path: String, target: Target, slots: Vec<usize>) {
        if let (Physics::SecondBody { sensors_move }, Target::Body(near)) = (effect.physics, target) {
            self.second_body(near, &path, &slots, sensors_move);
        }
        self.placed.push(PlacedEffect { effect, path, target, slots });
        let rank = |e: &Effect| EFFECTS.iter().position(|o| o.name == e.name).unwrap_or(EFFECTS.len());
        self.placed.sort_by_key(|p| rank(p.effect));
    }

    /// Adds a body that a spring connects to the body `near`.
    fn second_body(&mut self, near: usize, path: &str, slots: &[usize], sensors_move: bool) {
        let [inertia, stiffness, damping] = *slots else { return };
        let far = self.bodies.len();
        let Body { slides, name, .. } = self.bodies[near].clone();
        self.bodies.push(Body {
            name: format!("{name} behind {path}"),
            path: path.to_string(),
            slides,
            inertia,
            minus: None,
            teeth: None,
            motion: BodyMotion::Free,
        });
        self.slots.push(Slot { path: format!("{path}.one"), unit: 1.0, low: 1.0, high: 1.0 });
        self.values.push(1.0);
        let one = self.slots.len() - 1;
        let end = |body, sign| End { body, gain: one, sign };
        self.springs.push(Spring {
            name: path.to_string(),
            path: path.to_string(),
            ends: vec![end(near, 1), end(far, -1)],
            stiffness,
            damping,
            tuned: Some(inertia),
            links: None,
        });
        if sensors_move {
            self.bodies[near].minus = Some(inertia);
            for s in &mut self.sensors {
                if let Reads::Angle(b) | Reads::Speed(b) | Reads::Acceleration(b) | Reads::Pulses { body: b, .. } =
                    &mut s.reads
                    && *b == near
                {
                    *b = far;
                }
            }
        }
    }
}
