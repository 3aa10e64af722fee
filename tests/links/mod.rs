//! Records from a drive with link bodies and one effect that its file does not declare: three speeds, noise of 1 %.

use pitchline::drive::{BUNDLED, Drive};
use pitchline::identify::identify;
use pitchline::identify::report::IdentificationReport;
use pitchline::identify::search::{Budget, Context};
use pitchline::machine::Machine;
use pitchline::machine::simulate::between;
use pitchline::measurement::Measurement;
use pitchline::measurement::columns::Memory;
use pitchline::measurement::segments::load;
use pitchline::sensing::Tracer;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64};

/// An effect, its overrides, and the paths that name it.
pub struct Case {
    pub name: &'static str,
    /// Set in the drive that makes the records, and in the declared one.
    pub both: &'static [&'static str],
    /// Set in the drive that makes the records.
    pub truth: &'static [&'static str],
    /// Numbers of the declared drive that are fitted too, and their `spread_percent`.
    pub free: &'static [(&'static str, u32)],
    pub path: &'static str,
}

/// The guide is pressed into the chain, so that its effects are measurable.
const PRESSED: &[&str] = &["guides.fixed.tight.clearance_um=-500"];

pub const CASES: [Case; 12] = [
    Case { name: "clean", both: &[], truth: &[], free: &[], path: "" },
    Case {
        name: "runout of the driver",
        both: &[],
        truth: &["effects.sprocket_runout.driver.amplitude_um=40"],
        free: &[],
        path: "effects.sprocket_runout.driver",
    },
    Case {
        name: "one long link",
        both: &[],
        truth: &["effects.pitch_error.worn.link=31", "effects.pitch_error.worn.length_um=40"],
        free: &[],
        path: "effects.pitch_error.found",
    },
    Case {
        name: "one long link, driven inertia free",
        both: &[],
        truth: &["effects.pitch_error.worn.link=31", "effects.pitch_error.worn.length_um=40"],
        free: &[("sprockets.driven.inertia_kg_m2", 10)],
        path: "effects.pitch_error.found",
    },
    Case {
        name: "alternate pitch",
        both: &[],
        truth: &["effects.alternate_pitch.chain.difference_um=25"],
        free: &[],
        path: "effects.alternate_pitch.chain",
    },
    Case {
        name: "one damaged tooth",
        both: &[],
        truth: &["effects.gap_error.driver.gap=7", "effects.gap_error.driver.outward_um=60"],
        free: &[],
        path: "effects.gap_error.driver",
    },
    Case {
        name: "one tight joint",
        both: &[],
        truth: &["effects.tight_joint.rusty.joint=44", "effects.tight_joint.rusty.torque_nm=0.1"],
        free: &[],
        path: "effects.tight_joint.found",
    },
    Case {
        name: "guide compliance",
        both: PRESSED,
        truth: &["effects.guide_compliance.tight.compliance_um_per_kn=1000"],
        free: &[],
        path: "effects.guide_compliance.tight",
    },
    Case {
        name: "pin friction",
        both: &[],
        truth: &["effects.pin_friction.chain.friction=0.06"],
        free: &[],
        path: "effects.pin_friction.chain",
    },
    Case {
        name: "drag of the driven shaft",
        both: &[],
        truth: &["effects.viscous_friction.driven.torque_nm_s_per_rad=0.02"],
        free: &[],
        path: "effects.viscous_friction.driven",
    },
    Case {
        name: "friction of the driven shaft",
        both: &[],
        truth: &["effects.coulomb_friction.driven.torque_nm=2"],
        free: &[],
        path: "effects.coulomb_friction.driven",
    },
    Case {
        name: "encoder marks",
        both: &[],
        truth: &["effects.encoder_error.driven.amplitude_deg=0.4", "effects.encoder_error.driven.phase_deg=40"],
        free: &[],
        path: "effects.encoder_error.driven",
    },
];

/// Of the reduction, its second chain of links or of spans.
pub const REDUCTION_CASES: [Case; 5] = [
    Case { name: "reduction, clean", both: &[], truth: &[], free: &[], path: "" },
    Case {
        name: "reduction, one damaged tooth of the second chain",
        both: &[],
        truth: &["effects.gap_error.pinion.gap=7", "effects.gap_error.pinion.outward_um=60"],
        free: &[],
        path: "effects.gap_error.pinion",
    },
    Case {
        name: "reduction, one long link of the second chain",
        both: &[],
        truth: &["effects.pitch_error.worn.link=131", "effects.pitch_error.worn.length_um=40"],
        free: &[],
        path: "effects.pitch_error.second",
    },
    Case {
        name: "reduction, drag of the common shaft",
        both: &[],
        truth: &["effects.viscous_friction.middle.torque_nm_s_per_rad=0.03"],
        free: &[],
        path: "effects.viscous_friction.driven",
    },
    Case {
        name: "reduction, soft span of a chain of spans",
        both: &["chains.second.fidelity=\"spans\""],
        truth: &["effects.span_stiffness.output-pinion.stiffness_n_per_m=-4e5"],
        free: &[],
        path: "effects.span_stiffness.output-pinion",
    },
];

/// Causes in a drive with a hydraulic tensioner. The speed of its driver swings with order 2.
pub const TENSIONER_CASES: [Case; 9] = [
    Case { name: "tensioner, clean", both: &[], truth: &[], free: &[], path: "" },
    Case {
        name: "tensioner, worn bore",
        both: &[],
        truth: &["effects.leak_gap.plunger.gap_um=20"],
        free: &[],
        path: "effects.leak_gap.plunger",
    },
    Case {
        name: "tensioner, dirt under the ball",
        both: &[],
        truth: &["effects.check_leak.feed.area_mm2=0.2"],
        free: &[],
        path: "effects.check_leak.feed",
    },
    Case {
        name: "tensioner, air in the oil",
        both: &[],
        truth: &["effects.oil_air.oil.air_percent=6"],
        free: &[],
        path: "effects.oil_air.oil",
    },
    Case {
        name: "tensioner, plunger rubs in its bore",
        both: &[],
        truth: &[
            "effects.coulomb_friction.plunger.force_n=15",
            "effects.coulomb_friction.plunger.stick_speed_m_s=0.002",
        ],
        free: &[],
        path: "effects.coulomb_friction.plunger",
    },
    Case {
        name: "tensioner, weak spring",
        both: &[],
        truth: &["effects.constant_torque.plunger.force_n=-12"],
        free: &[],
        path: "effects.constant_torque.plunger",
    },
    Case {
        name: "tensioner, soft joints",
        both: &[],
        truth: &["effects.joint_stiffness.chain.share_percent=-25"],
        free: &[],
        path: "effects.joint_stiffness.chain",
    },
    Case {
        name: "tensioner, damped joints",
        both: &[],
        truth: &["effects.joint_damping.chain.damping_n_s_per_m=300"],
        free: &[],
        path: "effects.joint_damping.chain",
    },
    Case {
        name: "tensioner, arm rubs on the chain",
        both: &[],
        truth: &["effects.guide_friction.slack.friction=0.06"],
        free: &[],
        path: "effects.guide_friction.slack",
    },
];

/// A drive, and how it is measured.
pub struct Rig {
    pub text: String,
    /// Tables of its sensors.
    pub sensors: &'static str,
    /// Name, path of the sensor, unit.
    pub channels: &'static [(&'static str, &'static str, &'static str)],
    /// Path of the driver's speed.
    pub driver: &'static str,
    /// Speeds of the driver [rpm], and what the records at them are used for.
    pub speeds: [(f64, &'static str); 3],
    /// Channels whose noise is not 1 % of their root mean square, and what it is, SI.
    pub noise: &'static [(&'static str, f64)],
    /// Before the records begin [s].
    pub settles_s: f64,
    /// Effects that are tried; empty: all.
    pub only: &'static [&'static str],
}

/// Sensors: speed of the driven shaft, torque at the driver, tension of both spans; force of the guide if it is pressed
/// in.
pub const SENSORS: &str = "\n[sensors.tachometer.driven]\n\n[sensors.torque.driver]\n\n[sensors.strain_gauge.tight]\nspan = [\"driven\", \"driver\"]\n\n[sensors.strain_gauge.slack]\nspan = [\"driver\", \"driven\"]\n\n[sensors.force.guide]\nguide = \"tight\"\n";

const CHANNELS: [(&str, &str, &str); 5] = [
    ("speed", "sensors.tachometer.driven", "rad/s"),
    ("torque", "sensors.torque.driver", "N m"),
    ("tight", "sensors.strain_gauge.tight", "N"),
    ("slack", "sensors.strain_gauge.slack", "N"),
    ("guide", "sensors.force.guide", "N"),
];

/// A bush drive with one chain.
pub fn one_chain(text: &str, case: &Case) -> Rig {
    let channels = if case.both.is_empty() { &CHANNELS[..4] } else { &CHANNELS[..] };
    Rig {
        text: text.to_string(),
        sensors: SENSORS,
        channels,
        driver: DRIVER,
        speeds: SPEEDS,
        noise: &[],
        settles_s: 0.1,
        only: &[],
    }
}

/// Two chains on a common shaft.
pub fn reduction() -> Rig {
    Rig {
        text: BUNDLED[4].1.to_string(),
        sensors: "\n[sensors.tachometer.shaft]\nbody = \"driven\"\n\n[sensors.tachometer.output]\n\n[sensors.torque.driver]\n\n[sensors.strain_gauge.first]\nspan = [\"driven\", \"driver\"]\n\n[sensors.strain_gauge.second]\nspan = [\"output\", \"pinion\"]\n",
        channels: &[
            ("shaft", "sensors.tachometer.shaft", "rad/s"),
            ("output", "sensors.tachometer.output", "rad/s"),
            ("torque", "sensors.torque.driver", "N m"),
            ("first", "sensors.strain_gauge.first", "N"),
            ("second", "sensors.strain_gauge.second", "N"),
        ],
        driver: DRIVER,
        speeds: SPEEDS,
        noise: &[],
        settles_s: 0.1,
        only: &[],
    }
}

/// What tensioners, guides, joints and gauges may have. A search of all effects takes three times as long.
const TENSIONER_EFFECTS: [&str; 11] = [
    "leak_gap",
    "check_leak",
    "oil_air",
    "oil_viscosity",
    "coulomb_friction",
    "constant_torque",
    "joint_stiffness",
    "joint_damping",
    "guide_friction",
    "gain_error",
    "offset",
];

/// One chain with an arm and a hydraulic tensioner. A speed that swings makes its plunger pump.
pub fn tensioner() -> Rig {
    let (_, text) = BUNDLED.iter().find(|(name, _)| *name == "tensioner-20-40").expect("it is bundled");
    Rig {
        text: text
            .replace("speed_rpm = 3000", "orders = [2]\namplitudes_deg = [1.5]\nphases_deg = [0]\nspeed_rpm = 3000"),
        sensors: "\n[sensors.tachometer.driven]\n\n[sensors.torque.driver]\n\n[sensors.strain_gauge.slack]\nspan = [\"driver\", \"driven\"]\n",
        channels: &[
            ("speed", "sensors.tachometer.driven", "rad/s"),
            ("torque", "sensors.torque.driver", "N m"),
            ("slack", "sensors.strain_gauge.slack", "N"),
            ("travel", "sensors.displacement.plunger", "m"),
            ("pressure", "sensors.pressure.high", "Pa"),
        ],
        driver: DRIVER,
        speeds: [(2000.0, "fit"), (4000.0, "fit"), (3000.0, "judge")],
        // The plunger stands 4 mm from where it is drawn, and moves by some 0.1 mm.
        noise: &[("travel", 3e-6)],
        // It creeps to its place.
        settles_s: 1.5,
        only: &TENSIONER_EFFECTS,
    }
}

/// Path of the speed of the two-sprocket drives.
const DRIVER: &str = "speeds.constant.driver.speed_rpm";
const RATE_HZ: f64 = 10_000.0;
const SAMPLES: usize = 4000;
/// Fit, fit, judge [rpm].
pub const SPEEDS: [(f64, &str); 3] = [(1000.0, "fit"), (3000.0, "fit"), (2000.0, "judge")];

/// Normal numbers from a seed.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (2.0 * std::f64::consts::PI * self.uniform()).cos()
    }
}

/// The declared drive's text.
pub fn declared(rig: &Rig, both: &[&str]) -> String {
    // Values are written into the text, so that the file looks like a user's.
    let mut table: toml::Table = format!("{}{}", rig.text, rig.sensors).parse().expect("TOML");
    for set in both {
        let (path, value) = set.split_once('=').expect("path=value");
        let mut at = &mut table;
        let keys: Vec<&str> = path.split('.').collect();
        for key in &keys[..keys.len() - 1] {
            at = at
                .entry(key.to_string())
                .or_insert(toml::Value::Table(toml::Table::new()))
                .as_table_mut()
                .expect("a table");
        }
        at.insert(keys[keys.len() - 1].to_string(), value.parse().expect("a value"));
    }
    toml::to_string(&table).expect("TOML")
}

/// Makes the records of a case in `folder`.
pub fn write(folder: &Path, rig: &Rig, case: &Case, seed: u64) {
    let drive = declared(rig, case.both);
    std::fs::write(folder.join("drive.toml"), &drive).expect("written");
    let mut measurement = String::from("title = \"links\"\ndrive = \"drive.toml\"\n");
    let channels = rig.channels;
    for (name, sensor, unit) in channels {
        measurement += &format!("[channels.{name}]\nsensor = \"{sensor}\"\ncolumn = \"{name}\"\nunit = \"{unit}\"\n");
    }
    let mut random = Random(seed);
    for (rpm, usage) in rig.speeds {
        let mut sets: Vec<String> = case.truth.iter().map(|s| (*s).to_string()).collect();
        sets.push(format!("{}={rpm}", rig.driver));
        let real = Drive::parse("drive.toml", &drive, &sets).unwrap_or_else(|e| panic!("{e}"));
        let mut tracer = Tracer::new(&real, 2.5e-6).expect("assembled");
        tracer.run_for(rig.settles_s + 0.1 * random.uniform()).expect("runs");
        tracer.clear_readings();
        tracer.run_until(SAMPLES as f64 / RATE_HZ + 1e-3).expect("runs");
        let columns: Vec<Vec<f64>> = (0..channels.len())
            .map(|c| {
                let sensor = real.sensors.iter().position(|s| s.path == channels[c].1).expect("a sensor");
                let series = tracer.readings(sensor);
                let values: Vec<f64> =
                    (0..SAMPLES).map(|i| between(series, i as f64 / RATE_HZ / tracer.step_s())).collect();
                // Signal effects: only the encoder's wave is used here, implemented independently.
                let values = if c == 0 { encoder(&real, &values) } else { values };
                let own = rig.noise.iter().find(|(name, _)| *name == channels[c].0);
                let rms = (values.iter().map(|v| v * v).sum::<f64>() / SAMPLES as f64).sqrt();
                let noise = own.map_or(0.01 * rms, |(_, si)| *si);
                values.iter().map(|v| v + noise * random.normal()).collect()
            })
            .collect();
        let mut csv = channels.iter().map(|c| c.0).collect::<Vec<_>>().join(",") + "\n";
        for i in 0..SAMPLES {
            csv += &columns.iter().map(|c| format!("{:.8e}", c[i])).collect::<Vec<_>>().join(",");
            csv.push('\n');
        }
        std::fs::write(folder.join(format!("{rpm}.csv")), csv).expect("written");
        measurement += &format!(
            "[files.n{rpm}]\npath = \"{rpm}.csv\"\n[records.n{rpm}]\nfile = \"n{rpm}\"\nuse = \"{usage}\"\nrate_hz = {RATE_HZ}\nset = {{ \"{}\" = {rpm} }}\n",
            rig.driver
        );
    }
    for (path, spread) in case.free {
        measurement += &format!("[fit.\"{path}\"]\nspread_percent = {spread}\n");
    }
    if !rig.only.is_empty() {
        measurement += &format!("[candidates]\nonly = {:?}\n", rig.only);
    }
    std::fs::write(folder.join("measured.toml"), measurement).expect("written");
}

/// Speed as displayed by an encoder with a wave in its marks.
fn encoder(real: &Drive, values: &[f64]) -> Vec<f64> {
    let Some(signal) = real.signals.first() else { return values.to_vec() };
    let mut angle = signal.values[1];
    values
        .iter()
        .map(|v| {
            angle += v / RATE_HZ;
            v * (1.0 + signal.values[0] * angle.cos())
        })
        .collect()
}

/// Identifies the measurement in `folder`.
pub fn identified(folder: &Path, threads: usize) -> Result<IdentificationReport, String> {
    let path = folder.join("measured.toml");
    let text = std::fs::read_to_string(&path).map_err(|e| e.to_string())?;
    let measurement = Measurement::parse("measured.toml", &text).map_err(|r| r.to_string())?;
    let text = std::fs::read_to_string(folder.join("drive.toml")).map_err(|e| e.to_string())?;
    let drive = Drive::parse("drive.toml", &text, &[]).map_err(|r| r.to_string())?;
    let machine = Machine::of_links(&drive);
    let data =
        load(&measurement, &machine, folder, &mut Memory::for_program(1_000_000_000)).map_err(|e| e.to_string())?;
    let (stop, runs) = (AtomicBool::new(false), AtomicU64::new(0));
    let verbose = std::env::var_os("PITCHLINE_VERBOSE").is_some();
    let started = std::time::Instant::now();
    let say = |stage: &str, runs: u64| {
        if verbose {
            println!("{:7.1} s {runs:5} runs: {stage}", started.elapsed().as_secs_f64());
        }
    };
    let context = Context {
        threads,
        budget: Budget { runs: None, seconds: None },
        started,
        stop: &stop,
        progress: &say,
        runs: &runs,
    };
    identify(&measurement, &machine, &data, &context).map_err(|e| e.to_string())
}

/// The bundled bush drive.
pub fn bush() -> &'static str {
    BUNDLED[0].1
}
