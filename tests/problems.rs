//! Whole runs of `identify` on small machines out of random bytes: each ends with an answer or with a reason, never with a panic. The fuzz target
//! `identified` does the same for hours; `PITCHLINE_PROBLEMS=200..5000` runs others here, `PITCHLINE_PROBLEM=FILE` one that it has found, and prints it.

#[path = "problems/mod.rs"]
mod problems;

use pitchline::random::SplitMix;
use problems::SmallProblem;

/// Problems of the test.
const PROBLEMS: std::ops::Range<u64> = 0..200;

/// Problems that the fuzzer has found.
const FOUND: [&[u8]; 2] = [
    // Nothing is left of a record, so that no number has an error.
    b"AFF\xd6F=\xd4#00000biiiiiiiiii\x18\x18\x18\x18\x18\x18\x18ii%\xd4\xdd\xd6",
    // A record of zeros tells nothing of a number.
    b"\x0C#-#-\xD7\xAB\xCE-..................##\xAB)-#\xDD,,,,T\x99\xB3",
];

#[test]
fn problems_that_were_found_end_with_an_answer() {
    let folder = tempfile::tempdir().expect("a folder");
    for bytes in FOUND {
        assert!(SmallProblem::new(bytes, folder.path()).answers(folder.path()), "{bytes:?}");
    }
}

#[test]
fn any_small_problem_ends_with_an_answer_or_a_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    if let Some(file) = std::env::var_os("PITCHLINE_PROBLEM") {
        let problem = SmallProblem::new(&std::fs::read(file).expect("a file"), folder.path());
        println!("{}\n{}\n{:?}", problem.measurement, problem.drive, problem.budget);
        problem.records.iter().for_each(|(name, csv)| println!("{name}: {csv}"));
        let started = std::time::Instant::now();
        println!("answered: {} after {:?}", problem.answers(folder.path()), started.elapsed());
        return;
    }
    let asked = std::env::var("PITCHLINE_PROBLEMS").ok();
    let asked = asked.as_ref().and_then(|range| range.split_once(".."));
    let seeds = asked.map_or(PROBLEMS, |(a, b)| a.parse().expect("a number")..b.parse().expect("a number"));
    let count = seeds.end - seeds.start;
    let (mut answers, mut panics) = (0, Vec::new());
    for seed in seeds {
        let mut random = SplitMix::of(&[seed]);
        let bytes: Vec<u8> = (0..4000).map(|_| random.bits().to_le_bytes()[0]).collect();
        match std::panic::catch_unwind(|| SmallProblem::new(&bytes, folder.path()).answers(folder.path())) {
            Ok(answered) => answers += u64::from(answered),
            Err(_) => panics.push(seed),
        }
    }
    assert!(panics.is_empty(), "problems {panics:?}");
    // Problems that are all refused would show nothing.
    assert!(3 * answers > count, "{answers} of {count} came to an answer");
}
