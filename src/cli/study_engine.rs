//! `pitchline study --engine` and `--print-job`: the shards of a study as tasks of an engine.

use super::study::{StudyArgs, failure, folder_path};
use super::{Failure, Outcome, print_out};
use crate::study::BUNDLED_STUDIES;
use crate::study::bind::BoundStudy;
use crate::study::engine::{BatchJob, BatchSystem};
use crate::study::folder::{FolderUse, Shard, StudyFolder};
use crate::study::run::CaseRow;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Runs the shards with Ray.
const RAY_SCRIPT: &str = include_str!("../../python/pitchline_ray.py");
/// Times that Ray begins a task again.
const RAY_RETRIES: u32 = 5;

#[derive(clap::Args, Debug, Default)]
pub struct EngineArgs {
    /// Where the cases run: local (all cores of this machine), slurm (an array job), ray (a Ray cluster)
    #[arg(long, value_name = "ENGINE", default_value = "local", value_parser = ["local", "slurm", "ray"], conflicts_with_all = ["shard", "collect", "status", "record"])]
    pub(super) engine: String,
    /// Print the job script for slurm, lsf or pbs, and submit nothing
    #[arg(long, value_name = "ENGINE", value_parser = ["slurm", "lsf", "pbs"], conflicts_with_all = ["engine", "shard", "collect", "status", "record"])]
    pub(super) print_job: Option<String>,
    /// Tasks of an engine
    #[arg(long, value_name = "N", default_value = "16", value_parser = clap::value_parser!(u32).range(1..))]
    shards: u32,
    /// A further option of the engine, e.g. --engine-option=--time=02:00:00; may be given several times
    #[arg(long = "engine-option", value_name = "OPTION", allow_hyphen_values = true)]
    options: Vec<String>,
    /// Address of the Ray cluster; local starts one on this machine
    #[arg(long, value_name = "ADDRESS", default_value = "auto")]
    ray_address: String,
    /// Python with ray
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    python: PathBuf,
}

/// The study as tasks.
fn job(args: &StudyArgs, bound: &BoundStudy) -> Result<BatchJob, Failure> {
    let absolute = |path: &Path| {
        std::path::absolute(path)
            .map(|p| p.display().to_string())
            .map_err(|e| Failure::World(format!("{}: {e}", path.display())))
    };
    let program =
        std::env::current_exe().map_err(|e| Failure::World(format!("cannot tell where this program is: {e}")))?;
    let is_bundled = BUNDLED_STUDIES.iter().any(|(name, _)| Path::new(name) == args.study);
    let study = if is_bundled { args.study.display().to_string() } else { absolute(&args.study)? };
    let mut arguments: Vec<String> = args.other_build.then(|| "--other-build".to_string()).into_iter().collect();
    arguments.extend(args.budget.map(|s| format!("--budget={s}s")));
    let job = BatchJob {
        name: bound.study.name.clone(),
        program: absolute(&program)?,
        study,
        folder: absolute(&folder_path(args, bound))?,
        shards: args.engine.shards as usize,
        threads: args.threads.map_or(1, usize::from),
        arguments,
        options: args.engine.options.clone(),
    };
    // Job scripts have an option a line, with paths in quotes.
    let is_wrong = |text: &&String| text.contains(|c: char| c.is_control() || c == '"');
    if let Some(text) = [&job.program, &job.study, &job.folder].into_iter().chain(&job.options).find(is_wrong) {
        return Err(Failure::Input(format!(
            "{text:?} holds a line end or a quotation mark, which job scripts do not bear"
        )));
    }
    Ok(job)
}

/// The folder, with room for the engine's logs.
fn folder(args: &StudyArgs, bound: &BoundStudy, wanted: FolderUse) -> Result<StudyFolder, Failure> {
    let folder = StudyFolder::open(&folder_path(args, bound), bound, wanted, args.other_build).map_err(failure)?;
    let log = folder.path.join("log");
    std::fs::create_dir_all(&log).map_err(|e| Failure::World(format!("cannot make {}: {e}", log.display())))?;
    Ok(folder)
}

/// Prints a job script.
pub(super) fn print_job(args: &StudyArgs, bound: &BoundStudy, engine: &str) -> Result<Outcome, Failure> {
    let job = job(args, bound)?;
    let found = BatchSystem::ALL.into_iter().find(|(name, _, _)| *name == engine);
    let Some((_, system, _)) = found else {
        return Err(Failure::Input(format!("`{engine}` is no engine with job scripts")));
    };
    folder(args, bound, FolderUse::GoOn)?;
    print_out(&system.script(&job))
}

/// Hands the shards to an engine. The folder may have cases already: shards go on with what is missing.
pub(super) fn submit(args: &StudyArgs, bound: &BoundStudy) -> Result<Outcome, Failure> {
    let job = job(args, bound)?;
    let wanted = if args.resume { FolderUse::GoOn } else { FolderUse::Begin };
    let folder = folder(args, bound, wanted)?;
    if args.engine.engine == "ray" { with_ray(args, bound, &folder, &job) } else { with_slurm(args, &folder, &job) }
}

/// Output of a program, or what to install.
fn output_of(command: &mut Command, help: &str) -> Result<String, Failure> {
    let name = command.get_program().to_string_lossy().into_owned();
    let out = command.output().map_err(|e| Failure::World(format!("cannot start `{name}`: {e}\nhelp: {help}")))?;
    if !out.status.success() {
        let why = String::from_utf8_lossy(&out.stderr).trim().to_string();
        return Err(Failure::World(format!("`{name}` ended with {}: {why}", out.status)));
    }
    Ok(String::from_utf8_lossy(&out.stdout).trim().to_string())
}

/// Submits an array job, and one after it that collects.
fn with_slurm(args: &StudyArgs, folder: &StudyFolder, job: &BatchJob) -> Result<Outcome, Failure> {
    let script = folder.path.join("job.slurm");
    crate::output::write(&script, BatchSystem::Slurm.script(job).as_bytes())?;
    let help = "SLURM's client is needed here (Debian: apt install slurm-client); `--print-job slurm` prints the job for another machine";
    let id = output_of(Command::new("sbatch").arg("--parsable").arg(&script), help)?;
    // Where several clusters are federated, sbatch prints the cluster's name behind the number.
    let id = id.split(';').next().unwrap_or_default().to_string();
    let log = format!("{}/log/collect_%j.txt", job.folder);
    let mut collect = Command::new("sbatch");
    collect.args(["--parsable", &format!("--dependency=afterany:{id}"), "--job-name=pitchline-collect"]);
    collect.arg(format!("--output={log}")).arg(format!("--wrap={}", job.collect()));
    let collecting = output_of(&mut collect, help)?;
    let (study, folder) = (args.study.display(), folder.path.display());
    print_out(&format!(
        "submitted job {id}: {} tasks; job {collecting} writes the tables when they have ended\n\
         what is done: pitchline study {study} -o {folder} --status\n\
         what is lost: pitchline study {study} -o {folder} --resume --engine slurm --shards {}\n",
        job.shards, job.shards
    ))
}

/// Runs the shards with Ray, and collects.
fn with_ray(args: &StudyArgs, bound: &BoundStudy, folder: &StudyFolder, job: &BatchJob) -> Result<Outcome, Failure> {
    let shard = |index| Shard { index, count: job.shards };
    let commands: Vec<Vec<String>> = (1..=job.shards).map(|index| job.command(shard(index))).collect();
    let address = (args.engine.ray_address != "local").then_some(&args.engine.ray_address);
    let tasks =
        serde_json::json!({"address": address, "threads": job.threads, "retries": RAY_RETRIES, "commands": commands});
    let (file, script) = (folder.path.join("ray.json"), folder.path.join("pitchline_ray.py"));
    crate::output::write(&file, tasks.to_string().as_bytes())?;
    crate::output::write(&script, RAY_SCRIPT.as_bytes())?;
    let mut command = Command::new(&args.engine.python);
    command.arg(&script).arg(&file).stdout(std::io::stderr());
    let status = command.status().map_err(|e| {
        Failure::World(format!(
            "cannot start `{}`: {e}\nhelp: --python names a Python with ray",
            args.engine.python.display()
        ))
    })?;
    let outcome = super::study::collect(args, bound, folder)?;
    if !status.success() {
        let found = folder.rows(bound).map_err(failure)?;
        let done: Vec<&CaseRow> = found.rows.values().collect();
        return Err(Failure::World(format!(
            "Ray's tasks ended with {status}: {} of {} cases are done\nhelp: `--resume --engine ray` goes on",
            done.len(),
            bound.cases()
        )));
    }
    Ok(outcome)
}
