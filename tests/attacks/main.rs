//! Inputs by attackers and accidents, generated from seeds: no panic, no hang, no memory beyond the stated limits, and
//! no wrong answer without a message. `fuzz/attack/` contains more of them, for hours.
#![cfg(unix)]

mod outputs;
mod recordings;
#[cfg(all(feature = "live", feature = "web"))]
mod servers;
mod texts;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const PROGRAM: &str = env!("CARGO_BIN_EXE_pitchline");
/// Time limit of a run.
const LONGEST: Duration = Duration::from_secs(10);

/// Pseudorandom numbers that depend only on the seed (Steele and others 2014, SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    fn of<'a, T: ?Sized>(&mut self, all: &[&'a T]) -> &'a T {
        all[self.below(all.len())]
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn sample() -> PathBuf {
    root().join("recordings/samples/bush-20-40.mcap")
}

/// Runs the program; it must end in time, by itself, without a panic, and print a message if it fails.
fn run(folder: &Path, args: &[&str]) -> Output {
    let started = Instant::now();
    let mut child = Command::new(PROGRAM)
        .args(args)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    // Read on another thread, because a full pipe would block the program.
    let mut stderr = child.stderr.take().expect("piped");
    let errors = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut stderr, &mut bytes).expect("read");
        bytes
    });
    let mut stdout = child.stdout.take().expect("piped");
    let answer = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut stdout, &mut bytes).expect("read");
        bytes
    });
    let status = loop {
        if let Some(status) = child.try_wait().expect("lives") {
            break status;
        }
        if started.elapsed() > LONGEST + Duration::from_secs(20) {
            child.kill().expect("ends");
            panic!("{args:?} takes for ever");
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    let out = Output { status, stdout: answer.join().expect("read"), stderr: errors.join().expect("read") };
    let said = String::from_utf8_lossy(&out.stderr);
    let code = out.status.code().unwrap_or_else(|| panic!("{args:?} ended by {status}: {said}"));
    assert!([0, 1, 2, 3, 130].contains(&code) && !said.contains("panicked"), "{args:?}: {code} {said}");
    assert!(code == 0 || !out.stderr.is_empty() || !out.stdout.is_empty(), "{args:?}: {code} without a word");
    out
}
