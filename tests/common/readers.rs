//! Programs of others that tests use. Where one is missing, a test is skipped with a printed line, or fails where
//! PITCHLINE_NO_SKIP=1 is set, as in CI, which installs them.

use std::process::Command;

/// Says that a test is skipped, and why.
pub fn skip(why: &str) {
    assert!(std::env::var_os("PITCHLINE_NO_SKIP").is_none_or(|v| v != "1"), "{why}; PITCHLINE_NO_SKIP forbids to skip");
    println!("skipped: {why}");
}

/// The Python named by PITCHLINE_PYTHON, or `python3`, if it has these modules.
pub fn python(modules: &str) -> Option<String> {
    let python = std::env::var("PITCHLINE_PYTHON").unwrap_or_else(|_| "python3".into());
    let has = Command::new(&python).args(["-c", &format!("import {modules}")]).output();
    if !has.is_ok_and(|out| out.status.success()) {
        skip(&format!("{python} has no {modules}"));
        return None;
    }
    Some(python)
}

/// The Rerun viewer named by PITCHLINE_RERUN, or `rerun`, if it starts.
pub fn rerun() -> Option<String> {
    let program = std::env::var("PITCHLINE_RERUN").unwrap_or_else(|_| "rerun".into());
    if Command::new(&program).arg("--version").output().is_err() {
        skip(&format!("no program `{program}` (pip install rerun-sdk==0.36.3)"));
        return None;
    }
    Some(program)
}
