//! Reading a measurement file, table by table.

use super::clocks::BesideSpec;
use super::columns::FileLayout;
use super::wheels::WheelSpec;
use super::{
    CandidateSpec, ChannelSpec, FileSpec, FitScope, FitSpec, InputSpec, Measurement, PulseValues, RecordSpec, Split,
    Use,
};
use crate::diag::nearest;
use crate::drive::reader::{Places, TomlTable};
use crate::effects::{EFFECTS, named};

pub(super) fn measurement(root: &TomlTable<'_>) -> Measurement {
    let title = root.text("title").unwrap_or_default();
    let drive = root.text("drive").unwrap_or_else(|| {
        root.error("`drive` is missing".into(), Some("add `drive = \"FILE.toml\"`, beside this file".into()));
        String::new()
    });
    let files = files(root);
    let wheels = wheels(root);
    let channels = channels(root);
    let inputs = inputs(root);
    let records = records(root, &files, &channels, &inputs);
    let fit = fit(root);
    let table = root.table("candidates");
    let candidates = CandidateSpec { only: effect_names(&table, "only"), without: effect_names(&table, "without") };
    table.finish();
    root.finish();
    Measurement {
        name: String::new(),
        text: String::new(),
        title,
        drive,
        files,
        wheels,
        channels,
        inputs,
        records,
        fit,
        candidates,
        places: Places::empty(),
    }
}

fn effect_names(t: &TomlTable<'_>, key: &str) -> Vec<String> {
    let names = t.texts(key).unwrap_or_default();
    for name in &names {
        if named(name).is_none() {
            let near = nearest(name, EFFECTS.iter().map(|e| e.name));
            let help = near.map_or("`pitchline effects` lists all".to_string(), |n| format!("did you mean \"{n}\"?"));
            t.error_at(key, format!("no effect is called `{name}`"), Some(help));
        }
    }
    names
}

fn text(t: &TomlTable<'_>, key: &str, example: &str) -> String {
    t.text(key).unwrap_or_else(|| {
        t.error(format!("`{}.{key}` is missing", t.path()), Some(format!("add `{key} = \"{example}\"`")));
        String::new()
    })
}

/// A count, for example of rows.
fn count(t: &TomlTable<'_>, key: &str, range: std::ops::RangeInclusive<i64>) -> Option<usize> {
    t.integer(key, range).and_then(|n| usize::try_from(n).ok())
}

fn files(root: &TomlTable<'_>) -> Vec<FileSpec> {
    let table = root.table("files");
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        let path = text(&t, "path", "FILE.csv");
        let separator = t.text("separator").and_then(|s| match s.as_bytes() {
            [b'"' | b'\n' | b'\r'] | [b'0'..=b'9'] => {
                t.error_at("separator", format!("`{s}` cannot part columns"), Some("\",\", \";\" or \"tab\"".into()));
                None
            }
            [one] => Some(*one),
            b"tab" | b"\\t" => Some(b'\t'),
            _ => {
                t.error_at("separator", format!("`{s}` is not one character"), Some("\",\", \";\" or \"tab\"".into()));
                None
            }
        });
        let layout = FileLayout {
            header: t.flag("header").unwrap_or(true),
            separator,
            skip_lines: count(&t, "skip_lines", 0..=10_000).unwrap_or(0),
            group: count(&t, "group", 0..=1_000_000),
        };
        all.push(FileSpec { name, path, layout });
        t.finish();
    }
    if all.is_empty() {
        root.error("no measured file is named".into(), Some("add `[files.NAME]` with `path = \"FILE.csv\"`".into()));
    }
    table.finish();
    all
}

fn wheels(root: &TomlTable<'_>) -> Vec<WheelSpec> {
    let table = root.table("wheels");
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        let column = text(&t, "column", "name of the column with the level");
        let rising = t.choice("edge", &[("rising", true), ("falling", false)]).unwrap_or(true);
        let places = usize::try_from(t.required_integer("teeth", 1..=10_000)).unwrap_or(1);
        let without = t.list("missing", 1.0, 1.0..=places as f64).unwrap_or_default();
        if let Some(part) = without.iter().find(|m| **m != libm::trunc(**m)) {
            t.error_at("missing", format!("{part} is no place of the wheel"), Some("whole numbers from 1".into()));
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 1 to 10,000")]
        let mut missing: Vec<usize> = without.iter().map(|m| *m as usize).collect();
        missing.sort_unstable();
        missing.dedup();
        if missing.len() >= places {
            let help = "`teeth` counts all places, also those without a tooth";
            t.error_at("missing", "the wheel has no tooth left".into(), Some(help.into()));
        }
        let wheel = WheelSpec { name, column, rising, places, missing };
        if wheel.missing.len() < places && !wheel.has_usual_gap() {
            let help = "two thirds of the gaps between teeth must be alike: the edges do not tell the places otherwise";
            t.error_at("missing", "the teeth of this wheel are too uneven".into(), Some(help.into()));
        }
        all.push(wheel);
        t.finish();
    }
    table.finish();
    all
}

fn channels(root: &TomlTable<'_>) -> Vec<ChannelSpec> {
    let table = root.table("channels");
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        all.push(ChannelSpec {
            sensor: text(&t, "sensor", "sensors.tachometer.BODY"),
            column: text(&t, "column", "name of a column"),
            unit: text(&t, "unit", "rad/s"),
            noise: t.number("noise", 1.0, 1e-30..=1e12),
            values: t
                .choice("values", &[("intervals", PulseValues::Intervals), ("times", PulseValues::Times)])
                .unwrap_or(PulseValues::Intervals),
            name,
        });
        t.finish();
    }
    if all.is_empty() {
        let help = "add `[channels.NAME]` with `sensor`, `column` and `unit`";
        root.error("no channel is measured".into(), Some(help.into()));
    }
    table.finish();
    all
}

fn inputs(root: &TomlTable<'_>) -> Vec<InputSpec> {
    let table = root.table("inputs");
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        all.push(InputSpec {
            input: text(&t, "input", "inputs.torque.BODY"),
            column: text(&t, "column", "name of a column"),
            unit: t.text("unit").unwrap_or_else(|| "1".into()),
            hold: t.flag("hold").unwrap_or(false),
            name,
        });
        t.finish();
    }
    table.finish();
    all
}

fn records(
    root: &TomlTable<'_>,
    files: &[FileSpec],
    channels: &[ChannelSpec],
    inputs: &[InputSpec],
) -> Vec<RecordSpec> {
    let table = root.table("records");
    let mut all: Vec<RecordSpec> = Vec::new();
    for (name, t) in table.tables() {
        let file = t.text("file").unwrap_or_else(|| match files {
            [only] => only.name.clone(),
            _ => text(&t, "file", "NAME of a [files.NAME]"),
        });
        check_file(&t, &file, files);
        let time = t.text("time_column").map(|c| (c, t.text("time_unit").unwrap_or_else(|| "s".into())));
        let columns_table = t.table("columns");
        let known = channels.iter().map(|c| &c.name).chain(inputs.iter().map(|i| &i.name));
        let columns = known.filter_map(|n| columns_table.text(n).map(|c| (n.clone(), c))).collect();
        columns_table.finish();
        let beside = beside(&t, files, channels, inputs);
        let set_table = t.table("set");
        let set = set_table.numbers();
        set_table.finish();
        let split = match t.choice("split", &[("whole", false), ("coasting", true)]).unwrap_or(false) {
            false => Split::Whole,
            true => Split::Coasting { at_least: count(&t, "at_least_pulses", 8..=100_000).unwrap_or(24) },
        };
        let record = RecordSpec {
            file,
            usage: t
                .choice("use", &[("fit", Use::Fit), ("judge", Use::Judge), ("transfer", Use::Transfer)])
                .unwrap_or(Use::Fit),
            from_row: count(&t, "from_row", 1..=1_000_000_000).unwrap_or(1),
            to_row: count(&t, "to_row", 1..=1_000_000_000),
            judge_from_row: count(&t, "judge_from_row", 2..=1_000_000_000),
            judge_share: t.number("judge_share", 1.0, 0.0..=0.9),
            rate_hz: t.number("rate_hz", 1.0, 1e-6..=1e9),
            time,
            split,
            at_rest: t.choice("start", &[("free", false), ("rest", true)]).unwrap_or(false),
            columns,
            set,
            beside,
            name,
        };
        if let Some(to) = record.to_row.filter(|to| *to <= record.from_row) {
            t.error_at("to_row", format!("the record ends at row {to}, before it starts"), None);
        }
        if let Some(row) =
            record.judge_from_row.filter(|r| *r <= record.from_row || record.to_row.is_some_and(|t| *r > t))
        {
            t.error_at("judge_from_row", format!("row {row} is no row of this record"), None);
        }
        all.push(record);
        t.finish();
    }
    if all.is_empty() {
        root.error("no record is named".into(), Some("add `[records.NAME]` with `rate_hz` or `time_column`".into()));
    }
    table.finish();
    all
}

/// `[records.NAME.beside.NAME]`.
fn beside(
    record: &TomlTable<'_>,
    files: &[FileSpec],
    channels: &[ChannelSpec],
    inputs: &[InputSpec],
) -> Vec<BesideSpec> {
    let known: Vec<&str> =
        channels.iter().map(|c| c.name.as_str()).chain(inputs.iter().map(|i| i.name.as_str())).collect();
    let table = record.table("beside");
    let mut all: Vec<BesideSpec> = Vec::new();
    for (name, t) in table.tables() {
        let file = text(&t, "file", "NAME of a [files.NAME]");
        check_file(&t, &file, files);
        let holds = t.texts("holds").unwrap_or_default();
        if holds.is_empty() {
            let help = format!("`holds` names channels and inputs: {}", known.join(", "));
            t.error(format!("nothing of file `{file}` is used"), Some(help));
        }
        for (i, own) in holds.iter().enumerate() {
            if holds.iter().take(i).any(|other| other == own) {
                t.error_at("holds", format!("`{own}` is named twice"), None);
            }
            if !known.contains(&own.as_str()) {
                let help = nearest(own, known.iter().copied()).map(|near| format!("did you mean \"{near}\"?"));
                t.error_at("holds", format!("no channel or input is called `{own}`"), help);
            }
            if channels.iter().any(|c| c.name == *own) && inputs.iter().any(|i| i.name == *own) {
                t.error_at(
                    "holds",
                    format!("`{own}` is a channel and an input"),
                    Some("give one of them another name".into()),
                );
            }
            if let Some(other) = all.iter().find(|b| b.holds.contains(own)) {
                t.error_at("holds", format!("`{own}` lies in `{}` already", other.name), None);
            }
        }
        let time = t.text("time_column").map(|c| (c, t.text("time_unit").unwrap_or_else(|| "s".into())));
        all.push(BesideSpec {
            file,
            holds,
            rate_hz: t.number("rate_hz", 1.0, 1e-6..=1e9),
            time,
            offset_s: t.number("offset_ms", 1e-3, -1e13..=1e13).unwrap_or(0.0),
            drift: t.number("drift_percent", 0.01, -50.0..=50.0).unwrap_or(0.0),
            name,
        });
        t.finish();
    }
    table.finish();
    all
}

/// Says if no file is called so.
fn check_file(t: &TomlTable<'_>, file: &str, files: &[FileSpec]) {
    if !file.is_empty() && files.iter().all(|f| f.name != file) {
        let names: Vec<_> = files.iter().map(|f| f.name.clone()).collect();
        t.error_at("file", format!("no file is called `{file}`"), Some(format!("files: {}", names.join(", "))));
    }
}

fn fit(root: &TomlTable<'_>) -> Vec<FitSpec> {
    let table = root.table("fit");
    let mut all = Vec::new();
    for (path, t) in table.tables() {
        let scope = [("all", FitScope::All), ("record", FitScope::Record), ("part", FitScope::Part)];
        all.push(FitSpec {
            path,
            spread: t.number("spread_percent", 0.01, 0.01..=1e6),
            low: t.number("low", 1.0, -1e300..=1e300),
            high: t.number("high", 1.0, -1e300..=1e300),
            scope: t.choice("per", &scope).unwrap_or(FitScope::All),
        });
        t.finish();
    }
    table.finish();
    all
}
