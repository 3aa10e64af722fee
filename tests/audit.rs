//! Causes are planted in drives, sizes and places from a seed. `pitchline run`, then `pitchline audit --against` or `pitchline spectrum --against`, must
//! name each: the part, the quantity, its sign, and its size within a fifth. Nothing of the drive's text reaches these verbs but names.
//! Healthy drives must be told healthy.

use pitchline::analysis::audit::Topology;
use pitchline::analysis::audit::links::{JointPass, LinkSums};
use pitchline::recording::frame::{Contacts, Frame, Joints, Links};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Share of a planted size by which the measured one may be off.
const SHARE: f64 = 0.2;
/// One lap of the chains and a tenth more [ms], and between two frames.
const RECORDED: (&str, &str) = ("100ms", "150us");

fn command(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pitchline")).args(args).output().expect("the program starts")
}

/// Runs a command that prints JSON.
fn json(args: &[&str]) -> Value {
    let out = command(&[args, &["--json"]].concat());
    assert!(out.status.success(), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).expect("JSON")
}

/// Records a drive with modified values.
fn record(drive: &str, path: &Path, (duration, every): (&str, &str), set: &[String]) {
    let mut args = vec!["run", drive, "--duration", duration, "--every", every, "-o", path.to_str().expect("text")];
    set.iter().for_each(|s| args.extend(["--set", s]));
    json(&args);
}

/// Marsaglia's xorshift.
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A whole number below `n`.
    fn below(&mut self, n: u32) -> u32 {
        (self.roll() * f64::from(n)) as u32
    }

    /// A whole number of some unit, of either sign, from `low` to `high` in size.
    fn size(&mut self, low: u32, high: u32) -> f64 {
        let size = f64::from(low + self.below(high - low + 1));
        if self.roll() < 0.5 { size } else { -size }
    }
}

/// What is planted, and how it must be named.
struct Cause {
    set: Vec<String>,
    part: String,
    quantity: &'static str,
    /// In SI: the difference from the healthy drive.
    size: f64,
}

fn cause<const N: usize>(set: [String; N], part: impl Into<String>, quantity: &'static str, size: f64) -> Cause {
    Cause { set: set.into(), part: part.into(), quantity, size }
}

/// Causes that all drives take.
fn common(dice: &mut Dice, rows: [&str; 2]) -> Vec<Cause> {
    let (link, joint) = (dice.below(90), dice.below(90));
    let (um, nmm) = (dice.size(5, 60), dice.size(20, 400).abs());
    let (worn, clearance) = (dice.size(10, 30).abs(), dice.size(8, 25).abs());
    let mu = 0.05 + 0.01 * f64::from(dice.below(15));
    let damping = 600.0 + f64::from(dice.below(5)) * 100.0;
    let pitch = "effects.pitch_error.odd";
    vec![
        cause(
            [format!("{pitch}.link={link}"), format!("{pitch}.length_um={um}")],
            format!("link {link}"),
            "pitch_m",
            um * 1e-6,
        ),
        cause(
            [
                format!("effects.tight_joint.odd.joint={joint}"),
                format!("effects.tight_joint.odd.torque_nm={}", nmm * 1e-3),
            ],
            format!("joint {joint}"),
            "tight_torque_nm",
            nmm * 1e-3,
        ),
        cause([format!("effects.pin_friction.chain.friction={mu}")], "joints", "friction_arm_m", mu),
        cause(
            [format!("effects.wear_elongation.chain.length_um={worn}")],
            format!("{} links", rows[0]),
            "pitch_m",
            worn * 1e-6,
        ),
        cause([format!("chain.joint.clearance_um={clearance}")], "joints", "clearance_m", clearance * 1e-6),
        cause([format!("chain.joint.damping_n_s_per_m={damping}")], "joints", "damping_n_s_per_m", damping),
        cause(["chain.joint.stiffness_n_per_m=2.2e7".into()], "joints", "stiffness_n_per_m", -8e6),
    ]
}

/// Causes of sprockets that seat bushes.
fn of_gaps(dice: &mut Dice) -> Vec<Cause> {
    let (high, low) = (dice.below(20), dice.below(40));
    let (up, down) = (dice.size(10, 40).abs(), -dice.size(10, 30).abs());
    let (runout, phase) = (dice.size(20, 60).abs(), dice.below(360));
    let (wave, order) = (dice.size(10, 25).abs(), 2 + dice.below(4));
    let gap = |sprocket: &str, gap: u32, um: f64| {
        let effect = format!("effects.gap_error.{sprocket}");
        [format!("{effect}.gap={gap}"), format!("{effect}.outward_um={um}")]
    };
    let (runs_out, uneven) = ("effects.sprocket_runout.driven", "effects.tooth_pitch_error.driven");
    vec![
        cause(gap("driver", high, up), format!("gap {high} of `driver`"), "outward_m", up * 1e-6),
        cause(gap("driven", low, down), format!("gap {low} of `driven`"), "outward_m", down * 1e-6),
        cause(
            [format!("{runs_out}.amplitude_um={runout}"), format!("{runs_out}.phase_deg={phase}")],
            "sprockets.driven",
            "eccentricity_m",
            runout * 1e-6,
        ),
        cause(
            [format!("{uneven}.amplitude_um={wave}"), format!("{uneven}.order={order}")],
            "sprockets.driven",
            "place_wave_m",
            wave * 1e-6,
        ),
    ]
}

/// Causes at the guide along the tight span, which is pressed against the chain in the healthy drive too.
fn of_guides(dice: &mut Dice) -> Vec<Cause> {
    let per_kn = f64::from(50 + dice.below(150));
    let (lift, mu) = (f64::from(100 + 10 * dice.below(20)), 0.05 + 0.01 * f64::from(dice.below(15)));
    let guide = "guides.fixed.tight";
    vec![
        cause(
            [format!("effects.guide_compliance.tight.compliance_um_per_kn={per_kn}")],
            guide,
            "mount_compliance_m_per_n",
            per_kn * 1e-9,
        ),
        cause([format!("effects.guide_friction.tight.friction={mu}")], guide, "friction", mu),
        cause([format!("guides.fixed.tight.end_lift_um={lift}")], guide, "height_m", lift * 1e-6),
    ]
}

/// The first finding about a part and quantity, and its rank.
fn named<'a>(found: &'a Value, part: &str, quantity: &str) -> Option<(usize, &'a Value)> {
    let list = found["findings"].as_array()?;
    list.iter().enumerate().find(|(_, f)| f["part"] == part && f["quantity"] == quantity)
}

/// Plants causes, one after the other; returns how many were named first, and the lines of the table.
fn planted(drive: &str, healthy: &[&str], causes: Vec<Cause>, pin_radius_m: f64) -> (usize, Vec<String>) {
    let folder = tempfile::tempdir().expect("a folder");
    let (good, odd) = (folder.path().join("good.mcap"), folder.path().join("odd.mcap"));
    let healthy: Vec<String> = healthy.iter().map(|s| (*s).to_string()).collect();
    record(drive, &good, RECORDED, &healthy);
    let (good, shown) = (good.to_str().expect("text"), odd.to_str().expect("text").to_string());
    let alone = json(&["audit", good]);
    assert_eq!(alone["healthy"], true, "{drive}: {:#?}", alone["findings"]);
    let (mut named_so_far, mut lines) = (0, Vec::new());
    for mut cause in causes {
        // An effect on friction has another unit than what is measured.
        match cause.quantity {
            "friction_arm_m" => cause.size *= pin_radius_m,
            "damping_n_s_per_m" => {
                let own = json(&["audit", good])["parts"].as_array().expect("a list").clone();
                let of = own.iter().find(|p| p["quantity"] == "damping_n_s_per_m").expect("measured");
                cause.size -= libm::round(of["value"].as_f64().expect("a number") / 100.0) * 100.0;
            }
            _ => {}
        }
        record(drive, &odd, RECORDED, &[&healthy[..], &cause.set].concat());
        let found = json(&["audit", &shown, "--against", good]);
        let finding = named(&found, &cause.part, cause.quantity);
        let measured = finding.and_then(|(_, f)| f["difference"].as_f64()).unwrap_or(0.0);
        // Of the other row of links, or of the same part: nothing else may be named before.
        let is_kin = |f: &Value| f["quantity"] == cause.quantity || f["part"] == cause.part.as_str();
        let before = found["findings"].as_array().map_or(&[][..], |list| &list[..finding.map_or(0, |(rank, _)| rank)]);
        let is_named = before.iter().all(is_kin) && (measured / cause.size - 1.0).abs() <= SHARE;
        named_so_far += usize::from(is_named);
        lines.push(format!(
            "{} {drive:16} {:34} {:26} planted {:11.4e}, measured {measured:11.4e}, rank {}",
            if is_named { "yes" } else { "NO " },
            cause.part,
            cause.quantity,
            cause.size,
            finding.map_or("-".to_string(), |(rank, _)| (rank + 1).to_string())
        ));
    }
    (named_so_far, lines)
}

/// Prints the table, and fails if one is not named first, with its size.
fn judge(results: Vec<(usize, Vec<String>)>) {
    let named: usize = results.iter().map(|r| r.0).sum();
    let lines: Vec<String> = results.into_iter().flat_map(|r| r.1).collect();
    println!("{}\n{named} of {} named", lines.join("\n"), lines.len());
    assert_eq!(named, lines.len(), "{named} of {} named\n{}", lines.len(), lines.join("\n"));
}

#[test]
fn planted_causes_are_named_in_bush_drives() {
    let mut dice = Dice(20_251_125);
    let near = ["guides.fixed.tight.clearance_um=0"];
    let mut causes = common(&mut dice, ["inner", "outer"]);
    causes.extend(of_gaps(&mut dice));
    causes.extend([
        cause(["sprockets.driver.gap_form=min".into()], "sprockets.driver", "seat_radius_m", -0.118e-3),
        cause(["preload.tension_n=230".into()], "chain", "tightening_n", -70.0),
        // A wave of the gaps' places that is as large as half their play, and an order of the driver's speed: A w/sqrt 2, w 3 times 100 pi.
        cause(
            [
                "effects.tooth_pitch_error.driver.amplitude_um=45".into(),
                "effects.tooth_pitch_error.driver.order=4".into(),
            ],
            "sprockets.driver",
            "place_wave_m",
            45e-6,
        ),
        cause(
            [
                "speeds.constant.driver.orders=[3]".into(),
                "speeds.constant.driver.amplitudes_deg=[0.078]".into(),
                "speeds.constant.driver.phases_deg=[0]".into(),
            ],
            "sprockets.driver",
            "driver_speed_scatter_rad_s",
            0.078 / 180.0 * std::f64::consts::PI * 300.0 * std::f64::consts::PI / std::f64::consts::SQRT_2,
        ),
        // A guide that links touch at its ends alone, and gaps that lie deeper as a whole.
        cause(["guides.fixed.slack.clearance_um=90".into()], "guides.fixed.slack", "height_m", 110e-6),
        cause(["sprockets.driver.root_relief_um=14".into()], "sprockets.driver", "gap_form_m", -14e-6),
        // Thin guides on pins: the mass of outer links is given, not computed.
        cause(["chain.bush.outer.mass_g=6.89".into()], "outer links", "mass_kg", 3.445e-3),
        cause(["chain.bush.outer.inertia_g_mm2=98".into()], "outer links", "inertia_kg_m2", 32.8e-9),
    ]);
    let alone = planted("bush-20-40", &[], causes, 1.65e-3);
    let guided = planted("bush-20-40", &near, of_guides(&mut dice), 1.65e-3);
    let mut causes = common(&mut dice, ["inner", "outer"]);
    causes.extend(of_gaps(&mut dice));
    // A rail on the arm that stands nearer to the chain.
    causes.push(cause(["guides.rail.slack.start_y_mm=-30.40".into()], "guides.rail.slack", "place_m", 140.6e-6));
    let arm = planted("arm-20-40", &[], causes, 1.65e-3);
    judge(vec![alone, guided, arm]);
}

#[test]
fn planted_causes_are_named_in_silent_and_abutment_drives() {
    let mut dice = Dice(4_711);
    let near = ["guides.fixed.tight.clearance_um=0"];
    let mut causes = common(&mut dice, ["even", "odd"]);
    causes.extend([
        cause(["preload.tension_n=230".into()], "chain", "tightening_n", -70.0),
        cause(["chain.silent.outer.mass_g=14.6".into()], "odd links", "mass_kg", 7.3e-3),
        cause(["chain.silent.outer.inertia_g_mm2=140".into()], "odd links", "inertia_kg_m2", 70e-9),
        // No link touches it then.
        cause(["guides.fixed.slack.clearance_um=300".into()], "guides.fixed.slack", "height_m", -100e-6),
    ]);
    let silent = planted("silent-20-40", &[], causes, 1.4e-3);
    let guided = planted("silent-20-40", &near, of_guides(&mut dice), 1.4e-3);
    let mut causes = common(&mut dice, ["inner", "outer"]);
    causes.extend(of_gaps(&mut dice));
    causes.extend(of_guides(&mut dice));
    causes.extend([
        cause(["preload.tension_n=225".into()], "chain", "tightening_n", -60.0),
        cause(["sprockets.driven.root_relief_um=43".into()], "sprockets.driven", "gap_form_m", 19e-6),
        cause(["sprockets.driven.root_relief_um=81".into()], "sprockets.driven", "gap_form_m", -19e-6),
    ]);
    let smartchain = planted("smartchain-20-40", &[], causes, 1.65e-3);
    judge(vec![silent, guided, smartchain]);
}

/// A rail that turned, one of another radius, and a guide lifted where the chain leaves it are told as such; one lifted where no link touches it, by its pose.
#[test]
fn how_guides_and_rails_stand_elsewhere_is_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let (good, odd) = (folder.path().join("good.mcap"), folder.path().join("odd.mcap"));
    let near = "guides.fixed.tight.clearance_um=0".to_string();
    for (drive, healthy, set, wanted) in [
        ("arm-20-40", None, "guides.rail.slack.heading_deg=19.9", "turned by 0.25"),
        ("arm-20-40", None, "guides.rail.slack.radii_mm=[60, 400, 60]", "has another form"),
        ("bush-20-40", Some(near), "guides.fixed.tight.end_lift_um=200", "touch it near its end, its face stands 19"),
        ("bush-20-40", None, "guides.fixed.slack.end_lift_um=150", "by its pose it stands up to 15"),
        (
            "smartchain-20-40",
            None,
            "sprockets.driver.gap_form=min",
            "the clockwise flank of its gaps lies 97.6 um further out",
        ),
    ] {
        let healthy: Vec<String> = healthy.into_iter().collect();
        record(drive, &good, RECORDED, &healthy);
        record(drive, &odd, RECORDED, &[&healthy[..], &[set.to_string()]].concat());
        let found = json(&["audit", odd.to_str().expect("text"), "--against", good.to_str().expect("text")]);
        let text = &found["findings"][0]["text"];
        println!("{text}");
        assert!(text.as_str().is_some_and(|t| t.contains(wanted)), "{set}: {text}");
    }
}

/// A gap that is so low that nothing touches it is named by that.
#[test]
fn a_gap_that_is_never_seated_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let odd = folder.path().join("odd.mcap");
    let effect = "effects.gap_error.driven";
    record("smartchain-20-40", &odd, RECORDED, &[format!("{effect}.gap=27"), format!("{effect}.outward_um=-150")]);
    let found = json(&["audit", odd.to_str().expect("text")]);
    let first = &found["findings"][0];
    println!("{first}");
    assert_eq!((&first["body"], &first["tooth"]), (&Value::from("sprockets.driven"), &Value::from(27)));
    assert!(first["text"].as_str().is_some_and(|t| t.contains("never seated")), "{first}");
}

/// A sprocket that is 50 um eccentric turns up in the speed of its shaft once a turn, and in no healthy drive.
#[test]
fn an_eccentric_sprocket_stands_out_in_the_spectrum() {
    let folder = tempfile::tempdir().expect("a folder");
    let (good, odd) = (folder.path().join("good.mcap"), folder.path().join("odd.mcap"));
    for (drive, effect) in [
        ("bush-20-40", "effects.sprocket_runout.driven.amplitude_um=50"),
        ("smartchain-20-40", "effects.sprocket_runout.driven.amplitude_um=50"),
        ("arm-20-40", "effects.sprocket_runout.driven.amplitude_um=50"),
    ] {
        record(drive, &good, ("160ms", "100us"), &[]);
        record(drive, &odd, ("160ms", "100us"), &[effect.to_string()]);
        let (good, odd) = (good.to_str().expect("text"), odd.to_str().expect("text"));
        let found = json(&["spectrum", odd, "sprocket.driven.speed", "--against", good]);
        let first = &found["differing"][0];
        println!("{drive}: {first}");
        assert_eq!(first["names"][0], "1 x driven", "{found:#}");
        let healthy = json(&["spectrum", good, "sprocket.driven.speed"]);
        let once = healthy["peaks"].as_array().expect("a list").iter().find(|p| p["names"][0] == "1 x driven");
        let size = |p: &Value, key: &str| p[key].as_f64().expect("a number");
        assert!(once.is_none_or(|p| size(p, "amplitude") < 0.2 * size(first, "amplitude")), "{healthy:#}");
    }
}

/// Bad input is refused with a message that says what it takes.
fn refused(args: &[&str], wanted: &[&str]) {
    let out = command(args);
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{args:?}: {said}");
    wanted.iter().for_each(|w| assert!(said.contains(w), "{args:?}: {said}"));
}

#[test]
fn what_cannot_be_measured_is_said_with_what_it_takes() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| -> PathBuf { folder.path().join(name) };
    let (short, long, other, coarse) = (at("short.mcap"), at("long.mcap"), at("other.mcap"), at("coarse.mcap"));
    record("bush-20-40", &short, ("0.5ms", "100us"), &[]);
    record("bush-20-40", &long, ("20ms", "100us"), &[]);
    record("silent-20-40", &other, ("5ms", "100us"), &[]);
    record("bush-20-40", &coarse, ("100ms", "8ms"), &[]);
    let text = |path: &PathBuf| path.to_str().expect("text").to_string();
    let (short, long, other, coarse) = (text(&short), text(&long), text(&other), text(&coarse));
    refused(&["audit", &short], &["an audit takes 12", "zoom"]);
    refused(&["audit", &long, "--against", &other], &["two drives", "contours"]);
    refused(&["spectrum", &long, "sprocket.driven.speed", "--against", &other], &["two drives"]);
    refused(&["spectrum", &short, "sprocket.driven.speed"], &["takes 32"]);
    refused(&["spectrum", &long, "sprocket.drive.speed"], &["did you mean `sprocket.driven.speed`"]);
    refused(&["spectrum", &long, "joint.force"], &["joint[12].force"]);
    refused(&["spectrum", &long, "contact.normal_force"], &["come and go"]);
    refused(&["spectrum", &long, "rotors.driven.sped_rad_s"], &["did you mean `speed_rad_s`"]);
    refused(&["spectrum", &long, "joints.force_x_n[90]"], &["has no row `90`"]);
    refused(&["spectrum", &long, "sprocket.driven.speed", "-o", "a.gif"], &[".svg or .png"]);
    let missing = json(&["audit", &long])["not_measured"].to_string();
    assert!(missing.contains("joints, which turn in fewer than 12 frames: it takes 90.0 ms"), "{missing}");
    let missing = json(&["audit", &coarse])["not_measured"].to_string();
    let coarse_gaps = missing.contains("us is too coarse") && missing.contains("tooth gaps of");
    assert!(coarse_gaps && missing.contains("zoom"), "{missing}");
    let found = json(&["spectrum", &long, "span.driven.driver.tension"]);
    assert!(found["too_short_for"].to_string().contains("lap"), "{found:#}");
    // A recording that was cut off is read as far as it is whole; this is said first.
    let bytes = std::fs::read(&long).expect("the recording");
    let cut = text(&at("cut.mcap"));
    std::fs::write(&cut, &bytes[..bytes.len() * 3 / 4]).expect("written");
    for args in [vec!["audit", &cut], vec!["spectrum", &cut, "sprocket.driven.speed"]] {
        let out = command(&args);
        assert_eq!(out.status.code(), Some(3), "{args:?}");
        assert!(String::from_utf8_lossy(&out.stderr).contains("was not finished"), "{args:?}");
    }
}

#[test]
fn healthy_drives_are_told_healthy_alone_and_against_themselves() {
    let folder = tempfile::tempdir().expect("a folder");
    let (a, b) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    for (drive, ms) in [
        ("bush-20-40", "30ms"),
        ("bush-20-40", "130ms"),
        ("silent-20-40", "60ms"),
        ("smartchain-20-40", "40ms"),
        ("arm-20-40", "60ms"),
        ("tensioner-20-40", "60ms"),
        ("reduction-20-40-20-40", "60ms"),
        ("smartchain-20-40", "4ms"),
    ] {
        record(drive, &a, (ms, "150us"), &[]);
        record(drive, &b, ("100ms", "200us"), &[]);
        let (a, b) = (a.to_str().expect("text"), b.to_str().expect("text"));
        for args in [vec!["audit", a], vec!["audit", a, "--against", b]] {
            let found = json(&args);
            let properties =
                found["findings"].as_array().expect("a list").iter().filter(|f| f["kind"] != "consequence");
            let properties: Vec<&Value> = properties.collect();
            assert!(properties.is_empty(), "{drive}, {ms}, {}: {properties:#?}", args.len());
        }
    }
}

/// A chain of links that fly freely: known masses, arms and joints, random motion, forces by the law of the joint. What no drive file can plant, one
/// heavy link and one stiff damper, is found with the rest.
#[test]
fn frames_made_by_hand_give_back_masses_arms_and_joints() {
    const N: usize = 6;
    let mut dice = Dice(99);
    let mass = [2.7e-3, 3.4e-3, 2.7e-3, 6.8e-3, 2.7e-3, 3.4e-3];
    let inertia = [56e-9, 65e-9, 56e-9, 130e-9, 56e-9, 65e-9];
    let (arm, stiffness, clearance) = ([4e-3, 4e-3, 4.02e-3, 4e-3, 4e-3, 4e-3], 3e7, 12e-6);
    let damping = [100.0, 100.0, 700.0, 100.0, 100.0, 100.0];
    let (friction_arm, tight) = (165e-6, [0.0, 0.0, 0.0, 0.0, 0.2, 0.0]);
    let topology = Topology {
        rollers: Vec::new(),
        ahead: (0..N).map(|i| (i + 1) % N).collect(),
        behind: (0..N).map(|i| (i + N - 1) % N).collect(),
        row: (0..N as u32).map(|i| i % 2).collect(),
        chain: vec![0; N],
        pitch_m: vec![8e-3],
        forwards: true,
    };
    let mut frames = Vec::new();
    for _ in 0..60 {
        let mut random = |size: f64| (2.0 * dice.roll() - 1.0) * size;
        let angle: Vec<f64> = (0..N).map(|_| random(0.5)).collect();
        let omega: Vec<f64> = (0..N).map(|_| random(300.0)).collect();
        let pull: Vec<[f64; 2]> = (0..N).map(|_| [300.0 + random(250.0), random(80.0)]).collect();
        let rate: Vec<[f64; 2]> = (0..N).map(|_| [random(0.2), random(0.2)]).collect();
        let heading = |i: usize| [libm::cos(angle[i]), libm::sin(angle[i])];
        let (mut links, mut joints) = (Links::default(), Joints::default());
        let (mut place, mut speed) = (vec![[0.0; 2]; N], vec![[0.0; 2]; N]);
        for i in 0..N {
            let (force, [nx, ny]) = {
                let size = libm::hypot(pull[i][0], pull[i][1]);
                (size, [pull[i][0] / size, pull[i][1] / size])
            };
            // |F| = k (|u| - c_r) + c u' . n, along u.
            let along = rate[i][0] * nx + rate[i][1] * ny;
            let stretch = clearance + (force - damping[i] * along) / stiffness;
            let relative = omega[(i + 1) % N] - omega[i];
            joints.force_x_n.push(pull[i][0]);
            joints.force_y_n.push(pull[i][1]);
            joints.friction_torque_nm.push(-(friction_arm * force + tight[i]) * relative.signum());
            if i + 1 < N {
                let (own, next) = (heading(i), heading(i + 1));
                for axis in 0..2 {
                    let n = [nx, ny][axis];
                    place[i + 1][axis] = place[i][axis] + arm[i] * own[axis] + arm[i + 1] * next[axis] - stretch * n;
                }
                let turned = |i: usize| [-omega[i] * heading(i)[1], omega[i] * heading(i)[0]];
                for axis in 0..2 {
                    speed[i + 1][axis] =
                        speed[i][axis] + arm[i] * turned(i)[axis] + arm[i + 1] * turned(i + 1)[axis] - rate[i][axis];
                }
            }
        }
        for i in 0..N {
            let (front, rear) = ([-pull[i][0], -pull[i][1]], pull[(i + N - 1) % N]);
            let cross = |f: [f64; 2]| heading(i)[0] * f[1] - heading(i)[1] * f[0];
            let friction = joints.friction_torque_nm[(i + N - 1) % N] - joints.friction_torque_nm[i];
            links.x_m.push(place[i][0]);
            links.y_m.push(place[i][1]);
            links.angle_rad.push(angle[i]);
            links.vx_m_s.push(speed[i][0]);
            links.vy_m_s.push(speed[i][1]);
            links.omega_rad_s.push(omega[i]);
            links.ax_m_s2.push((front[0] + rear[0]) / mass[i]);
            links.ay_m_s2.push((front[1] + rear[1]) / mass[i]);
            links.alpha_rad_s2.push((arm[i] * cross(front) - arm[i] * cross(rear) + friction) / inertia[i]);
        }
        frames.push(Frame { links, joints, contacts: Contacts::default(), ..Frame::default() });
    }
    let mut sums = LinkSums::new(N);
    frames.iter().for_each(|f| sums.take(f, &topology));
    let links = sums.fits();
    let mut pass = JointPass::new(&sums, &links, &topology);
    frames.iter().for_each(|f| pass.take(f, &topology));
    let joints = pass.fits();
    // Rounding, times what the unknowns amplify it.
    let near =
        |measured: f64, truth: f64, scale: f64| assert!((measured - truth).abs() < 1e-6 * scale, "{measured} {truth}");
    for i in 0..N {
        near(links[i].mass_kg.expect("known").value, mass[i], mass[i]);
        near(links[i].inertia_kg_m2.expect("known").value, inertia[i], inertia[i]);
        near(links[i].pitch_m().expect("known").value, 2.0 * arm[i], 8e-3);
        near(joints[i].friction_arm_m.expect("known").value, friction_arm, friction_arm);
        near(joints[i].tight_torque_nm.expect("known").value, tight[i], 0.2);
    }
    // The last joint would close the ring, which these links do not.
    for (joint, truth) in joints.iter().zip(damping).take(N - 1) {
        near(joint.stiffness_n_per_m.expect("known").value, stiffness, stiffness);
        near(joint.clearance_m.expect("known").value, clearance, clearance);
        near(joint.damping_n_s_per_m.expect("known").value, truth, truth);
    }
}
