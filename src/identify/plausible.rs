//! Whether an effect has a size that the records can show, and whether a set that leaves something is one that can be.
//!
//! A law whose form lies outside what was measured takes another form inside it: friction with a bend at a speed that the body never reaches is a
//! damper, a resonance that is slower than the record is a drift.

use super::judge::Residuals;
use super::model::{FittedModel, globals_of};
use crate::effects::{Kind, Scale, constant_torque, offset, warming_friction};
use crate::machine::simulate::Samples;
use crate::machine::{Input, InputKind, Reads, Target};

/// A law of the speed must bend below so many root mean squares of the body's speed. A sine reaches 1.4 of them, a run-up from rest 1.7.
const REACHED: f64 = 3.0;
/// Periods of a resonance in the longest record, at least: with fewer, a drift has the same form.
const PERIODS: f64 = 2.0;

/// What speaks against the form of an effect, in words.
pub fn outside_the_records(model: &FittedModel, which: usize) -> Option<String> {
    let h = &model.effects[which];
    let longest_s = model.problem.data.clocks.iter().map(|c| c.length_s).fold(0.0, f64::max);
    for g in globals_of(model, which) {
        let global = &model.problem.globals[g];
        let slot = &model.problem.machine.slots[global.slot];
        let key = slot.path.rsplit('.').next().unwrap_or_default();
        let value = global.law.value(model.fit.point.globals[g]);
        let shown = value / slot.unit;
        let of_key = h.rows.iter().zip(&h.scales).find(|(row, _)| row.key == key || row.sliding_key == key);
        if let Some((row, speed)) = of_key
            && (row.scale, row.kind) == (Scale::Speed, Kind::Shape)
            && value > REACHED * speed
        {
            return Some(format!(
                "`{key}` = {shown:.4}, where the body's speed is {:.4} in the root mean square: the records do not reach the bend of this law",
                speed / slot.unit
            ));
        }
        let frequency_hz = match key {
            "frequency_hz" => shown,
            "period_ms" => 1e3 / shown,
            _ => continue,
        };
        if frequency_hz * longest_s < PERIODS {
            return Some(format!(
                "`{key}` = {shown:.4}: the longest record, of {longest_s:.3} s, holds less than two periods of it"
            ));
        }
    }
    None
}

/// Whether the form of every effect of a set lies inside the records.
pub fn is_inside_the_records(set: &FittedModel) -> bool {
    (0..set.effects.len()).all(|which| outside_the_records(set, which).is_none())
}

/// What a set leaves of held-out records over what it leaves of fitted ones may be so many times what the declared model's is. Measured on machines whose cause
/// the catalogue lacks: 3.2 where a fluctuation of the load was taken for an error of the encoder.
const CARRIED_OVER: f64 = 2.0;

/// What speaks against a set that leaves more than noise: it does not carry over to held-out records, or holds two laws of dry friction on one body.
pub fn doubts(declared: &FittedModel, best: &FittedModel) -> Vec<String> {
    let mut all = Vec::new();
    let over = |r: &Residuals, c: usize| {
        let (fitted, held_out) = r.rms(c);
        (fitted > 0.0 && held_out.is_finite()).then(|| held_out / fitted)
    };
    for (c, channel) in best.problem.data.channels.iter().enumerate() {
        let (Some(before), Some(after)) = (over(declared.residuals(), c), over(best.residuals(), c)) else { continue };
        if after > CARRIED_OVER * before.max(1.0) {
            all.push(format!(
                "what is left of `{}` in held-out records is {after:.1} times that in fitted ones, and was {before:.1} times without effects: \
                 the set does not carry over",
                channel.name
            ));
        }
    }
    // What falls while a machine warms up comes on top of what stays.
    let dry = |which: usize| {
        let effect = best.effects[which].effect;
        effect.kin.family == Some(DRY_FRICTION) && *effect != warming_friction::ROW
    };
    for which in 0..best.effects.len() {
        let own = &best.effects[which];
        if dry(which) && (0..which).any(|other| dry(other) && best.effects[other].target == own.target) {
            all.push(format!(
                "two laws of friction stand on `{}` together, and something is left: it may have neither",
                own.name
            ));
        }
    }
    all
}

/// A force may be so many times the largest that goes in and that an inertia gives; accelerations are means over so many samples.
const MOST_OF_INPUT: f64 = 3.0;
const OVER_SAMPLES: usize = 8;
/// A zero offset may differ from what the channel reads at rest by this share of itself, beside so many times the noise.
const OFFSET_AT_REST: f64 = 0.2;
const NOISE_AT_REST: f64 = 10.0;

/// What speaks against sizes that the records themselves refute: a force far above what goes in and what inertia gives, an offset that a channel at rest does not show.
pub fn sizes_that_no_machine_has(best: &FittedModel) -> Vec<String> {
    (0..best.effects.len())
        .filter_map(|which| force_above_inputs(best, which).or_else(|| offset_at_rest(best, which)))
        .collect()
}

/// The largest amplitude of an effect, scaled, with its path.
fn largest_amplitude(best: &FittedModel, which: usize) -> Option<(f64, String)> {
    let row_of = |key: &str| best.effects[which].rows.iter().find(|row| row.key == key || row.sliding_key == key);
    let of = |g: usize| {
        let slot = &best.problem.machine.slots[best.problem.globals[g].slot];
        let row = row_of(slot.path.rsplit('.').next().unwrap_or_default())?;
        let value = best.problem.globals[g].law.value(best.fit.point.globals[g]);
        (row.kind == Kind::Amplitude).then(|| (value, slot.path.clone()))
    };
    globals_of(best, which).into_iter().filter_map(of).max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))
}

/// A constant force or a dry friction on a body that one measured force drives, far above that force and what the body's own inertia gives as it speeds
/// up or slows down: F = u - J a, whatever moves.
fn force_above_inputs(best: &FittedModel, which: usize) -> Option<String> {
    let h = &best.effects[which];
    let machine = &best.problem.machine;
    let Target::Body(body) = h.target else { return None };
    let is_force = h.effect.kin.family == Some(DRY_FRICTION) || *h.effect == constant_torque::ROW;
    let is_own = |input: &Input| matches!(input.kind, InputKind::Force(_)) && input.body == body;
    let is_loaded = machine.placed.iter().any(|p| p.target == h.target && *p.effect == constant_torque::ROW);
    let others = best.effects.iter().filter(|e| e.target == h.target).count() > 1;
    if !is_force
        || is_loaded
        || others
        || !machine.springs.is_empty()
        || machine.inputs.iter().filter(|i| is_own(i)).count() != 1
    {
        return None;
    }
    let number = |slot: usize| {
        let fitted = best.problem.globals.iter().position(|g| g.slot == slot && g.record.is_none());
        fitted.map_or(machine.values[slot], |g| best.problem.globals[g].law.value(best.fit.point.globals[g]))
    };
    let (input, gain) = machine.inputs.iter().enumerate().find_map(|(k, input)| match input.kind {
        InputKind::Force(gain) if is_own(input) => Some((k, number(gain))),
        InputKind::Force(_) | InputKind::Speed | InputKind::Angle | InputKind::Acceleration => None,
    })?;
    // A speed of the body is measured: its mean changes over a few samples tell the acceleration.
    let c = best.problem.data.channels.iter().position(|c| machine.sensors[c.sensor].reads == Reads::Speed(body))?;
    let per_unit = number(machine.sensors[best.problem.data.channels[c].sensor].gain);
    let inertia = number(machine.bodies[body].inertia?);
    let mut largest = 0.0_f64;
    for s in &best.problem.data.segments {
        let Samples::Times { step_s, .. } = s.task.samples else { return None };
        let force = s.task.inputs.get(input)?.iter().fold(0.0_f64, |most, u| most.max((gain * u).abs()));
        let means: Vec<f64> =
            s.measured[c].chunks(OVER_SAMPLES).map(|own| own.iter().sum::<f64>() / own.len() as f64).collect();
        let changes = means.windows(2).map(|w| (w[1] - w[0]).abs() / per_unit.abs()).filter(|d| d.is_finite());
        let acceleration = changes.fold(0.0, f64::max) / (OVER_SAMPLES as f64 * step_s);
        largest = largest.max(force + inertia * acceleration);
    }
    let (size, path) = largest_amplitude(best, which)?;
    (size.abs() > MOST_OF_INPUT * largest).then(|| {
        format!(
            "`{path}` is {:.1} times what goes in and what the inertia gives, at most: nothing moves against that",
            size.abs() / largest
        )
    })
}

/// A zero offset that a channel does not show where the machine is declared to be at rest.
fn offset_at_rest(best: &FittedModel, which: usize) -> Option<String> {
    let h = &best.effects[which];
    let Target::Sensor(sensor) = h.target else { return None };
    let reads = best.problem.machine.sensors[sensor].reads;
    if *h.effect != offset::ROW
        || globals_of(best, which).len() != 1
        || !matches!(reads, Reads::Angle(_) | Reads::Speed(_))
    {
        return None;
    }
    let c = best.problem.data.channels.iter().position(|c| c.sensor == sensor)?;
    let channel = &best.problem.data.channels[c];
    let at_rest = best.problem.data.segments.iter().filter(|s| s.at_rest);
    let first = at_rest.filter_map(|s| s.measured.get(c)?.iter().copied().find(|v| v.is_finite())).next()?;
    let (size, path) = largest_amplitude(best, which)?;
    let shown = |value: f64| value * channel.shown;
    ((first - size).abs() > NOISE_AT_REST * channel.sensor_noise + OFFSET_AT_REST * size.abs()).then(|| {
        format!(
            "`{path}` is {:.4} {}, and the channel begins with {:.4} at rest: it has no such offset",
            shown(size),
            channel.unit,
            shown(first)
        )
    })
}

/// Friction whose size does not grow with the speed, as the catalogue names the family.
const DRY_FRICTION: &str = "friction";
