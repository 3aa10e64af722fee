//! Tables of recordings: every value equals the Frame's to the bit, in Parquet and CSV, also for other readers; errors
//! and full disks are reported and leave no files behind.

#[allow(dead_code)]
#[path = "common/readers.rs"]
mod readers;

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use pitchline::recording::columns::{self, ColumnValues, Rows};
use pitchline::recording::frame::{self, Event, Feature, Frame, Header, Impact, Segment, channels};
use pitchline::recording::mcap::{self, Recording};
use pitchline::recording::table::{Format, Moment, ROWS_PER_GROUP, TABLES, TableWriter};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn samples() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/samples");
    ["bush-20-40", "silent-20-40", "smartchain-20-40"].map(|name| folder.join(format!("{name}.mcap"))).to_vec()
}

fn export(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pitchline")).arg("export").args(args).output().expect("the program starts")
}

fn done(args: &[&str]) -> serde_json::Value {
    let out = export(&[args, &["--json"]].concat());
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).expect("stdout is one JSON document")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("text")
}

/// A value, floats as their bits.
#[derive(Clone, Debug, PartialEq)]
enum Cell {
    Float(u64),
    Whole(u64),
    Truth(bool),
    Text(String),
}

fn float(x: f64) -> Cell {
    Cell::Float(x.to_bits())
}

fn whole(x: impl Into<u64>) -> Cell {
    Cell::Whole(x.into())
}

fn words(x: &str) -> Cell {
    Cell::Text(x.to_string())
}

/// Names of columns, and rows.
type Sheet = (Vec<&'static str>, Vec<Vec<Cell>>);

const STAMP: [&str; 4] = ["frame", "step", "t_s", "crank_angle_rad"];

/// Rows of a table of frames: `n` rows per frame, `cells` makes the rest of a row.
fn per_frame(
    recording: &Recording,
    names: &[&'static str],
    n: impl Fn(&Frame) -> usize,
    cells: impl Fn(&Frame, usize) -> Vec<Cell>,
) -> Sheet {
    let mut rows = Vec::new();
    for (index, frame) in recording.frames.iter().enumerate() {
        for i in 0..n(frame) {
            let mut row = vec![whole(index as u64), whole(frame.step), float(frame.t_s), float(frame.crank_angle_rad)];
            row.extend(cells(frame, i));
            rows.push(row);
        }
    }
    (STAMP.iter().chain(names).copied().collect(), rows)
}

/// Expected content of a table, written independently.
fn expected(table: &str, recording: &Recording) -> Sheet {
    if let Some(table) = frame::TABLES.iter().find(|t| t.message.name == table) {
        return expected_rows(table, recording);
    }
    match table {
        "sensors" => per_frame(
            recording,
            &["sensor", "sensor_path", "unit", "reading"],
            |f| f.sensors.len(),
            |f, i| {
                let s = &recording.header.sensors[i];
                vec![whole(i as u64), words(&s.path), words(&s.unit), float(f.sensors[i])]
            },
        ),
        "energy" => expected_energy(recording),
        "events" => {
            let names = ["step", "t_s", "kind", "link", "body", "body_path", "value", "text"];
            let row = |e: &Event| {
                let path = words(&recording.header.bodies[e.body as usize].path);
                let (link, body) = (whole(e.link), whole(e.body));
                vec![whole(e.step), float(e.t_s), words(&e.kind), link, body, path, float(e.value), words(&e.text)]
            };
            (names.to_vec(), recording.events.iter().map(row).collect())
        }
        "impacts" => {
            #[rustfmt::skip]
            let names = [
                "step", "t_s", "link", "feature", "feature_name", "body", "body_path", "tooth", "segment",
                "segment_name", "approach_speed_m_s", "peak_force_n", "peak_after_s", "impulse_n_s", "rise_time_s",
                "second_period_mean_n", "x_m", "y_m", "watched_s", "touch_force_n", "touch_offset_s",
            ];
            let row = |i: &Impact| {
                let path = words(&recording.header.bodies[i.body as usize].path);
                let mut row = vec![whole(i.step), float(i.t_s), whole(i.link), whole(i.feature)];
                row.extend([words(Feature::name(i.feature)), whole(i.body), path, whole(i.tooth), whole(i.segment)]);
                row.push(words(Segment::name(i.segment)));
                let forces = [i.approach_speed_m_s, i.peak_force_n, i.peak_after_s, i.impulse_n_s, i.rise_time_s];
                row.extend(forces.map(float));
                row.extend(
                    [i.second_period_mean_n, i.x_m, i.y_m, i.watched_s, i.touch_force_n, i.touch_offset_s].map(float),
                );
                row
            };
            (names.to_vec(), recording.impacts.iter().map(row).collect())
        }
        "bodies" => {
            let names = ["body", "path", "rotor", "coordinate", "x_m", "y_m", "angle_rad", "teeth"];
            let more = ["slider", "bearing", "kind", "kind_name", "low_stop", "high_stop"];
            let row = |(i, b): (usize, &pitchline::recording::frame::BodyInfo)| {
                let place = [b.coordinate.map_or(-1.0, f64::from), b.x_m, b.y_m, b.angle_rad].map(float);
                let head = [whole(i as u64), words(&b.path), Cell::Truth(b.rotor)];
                let kind = [whole(b.kind), words(frame::BodyKind::name(b.kind))];
                let tail = [b.low_stop.unwrap_or(f64::NAN), b.high_stop.unwrap_or(f64::NAN)].map(float);
                let bearing = b.shifts.first().map_or(-1.0, |shift| f64::from(shift.slider));
                let slider = [whole(b.teeth), float(b.slider.map_or(-1.0, f64::from)), float(bearing)];
                head.into_iter().chain(place).chain(slider).chain(kind).chain(tail).collect()
            };
            (names.into_iter().chain(more).collect(), recording.header.bodies.iter().enumerate().map(row).collect())
        }
        "link_info" => {
            let names = ["link", "outline", "outline_name", "pitch_m", "mass_kg", "inertia_kg_m2", "ahead"];
            let header = &recording.header;
            let row = |(i, l): (usize, &pitchline::recording::frame::LinkInfo)| {
                let name = words(&header.link_outlines[l.outline as usize].name);
                let floats = [l.pitch_m, l.mass_kg, l.inertia_kg_m2].map(float);
                [whole(i as u64), whole(l.outline), name].into_iter().chain(floats).chain([whole(l.ahead)]).collect()
            };
            (names.to_vec(), header.links.iter().enumerate().map(row).collect())
        }
        "roller_info" => {
            let names = ["roller", "joint", "link", "radius_m", "bore_radius_m", "mass_kg", "inertia_kg_m2"];
            let row = |(i, r): (usize, &pitchline::recording::frame::RollerInfo)| {
                let floats = [r.radius_m, r.bore_radius_m, r.mass_kg, r.inertia_kg_m2].map(float);
                [whole(i as u64), whole(r.joint), whole(r.link)].into_iter().chain(floats).collect()
            };
            (names.to_vec(), recording.header.rollers.iter().enumerate().map(row).collect())
        }
        _ => panic!("{table} is new: say here what it holds"),
    }
}

/// A table of frames: the columns of its message, before them what has a row, and beside some numbers what they stand for.
fn expected_rows(table: &columns::TableInfo, recording: &Recording) -> Sheet {
    let header = &recording.header;
    let mut names = match table.rows {
        Rows::Link => vec!["link"],
        Rows::Joint => vec!["joint"],
        Rows::Contact => vec![],
        Rows::Rotor => vec!["rotor", "rotor_path"],
        Rows::Slider => vec!["slider", "slider_path"],
        Rows::Touch => vec!["touch", "touch_path"],
        Rows::Chamber => vec!["chamber", "chamber_path"],
        Rows::Passage => vec!["passage", "passage_path"],
        Rows::Roller => vec!["roller"],
        Rows::Span => vec!["span", "span_path"],
    };
    for column in table.message.columns {
        names.push(column.name);
        names.extend(match column.name {
            "feature" => Some("feature_name"),
            "body" => Some("body_path"),
            "segment" => Some("segment_name"),
            _ => None,
        });
    }
    let mut rows = Vec::new();
    for (index, f) in recording.frames.iter().enumerate() {
        f.each_table(|of, values| {
            for i in (0..values[0].len()).filter(|_| of == table) {
                let mut row = vec![whole(index as u64), whole(f.step), float(f.t_s), float(f.crank_angle_rad)];
                row.extend(match table.rows {
                    Rows::Link | Rows::Joint | Rows::Roller => vec![whole(i as u64)],
                    Rows::Contact => vec![],
                    Rows::Rotor | Rows::Slider | Rows::Touch | Rows::Chamber | Rows::Passage | Rows::Span => {
                        vec![whole(i as u64), words(&header.row_paths(table.rows).expect("named")[i])]
                    }
                });
                for (column, values) in table.message.columns.iter().zip(values) {
                    match (column.name, values) {
                        (_, ColumnValues::F64(v)) => row.push(float(v[i])),
                        (_, ColumnValues::Bool(v)) => row.push(Cell::Truth(v[i])),
                        ("feature", ColumnValues::U32(v)) => row.extend([whole(v[i]), words(Feature::name(v[i]))]),
                        ("segment", ColumnValues::U32(v)) => row.extend([whole(v[i]), words(Segment::name(v[i]))]),
                        ("body", ColumnValues::U32(v)) => {
                            row.extend([whole(v[i]), words(&header.bodies[v[i] as usize].path)]);
                        }
                        (_, ColumnValues::U32(v)) => row.push(whole(v[i])),
                        (_, ColumnValues::U64(v)) => row.push(whole(v[i])),
                        (_, ColumnValues::Text(v)) => row.push(words(&v[i])),
                    }
                }
                rows.push(row);
            }
        });
    }
    (STAMP.into_iter().chain(names).collect(), rows)
}

fn expected_energy(recording: &Recording) -> Sheet {
    let names = frame::Energy::MESSAGE.columns.iter().map(|account| account.name);
    let names: Vec<_> = std::iter::once("state_hash").chain(names).collect();
    let cells = |f: &Frame, _| {
        let values = f.energy.accounts().map(|(_, value_j)| float(value_j));
        std::iter::once(whole(f.state_hash)).chain(values).collect()
    };
    per_frame(recording, &names, |_| 1, cells)
}

/// All rows of a Parquet file, by the library's own reader.
fn parquet_rows(path: &Path) -> (Vec<String>, Vec<Vec<Cell>>) {
    let reader = SerializedFileReader::new(File::open(path).expect("there")).expect("Parquet");
    let schema = reader.metadata().file_metadata().schema_descr();
    let names = schema.columns().iter().map(|c| c.name().to_string()).collect();
    let cell = |field: &Field| match field {
        Field::Double(x) => float(*x),
        Field::UInt(x) => whole(*x),
        Field::ULong(x) => whole(*x),
        Field::Bool(x) => Cell::Truth(*x),
        Field::Str(x) => words(x),
        other => panic!("{other:?} is no type of a column"),
    };
    let rows = reader.get_row_iter(None).expect("rows");
    (names, rows.map(|r| r.expect("a row").get_column_iter().map(|(_, f)| cell(f)).collect()).collect())
}

/// Compares a CSV file with its expected content: its texts, parsed like the expected cells.
fn assert_csv(path: &Path, (names, rows): &Sheet) {
    let mut reader = csv::Reader::from_path(path).expect("CSV");
    assert!(reader.headers().expect("names").iter().eq(names.iter().copied()), "{}", path.display());
    let mut n = 0;
    for (record, row) in reader.records().zip(rows) {
        let record = record.expect("a row");
        for ((text, cell), name) in record.iter().zip(row).zip(names) {
            let read = match cell {
                Cell::Float(_) => float(text.parse().expect("a number")),
                Cell::Whole(_) => Cell::Whole(text.parse().expect("a whole number")),
                Cell::Truth(_) => Cell::Truth(text.parse().expect("true or false")),
                Cell::Text(_) => words(text),
            };
            assert_eq!(&read, cell, "{} {name} row {n}", path.display());
        }
        n += 1;
    }
    assert_eq!(n, rows.len(), "{}", path.display());
    assert_eq!(csv::Reader::from_path(path).expect("CSV").records().count(), n, "{}", path.display());
}

fn assert_parquet(path: &Path, (names, rows): &Sheet) {
    let (names_read, rows_read) = parquet_rows(path);
    assert_eq!(&names_read, names, "{}", path.display());
    assert_eq!(rows_read.len(), rows.len(), "{}", path.display());
    for (n, (read, row)) in rows_read.iter().zip(rows).enumerate() {
        assert_eq!(read, row, "{} row {n}", path.display());
    }
}

#[test]
fn every_value_of_every_table_is_the_frames_to_the_bit() {
    for sample in samples() {
        let folder = tempfile::tempdir().expect("a folder");
        let recording = mcap::read(&sample).expect("readable");
        for format in Format::ALL {
            let out = folder.path().join(format.name());
            let result = done(&[text(&sample), "-o", text(&out), "--format", format.name()]);
            assert_eq!(result["frames"], recording.frames.len());
            assert_eq!(result["complete"], true);
            for (i, table) in TABLES.iter().enumerate() {
                let path = out.join(format!("{}.{}", table.name, format.name()));
                let sheet = expected(table.name, &recording);
                // Not every sample's drive has sensors, sliders or oil.
                let header = &recording.header;
                let none = match table.name {
                    "sensors" => header.sensors.is_empty(),
                    "sliders" => header.sliders.is_empty(),
                    "touches" => header.touches.is_empty(),
                    "chambers" => header.chambers.is_empty(),
                    "passages" => header.passages.is_empty(),
                    "rollers" | "roller_info" => header.rollers.is_empty(),
                    "spans" => header.spans.is_empty(),
                    _ => false,
                };
                assert_eq!(sheet.1.is_empty(), none, "{} of {}", table.name, sample.display());
                assert_eq!(result["outputs"][i]["table"], table.name);
                assert_eq!(result["outputs"][i]["rows"], sheet.1.len());
                assert_eq!(result["outputs"][i]["bytes"], std::fs::metadata(&path).expect("there").len());
                match format {
                    Format::Parquet => assert_parquet(&path, &sheet),
                    Format::Csv => assert_csv(&path, &sheet),
                }
            }
            assert_eq!(std::fs::read_dir(&out).expect("a folder").count(), TABLES.len(), "nothing else is left");
        }
    }
}

#[test]
fn units_and_meanings_travel_with_the_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let sample = &samples()[0];
    let header = mcap::read(sample).expect("readable").header;
    done(&[text(sample), "-o", text(folder.path())]);
    let mut from_channels = 0;
    for table in TABLES {
        let file = File::open(folder.path().join(format!("{}.parquet", table.name))).expect("there");
        let reader = SerializedFileReader::new(file).expect("Parquet");
        let pairs = reader.metadata().file_metadata().key_value_metadata().expect("metadata").clone();
        let value = |key: &str| {
            let found = pairs.iter().find(|p| p.key == format!("pitchline.{key}"));
            found.and_then(|p| p.value.clone()).unwrap_or_else(|| panic!("{} has no {key}", table.name))
        };
        assert_eq!(value("drive"), header.drive_name);
        assert_eq!(value("program"), header.program);
        assert_eq!(value("table"), table.name);
        assert_eq!(value("step_s").parse::<f64>().expect("a number").to_bits(), header.step_s.to_bits());
        let notes: serde_json::Value = serde_json::from_str(&value("columns")).expect("JSON");
        for column in table.columns() {
            let note = &notes[column.name];
            assert!(note["unit"].as_str().is_some_and(|u| !u.is_empty()), "{} {}", table.name, column.name);
            assert!(note["meaning"].as_str().is_some_and(|m| m.ends_with('.')), "{} {}", table.name, column.name);
            let full = format!("{}.{}", table.name, column.name);
            if let Some(channel) = channels().find(|c| c.channel == full) {
                assert_eq!(
                    (note["unit"].as_str(), note["meaning"].as_str()),
                    (Some(channel.unit), Some(channel.meaning))
                );
                from_channels += 1;
            }
        }
    }
    assert_eq!(from_channels, channels().count(), "every channel is a column");
}

/// Numbers and texts that are easily lost: signed zero, the smallest and largest, infinities; quotes, commas, new
/// lines.
#[test]
fn odd_numbers_and_texts_survive() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut recording = mcap::read(&samples()[0]).expect("readable");
    recording.frames.truncate(1);
    let odd = [-0.0, f64::from_bits(1), f64::MIN_POSITIVE, f64::MAX, f64::INFINITY, f64::NEG_INFINITY, 0.1 + 0.2, 1e23];
    recording.frames[0].links.x_m[..odd.len()].copy_from_slice(&odd);
    recording.frames[0].state_hash = u64::MAX;
    recording.header.bodies[0].path = "a \"path\", of\r\ntwo lines, \u{e9}".into();
    for format in Format::ALL {
        for (name, text) in [("links", ""), ("energy", ""), ("bodies", ""), ("events", "\"")] {
            recording.events.truncate(1);
            recording.events[0].text = text.into();
            let path = folder.path().join(format!("{name}.{}", format.name()));
            written(name, &path, format, &recording);
            match format {
                Format::Parquet => assert_parquet(&path, &expected(name, &recording)),
                Format::Csv => assert_csv(&path, &expected(name, &recording)),
            }
        }
    }
    // NaN is preserved; Parquet preserves its bits as well.
    recording.frames[0].links.x_m[0] = f64::from_bits(0x7ff8_0000_0000_beef);
    let path = folder.path().join("nan.parquet");
    written("links", &path, Format::Parquet, &recording);
    assert_parquet(&path, &expected("links", &recording));
}

/// One table of a recording in memory.
fn written(name: &str, path: &Path, format: Format, recording: &Recording) {
    let table = TABLES.into_iter().find(|t| t.name == name).expect("a table");
    let mut writer = TableWriter::create(table, path, format, &recording.header).expect("opens");
    for (index, frame) in recording.frames.iter().enumerate() {
        let at = Moment { header: &recording.header, index: index as u64, frame };
        writer.frame(&at).expect("writes");
    }
    for event in &recording.events {
        writer.event(&recording.header, event).expect("writes");
    }
    writer.finish().expect("finishes");
    writer.publish().expect("renames");
}

#[test]
fn row_groups_are_bounded_and_damaged_frames_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("links.parquet");
    let recording = mcap::read(&samples()[0]).expect("readable");
    let (header, frame) = (&recording.header, &recording.frames[0]);
    let table = TABLES[0];
    let n = frame.links.x_m.len();
    let frames = 3 * ROWS_PER_GROUP / n;
    let mut writer = TableWriter::create(table, &path, Format::Parquet, header).expect("opens");
    for index in 0..frames as u64 {
        writer.frame(&Moment { header, index, frame }).expect("writes");
    }
    writer.finish().expect("finishes");
    assert!(!path.exists(), "a file gets its name when it is whole");
    writer.publish().expect("renames");
    let reader = SerializedFileReader::new(File::open(&path).expect("there")).expect("Parquet");
    let groups = reader.metadata().row_groups();
    assert!(groups.len() >= 3 && groups.iter().all(|g| g.num_rows() as usize <= ROWS_PER_GROUP));
    let (_, rows) = parquet_rows(&path);
    assert_eq!(rows.len(), frames * n);
    assert!(rows.iter().enumerate().all(|(i, row)| row[0] == whole((i / n) as u64) && row[4] == whole((i % n) as u64)));
    // A column that is shorter than the others.
    let mut damaged = frame.clone();
    damaged.links.vy_m_s.pop();
    let mut writer = TableWriter::create(table, &path, Format::Parquet, header).expect("opens");
    let error = writer.frame(&Moment { header, index: 0, frame: &damaged }).expect_err("refused");
    assert!(error.to_string().contains("links.vy_m_s"), "{error}");
    drop(writer);
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 1, "given up: nothing is left");
}

/// Highest normal force on a tooth of the driver: tooth, force.
fn highest_peak(header: &Header, frames: &[Frame]) -> (u32, f64) {
    let driver = header.bodies.iter().position(|b| b.path == "sprockets.driver").expect("a driver") as u32;
    let mut highest = (0, 0.0);
    for contacts in frames.iter().map(|f| &f.contacts) {
        for i in (0..contacts.link.len()).filter(|i| contacts.body[*i] == driver) {
            if contacts.normal_force_n[i] > highest.1 {
                highest = (contacts.tooth[i], contacts.normal_force_n[i]);
            }
        }
    }
    highest
}

#[test]
fn duckdb_finds_the_tooth_with_the_highest_peak() {
    let Some(python) = readers::python("duckdb") else { return };
    let script = "import duckdb, sys
tooth, peak = duckdb.sql(f\"\"\"select tooth, max(normal_force_n) as peak from '{sys.argv[1]}'
    where body_path = 'sprockets.driver' group by tooth order by peak desc limit 1\"\"\").fetchall()[0]
print(tooth, peak.hex())";
    for sample in samples() {
        let recording = mcap::read(&sample).expect("readable");
        let (tooth, peak) = highest_peak(&recording.header, &recording.frames);
        for format in Format::ALL {
            let folder = tempfile::tempdir().expect("a folder");
            let path = folder.path().join(format!("contacts.{}", format.name()));
            done(&[text(&sample), "-o", text(&path), "--tables", "contacts"]);
            let out = Command::new(&python).args(["-c", script]).arg(&path).output().expect("runs");
            let said = String::from_utf8_lossy(&out.stdout);
            assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
            println!("{}: tooth {tooth}, {peak:.1} N; DuckDB of {}: {}", sample.display(), format.name(), said.trim());
            let (tooth_read, peak_read) = said.trim().split_once(' ').expect("tooth and peak");
            assert_eq!(tooth_read.parse(), Ok(tooth));
            assert_eq!(from_hex(peak_read).to_bits(), peak.to_bits());
        }
    }
}

/// A float as Python's float.hex writes it, e.g. 0x1.91eb851eb851fp+6.
fn from_hex(text: &str) -> f64 {
    let (mantissa, exponent) = text.trim_start_matches("0x1.").split_once('p').expect("hexadecimal");
    let fraction = u64::from_str_radix(mantissa, 16).expect("digits") << (4 * (13 - mantissa.len()));
    let exponent: i64 = exponent.parse().expect("an exponent");
    f64::from_bits(((exponent + 1023) as u64) << 52 | fraction)
}

#[test]
fn a_span_of_time_keeps_the_places_in_the_recording() {
    let folder = tempfile::tempdir().expect("a folder");
    let sample = &samples()[0];
    let recording = mcap::read(sample).expect("readable");
    let times: Vec<f64> = recording.frames.iter().map(|f| f.t_s).collect();
    let middle = times[times.len() / 2];
    let from = format!("{:e}s", middle);
    let path = folder.path().join("energy.parquet");
    let args = [text(sample), "-o", text(&path), "--tables", "energy"];
    done(&[&args[..], &["--from", &from]].concat());
    let (names, rows) = expected("energy", &recording);
    let first = times.len() / 2;
    assert_parquet(&path, &(names.clone(), rows[first..].to_vec()));
    done(&[&args[..], &["--to", &from]].concat());
    assert_parquet(&path, &(names.clone(), rows[..=first].to_vec()));
    done(&[&args[..], &["--from", &from, "--to", &from]].concat());
    assert_parquet(&path, &(names, rows[first..=first].to_vec()));
    let events = folder.path().join("events.csv");
    done(&[text(sample), "-o", text(&events), "--tables", "events", "--to", &from]);
    let (names, rows) = expected("events", &recording);
    let kept = recording.events.iter().zip(rows).filter(|(e, _)| e.t_s <= middle).map(|(_, row)| row).collect();
    assert_csv(&events, &(names, kept));
}

#[test]
fn a_recording_that_was_cut_off_is_exported_as_far_as_it_goes() {
    let folder = tempfile::tempdir().expect("a folder");
    let (cut, path) = (folder.path().join("cut.mcap"), folder.path().join("energy.csv"));
    let bytes = std::fs::read(&samples()[2]).expect("readable");
    std::fs::write(&cut, &bytes[..bytes.len() * 9 / 10]).expect("writable");
    let out = export(&[text(&cut), "-o", text(&path), "--tables", "energy"]);
    let said = String::from_utf8_lossy(&out.stderr);
    println!("{said}");
    assert!(out.status.code() == Some(3) && said.contains("was not finished"), "{said}");
    assert_csv(&path, &expected("energy", &mcap::read(&cut).expect("readable")));
}

#[test]
fn mistakes_are_said_and_change_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| text(&folder.path().join(name)).to_string();
    let own = at("links.parquet");
    std::fs::copy(&samples()[0], &own).expect("copies");
    let before = std::fs::read(&own).expect("readable");
    std::fs::create_dir(at("taken.csv")).expect("a folder");
    std::fs::create_dir_all(at("half/energy.parquet")).expect("a folder");
    let refused = |code: i32, args: &[&str], says: &[&str]| {
        let out = export(&[&[own.as_str()], args].concat());
        let said = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(code), "{args:?}: {said}");
        assert!(says.iter().all(|s| said.contains(s)), "{args:?}: {said}");
    };
    refused(2, &["-o", &at("a.csv"), "--tables", "contcts"], &["`contcts`", "did you mean `contacts`"]);
    refused(2, &["-o", &at("a.csv"), "--tables", "links,"], &["tables: links, contacts"]);
    refused(2, &["-o", &at("a.txt"), "--tables", "links"], &["a.txt", ".parquet or .csv"]);
    refused(2, &["-o", &at("a.csv"), "--tables", "links,joints"], &["2 tables", "--tables"]);
    refused(2, &["-o", &at("a.csv")], &["17 tables"]);
    refused(2, &["-o", &at("a.csv"), "--tables", "links", "--format", "parquet"], &["--format"]);
    refused(2, &["-o", &at("a/"), "--format", "xlsx"], &["parquet or csv"]);
    refused(2, &["-o", &at("a/"), "--from", "2ms", "--to", "1ms"], &["--from"]);
    refused(2, &["-o", &at("a/"), "--from", "100s"], &["no frame", "ends at"]);
    refused(2, &["-o", &at("half/")], &["energy.parquet", "directory"]);
    refused(2, &["-o", text(folder.path()), "--tables", "links"], &["is the input itself"]);
    refused(1, &["-o", &format!("{own}/a/")], &["cannot make", "links.parquet/a"]);
    refused(1, &["-o", &at("nowhere/a.csv"), "--tables", "links"], &["cannot write", "nowhere/a.csv"]);
    let out = export(&[&at("none.mcap"), "-o", &at("a/")]);
    assert_eq!(out.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&out.stderr).contains("none.mcap"));
    assert_eq!(std::fs::read(&own).expect("readable"), before);
    // Only the earlier files, and the folder of the export that found no frame.
    let mut left: Vec<_> =
        std::fs::read_dir(folder.path()).expect("a folder").flatten().map(|e| e.file_name()).collect();
    left.sort();
    assert_eq!(left, ["a", "half", "links.parquet", "taken.csv"]);
    assert_eq!(std::fs::read_dir(at("a")).expect("a folder").count(), 0);
    // Existing tables are replaced.
    std::fs::write(at("a/joints.parquet"), "old").expect("writable");
    done(&[&own, "-o", &at("a/"), "--tables", "joints"]);
    assert_parquet(
        Path::new(&at("a/joints.parquet")),
        &expected("joints", &mcap::read(Path::new(&own)).expect("readable")),
    );
}

#[cfg(unix)]
#[test]
fn a_disk_that_runs_full_is_an_error_that_names_the_file_and_leaves_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    for format in Format::ALL {
        let out = folder.path().join(format.name());
        // 32 blocks of 512 or 1024 bytes per file; the signal that would end the program is ignored, so that writing
        // fails.
        let script = "trap '' XFSZ; ulimit -f 32; exec \"$@\"";
        let sample = samples().remove(0);
        let args = [env!("CARGO_BIN_EXE_pitchline"), "export", text(&sample), "--format", format.name(), "-o"];
        let result = Command::new("sh").args(["-c", script, "sh"]).args(args).arg(&out).output().expect("runs");
        let said = String::from_utf8_lossy(&result.stderr);
        println!("{said}");
        assert_eq!(result.status.code(), Some(1), "{said}");
        assert!(said.contains("cannot write") && said.contains(&format!("links.{}", format.name())), "{said}");
        assert_eq!(said.matches("too large").count(), 1, "said once: {said}");
        assert_eq!(std::fs::read_dir(&out).expect("a folder").count(), 0, "nothing is left");
    }
}

#[test]
fn the_help_names_every_table() {
    let said = String::from_utf8(export(&["--help"]).stdout).expect("text");
    for table in TABLES {
        assert!(said.contains(table.name), "{}", table.name);
    }
}

/// The script of docs/recording-format.md, unchanged, on tables of the samples.
#[test]
fn the_documented_script_finds_forces_balanced() {
    let docs = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/recording-format.md")).expect("docs");
    let (_, script) = docs.split_once("```python\n").expect("a script");
    let (script, _) = script.split_once("```").expect("its end");
    let Some(python) = readers::python("csv, math") else { return };
    for sample in samples() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("balance.py");
        std::fs::write(&path, script).expect("writable");
        let tables = format!("{}/", folder.path().join("tables").display());
        done(&[text(&sample), "-o", &tables, "--format", "csv"]);
        let out = Command::new(&python).arg(&path).arg(&tables).output().expect("runs");
        println!("{}", String::from_utf8_lossy(&out.stdout));
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    }
}
