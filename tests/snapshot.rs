//! Drawings of recordings: contours at their recorded poses, arrows to scale, valid pictures.

use pitchline::recording::frame::{Frame, Header, Outline, OutlineElement};
use pitchline::recording::mcap::{Recording, read};
use pitchline::render::snapshot::contours::{Pose, body_pose, link_pose, path_data};
use pitchline::render::snapshot::{SnapshotOptions, ViewCentre, draw};
use std::f64::consts::PI;
use std::path::PathBuf;
use std::process::{Command, Output};

const CHAINS: [&str; 3] = ["bush", "silent", "smartchain"];
const DRIVE: SnapshotOptions<'static> =
    SnapshotOptions { around: ViewCentre::Drive, width_mm: None, joints: false, impacts: &[] };

fn sample(chain: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("recordings/samples/{chain}-20-40.mcap"))
}

fn recorded(chain: &str) -> Recording {
    read(&sample(chain)).expect("a sample")
}

fn pitchline(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pitchline")).args(args).output().expect("the program starts")
}

fn stderr(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

/// Values of an attribute of all tags that contain `mark`, in order.
fn attributes<'a>(svg: &'a str, mark: &str, name: &str) -> Vec<&'a str> {
    let key = format!(" {name}=\"");
    svg.split('<')
        .filter(|tag| tag.contains(mark))
        .filter_map(|tag| tag.split_once(&key).and_then(|(_, rest)| rest.split_once('"')).map(|(value, _)| value))
        .collect()
}

fn numbers(text: &str) -> Vec<f64> {
    text.split(|c: char| !(c.is_ascii_digit() || "+-.e".contains(c))).filter_map(|n| n.parse().ok()).collect()
}

/// (letter, numbers) of path data.
fn commands(data: &str) -> Vec<(char, Vec<f64>)> {
    let letters: Vec<usize> = data.char_indices().filter(|(_, c)| "MLAZ".contains(*c)).map(|(i, _)| i).collect();
    let end = |k: usize| letters.get(k + 1).copied().unwrap_or(data.len());
    let each = |(k, i): (usize, &usize)| (data[*i..].chars().next().expect("a letter"), numbers(&data[i + 1..end(k)]));
    letters.iter().enumerate().map(each).collect()
}

/// Tail and tip of an arrow from its outline.
fn arrow(data: &str) -> [[f64; 2]; 2] {
    let n = numbers(data);
    assert_eq!(n.len(), 14, "{data}");
    [[0.5 * (n[0] + n[12]), 0.5 * (n[1] + n[13])], [n[6], n[7]]]
}

/// Rotated and shifted independently, with the C library's trigonometry [mm].
fn placed(pose: Pose, x: f64, y: f64) -> [f64; 2] {
    let (s, c) = pose.angle_rad.sin_cos();
    [1e3 * (pose.x_m + c * x - s * y), 1e3 * (pose.y_m + s * x + c * y)]
}

/// Largest difference of ends and radii between the drawing's path and the outline's elements [mm].
fn error_mm(data: &str, outline: &Outline, pose: Pose) -> f64 {
    let commands = commands(data);
    let drawn: Vec<_> = commands.iter().filter(|(c, _)| "LA".contains(*c)).collect();
    assert_eq!(drawn.len(), outline.elements.len(), "one command an element");
    let mut worst = 0.0_f64;
    for ((letter, n), e) in drawn.into_iter().zip(&outline.elements) {
        let [x, y] = placed(pose, e.end_x_m, e.end_y_m);
        worst = worst.max((n[n.len() - 2] - x).abs()).max((n[n.len() - 1] - y).abs());
        assert_eq!(*letter == 'A', e.radius_m > 0.0 && e.sweep_rad != 0.0, "arcs are arcs");
        if *letter == 'A' {
            worst = worst.max((n[0] - 1e3 * e.radius_m).abs());
            assert_eq!(n[3] == 1.0, e.sweep_rad.abs() > PI);
            assert_eq!(n[4] == 1.0, e.sweep_rad > 0.0);
        }
    }
    worst
}

#[test]
fn contours_stand_where_the_recording_says() {
    for chain in CHAINS {
        let recording = recorded(chain);
        let (header, frame): (&Header, &Frame) = (&recording.header, &recording.frames[20]);
        let drawing = draw(header, &[frame], DRIVE);
        let (_, contours) = drawing.svg.split_once("class=\"contours\"").expect("contours");
        let (contours, _) = contours.split_once("</g>").expect("an end");
        let mut paths = attributes(contours, "path d", "d").into_iter();
        let mut worst = 0.0_f64;
        for (k, body) in header.bodies.iter().enumerate() {
            let turned = if body.rotor { frame.rotors.angle_rad[k] } else { 0.0 };
            let pose = Pose { x_m: body.x_m, y_m: body.y_m, angle_rad: body.angle_rad + turned };
            assert_eq!(pose, body_pose(header, frame, k));
            let outline = body.outline.as_ref().expect("an outline");
            worst = worst.max(error_mm(paths.next().expect("a path"), outline, pose));
        }
        for row in (0..header.link_outlines.len()).rev() {
            for i in (0..header.links.len()).filter(|i| header.links[*i].outline as usize == row) {
                let data = paths.next().expect("a path");
                worst = worst.max(error_mm(data, &header.link_outlines[row], link_pose(frame, i)));
            }
        }
        assert_eq!(paths.next(), None, "nothing else is drawn");
        println!("{chain}: {worst:.1e} mm");
        // Measured 5e-8: half of the last written digit.
        assert!(worst < 1e-6, "{chain}: {worst} mm");
    }
}

#[test]
fn contours_go_through_the_map_to_the_page_with_y_up() {
    let recording = recorded("bush");
    let drawing = draw(&recording.header, &[&recording.frames[3]], DRIVE);
    let map = numbers(attributes(&drawing.svg, "class=\"contours\"", "transform")[0]);
    assert!((map[0] - drawing.units_per_mm).abs() < 1e-9 && map[3] == -map[0] && map[1] == 0.0 && map[2] == 0.0);
    // The drawn contact points are on the page where their contours are.
    let contacts = &recording.frames[3].contacts;
    let dots: Vec<&str> = drawing.svg.lines().filter(|l| l.starts_with("<circle") && l.contains("#dc263c")).collect();
    assert_eq!(dots.len(), contacts.link.len());
    for (i, dot) in dots.iter().enumerate() {
        let [x, y] = ["cx", "cy"].map(|name| numbers(attributes(dot, "circle", name)[0])[0]);
        let (px, py) = (contacts.point_body_x_m[i] * 1e3, contacts.point_body_y_m[i] * 1e3);
        assert!((x - (map[0] * px + map[4])).abs() < 0.006 && (y - (map[3] * py + map[5])).abs() < 0.006, "{dot}");
    }
}

/// An arc around (1, 2) mm with radius 3 mm.
fn arc(start_rad: f64, sweep_rad: f64) -> OutlineElement {
    let at = |a: f64| (1e-3 + 3e-3 * a.cos(), 2e-3 + 3e-3 * a.sin());
    let ((start_x_m, start_y_m), (end_x_m, end_y_m)) = (at(start_rad), at(start_rad + sweep_rad));
    OutlineElement {
        start_x_m,
        start_y_m,
        end_x_m,
        end_y_m,
        centre_x_m: 1e-3,
        centre_y_m: 2e-3,
        radius_m: 3e-3,
        sweep_rad,
    }
}

/// Centre of an SVG arc, as the standard computes it (F.6.5), for equal radii.
fn svg_centre(from: [f64; 2], n: &[f64]) -> [f64; 2] {
    let (r, large, positive, to) = (n[0], n[3] == 1.0, n[4] == 1.0, [n[5], n[6]]);
    let (dx, dy) = (0.5 * (to[0] - from[0]), 0.5 * (to[1] - from[1]));
    let half = dx.hypot(dy);
    let height = (r * r - half * half).max(0.0).sqrt() * if large == positive { 1.0 } else { -1.0 };
    [0.5 * (from[0] + to[0]) + height * dy / half, 0.5 * (from[1] + to[1]) - height * dx / half]
}

#[test]
fn long_arcs_and_full_circles_keep_their_centre() {
    /// User units per metre: of a whole drive, and of a view 0.05 mm wide.
    const SCALES: [f64; 2] = [3e3, 2e7];
    let angles = [30.0, 179.0, 181.0, 270.0, 314.0, 316.0, 350.0, 360.0, -90.0, -200.0, -340.0, -360.0_f64];
    for (degrees, scale) in angles.into_iter().flat_map(|a| SCALES.map(|s| (a, s))) {
        let element = arc(0.7, degrees.to_radians());
        let outline = Outline { elements: vec![element], ..Outline::default() };
        let pose = Pose { x_m: 5e-3, y_m: -4e-3, angle_rad: 1.1 };
        let expected = placed(pose, 1e-3, 2e-3);
        let mut from = [0.0; 2];
        let (mut drawn, mut worst) = (0, 0.0_f64);
        for (letter, n) in commands(&path_data(&outline, pose, scale)) {
            let to = [n[n.len() - 2], n[n.len() - 1]];
            if letter == 'A' {
                drawn += 1;
                assert!((to[0] - from[0]).hypot(to[1] - from[1]) > 0.1, "{degrees}: an arc that viewers leave out");
                assert_eq!(n[4] == 1.0, degrees > 0.0);
                let centre = svg_centre(from, &n);
                worst = worst.max((centre[0] - expected[0]).hypot(centre[1] - expected[1]));
            }
            from = to;
        }
        println!("{degrees} degrees, {drawn} pieces: centre {worst:.1e} mm off");
        // Measured 2.6e-6 at 181 degrees, where the last digit of the ends counts most; 2e-6 elsewhere.
        assert!(worst < 3e-5, "{degrees}: centre {worst:.1e} mm off");
        let end = placed(pose, element.end_x_m, element.end_y_m);
        assert!((from[0] - end[0]).abs() < 1e-6 && (from[1] - end[1]).abs() < 1e-6);
        if scale == SCALES[0] {
            assert_eq!(drawn, if degrees.abs() > 315.0 { 2 } else { 1 });
        } else {
            // A sixth root, because the error of a cubic decreases with the sixth power of the sweep: 30.6 degrees.
            let longest = 90.0 * (0.025_f64 / (2.7e-4 * 3.0 * 2e4)).powf(1.0 / 6.0);
            assert_eq!(drawn, (degrees.abs() / longest).ceil() as usize, "{degrees}");
        }
    }
}

/// Distance between the tooth's line and the bush's, across the panel through the contact point, in a PNG.
#[test]
fn penetration_is_drawn_as_deep_as_it_is() {
    let recording = recorded("bush");
    let (header, frame) = (&recording.header, &recording.frames[21]);
    let drawing = draw(
        header,
        &[frame],
        SnapshotOptions { around: ViewCentre::Body(0), width_mm: Some(0.05), joints: false, impacts: &[] },
    );
    let bytes = pitchline::render::png::encode(&drawing.svg, 2.0).expect("encoded");
    let pixmap = resvg::tiny_skia::Pixmap::decode_png(&bytes).expect("decodes");
    // The deepest contact of the driver is at the centre of the panel.
    let c = &frame.contacts;
    let i = (0..c.body.len())
        .filter(|i| c.body[*i] == 0)
        .max_by(|a, b| c.normal_force_n[*a].total_cmp(&c.normal_force_n[*b]))
        .expect("a contact");
    let clip = drawing.svg.lines().find(|l| l.starts_with("<clipPath")).expect("a panel");
    let [x, y, w, h] = ["x", "y", "width", "height"].map(|name| numbers(attributes(clip, "rect", name)[0])[0]);
    let (middle, per_mm) = ([2.0 * x + w, 2.0 * y + h], 2.0 * drawing.units_per_mm);
    // Into the body along the normal, beside the arrow; the page's y points down.
    let (n, t) = ([c.normal_x[i], -c.normal_y[i]], [c.normal_y[i], c.normal_x[i]]);
    let at = |depth: f64| {
        let aside = 100.0;
        let p = [0, 1].map(|k| (middle[k] - depth * n[k] + aside * t[k]) as u32);
        pixmap.pixel(p[0], p[1]).expect("inside")
    };
    let line = |is: &dyn Fn(resvg::tiny_skia::PremultipliedColorU8) -> bool| {
        let hits: Vec<f64> = (-100..300).map(|d| f64::from(d) * 0.5).filter(|d| is(at(*d))).collect();
        assert!(!hits.is_empty(), "a line is there");
        hits.iter().sum::<f64>() / hits.len() as f64
    };
    let ink = line(&|p| p.red() < 80 && p.blue() < 90);
    let blue = line(&|p| p.red() < 120 && p.blue() > 170);
    let drawn_um = (blue - ink) / per_mm * 1e3;
    println!("penetration {:.3} um, drawn {drawn_um:.3} um", c.penetration_m[i] * 1e6);
    // Measured error 0.007 um; 0.2 um with arcs of a quarter turn. Near the contact point the bush's circle still
    // coincides with the tooth's.
    assert!((drawn_um - c.penetration_m[i] * 1e6).abs() < 0.06, "2.3 pixels");
}

#[test]
fn arrows_have_the_length_and_direction_of_their_forces() {
    for chain in CHAINS {
        let recording = recorded(chain);
        let (header, frame) = (&recording.header, &recording.frames[20]);
        let drawing = draw(header, &[frame], SnapshotOptions { joints: true, ..DRIVE });
        let per_n = drawing.contact_units_per_n.expect("contacts");
        let c = &frame.contacts;
        let force = |i: usize| {
            let (n, t) = (c.normal_force_n[i], c.tangential_force_n[i]);
            [n * c.normal_x[i] - t * c.normal_y[i], n * c.normal_y[i] + t * c.normal_x[i]]
        };
        // Arrows below half a unit are drawn as dots.
        let long: Vec<_> = (0..c.link.len()).map(force).filter(|f| f[0].hypot(f[1]) * per_n >= 0.5).collect();
        let drawn = attributes(&drawing.svg, "class=\"contact\"", "d");
        assert!(!drawn.is_empty() && drawn.len() == long.len(), "{} of {}", drawn.len(), long.len());
        for (data, [fx, fy]) in drawn.iter().zip(long) {
            let [tail, tip] = arrow(data);
            assert!((tip[0] - tail[0] - fx * per_n).abs() < 2e-3, "{chain}: {data}");
            assert!((tip[1] - tail[1] + fy * per_n).abs() < 2e-3, "{chain}: {data}");
        }
        // The legend's arrow has the length of its force.
        for (class, per_n, word) in [
            ("class=\"legend\"", per_n, "N, contact force"),
            ("class=\"legend-joint\"", drawing.joint_units_per_n.expect("joints"), "N, joint force"),
        ] {
            let [tail, tip] = arrow(attributes(&drawing.svg, class, "d")[0]);
            let text = drawing.svg.lines().find(|l| l.contains(word)).expect("a legend");
            let named_n = numbers(text.split_once(">").expect("a text").1)[0];
            assert!((tip[0] - tail[0] - named_n * per_n).abs() < 2e-3, "{chain}: {named_n} N");
        }
    }
}

#[test]
fn tension_pulls_the_link_ahead_back() {
    let recording = recorded("bush");
    let (header, frame) = (&recording.header, &recording.frames[20]);
    let drawing = draw(header, &[frame], SnapshotOptions { around: ViewCentre::Link(35), joints: true, ..DRIVE });
    let arrows = attributes(&drawing.svg, "class=\"joint\"", "d");
    assert!((5..=10).contains(&arrows.len()), "{}", arrows.len());
    for data in arrows {
        let [tail, tip] = arrow(data);
        // The tight span runs to the left, so that it pulls to the right; both in the direction of link 35 within 10
        // degrees.
        let heading = frame.links.angle_rad[35];
        let along = (tip[0] - tail[0]) * heading.cos() - (tip[1] - tail[1]) * heading.sin();
        assert!(along < -0.98 * (tip[0] - tail[0]).hypot(tip[1] - tail[1]), "{data}");
    }
}

#[test]
fn film_strips_have_a_panel_an_instant_with_one_scale() {
    let recording = recorded("silent");
    let frames: Vec<&Frame> = recording.frames[8..14].iter().collect();
    for (count, rows) in [(1, 1), (2, 1), (4, 1), (5, 2), (6, 2)] {
        let around = SnapshotOptions { around: ViewCentre::Link(50), ..DRIVE };
        let drawing = draw(&recording.header, &frames[..count], around);
        assert_eq!(drawing.svg.matches("class=\"panel\"").count(), count);
        assert_eq!(drawing.svg.matches("t = ").count(), count);
        let clips: Vec<&str> = drawing.svg.lines().filter(|l| l.starts_with("<clipPath")).collect();
        let mut tops: Vec<&str> = clips.iter().map(|l| attributes(l, "rect", "y")[0]).collect();
        tops.dedup();
        assert_eq!(tops.len(), rows);
        for frame in &frames[..count] {
            assert!(drawing.svg.contains(&format!("t = {:.4} ms", frame.t_s * 1e3)));
        }
        let maps = attributes(&drawing.svg, "class=\"contours\"", "transform");
        assert!(maps.iter().all(|m| numbers(m)[0] == numbers(maps[0])[0]), "one scale");
        // The view follows the link, which is at the centre of every panel.
        for ((map, clip), frame) in maps.iter().zip(clips).zip(&frames) {
            let map = numbers(map);
            let [x, y, w, h] = ["x", "y", "width", "height"].map(|name| numbers(attributes(clip, "rect", name)[0])[0]);
            let at = [map[0] * frame.links.x_m[50] * 1e3 + map[4], map[3] * frame.links.y_m[50] * 1e3 + map[5]];
            assert!((at[0] - x - 0.5 * w).abs() < 0.02 && (at[1] - y - 0.5 * h).abs() < 0.02);
        }
    }
}

#[test]
fn the_verb_draws_svg_and_png_and_says_what() {
    let folder = tempfile::tempdir().expect("a folder");
    let recording = sample("smartchain");
    let recording = recording.to_str().expect("text");
    let (svg, png) = (folder.path().join("a.svg"), folder.path().join("a.png"));
    let draw = |path: &PathBuf, args: &[&str]| {
        let args = [&["snapshot", recording, "-o", path.to_str().expect("text"), "--json"], args].concat();
        let out = pitchline(&args);
        assert!(out.status.success(), "{}", stderr(&out));
        let json: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
        (json, stderr(&out))
    };
    let (json, said) = draw(&svg, &["--at", "1ms", "--around", "driver"]);
    assert_eq!(json["frames"].as_array().map(Vec::len), Some(1));
    for key in ["step", "t_s", "contacts", "crank_angle_deg"] {
        assert!(json["frames"][0][key].is_number(), "{key}");
    }
    assert!(json["force_scale_n_per_mm"].as_f64() > Some(0.0) && json["joint_force_scale_n_per_mm"].is_null());
    assert_eq!(said, "", "there is a frame at 1 ms");
    let text = std::fs::read_to_string(&svg).expect("drawn");
    let shown_ms = json["frames"][0]["t_s"].as_f64().map(|t| 1e3 * t).expect("a time");
    assert!((shown_ms - 1.0).abs() < 0.05, "the frame nearest to 1 ms");
    assert!(text.contains("around sprockets.driver") && text.contains("20 teeth"));
    assert!(text.contains(&format!("t = {shown_ms:.4} ms")));
    let (json, _) = draw(&png, &["--at", "0.8ms..1.3ms/6", "--around", "link:50", "--joints"]);
    assert_eq!(json["frames"].as_array().map(Vec::len), Some(6));
    let bytes = std::fs::read(&png).expect("drawn");
    // Signature, then IHDR: length, name, width, height, 8 bits, colours with opacity.
    assert_eq!(&bytes[..16], b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR");
    let size = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
    assert_eq!(json["width_px"].as_f64(), Some(f64::from(size(16))));
    assert_eq!(json["height_px"].as_f64(), Some(f64::from(size(20))));
    assert_eq!(&bytes[24..26], b"\x08\x06");
    let (json, said) = draw(&svg, &["--at", "1ms..1.1ms/6"]);
    assert_eq!(json["frames"].as_array().map(Vec::len), Some(2));
    assert!(said.contains("6 instants") && said.contains("2 frames"), "{said}");
}

#[test]
fn png_shows_text_and_contours() {
    let recording = recorded("bush");
    let drawing = draw(&recording.header, &[&recording.frames[20]], DRIVE);
    let bytes = pitchline::render::png::encode(&drawing.svg, 1.0).expect("encoded");
    let pixmap = resvg::tiny_skia::Pixmap::decode_png(&bytes).expect("decodes");
    assert_eq!((pixmap.width(), pixmap.height()), (drawing.width.ceil() as u32, drawing.height.ceil() as u32));
    let dark = |rows: std::ops::Range<u32>| {
        let pixel = |x: u32, y: u32| pixmap.pixel(x, y).expect("inside");
        rows.flat_map(|y| (0..pixmap.width()).map(move |x| (x, y)))
            .filter(|(x, y)| pixel(*x, *y).red() < 128 && pixel(*x, *y).alpha() == 255)
            .count()
    };
    let (title, panel) = (dark(0..30), dark(40..pixmap.height() - 60));
    println!("{title} dark pixels in the title, {panel} in the panel");
    // Measured 473 and 3370; without a font the title has none.
    assert!(title > 200, "the title's letters: {title} pixels");
    assert!(panel > 1500, "contours: {panel} pixels");
}

/// An animated PNG by the standard's own control chunks: pictures of one size, as long each as asked for, that differ, and the first as it is drawn
/// alone on its page.
#[test]
fn animations_have_a_picture_an_instant() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("film.png");
    let (recording, out) = (sample("bush"), path.to_str().expect("text"));
    let recording = recording.to_str().expect("text");
    let args = ["snapshot", recording, "--at", "1ms..3ms/5", "--around", "driver", "--animate", "10", "-o", out];
    let done = pitchline(&args);
    assert!(done.status.success(), "{}", stderr(&done));
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&path).expect("written")));
    let mut reader = decoder.read_info().expect("a PNG");
    let control = *reader.info().animation_control().expect("animated");
    assert_eq!((control.num_frames, control.num_plays), (5, 0));
    let mut pictures: Vec<Vec<u8>> = Vec::new();
    for _ in 0..5 {
        let mut picture = vec![0; reader.output_buffer_size().expect("a size")];
        reader.next_frame(&mut picture).expect("a picture");
        let frame = reader.info().frame_control().expect("a frame");
        assert_eq!((frame.delay_num, frame.delay_den), (1, 10));
        assert!(pictures.iter().all(|p| *p != picture), "nothing moved");
        pictures.push(picture);
    }
    assert!(reader.next_frame(&mut vec![0; pictures[0].len()]).is_err(), "a sixth");
}

#[test]
fn mistakes_are_refused_with_the_way_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let copy = folder.path().join("copy.svg");
    std::fs::copy(sample("bush"), &copy).expect("copied");
    let (copy, folder_path) = (copy.to_str().expect("text"), folder.path().to_str().expect("text"));
    let recording = sample("bush");
    let recording = recording.to_str().expect("text");
    let svg = folder.path().join("x.svg");
    let svg = svg.to_str().expect("text");
    let refused = |args: &[&str], says: &str| {
        let out = pitchline(&[&["snapshot"], args].concat());
        assert_eq!(out.status.code(), Some(2), "{args:?}: {}", stderr(&out));
        assert!(stderr(&out).contains(says), "{args:?}: {}", stderr(&out));
        assert!(!std::path::Path::new(svg).exists());
    };
    let at = |t: &'static str| [recording, "-o", svg, "--at", t];
    refused(&[&at("1ms")[..], &["--around", "drivr"]].concat(), "did you mean `driver`?");
    refused(&[&at("1ms")[..], &["--around", "sprocket.driven"]].concat(), "did you mean `sprockets.driven`?");
    refused(&[&at("1ms")[..], &["--around", "xyzzy"]].concat(), "sprockets.driver, sprockets.driven");
    refused(&[&at("1ms")[..], &["--around", "link:90"]].concat(), "the links are 0 to 89");
    refused(&[&at("1ms")[..], &["--width-mm", "0"]].concat(), "millimetres");
    refused(&at("5ms"), "from 0.0000 to 4.0000 ms");
    refused(&at("1ms..5ms/3"), "5.0000 ms was not recorded");
    refused(&at("frame:43"), "0 to 41");
    refused(&at("12"), "with its unit");
    refused(&at("1ms..2ms"), "number of its pictures");
    refused(&at("2ms..1ms/3"), "later");
    refused(&at("1ms..2ms/1"), "2 to 2000");
    refused(&at("1ms..2ms/25"), "at most 24 pictures");
    refused(&[&at("1ms..2ms/25")[..], &["--animate"]].concat(), "end in .png");
    refused(&[recording, "--at", "1ms", "-o", "x.png", "--animate"], "several pictures");
    refused(&[recording, "--at", "1ms", "-o", folder_path], "directory");
    refused(&[recording, "--at", "1ms", "-o", "x.pdf"], ".svg or .png");
    refused(&[copy, "--at", "1ms", "-o", copy], "not overwritten");
    refused(&["none.mcap", "--at", "1ms", "-o", svg], "none.mcap");
    assert_eq!(std::fs::read(copy).expect("there"), std::fs::read(recording).expect("there"));
}
