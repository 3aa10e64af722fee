//! Waves in their usual form: a negative amplitude is a positive one half a turn on, and a phase lies within half a turn of zero. A fit may end
//! at any of these.

use crate::effects::Kind;

/// A number of an effect `a sin(... + phase)`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct WaveNumber {
    pub kind: Kind,
    /// Set if it holds for one record only.
    pub record: Option<String>,
    /// A phase in degrees.
    pub value: f64,
}

/// Brings amplitudes and phases into their usual form, if there are any phases. A number of a record goes with the others of its record.
pub(super) fn to_usual_form(numbers: &mut [WaveNumber]) {
    let amplitudes = || numbers.iter().filter(|n| n.kind == Kind::Amplitude);
    let has_phase = |record: &Option<String>| numbers.iter().any(|n| n.kind == Kind::Phase && n.record == *record);
    let all_negative = amplitudes().count() > 0 && amplitudes().all(|n| n.value < 0.0);
    // What can be turned alone: an amplitude of a record that has a phase of its own.
    let is_alone = |n: &WaveNumber| n.value < 0.0 && n.record.is_some() && has_phase(&n.record);
    let turned: Vec<Option<String>> = amplitudes().filter(|n| is_alone(n)).map(|n| n.record.clone()).collect();
    if !numbers.iter().any(|n| n.kind == Kind::Phase) {
        return;
    }
    for n in numbers {
        let is_turned = all_negative || turned.contains(&n.record);
        if n.kind == Kind::Amplitude && is_turned {
            n.value = -n.value;
        } else if n.kind == Kind::Phase {
            let phase = n.value + if is_turned { 180.0 } else { 0.0 };
            n.value = phase - 360.0 * libm::ceil((phase - 180.0) / 360.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Kind, record and value of a number.
    type Number = (Kind, Option<&'static str>, f64);

    /// The wave has the same values before and after, whatever has a value for each record.
    #[test]
    fn the_usual_form_is_the_same_wave() {
        use Kind::{Amplitude, Phase};
        // The last column: whether an amplitude stays negative, because the records share a phase.
        let cases: [(&[Number], bool); 5] = [
            (&[(Amplitude, None, -2.0), (Phase, None, 856.0)], false),
            (&[(Amplitude, None, -2.0), (Phase, Some("a"), -190.0), (Phase, Some("b"), 3016.0)], false),
            (&[(Amplitude, Some("a"), -2.0), (Amplitude, Some("b"), -1.0), (Phase, None, 40.0)], false),
            (&[(Amplitude, Some("a"), -2.0), (Amplitude, Some("b"), 1.0), (Phase, None, 540.0)], true),
            (
                &[
                    (Amplitude, Some("a"), -2.0),
                    (Amplitude, Some("b"), 1.0),
                    (Phase, Some("a"), 0.0),
                    (Phase, Some("b"), 400.0),
                ],
                false,
            ),
        ];
        for (case, stays_negative) in cases {
            let number = |(kind, record, value): &Number| WaveNumber {
                kind: *kind,
                record: record.map(String::from),
                value: *value,
            };
            let before: Vec<WaveNumber> = case.iter().map(number).collect();
            let mut after = before.clone();
            to_usual_form(&mut after);
            let of = |all: &[WaveNumber], kind: Kind, record: &str| {
                let own = |n: &&WaveNumber| n.kind == kind && n.record.as_deref().is_none_or(|r| r == record);
                all.iter().find(own).unwrap().value
            };
            for (record, q) in [("a", 0.1), ("a", 1.3), ("b", 0.1), ("b", 1.3)] {
                let wave = |all: &[WaveNumber]| {
                    of(all, Amplitude, record) * libm::sin(q + of(all, Phase, record).to_radians())
                };
                assert!((wave(&before) - wave(&after)).abs() < 1e-12, "{case:?} {after:?}");
            }
            let mut phases = after.iter().filter(|n| n.kind == Phase);
            assert!(phases.all(|n| n.value > -180.0 && n.value <= 180.0), "{after:?}");
            assert_eq!(after.iter().any(|n| n.kind == Amplitude && n.value < 0.0), stays_negative, "{after:?}");
        }
    }

    #[test]
    fn without_a_phase_a_sign_means_something() {
        let mut offset = [WaveNumber { kind: Kind::Amplitude, record: None, value: -2.0 }];
        to_usual_form(&mut offset);
        assert_eq!(offset[0].value, -2.0);
    }
}
