//! Cases of every class.

use super::effects::{Fault, Law, ROWS, fault};
use super::files::Written;
use super::machine::{Kind, Wish};
use super::numbers::{Random, dot};
use super::weighing::{Bench, outside};
use super::{COARSE, Case, Class, MARK, Truth, fine};

/// Effects that this kind of machine shows. Left out are those that its free parameters absorb (a gauge's gain where
/// all forces are free), and those that need another motion (friction's sign on a chain that never reverses).
pub(super) fn laws(kind: Kind) -> Vec<(Law, &'static [usize])> {
    use Law::{
        Alternate, Attached, Backlash, Constant, Coulomb, DeadZone, Drift, Encoder, Gain, GainCurve, Hardening,
        InputDelay, Lag, Latency, LowPass, Offset, Polygon, Quadratic, Ripple, Runout, SignBlind, Stribeck, ToothPitch,
    };
    const FIRST: &[usize] = &[0];
    const LAST: &[usize] = &[1];
    const BOTH: &[usize] = &[0, 1];
    let every = |laws: &[Law], at: &'static [usize]| -> Vec<(Law, &'static [usize])> {
        laws.iter().map(|l| (*l, at)).collect()
    };
    match kind {
        Kind::One => every(
            &[
                Coulomb, Stribeck, Quadratic, Constant, Ripple, Attached, GainCurve, DeadZone, Lag, InputDelay,
                Encoder, LowPass, Latency, SignBlind, Offset, Drift,
            ],
            FIRST,
        ),
        Kind::Two => [
            every(&[Coulomb, Stribeck, Quadratic, Constant, Ripple, Attached], BOTH),
            every(&[Backlash, Hardening, GainCurve, DeadZone, Lag, InputDelay], FIRST),
            every(&[Encoder, LowPass, Latency, SignBlind, Gain, Offset, Drift], BOTH),
        ]
        .concat(),
        Kind::Chain => [
            every(&[Quadratic, Ripple, Attached], LAST),
            every(&[Hardening], FIRST),
            every(&[Runout, ToothPitch, Polygon, Alternate], BOTH),
            every(&[Encoder, Gain, Offset], FIRST),
            every(&[LowPass, Latency, Drift], BOTH),
        ]
        .concat(),
    }
}

/// Planned content of a case.
struct Draft {
    kind: Kind,
    wish: Wish,
    laws: Vec<(Law, usize, Option<f64>)>,
}

/// By number, so that every effect occurs on every machine.
fn single(turn: u64, random: &mut Random) -> Draft {
    let all: Vec<(Kind, Law, &[usize])> = [Kind::One, Kind::Two, Kind::Chain]
        .into_iter()
        .flat_map(|kind| laws(kind).into_iter().map(move |(law, at)| (kind, law, at)))
        .collect();
    // A stride without common divisor mixes neighbours.
    let (kind, law, places) = all[(turn as usize * 11 + 5) % all.len()];
    let wish = Wish { biased: law == Law::SignBlind, ..Wish::default() };
    Draft { kind, wish, laws: vec![(law, random.pick(places), None)] }
}

fn double(random: &mut Random) -> Draft {
    let kind = random.pick(&[Kind::One, Kind::Two, Kind::Chain]);
    let all = laws(kind);
    let part = |law: Law| ROWS[law as usize].part;
    let (first, places) = random.pick(&all);
    let spring = |law: Law| matches!(law, Law::Backlash | Law::Hardening);
    let fits = |law: Law| part(law) != part(first) && !(spring(law) && spring(first));
    let others: Vec<(Law, &[usize])> = all.into_iter().filter(|(l, _)| fits(*l)).collect();
    let (second, more) = random.pick(&others);
    let wish = Wish { biased: first == Law::SignBlind || second == Law::SignBlind, ..Wish::default() };
    Draft { kind, wish, laws: vec![(first, random.pick(places), None), (second, random.pick(more), None)] }
}

fn out_of_catalogue(number: u64, random: &mut Random) -> Draft {
    let (kind, law) = match number % 6 {
        0 => (random.pick(&[Kind::One, Kind::Two, Kind::Chain]), Law::Bump),
        1 => (random.pick(&[Kind::Two, Kind::Chain]), Law::Hysteresis),
        2 => (random.pick(&[Kind::One, Kind::Two, Kind::Chain]), Law::Intermittent),
        3 => (random.pick(&[Kind::One, Kind::Two, Kind::Chain]), Law::RandomWalk),
        4 => (random.pick(&[Kind::One, Kind::Two]), Law::Cubic),
        _ => (random.pick(&[Kind::One, Kind::Two]), Law::Mass),
    };
    let at = if law == Law::Hysteresis || kind == Kind::One { 0 } else { 1 };
    Draft { kind, wish: Wish::default(), laws: vec![(law, at, None)] }
}

fn confusable(number: u64, random: &mut Random) -> Draft {
    let none = Wish::default();
    let (kind, wish, law) = match number % 7 {
        // On a linear machine with one sensor all positions of a delay are equivalent.
        0 => (Kind::One, none, (random.pick(&[Law::InputDelay, Law::Latency]), 0, None)),
        1 => (Kind::One, none, (random.pick(&[Law::Lag, Law::LowPass]), 0, None)),
        2 => match random.chance(0.5) {
            true => (Kind::One, none, (random.pick(&[Law::InputOffset, Law::Constant, Law::Offset]), 0, None)),
            false if random.chance(0.5) => (Kind::Two, none, (Law::InputOffset, 0, None)),
            false => (Kind::Two, none, (Law::Constant, random.below(2), None)),
        },
        // Without reversal, friction is a constant load.
        3 => {
            let wish = Wish { one_way: true, ..none };
            (Kind::One, wish, (random.pick(&[Law::Coulomb, Law::DeadZone, Law::Constant]), 0, None))
        }
        // One speed, one channel: everything that repeats once per revolution.
        4 => {
            let teeth = Some([19, 15 + 2 * random.below(10) as u32 + u32::from(random.chance(0.5)) * 16]);
            let wish = Wish { one_speed: true, one_channel: true, teeth, ..none };
            let (law, at) = random.pick(&[(Law::Encoder, 0), (Law::Runout, 1), (Law::Ripple, 1)]);
            (Kind::Chain, wish, (law, at, Some(1.0)))
        }
        // Equal tooth counts: both bodies turn alike.
        5 => {
            let z = 15 + random.below(12) as u32;
            (Kind::Chain, Wish { teeth: Some([z, z]), one_channel: true, ..none }, (Law::Runout, random.below(2), None))
        }
        // Two turns of one for one turn of the other.
        _ => {
            let z = 13 + random.below(8) as u32;
            let law = random.pick(&[(Law::Runout, 1, None), (Law::ToothPitch, 0, Some(2.0))]);
            (Kind::Chain, Wish { teeth: Some([2 * z, z]), one_channel: true, ..none }, law)
        }
    };
    Draft { kind, wish, laws: vec![law] }
}

fn draft(class: Class, number: u64, attempt: u64, random: &mut Random) -> Draft {
    match class {
        // After many failures with one effect, the next one.
        Class::Single => single(number + attempt / 40, random),
        Class::Double => double(random),
        Class::Outside => out_of_catalogue(number, random),
        Class::Confusable => confusable(number, random),
        Class::Clean => {
            let kind = random.pick(&[Kind::One, Kind::Two, Kind::Chain]);
            Draft { kind, wish: Wish::default(), laws: Vec::new() }
        }
    }
}

/// One attempt at a case; None if no plausible size gives the drawn magnitude.
pub(super) fn attempted(class: Class, number: u64, attempt: u64, random: &mut Random) -> Option<Case> {
    let draft = draft(class, number, attempt, random);
    let bench = Bench::new(draft.kind, draft.wish, random);
    let mut faults: Vec<Fault> = Vec::new();
    for (law, at, order) in &draft.laws {
        if bench.m.slides && matches!(law, Law::Ripple | Law::Encoder) {
            return None;
        }
        let mut f = fault(*law, *at, &bench.m, &bench.scale, random);
        if let Some(order) = order {
            f.form[0] = *order;
        }
        let low = match class {
            Class::Single => MARK.0,
            Class::Double | Class::Confusable => 1.0,
            _ => 2.0,
        };
        let target = random.log_between(low, MARK.1);
        faults.push(bench.sized(&faults, &f, target)?);
    }
    let shown = bench.shows(&bench.m, &faults, fine(draft.kind), None, true);
    let (truth, rivals) = weighed(&bench, &faults, &shown, class)?;
    let written = Written::new(&bench, class, number, random);
    let mut name = format!("{class:?}-{number:03}-{:?}", bench.m.kind).to_lowercase();
    for f in &faults {
        name += &format!("-{}", f.row().name.replace('_', "-"));
    }
    let columns = written.columns(&bench, &shown, random);
    Some(Case {
        drive_toml: written.drive(&bench.m, &name),
        measurement_toml: written.measurement(&bench, &name),
        csvs: written.csvs(&bench, &columns),
        numbers: written.numbers(&bench.m),
        name,
        class,
        truth,
        rivals,
    })
}

/// The contribution of each fault, and its rivals; None if the class is not met.
fn weighed(bench: &Bench, faults: &[Fault], shown: &[f64], class: Class) -> Option<(Vec<Truth>, Vec<String>)> {
    let mut truth = Vec::new();
    let mut rivals: Vec<String> = Vec::new();
    let mut marks: Vec<Vec<f64>> = Vec::new();
    for (i, f) in faults.iter().enumerate() {
        let others: Vec<Fault> = faults.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, f)| *f).collect();
        let without = bench.shows(&bench.m, &others, fine(bench.m.kind), None, true);
        let added: Vec<f64> = shown.iter().zip(&without).map(|(a, b)| a - b).collect();
        let over_floor = bench.best(&added, true);
        if !(over_floor > 0.8 * MARK.0 && (over_floor < 1.3 * MARK.1 || f.law == Law::SignBlind)) {
            return None;
        }
        let beside = bench.beside(&others, COARSE, false);
        let frame = bench.frame(&beside);
        let mark = outside(&beside.mark(f), &frame);
        let sigmas = dot(&mark, &mark).sqrt();
        if class != Class::Outside && sigmas > 3.0 {
            rivals.extend(bench.rivals(&beside, f, &mark, &frame));
        }
        let after_fit = bench.best(&mark, false);
        truth.push(Truth { path: f.path(&bench.m), sizes: f.sizes(&bench.m), over_floor, after_fit, sigmas });
        marks.push(mark);
    }
    rivals.sort();
    rivals.dedup();
    if class == Class::Confusable && (rivals.is_empty() || truth.iter().any(|t| t.sigmas < 6.0)) {
        return None;
    }
    if let [a, b] = marks.as_slice() {
        // Two effects with the same contribution count as one.
        let along = dot(a, b);
        if along * along > 0.7 * dot(a, a) * dot(b, b) {
            return None;
        }
    }
    Some((truth, rivals))
}
