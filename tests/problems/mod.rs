//! Small measured machines out of any bytes, and what every answer of `identify` about them must be: for the fuzzer and for a test.
//!
//! A machine of one to three bodies, with loads, springs, sensors and inputs, carries effects of the catalogue that its file does not declare.
//! Its records are simulated, made noisy and spoilt: spikes, gaps, moments 1e-12 s apart, columns that stand still, wrong units. Most problems
//! make no sense as machines; each must end with an answer or with a refusal that says why.

use pitchline::effects::{EFFECTS, Effect, Kind, On};
use pitchline::identify::search::{Budget, Context};
use pitchline::identify::updated::updated;
use pitchline::identify::{identify, text};
use pitchline::machine::Machine;
use pitchline::machine::simulate::run;
use pitchline::measurement::Measurement;
use pitchline::measurement::columns::Memory;
use pitchline::measurement::segments::{Data, load};
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::time::Instant;

/// Reads choices out of bytes; behind their end every choice is the first one.
pub struct Choices<'a> {
    bytes: &'a [u8],
}

impl<'a> Choices<'a> {
    pub fn new(bytes: &'a [u8]) -> Choices<'a> {
        Choices { bytes }
    }

    fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.bytes.split_first() else { return 0 };
        self.bytes = rest;
        *first
    }

    /// A whole number in 0 .. `n`.
    fn below(&mut self, n: usize) -> usize {
        usize::from(self.byte()) * n / 256
    }

    fn one_in(&mut self, n: usize) -> bool {
        self.below(n) + 1 == n
    }

    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }

    /// In 0 ..= 1.
    fn share(&mut self) -> f64 {
        let [high, low] = [self.byte(), self.byte()].map(f64::from);
        (256.0 * high + low) / 65535.0
    }

    /// Between two positive numbers, even in the logarithm.
    fn log_between(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.share())
    }

    /// About -1 ..= 1: the sum of three shares is close enough to a normal distribution.
    fn noise(&mut self) -> f64 {
        2.0 * (self.share() + self.share() + self.share()) - 3.0
    }
}

/// A measurement file, its drive and its data, as texts.
pub struct SmallProblem {
    pub measurement: String,
    pub drive: String,
    /// A file for every record: its name and its text.
    pub records: Vec<(String, String)>,
    pub budget: Budget,
}

struct Body {
    slides: bool,
    name: &'static str,
}

const NAMES: [&str; 3] = ["first", "second", "third"];

/// What a record's columns hold, and how it was made.
struct Record {
    t_s: Vec<f64>,
    input: Vec<f64>,
    channels: Vec<Vec<f64>>,
    /// Where the first channel lies in a file of its own.
    own: Option<OwnFile>,
}

/// A file with a clock of its own, as it is declared, and what that lacks.
struct OwnFile {
    offset_s: f64,
    drift: f64,
    late_s: f64,
    lost: f64,
}

struct Maker<'a> {
    c: Choices<'a>,
    bodies: Vec<Body>,
    springs: usize,
    /// Kind of the input in a drive file, if there is one: always on the first body.
    input: Option<&'static str>,
    /// Kind and target of every sensor.
    sensors: Vec<(&'static str, &'static str, usize)>,
    /// Paths and values of the declared numbers.
    numbers: Vec<(String, f64)>,
}

impl SmallProblem {
    /// `folder` is for files that are read on the way.
    pub fn new(bytes: &[u8], folder: &Path) -> SmallProblem {
        let mut maker = Maker {
            c: Choices::new(bytes),
            bodies: Vec::new(),
            springs: 0,
            input: None,
            sensors: Vec::new(),
            numbers: Vec::new(),
        };
        let (declared, mut truth) = maker.drive();
        for _ in 0..maker.c.below(4) {
            truth += &maker.effect();
        }
        let mut drive = declared;
        if maker.c.one_in(8) {
            drive += &maker.effect();
        }
        let counts: Vec<usize> =
            (0..1 + maker.c.below(4)).map(|_| if maker.c.one_in(30) { 9 } else { 20 + maker.c.below(180) }).collect();
        let mut records: Vec<Record> = counts.iter().map(|n| maker.record(*n)).collect();
        let measurement = maker.measurement(&records);
        let machine = Machine::parse("truth.toml", &truth, &[]).ok();
        let data = machine.as_ref().and_then(|m| loaded(&measurement, m, &texts(&records), folder).ok());
        if let (Some(machine), Some(data)) = (machine, data) {
            maker.simulate(&machine, &data, &mut records);
        }
        for r in &mut records {
            maker.spoil(r);
        }
        let budget = match maker.c.below(3) {
            0 => Budget { runs: Some(maker.c.log_between(20.0, 1500.0) as u64), seconds: None },
            1 => Budget { runs: None, seconds: Some(maker.c.log_between(0.01, 0.5)) },
            _ => Budget { runs: Some(300), seconds: Some(0.5) },
        };
        // Drawn last, so that bytes that were kept before still mean the same.
        let measurement = measurement + &maker.own_files(&mut records);
        SmallProblem { measurement, drive, records: texts(&records), budget }
    }

    /// Runs `identify` on it; whether it came to an answer.
    ///
    /// # Panics
    /// The answer is none that a user may be given.
    pub fn answers(&self, folder: &Path) -> bool {
        let measurement = match Measurement::parse("measured.toml", &self.measurement) {
            Ok(m) => m,
            Err(report) => {
                panic!("the maker writes measurement files that can be read: {report}\n{}", self.measurement)
            }
        };
        let machine = match Machine::of_file("drive.toml", &self.drive) {
            Ok(m) => m,
            Err(report) => return refused(&report.to_string()),
        };
        let data = match loaded(&self.measurement, &machine, &self.records, folder) {
            Ok(data) => data,
            Err(e) => return refused(&e),
        };
        let (stop, runs, quiet) = (AtomicBool::new(false), AtomicU64::new(0), |_: &str, _: u64| {});
        let started = Instant::now();
        let context = Context { threads: 1, budget: self.budget, started, stop: &stop, progress: &quiet, runs: &runs };
        let report = match identify(&measurement, &machine, &data, &context) {
            Ok(r) => r,
            Err(e) => return refused(&e.to_string()),
        };
        let runs_are_over = self.budget.runs.is_some_and(|most| report.model_runs >= most);
        assert!(report.budget_spent || !runs_are_over, "{} runs, and not marked", report.model_runs);
        assert!(!report.interrupted);
        let shown = text::text(&report);
        assert!(shown.contains(&format!("{:?}", report.outcome).to_uppercase()), "{shown}");
        assert!(!shown.contains("NaN"), "{shown}");
        serde_json::to_string(&report).expect("a report is JSON");
        for e in &report.effects {
            for p in &e.parameters {
                assert!(p.value.is_finite(), "{} = {}", e.path, p.value);
            }
        }
        let out = updated(&machine, &report).expect("every number of a report has a table");
        if let Err(report) = Machine::of_file("updated.toml", &out) {
            panic!("the updated drive cannot be read: {report}\n{out}");
        }
        true
    }
}

fn refused(why: &str) -> bool {
    assert!(why.len() > 10, "`{why}` is no reason");
    if std::env::var_os("PITCHLINE_VERBOSE").is_some() {
        println!("refused: {why}");
    }
    false
}

/// Writes the files into `folder` and reads them.
fn loaded(measurement: &str, machine: &Machine, records: &[(String, String)], folder: &Path) -> Result<Data, String> {
    std::fs::create_dir_all(folder).map_err(|e| e.to_string())?;
    for (name, csv) in records {
        std::fs::write(folder.join(format!("{name}.csv")), csv).map_err(|e| e.to_string())?;
    }
    let measurement = Measurement::parse("measured.toml", measurement).map_err(|r| r.to_string())?;
    load(&measurement, machine, folder, &mut Memory::for_program(100_000_000)).map_err(|e| e.to_string())
}

fn texts(records: &[Record]) -> Vec<(String, String)> {
    let text = |r: &Record| {
        let mut csv = String::from("t,input");
        for k in 0..r.channels.len() {
            let _ = write!(csv, ",c{k}");
        }
        for i in 0..r.t_s.len() {
            let _ = write!(csv, "\n{:e},{:e}", r.t_s[i], r.input[i]);
            for c in &r.channels {
                // A cell that is empty is a value that is missing.
                let _ = if c[i].is_nan() { write!(csv, ",") } else { write!(csv, ",{:e}", c[i]) };
            }
        }
        csv.push('\n');
        csv
    };
    // Two of three samples, by the own clock.
    let own = |(k, r): (usize, &Record)| {
        let own = r.own.as_ref()?;
        let mut csv = String::from("t,c0");
        for i in (0..r.t_s.len()).filter(|i| i % 3 != 1) {
            let t = (r.t_s[i] * (1.0 + own.lost) + own.late_s - own.offset_s) / (1.0 + own.drift);
            let value = r.channels[0][i];
            let _ = if value.is_nan() { write!(csv, "\n{t:e},") } else { write!(csv, "\n{t:e},{value:e}") };
        }
        csv.push('\n');
        Some((format!("own{k}"), csv))
    };
    let joined = records.iter().enumerate().map(|(k, r)| (format!("r{k}"), text(r)));
    joined.chain(records.iter().enumerate().filter_map(own)).collect()
}

impl Maker<'_> {
    /// The drive as declared, and as it is.
    fn drive(&mut self) -> (String, String) {
        let mut both = [String::from("fidelity = \"lumped\"\n"), String::from("fidelity = \"lumped\"\n")];
        let count = 1 + self.c.below(3);
        let slides = self.c.one_in(4);
        let chain = count > 1 && !slides && self.c.one_in(3);
        for name in &NAMES[..count] {
            self.bodies.push(Body { slides, name });
            let (table, key) = if slides { ("sliders", "mass_kg") } else { ("rotors", "inertia_kg_m2") };
            for text in &mut both {
                let _ = writeln!(text, "\n[{table}.{name}]");
                if chain {
                    let _ = writeln!(text, "teeth = {}", 17 + 3 * name.len());
                }
            }
            let value = self.c.log_between(1e-6, 1e2);
            self.number(&mut both, format!("{table}.{name}"), key, value);
        }
        for k in 1..count {
            self.spring(&mut both, k, chain);
        }
        for k in 0..count {
            if self.c.one_in(2) {
                let name = self.bodies[k].name;
                let table = format!("loads.viscous.{name}");
                let key = if slides { "force_n_s_per_m" } else { "torque_nm_s_per_rad" };
                let _ = both.iter_mut().map(|t| writeln!(t, "\n[{table}]")).collect::<Vec<_>>();
                let value = self.c.log_between(1e-7, 1e2);
                self.number(&mut both, table, key, value);
            }
        }
        self.input = match (self.c.below(4), slides, count) {
            (0, ..) | (1, _, 1) => None,
            (1, ..) => Some("speed"),
            (_, true, _) => Some("force"),
            (_, false, _) => Some("torque"),
        };
        if let Some(kind) = self.input {
            for text in &mut both {
                let _ = writeln!(text, "\n[inputs.{kind}.drive]\nbody = \"first\"");
            }
        }
        if chain {
            for text in &mut both {
                text.push_str("\n[chain]\nlinks = 80\n");
            }
        }
        for k in 0..1 + self.c.below(3) {
            self.sensor(&mut both, k);
            if self.sensors[0].0 == "pulse_pickup" {
                break;
            }
        }
        let [declared, truth] = both;
        (declared, truth)
    }

    /// Writes a number: declared, and true where the file errs.
    fn number(&mut self, both: &mut [String; 2], table: String, key: &str, value: f64) {
        let factor = match self.c.below(4) {
            0 | 1 => 1.0,
            2 => self.c.log_between(0.7, 1.4),
            _ => self.c.log_between(0.02, 50.0),
        };
        let _ = writeln!(both[0], "{key} = {:e}", factor * value);
        let _ = writeln!(both[1], "{key} = {value:e}");
        self.numbers.push((format!("{table}.{key}"), factor * value));
    }

    fn spring(&mut self, both: &mut [String; 2], k: usize, chain: bool) {
        let slides = self.bodies[0].slides;
        let between = format!("between = [\"{}\", \"{}\"]", self.bodies[k - 1].name, self.bodies[k].name);
        let (table, keys) = match (chain, slides) {
            (true, _) => (format!("spans.s{k}"), ["stiffness_n_per_m", "damping_n_s_per_m"]),
            (false, true) => (format!("couplings.s{k}"), ["stiffness_n_per_m", "damping_n_s_per_m"]),
            (false, false) => (format!("couplings.s{k}"), ["stiffness_nm_per_rad", "damping_nm_s_per_rad"]),
        };
        for text in both.iter_mut() {
            let _ = writeln!(text, "\n[{table}]\n{between}");
            if chain {
                let _ = writeln!(text, "from_radius_mm = 30\nto_radius_mm = 45");
            }
        }
        let value = self.c.log_between(1e-2, 1e5);
        self.number(both, table.clone(), keys[0], value);
        let value = self.c.log_between(1e-6, 1e2);
        self.number(both, table, keys[1], value);
        self.springs += 1;
    }

    fn sensor(&mut self, both: &mut [String; 2], k: usize) {
        let on = self.c.below(self.bodies.len());
        let body = self.bodies[on].name;
        let slides = self.bodies[on].slides;
        let (kind, unit) = match (self.c.below(5), slides) {
            (0, false) => ("encoder", "rad"),
            (0, true) => ("displacement", "m"),
            (1, false) => ("accelerometer", "rad/s^2"),
            (2, false) if !self.sensors.iter().any(|s| s.0 == "pulse_pickup") && k == 0 && self.c.one_in(2) => {
                ("pulse_pickup", "s")
            }
            (3, _) if self.springs > 0 => match both[0].contains("[spans.") || slides {
                true => ("strain_gauge", "N"),
                false => ("strain_gauge", "N m"),
            },
            (_, false) => ("tachometer", "rad/s"),
            (_, true) => ("tachometer", "m/s"),
        };
        for text in both.iter_mut() {
            let _ = writeln!(text, "\n[sensors.{kind}.n{k}]");
            let _ = match kind {
                "strain_gauge" => writeln!(text, "span = \"s1\""),
                "pulse_pickup" => writeln!(text, "body = \"{body}\"\nmarks = 6"),
                _ => writeln!(text, "body = \"{body}\""),
            };
        }
        self.sensors.push((kind, unit, k));
    }

    /// An effect of the catalogue with any numbers, as a table of a drive file; empty where it has no place.
    fn effect(&mut self) -> String {
        let e: &Effect = EFFECTS[self.c.below(EFFECTS.len())];
        let slides = self.bodies[0].slides;
        let first = usize::from(self.input == Some("speed"));
        let target = match e.on {
            On::Body => self.bodies.get(first + self.c.below(self.bodies.len() - first)).map(|b| b.name.to_string()),
            On::Prescribed => (first == 1).then(|| "first".to_string()),
            On::Sprocket => Some("first".to_string()),
            On::Span => (self.springs > 0).then(|| "s1".to_string()),
            On::Chain => Some("chain".to_string()),
            On::Input => self.input.map(|_| "drive".to_string()),
            On::Sensor | On::AngleSensor | On::Pickup => {
                let (_, _, k) = self.c.pick(&self.sensors);
                Some(format!("n{k}"))
            }
            On::Joints
            | On::Guide
            | On::Blade
            | On::Bearing
            | On::Valve
            | On::Coupling
            | On::Arm
            | On::Leak
            | On::Orifice
            | On::Check
            | On::Oil => None,
        };
        let Some(target) = target else { return String::new() };
        let mut text = format!("\n[effects.{}.{target}]\n", e.name);
        for p in e.parameters {
            if p.default.is_some() && !self.c.one_in(2) {
                continue;
            }
            let size = self.c.log_between(1e-5, 1e3) * if self.c.one_in(3) { -1.0 } else { 1.0 };
            let value = size.clamp(p.low, p.high);
            let whole = matches!(p.kind, Kind::Whole | Kind::Index);
            let value = if whole { value.round().max(p.low.ceil()) } else { value };
            let key = if slides { p.sliding_key } else { p.key }.replace('#', "2");
            let _ = if whole { writeln!(text, "{key} = {value}") } else { writeln!(text, "{key} = {value:e}") };
        }
        text
    }

    fn record(&mut self, n: usize) -> Record {
        let step = self.c.log_between(1e-5, 0.1);
        let mut t_s: Vec<f64> = (0..n).map(|i| step * i as f64).collect();
        match self.c.below(6) {
            0 => t_s.iter_mut().skip(1).for_each(|t| *t += 0.3 * step * (self.c.share() - 0.5)),
            1 => {
                let at = self.c.below(n);
                t_s[at..].iter_mut().for_each(|t| *t += 40.0 * step);
            }
            2 => {
                let at = self.c.below(n - 1);
                t_s[at + 1] = t_s[at] + 1e-12;
            }
            _ => {}
        }
        let size = self.c.log_between(1e-4, 1e3);
        let turns = self.c.log_between(0.3, 0.25 * n as f64);
        let (form, offset) = (self.c.below(6), self.c.noise());
        let input = (0..n).map(|i| {
            let phase = 2.0 * PI * turns * i as f64 / n as f64;
            size * match form {
                0 => 0.0,
                1 => 1.0,
                2 => phase.sin() + offset,
                3 => phase.sin().signum(),
                4 => i as f64 / n as f64,
                _ => self.c.noise(),
            }
        });
        let input = input.collect();
        let channels = self.sensors.iter().map(|s| match s.0 {
            "pulse_pickup" => vec![step; n],
            _ => (0..n).map(|i| size * (turns * i as f64).sin()).collect(),
        });
        Record { t_s, input, channels: channels.collect(), own: None }
    }

    /// Puts the first channel of some records into files of their own; what the measurement file says of them.
    fn own_files(&mut self, records: &mut [Record]) -> String {
        let mut text = String::new();
        let has_samples = self.sensors.first().is_some_and(|s| s.0 != "pulse_pickup");
        if !has_samples || self.c.below(4) != 3 {
            return text;
        }
        for (k, r) in records.iter_mut().enumerate() {
            let length_s = r.t_s[r.t_s.len() - 1] - r.t_s[0];
            let [offset, drift, late, lost] = [(); 4].map(|()| if self.c.one_in(2) { 0.0 } else { self.c.noise() });
            r.own = Some(OwnFile {
                offset_s: length_s * offset,
                drift: 0.01 * drift,
                late_s: 0.02 * length_s * late,
                lost: 0.01 * lost,
            });
            let _ = write!(
                text,
                "\n[files.own{k}]\npath = \"own{k}.csv\"\n\n[records.r{k}.beside.own]\nfile = \"own{k}\"\nholds = [\"c0\"]\ntime_column = \"t\"\n\
                 offset_ms = {:e}\ndrift_percent = {:e}\n",
                1e3 * length_s * offset,
                drift
            );
        }
        text
    }

    fn measurement(&mut self, records: &[Record]) -> String {
        let mut text = String::from("title = \"any bytes\"\ndrive = \"drive.toml\"\n");
        let pulses = self.sensors.iter().any(|s| s.0 == "pulse_pickup");
        for k in 0..records.len() {
            let _ = writeln!(text, "\n[files.r{k}]\npath = \"r{k}.csv\"");
        }
        for (k, (kind, unit, n)) in self.sensors.iter().enumerate() {
            let _ = write!(text, "\n[channels.c{k}]\nsensor = \"sensors.{kind}.n{n}\"\ncolumn = \"c{k}\"\n");
            let _ = writeln!(text, "unit = \"{unit}\"");
            if self.c.one_in(5) {
                let _ = writeln!(text, "noise = {:e}", self.c.log_between(1e-9, 1e2));
            }
        }
        if let Some(kind) = self.input {
            let unit = match (kind, self.bodies[0].slides) {
                ("speed", true) => "m/s",
                ("speed", false) => "rad/s",
                ("force", _) => "N",
                _ => "N m",
            };
            let _ = write!(
                text,
                "\n[inputs.drive]\ninput = \"inputs.{kind}.drive\"\ncolumn = \"input\"\nunit = \"{unit}\"\n"
            );
            if self.c.one_in(3) {
                text.push_str("hold = true\n");
            }
        }
        for (k, r) in records.iter().enumerate() {
            let n = r.t_s.len();
            let _ = writeln!(text, "\n[records.r{k}]\nfile = \"r{k}\"");
            match self.c.below(3) {
                _ if pulses => {}
                0 => _ = writeln!(text, "rate_hz = {:e}", 1.0 / (r.t_s[1] - r.t_s[0]).clamp(1e-5, 1e3)),
                _ => text.push_str("time_column = \"t\"\n"),
            }
            match self.c.below(5) {
                0 if k > 0 => text.push_str("use = \"judge\"\n"),
                1 if k > 0 => text.push_str("use = \"transfer\"\n"),
                2 => _ = writeln!(text, "judge_from_row = {}", 2 + self.c.below(n - 2)),
                3 => _ = writeln!(text, "judge_share = {:.3}", 0.9 * self.c.share()),
                _ => {}
            }
            if self.c.one_in(4) {
                text.push_str("start = \"rest\"\n");
            }
        }
        for (path, value) in &self.numbers {
            if self.c.one_in(2) {
                let _ = writeln!(text, "\n[fit.\"{path}\"]");
                if self.c.one_in(3) {
                    let _ = writeln!(text, "spread_percent = {:.3}", self.c.log_between(0.05, 1e4));
                }
                if self.c.one_in(4) {
                    let _ = writeln!(text, "low = {:e}", value * self.c.log_between(1e-6, 2.0));
                }
                if self.c.one_in(6) {
                    text.push_str("per = \"record\"\n");
                }
            }
        }
        if self.c.one_in(3) {
            let [a, b] = [self.c.below(EFFECTS.len()), self.c.below(EFFECTS.len())].map(|i| EFFECTS[i].name);
            let _ = writeln!(text, "\n[candidates]\nonly = [\"{a}\", \"{b}\"]");
        }
        text
    }

    /// Puts what the true machine shows into the columns, where it can be run.
    fn simulate(&mut self, machine: &Machine, data: &Data, records: &mut [Record]) {
        let sensors: Vec<usize> = data.channels.iter().map(|c| c.sensor).collect();
        for s in &data.segments {
            let mut start = s.start.clone();
            for v in &mut start.v {
                *v += self.c.pick(&[0.0, 1.0, 10.0, 100.0]) * (1.0 + self.c.noise());
            }
            let shown = run(machine, &machine.values, &s.task, &start, &sensors, 64.0, None);
            let (Ok(shown), Some(r)) = (shown, records.get_mut(s.record)) else { continue };
            for (k, values) in shown.iter().enumerate() {
                let pulses = self.sensors[k].0 == "pulse_pickup";
                let column = &mut r.channels[k];
                if values.len() == column.len() && values.iter().all(|v| v.is_finite()) {
                    *column = values.iter().map(|v| if pulses { v.exp() } else { *v }).collect();
                }
            }
        }
    }

    /// Noise, and now and then what no recorder should write.
    fn spoil(&mut self, r: &mut Record) {
        for column in &mut r.channels {
            let largest = column.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            let sigma = largest * self.c.pick(&[0.0, 1e-6, 1e-3, 1e-2, 0.3]);
            if sigma > 0.0 {
                column.iter_mut().for_each(|v| *v += sigma * self.c.noise());
            }
            let at = self.c.below(column.len());
            match self.c.below(12) {
                1 => column[at] = 1e9 * largest,
                2 => column[at - at / 8..=at].fill(f64::NAN),
                3 if self.c.one_in(3) => column.fill(0.0),
                4 => column.iter_mut().for_each(|v| *v = v.clamp(-0.5 * largest, 0.5 * largest)),
                5 => column.iter_mut().for_each(|v| *v *= 1e3),
                6 => column.iter_mut().for_each(|v| *v = (*v / (0.2 * largest + 1e-300)).round()),
                7 => column.reverse(),
                8 => column.iter_mut().for_each(|v| *v += 1e6 * largest),
                9 if self.c.one_in(3) => column[at..].fill(f64::NAN),
                _ => {}
            }
        }
    }
}
