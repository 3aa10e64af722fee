//! The `.rrd` view of a recording, for the Rerun viewer. Numbers are stored in f32 under `state`: of contacts and rotors every
//! frame, of links and joints with every picture. The drawing (millimetres) and the curves are derived from them. All digits of
//! every frame are in the archive. Rows are collected in blocks, because one message
//! per block and entity is thirty times cheaper than one per row. The file is written on its own thread, one block
//! behind: each block waits for the one before and checks whether it was written. A live viewer gets the same rows, in
//! smaller blocks.

mod blueprint;
mod live;
pub mod measured;
mod rows;
mod scene;
mod table;
mod writer;

use super::contact_labels::{drive_of, drives_of, short_name};
use super::frame::{BodyInfo, Event, Frame, Header, Impact, Keyframe, Links};
use super::view_geometry::{bounds_of, scene_bounds};
use super::{OpensAt, PictureClock, Sink, ViewOptions};
use crate::output::OutputFile;
use anyhow::{Context, Result};
use blueprint::{FirstView, PictureTab, ViewRect};
use rerun::blueprint::components::PlayState;
use rerun::sink::LogSink;
use rerun::{RecordingStream, RecordingStreamBuilder, TextLog};
use rows::{Curves, Numbers, Pictures, curves_table};
use scene::{ForceScale, MM_PER_M};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;
use table::{ComponentValues, EntityTable, Times};
use writer::Writer;

/// Recordings with the same application name share a layout in the viewer.
const APPLICATION: &str = "pitchline";

/// Rows per message: numbers, pictures and curves. A killed run loses at most that many. Every message costs time
/// (hashing and validation in the crate) and 10 kB of memory for the footer; rows cost their size. Measured on a second of the bush
/// drive with archive and view, of 1.05 CPU s for the archive alone: 64 rows of numbers 2.2 s, 128 1.9 s, 512 1.6 s, 1024 1.45 s.
const NUMBER_ROWS: usize = 1024;
const PICTURE_ROWS: usize = 512;
const CURVE_ROWS: usize = 2048;

/// Destination of the rows.
enum RowDestination {
    File {
        output: OutputFile,
        file: File,
        writer: Writer,
    },
    /// Over the network; collected rows are sent every [`live::BLOCK_INTERVAL`].
    Viewer {
        last_block: Instant,
    },
}

/// Writes an `.rrd` file, or sends the run to a viewer.
pub struct RerunSink {
    /// Path of the file, or address of the viewer.
    path: PathBuf,
    end: RowDestination,
    header: Header,
    /// None once finished.
    stream: Option<RecordingStream>,
    recording: String,
    clock: PictureClock,
    scale: ForceScale,
    opens_at: Option<OpensAt>,
    has_layout: bool,
    /// Times of the last frames [s], and the crank's angle then.
    last_cranks_udeg: std::collections::VecDeque<(f64, i64)>,
    number_times: Times,
    curve_times: Times,
    picture_times: Times,
    event_times: Times,
    numbers: Numbers,
    curves: Curves,
    pictures: Pictures,
    events: EntityTable,
    /// Peaks of impacts on each curve of contact forces.
    peaks: Vec<(Times, EntityTable)>,
}

impl RerunSink {
    /// Opens `path` and writes all static data.
    pub fn create(path: &Path, header: &Header, view: ViewOptions) -> Result<RerunSink> {
        let (output, file) = OutputFile::create(path)?;
        let writer = Writer::new(file.try_clone()?).with_context(|| cannot_write(path))?;
        let end = RowDestination::File { output, file, writer: writer.clone() };
        RerunSink::begin(path.to_owned(), end, Box::new(writer), recording_id(header), header, view)
    }

    /// Sends all static data to `sink`.
    fn begin(
        path: PathBuf,
        end: RowDestination,
        sink: Box<dyn LogSink>,
        recording: String,
        header: &Header,
        view: ViewOptions,
    ) -> Result<RerunSink> {
        let builder = RecordingStreamBuilder::new(APPLICATION).recording_id(recording.as_str());
        let (_, store, properties, batching, hooks, _) = builder.into_args();
        let stream = RecordingStream::new(store, properties, batching, hooks, sink)?;
        stream.disable_timeline("log_time");
        stream.disable_timeline("log_tick");
        let scale = ForceScale::new(header);
        let mut sink = RerunSink {
            path,
            end,
            header: header.clone(),
            stream: Some(stream),
            recording,
            clock: PictureClock::new(view.picture_interval_s),
            scale,
            opens_at: view.opens_at,
            has_layout: false,
            last_cranks_udeg: std::collections::VecDeque::new(),
            number_times: Times::default(),
            curve_times: Times::default(),
            picture_times: Times::default(),
            event_times: Times::default(),
            numbers: Numbers::new(header),
            curves: Curves::new(header),
            pictures: Pictures::new(header),
            events: events_table(),
            peaks: scene::peaks_entities(header).iter().map(|e| (Times::default(), curves_table(e))).collect(),
        };
        let stream = sink.stream()?;
        stream.send_recording_name(header.drive_name.as_str())?;
        scene::log(stream, header, scale)?;
        sink.check_written()?;
        if let RowDestination::File { output, .. } = &mut sink.end {
            output.show()?;
        }
        Ok(sink)
    }

    /// Crank angle of the frame before, close enough to find what lies between frames; of an archive, events and impacts come behind the frames of
    /// their chunk.
    fn crank_before_udeg(&self, t_s: f64) -> i64 {
        let before = self.last_cranks_udeg.iter().rev().find(|(frame_s, _)| *frame_s <= t_s);
        before.map_or(0, |(_, crank_udeg)| *crank_udeg)
    }

    fn stream(&self) -> Result<&RecordingStream> {
        self.stream.as_ref().with_context(|| format!("{} is finished", self.path.display()))
    }

    /// Waits until everything sent so far is in the file, or returns the write error.
    fn check_written(&self) -> Result<()> {
        match &self.end {
            RowDestination::File { writer, .. } => {
                let flushed = self.stream()?.flush_blocking();
                writer.check().and(flushed.map_err(anyhow::Error::from)).with_context(|| cannot_write(&self.path))
            }
            RowDestination::Viewer { .. } => live::flush(self.stream()?),
        }
    }

    /// Whether a live viewer's next block is due.
    fn viewer_waits(&mut self) -> bool {
        match &mut self.end {
            RowDestination::Viewer { last_block } if last_block.elapsed() >= live::BLOCK_INTERVAL => {
                *last_block = Instant::now();
                true
            }
            RowDestination::File { .. } | RowDestination::Viewer { .. } => false,
        }
    }

    /// Sends the full blocks, or all collected rows.
    fn send_blocks(&mut self, all: bool) -> Result<()> {
        let all = all || self.viewer_waits();
        let due = |times: &Times, rows: usize| times.len() >= if all { 1 } else { rows };
        let numbers = due(&self.number_times, NUMBER_ROWS);
        let curves = due(&self.curve_times, CURVE_ROWS);
        let pictures = due(&self.picture_times, PICTURE_ROWS);
        // Events are few and are sent with the numbers around them.
        let events = due(&self.event_times, if numbers { 1 } else { NUMBER_ROWS });
        // Impacts come later than their frames, from a run by other frames than from an archive: their blocks hang on their number alone.
        let peaks = self.peaks.iter().any(|(times, _)| due(times, NUMBER_ROWS));
        if !(numbers || curves || pictures || events || peaks) {
            return Ok(());
        }
        self.check_written()?;
        let Some(stream) = &self.stream else { return Ok(()) };
        if numbers {
            table::send(stream, &mut self.number_times, self.numbers.tables())?;
        }
        if curves {
            table::send(stream, &mut self.curve_times, self.curves.tables())?;
        }
        if pictures {
            let tables = self.pictures.tables().chain(self.numbers.tables_beside_pictures());
            table::send(stream, &mut self.picture_times, tables)?;
        }
        if events {
            table::send(stream, &mut self.event_times, [&mut self.events])?;
        }
        for (times, table) in &mut self.peaks {
            if due(times, NUMBER_ROWS) {
                table::send(stream, times, [table])?;
            }
        }
        Ok(())
    }

    /// `frame`: the first one, if there is any.
    fn send_layout(&mut self, frame: Option<&Frame>) -> Result<()> {
        let play = match self.end {
            RowDestination::File { .. } => PlayState::Paused,
            RowDestination::Viewer { .. } => PlayState::Following,
        };
        let sensors: Vec<_> = scene::sensors_by_unit(&self.header)
            .into_iter()
            .map(|(unit, _)| (format!("sensors [{unit}]"), format!("/{}", scene::sensors_entity(&unit))))
            .collect();
        let stands_at_ns = self.opens_at.map(|at| (at.t_s * 1e9).round() as i64);
        let first = FirstView { tabs: picture_tabs(&self.header, frame, self.opens_at), play, stands_at_ns, sensors };
        for (view, look) in first.pictures().enumerate() {
            scene::log_legend(self.stream()?, view, look, self.scale)?;
        }
        blueprint::send(self.stream()?, &self.recording, &first)?;
        self.has_layout = true;
        Ok(())
    }
}

impl Sink for RerunSink {
    fn frame(&mut self, frame: &Frame) -> Result<()> {
        if !self.has_layout {
            self.send_layout(Some(frame))?;
        }
        let crank_udeg = (frame.crank_angle_rad.to_degrees() * 1e6).round() as i64;
        if self.last_cranks_udeg.len() == REMEMBERED_FRAMES {
            self.last_cranks_udeg.pop_front();
        }
        self.last_cranks_udeg.push_back((frame.t_s, crank_udeg));
        self.number_times.push(frame.t_s, frame.step, crank_udeg);
        self.numbers.push(frame);
        self.curve_times.push(frame.t_s, frame.step, crank_udeg);
        self.curves.push(frame);
        if self.clock.due(frame.t_s) {
            self.picture_times.push(frame.t_s, frame.step, crank_udeg);
            self.pictures.push(frame, &self.header, self.scale);
            self.numbers.push_beside_picture(frame);
        }
        self.send_blocks(false)
    }

    /// Keyframes contain nothing to display.
    fn keyframe(&mut self, _keyframe: &Keyframe) -> Result<()> {
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<()> {
        let Event { step, t_s, kind, text, link, body, value } = event;
        self.event_times.push(*t_s, *step, self.crank_before_udeg(*t_s));
        self.events.text(0).push(format!("{kind}: {text}"));
        self.events.text(1).push("INFO".to_owned());
        self.events.u64(2).push(u64::from(*link));
        self.events.u64(3).push(u64::from(*body));
        self.events.f64(4).push(*value);
        self.events.end_row(1);
        self.send_blocks(false)
    }

    /// The event of its first contact is already in the log. Its peak, which may lie between frames, is a mark over the curves of contact
    /// forces.
    fn impact(&mut self, impact: &Impact) -> Result<()> {
        let t_s = impact.t_s + impact.peak_after_s;
        let step = impact.step + (impact.peak_after_s / self.header.step_s).round() as u64;
        let crank_udeg = self.crank_before_udeg(t_s);
        if let Some((times, table)) = self.curves.curve_of(impact).and_then(|curve| self.peaks.get_mut(curve)) {
            times.push(t_s, step, crank_udeg);
            rows::push_curves(table, [impact.peak_force_n]);
        }
        self.send_blocks(false)
    }

    fn close(&mut self) -> Result<u64> {
        if !self.has_layout {
            self.send_layout(None)?;
        }
        self.send_blocks(true)?;
        self.check_written()?;
        let stream = self.stream.take();
        match &self.end {
            RowDestination::File { output, file, writer } => {
                // Ends the writing thread.
                drop(stream);
                writer.finish().with_context(|| cannot_write(&self.path))?;
                output.sync(file).with_context(|| cannot_write(&self.path))?;
                Ok(file.metadata()?.len())
            }
            RowDestination::Viewer { .. } => live::close(stream).map(|()| 0),
        }
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn publish(&mut self) -> Result<()> {
        match &mut self.end {
            RowDestination::File { output, .. } => output.publish(),
            RowDestination::Viewer { .. } => Ok(()),
        }
    }

    fn current_path(&self) -> &Path {
        match &self.end {
            RowDestination::File { output, .. } => output.current_path(),
            RowDestination::Viewer { .. } => &self.path,
        }
    }
}

impl Drop for RerunSink {
    fn drop(&mut self) {
        // Aborted: dropping the stream would wait for the viewer indefinitely.
        if matches!(self.end, RowDestination::Viewer { .. }) {
            std::mem::forget(self.stream.take());
        }
    }
}

/// Id of a recording: the same for the same run, different for runs whose headers differ, so that they can be open side
/// by side.
fn recording_id(header: &Header) -> String {
    let bytes = prost::Message::encode_to_vec(header);
    format!("{}-{:016x}", header.drive_name, twox_hash::XxHash3_64::oneshot(&bytes))
}

/// Log entries for the viewer, and their numbers.
/// Frames behind which an event may come: those of a few chunks of an archive.
const REMEMBERED_FRAMES: usize = 256;

fn events_table() -> EntityTable {
    let columns = vec![
        (TextLog::descriptor_text(), ComponentValues::Text(Vec::new())),
        (TextLog::descriptor_level(), ComponentValues::Text(Vec::new())),
        (table::number("event", "link"), ComponentValues::U64(Vec::new())),
        (table::number("event", "body"), ComponentValues::U64(Vec::new())),
        (table::number("event", "value"), ComponentValues::F64(Vec::new())),
    ];
    EntityTable::new("events".into(), columns)
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write {}", path.display())
}

/// Pitches that a close-up shows.
const CLOSE_UP: f64 = 5.0;
/// Close-ups that share a row; of more, each has a tab.
const CLOSE_UPS_IN_A_ROW: usize = 2;

/// The pictures of a recording: what it opens at, the whole drive with close-ups; of a merged one all drives, then each with its own.
fn picture_tabs(header: &Header, frame: Option<&Frame>, opens_at: Option<OpensAt>) -> Vec<PictureTab> {
    let whole = picture_of("drive", header, scene_bounds(header));
    let looks = |drive: Option<&str>| frame.map_or_else(Vec::new, |frame| close_ups(header, frame, drive));
    let mut tabs = Vec::new();
    if let Some(OpensAt { point_m, .. }) = opens_at {
        let name = "impact".to_string();
        let rows = vec![vec![close_up(header, name.clone(), point_m)], vec![whole.clone()]];
        tabs.push(PictureTab { name, rows });
    }
    let drives = drives_of(header);
    if drives.is_empty() {
        let near = looks(None);
        let name = "drive".to_string();
        if near.len() <= CLOSE_UPS_IN_A_ROW {
            let rows = [vec![whole], near].into_iter().filter(|row| !row.is_empty()).collect();
            tabs.push(PictureTab { name, rows });
        } else {
            let first = near[0].clone();
            tabs.push(PictureTab { name, rows: vec![vec![whole], vec![first]] });
            tabs.extend(near.into_iter().map(|look| PictureTab { name: look.name.clone(), rows: vec![vec![look]] }));
        }
        return tabs;
    }
    let drivers: Vec<ViewRect> = drives.iter().filter_map(|drive| looks(Some(drive)).into_iter().next()).collect();
    let rows = [vec![ViewRect { name: "all drives".into(), ..whole }], drivers];
    tabs.push(PictureTab { name: "all drives".into(), rows: rows.into_iter().filter(|row| !row.is_empty()).collect() });
    for drive in drives {
        let own = header.bodies.iter().filter(|body| drive_of(body) == Some(drive));
        let mut rows = vec![vec![picture_of(drive, header, bounds_of(own))]];
        rows.extend(looks(Some(drive)).into_iter().take(CLOSE_UPS_IN_A_ROW).map(|look| vec![look]));
        tabs.push(PictureTab { name: drive.to_string(), rows });
    }
    tabs
}

/// A picture of bodies between two corners, with room for the chain about them.
fn picture_of(name: &str, header: &Header, (low, high): ([f64; 2], [f64; 2])) -> ViewRect {
    let name = name.to_owned();
    if !(low[0] <= high[0] && low[1] <= high[1]) {
        return ViewRect { name, centre: [0.0, 0.0], width: 300.0, height: 200.0, is_near: false };
    }
    // Two pitches of room on each side for the chain.
    let room = 4.0 * scene::pitch_mm(header);
    let centre = [0, 1].map(|k| 0.5 * MM_PER_M * (low[k] + high[k]));
    let [width, height] = [0, 1].map(|k| MM_PER_M * (high[k] - low[k]) + room);
    ViewRect { name, centre, width, height, is_near: false }
}

fn close_up(header: &Header, name: String, point_m: [f64; 2]) -> ViewRect {
    let size = CLOSE_UP * scene::pitch_mm(header);
    ViewRect { name, centre: point_m.map(|v| MM_PER_M * v), width: size, height: size, is_near: true }
}

/// For each sprocket, or each of one drive, the place where the chain runs on; on the driver this is the end of the tight span.
fn close_ups(header: &Header, frame: &Frame, drive: Option<&str>) -> Vec<ViewRect> {
    let own = header.bodies.iter().filter(|body| body.rotor && (drive.is_none() || drive_of(body) == drive));
    own.filter_map(|body| {
        let name = format!("{}: chain runs on", short_name(body));
        first_seated(header, body, frame).map(|point_m| close_up(header, name, point_m))
    })
    .collect()
}

/// Centre of the link that seated last on the sprocket [m].
fn first_seated(header: &Header, body: &BodyInfo, frame: &Frame) -> Option<[f64; 2]> {
    let Links { x_m, y_m, angle_rad, vx_m_s, vy_m_s, .. } = &frame.links;
    let n = x_m.len();
    if n == 0 || body.teeth == 0 {
        return None;
    }
    let pitch_m = scene::pitch_mm(header) / MM_PER_M;
    let pitch_radius_m = 0.5 * pitch_m / libm::sin(std::f64::consts::PI / f64::from(body.teeth));
    let seated = |i: usize| libm::hypot(x_m[i] - body.x_m, y_m[i] - body.y_m) < pitch_radius_m + 0.1 * pitch_m;
    // Links arrive in order of the chain if it runs forwards; a chain at rest is treated the same.
    let along: f64 = (0..n).map(|i| vx_m_s[i] * libm::cos(angle_rad[i]) + vy_m_s[i] * libm::sin(angle_rad[i])).sum();
    let next_to_come = if along < 0.0 { 1 } else { n - 1 };
    (0..n).find(|i| seated(*i) && !seated((i + next_to_come) % n)).map(|i| [x_m[i], y_m[i]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::frame::{Contacts, LinkInfo, Links, Outline};
    use rerun::external::re_log_encoding::DecoderApp;
    use rerun::log::{Chunk, LogMsg};

    fn header() -> Header {
        let link = LinkInfo { outline: 0, pitch_m: 8e-3, mass_kg: 1e-3, inertia_kg_m2: 1e-8, ahead: 0 };
        let outline = Outline { name: "inner".to_owned(), ..Outline::default() };
        Header {
            drive_name: "test".to_owned(),
            links: vec![link; 2],
            link_outlines: vec![outline],
            ..Header::default()
        }
    }

    /// Two links; one contact in odd frames.
    fn frame(step: u64) -> Frame {
        let x_m = vec![step as f64 / 3.0, -1.0];
        let zero = vec![0.0; 2];
        let mut frame = Frame { step, t_s: step as f64 * 1e-3, ..Frame::default() };
        let [y_m, angle_rad, vx_m_s, vy_m_s, omega_rad_s] = std::array::from_fn(|_| zero.clone());
        let [ax_m_s2, ay_m_s2, alpha_rad_s2] = std::array::from_fn(|_| zero.clone());
        frame.links = Links { x_m, y_m, angle_rad, vx_m_s, vy_m_s, omega_rad_s, ax_m_s2, ay_m_s2, alpha_rad_s2 };
        (frame.joints.force_x_n, frame.joints.force_y_n) = (zero.clone(), zero.clone());
        frame.joints.friction_torque_nm = zero;
        if step % 2 == 1 {
            frame.contacts = one_contact();
        }
        frame
    }

    fn one_contact() -> Contacts {
        let (one, number) = (vec![0_u32], vec![0.5_f64]);
        Contacts {
            link: one.clone(),
            feature: one.clone(),
            body: one.clone(),
            tooth: one.clone(),
            segment: one,
            point_body_x_m: number.clone(),
            point_body_y_m: number.clone(),
            point_link_x_m: number.clone(),
            point_link_y_m: number.clone(),
            normal_x: number.clone(),
            normal_y: number.clone(),
            penetration_m: number.clone(),
            approach_speed_m_s: number.clone(),
            normal_speed_m_s: number.clone(),
            tangential_speed_m_s: number.clone(),
            normal_force_n: number.clone(),
            tangential_force_n: number.clone(),
            instant_force_n: number.clone(),
            stick: vec![true],
            age_s: number,
        }
    }

    /// Rows of a component in order, read back with the crate's decoder.
    fn rows<T>(path: &Path, entity: &str, of_chunk: impl Fn(&Chunk) -> Vec<Vec<T>>) -> Vec<Vec<T>> {
        let file = std::io::BufReader::new(File::open(path).unwrap());
        let mut rows = Vec::new();
        for message in DecoderApp::decode_lazy(file) {
            let LogMsg::ArrowMsg(_, message) = message.unwrap() else { continue };
            let chunk = Chunk::from_arrow_msg(&message).unwrap();
            if chunk.entity_path().to_string() == entity {
                rows.extend(of_chunk(&chunk));
            }
        }
        rows
    }

    fn floats(path: &Path, entity: &str, component: &'static str) -> Vec<Vec<f32>> {
        rows(path, entity, |chunk| chunk.iter_slices::<f32>(component.into()).map(<[f32]>::to_vec).collect())
    }

    #[test]
    fn numbers_come_back_with_seven_digits() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.rrd");
        let view = ViewOptions::every(0.01);
        let mut sink = RerunSink::create(&path, &header(), view).unwrap();
        // Two full blocks and a partial one.
        let n = 2 * NUMBER_ROWS as u64 + 3;
        (0..n).for_each(|step| sink.frame(&frame(step)).unwrap());
        let bytes = sink.finish().unwrap();
        assert_eq!(bytes, std::fs::metadata(&path).unwrap().len());
        let shown = |step: u64| frame(step).links.x_m.iter().map(|v| *v as f32).collect::<Vec<f32>>();
        // Links with every picture, of which there is one for ten frames; contacts of every frame.
        let expected: Vec<Vec<f32>> = (0..n).step_by(10).map(shown).collect();
        assert_eq!(floats(&path, "/state/links", "link:x_m"), expected);
        let lengths: Vec<usize> = floats(&path, "/state/contacts", "contact:age_s").iter().map(Vec::len).collect();
        assert_eq!(lengths, (0..n).map(|step| (step % 2) as usize).collect::<Vec<_>>());
        let curves = rows(&path, "/plots/contacts", |chunk| {
            chunk.iter_slices::<f64>("Scalars:scalars".into()).map(<[f64]>::to_vec).collect()
        });
        assert_eq!(curves.len() as u64, n);
    }

    #[test]
    fn a_finished_file_ends_with_its_footer() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("empty.rrd");
        RerunSink::create(&path, &header(), ViewOptions::default()).unwrap().finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(&bytes[bytes.len() - 8..bytes.len() - 4], b"FOOT");
    }

    #[test]
    fn a_path_that_cannot_be_written_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let error = RerunSink::create(folder.path(), &header(), ViewOptions::default()).err().unwrap();
        assert!(format!("{error:#}").contains(&folder.path().display().to_string()), "{error:#}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("full.rrd");
        std::os::unix::fs::symlink("/dev/full", &path).unwrap();
        let error = RerunSink::create(&path, &header(), ViewOptions::default()).err().unwrap();
        assert!(format!("{error:#}").contains("No space left"), "{error:#}");
    }
}
