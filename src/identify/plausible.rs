//! Whether an effect has a size that the records can show, and whether a set that leaves something is one that can be.
//!
//! A law whose form lies outside what was measured takes another form inside it: friction with a bend at a speed that the body never reaches is a
//! damper, a resonance that is slower than the record is a drift.

use super::judge::Residuals;
use super::model::{FittedModel, globals_of};
use crate::effects::{Kind, Scale, warming_friction};

/// A law of the speed must bend below so many root mean squares of the body's speed. A sine reaches 1.4 of them, a run-up from rest 1.7.
const REACHED: f64 = 3.0;
/// Periods of a resonance in the longest record, at least.
const PERIODS: f64 = 1.0;

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
                "`{key}` = {shown:.4}: the longest record, of {longest_s:.3} s, holds no period of it"
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

/// Friction whose size does not grow with the speed, as the catalogue names the family.
const DRY_FRICTION: &str = "friction";
