//! The `pitchline` program: parses the command line, runs a verb, turns its end into an exit code.

use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    pitchline::measurement::contained::silence_contained_panics();
    // Exceeding the file size limit is then an error of the write, instead of ending the program.
    #[cfg(unix)]
    let _set = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default());
    let given = match pitchline::cli::command().try_get_matches() {
        Ok(given) => given,
        Err(e) => {
            // Help and version go to stdout and are not failures. A closed pipe is not an error.
            return match e.print() {
                Err(error) if !e.use_stderr() && error.kind() != std::io::ErrorKind::BrokenPipe => {
                    let _written = writeln!(std::io::stderr(), "error: cannot write to stdout: {error}");
                    ExitCode::from(1)
                }
                _ => ExitCode::from(if e.use_stderr() { 2 } else { 0 }),
            };
        }
    };
    match pitchline::cli::run(&given) {
        Ok(outcome) => ExitCode::from(outcome.code()),
        Err(failure) => {
            // If even this cannot be written, the exit code still reports the failure.
            let _written = writeln!(std::io::stderr(), "{failure}");
            ExitCode::from(failure.code())
        }
    }
}
