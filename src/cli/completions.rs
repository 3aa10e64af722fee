//! `pitchline completions`: a script that completes commands in a shell.

use super::{Failure, Outcome, print_out};

#[derive(clap::Args, Debug)]
pub struct CompletionsArgs {
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

pub fn run(args: &CompletionsArgs) -> Result<Outcome, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut super::command(), "pitchline", &mut script);
    print_out(&String::from_utf8_lossy(&script))
}
