//! A recording as tables: one row per link, joint, contact, sprocket and frame. Module `file` writes the files.
//!
//! Tables of a frame, events, impacts and links have the columns of their messages, in order, and what is added to them
//! here: the frame before, the row's own index, and names beside numbers.

mod file;

pub use file::{Format, ROWS_PER_GROUP, TableWriter};

use super::columns::{self, Column, ColumnKind, Rows};
use super::frame::{
    BodyInfo, BodyKind, Chambers, Contacts, Energy, Event, Feature, Frame, Header, Impact, Joints, LinkInfo, Links,
    Passages, RollerInfo, Rollers, Rotors, Segment, Sliders, Spans, Touches,
};
use file::Store;

/// All tables.
pub const TABLES: [Table; 17] = [
    Table { name: "links", source: Source::Table(&Links::TABLE) },
    Table { name: "contacts", source: Source::Table(&Contacts::TABLE) },
    Table { name: "joints", source: Source::Table(&Joints::TABLE) },
    Table { name: "rotors", source: Source::Table(&Rotors::TABLE) },
    Table { name: "sliders", source: Source::Table(&Sliders::TABLE) },
    Table { name: "rollers", source: Source::Table(&Rollers::TABLE) },
    Table { name: "touches", source: Source::Table(&Touches::TABLE) },
    Table { name: "chambers", source: Source::Table(&Chambers::TABLE) },
    Table { name: "passages", source: Source::Table(&Passages::TABLE) },
    Table { name: "spans", source: Source::Table(&Spans::TABLE) },
    Table { name: "sensors", source: Source::Frame(sensors) },
    Table { name: "energy", source: Source::Frame(energy) },
    Table { name: "events", source: Source::Event },
    Table { name: "impacts", source: Source::Impact },
    Table { name: "bodies", source: Source::Body },
    Table { name: "link_info", source: Source::Link },
    Table { name: "roller_info", source: Source::Roller },
];

/// One kind of table.
#[derive(Clone, Copy, Debug)]
pub struct Table {
    /// Also the name of its file in a folder.
    pub name: &'static str,
    source: Source,
}

/// Source of a table's rows.
#[derive(Clone, Copy, Debug)]
enum Source {
    /// A table of each frame.
    Table(&'static columns::TableInfo),
    /// Each frame.
    Frame(for<'a> fn(&Moment<'a>) -> Block<'a>),
    Event,
    Impact,
    /// A row per body of the header.
    Body,
    /// A row per link of the header.
    Link,
    /// A row per roller of the header.
    Roller,
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
struct Block<'a> {
    n: usize,
    columns: Vec<Cells<'a>>,
}

/// One column of some rows.
struct Cells<'a> {
    name: &'static str,
    unit: &'static str,
    meaning: &'static str,
    values: Values<'a>,
}

enum Values<'a> {
    F64(&'a [f64]),
    U32(&'a [u32]),
    U64(&'a [u64]),
    Bool(&'a [bool]),
    Text(Vec<&'a str>),
    /// The same value in all rows.
    EveryF64(f64),
    EveryU32(u32),
    EveryU64(u64),
    /// 0, 1, 2, ...
    Count,
}
use Values::{Bool, Count, EveryF64, EveryU32, EveryU64, F64, Text, U32, U64};

/// A column or field of a message.
fn of<'a>(column: &Column, values: Values<'a>) -> Cells<'a> {
    Cells { name: column.name, unit: column.unit, meaning: column.meaning, values }
}

/// A column that no message has.
fn own<'a>(name: &'static str, unit: &'static str, meaning: &'static str, values: Values<'a>) -> Cells<'a> {
    Cells { name, unit, meaning, values }
}

/// Adds columns of a message, and beside a number what it stands for.
fn add<'a>(to: &mut Vec<Cells<'a>>, header: &'a Header, columns: &[Column], values: impl Iterator<Item = Values<'a>>) {
    for (column, values) in columns.iter().zip(values) {
        let names = |name: &dyn Fn(u32) -> &'a str| match &values {
            U32(indices) => Text(indices.iter().map(|i| name(*i)).collect()),
            EveryU32(index) => Text(vec![name(*index)]),
            F64(_) | U64(_) | Bool(_) | Text(_) | EveryF64(_) | EveryU64(_) | Count => Text(Vec::new()),
        };
        let words = match column.kind {
            ColumnKind::Feature => Some(own("feature_name", "1", "`feature` in words.", names(&|i| Feature::name(i)))),
            ColumnKind::Segment => Some(own("segment_name", "1", "`segment` in words.", names(&|i| Segment::name(i)))),
            ColumnKind::Body => {
                Some(own("body_path", "1", "Path of the body in the drive file.", names(&|i| body_path(header, i))))
            }
            ColumnKind::Value | ColumnKind::Height | ColumnKind::Link => None,
            ColumnKind::Kinetic
            | ColumnKind::Elastic
            | ColumnKind::WorkIn
            | ColumnKind::WorkOut
            | ColumnKind::Lost
            | ColumnKind::Error => None,
        };
        to.push(of(column, values));
        to.extend(words);
    }
}

/// Values of a table.
fn many<'a>(values: &columns::ColumnValues<'a>) -> Values<'a> {
    match *values {
        columns::ColumnValues::F64(v) => F64(v),
        columns::ColumnValues::U32(v) => U32(v),
        columns::ColumnValues::U64(v) => U64(v),
        columns::ColumnValues::Bool(v) => Bool(v),
        columns::ColumnValues::Text(v) => Text(v.iter().map(String::as_str).collect()),
    }
}

/// The value of a field.
fn one<'a>(values: columns::ColumnValues<'a>) -> Values<'a> {
    match values {
        columns::ColumnValues::F64(&[v]) => EveryF64(v),
        columns::ColumnValues::U32(&[v]) => EveryU32(v),
        columns::ColumnValues::U64(&[v]) => EveryU64(v),
        columns::ColumnValues::F64(_) | columns::ColumnValues::U32(_) | columns::ColumnValues::U64(_) => many(&values),
        columns::ColumnValues::Bool(_) | columns::ColumnValues::Text(_) => many(&values),
    }
}

/// The common first columns of tables of frames.
fn stamp<'a>(at: &Moment<'a>) -> Vec<Cells<'a>> {
    let Frame { step, t_s, crank_angle_rad, .. } = at.frame;
    vec![
        own("frame", "1", "Index of the frame in the recording.", EveryU64(at.index)),
        own("step", "1", "Step number; t_s = step x step_s.", EveryU64(*step)),
        own("t_s", "s", "Simulated time since the start of the recording.", EveryF64(*t_s)),
        own("crank_angle_rad", "rad", "Angle turned by the driver since step 0.", EveryF64(*crank_angle_rad)),
    ]
}

/// A table of a frame.
fn table<'a>(at: &Moment<'a>, wanted: &columns::TableInfo) -> Block<'a> {
    let mut sheet = Block { n: 0, columns: stamp(at) };
    at.frame.each_table(|table, values| {
        if table.tag != wanted.tag {
            return;
        }
        sheet.n = values.first().map_or(0, columns::ColumnValues::len);
        let joint = "Index of the joint: `j` joins links `j` and `j + 1`; the last closes the loop.";
        match table.rows {
            Rows::Link => sheet.columns.push(own("link", "1", "Index of the link.", Count)),
            Rows::Joint => sheet.columns.push(own("joint", "1", joint, Count)),
            Rows::Contact => {}
            Rows::Roller => sheet.columns.push(own("roller", "1", "Index of the roller.", Count)),
            Rows::Rotor | Rows::Slider | Rows::Touch | Rows::Chamber | Rows::Passage | Rows::Span => {
                let known = at.header.row_paths(table.rows).unwrap_or_default();
                let paths = (0..sheet.n).map(|i| known.get(i).map_or("unknown", String::as_str)).collect();
                let index = "Index of the row, as in the header.";
                sheet.columns.push(own(table.rows.name(), "1", index, Count));
                sheet.columns.push(own(table.rows.path_column(), "1", "Its path in the drive file.", Text(paths)));
            }
        }
        add(&mut sheet.columns, at.header, table.message.columns, values.iter().map(many));
    });
    sheet
}

fn body_path(header: &Header, body: u32) -> &str {
    header.bodies.get(body as usize).map_or("unknown body", |b| b.path.as_str())
}

fn sensors<'a>(at: &Moment<'a>) -> Block<'a> {
    let readings = &at.frame.sensors;
    let known = |i: usize| at.header.sensors.get(i);
    let paths = (0..readings.len()).map(|i| known(i).map_or("unknown sensor", |s| s.path.as_str())).collect();
    let units = (0..readings.len()).map(|i| known(i).map_or("", |s| s.unit.as_str())).collect();
    let mut columns = stamp(at);
    columns.extend([
        own("sensor", "1", "Index of the sensor.", Count),
        own("sensor_path", "1", "Path of the sensor in the drive file.", Text(paths)),
        own("unit", "1", "Unit of the reading.", Text(units)),
        own("reading", "SI", "What the sensor stands at, before its gain and its errors.", F64(readings)),
    ]);
    Block { n: readings.len(), columns }
}

fn energy<'a>(at: &Moment<'a>) -> Block<'a> {
    let mut columns = stamp(at);
    columns.push(own("state_hash", "1", "XXH3-64 of the whole state.", EveryU64(at.frame.state_hash)));
    add(&mut columns, at.header, Energy::MESSAGE.columns, at.frame.energy.values().into_iter().map(one));
    Block { n: 1, columns }
}

fn event<'a>(header: &'a Header, event: &'a Event) -> Block<'a> {
    let mut columns = Vec::new();
    add(&mut columns, header, Event::MESSAGE.columns, event.values().into_iter().map(one));
    Block { n: 1, columns }
}

fn impact<'a>(header: &'a Header, impact: &'a Impact) -> Block<'a> {
    let mut columns = Vec::new();
    add(&mut columns, header, Impact::MESSAGE.columns, impact.values().into_iter().map(one));
    Block { n: 1, columns }
}

fn body<'a>(index: u32, body: &'a BodyInfo) -> Block<'a> {
    // An outline is a list of its own and is not exported.
    let BodyInfo { path, rotor, x_m, y_m, angle_rad, teeth, outline: _, coordinate, slider, shifts, .. } = body;
    let BodyInfo { kind, low_stop, high_stop, .. } = body;
    let index_or_none = |row: &Option<u32>| EveryF64(row.map_or(-1.0, f64::from));
    let number_or_none = |limit: &Option<f64>| EveryF64(limit.unwrap_or(f64::NAN));
    let columns = vec![
        own(
            "body",
            "1",
            "Index of the body: sprockets first, then guides, then rails, then what no chain touches.",
            EveryU32(index),
        ),
        own("path", "1", "Path in the drive file.", Text(vec![path])),
        own("rotor", "1", "True: a sprocket.", Bool(std::slice::from_ref(rotor))),
        own(
            "coordinate",
            "1",
            "Index in `rotors` of what it turns by; -1: it does not turn.",
            index_or_none(coordinate),
        ),
        own("x_m", "m", "Origin of the body's frame, x; a sprocket's axis.", EveryF64(*x_m)),
        own("y_m", "m", "Origin of the body's frame, y.", EveryF64(*y_m)),
        own("angle_rad", "rad", "Rotation of a guide's frame; of what turns, at angle zero.", EveryF64(*angle_rad)),
        own("teeth", "1", "Number of teeth; 0 for all but sprockets.", EveryU32(*teeth)),
        own("slider", "1", "Index in `sliders` of what it slides by; -1: it does not slide.", index_or_none(slider)),
        own(
            "bearing",
            "1",
            "Index in `sliders` of the first of both ways of its bearing; -1: its axis stands still.",
            index_or_none(&shifts.first().map(|shift| shift.slider)),
        ),
        own(
            "kind",
            "1",
            "What it is: 0 sprocket, 1 guide, 2 rail, 3 arm, 4 slider, 5 housing, 6 ball.",
            EveryU32(*kind),
        ),
        own("kind_name", "1", "`kind` in words.", Text(vec![BodyKind::name(*kind)])),
        own("low_stop", "rad or m", "Lower end of its way; not a number where it has none.", number_or_none(low_stop)),
        own(
            "high_stop",
            "rad or m",
            "Upper end of its way; not a number where it has none.",
            number_or_none(high_stop),
        ),
    ];
    Block { n: 1, columns }
}

fn link_info<'a>(header: &'a Header, index: u32, link: &'a LinkInfo) -> Block<'a> {
    let name = header.link_outlines.get(link.outline as usize).map_or("unknown outline", |o| o.name.as_str());
    let mut columns = vec![own("link", "1", "Index of the link.", EveryU32(index))];
    add(&mut columns, header, LinkInfo::MESSAGE.columns, link.values().into_iter().map(one));
    columns.insert(2, own("outline_name", "1", "Its name: the link's row.", Text(vec![name])));
    Block { n: 1, columns }
}

fn roller_info<'a>(header: &'a Header, index: u32, roller: &'a RollerInfo) -> Block<'a> {
    let mut columns = vec![own("roller", "1", "Index of the roller.", EveryU32(index))];
    add(&mut columns, header, RollerInfo::MESSAGE.columns, roller.values().into_iter().map(one));
    Block { n: 1, columns }
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
        let one_roller = RollerInfo::default();
        let rows = match self.source {
            Source::Table(of) => table(&Moment { header: &header, index: 0, frame: &frame }, of),
            Source::Frame(rows) => rows(&Moment { header: &header, index: 0, frame: &frame }),
            Source::Event => event(&header, &happened),
            Source::Impact => impact(&header, &hit),
            Source::Body => body(0, &one_body),
            Source::Link => link_info(&header, 0, &one_link),
            Source::Roller => roller_info(&header, 0, &one_roller),
        };
        rows.columns
            .iter()
            .map(|Cells { name, unit, meaning, values }| {
                let repeats = matches!(values, EveryF64(_) | EveryU32(_) | EveryU64(_));
                ColumnInfo { name, unit, meaning, repeats, store: Store::of(values) }
            })
            .collect()
    }
}
