//! Compares the results of `identify` for blind cases with the truth.

use super::blind::{Case, Class, case};
use pitchline::identify::identify;
use pitchline::identify::report::{ChannelError, IdentificationReport, IdentificationVerdict};
use pitchline::identify::search::{Budget, Context};
use pitchline::machine::Machine;
use pitchline::measurement::Measurement;
use pitchline::measurement::columns::Memory;
use pitchline::measurement::segments::load;
use pitchline::side_by_side::parallel;
use std::sync::atomic::{AtomicBool, AtomicU64};

/// Result of a case.
pub struct Outcome {
    pub class: Class,
    /// Three times above the floor after the best change of all free parameters, and distinguishable in these records
    /// (except for the class that is not).
    pub clear: bool,
    /// The first name is the truth.
    pub first: bool,
    /// The truth is named, or in the set.
    pub in_set: bool,
    /// Something is named that does not exist.
    pub false_name: bool,
    pub ambiguous: bool,
    pub set_size: usize,
    /// For the named effects: parameters inside their 95 % interval, and all parameters.
    pub covered: (usize, usize),
    pub explained_wrongly: bool,
    pub both: bool,
    pub runs: u64,
    #[allow(dead_code)] // told by the bench
    pub wall_s: f64,
    pub line: String,
}

fn report_of(c: &Case) -> Result<IdentificationReport, String> {
    let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
    for (name, text) in &c.csvs {
        std::fs::write(folder.path().join(name), text).map_err(|e| e.to_string())?;
    }
    let measurement = Measurement::parse("measurement.toml", &c.measurement_toml).map_err(|r| r.to_string())?;
    let machine = Machine::parse(&measurement.drive, &c.drive_toml, &[]).map_err(|r| r.to_string())?;
    let data = load(&measurement, &machine, folder.path(), &mut Memory::for_program(1_000_000_000))
        .map_err(|e| e.to_string())?;
    let (stop, runs) = (AtomicBool::new(false), AtomicU64::new(0));
    let quiet = |_: &str, _: u64| {};
    let context = Context {
        threads: 1,
        budget: Budget { runs: None, seconds: None },
        started: std::time::Instant::now(),
        stop: &stop,
        progress: &quiet,
        runs: &runs,
    };
    identify(&measurement, &machine, &data, &context).map_err(|e| e.to_string())
}

/// Whether paths of two effects are equal, except for names that a drive file leaves free.
fn same(a: &str, b: &str) -> bool {
    let words = |p: &str| p.trim_end_matches('+').splitn(3, '.').map(str::to_string).collect::<Vec<_>>();
    let (a, b) = (words(a), words(b));
    let free = |n: &str| matches!(n, "pitch_error" | "tight_joint" | "pin_friction");
    a.get(1) == b.get(1) && (a.get(2) == b.get(2) || a.get(1).is_some_and(|n| free(n)))
}

fn outcome(class: Class, number: u64) -> Outcome {
    let c = case(class, number);
    let mut o = Outcome {
        class,
        clear: !c.truth.is_empty()
            && c.truth.iter().all(|t| t.after_fit > 3.0)
            && (class == Class::Confusable || c.rivals.is_empty()),
        first: false,
        in_set: false,
        false_name: false,
        ambiguous: false,
        set_size: 0,
        covered: (0, 0),
        explained_wrongly: false,
        both: false,
        runs: 0,
        wall_s: 0.0,
        line: String::new(),
    };
    let started = std::time::Instant::now();
    let told = report_of(&c);
    o.wall_s = started.elapsed().as_secs_f64();
    let r = match told {
        Ok(r) => r,
        Err(e) => {
            o.line = format!("{}: FAILED {e}", c.name);
            return o;
        }
    };
    o.runs = r.model_runs;
    o.ambiguous = r.outcome == IdentificationVerdict::Ambiguous;
    let right = |path: &str| c.truth.iter().any(|t| same(&t.path, path)) || c.rivals.iter().any(|p| same(p, path));
    let true_one = |path: &str| c.truth.iter().any(|t| same(&t.path, path));
    let sets: Vec<Vec<&str>> = r
        .effects
        .iter()
        .map(|e| std::iter::once(e.path.as_str()).chain(e.rivals.iter().map(|x| x.path.as_str())).collect())
        .collect();
    o.first = r.effects.first().is_some_and(|e| true_one(&e.path));
    o.in_set = sets.iter().flatten().any(|p| true_one(p));
    o.both = c.truth.len() == 2 && c.truth.iter().all(|t| sets.iter().any(|s| s.iter().any(|p| same(p, &t.path))));
    o.false_name = sets.iter().any(|s| !s.iter().any(|p| right(p)));
    o.set_size = sets.iter().map(Vec::len).max().unwrap_or(0);
    for e in r.effects.iter().filter(|e| true_one(&e.path)) {
        for n in e.parameters.iter().filter(|n| n.standard_error > 0.0 && n.record.is_none()) {
            let truth = c.truth.iter().flat_map(|t| &t.sizes).find(|(p, _)| p.trim_end_matches('+') == n.path);
            if let Some((_, value)) = truth {
                o.covered.1 += 1;
                o.covered.0 += usize::from((n.value.abs() - value.abs()).abs() <= 1.96 * n.standard_error);
            }
        }
    }
    o.explained_wrongly = r.explained && r.noise_floor.iter().any(|f| f.times_floor > 2.0);
    let truths: Vec<String> = c
        .truth
        .iter()
        .map(|t| format!("{} x{:.1}, after a fit x{:.2}, {:.0} sigma", t.path, t.over_floor, t.after_fit, t.sigmas))
        .collect();
    let sizes: Vec<String> = r
        .effects
        .iter()
        .map(|e| {
            let all = e.sizes.iter().map(|s| format!("{:.2}+-{:.2}", s.relative, s.standard_error));
            all.collect::<Vec<_>>().join(" ")
        })
        .collect();
    // Remaining share of the squared held-out error above the floor.
    let above = |all: &[ChannelError]| -> f64 {
        let whole = all.iter().filter(|e| e.record.is_none()).zip(&r.noise_floor);
        whole.map(|(e, f)| ((e.held_out.unwrap_or(0.0) / f.noise_floor).powi(2) - 1.0).max(0.0)).sum()
    };
    let left = above(&r.error_after) / above(&r.error_before).max(1e-9);
    o.line = format!(
        "{} {:?}: truth [{}] rivals {:?} found {:?} left {left:.3} sizes {sizes:?} explained {} floor {:.2} runs {}",
        c.name,
        r.outcome,
        truths.join("; "),
        c.rivals,
        sets,
        r.explained,
        r.noise_floor.iter().map(|f| f.times_floor).fold(0.0, f64::max),
        r.model_runs
    );
    o
}

/// Some cases of a class, on all cores; `done` is called as soon as each is finished.
pub fn outcomes(class: Class, numbers: std::ops::Range<u64>, done: impl Fn(&Outcome) + Sync) -> Vec<Outcome> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    parallel((numbers.end - numbers.start) as usize, threads, |i| {
        let outcome = outcome(class, numbers.start + i as u64);
        done(&outcome);
        outcome
    })
}

/// Sums over many cases.
#[derive(Default)]
pub struct Table {
    all: Vec<Row>,
    pub covered: (usize, usize),
    runs: Vec<u64>,
}

struct Row {
    class: Class,
    n: usize,
    clear: usize,
    first: usize,
    in_set: usize,
    false_name: usize,
    ambiguous: usize,
    both: usize,
    named: usize,
    set_size: usize,
    explained_wrongly: usize,
}

#[allow(dead_code)] // the bench prints shares, the test does not
impl Table {
    pub fn add(&mut self, o: &Outcome) {
        if !self.all.iter().any(|r| r.class == o.class) {
            let class = o.class;
            self.all.push(Row {
                class,
                n: 0,
                clear: 0,
                first: 0,
                in_set: 0,
                false_name: 0,
                ambiguous: 0,
                both: 0,
                named: 0,
                set_size: 0,
                explained_wrongly: 0,
            });
        }
        let Some(r) = self.all.iter_mut().find(|r| r.class == o.class) else { return };
        r.n += 1;
        r.clear += usize::from(o.clear);
        r.first += usize::from(o.clear && o.first);
        r.in_set += usize::from(o.clear && o.in_set);
        r.false_name += usize::from(o.false_name);
        r.ambiguous += usize::from(o.ambiguous);
        r.both += usize::from(o.both && o.clear);
        r.named += usize::from(o.set_size > 0);
        r.set_size += o.set_size;
        r.explained_wrongly += usize::from(o.explained_wrongly);
        self.covered.0 += o.covered.0;
        self.covered.1 += o.covered.1;
        self.runs.push(o.runs);
    }

    /// Share of clear cases of a class whose first name is the truth, whose set contains it, and share of all cases
    /// with a false name.
    pub fn shares(&self, class: Class) -> (f64, f64, f64) {
        let Some(r) = self.all.iter().find(|r| r.class == class) else { return (0.0, 0.0, 0.0) };
        let of = |a: usize, b: usize| a as f64 / b.max(1) as f64;
        (of(r.first, r.clear), of(r.in_set, r.clear), of(r.false_name, r.n))
    }
}

impl std::fmt::Display for Table {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "class        cases  clear  first right  set holds truth  false name  ambiguous  both found  mean set  explained wrongly"
        )?;
        for r in &self.all {
            let percent = |a: usize, b: usize| format!("{:.1} %", 100.0 * a as f64 / b.max(1) as f64);
            writeln!(
                f,
                "{:<12} {:>5}  {:>5}  {:>11}  {:>15}  {:>10}  {:>9}  {:>10}  {:>8.2}  {:>8}",
                format!("{:?}", r.class),
                r.n,
                r.clear,
                percent(r.first, r.clear),
                percent(r.in_set, r.clear),
                percent(r.false_name, r.n),
                percent(r.ambiguous, r.n),
                percent(r.both, r.clear),
                r.set_size as f64 / r.named.max(1) as f64,
                r.explained_wrongly
            )?;
        }
        let mut runs = self.runs.clone();
        runs.sort_unstable();
        writeln!(
            f,
            "95 % intervals that hold the truth: {} of {} ({:.0} %); model runs a case: median {}",
            self.covered.0,
            self.covered.1,
            100.0 * self.covered.0 as f64 / self.covered.1.max(1) as f64,
            runs.get(runs.len() / 2).copied().unwrap_or(0)
        )
    }
}
