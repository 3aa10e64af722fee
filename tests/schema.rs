//! The schema of recordings for readers of other programs: `assets/pitchline.proto` and the list of columns in
//! `docs/recording-format.md` hold what `src/recording/frame.rs` lists, and `assets/pitchline.desc` is the output of a protobuf
//! compiler for the proto file. With PITCHLINE_WRITE_SCHEMA set, the tests write all three.

use pitchline::recording::columns::{Column, FINE_TAG, Holds, MessageInfo, Stored};
use pitchline::recording::frame::{Frame, TABLES, channels, messages};
use prost::Message;
use std::path::PathBuf;

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(name)
}

fn read(name: &str) -> String {
    std::fs::read_to_string(path(name)).expect("a text")
}

/// Whether files are to be written instead of compared.
fn writes() -> bool {
    std::env::var_os("PITCHLINE_WRITE_SCHEMA").is_some()
}

/// Replaces the paragraph in which `start` stands, until `end`, in a file, or compares it.
fn hold(file: &str, start: &str, end: &str, wanted: &str) {
    let text = read(file);
    let from = text.find(start).unwrap_or_else(|| panic!("{file} has no `{start}`"));
    let from = text[..from].rfind("\n\n").map_or(0, |before| before + 2);
    let until = from + text[from..].find(end).expect("an end") + end.len();
    if writes() {
        std::fs::write(path(file), format!("{}{wanted}{}", &text[..from], &text[until..])).expect("writable");
    } else {
        assert!(text[from..until] == *wanted, "{file}: {ADVICE}\n{wanted}");
    }
}

const ADVICE: &str = "run PITCHLINE_WRITE_SCHEMA=1 cargo test --release --test schema, and look at the change; wanted:";

/// Unit behind a sentence; numbers without unit have none.
fn with_unit(column: &Column) -> String {
    match column.unit {
        "1" => column.meaning.to_string(),
        unit => format!("{} [{unit}].", column.meaning.trim_end_matches('.')),
    }
}

fn proto(message: &MessageInfo) -> String {
    let mut columns: Vec<&Column> = message.columns.iter().collect();
    columns.sort_by_key(|c| c.tag);
    let repeated = TABLES.iter().any(|t| t.message == *message);
    let mut text = format!("// {}\nmessage {} {{\n", message.about, message.struct_name);
    for column in columns.iter().filter(|c| c.stored != Stored::derived) {
        let Column { tag, name, stored, .. } = column;
        let label = if repeated { "repeated " } else { "" };
        text += &format!("  // {}\n  {label}{} {name} = {tag};\n", with_unit(column), stored.schema_type());
    }
    for column in columns.iter().filter(|c| c.stored.fine_bytes() > 0) {
        let (bits, name) = (8 * column.stored.fine_bytes(), column.name);
        text += &format!("  // The {bits} bits of the mantissa behind each value of {name}, little-endian.\n");
        text += &format!("  bytes {name}_fine = {};\n", column.tag + FINE_TAG);
    }
    text + "}\n"
}

/// One test, because each part reads what the one before writes.
#[test]
fn schema_and_documentation_hold_the_columns_of_frames() {
    for message in messages() {
        let start = format!("message {} {{\n", message.struct_name);
        hold("assets/pitchline.proto", &start, "}\n", &proto(&message));
    }
    for table in TABLES {
        let field = format!("  {} {} = {};\n", table.message.struct_name, table.message.name, table.tag);
        assert!(read("assets/pitchline.proto").contains(&field), "message Frame lacks{field}");
    }
    let descriptor = protox::Compiler::new([path("assets")])
        .expect("includes")
        .include_source_info(false)
        .open_file("pitchline.proto")
        .expect("the proto file compiles")
        .encode_file_descriptor_set();
    if writes() {
        std::fs::write(path("assets/pitchline.desc"), &descriptor).expect("writable");
    }
    assert!(std::fs::read(path("assets/pitchline.desc")).expect("a descriptor") == descriptor, "{ADVICE} a descriptor");
    let mut table = "| column | unit | holds | stored as | meaning |\n|---|---|---|---|---|\n".to_string();
    for Column { channel, unit, holds, stored, meaning, .. } in channels() {
        let holds = match holds {
            Holds::Node => "at the node",
            Holds::Step => "over the step",
        };
        let stored = match stored {
            Stored::double48 => "float and 16 bits",
            Stored::double40 => "float and 8 bits",
            Stored::derived => "not stored",
            Stored::double | Stored::float | Stored::uint32 | Stored::uint64 | Stored::bool | Stored::string => {
                stored.schema_type()
            }
        };
        table += &format!("| `{channel}` | {unit} | {holds} | {stored} | {meaning} |\n");
    }
    hold("docs/recording-format.md", "| column | unit |", "\n\n", &(table + "\n"));
}

/// Tags and kinds that the loops over columns rely on.
#[test]
fn columns_of_frames_are_in_the_order_of_their_tags() {
    for table in TABLES {
        let tags = table.message.columns.iter().map(|c| c.tag);
        assert!(tags.eq(1..=table.message.columns.len() as u32), "{} has tags out of order", table.message.name);
        assert!(table.message.columns.len() as u32 <= FINE_TAG, "{} has more columns than tags", table.message.name);
    }
    for message in messages() {
        for column in message.columns {
            let Column { channel, unit, meaning, .. } = column;
            assert!(meaning.ends_with('.') && !unit.is_empty(), "{channel} has no unit or meaning");
        }
    }
    let mut named = Vec::new();
    Frame::default().each_table(|table, values| {
        assert_eq!(table.message.columns.len(), values.len());
        named.push(table.message.name);
    });
    assert!(named.iter().eq(TABLES.iter().map(|t| &t.message.name)));
    assert!(Frame::default().encode_to_vec().len() > TABLES.len());
}
