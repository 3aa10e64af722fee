//! Measured files written by other programs: each contains the numbers of `truth.csv` (see
//! `tests/data/strangers/README.md`).

use pitchline::measurement::columns::{ColumnSelection, Columns, FileLayout, Memory, read};
use std::path::PathBuf;

fn at(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/strangers").join(name)
}

fn columns(name: &str, layout: FileLayout, wanted: &[&str]) -> Columns {
    let wanted: Vec<String> = wanted.iter().map(|w| (*w).to_string()).collect();
    read(&at(name), layout, ColumnSelection::Named(&wanted), &mut Memory::for_program(1_000_000_000))
        .unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn column<'a>(c: &'a Columns, name: &str) -> &'a [f64] {
    let i = c.find(name).unwrap_or_else(|| panic!("no {name} in {:?}", c.names));
    assert_eq!(c.wrong[i], None);
    &c.values[i]
}

fn truth(name: &str) -> Vec<f64> {
    let text = std::fs::read_to_string(at("truth.csv")).expect("the truth");
    let mut lines = text.lines();
    let index = lines.next().expect("names").split(',').position(|n| n == name).expect("a column");
    lines.map(|l| l.split(',').nth(index).expect("a field").parse().expect("a number")).collect()
}

const NAMES: [&str; 3] = ["time_s", "speed_rpm", "torque_nm"];

#[test]
fn text_files_of_spreadsheets_and_test_benches() {
    for name in [
        "truth.csv",
        "csv_pandas_bom_crlf.csv",
        "csv_excel_german_cp1252.csv",
        "csv_utf16le_tab.txt",
        "csv_utf16be_comma.csv",
        "csv_units_row.csv",
        "csv_libreoffice.csv",
        "csv_libreoffice_german.csv",
        "csv_gzip.csv.gz",
        "csv_stray_quote.csv",
        "csv_stray_quote_more_quotes.csv",
    ] {
        let c = columns(name, FileLayout::default(), &NAMES);
        for key in NAMES {
            assert_eq!(column(&c, key), truth(key), "{name}: {key}");
        }
        // A warning for irregular files, and only for these.
        let stray = name.contains("stray_quote");
        assert_eq!(
            c.warnings.iter().any(|w| w.contains("line 102: a quotation mark")),
            stray,
            "{name}: {:?}",
            c.warnings
        );
    }
    let c = columns("csv_units_row.csv", FileLayout::default(), &NAMES);
    assert_eq!(c.units[1].as_deref(), Some("rpm"));
    let c = columns("csv_excel_german_cp1252.csv", FileLayout::default(), &["\u{d6}ltemperatur_\u{b0}C"]);
    assert_eq!(column(&c, "\u{d6}ltemperatur_\u{b0}C")[0], 71.55);
    // Columns that are not requested are not stored.
    assert!(c.values[1].is_empty() && c.rows() == 200);
}

#[test]
fn times_as_dates() {
    for name in ["csv_iso_t.csv", "csv_iso_z.csv", "csv_iso_offset.csv", "csv_iso_space.csv"] {
        let c = columns(name, FileLayout::default(), &["time", "speed_rpm"]);
        for (read, t_s) in column(&c, "time").iter().zip(truth("time_s")) {
            assert!((read - t_s).abs() < 1e-12, "{name}: {read} {t_s}");
        }
        assert_eq!(c.units[0].as_deref(), Some("s"));
        assert_eq!(column(&c, "speed_rpm"), truth("speed_rpm"));
    }
}

#[test]
fn two_columns_of_one_name_are_a_mistake_where_one_is_asked_for() {
    let c = columns("csv_same_name_twice.csv", FileLayout::default(), &NAMES);
    let wrong = c.wrong[c.find("speed_rpm").expect("there")].clone().expect("a mistake");
    assert!(wrong.contains("columns 2 and 3 are both called `speed_rpm`"), "{wrong}");
    assert_eq!(column(&c, "torque_nm"), truth("torque_nm"));
}

#[test]
fn parquet_with_every_codec_and_kind_of_column() {
    for name in ["snappy", "gzip", "lz4", "brotli", "zstd", "none", "v2_encodings", "polars", "duckdb", "nested"] {
        let name = format!("parquet_{name}.parquet");
        let c = columns(&name, FileLayout::default(), &NAMES);
        for key in NAMES {
            assert_eq!(column(&c, key), truth(key), "{name}: {key}");
        }
    }
    let nested = columns("parquet_nested.parquet", FileLayout::default(), &["note", "peaks.list.element"]);
    let said: Vec<&String> = nested.wrong.iter().flatten().collect();
    assert!(said.iter().any(|w| w.contains("is nested")) && said.iter().any(|w| w.contains("holds texts")), "{said:?}");
    let types = columns(
        "parquet_types_nulls.parquet",
        FileLayout::default(),
        &["time", "speed_rpm", "torque_nm", "count", "driving"],
    );
    for (read, t_s) in column(&types, "time").iter().zip(truth("time_s")) {
        assert!((read - t_s).abs() < 1e-12);
    }
    for (i, (read, v)) in column(&types, "speed_rpm").iter().zip(truth("speed_rpm")).enumerate() {
        assert!(if (50..55).contains(&i) { read.is_nan() } else { *read == v }, "{i}: {read} {v}");
    }
    for (read, v) in column(&types, "torque_nm").iter().zip(truth("torque_nm")) {
        assert_eq!(*read, f64::from(v as f32));
    }
    for (i, read) in column(&types, "count").iter().enumerate() {
        assert_eq!(read.is_nan(), i % 10 == 7, "{i}");
    }
    assert!(column(&types, "driving").iter().all(|v| *v == 0.0 || *v == 1.0));
}

#[test]
fn mdf_as_asammdf_writes_it() {
    let names = ["time", "speed_rpm", "torque_nm"];
    for name in [
        "mdf410_plain",
        "mdf410_deflate",
        "mdf410_transposed",
        "mdf410_block_list",
        "mdf410_unsorted",
        "mdf420_plain",
        "mdf420_columns",
        "mdf420_columns_deflate",
        "mdf410_two_rates",
    ] {
        let groups = matches!(name, "mdf410_two_rates" | "mdf410_unsorted");
        let layout = FileLayout { group: groups.then_some(0), ..FileLayout::default() };
        let c = columns(&format!("{name}.mf4"), layout, &names);
        for (key, of) in names.iter().zip(NAMES) {
            assert_eq!(column(&c, key), truth(of), "{name}: {key}");
        }
    }
    let rates =
        columns("mdf410_two_rates.mf4", FileLayout { group: Some(1), ..FileLayout::default() }, &["temperature_degc"]);
    assert_eq!(column(&rates, "temperature_degc")[..2], [71.55, 72.5701]);
    let raw = columns("mdf410_int16_linear.mf4", FileLayout::default(), &names);
    for (read, v) in column(&raw, "speed_rpm").iter().zip(truth("speed_rpm")) {
        assert!((read - v).abs() <= 0.05, "{read} {v}");
    }
}

/// Files that claim or contain more than a program may allocate.
#[test]
fn what_a_file_says_of_itself_takes_no_memory() {
    let folder = tempfile::tempdir().expect("a folder");
    let read_within = |name: &str, bytes: usize| {
        read(&folder.path().join(name), FileLayout::default(), ColumnSelection::All, &mut Memory::for_program(bytes))
            .map_err(|e| e.to_string())
    };
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    // A line without end: two gigabytes of zeros in a sparse file.
    let sparse = std::fs::File::create(folder.path().join("zeros.csv")).expect("made");
    sparse.set_len(2 << 30).expect("sparse");
    assert!(read_within("zeros.csv", 1_000_000_000).expect_err("too long").contains("a line of more than"));
    let sparse = std::fs::File::create(folder.path().join("zeros.mf4")).expect("made");
    sparse.set_len(2 << 30).expect("sparse");
    assert!(read_within("zeros.mf4", 1_000_000_000).expect_err("nothing").contains("no MDF file"));
    write("wide.csv", &format!("{}\n{}\n", vec!["a"; 60_000].join(","), vec!["1"; 60_000].join(",")));
    assert!(read_within("wide.csv", 1_000_000_000).expect_err("too wide").contains("at most 50000"));
    write("long.csv", &format!("a,b\n{}", "1,2\n".repeat(100_000)));
    let said = read_within("long.csv", 1_000_000).expect_err("too long");
    assert!(said.contains("--memory") && said.contains("long.csv"), "{said}");
    assert_eq!(read_within("long.csv", 100_000_000).map(|c| c.rows()), Ok(100_000));
    write("bomb.csv.gz", "");
    let packed = std::fs::File::create(folder.path().join("bomb.csv.gz")).expect("made");
    let mut packer = flate2::write::GzEncoder::new(packed, flate2::Compression::fast());
    std::io::Write::write_all(&mut packer, b"a,b\n").expect("written");
    for _ in 0..200 {
        std::io::Write::write_all(&mut packer, "1,2\n".repeat(10_000).as_bytes()).expect("written");
    }
    packer.finish().expect("written");
    assert!(read_within("bomb.csv.gz", 10_000_000).expect_err("too long").contains("--memory"));
    #[cfg(unix)]
    assert!(
        read(&PathBuf::from("/dev/zero"), FileLayout::default(), ColumnSelection::All, &mut Memory::for_program(1))
            .is_err()
    );
}

/// Typical irregularities of spreadsheet exports, one per line.
#[test]
fn odd_rows_of_text_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.csv");
    let parse = |text: &str, header: bool| {
        std::fs::write(&path, text).expect("written");
        let layout = FileLayout { header, ..FileLayout::default() };
        read(&path, layout, ColumnSelection::All, &mut Memory::for_program(1_000_000)).map_err(|e| e.to_string())
    };
    let numbers = |text: &str, header: bool, name: &str| {
        let c = parse(text, header).unwrap_or_else(|e| panic!("{text:?}: {e}"));
        let values = c.values[c.find(name).unwrap_or_else(|| panic!("{name} in {:?}", c.names))].clone();
        values.iter().map(|v| if v.is_nan() { "-".to_string() } else { v.to_string() }).collect::<Vec<_>>().join(" ")
    };
    // A text over two lines, in a row and in the names; with a comma and a quotation mark inside.
    assert_eq!(numbers("t,v,note\n0,1,ok\n0.1,5,\"bump\nagain\"\n0.2,7,\"a, \"\"b\"\"\"\n", true, "v"), "1 5 7");
    assert_eq!(numbers("t,\"Speed\n[rpm]\",torque\n0,1,2\n1,3,4\n", true, "torque"), "2 4");
    // Decimal commas without names.
    assert_eq!(numbers("1,5;2,5\n3,5;4,5\n", false, "2"), "2.5 4.5");
    assert_eq!(numbers("0,001\t1,5\n0,002\t2,5\n", false, "1"), "0.001 0.002");
    assert_eq!(numbers("1,5\n2,6\n", false, "2"), "5 6");
    // Lost samples keep their position; separators at the end are ignored.
    assert_eq!(numbers("a;b\n1;2\n;\n;\n3;4\n;\n;\n", true, "b"), "2 - - 4");
    // The first row may have fewer fields than others.
    assert_eq!(numbers("0,1,\n1,1,5\n", false, "3"), "- 5");
    // A quotation mark that is never closed, in the last line and with columns behind it.
    assert_eq!(numbers("a,b\n1,x\n2,\"y\n", true, "a"), "1 2");
    assert!(parse("a,b,c\n1,\"x\n", true).expect_err("lost").to_string().contains("is not closed"));
    assert!(
        parse(&format!("a,b,c\n1,\"x{}", "\ny".repeat(200)), true)
            .expect_err("lost")
            .to_string()
            .contains("within 100 lines")
    );
    assert!(parse("", true).is_err() && parse("a,b\n", true).is_err() && parse("\n\n#x\n", true).is_err());
}

/// Found by fuzzing: pages that contain less than they state, on which the decoding library panics.
#[test]
fn a_library_that_gives_up_is_an_error() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/hostile/byte_stream_split.parquet");
    let said = read(&path, FileLayout::default(), ColumnSelection::All, &mut Memory::for_program(100_000_000))
        .expect_err("damaged")
        .to_string();
    assert!(said.contains("byte_stream_split.parquet") && said.contains("its reader gave up"), "{said}");
}

/// Found by fuzzing: page headers and a footer that state lists of 2^31 elements, which the library skips one by one,
/// and a dictionary of 2^31 numbers, which it allocates.
#[test]
fn what_is_not_there_is_refused_before_the_library_takes_it_for_granted() {
    for (name, why) in [
        ("page_header_list", "a page header holds something unknown"),
        ("footer_list", "the footer holds something unknown"),
        ("dictionary_count", "a page header states more values of a dictionary than its page has room for"),
    ] {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/hostile/{name}.parquet"));
        let said = read(&path, FileLayout::default(), ColumnSelection::All, &mut Memory::for_program(100_000_000))
            .expect_err("damaged")
            .to_string();
        assert!(said.contains(name) && said.contains(why), "{said}");
    }
}

/// Found by fuzzing: a channel of variable length whose offsets claim 10^14 bytes, which the library allocated.
#[test]
fn a_channel_of_variable_length_is_no_column_of_numbers() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/hostile/variable_length.mf4");
    let read = read(&path, FileLayout::default(), ColumnSelection::All, &mut Memory::for_program(100_000_000));
    let columns = read.unwrap_or_else(|e| panic!("{e}"));
    let wrong: Vec<&str> = columns.wrong.iter().flatten().map(String::as_str).collect();
    assert!(wrong.iter().any(|w| w.contains("has values of variable length, no numbers")), "{wrong:?}");
}
