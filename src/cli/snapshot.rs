//! `pitchline snapshot`: frames of a recording as a drawing.

use super::{Answer, Failure, Outcome, answer};
use crate::recording::frame::{Frame, Header};
use crate::recording::reader::Reader;
use crate::render::png;
use crate::render::snapshot::{Drawing, SnapshotOptions, ViewCentre, draw, draw_pages};
use crate::replay::Replay;
use std::path::{Path, PathBuf};

#[derive(clap::Args, Debug)]
pub struct SnapshotArgs {
    /// Recording to draw from, .mcap
    recording: PathBuf,
    /// The instant: 12.3ms, frame:250, or a film strip such as 12.30ms..12.40ms/6 (up to 24 pictures, 2000 with --animate)
    #[arg(long, value_name = "T", value_parser = instant)]
    at: At,
    /// Draw the pictures of the strip after each other into an animated PNG, which browsers play, so many a second
    #[arg(long, value_name = "PER_SECOND", num_args = 0..=1, default_missing_value = "20",
        value_parser = clap::value_parser!(u16).range(1..=100))]
    animate: Option<u16>,
    /// Centre of the view: a sprocket or guide (driver, sprockets.driver), or a link (37, link:37) [default: the whole
    /// drive]
    #[arg(long, value_name = "WHAT")]
    around: Option<String>,
    /// Width of the view [default: what fits; six pitches around a link]
    #[arg(long, value_name = "W", value_parser = width)]
    width_mm: Option<f64>,
    /// Draw the forces in the joints too
    #[arg(long)]
    joints: bool,
    /// Drawing to write, .svg or .png
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Draw the exact step instead of the nearest recorded frame: simulates again from the keyframe before
    #[arg(long)]
    exact: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Pixels of a PNG per user unit of its SVG: a drawing 992 units wide gets 300 dots per inch across 168 mm of paper.
const PIXELS_PER_UNIT: f64 = 2.0;
/// Narrowest view [mm]. SVG viewers use single precision: 240 mm to 1.5e-5 mm, half a pixel here.
const NARROWEST_MM: f64 = 0.05;
/// Pixels of an animated PNG per user unit: what screens show.
const ANIMATED_PIXELS_PER_UNIT: f64 = 1.0;
/// Maximum number of panels of a film strip: six rows of four; and of pictures of an animation: some 200 MB.
const MAX_PANELS: usize = 24;
const MAX_PICTURES: usize = 2000;

/// The requested frames.
#[derive(Clone, Copy, Debug, PartialEq)]
enum At {
    /// The frame nearest to this time [s].
    Time(f64),
    /// The frame with this number, from 0.
    Frame(usize),
    /// `count` times, the first and the last included [s].
    Strip { from_s: f64, to_s: f64, count: usize },
}

fn instant(text: &str) -> Result<At, String> {
    if let Some(number) = text.trim().strip_prefix("frame:") {
        let parsed = number.trim().parse();
        return parsed.map(At::Frame).map_err(|_| format!("`{number}` is no frame number; frames count from 0"));
    }
    let Some((from, rest)) = text.split_once("..") else { return super::run::instant(text).map(At::Time) };
    let Some((to, count)) = rest.split_once('/') else {
        return Err("a film strip needs the number of its pictures, e.g. 12.30ms..12.40ms/6".into());
    };
    let (from_s, to_s) = (super::run::instant(from)?, super::run::instant(to)?);
    match count.trim().parse::<usize>() {
        _ if to_s <= from_s => Err(format!("`{to}` must be later than `{from}`")),
        Ok(count) if (2..=MAX_PICTURES).contains(&count) => Ok(At::Strip { from_s, to_s, count }),
        _ => Err(format!("a strip has 2 to {MAX_PICTURES} pictures, not `{count}`")),
    }
}

fn width(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(w) if (NARROWEST_MM..=1e5).contains(&w) => Ok(w),
        _ => Err(format!("write millimetres from {NARROWEST_MM} to 100000, e.g. 40")),
    }
}

/// Format from the output's extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ImageFormat {
    Svg,
    Png,
}

pub fn run(args: &SnapshotArgs) -> Result<Outcome, Failure> {
    let kind = output_kind(args)?;
    let mut reader = super::open_recording(&args.recording)?;
    let (header, frames) = read_frames(&mut reader, args.at, args.exact)?;
    for frame in &frames {
        check_columns(&header, frame, &args.recording)?;
    }
    let around = match &args.around {
        None => ViewCentre::Drive,
        Some(what) => resolve(what, &header)?,
    };
    let impacts = super::impacts::all(&mut reader)?;
    let options = SnapshotOptions { around, width_mm: args.width_mm, joints: args.joints, impacts: &impacts };
    let shown_frames: Vec<&Frame> = frames.iter().collect();
    let (drawing, bytes) = match args.animate {
        Some(per_second) => {
            let mut pages = draw_pages(&header, &shown_frames, options);
            let svgs: Vec<&str> = pages.iter().map(|p| p.svg.as_str()).collect();
            let bytes = png::encode_animation(&svgs, ANIMATED_PIXELS_PER_UNIT, per_second)?;
            (pages.swap_remove(0), bytes)
        }
        None => {
            let drawing = draw(&header, &shown_frames, options);
            let bytes = match kind {
                ImageFormat::Svg => drawing.svg.clone().into_bytes(),
                ImageFormat::Png => png::encode(&drawing.svg, PIXELS_PER_UNIT)?,
            };
            (drawing, bytes)
        }
    };
    let shown = args.output.display();
    crate::output::write(&args.output, &bytes)?;
    let found = if args.json {
        Answer::Json(json(args, kind, &frames, &drawing))
    } else {
        let list = frames.iter().map(|f| format!("  t = {:.4} ms, step {}\n", f.t_s * 1e3, f.step));
        Answer::Text(format!("wrote {shown}\n{}", list.collect::<String>()))
    };
    answer(&[&reader], found, Outcome::Done)
}

/// The output format, checked before anything is read.
fn output_kind(args: &SnapshotArgs) -> Result<ImageFormat, Failure> {
    let shown = args.output.display();
    super::check_outputs([args.output.as_path()], [args.recording.as_path()])?;
    let count = if let At::Strip { count, .. } = args.at { count } else { 1 };
    if args.animate.is_none() && count > MAX_PANELS {
        let text = format!("a film strip has at most {MAX_PANELS} pictures, not {count}");
        return Err(Failure::Input(format!("{text}\nhelp: `--animate -o film.png` draws them after each other")));
    }
    if args.animate.is_some() && count < 2 {
        let help = "help: `--at FROM..TO/N`, e.g. `--at 12.30ms..12.40ms/60`";
        return Err(Failure::Input(format!("an animation takes several pictures\n{help}")));
    }
    if args.animate.is_some() && args.output.extension().and_then(|e| e.to_str()) != Some("png") {
        return Err(Failure::Input(format!("{shown}: animations end in .png (APNG, which browsers play)")));
    }
    match args.output.extension().and_then(|e| e.to_str()) {
        Some("svg") => Ok(ImageFormat::Svg),
        Some("png") => Ok(ImageFormat::Png),
        _ => Err(Failure::Input(format!("{shown}: drawings end in .svg or .png"))),
    }
}

/// Header and requested frames in order of time: the recorded ones nearest to the instants, or with `exact` the steps
/// nearest to them, simulated again from the keyframe before.
fn read_frames(reader: &mut Reader, at: At, exact: bool) -> Result<(Header, Vec<Frame>), Failure> {
    let path = reader.path().to_path_buf();
    let path = path.as_path();
    let heads = reader.heads()?;
    let header = reader.header().clone();
    let times_s: Vec<f64> = heads.iter().map(|h| h.t_s).collect();
    let interval_s = header.steps_per_frame as f64 * header.step_s;
    if exact && !times_s.is_empty() {
        return Ok((header, exact_frames(path, at, &times_s)?));
    }
    let numbers = pick(&times_s, interval_s, at).map_err(|e| Failure::Input(format!("{}: {e}", path.display())))?;
    let mut frames = Vec::new();
    for t_s in numbers.into_iter().filter_map(|number| times_s.get(number).copied()) {
        frames.extend(reader.frame_at(t_s)?);
        if frames.is_empty() {
            let shown = path.display();
            return Err(Failure::World(format!(
                "{shown} is damaged: the frame listed at {:.4} ms is missing",
                t_s * 1e3
            )));
        }
    }
    Ok((header, frames))
}

/// Frames of the steps nearest to the instants.
fn exact_frames(path: &Path, at: At, times_s: &[f64]) -> Result<Vec<Frame>, Failure> {
    let (Some(&first), Some(&last)) = (times_s.first(), times_s.last()) else { return Ok(Vec::new()) };
    let wanted_s = match at {
        At::Frame(number) => vec![*times_s.get(number).unwrap_or(&f64::NAN)],
        At::Time(t) => vec![t],
        At::Strip { from_s, to_s, count } => {
            (0..count).map(|k| from_s + (to_s - from_s) * k as f64 / (count - 1) as f64).collect()
        }
    };
    let mut replay = Replay::open(path)?;
    let mut frames: Vec<Frame> = Vec::new();
    for t_s in wanted_s {
        let step = replay.step_at(t_s);
        if !(replay.step_at(first)..=replay.step_at(last)).contains(&step) || !t_s.is_finite() {
            let (first, last) = (first * 1e3, last * 1e3);
            return Err(Failure::Input(format!(
                "{}: not recorded at {:.4} ms; the recording goes from {first:.4} to {last:.4} ms",
                path.display(),
                t_s * 1e3
            )));
        }
        if frames.last().is_none_or(|f| f.step != step) {
            frames.push(replay.frame_of_step(step)?);
        }
    }
    Ok(frames)
}

/// Why a recording lacks a requested frame. The text follows the name of the recording.
#[derive(Clone, Debug, PartialEq)]
enum NotRecorded {
    NoFrames,
    Number { number: usize, last: usize },
    Time { t_s: f64, first_s: f64, last_s: f64 },
}

impl std::fmt::Display for NotRecorded {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            NotRecorded::NoFrames => f.write_str("holds no frames"),
            NotRecorded::Number { number, last } => write!(f, "has no frame {number}; its frames are 0 to {last}"),
            NotRecorded::Time { t_s, first_s, last_s } => {
                let (t, first, last) = (t_s * 1e3, first_s * 1e3, last_s * 1e3);
                write!(f, "{t:.4} ms was not recorded; the recording goes from {first:.4} to {last:.4} ms")
            }
        }
    }
}

impl std::error::Error for NotRecorded {}

/// Numbers of the requested frames, without repetition. `times_s` are those of all frames, ascending.
fn pick(times_s: &[f64], interval_s: f64, at: At) -> Result<Vec<usize>, NotRecorded> {
    let (Some(&first), Some(&last)) = (times_s.first(), times_s.last()) else {
        return Err(NotRecorded::NoFrames);
    };
    #[expect(clippy::indexing_slicing, reason = "there is a frame, and both numbers are at most that of the last")]
    let nearest = |t: f64| {
        let after = times_s.partition_point(|s| *s < t).min(times_s.len() - 1);
        let before = after.saturating_sub(1);
        let number = if (t - times_s[before]).abs() <= (times_s[after] - t).abs() { before } else { after };
        (number, times_s[number])
    };
    let wanted_s: Vec<f64> = match at {
        At::Frame(number) if number < times_s.len() => return Ok(vec![number]),
        At::Frame(number) => {
            return Err(NotRecorded::Number { number, last: times_s.len() - 1 });
        }
        At::Time(t) => vec![t],
        At::Strip { from_s, to_s, count } => {
            let share = |k: usize| k as f64 / (count - 1) as f64;
            (0..count).map(|k| from_s + (to_s - from_s) * share(k)).collect()
        }
    };
    // A time up to half a frame beyond the ends is accepted; the factor allows for rounding.
    let slack_s = 0.5 * interval_s * (1.0 + 1e-9);
    if let Some(t) = wanted_s.iter().find(|t| **t < first - slack_s || **t > last + slack_s) {
        return Err(NotRecorded::Time { t_s: *t, first_s: first, last_s: last });
    }
    let mut numbers = Vec::new();
    for t in &wanted_s {
        let (number, found_s) = nearest(*t);
        numbers.push(number);
        let off_s = (found_s - t).abs();
        if off_s > slack_s {
            let (t, found) = (t * 1e3, found_s * 1e3);
            eprintln!(
                "note: the frame nearest to {t:.4} ms is at {found:.4} ms, {:.1} us off; frames are missing there",
                off_s * 1e6
            );
        }
    }
    numbers.dedup();
    if numbers.len() < wanted_s.len() {
        eprintln!(
            "note: {} instants asked for lie within {} frames, {:.3} us apart; each is drawn once",
            wanted_s.len(),
            numbers.len(),
            interval_s * 1e6
        );
    }
    Ok(numbers)
}

/// Refuses a frame whose columns do not match its header, on which drawing relies.
fn check_columns(header: &Header, frame: &Frame, path: &Path) -> Result<(), Failure> {
    let (l, j, c) = (&frame.links, &frame.joints, &frame.contacts);
    let n = header.links.len();
    let links = [&l.x_m, &l.y_m, &l.angle_rad].iter().all(|column| column.len() == n);
    let joints = j.force_x_n.len() <= n && j.force_x_n.len() == j.force_y_n.len();
    let count = c.link.len();
    let contacts = [&c.point_body_x_m, &c.point_body_y_m, &c.normal_x, &c.normal_y]
        .into_iter()
        .chain([&c.normal_force_n, &c.tangential_force_n, &c.penetration_m])
        .all(|column| column.len() == count);
    if links && joints && contacts && c.body.len() == count {
        return Ok(());
    }
    let (shown, t) = (path.display(), frame.t_s * 1e3);
    Err(Failure::World(format!("{shown} is damaged: columns of the frame at {t:.4} ms have different lengths")))
}

/// The link or body that `what` names.
fn resolve(what: &str, header: &Header) -> Result<ViewCentre, Failure> {
    let number = what.strip_prefix("link:").or_else(|| what.strip_prefix("link ")).unwrap_or(what).trim();
    if let Ok(link) = number.parse::<usize>() {
        let n = header.links.len();
        if link >= n {
            let last = n.saturating_sub(1);
            return Err(Failure::Input(format!("there is no link {link}; the links are 0 to {last}")));
        }
        return Ok(ViewCentre::Link(link));
    }
    // In merged recordings several bodies may share a name; then the full path is needed.
    let fitting =
        header.bodies.iter().enumerate().filter(|(_, b)| b.path == what || crate::diag::last_name(&b.path) == what);
    let found: Vec<usize> = fitting.map(|(k, _)| k).collect();
    match found.as_slice() {
        [k] => Ok(ViewCentre::Body(*k)),
        [] => {
            let lasts: Vec<String> =
                header.bodies.iter().map(|b| crate::diag::last_name(&b.path).to_string()).collect();
            let names = header.bodies.iter().map(|b| b.path.as_str()).chain(lasts.iter().map(String::as_str));
            let help = match crate::diag::nearest(what, names) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("name one of {}, or a link by its number", listed(header, |_| true)),
            };
            Err(Failure::Input(format!("nothing is called `{what}`\nhelp: {help}")))
        }
        several => Err(Failure::Input(format!(
            "`{what}` is the name of several\nhelp: give the path: {}",
            listed(header, |k| several.contains(&k))
        ))),
    }
}

fn listed(header: &Header, which: impl Fn(usize) -> bool) -> String {
    let paths = header.bodies.iter().enumerate().filter(|(k, _)| which(*k)).map(|(_, b)| b.path.as_str());
    paths.collect::<Vec<_>>().join(", ")
}

fn json(args: &SnapshotArgs, kind: ImageFormat, frames: &[Frame], drawing: &Drawing) -> serde_json::Value {
    let per_unit = match kind {
        ImageFormat::Svg => 1.0,
        ImageFormat::Png if args.animate.is_some() => ANIMATED_PIXELS_PER_UNIT,
        ImageFormat::Png => PIXELS_PER_UNIT,
    };
    let pixels = |units: f64| if kind == ImageFormat::Png { (units * per_unit).ceil() } else { units };
    let newtons_per_mm = |units_per_n: Option<f64>| units_per_n.map(|u| drawing.units_per_mm / u);
    serde_json::json!({
        "path": args.output,
        "width_px": pixels(drawing.width),
        "height_px": pixels(drawing.height),
        "px_per_mm": drawing.units_per_mm * per_unit,
        "force_scale_n_per_mm": newtons_per_mm(drawing.contact_units_per_n),
        "joint_force_scale_n_per_mm": newtons_per_mm(drawing.joint_units_per_n),
        "frames": frames.iter().map(|f| serde_json::json!({
            "step": f.step,
            "t_s": f.t_s,
            "crank_angle_deg": f.crank_angle_rad.to_degrees(),
            "contacts": f.contacts.link.len(),
        })).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn picks_the_nearest_frame_and_refuses_what_was_not_recorded() {
        // Two windows of a recording with a gap.
        let times_s = [1.0, 1.1, 1.2, 3.0, 3.1];
        let pick = |at| pick(&times_s, 0.1, at);
        assert_eq!(pick(At::Time(1.14)), Ok(vec![1]));
        assert_eq!(pick(At::Time(1.16)), Ok(vec![2]));
        assert_eq!(pick(At::Time(2.5)), Ok(vec![3]));
        assert_eq!(pick(At::Time(0.96)), Ok(vec![0]));
        assert_eq!(pick(At::Time(3.15)), Ok(vec![4]));
        assert!(pick(At::Time(0.94)).is_err() && pick(At::Time(3.16)).is_err());
        assert_eq!(pick(At::Frame(4)), Ok(vec![4]));
        assert!(pick(At::Frame(5)).is_err());
        assert_eq!(pick(At::Strip { from_s: 1.0, to_s: 1.2, count: 3 }), Ok(vec![0, 1, 2]));
        assert_eq!(pick(At::Strip { from_s: 1.0, to_s: 1.1, count: 6 }), Ok(vec![0, 1]));
        assert!(super::pick(&[], 0.1, At::Time(1.0)).is_err());
    }

    #[test]
    fn instants_are_read_with_their_units() {
        assert_eq!(instant("0ms"), Ok(At::Time(0.0)));
        assert_eq!(instant("frame:12"), Ok(At::Frame(12)));
        assert_eq!(instant("1s..2s/3"), Ok(At::Strip { from_s: 1.0, to_s: 2.0, count: 3 }));
        for wrong in
            ["", "12", "-1ms", "NaNs", "infs", "frame:-1", "1s..2s", "2s..1s/3", "1s..2s/1", "1s..2s/2001", "1s..2/4"]
        {
            assert!(instant(wrong).is_err(), "{wrong}");
        }
    }
}
