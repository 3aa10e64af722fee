//! Forces on mounts against what must carry them: the momentum of the chain, tensions of spans, Newton's law of plungers and of bearings.

use pitchline::analysis::audit::Topology;
use pitchline::analysis::audit::spans::spans_of;
use pitchline::analysis::mounts::{Balance, Mount, mounts};
use pitchline::analysis::signal::Signal;
use pitchline::drive::{BUNDLED, Drive};
use pitchline::recording::frame::{BodyShift, Frame, Header};
use pitchline::recording::reader::{Entry, Flow, Reader, WHOLE, Wanted};
use std::path::Path;
use std::process::Command;

fn frames_of(path: &Path) -> (Header, Vec<Frame>) {
    let mut reader = Reader::open(path).expect("a recording");
    let header = reader.header().clone();
    let mut frames = Vec::new();
    let taken = reader.each(Wanted { frames: true, ..Wanted::default() }, WHOLE, |entry| {
        if let Entry::Frame(frame) = entry {
            frames.push(frame.clone());
        }
        Ok(Flow::On)
    });
    taken.expect("frames");
    (header, frames)
}

fn sample(name: &str) -> (Header, Vec<Frame>) {
    frames_of(&Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("recordings/samples/{name}.mcap")))
}

/// A bundled drive with more tables, recorded with these values.
fn recorded(drive: &str, more: &str, duration: &str, set: &[&str]) -> (Header, Vec<Frame>) {
    let text = BUNDLED.iter().find(|b| b.0 == drive).expect("a bundled drive").1;
    recorded_text(&format!("{text}\n{more}"), duration, set)
}

fn recorded_text(text: &str, duration: &str, set: &[&str]) -> (Header, Vec<Frame>) {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, path) = (folder.path().join("it.toml"), folder.path().join("it.mcap"));
    std::fs::write(&file, text).expect("written");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pitchline"));
    command.arg("run").arg(&file).args(["--duration", duration, "--every", "50us", "-o"]).arg(&path);
    set.iter().for_each(|s| _ = command.args(["--set", s]));
    let out = command.output().expect("it starts");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    frames_of(&path)
}

fn named(header: &Header, path: &str) -> Mount {
    let all = mounts(header).expect("a drive");
    let paths: Vec<String> = all.iter().map(|m| m.path.clone()).collect();
    all.into_iter().find(|m| m.path == path).unwrap_or_else(|| panic!("no {path} in {paths:?}"))
}

fn mean(forces: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|i| forces.iter().map(|f| f[i]).sum::<f64>() / forces.len() as f64)
}

/// The forces on all mounts but those of cams, with the inertia of links, rollers and plungers, add up to nothing: no contact is forgotten, none
/// is counted twice. Contacts alone change the momentum of links and rollers.
#[test]
fn forces_on_all_mounts_of_every_drive_add_up_to_the_inertia_of_what_moves() {
    for (name, text) in BUNDLED {
        let (header, frames) = sample(name);
        let drive = Drive::parse(name, text, &[]).expect("a bundled drive");
        // Followers give heads what they get from cams, less their own inertia.
        let of_valves = |m: &Mount| m.path.starts_with("cams.") || m.path.starts_with("head.");
        let all: Vec<Mount> = mounts(&header).expect("a drive").into_iter().filter(|m| !of_valves(m)).collect();
        let (mut balance, mut left_n): (Balance, f64) = (Balance::default(), 0.0);
        for f in &frames {
            balance.add(f, &header);
            let mut sum = all.iter().map(|m| m.force(f)).fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
            let mut moves = |mass: f64, ax: f64, ay: f64| sum = [sum[0] + mass * ax, sum[1] + mass * ay];
            for (i, link) in header.links.iter().enumerate() {
                moves(link.mass_kg, f.links.ax_m_s2[i], f.links.ay_m_s2[i]);
            }
            for (i, roller) in header.rollers.iter().enumerate() {
                moves(roller.mass_kg, f.rollers.ax_m_s2[i], f.rollers.ay_m_s2[i]);
            }
            for spec in &drive.sliders {
                let row = header.sliders.iter().position(|p| *p == format!("sliders.{}", spec.name)).expect("its row");
                let a = f.sliders.acceleration_m_s2[row];
                let (sin, cos) = spec.direction_rad.sin_cos();
                moves(spec.mass_kg, a * cos, a * sin);
            }
            // What stands on a bearing is moved by it.
            let mut ways: Vec<&BodyShift> = header.bodies.iter().flat_map(|b| &b.shifts).collect();
            ways.dedup_by_key(|way| way.slider);
            for way in ways {
                let path = &header.sliders[way.slider as usize];
                let bearing = drive.bearings.iter().find(|b| path.starts_with(&format!("{}.", b.path)));
                let a = f.sliders.acceleration_m_s2[way.slider as usize];
                let mass = bearing.unwrap_or_else(|| panic!("{path}: no bearing")).mass_kg;
                moves(mass, a * way.direction_x, a * way.direction_y);
            }
            left_n = left_n.max(sum[0].hypot(sum[1]));
        }
        let (contacts_n, largest_n) = balance.left_n();
        println!("{name}: mounts {left_n:.2e}, contacts {contacts_n:.2e} of {largest_n:.0} N");
        assert!(contacts_n < 1e-6 * largest_n, "{name}: {contacts_n:.2e} of {largest_n:.0} N");
        assert!(left_n < 1e-5 * largest_n, "{name}: {left_n:.2e} of {largest_n:.0} N");
    }
}

/// Both spans pull a sprocket with their tension less m' v^2, along their lines.
#[test]
fn the_axis_of_a_sprocket_carries_both_spans() {
    let (header, frames) = recorded("bush-20-40", "", "60ms", &["speeds.constant.driver.speed_rpm=1500"]);
    let topology = Topology::of(&header);
    let body = |name: &str| header.bodies.iter().position(|b| b.path == name).expect("a sprocket");
    let (driver, driven) = (body("sprockets.driver"), body("sprockets.driven"));
    let (a, b) = (&header.bodies[driver], &header.bodies[driven]);
    let distance = (b.x_m - a.x_m).hypot(b.y_m - a.y_m);
    let axis = [(b.x_m - a.x_m) / distance, (b.y_m - a.y_m) / distance];
    let radius = |teeth: u32| 8e-3 / (2.0 * (std::f64::consts::PI / f64::from(teeth)).sin());
    let sin = (radius(b.teeth) - radius(a.teeth)) / distance;
    let links = &header.links;
    let mass_per_m = links.iter().map(|l| l.mass_kg).sum::<f64>() / links.iter().map(|l| l.pitch_m).sum::<f64>();
    let momentum = mass_per_m * header.chain_speed_m_s * header.chain_speed_m_s;
    let settled = &frames[frames.len() / 3..];
    let mut along = [0.0; 2];
    for frame in settled {
        for ((from, to), tension) in spans_of(frame, &header, &topology) {
            assert_eq!(from + to, driver + driven);
            along[usize::from(from == driven)] += (tension - momentum) / settled.len() as f64;
        }
    }
    let cos = (1.0 - sin * sin).sqrt();
    let (sum, difference) = (along[0] + along[1], (along[0] - along[1]).abs());
    for (path, sign) in [("sprockets.driver", 1.0), ("sprockets.driven", -1.0)] {
        let mount = named(&header, path);
        let force = mean(&settled.iter().map(|f| mount.force(f)).collect::<Vec<_>>());
        let (on_line, beside) = (force[0] * axis[0] + force[1] * axis[1], force[1] * axis[0] - force[0] * axis[1]);
        println!(
            "{path}: {on_line:.2} N along, {beside:.2} N beside; spans {:.2}, {:.2}",
            sign * sum * cos,
            difference * sin
        );
        assert!((on_line / (sign * sum * cos) - 1.0).abs() < 0.01, "{path}: {on_line} {}", sum * cos);
        assert!((beside.abs() - difference * sin).abs() < 0.02 * sum, "{path}: {beside} {}", difference * sin);
    }
}

/// A plunger: what its pad gives it less what the housing gets is its mass times its acceleration, and its tip gets what the arm's pivot does not.
#[test]
fn housings_get_what_the_pad_gives_less_the_inertia_of_the_plunger() {
    let (header, frames) = sample("tensioner-20-40");
    let (plunger, pivot) = (named(&header, "sliders.plunger"), named(&header, "arms.tensioner"));
    let row = header.sliders.iter().position(|p| p == "sliders.plunger").expect("a plunger");
    let tip = header.touches.iter().position(|p| p == "sliders.plunger.tip").expect("a tip");
    let rail = header.bodies.iter().position(|b| b.path.starts_with("guides.rail.") && b.coordinate.is_some());
    let rail = rail.expect("a rail on the arm") as u32;
    let (sin, cos) = 105_f64.to_radians().sin_cos();
    let mut largest: f64 = 0.0;
    for f in &frames {
        let t = &f.touches;
        let (n, s) = (t.normal_force_n[tip], t.tangential_force_n[tip]);
        let on_tip = [n * t.normal_x[tip] - s * t.normal_y[tip], n * t.normal_y[tip] + s * t.normal_x[tip]];
        let inertia = 0.02 * f.sliders.acceleration_m_s2[row];
        let wanted = [on_tip[0] - inertia * cos, on_tip[1] - inertia * sin];
        let got = plunger.force(f);
        largest = largest.max(n);
        for i in 0..2 {
            assert!((wanted[i] - got[i]).abs() < 1e-6 * n.max(1.0), "{wanted:?} {got:?}");
        }
        let c = &f.contacts;
        let own = (0..c.body.len()).filter(|k| c.body[*k] == rail);
        let chain = own.fold([0.0; 2], |[x, y], k| {
            let (n, s) = (c.normal_force_n[k], c.tangential_force_n[k]);
            [x - n * c.normal_x[k] + s * c.normal_y[k], y - n * c.normal_y[k] - s * c.normal_x[k]]
        });
        let on_pivot = pivot.force(f);
        for i in 0..2 {
            assert!(
                (chain[i] - on_tip[i] - on_pivot[i]).abs() < 1e-6 * n.max(1.0),
                "{chain:?} {on_tip:?} {on_pivot:?}"
            );
        }
    }
    assert!(largest > 10.0, "the tip pushes with {largest} N at most");
}

/// A bearing hands on what the chain gives less the inertia of what it carries; over time both are the same.
#[test]
fn bearings_hand_on_what_the_chain_gives_less_inertia() {
    let more = "[bearings.elastic.driven]\nmass_kg = 0.5\nstiffness_n_per_m = 2e7\ndamping_n_s_per_m = 400\n";
    let (header, frames) = recorded("bush-20-40", more, "20ms", &[]);
    let mount = named(&header, "sprockets.driven");
    let body = header.bodies.iter().position(|b| b.path == "sprockets.driven").expect("a sprocket");
    let shifts = &header.bodies[body].shifts;
    assert_eq!(shifts.len(), 2);
    let (mut largest, mut differs): (f64, f64) = (0.0, 0.0);
    for f in &frames {
        let c = &f.contacts;
        let mut chain = [0.0; 2];
        for k in (0..c.body.len()).filter(|k| c.body[*k] as usize == body) {
            let (n, s) = (c.normal_force_n[k], c.tangential_force_n[k]);
            chain[0] -= n * c.normal_x[k] - s * c.normal_y[k];
            chain[1] -= n * c.normal_y[k] + s * c.normal_x[k];
        }
        let inertia = shifts.iter().fold([0.0; 2], |[x, y], way| {
            let a = 0.5 * f.sliders.acceleration_m_s2[way.slider as usize];
            [x + a * way.direction_x, y + a * way.direction_y]
        });
        let got = mount.force(f);
        for i in 0..2 {
            largest = largest.max(chain[i].abs());
            differs = differs.max((got[i] - chain[i]).abs());
            assert!(
                (got[i] - chain[i] + inertia[i]).abs() < 1e-6 * chain[i].abs().max(100.0),
                "{got:?} {chain:?} {inertia:?}"
            );
        }
    }
    assert!(differs > 0.01 * largest, "inertia shows: {differs} of {largest} N");
}

/// Chains without links pull as chains with links do, but for m' v^2.
#[test]
fn spans_pull_their_sprockets_as_links_do() {
    let slow = ["speeds.constant.driver.speed_rpm=200"];
    let set = [slow[0], "chains.first.fidelity=spans"];
    let [links, spans] = [&slow[..], &set[..]].map(|set| recorded("reduction-20-40-20-40", "", "60ms", set));
    for path in ["sprockets.driver", "sprockets.driven"] {
        let [of_links, of_spans] = [&links, &spans].map(|(header, frames)| {
            let mount = named(header, path);
            mean(&frames[frames.len() / 2..].iter().map(|f| mount.force(f)).collect::<Vec<_>>())
        });
        let off = (of_links[0] - of_spans[0]).hypot(of_links[1] - of_spans[1]);
        println!("{path}: {of_links:.1?} {of_spans:.1?}");
        assert!(off < 0.03 * of_links[0].hypot(of_links[1]), "{path}: {of_links:?} {of_spans:?}");
    }
    assert!(named(&spans.0, "sprockets.driver").notes[0].contains("m' v^2"));
}

/// A guide that gives way along its normal hands on friction across it; two sprockets of one shaft share its bearing, in one row.
#[test]
fn a_single_way_leaves_friction_and_a_shared_bearing_is_one_mount() {
    let more = "[effects.guide_compliance.tight]\ncompliance_um_per_kn = 0.01\n";
    let [rigid, gives] = ["", more].map(|more| recorded("bmw318", more, "4ms", &[]));
    let [a, b] = [&rigid, &gives].map(|(header, frames)| {
        let mount = named(header, "guides.rail.tight");
        mean(&frames[frames.len() / 2..].iter().map(|f| mount.force(f)).collect::<Vec<_>>())
    });
    println!("{a:.3?} {b:.3?}");
    let off = (a[0] - b[0]).hypot(a[1] - b[1]);
    assert!(off < 0.05 * a[0].hypot(a[1]), "{a:?} {b:?}");
    let slope = |f: [f64; 2]| (f[1] / f[0]).atan();
    assert!((slope(a) - slope(b)).abs() < 0.03, "friction turns both alike: {a:?} {b:?}");

    let more = "[bearings.elastic.middle]\nmass_kg = 1.0\nstiffness_n_per_m = 5e7\ndamping_n_s_per_m = 400\n";
    let (header, _) = recorded("reduction-20-40-20-40", more, "2ms", &[]);
    let paths: Vec<String> = mounts(&header).expect("a drive").into_iter().map(|m| m.path).collect();
    assert!(paths.iter().any(|p| p == "bearings.elastic.middle"), "{paths:?}");
    assert!(!paths.iter().any(|p| p == "sprockets.driven" || p == "sprockets.pinion"), "{paths:?}");
}

/// Cams press on their shaft against the way of their valves, and beside it where the follower is a roller: what they take of the shaft's power is what they give their followers.
#[test]
fn cams_press_on_their_shafts_and_take_its_power() {
    let text = BUNDLED.iter().find(|b| b.0 == "gasoline-3cyl-bush").expect("a bundled drive").1;
    let text = text.replace("[valves.intake]\n", "[valves.intake]\nroller_radius_mm = 9\n");
    let (header, frames) = recorded_text(&text, "12ms", &["contact.cam.friction=0"]);
    let cams = named(&header, "cams.sprockets.intake");
    let own: Vec<_> = header.bodies.iter().filter(|b| b.path.starts_with("cams.intake")).collect();
    let shaft = own[0].coordinate.expect("a shaft") as usize;
    let (mut across, mut most, mut off): (f64, f64, f64) = (0.0, 0.0, 0.0);
    for f in &frames {
        let (mut given_w, mut single) = (0.0, None);
        for cam in &own {
            let valve = cam.path.replacen("cams.", "valves.", 1);
            let touch = header.touches.iter().position(|p| *p == format!("{valve}.cam")).expect("its touch");
            let row = header.sliders.iter().position(|p| *p == valve).expect("its valve");
            let t = &f.touches;
            let n = t.normal_force_n[touch];
            if n > 1.0 {
                given_w += n * f.sliders.speed_m_s[row];
                let at = [t.x_m[touch] - cam.x_m, t.y_m[touch] - cam.y_m];
                single = if single.is_none() {
                    Some((at, [t.normal_x[touch], t.normal_y[touch]]))
                } else {
                    Some(([f64::NAN; 2], [0.0; 2]))
                };
            }
        }
        // One cam alone: its torque is that of the force on the mount about the axis.
        let Some((at, lift)) = single.filter(|(at, _)| at[0].is_finite()) else { continue };
        let [x, y] = cams.force(f);
        assert!(x * lift[0] + y * lift[1] < 0.0, "cams push back");
        let taken_w = -(at[0] * y - at[1] * x) * f.rotors.speed_rad_s[shaft];
        across = across.max((x * lift[1] - y * lift[0]).abs() / x.hypot(y));
        most = most.max(given_w.abs());
        off = off.max((taken_w - given_w).abs());
    }
    println!("largest share across {across:.3}, power {most:.1} W, off by {off:.2} W");
    assert!(across > 0.1 && most > 10.0 && off < 0.03 * most, "{across} {most} {off}");
}

/// The head gets what the springs push their far ends with, less what the seats are pressed by.
#[test]
fn heads_carry_springs_and_seats() {
    let text = BUNDLED.iter().find(|b| b.0 == "gasoline-3cyl-bush").expect("a bundled drive").1;
    let set = [
        "contact.cam.friction=0",
        "valves.intake.spring_mass_g=40",
        "valves.intake.spring_parts=6",
        "valves.intake.spring_damping_percent=5",
    ];
    let (header, frames) = recorded_text(text, "40ms", &set);
    let drive = Drive::parse("it", text, &set.map(str::to_string)).expect("the same drive");
    let spec = drive.valves.iter().find(|v| v.name == "intake").expect("its valves");
    let head = named(&header, "head.intake");
    let (sin, cos) = spec.direction_rad.sin_cos();
    let row = |path: String| header.sliders.iter().position(|p| *p == path).expect("a slider");
    let (mut worst, mut most): (f64, f64) = (0.0, 0.0);
    for f in &frames {
        // Of six parts, with the damping that `spring_damping_percent` gives the first surge mode.
        let (k, m) = (6.0 * spec.spring_n_per_m, spec.spring_mass_kg / 6.0);
        let damping = 2.0 * 0.05 * k / (2.0 * (k / m).sqrt() * (0.5 * std::f64::consts::PI / 6.0).sin());
        let mut known = 0.0;
        for number in 0..spec.phases_rad.len() {
            let path = spec.path(number);
            let seat = header.touches.iter().position(|p| *p == format!("{path}.seat")).expect("its seat");
            let far_speed = f.sliders.speed_m_s[row(format!("{path}.spring.1"))];
            let far = f.sliders.position_m[row(format!("{path}.spring.1"))];
            known +=
                spec.spring_n + 6.0 * spec.spring_n_per_m * far + damping * far_speed - f.touches.normal_force_n[seat];
        }
        let [x, y] = head.force(f);
        worst = worst.max((x * cos + y * sin - known).abs()).max((x * sin - y * cos).abs());
        most = most.max(known.abs());
    }
    println!("head up to {most:.0} N, off by {worst:.1e} N");
    assert!(most > 100.0 && worst < 1e-6 * most, "{worst} of {most}");
}

/// Forces on mounts are signals too, and a wrong name is told.
#[test]
fn forces_on_mounts_are_signals() {
    let (header, frames) = sample("gasoline-3cyl-bush");
    let all = mounts(&header).expect("a drive");
    let cams = all.iter().find(|m| m.path.starts_with("cams.")).expect("cams");
    assert!(frames.iter().any(|f| cams.force(f)[0].hypot(cams.force(f)[1]) > 10.0));
    let find = |axis: &str| Signal::find(&format!("mount.{}.{axis}", cams.path), &header).expect("a signal");
    let (x, y, size) = (find("x"), find("y"), find("force"));
    let of_sprocket = Signal::find("mount.intake.x", &header).expect("the sprocket goes before the cams of its shaft");
    assert_eq!(of_sprocket.value(&frames[0], &header), Some(named(&header, "sprockets.intake").force(&frames[0])[0]));
    for f in &frames {
        let of = |signal: &Signal| signal.value(f, &header).expect("a value");
        assert_eq!([of(&x), of(&y)], cams.force(f));
        assert!((of(&x).hypot(of(&y)) - of(&size)).abs() < 1e-9);
    }
    let why = Signal::find("mount.nobody.x", &header).expect_err("no such mount").to_string();
    assert!(why.contains("`mount.nobody.x` names no force on a mount") && why.contains("sprockets."), "{why}");
}
