//! A small, fixed share of the blind test; the whole test is `cargo bench --bench blind`.

#[path = "blind/mod.rs"]
mod blind;
#[path = "blind/judge.rs"]
mod judge;

use blind::Class;

#[test]
fn a_share_of_the_blind_cases_is_named_right_and_nothing_is_named_that_is_not_there() {
    let mut table = judge::Table::default();
    let mut right = 0;
    for (class, n) in [(Class::Single, SINGLE), (Class::Clean, CLEAN)] {
        for o in judge::outcomes(class, 0..n, |_| {}) {
            println!("{}", o.line);
            right += usize::from(o.in_set);
            assert!(!o.line.contains("FAILED"), "{}", o.line);
            assert!(!o.false_name, "{}", o.line);
            assert!(!o.explained_wrongly, "{}", o.line);
            table.add(&o);
        }
    }
    println!("{table}");
    assert!(right >= NAMED, "{right} named");
}

/// Cases that were named wrong before records were also started in the other direction (72), fitted records judged
/// effects that the held-out ones do not show (87), short stretches were used (37), and filters and added bodies had an
/// initial state (103).
#[test]
fn cases_that_need_a_second_look_are_named_right() {
    are_named_right(&[37, 72, 87, 103].map(|number| (Class::Single, number)));
}

/// With two effects, and an initial state. (This test and the next one take longest: their names make them start
/// first.)
#[test]
fn a_pair_with_a_memory_at_the_start_is_named_right() {
    are_named_right(&[(Class::Double, 9)]);
}

/// The declared model, without its two effects, fits best as a slipping chain.
#[test]
#[ignore = "takes 100 s: .ci/run runs it"]
fn a_pair_without_which_the_chain_seems_to_slip_is_named_right() {
    are_named_right(&[(Class::Double, 25)]);
}

fn are_named_right(cases: &[(Class, u64)]) {
    for (class, number) in cases.iter().copied() {
        for o in judge::outcomes(class, number..number + 1, |_| {}) {
            println!("{}", o.line);
            let all = if class == Class::Double { o.both } else { o.in_set };
            assert!(all && !o.false_name && o.line.contains("explained true"), "{}", o.line);
        }
    }
}

/// Causes outside the catalogue get no name: a drag by the third power of speed (16), which a quadratic one fits well,
/// and a span with hysteresis (13), for which a hardening span needs another size in every record.
#[test]
fn causes_that_the_catalogue_does_not_have_get_no_name() {
    for number in [13, 16] {
        for o in judge::outcomes(Class::Outside, number..number + 1, |_| {}) {
            println!("{}", o.line);
            assert!(o.set_size == 0, "{}", o.line);
        }
    }
}

/// Cases of each class.
const SINGLE: u64 = 10;
const CLEAN: u64 = 6;
/// Ten machines have an effect. Half of the effects are below three times the noise before the fit, and all of them are after it, because
/// the free parameters absorb what they can. measured: 5 are named.
const NAMED: usize = 5;
