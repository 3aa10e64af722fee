//! A number of every frame, by its name: quantities of break expressions (`sprocket.driven.speed`, `joint[3].force`), sensors
//! (`sensors.KIND.NAME`), tensions of spans (`span.LEAVES.REACHES.tension`), forces on mounts (`mount.NAME.x`, `.y`, `.force`), and columns of tables as `export` writes them
//! (`joints.force_x_n[3]`, `rotors.driven.speed_rad_s`, `energy.kinetic_j`).

use super::audit::Topology;
use super::audit::spans::{SpanEnds, spans_of};
use super::mounts::{Mount, mounts};
use crate::breakpoint::quantities::{QUANTITIES, Quantity, Scope};
use crate::breakpoint::{Names, Number, in_frame, parse};
use crate::diag::{last_name, nearest};
use crate::recording::columns::{ColumnValues, Rows};
use crate::recording::frame::{BodyInfo, Energy, Frame, Header, TABLES};

/// Where a number stands in a frame.
#[derive(Clone, Debug, PartialEq)]
enum SignalSource {
    Expression(Number),
    Sensor(usize),
    Span(SpanEnds),
    /// Table, column and row.
    Column(usize, usize, usize),
    Account(usize),
    Mount(Mount, MountAxis),
}

/// Which number of a force on a mount.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MountAxis {
    X,
    Y,
    Size,
}

/// A number of every frame.
#[derive(Clone, Debug)]
pub struct Signal {
    pub name: String,
    /// SI; empty for plain numbers.
    pub unit: String,
    source: SignalSource,
    names: Names,
    topology: Topology,
}

/// Why a recording has no such number: one sentence, and what helps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownSignal(String);

impl std::fmt::Display for UnknownSignal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for UnknownSignal {}

impl Signal {
    /// Finds a quantity by its name.
    ///
    /// # Errors
    /// There is none, or several have this name: one sentence, and what was probably meant.
    pub fn find(name: &str, header: &Header) -> Result<Signal, UnknownSignal> {
        let names = names(header);
        let made = |source, unit: &str| {
            let topology = Topology::of(header);
            Ok(Signal { name: name.to_string(), unit: unit.to_string(), source, names: names.clone(), topology })
        };
        if let Some(k) = header.sensors.iter().position(|s| s.path == name) {
            return made(SignalSource::Sensor(k), &header.sensors[k].unit);
        }
        if let Some(ends) = span(name, header) {
            return made(SignalSource::Span(ends), "N");
        }
        if let Some((mount, axis)) = mount(name, header)? {
            return made(SignalSource::Mount(mount, axis), "N");
        }
        if let Some(k) = Energy::MESSAGE.columns.iter().position(|c| c.channel == name) {
            return made(SignalSource::Account(k), "J");
        }
        if let Some((table, column, row)) = column(name, header)? {
            let unit = TABLES[table].message.columns[column].unit;
            return made(SignalSource::Column(table, column, row), if unit == "1" { "" } else { unit });
        }
        match parse::quantity(name, &names) {
            Ok((number, quantity)) => {
                is_one(&number, quantity)?;
                made(SignalSource::Expression(number), quantity.dimension.si())
            }
            Err(report) => {
                let all = known(header, &names);
                let help = match nearest(name, all.iter().map(String::as_str)) {
                    Some(near) => format!("did you mean `{near}`?"),
                    None => format!("{report}").lines().last().unwrap_or_default().trim().to_string(),
                };
                let sensors: Vec<&str> = header.sensors.iter().map(|s| s.path.as_str()).collect();
                let sensors =
                    if sensors.is_empty() { String::new() } else { format!("; sensors: {}", sensors.join(", ")) };
                Err(UnknownSignal(format!(
                    "this recording has no quantity `{name}`\nhelp: {}{sensors}",
                    help.trim_start_matches("= help: ")
                )))
            }
        }
    }

    /// Its value in a frame; None where it has none.
    pub fn value(&self, frame: &Frame, header: &Header) -> Option<f64> {
        match &self.source {
            SignalSource::Expression(number) => in_frame(number, frame, &self.names.chains),
            SignalSource::Sensor(k) => frame.sensors.get(*k).copied(),
            SignalSource::Span(ends) => {
                spans_of(frame, header, &self.topology).into_iter().find(|(own, _)| own == ends).map(|(_, force)| force)
            }
            SignalSource::Mount(mount, axis) => {
                let [x, y] = mount.force(frame);
                Some(match axis {
                    MountAxis::X => x,
                    MountAxis::Y => y,
                    MountAxis::Size => libm::hypot(x, y),
                })
            }
            SignalSource::Account(k) => frame.energy.accounts().nth(*k).map(|(_, value)| value),
            SignalSource::Column(table, column, row) => {
                let (mut number, mut value) = (0, None);
                frame.each_table(|_, columns| {
                    if number == *table {
                        value = columns.get(*column).and_then(|values| float(values, *row));
                    }
                    number += 1;
                });
                value
            }
        }
    }
}

fn float(values: &ColumnValues<'_>, row: usize) -> Option<f64> {
    match values {
        ColumnValues::F64(v) => v.get(row).copied(),
        ColumnValues::U32(v) => v.get(row).map(|v| f64::from(*v)),
        ColumnValues::Bool(v) => v.get(row).map(|v| f64::from(u8::from(*v))),
        ColumnValues::U64(_) | ColumnValues::Text(_) => None,
    }
}

/// Whether a quantity is one number a frame.
fn is_one(number: &Number, quantity: &Quantity) -> Result<(), UnknownSignal> {
    let Number::Quantity { index, .. } = number else { return Err(UnknownSignal("this never changes".into())) };
    let (scope, name) = (quantity.scope.name(), quantity.name);
    match quantity.scope {
        Scope::Link | Scope::Joint if index.is_none() => Err(UnknownSignal(format!(
            "`{scope}.{name}` is of every {scope}\nhelp: choose one, e.g. `{scope}[12].{name}`"
        ))),
        Scope::Contact | Scope::Impact => Err(UnknownSignal(format!(
            "`{scope}.{name}` is of contacts, which come and go\nhelp: e.g. `sprocket.NAME.chain_torque` sums them up; `pitchline impacts` lists impacts"
        ))),
        Scope::Link | Scope::Joint | Scope::Sprocket | Scope::Shaft | Scope::Arm | Scope::Slider => Ok(()),
        Scope::Ball | Scope::Touch | Scope::Chamber | Scope::Reservoir | Scope::Passage | Scope::Span => Ok(()),
        Scope::Energy | Scope::Run => Ok(()),
    }
}

/// Names of what a recording holds.
fn names(header: &Header) -> Names {
    let own = header.bodies.iter().filter(|b| b.rotor);
    let mut turning: Vec<(String, usize)> =
        own.filter_map(|b| Some((b.path.clone(), b.coordinate? as usize))).collect();
    for (row, path) in header.coordinates.iter().enumerate() {
        if turning.iter().all(|(known, _)| known != path) {
            turning.push((path.clone(), row));
        }
    }
    Names {
        bodies: header.bodies.iter().map(|b| b.path.clone()).collect(),
        turning,
        rows: [Rows::Slider, Rows::Touch, Rows::Chamber, Rows::Passage, Rows::Span]
            .map(|rows| (rows, header.row_paths(rows).unwrap_or_default().to_vec()))
            .to_vec(),
        chains: header.chains().iter().map(ExactSizeIterator::len).collect(),
    }
}

/// `span.LEAVES.REACHES.tension`.
fn span(name: &str, header: &Header) -> Option<SpanEnds> {
    let words: Vec<&str> = name.split('.').collect();
    let ["span", from, to, "tension"] = words.as_slice() else { return None };
    // A path, or its last word where one sprocket alone has it.
    let body = |wanted: &str| {
        let named = |b: &BodyInfo| b.rotor && (b.path == wanted || last_name(&b.path) == wanted);
        let mut found = header.bodies.iter().enumerate().filter(|(_, b)| named(b));
        let (body, _) = found.next()?;
        found.next().is_none().then_some(body)
    };
    Some((body(from)?, body(to)?)).filter(|(from, to)| from != to)
}

/// `mount.NAME.x`, `.y` or `.force`, by the path of what it carries or its last word.
fn mount(name: &str, header: &Header) -> Result<Option<(Mount, MountAxis)>, UnknownSignal> {
    let Some(rest) = name.strip_prefix("mount.") else { return Ok(None) };
    let all = mounts(header).map_err(UnknownSignal)?;
    let paths: Vec<String> = all.iter().map(|m| m.path.clone()).collect();
    let axis = |word: &str| match word {
        "x" => Some(MountAxis::X),
        "y" => Some(MountAxis::Y),
        "force" => Some(MountAxis::Size),
        _ => None,
    };
    // A part of the chain drive goes before the cams of its shaft, and before valves that are called so.
    let of_valve_trains = |path: &str| path.starts_with("cams.") || path.starts_with("head.");
    let named = |path: &str| {
        let is_so_called = |row: &usize| paths.get(*row).is_some_and(|p| last_name(p) == path && !of_valve_trains(p));
        let mut others = (0..paths.len()).filter(is_so_called);
        one_row(&paths, path).or_else(|| others.next().filter(|_| others.next().is_none()))
    };
    let found = rest.rsplit_once('.').and_then(|(path, word)| Some((named(path)?, axis(word)?)));
    match found {
        Some((row, axis)) => Ok(all.into_iter().nth(row).map(|mount| (mount, axis))),
        None => Err(UnknownSignal(format!(
            "`{name}` names no force on a mount\nhelp: `mount.NAME.x`, `.y` or `.force`; names: {}",
            paths.join(", ")
        ))),
    }
}

/// The row of a path, or of its last word where one path alone ends so. A part of the drive goes before what an effect adds under its name.
fn one_row(paths: &[String], wanted: &str) -> Option<usize> {
    let exact = paths.iter().position(|p| p == wanted);
    let one_of = |added: bool| {
        let is_so_called = |p: &String| last_name(p) == wanted && p.starts_with("effects.") == added;
        let mut by_word = (0..paths.len()).filter(|row| paths.get(*row).is_some_and(is_so_called));
        by_word.next().filter(|_| by_word.next().is_none())
    };
    exact.or_else(|| one_of(false)).or_else(|| one_of(true))
}

/// `TABLE.COLUMN[ROW]` or `TABLE.NAME.COLUMN`: table, column, row.
fn column(name: &str, header: &Header) -> Result<Option<(usize, usize, usize)>, UnknownSignal> {
    let Some((table_name, rest)) = name.split_once('.') else { return Ok(None) };
    let Some(table) = TABLES.iter().position(|t| t.message.name == table_name) else { return Ok(None) };
    let info = &TABLES[table];
    let rows = match info.rows {
        Rows::Link | Rows::Joint => header.links.len(),
        Rows::Contact => {
            return Err(UnknownSignal(format!("rows of `{table_name}` come and go: they have no spectrum")));
        }
        Rows::Roller => header.rollers.len(),
        Rows::Rotor | Rows::Slider | Rows::Touch | Rows::Chamber | Rows::Passage | Rows::Span => {
            header.row_paths(info.rows).map_or(0, <[String]>::len)
        }
    };
    let of = |wanted: &str| {
        let own = info.message.columns.iter();
        own.clone().position(|c| c.name == wanted).ok_or_else(|| {
            let names: Vec<&str> = own.map(|c| c.name).collect();
            let help = nearest(wanted, names.iter().copied());
            let help =
                help.map_or_else(|| format!("it has {}", names.join(", ")), |near| format!("did you mean `{near}`?"));
            UnknownSignal(format!("table `{table_name}` has no column `{wanted}`\nhelp: {help}"))
        })
    };
    if let Some((wanted, index)) = rest.strip_suffix(']').and_then(|r| r.split_once('[')) {
        let row = index.parse::<usize>().ok().filter(|row| *row < rows);
        let row = row.ok_or_else(|| {
            UnknownSignal(format!("`{table_name}` has no row `{index}`: it has {rows}, counted from 0"))
        })?;
        return Ok(Some((table, of(wanted)?, row)));
    }
    let paths = header.row_paths(info.rows).unwrap_or_default();
    let found = rest.rsplit_once('.').and_then(|(path, wanted)| Some((wanted, one_row(paths, path)?)));
    match found {
        Some((wanted, row)) => Ok(Some((table, of(wanted)?, row))),
        None => {
            let row = if paths.is_empty() { "[12]".to_string() } else { "[0]".to_string() };
            let column = info.message.columns.first().map_or("", |c| c.name);
            let rows = if paths.is_empty() { String::new() } else { format!("; rows: {}", paths.join(", ")) };
            Err(UnknownSignal(format!(
                "`{name}` names no row of table `{table_name}`\nhelp: e.g. `{table_name}.{column}{row}`{rows}"
            )))
        }
    }
}

/// Names that there are, for those who mistype one.
fn known(header: &Header, names: &Names) -> Vec<String> {
    let mut all: Vec<String> = header.sensors.iter().map(|s| s.path.clone()).collect();
    let paths = |rows: Rows| -> Vec<&String> {
        let own = names.rows.iter().filter(|(r, _)| *r == rows).flat_map(|(_, paths)| paths);
        let turning = names.turning.iter().map(|(path, _)| path).filter(|_| rows == Rows::Rotor);
        turning.chain(own).collect()
    };
    for quantity in &QUANTITIES {
        let scope = quantity.scope.name();
        if let Some((rows, _)) = quantity.scope.named_rows() {
            let own = paths(rows).into_iter().filter_map(|p| quantity.scope.short_name(p));
            all.extend(own.map(|own| format!("{scope}.{own}.{}", quantity.name)));
        } else if matches!(quantity.scope, Scope::Link | Scope::Joint) {
            all.push(format!("{scope}[12].{}", quantity.name));
        } else if quantity.scope == Scope::Energy {
            all.push(format!("{scope}.{}", quantity.name));
        }
    }
    let carried = mounts(header).unwrap_or_default();
    all.extend(carried.iter().flat_map(|m| ["x", "y", "force"].map(|axis| format!("mount.{}.{axis}", m.path))));
    let sprockets: Vec<&str> = header.bodies.iter().filter(|b| b.rotor).map(|b| last_name(&b.path)).collect();
    for from in &sprockets {
        all.extend(sprockets.iter().filter(|to| *to != from).map(|to| format!("span.{from}.{to}.tension")));
    }
    all
}
