//! `pitchline study -o s3://BUCKET/PREFIX`: shards of machines that share an object store.

use super::study::StudyArgs;
use super::{Failure, Outcome};
use crate::study::bind::BoundStudy;

#[cfg(not(feature = "s3"))]
pub(super) fn run(_: &StudyArgs, _: &BoundStudy, url: &str) -> Result<Outcome, Failure> {
    Err(Failure::Input(format!(
        "{url}: this build reaches no object stores\nhelp: `cargo install pitchline --features s3`, or a folder that all machines share"
    )))
}

#[cfg(feature = "s3")]
pub(super) fn run(args: &StudyArgs, bound: &BoundStudy, url: &str) -> Result<Outcome, Failure> {
    use super::study::{check_nominal, collect, failure, finish_shard, run_missing, status};
    use crate::study::folder::{FolderUse, Shard, StudyFolder};
    use crate::study::remote::RemoteFolder;
    use std::sync::atomic::Ordering;

    if args.engine.engine != "local" || args.engine.print_job.is_some() || args.record.is_some() {
        let said = "with an object store, engines run `pitchline study STUDY -o s3://BUCKET/PREFIX --shard I/N`; record a case into a folder";
        return Err(Failure::Input(said.into()));
    }
    let shard = args.shard.unwrap_or(Shard::WHOLE);
    let own = format!("pitchline-{:016x}-{}", bound.fingerprint, shard.name());
    let scratch = args.scratch.clone().unwrap_or_else(|| std::env::temp_dir().join(own));
    let mut remote = RemoteFolder::open(url)?;
    let alike = format!("-of-{}.rows", shard.count);
    let journal = format!("shard-{}.rows", shard.name());
    let is_all = args.shard.is_none();
    remote.fetch(&scratch, |name| is_all || name == journal || !name.ends_with(&alike))?;
    let open = |wanted| StudyFolder::open(&scratch, bound, wanted, args.other_build).map_err(failure);
    if args.status {
        return status(args, bound, &open(FolderUse::Look)?);
    }
    let results = ["results.parquet", "results.csv", "timing.parquet", "report.html"].map(str::to_string);
    if args.collect {
        let folder = open(FolderUse::Look)?;
        let outcome = collect(args, bound, &folder)?;
        remote.see(&results)?;
        remote.send(&scratch, &results)?;
        return Ok(outcome);
    }
    let wanted = if args.resume || args.shard.is_some() { FolderUse::GoOn } else { FolderUse::Begin };
    check_nominal(bound)?;
    let folder = open(wanted)?;
    // Shards that begin together write the same mark.
    let mark = ["study.toml", "study.json"].map(str::to_string);
    remote.see(&mark)?;
    if let Err(e) = remote.send(&scratch, &mark) {
        remote.see(&mark)?;
        eprintln!("note: {e:#}");
    }
    let stop = super::run::stop_on_interrupt();
    let mut added = || match remote.is_due() {
        true => remote.send(&scratch, std::slice::from_ref(&journal)),
        false => Ok(()),
    };
    run_missing(args, bound, &folder, shard, &stop, &mut added)?;
    remote.send(&scratch, std::slice::from_ref(&journal))?;
    let outcome = if args.shard.is_some() {
        let outcome = finish_shard(args, bound, &folder, shard)?;
        let table = [format!("shard-{}.parquet", shard.name())];
        remote.see(&table)?;
        remote.send(&scratch, &table)?;
        outcome
    } else {
        let outcome = collect(args, bound, &folder)?;
        remote.see(&results)?;
        remote.send(&scratch, &results)?;
        outcome
    };
    Ok(if stop.load(Ordering::Relaxed) { Outcome::Interrupted } else { outcome })
}
