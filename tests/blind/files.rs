//! A case as the files that `identify` reads.

use super::machine::{Kind, Machine, Number};
use super::numbers::Random;
use super::weighing::Bench;
use super::{Class, DRIVE_FILE};
use std::f64::consts::PI;
use std::fmt::Write as _;

/// Form in which a case is written to files.
pub(super) struct Written {
    /// The drive as its file declares it.
    pub(super) declared: Machine,
    pub(super) free: Vec<Number>,
    /// Uncertainty of the file's parameters [percent].
    pub(super) spread: Option<f64>,
    /// Correlation of neighbours in the noise.
    pub(super) colour: f64,
    pub(super) one_file: bool,
    pub(super) time_column: bool,
    pub(super) rpm: bool,
}

const NAMES: [&str; 3] = ["first", "second", "third"];

impl Written {
    pub(super) fn new(bench: &Bench, class: Class, number: u64, random: &mut Random) -> Written {
        let free = bench.m.numbers(bench.wish);
        let mut declared = bench.m.clone();
        for n in &free {
            *declared.number(*n) *= 1.0 + random.between(-0.15, 0.15);
        }
        let wrong = class == Class::Clean && number % 3 == 1;
        if wrong && bench.m.kind == Kind::One && random.chance(0.5) {
            // Inertia and loss absorb it.
            declared.gain *= 1.0 + random.sign() * random.between(0.15, 0.35);
        } else if wrong {
            let n = random.pick(&free);
            *declared.number(n) *= if random.chance(0.5) { random.between(0.4, 0.6) } else { random.between(1.6, 2.3) };
        }
        let spread = if bench.wish.one_speed || (!wrong && random.chance(0.33)) { Some(15.0) } else { None };
        let colour = if class == Class::Clean && number.is_multiple_of(3) { random.between(0.5, 0.9) } else { 0.0 };
        let (one_file, time_column) = (random.chance(0.5), random.chance(0.5));
        Written { declared, free, spread, colour, one_file, time_column, rpm: !bench.m.slides && random.chance(0.3) }
    }

    /// A wrong gain scales all parameters that it drives.
    pub(super) fn numbers(&self, m: &Machine) -> Vec<(String, f64)> {
        let mut found = m.clone();
        let stretch = self.declared.gain / m.gain;
        self.free.iter().map(|n| (m.number_path(*n), stretch * *found.number(*n))).collect()
    }

    /// Name, unit and size in SI of a column of speeds; else of the gauge.
    pub(super) fn unit(&self, m: &Machine, channel: usize) -> (&'static str, f64) {
        match m.sensed(channel) {
            None => ("N", 1.0),
            Some(_) if m.slides => ("m/s", 1.0),
            Some(_) if self.rpm => ("rpm", PI / 30.0),
            Some(_) => ("rad/s", 1.0),
        }
    }

    /// Columns of every record: input, then channels with their noise, in the units of the file.
    pub(super) fn columns(&self, bench: &Bench, shown: &[f64], random: &mut Random) -> Vec<Vec<Vec<f64>>> {
        let mut all = Vec::new();
        let mut at = 0;
        for rec in &bench.records {
            let mut columns = vec![rec.input[rec.lead..rec.lead + rec.n].to_vec()];
            for (c, sigma) in bench.sigma.iter().enumerate() {
                let unit = sigma / self.unit(&bench.m, c).1;
                let mut noise = random.normal();
                let fresh = (1.0 - self.colour * self.colour).sqrt();
                let noisy = shown[at..at + rec.n].iter().map(|y| {
                    let value = unit * (y + noise);
                    noise = self.colour * noise + fresh * random.normal();
                    value
                });
                columns.push(noisy.collect());
                at += rec.n;
            }
            all.push(columns);
        }
        all
    }

    fn header(&self, m: &Machine) -> String {
        let time = if self.time_column { "t," } else { "" };
        let channels: Vec<String> = (0..m.channels).map(|c| format!("sensor_{}", m.sensor(c))).collect();
        format!("{time}input,{}\n", channels.join(","))
    }

    pub(super) fn csvs(&self, bench: &Bench, records: &[Vec<Vec<f64>>]) -> Vec<(String, String)> {
        let header = self.header(&bench.m);
        let mut files = Vec::new();
        let mut together = header.clone();
        let mut row = 0;
        for (k, columns) in records.iter().enumerate() {
            let mut own = String::new();
            for i in 0..columns[0].len() {
                if self.time_column {
                    let t = if self.one_file { row } else { i } as f64 / bench.m.rate_hz;
                    let _ = write!(own, "{t:.9},");
                }
                let _ = write!(own, "{:.9e}", columns[0][i]);
                for c in &columns[1..] {
                    let _ = write!(own, ",{:.7e}", c[i]);
                }
                own.push('\n');
                row += 1;
            }
            if self.one_file {
                together += &own;
            } else {
                files.push((format!("{}.csv", NAMES[k]), format!("{header}{own}")));
            }
        }
        if self.one_file {
            files.push(("records.csv".to_string(), together));
        }
        files
    }

    pub(super) fn drive(&self, true_machine: &Machine, name: &str) -> String {
        let d = &self.declared;
        let mut text = format!("title = \"{name}\"\nfidelity = \"lumped\"\n");
        let mut put = |table: String, lines: &[String]| {
            let _ = write!(text, "\n[{table}]\n");
            for l in lines {
                let _ = writeln!(text, "{l}");
            }
        };
        let line = |key: &str, value: f64| format!("{key} = {value:.9e}");
        for b in 0..=d.last() {
            let (group, key) = if d.slides { ("sliders", "mass_kg") } else { ("rotors", "inertia_kg_m2") };
            let mut lines = vec![line(key, d.inertia[b])];
            if d.kind == Kind::Chain {
                lines.push(format!("teeth = {}", d.teeth[b]));
            }
            put(format!("{group}.{}", d.body(b)), &lines);
            let key = if d.slides { "force_n_s_per_m" } else { "torque_nm_s_per_rad" };
            if d.viscous[b] > 0.0 {
                put(format!("loads.viscous.{}", d.body(b)), &[line(key, d.viscous[b])]);
            }
            if d.constant[b] != 0.0 {
                put(format!("loads.constant.{}", d.body(b)), &[line("torque_nm", d.constant[b])]);
            }
        }
        let between = format!("between = [\"{}\", \"{}\"]", d.body(0), d.body(1));
        match d.kind {
            Kind::One => {}
            Kind::Two => put(
                "couplings.shaft".into(),
                &[between, line("stiffness_nm_per_rad", d.stiffness), line("damping_nm_s_per_rad", d.damping)],
            ),
            Kind::Chain => {
                put("chain".into(), &[format!("links = {}", d.links)]);
                // Radii are those of the pitch circles' ratio, which the chain keeps.
                let [from, to] = true_machine.radius.map(|r| 1e3 * r);
                let mut lines = vec![between, line("from_radius_mm", from), line("to_radius_mm", to)];
                lines.push(line("stiffness_n_per_m", d.stiffness));
                lines.push(line("damping_n_s_per_m", d.damping));
                if let Some((from, to)) = d.span_links {
                    lines.push(format!("from_link = {from}\nto_link = {to}"));
                }
                put("spans.tight".into(), &lines);
            }
        }
        match (d.kind, d.slides) {
            (Kind::Chain, _) => put("inputs.speed.driver".into(), &[]),
            (_, true) => put("inputs.force.stage".into(), &[line("gain_n_per_unit", d.gain)]),
            (_, false) => put(format!("inputs.torque.{}", d.body(0)), &[line("gain_nm_per_unit", d.gain)]),
        }
        for c in 0..d.channels {
            let kind = if d.sensed(c).is_some() { "tachometer" } else { "strain_gauge" };
            put(format!("sensors.{kind}.{}", d.sensor(c)), &[]);
        }
        text
    }

    pub(super) fn measurement(&self, bench: &Bench, name: &str) -> String {
        let m = &bench.m;
        let mut text = format!("title = \"{name}\"\ndrive = \"{DRIVE_FILE}\"\n");
        let files: &[&str] = if self.one_file { &["records"] } else { &NAMES[..bench.records.len()] };
        for file in files {
            let _ = write!(text, "\n[files.{file}]\npath = \"{file}.csv\"\n");
        }
        for c in 0..m.channels {
            let (sensor, unit) = (m.sensor(c), self.unit(m, c).0);
            let kind = if m.sensed(c).is_some() { "tachometer" } else { "strain_gauge" };
            let _ = write!(
                text,
                "\n[channels.{sensor}]\nsensor = \"sensors.{kind}.{sensor}\"\ncolumn = \"sensor_{sensor}\"\nunit = \"{unit}\"\n"
            );
        }
        let (input, unit) = match (m.kind, m.slides, m.gain == 1.0) {
            (Kind::Chain, ..) => ("speed.driver".to_string(), "rad/s"),
            (_, true, _) => ("force.stage".to_string(), "N"),
            (_, false, true) => (format!("torque.{}", m.body(0)), "N m"),
            (_, false, false) => (format!("torque.{}", m.body(0)), "V"),
        };
        let _ = write!(text, "\n[inputs.drive]\ninput = \"inputs.{input}\"\ncolumn = \"input\"\nunit = \"{unit}\"\n");
        if m.hold {
            text += "hold = true\n";
        }
        let mut row = 1;
        for (k, rec) in bench.records.iter().enumerate() {
            let _ = write!(text, "\n[records.{}]\n", NAMES[k]);
            if self.one_file {
                let _ = write!(text, "from_row = {row}\nto_row = {}\n", row + rec.n - 1);
            } else {
                let _ = writeln!(text, "file = \"{}\"", NAMES[k]);
            }
            match self.time_column {
                true => text += "time_column = \"t\"\ntime_unit = \"s\"\n",
                false => text += &format!("rate_hz = {}\n", m.rate_hz),
            }
            if rec.judges {
                text += "use = \"judge\"\n";
            }
            if bench.wish.one_speed {
                let _ = writeln!(text, "judge_from_row = {}", row + 2 * rec.n / 3);
            }
            row += rec.n;
        }
        for n in &self.free {
            let _ = write!(text, "\n[fit.\"{}\"]\n", m.number_path(*n));
            if let Some(spread) = self.spread {
                let _ = writeln!(text, "spread_percent = {spread:.1}");
            }
        }
        text
    }
}
