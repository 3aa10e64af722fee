//! Placing effects on a machine: keys of the parameters, and added parts.

use super::{Body, BodyMotion, End, Machine, PlacedEffect, Reads, Slot, Spring, Target};
use crate::effects::{EFFECTS, Effect, Kind, Parameter, Physics};

impl Machine {
    /// Keys of an effect's parameters on this target, with their rows.
    pub fn keys(&self, effect: &'static Effect, target: Target) -> Vec<(String, &'static Parameter)> {
        let slides = match target {
            Target::Body(b) => self.bodies.get(b).is_some_and(|b| b.slides),
            Target::Input(i) => self.inputs.get(i).and_then(|i| self.bodies.get(i.body)).is_some_and(|b| b.slides),
            Target::Spring(_) | Target::Sensor(_) | Target::Chain(_) | Target::Part(_) | Target::Span(_) => false,
        };
        let mut keys = Vec::new();
        let with_links = self.period_pitches().is_some();
        for p in effect.parameters.iter().filter(|p| self.accepts(effect, target, p)) {
            let p = p.on_links.filter(|_| with_links).unwrap_or(p);
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
                let (low, high) = self.size_range(effect, target, p);
                m.slots.push(Slot { path: format!("{path}.{key}"), unit: p.unit, low, high });
                m.values.push(*value);
                m.slots.len() - 1
            })
            .collect();
        m.attach_effect(effect, path, target, slots.clone());
        (m, slots)
    }

    /// Range of a parameter of an effect on this target, in the key's unit: that of its row, or less where the part allows less.
    pub fn size_range(&self, effect: &Effect, target: Target, row: &Parameter) -> (f64, f64) {
        let own = self.fidelity.range(effect, target).filter(|_| row.kind.is_amplitude());
        let (least, most) = own.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
        (row.low.max(least / row.unit), row.high.min(most / row.unit))
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
            inertia: Some(inertia),
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
