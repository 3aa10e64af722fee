//! The `.rrd` view of a recording, for the Rerun viewer. Numbers of every frame are kept in f64 under `state`; the drawing
//! (f32, millimetres) and the curves come from them. Rows are gathered in blocks, because one message per block and entity is
//! thirty times cheaper than one per row. The crate writes on a thread of its own, and only says that it failed when asked to
//! flush: so each block is preceded by a flush of the one before, and the end of the file is looked at when all is written.

mod blueprint;
mod scene;
mod table;

use super::frame::{Contacts, Event, Frame, Header, Keyframe, Links};
use super::view_geometry::scene_bounds;
use super::{PictureClock, Sink, ViewOptions};
use anyhow::{Context, Result};
use blueprint::Look;
use rerun::{Arrows3D, InstancePoses3D, Points3D, RecordingStream, RecordingStreamBuilder, Scalars, TextLog, Transform3D};
use scene::{ForceScale, MM_PER_M, position_mm};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use table::{Table, Times, Values};

/// Recordings with one application name share a layout in the viewer.
const APPLICATION: &str = "pitchline";

/// Rows per message: numbers, pictures and curves. A killed run loses that many. Every message costs time (hashing and
/// validation in the crate) and 5 kB of memory until the end, for the footer's table of contents; rows cost their size.
const NUMBER_ROWS: usize = 512;
const PICTURE_ROWS: usize = 256;
const CURVE_ROWS: usize = 2048;

/// What the last bytes of a complete file are: see `StreamFooter` of re_log_encoding 0.36.
const FOOTER_MARK: [u8; 4] = *b"FOOT";
const FOOTER_MARK_FROM_END: i64 = 8;

/// Writes an `.rrd` file.
pub struct RerunSink {
    path: PathBuf,
    header: Header,
    /// None once finished.
    stream: Option<RecordingStream>,
    recording: String,
    clock: PictureClock,
    scale: ForceScale,
    has_layout: bool,
    last_crank_udeg: i64,
    number_times: Times,
    curve_times: Times,
    picture_times: Times,
    event_times: Times,
    numbers: Numbers,
    curves: Curves,
    pictures: Pictures,
    events: Table,
    event_data: Table,
}

impl RerunSink {
    /// Opens `path` and writes everything that stands still.
    pub fn create(path: &Path, header: &Header, view: ViewOptions) -> Result<RerunSink> {
        File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
        let recording = recording_id(header);
        let stream = RecordingStreamBuilder::new(APPLICATION)
            .recording_id(recording.as_str())
            .enabled(true)
            .save(path)
            .with_context(|| format!("cannot write {}", path.display()))?;
        stream.disable_timeline("log_time");
        stream.disable_timeline("log_tick");
        stream.send_recording_name(header.drive_name.as_str())?;
        let scale = ForceScale::new(header);
        scene::log(&stream, header, scale)?;
        let sink = RerunSink {
            path: path.to_owned(),
            header: header.clone(),
            stream: Some(stream),
            recording,
            clock: PictureClock::new(view),
            scale,
            has_layout: false,
            last_crank_udeg: 0,
            number_times: Times::default(),
            curve_times: Times::default(),
            picture_times: Times::default(),
            event_times: Times::default(),
            numbers: Numbers::new(),
            curves: Curves::new(header),
            pictures: Pictures::new(header),
            events: Table::drawn(
                "events".into(),
                vec![
                    (TextLog::descriptor_text(), Values::Text(Vec::new())),
                    (TextLog::descriptor_level(), Values::Text(Vec::new())),
                ],
            ),
            event_data: Table::numbers(
                "state/events",
                "event",
                vec![
                    ("link", Values::U64(Vec::new())),
                    ("body", Values::U64(Vec::new())),
                    ("value", Values::F64(Vec::new())),
                ],
            ),
        };
        sink.check_written()?;
        Ok(sink)
    }

    fn stream(&self) -> Result<&RecordingStream> {
        self.stream.as_ref().with_context(|| format!("{} is finished", self.path.display()))
    }

    /// Waits until everything sent so far is in the file, or says why it is not.
    fn check_written(&self) -> Result<()> {
        self.stream()?.flush_blocking().map_err(|error| self.write_error(&error.to_string()))
    }

    fn write_error(&self, reason: &str) -> anyhow::Error {
        let error = match probe(&self.path) {
            Ok(()) => anyhow::anyhow!("{reason}"),
            Err(error) => anyhow::Error::from(error),
        };
        error.context(format!("cannot write {}: the recording ends early", self.path.display()))
    }

    /// Sends the blocks that are full, or all there is.
    fn send_blocks(&mut self, all: bool) -> Result<()> {
        let due = |times: &Times, rows: usize| times.len() >= if all { 1 } else { rows };
        let numbers = due(&self.number_times, NUMBER_ROWS);
        let curves = due(&self.curve_times, CURVE_ROWS);
        let pictures = due(&self.picture_times, PICTURE_ROWS);
        let events = due(&self.event_times, PICTURE_ROWS);
        if !(numbers || curves || pictures || events) {
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
            table::send(stream, &mut self.picture_times, self.pictures.tables())?;
        }
        if events {
            table::send(stream, &mut self.event_times, [&mut self.events, &mut self.event_data])?;
        }
        Ok(())
    }

    fn send_layout(&mut self, close_ups: &[Look]) -> Result<()> {
        let drive = whole_drive(&self.header);
        blueprint::send(self.stream()?, &self.recording, &drive, close_ups)?;
        self.has_layout = true;
        Ok(())
    }
}

impl Sink for RerunSink {
    fn frame(&mut self, frame: &Frame) -> Result<()> {
        if !self.has_layout {
            self.send_layout(&close_ups(&self.header, frame))?;
        }
        self.last_crank_udeg = (frame.crank_angle_rad.to_degrees() * 1e6).round() as i64;
        self.number_times.push(frame.t_s, frame.step, self.last_crank_udeg);
        self.numbers.push(frame);
        self.curve_times.push(frame.t_s, frame.step, self.last_crank_udeg);
        self.curves.push(frame, &self.header);
        if self.clock.due(frame.t_s) {
            self.picture_times.push(frame.t_s, frame.step, self.last_crank_udeg);
            self.pictures.push(frame, &self.header, self.scale);
        }
        self.send_blocks(false)
    }

    /// Nothing to see in a snapshot.
    fn keyframe(&mut self, _keyframe: &Keyframe) -> Result<()> {
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<()> {
        let Event { step, t_s, kind, text, link, body, value } = event;
        // An event does not know the crank angle: that of the frame before is near enough to find it by.
        self.event_times.push(*t_s, *step, self.last_crank_udeg);
        self.events.text(0).push(format!("{kind}: {text}"));
        self.events.text(1).push("INFO".to_owned());
        self.events.end_row(1);
        self.event_data.u64(0).push(u64::from(*link));
        self.event_data.u64(1).push(u64::from(*body));
        self.event_data.f64(2).push(*value);
        self.event_data.end_row(1);
        self.send_blocks(false)
    }

    fn finish(&mut self) -> Result<u64> {
        if !self.has_layout {
            self.send_layout(&[])?;
        }
        self.send_blocks(true)?;
        self.check_written()?;
        // Dropping the stream writes the footer and ends the writer's thread, which keeps quiet about errors.
        drop(self.stream.take());
        complete_size(&self.path).map_err(|error| self.write_error(&error.to_string()))
    }

    fn path(&self) -> &Path {
        &self.path
    }
}

/// The same run has the same id; runs that differ in anything a header tells can be open side by side.
fn recording_id(header: &Header) -> String {
    let bytes = prost::Message::encode_to_vec(header);
    format!("{}-{:016x}", header.drive_name, xxhash_rust::xxh3::xxh3_64(&bytes))
}

/// Size of a file that ends as it should [bytes].
fn complete_size(path: &Path) -> std::io::Result<u64> {
    let mut file = File::open(path)?;
    file.sync_all()?;
    let mut mark = [0; FOOTER_MARK.len()];
    file.seek(SeekFrom::End(-FOOTER_MARK_FROM_END))?;
    file.read_exact(&mut mark)?;
    if mark != FOOTER_MARK {
        return Err(std::io::Error::other("the footer is missing"));
    }
    Ok(file.metadata()?.len())
}

/// Learns from the system why writing failed, by trying again; the file keeps its length.
fn probe(path: &Path) -> std::io::Result<()> {
    let mut file = File::options().append(true).open(path)?;
    let length = file.metadata()?.len();
    let written = file.write_all(&[0; 1 << 16]).and_then(|()| file.sync_all());
    file.set_len(length).or_else(|error| if file.metadata()?.is_file() { Err(error) } else { Ok(()) })?;
    written
}

/// Every number of every frame, in f64.
struct Numbers {
    frame: Table,
    links: Table,
    joints: Table,
    rotors: Table,
    contacts: Table,
}

impl Numbers {
    fn new() -> Numbers {
        let f64s = |names: &[&'static str]| names.iter().map(|name| (*name, Values::F64(Vec::new()))).collect::<Vec<_>>();
        let mut contacts: Vec<_> =
            ["link", "body", "tooth", "segment", "feature"].map(|name| (name, Values::U16(Vec::new()))).into();
        contacts.push(("stick", Values::Bool(Vec::new())));
        contacts.extend(f64s(&[
            "penetration_m",
            "normal_force_n",
            "tangential_force_n",
            "approach_speed_m_s",
            "normal_speed_m_s",
            "tangential_speed_m_s",
            "age_s",
            "normal_x",
            "normal_y",
            "point_body_x_m",
            "point_body_y_m",
            "point_link_x_m",
            "point_link_y_m",
        ]));
        let links = f64s(&["x_m", "y_m", "angle_rad", "vx_m_s", "vy_m_s", "omega_rad_s"]);
        let joints = f64s(&["force_x_n", "force_y_n", "friction_torque_nm"]);
        let rotors = f64s(&["angle_rad", "speed_rad_s", "chain_torque_nm", "outer_torque_nm"]);
        Numbers {
            frame: Table::numbers("state/frame", "frame", vec![("state_hash", Values::U64(Vec::new()))]),
            links: Table::numbers("state/links", "link", links),
            joints: Table::numbers("state/joints", "joint", joints),
            rotors: Table::numbers("state/rotors", "rotor", rotors),
            contacts: Table::numbers("state/contacts", "contact", contacts),
        }
    }

    fn push(&mut self, frame: &Frame) {
        let Frame { links, joints, contacts, rotors, .. } = frame;
        self.frame.u64(0).push(frame.state_hash);
        self.frame.end_row(1);
        let Links { x_m, y_m, angle_rad, vx_m_s, vy_m_s, omega_rad_s } = links;
        push_row(&mut self.links, 0, &[x_m, y_m, angle_rad, vx_m_s, vy_m_s, omega_rad_s]);
        push_row(&mut self.joints, 0, &[&joints.force_x_n, &joints.force_y_n, &joints.friction_torque_nm]);
        let super::frame::Rotors { angle_rad, speed_rad_s, chain_torque_nm, outer_torque_nm } = rotors;
        push_row(&mut self.rotors, 0, &[angle_rad, speed_rad_s, chain_torque_nm, outer_torque_nm]);
        push_contacts(&mut self.contacts, contacts);
    }

    fn tables(&mut self) -> [&mut Table; 5] {
        [&mut self.frame, &mut self.links, &mut self.joints, &mut self.rotors, &mut self.contacts]
    }
}

/// Adds a row to the f64 columns from `first` on.
fn push_row(table: &mut Table, first: usize, columns: &[&Vec<f64>]) {
    for (k, values) in columns.iter().enumerate() {
        table.f64(first + k).extend_from_slice(values);
    }
    table.end_row(columns[0].len());
}

fn push_contacts(table: &mut Table, contacts: &Contacts) {
    let Contacts {
        link,
        feature,
        body,
        tooth,
        segment,
        point_body_x_m,
        point_body_y_m,
        point_link_x_m,
        point_link_y_m,
        normal_x,
        normal_y,
        penetration_m,
        approach_speed_m_s,
        normal_speed_m_s,
        tangential_speed_m_s,
        normal_force_n,
        tangential_force_n,
        stick,
        age_s,
    } = contacts;
    for (k, values) in [link, body, tooth, segment, feature].into_iter().enumerate() {
        // No chain has as many links or teeth as would not fit.
        table.u16(k).extend(values.iter().map(|v| u16::try_from(*v).unwrap_or(u16::MAX)));
    }
    table.bool(5).extend_from_slice(stick);
    let columns = [
        penetration_m,
        normal_force_n,
        tangential_force_n,
        approach_speed_m_s,
        normal_speed_m_s,
        tangential_speed_m_s,
        age_s,
        normal_x,
        normal_y,
        point_body_x_m,
        point_body_y_m,
        point_link_x_m,
        point_link_y_m,
    ];
    push_row(table, 6, &columns);
}

/// A few numbers per frame that a viewer draws over time, several curves to an entity.
struct Curves {
    contact_force: Table,
    contacts: Table,
    tension: Table,
    speed: Table,
    energy: Table,
    lost: Table,
    error: Table,
    /// Curve of each body: a sprocket's own, or the one of all guides.
    curve_of_body: Vec<usize>,
    /// Largest contact force of each curve in this frame.
    largest_n: Vec<f64>,
}

impl Curves {
    fn new(header: &Header) -> Curves {
        let curves =
            |entity: &str| Table::drawn(entity.into(), vec![(Scalars::descriptor_scalars(), Values::F64(Vec::new()))]);
        let n_rotors = header.bodies.iter().filter(|body| body.rotor).count();
        let curve_of_body = header.bodies.iter().enumerate().map(|(i, body)| if body.rotor { i } else { n_rotors });
        Curves {
            contact_force: curves("plots/largest_contact_force"),
            contacts: curves("plots/contacts"),
            tension: curves("plots/joint_tension"),
            speed: curves("plots/speed"),
            energy: curves("plots/energy"),
            lost: curves("plots/energy_lost"),
            error: curves("plots/energy_error"),
            curve_of_body: curve_of_body.collect(),
            largest_n: vec![0.0; n_rotors + 1],
        }
    }

    fn push(&mut self, frame: &Frame, header: &Header) {
        let has_guides = self.largest_n.len() <= header.bodies.len();
        self.largest_n.fill(0.0);
        for (body, force_n) in frame.contacts.body.iter().zip(&frame.contacts.normal_force_n) {
            if let Some(curve) = self.curve_of_body.get(*body as usize) {
                self.largest_n[*curve] = self.largest_n[*curve].max(*force_n);
            }
        }
        let n_curves = if has_guides { self.largest_n.len() } else { self.largest_n.len() - 1 };
        push_curves(&mut self.contact_force, self.largest_n[..n_curves].iter().copied());
        push_curves(&mut self.contacts, [frame.contacts.body.len() as f64]);
        let (mut high, mut low) = (0.0_f64, f64::INFINITY);
        for (x, y) in frame.joints.force_x_n.iter().zip(&frame.joints.force_y_n) {
            let squared = x * x + y * y;
            (high, low) = (high.max(squared), low.min(squared));
        }
        push_curves(&mut self.tension, [high.sqrt(), low.sqrt()]);
        const RPM_PER_RAD_S: f64 = 30.0 / std::f64::consts::PI;
        push_curves(&mut self.speed, frame.rotors.speed_rad_s.iter().map(|w| RPM_PER_RAD_S * w));
        let e = &frame.energy;
        let stored_and_work =
            [e.kinetic_j, e.elastic_joint_j, e.elastic_contact_j, e.work_in_j, e.work_out_j];
        push_curves(&mut self.energy, stored_and_work);
        let lost = [
            e.lost_pin_damping_j,
            e.lost_pin_friction_j,
            e.lost_contact_damping_j,
            e.lost_contact_friction_j,
            e.lost_guide_damping_j,
            e.lost_guide_friction_j,
        ];
        push_curves(&mut self.lost, lost);
        push_curves(&mut self.error, [e.error_j]);
    }

    fn tables(&mut self) -> [&mut Table; 7] {
        [
            &mut self.contact_force,
            &mut self.contacts,
            &mut self.tension,
            &mut self.speed,
            &mut self.energy,
            &mut self.lost,
            &mut self.error,
        ]
    }
}

fn push_curves(table: &mut Table, values: impl IntoIterator<Item = f64>) {
    let column = table.f64(0);
    let before = column.len();
    column.extend(values);
    let n = column.len() - before;
    table.end_row(n);
}

/// The drawing: what moves of it.
struct Pictures {
    /// One for each outline of links.
    chain: Vec<Table>,
    /// One for each sprocket.
    rotors: Vec<Table>,
    pins: Table,
    contacts: Table,
    forces: Table,
}

impl Pictures {
    fn new(header: &Header) -> Pictures {
        let vec3 = || Values::Vec3(Vec::new());
        let quaternion = || Values::Quaternion(Vec::new());
        let chain = header.link_outlines.iter().map(|outline| {
            let columns = vec![
                (InstancePoses3D::descriptor_translations(), vec3()),
                (InstancePoses3D::descriptor_quaternions(), quaternion()),
            ];
            Table::drawn(scene::outline_entity(outline), columns)
        });
        let rotors = header.bodies.iter().filter(|body| body.rotor).map(|body| {
            let columns =
                vec![(Transform3D::descriptor_translation(), vec3()), (Transform3D::descriptor_quaternion(), quaternion())];
            Table::drawn(scene::body_entity(body), columns)
        });
        let points = || {
            vec![
                (Points3D::descriptor_positions(), vec3()),
                (Points3D::descriptor_class_ids(), Values::U16(Vec::new())),
            ]
        };
        let arrows = vec![(Arrows3D::descriptor_origins(), vec3()), (Arrows3D::descriptor_vectors(), vec3())];
        Pictures {
            chain: chain.collect(),
            rotors: rotors.collect(),
            pins: Table::drawn("joints/tension".into(), points()),
            contacts: Table::drawn("contacts/points".into(), points()),
            forces: Table::drawn("contacts/forces".into(), arrows),
        }
    }

    fn push(&mut self, frame: &Frame, header: &Header, scale: ForceScale) {
        self.push_chain(frame, header, scale);
        self.push_rotors(frame, header);
        self.push_contacts(&frame.contacts, scale);
    }

    fn push_chain(&mut self, frame: &Frame, header: &Header, scale: ForceScale) {
        let Links { x_m, y_m, angle_rad, .. } = &frame.links;
        let mut counts = [0_usize; 8];
        for (i, link) in header.links.iter().enumerate().take(x_m.len()) {
            let (s, c) = libm::sincos(0.5 * angle_rad[i]);
            if let Some(table) = self.chain.get_mut(link.outline as usize) {
                table.f32(0).extend_from_slice(&position_mm([x_m[i], y_m[i]], 0.0));
                table.f32(1).extend_from_slice(&[0.0, 0.0, s as f32, c as f32]);
                counts[link.outline as usize] += 1;
            }
            // Front pin: half a pitch ahead of the centre; (c2, s2) is the heading.
            let (c2, s2) = (c * c - s * s, 2.0 * s * c);
            let pin = [x_m[i] + 0.5 * link.pitch_m * c2, y_m[i] + 0.5 * link.pitch_m * s2];
            let (fx, fy) = (frame.joints.force_x_n[i], frame.joints.force_y_n[i]);
            self.pins.f32(0).extend_from_slice(&position_mm(pin, scale.z_mm));
            self.pins.u16(1).push(scale.class((fx * fx + fy * fy).sqrt()));
        }
        for (table, n) in self.chain.iter_mut().zip(counts) {
            table.end_row(n);
        }
        self.pins.end_row(header.links.len().min(x_m.len()));
    }

    fn push_rotors(&mut self, frame: &Frame, header: &Header) {
        let bodies = header.bodies.iter().filter(|body| body.rotor);
        for ((table, body), turned_rad) in self.rotors.iter_mut().zip(bodies).zip(&frame.rotors.angle_rad) {
            let (s, c) = libm::sincos(0.5 * (body.angle_rad + turned_rad));
            table.f32(0).extend_from_slice(&position_mm([body.x_m, body.y_m], 0.0));
            table.f32(1).extend_from_slice(&[0.0, 0.0, s as f32, c as f32]);
            table.end_row(1);
        }
    }

    fn push_contacts(&mut self, contacts: &Contacts, scale: ForceScale) {
        let n = contacts.link.len();
        for i in 0..n {
            let (normal_n, friction_n) = (contacts.normal_force_n[i], contacts.tangential_force_n[i]);
            let (nx, ny) = (contacts.normal_x[i], contacts.normal_y[i]);
            // The tangent is the normal turned by +90 degrees.
            let force_n = [normal_n * nx - friction_n * ny, normal_n * ny + friction_n * nx];
            let point = position_mm([contacts.point_body_x_m[i], contacts.point_body_y_m[i]], scale.z_mm);
            self.contacts.f32(0).extend_from_slice(&point);
            self.contacts.u16(1).push(scale.class(normal_n));
            self.forces.f32(0).extend_from_slice(&point);
            self.forces.f32(1).extend_from_slice(&[
                scale.mm_per_n * force_n[0] as f32,
                scale.mm_per_n * force_n[1] as f32,
                0.0,
            ]);
        }
        self.contacts.end_row(n);
        self.forces.end_row(n);
    }

    fn tables(&mut self) -> impl Iterator<Item = &mut Table> {
        let others = [&mut self.pins, &mut self.contacts, &mut self.forces];
        self.chain.iter_mut().chain(&mut self.rotors).chain(others)
    }
}

fn whole_drive(header: &Header) -> Look {
    let (low, high) = scene_bounds(header);
    let name = "drive".to_owned();
    if !(low[0] <= high[0] && low[1] <= high[1]) {
        return Look { name, centre: [0.0, 0.0], width: 300.0, height: 200.0 };
    }
    // Two pitches of room on each side for the chain.
    let room = 4.0 * scene::pitch_mm(header);
    let centre = [0, 1].map(|k| 0.5 * MM_PER_M * (low[k] + high[k]));
    let [width, height] = [0, 1].map(|k| MM_PER_M * (high[k] - low[k]) + room);
    Look { name, centre, width, height }
}

/// For each sprocket the place where the chain runs onto it: on the driver the end of the tight span.
fn close_ups(header: &Header, frame: &Frame) -> Vec<Look> {
    let pitch = scene::pitch_mm(header);
    let mut looks = Vec::new();
    for body in header.bodies.iter().filter(|body| body.rotor) {
        let Some([x_m, y_m]) = first_seated(header, body, frame) else { continue };
        let centre = [MM_PER_M * x_m, MM_PER_M * y_m];
        let name = format!("{}: chain runs on", scene::short_name(body));
        looks.push(Look { name, centre, width: 5.0 * pitch, height: 5.0 * pitch });
    }
    looks
}

/// Centre of the link that came onto the sprocket last [m].
fn first_seated(header: &Header, body: &super::frame::BodyInfo, frame: &Frame) -> Option<[f64; 2]> {
    let Links { x_m, y_m, angle_rad, vx_m_s, vy_m_s, .. } = &frame.links;
    let n = x_m.len();
    if n == 0 || body.teeth == 0 {
        return None;
    }
    let pitch_m = scene::pitch_mm(header) / MM_PER_M;
    let pitch_radius_m = 0.5 * pitch_m / libm::sin(std::f64::consts::PI / f64::from(body.teeth));
    let seated = |i: usize| libm::hypot(x_m[i] - body.x_m, y_m[i] - body.y_m) < pitch_radius_m + 0.1 * pitch_m;
    // Links come in order of the chain if it runs forward, which it also does in this sense while it stands still.
    let along: f64 = (0..n).map(|i| vx_m_s[i] * libm::cos(angle_rad[i]) + vy_m_s[i] * libm::sin(angle_rad[i])).sum();
    let next_to_come = if along < 0.0 { 1 } else { n - 1 };
    (0..n).find(|i| seated(*i) && !seated((i + next_to_come) % n)).map(|i| [x_m[i], y_m[i]])
}
