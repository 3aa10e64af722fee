//! A recording as tables: one row per link, joint, contact, sprocket and frame. Module `file` writes the files.
//!
//! The content of each table is defined once, by the functions `links`, `joints`, ... below. Each destructures its part
//! of a Frame and names every column, so that schema and content agree, and a new column of a Frame does not compile
//! until it is handled here.

mod file;

pub use file::{Format, ROWS_PER_GROUP, TableWriter};

use super::channels::CHANNELS;
use super::frame::{
    BodyInfo, Contacts, Energy, Event, Feature, Frame, Header, Impact, Joints, LinkInfo, Links, Rotors, Segment,
};
use file::Store;

/// All tables.
pub const TABLES: [Table; 10] = [
    Table { name: "links", source: Source::Frame(links) },
    Table { name: "contacts", source: Source::Frame(contacts) },
    Table { name: "joints", source: Source::Frame(joints) },
    Table { name: "rotors", source: Source::Frame(rotors) },
    Table { name: "sensors", source: Source::Frame(sensors) },
    Table { name: "energy", source: Source::Frame(energy) },
    Table { name: "events", source: Source::Event(event) },
    Table { name: "impacts", source: Source::Impact(impact) },
    Table { name: "bodies", source: Source::Body(body) },
    Table { name: "link_info", source: Source::Link(link_info) },
];

/// One kind of table.
#[derive(Clone, Copy, Debug)]
pub struct Table {
    /// Also the name of its file in a folder.
    pub name: &'static str,
    source: Source,
}

/// Source of a table's rows, and the function that makes them.
#[derive(Clone, Copy, Debug)]
enum Source {
    Frame(for<'a> fn(&Moment<'a>) -> Rows<'a>),
    Event(for<'a> fn(&'a Header, &'a Event) -> Rows<'a>),
    Impact(for<'a> fn(&'a Header, &'a Impact) -> Rows<'a>),
    /// A row per body of the header: index, body.
    Body(for<'a> fn(u32, &'a BodyInfo) -> Rows<'a>),
    /// A row per link of the header: index, link.
    Link(for<'a> fn(&'a Header, u32, &'a LinkInfo) -> Rows<'a>),
}

/// A frame, and its index in the recording.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    pub header: &'a Header,
    /// Counted from the recording's first frame.
    pub index: u64,
    pub frame: &'a Frame,
}

/// Some rows of a table, column by column.
struct Rows<'a> {
    n: usize,
    columns: Vec<Column<'a>>,
}

/// One column of some rows.
struct Column<'a> {
    name: &'static str,
    /// Unit and meaning; None: as in [`CHANNELS`], under `table.name`.
    note: Option<(&'static str, &'static str)>,
    values: Values<'a>,
}

enum Values<'a> {
    F64(&'a [f64]),
    U32(&'a [u32]),
    Bool(&'a [bool]),
    Text(Vec<&'a str>),
    /// The same value in all rows.
    EveryF64(f64),
    EveryU32(u32),
    EveryU64(u64),
    /// 0, 1, 2, ...
    Count,
}
use Values::{Bool, Count, EveryF64, EveryU32, EveryU64, F64, Text, U32};

/// A column of a Frame.
fn of<'a>(name: &'static str, values: Values<'a>) -> Column<'a> {
    Column { name, note: None, values }
}

/// A column that no Frame has.
fn own<'a>(name: &'static str, unit: &'static str, meaning: &'static str, values: Values<'a>) -> Column<'a> {
    Column { name, note: Some((unit, meaning)), values }
}

/// The common first columns of tables of frames, then `columns`.
fn stamped<'a, const N: usize>(at: &Moment<'a>, n: usize, columns: [Column<'a>; N]) -> Rows<'a> {
    let Frame {
        step,
        t_s,
        crank_angle_rad,
        state_hash: _,
        links: _,
        joints: _,
        contacts: _,
        rotors: _,
        energy: _,
        sensors: _,
    } = at.frame;
    let mut all = Vec::with_capacity(4 + N);
    all.extend([
        own("frame", "1", "Index of the frame in the recording.", EveryU64(at.index)),
        own("step", "1", "Step number; t_s = step x step_s.", EveryU64(*step)),
        own("t_s", "s", "Simulated time since the start of the recording.", EveryF64(*t_s)),
        own("crank_angle_rad", "rad", "Angle turned by the driver since step 0.", EveryF64(*crank_angle_rad)),
    ]);
    all.extend(columns);
    Rows { n, columns: all }
}

fn links<'a>(at: &Moment<'a>) -> Rows<'a> {
    let Links { x_m, y_m, angle_rad, vx_m_s, vy_m_s, omega_rad_s, ax_m_s2, ay_m_s2, alpha_rad_s2 } = &at.frame.links;
    let columns = [
        own("link", "1", "Index of the link.", Count),
        of("x_m", F64(x_m)),
        of("y_m", F64(y_m)),
        of("angle_rad", F64(angle_rad)),
        of("vx_m_s", F64(vx_m_s)),
        of("vy_m_s", F64(vy_m_s)),
        of("omega_rad_s", F64(omega_rad_s)),
        of("ax_m_s2", F64(ax_m_s2)),
        of("ay_m_s2", F64(ay_m_s2)),
        of("alpha_rad_s2", F64(alpha_rad_s2)),
    ];
    stamped(at, x_m.len(), columns)
}

fn joints<'a>(at: &Moment<'a>) -> Rows<'a> {
    let Joints { force_x_n, force_y_n, friction_torque_nm } = &at.frame.joints;
    let columns = [
        own("joint", "1", "Index of the joint: `j` joins links `j` and `j + 1`; the last closes the loop.", Count),
        of("force_x_n", F64(force_x_n)),
        of("force_y_n", F64(force_y_n)),
        of("friction_torque_nm", F64(friction_torque_nm)),
    ];
    stamped(at, force_x_n.len(), columns)
}

fn contacts<'a>(at: &Moment<'a>) -> Rows<'a> {
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
        instant_force_n,
    } = &at.frame.contacts;
    let names = |indices: &[u32], name: &dyn Fn(u32) -> &'a str| Text(indices.iter().map(|i| name(*i)).collect());
    let columns = [
        of("link", U32(link)),
        of("feature", U32(feature)),
        own("feature_name", "1", "`feature` in words.", names(feature, &|i| Feature::name(i))),
        of("body", U32(body)),
        own("body_path", "1", "Path of the body in the drive file.", names(body, &|i| body_path(at.header, i))),
        of("tooth", U32(tooth)),
        of("segment", U32(segment)),
        own("segment_name", "1", "`segment` in words.", names(segment, &|i| Segment::name(i))),
        of("point_body_x_m", F64(point_body_x_m)),
        of("point_body_y_m", F64(point_body_y_m)),
        of("point_link_x_m", F64(point_link_x_m)),
        of("point_link_y_m", F64(point_link_y_m)),
        of("normal_x", F64(normal_x)),
        of("normal_y", F64(normal_y)),
        of("penetration_m", F64(penetration_m)),
        of("approach_speed_m_s", F64(approach_speed_m_s)),
        of("normal_speed_m_s", F64(normal_speed_m_s)),
        of("tangential_speed_m_s", F64(tangential_speed_m_s)),
        of("normal_force_n", F64(normal_force_n)),
        of("tangential_force_n", F64(tangential_force_n)),
        of("stick", Bool(stick)),
        of("age_s", F64(age_s)),
        of("instant_force_n", F64(instant_force_n)),
    ];
    stamped(at, link.len(), columns)
}

fn body_path(header: &Header, body: u32) -> &str {
    header.bodies.get(body as usize).map_or("unknown body", |b| b.path.as_str())
}

fn rotors<'a>(at: &Moment<'a>) -> Rows<'a> {
    let Rotors { angle_rad, speed_rad_s, chain_torque_nm, outer_torque_nm } = &at.frame.rotors;
    let known = |i: usize| at.header.coordinates.get(i).map_or("unknown", String::as_str);
    let paths = (0..angle_rad.len()).map(known).collect();
    let columns = [
        own("rotor", "1", "Index of the sprocket, as in `bodies`, or of the arm, behind them.", Count),
        own("rotor_path", "1", "Path of the sprocket or arm in the drive file.", Text(paths)),
        of("angle_rad", F64(angle_rad)),
        of("speed_rad_s", F64(speed_rad_s)),
        of("chain_torque_nm", F64(chain_torque_nm)),
        of("outer_torque_nm", F64(outer_torque_nm)),
    ];
    stamped(at, angle_rad.len(), columns)
}

fn sensors<'a>(at: &Moment<'a>) -> Rows<'a> {
    let readings = &at.frame.sensors;
    let known = |i: usize| at.header.sensors.get(i);
    let paths = (0..readings.len()).map(|i| known(i).map_or("unknown sensor", |s| s.path.as_str())).collect();
    let units = (0..readings.len()).map(|i| known(i).map_or("", |s| s.unit.as_str())).collect();
    let columns = [
        own("sensor", "1", "Index of the sensor.", Count),
        own("sensor_path", "1", "Path of the sensor in the drive file.", Text(paths)),
        own("unit", "1", "Unit of the reading.", Text(units)),
        own("reading", "SI", "What the sensor stands at, before its gain and its errors.", F64(readings)),
    ];
    stamped(at, readings.len(), columns)
}

fn energy<'a>(at: &Moment<'a>) -> Rows<'a> {
    let Energy {
        kinetic_j,
        elastic_joint_j,
        elastic_contact_j,
        work_in_j,
        work_out_j,
        lost_pin_damping_j,
        lost_pin_friction_j,
        lost_contact_damping_j,
        lost_contact_friction_j,
        lost_guide_damping_j,
        lost_guide_friction_j,
        error_j,
        elastic_spring_j,
        lost_spring_damping_j,
    } = &at.frame.energy;
    let columns = [
        own("state_hash", "1", "XXH3-64 of the whole state.", EveryU64(at.frame.state_hash)),
        of("kinetic_j", EveryF64(*kinetic_j)),
        of("elastic_joint_j", EveryF64(*elastic_joint_j)),
        of("elastic_contact_j", EveryF64(*elastic_contact_j)),
        of("work_in_j", EveryF64(*work_in_j)),
        of("work_out_j", EveryF64(*work_out_j)),
        of("lost_pin_damping_j", EveryF64(*lost_pin_damping_j)),
        of("lost_pin_friction_j", EveryF64(*lost_pin_friction_j)),
        of("lost_contact_damping_j", EveryF64(*lost_contact_damping_j)),
        of("lost_contact_friction_j", EveryF64(*lost_contact_friction_j)),
        of("lost_guide_damping_j", EveryF64(*lost_guide_damping_j)),
        of("lost_guide_friction_j", EveryF64(*lost_guide_friction_j)),
        of("elastic_spring_j", EveryF64(*elastic_spring_j)),
        of("lost_spring_damping_j", EveryF64(*lost_spring_damping_j)),
        of("error_j", EveryF64(*error_j)),
    ];
    stamped(at, 1, columns)
}

fn event<'a>(header: &'a Header, event: &'a Event) -> Rows<'a> {
    let Event { step, t_s, kind, text, link, body, value } = event;
    let columns = vec![
        own("step", "1", "Step number; t_s = step x step_s, rounded.", EveryU64(*step)),
        own("t_s", "s", "Simulated time since the start of the recording.", EveryF64(*t_s)),
        own("kind", "1", "What happened, e.g. first_touch.", Text(vec![kind])),
        own("link", "1", "Index of the link.", EveryU32(*link)),
        own("body", "1", "Index of the body, as in `bodies`.", EveryU32(*body)),
        own("body_path", "1", "Path of the body in the drive file.", Text(vec![body_path(header, *body)])),
        own("value", "as the text says", "Quantity the event is about, e.g. the approach speed.", EveryF64(*value)),
        own("text", "1", "One sentence, with numbers and units.", Text(vec![text])),
    ];
    Rows { n: 1, columns }
}

fn impact<'a>(header: &'a Header, impact: &'a Impact) -> Rows<'a> {
    let Impact {
        link,
        feature,
        body,
        tooth,
        segment,
        step,
        t_s,
        approach_speed_m_s,
        peak_force_n,
        peak_after_s,
        impulse_n_s,
        rise_time_s,
        second_period_mean_n,
        x_m,
        y_m,
        watched_s,
    } = impact;
    let names = [Feature::name(*feature), body_path(header, *body), Segment::name(*segment)];
    let columns = vec![
        own("step", "1", "Step of the first touch.", EveryU64(*step)),
        own("t_s", "s", "Its simulated time.", EveryF64(*t_s)),
        own("link", "1", "Index of the link.", EveryU32(*link)),
        own("feature", "1", "What of the link touches, as in `contacts`.", EveryU32(*feature)),
        own("feature_name", "1", "The same in words.", Text(vec![names[0]])),
        own("body", "1", "Index of the body, as in `bodies`.", EveryU32(*body)),
        own("body_path", "1", "Path of the body in the drive file.", Text(vec![names[1]])),
        own("tooth", "1", "Tooth gap of a sprocket; 0 on a guide.", EveryU32(*tooth)),
        own("segment", "1", "Element of the body, as in `contacts`.", EveryU32(*segment)),
        own("segment_name", "1", "The same in words.", Text(vec![names[2]])),
        own(
            "approach_speed_m_s",
            "m/s",
            "Closing speed along the normal at first touch.",
            EveryF64(*approach_speed_m_s),
        ),
        own("peak_force_n", "N", "Largest normal force within two tooth periods.", EveryF64(*peak_force_n)),
        own("peak_after_s", "s", "Its time after the first touch.", EveryF64(*peak_after_s)),
        own("impulse_n_s", "N s", "Until the force has fallen to half its peak.", EveryF64(*impulse_n_s)),
        own("rise_time_s", "s", "From a tenth to nine tenths of the peak.", EveryF64(*rise_time_s)),
        own("second_period_mean_n", "N", "Mean force over the second tooth period.", EveryF64(*second_period_mean_n)),
        own("x_m", "m", "Place of the first touch, x.", EveryF64(*x_m)),
        own("y_m", "m", "Place of the first touch, y.", EveryF64(*y_m)),
        own("watched_s", "s", "How long it was watched.", EveryF64(*watched_s)),
    ];
    Rows { n: 1, columns }
}

fn body<'a>(index: u32, body: &'a BodyInfo) -> Rows<'a> {
    // An outline is a list of its own and is not exported.
    let BodyInfo { path, rotor, x_m, y_m, angle_rad, teeth, outline: _, coordinate } = body;
    let columns = vec![
        own("body", "1", "Index of the body: sprockets first, then guides, then rails.", EveryU32(index)),
        own("path", "1", "Path in the drive file.", Text(vec![path])),
        own("rotor", "1", "True: a sprocket.", Bool(std::slice::from_ref(rotor))),
        own(
            "coordinate",
            "1",
            "Index in `rotors` of what it turns by; -1: it stands still.",
            EveryF64(coordinate.map_or(-1.0, f64::from)),
        ),
        own("x_m", "m", "Origin of the body's frame, x; a sprocket's axis.", EveryF64(*x_m)),
        own("y_m", "m", "Origin of the body's frame, y.", EveryF64(*y_m)),
        own("angle_rad", "rad", "Rotation of a guide's frame; of what turns, at angle zero.", EveryF64(*angle_rad)),
        own("teeth", "1", "Number of teeth; 0 for a guide.", EveryU32(*teeth)),
    ];
    Rows { n: 1, columns }
}

fn link_info<'a>(header: &'a Header, index: u32, link: &'a LinkInfo) -> Rows<'a> {
    let LinkInfo { outline, pitch_m, mass_kg, inertia_kg_m2, ahead } = link;
    let name = header.link_outlines.get(*outline as usize).map_or("unknown outline", |o| o.name.as_str());
    let columns = vec![
        own("link", "1", "Index of the link.", EveryU32(index)),
        own("outline", "1", "Index of the link's outline.", EveryU32(*outline)),
        own("outline_name", "1", "Its name: the link's row.", Text(vec![name])),
        own("pitch_m", "m", "Pin-to-pin distance, unloaded.", EveryF64(*pitch_m)),
        own("mass_kg", "kg", "Mass.", EveryF64(*mass_kg)),
        own("inertia_kg_m2", "kg m2", "Moment of inertia about the centre of mass.", EveryF64(*inertia_kg_m2)),
        own("ahead", "1", "Index of the link ahead, behind the front joint.", EveryU32(*ahead)),
    ];
    Rows { n: 1, columns }
}

/// Name, unit and meaning of a column, and how its values are stored.
#[derive(Clone, Debug)]
pub struct ColumnInfo {
    pub name: &'static str,
    pub unit: &'static str,
    pub meaning: &'static str,
    /// Whether it has the same value in all rows of a frame.
    repeats: bool,
    /// An empty store of its type.
    store: Store,
}

impl Table {
    /// All columns in order.
    pub fn columns(&self) -> Vec<ColumnInfo> {
        let (header, frame, happened) = (Header::default(), Frame::default(), Event::default());
        let (one_body, one_link, hit) = (BodyInfo::default(), LinkInfo::default(), Impact::default());
        let rows = match self.source {
            Source::Frame(rows) => rows(&Moment { header: &header, index: 0, frame: &frame }),
            Source::Event(rows) => rows(&header, &happened),
            Source::Impact(rows) => rows(&header, &hit),
            Source::Body(rows) => rows(0, &one_body),
            Source::Link(rows) => rows(&header, 0, &one_link),
        };
        rows.columns.iter().map(|column| self.info(column)).collect()
    }

    fn info(&self, column: &Column<'_>) -> ColumnInfo {
        let name = column.name;
        let (unit, meaning) = column.note.unwrap_or_else(|| {
            let full = format!("{}.{name}", self.name);
            let found = CHANNELS.iter().find(|(channel, _, _)| *channel == full);
            assert!(found.is_some(), "{full} has no unit and meaning in CHANNELS");
            found.map_or(("", ""), |(_, unit, meaning)| (unit, meaning))
        });
        let repeats = matches!(column.values, EveryF64(_) | EveryU32(_) | EveryU64(_));
        ColumnInfo { name, unit, meaning, repeats, store: Store::of(&column.values) }
    }
}
