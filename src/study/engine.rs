//! Studies beyond one machine: job scripts for the engines that clusters have, each task a shard of the study. What is lost is begun again by
//! the engine, and goes on from its journal.

use super::folder::Shard;
use std::fmt::Write;

/// An engine that runs tasks on many machines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BatchSystem {
    Slurm,
    Lsf,
    Pbs,
}

/// A study as tasks of an engine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BatchJob {
    pub name: String,
    /// Absolute paths, which all nodes have.
    pub program: String,
    pub study: String,
    pub folder: String,
    pub shards: usize,
    pub threads: usize,
    /// Further options of `study`, such as `--other-build`.
    pub arguments: Vec<String>,
    /// Further options of the engine, a line each, such as `--time=02:00:00`.
    pub options: Vec<String>,
}

impl BatchSystem {
    /// With its name on the command line and the program that takes its jobs.
    pub const ALL: [(&'static str, BatchSystem, &'static str); 3] =
        [("slurm", BatchSystem::Slurm, "sbatch"), ("lsf", BatchSystem::Lsf, "bsub"), ("pbs", BatchSystem::Pbs, "qsub")];

    /// The job script: an array of tasks, one a shard.
    pub fn script(self, job: &BatchJob) -> String {
        let (mark, index) = match self {
            BatchSystem::Slurm => ("#SBATCH ", "$SLURM_ARRAY_TASK_ID"),
            BatchSystem::Lsf => ("#BSUB ", "$LSB_JOBINDEX"),
            BatchSystem::Pbs => ("#PBS ", "$PBS_ARRAY_INDEX"),
        };
        let (n, threads, log) = (job.shards, job.threads, format!("{}/log", job.folder));
        let name: String = job.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
        let own = match self {
            BatchSystem::Slurm => vec![
                format!("--job-name=pitchline-{name}"),
                format!("--array=1-{n}"),
                format!("--cpus-per-task={threads}"),
                "--requeue".into(),
                "--open-mode=append".into(),
                format!("--output=\"{log}/%A_%a.txt\""),
            ],
            BatchSystem::Lsf => vec![
                format!("-J \"pitchline-{name}[1-{n}]\""),
                format!("-n {threads}"),
                "-R \"span[hosts=1]\"".into(),
                "-r".into(),
                format!("-o \"{log}/%J_%I.txt\""),
            ],
            BatchSystem::Pbs => vec![
                format!("-N pitchline-{name}"),
                format!("-J 1-{n}"),
                format!("-l select=1:ncpus={threads}"),
                "-r y".into(),
                "-j oe".into(),
                format!("-o \"{log}\""),
            ],
        };
        let mut text = String::from("#!/bin/bash\n");
        for option in own.iter().chain(&job.options) {
            let _infallible = writeln!(text, "{mark}{option}");
        }
        let _infallible = writeln!(
            text,
            "# A task that is killed or begun anew goes on from its journal.\nexec {} study {} -o {} --shard \"{index}/{n}\" --threads {threads}{}",
            quoted(&job.program),
            quoted(&job.study),
            quoted(&job.folder),
            job.arguments.iter().map(|a| format!(" {}", quoted(a))).collect::<String>()
        );
        text
    }
}

impl BatchJob {
    /// The command of a shard, word by word.
    pub fn command(&self, shard: Shard) -> Vec<String> {
        let part = format!("{}/{}", shard.index, shard.count);
        let threads = self.threads.to_string();
        let words =
            [self.program.as_str(), "study", &self.study, "-o", &self.folder, "--shard", &part, "--threads", &threads];
        words.into_iter().map(str::to_string).chain(self.arguments.iter().cloned()).collect()
    }

    /// The command that writes the tables of all shards.
    pub fn collect(&self) -> String {
        format!("{} study {} -o {} --collect", quoted(&self.program), quoted(&self.study), quoted(&self.folder))
    }
}

/// A word as a POSIX shell reads it back.
pub fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:,@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_string()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scripts_run_the_shards_and_quote_their_paths() {
        let job = BatchJob {
            name: "s".into(),
            program: "/opt/pitchline".into(),
            study: "/home/a b/it's.toml".into(),
            folder: "/scratch/s".into(),
            shards: 7,
            threads: 2,
            arguments: vec!["--other-build".into()],
            options: vec!["--time=02:00:00".into()],
        };
        let text = BatchSystem::Slurm.script(&job);
        for wanted in [
            "#SBATCH --array=1-7\n",
            "#SBATCH --time=02:00:00\n",
            "'/home/a b/it'\\''s.toml'",
            "\"$SLURM_ARRAY_TASK_ID/7\" --threads 2 --other-build\n",
        ] {
            assert!(text.contains(wanted), "{wanted}: {text}");
        }
        assert!(BatchSystem::Lsf.script(&job).contains("-J \"pitchline-s[1-7]\""));
        assert!(BatchSystem::Pbs.script(&job).contains("#PBS -J 1-7"));
        assert_eq!(job.command(Shard { index: 3, count: 7 })[6], "3/7");
    }
}
