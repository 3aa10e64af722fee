"""Makes the files in this folder: one table, written by many tools.

    python make.py          write every file but the two of the next line
    python make.py columns  write mdf420_columns*.mf4; needs asammdf 8.0.1
    python make.py check    read every file back and compare it with the truth

Versions used for the committed files:

    Python 3.11.7, numpy 2.4.6, pandas 3.1.1, pyarrow 26.0.1, polars 2.1.0,
    duckdb 2.0.0, asammdf 8.8.28, openpyxl 3.1.5, odfpy 1.4.1,
    LibreOffice Calc 7.4.7.2

and for `columns`, in an environment of its own: asammdf 8.0.1, numpy 1.26.4,
pandas 3.0.6. (asammdf 8.8.28 fails when it writes or reads column storage.)
Only for the check: mdfreader 4.3.

LibreOffice is called as `soffice`; without it, its two files are left as they are.
The table is computed with sin and exp and then rounded, so it should come out the
same on every machine. Parquet, MDF and LibreOffice files may differ in some
bytes when other versions of the tools write them.
"""

import csv
import datetime
import math
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile

import numpy as np
import pandas as pd
from asammdf import MDF, Signal

HERE = pathlib.Path(__file__).resolve().parent
N = 200
START = datetime.datetime(2026, 3, 1, 12, 0, 0)
NUMBERS = ["time_s", "speed_rpm", "torque_nm"]
STRAY_ROW = 100  # counted from 0: the row with time_s = 1.0

# The torque is a whole number of steps above its offset, so that a file of
# int16 values with a linear conversion can hold it without loss.
TORQUE_OFFSET = 2.5
TORQUE_STEP = 0.00025


def torque_steps():
    return [round(32000 * math.sin(2 * math.pi * 1.7 * i / 100)) for i in range(N)]


def note(i):
    if i % 10 == 3:
        return 'he said "stop"'
    if i % 10 == 6:
        return "a,b;c"
    if i % 50 == 49:
        return "3,5 \u00b0C"
    return "ok"


def truth():
    time = [round(i / 100, 2) for i in range(N)]
    speed = [
        round(2987.6543 * math.exp(-t / 1.6) + 7.3 * math.sin(2 * math.pi * 11.3 * t), 4)
        for t in time
    ]
    torque = [round(TORQUE_OFFSET + TORQUE_STEP * k, 5) for k in torque_steps()]
    return pd.DataFrame(
        {
            "time_s": time,
            "speed_rpm": speed,
            "torque_nm": torque,
            "note": [note(i) for i in range(N)],
        }
    )


def truth_10hz():
    time = [round(i / 10, 1) for i in range(N // 10)]
    return pd.DataFrame(
        {
            "time_s": time,
            "temperature_degc": [round(81.25 - 9.7 * math.exp(-t / 0.9), 4) for t in time],
        }
    )


# ------------------------------------------------------------------ CSV


def text_of(frame, **options):
    options.setdefault("lineterminator", "\n")
    return frame.to_csv(None, index=False, **options)


def write_bytes(name, data):
    (HERE / name).write_bytes(data)


def make_csv():
    t = truth()
    write_bytes("truth.csv", text_of(t).encode("utf-8"))
    write_bytes("truth_10hz.csv", text_of(truth_10hz()).encode("utf-8"))

    t.to_csv(
        HERE / "csv_pandas_bom_crlf.csv", index=False, encoding="utf-8-sig", lineterminator="\r\n"
    )

    # What Excel writes in Germany as "CSV (Trennzeichen-getrennt)".
    german = t.copy()
    slow = truth_10hz()["temperature_degc"].tolist()
    german.insert(3, "\u00d6ltemperatur_\u00b0C", [slow[i // 10] for i in range(N)])
    german.to_csv(
        HERE / "csv_excel_german_cp1252.csv",
        index=False,
        sep=";",
        decimal=",",
        encoding="cp1252",
        lineterminator="\r\n",
    )

    # What Excel writes as "Unicode text"; LabVIEW writes much the same.
    tabs = text_of(t, sep="\t", lineterminator="\r\n")
    write_bytes("csv_utf16le_tab.txt", b"\xff\xfe" + tabs.encode("utf-16-le"))
    commas = text_of(t, lineterminator="\r\n")
    write_bytes("csv_utf16be_comma.csv", b"\xfe\xff" + commas.encode("utf-16-be"))

    instants = [START + datetime.timedelta(milliseconds=10 * i) for i in range(N)]
    cet = datetime.timezone(datetime.timedelta(hours=1))
    for name, write in [
        ("csv_iso_t.csv", lambda d: d.isoformat("T", "milliseconds")),
        ("csv_iso_z.csv", lambda d: d.isoformat("T", "milliseconds") + "Z"),
        (
            "csv_iso_offset.csv",
            lambda d: d.replace(tzinfo=cet).isoformat("T", "milliseconds"),
        ),
        ("csv_iso_space.csv", lambda d: d.isoformat(" ", "milliseconds")),
    ]:
        iso = t.drop(columns="time_s")
        iso.insert(0, "time", [write(d) for d in instants])
        write_bytes(name, text_of(iso).encode("utf-8"))

    # A test bench: the units in a second line.
    lines = text_of(t, sep=";").split("\n")
    lines.insert(1, "s;rpm;Nm;-")
    write_bytes("csv_units_row.csv", "\n".join(lines).encode("utf-8"))

    # A field that begins with a quote and never ends. In the first file no
    # quote follows it; in the second the later rows have theirs, so that
    # the open field seems to end in the middle of a later row.
    quiet = t.copy()
    quiet.loc[STRAY_ROW:, "note"] = "ok"
    for name, frame in [
        ("csv_stray_quote.csv", quiet),
        ("csv_stray_quote_more_quotes.csv", t),
    ]:
        lines = text_of(frame).split("\n")
        cut = lines[STRAY_ROW + 1].rsplit(",", 1)
        assert cut[1] == "ok"
        lines[STRAY_ROW + 1] = cut[0] + ',"broken'
        write_bytes(name, "\n".join(lines).encode("utf-8"))

    twice = t.copy()
    twice.insert(2, "second", [round(v + 100.0, 4) for v in t["speed_rpm"]])
    twice.columns = ["time_s", "speed_rpm", "speed_rpm", "torque_nm", "note"]
    twice.to_csv(HERE / "csv_same_name_twice.csv", index=False, lineterminator="\n")

    t.to_csv(
        HERE / "csv_gzip.csv.gz",
        index=False,
        lineterminator="\n",
        compression={"method": "gzip", "mtime": 0},
    )


GERMAN_PROFILE = """<?xml version="1.0" encoding="UTF-8"?>
<oor:items xmlns:oor="http://openoffice.org/2001/registry">
<item oor:path="/org.openoffice.Setup/L10N">
<prop oor:name="ooSetupSystemLocale" oor:op="fuse"><value>de-DE</value></prop>
</item>
</oor:items>
"""


def make_libreoffice():
    """Two exports by Calc, from workbooks that pandas wrote.

    Filter options of the second: separator (59 is a semicolon), quote (34),
    character set (76 is UTF-8), first line, column formats, language (1031
    is German, Germany), quote all text, detect numbers (for an export: write
    the cells as shown). The language in the filter options is for reading
    only: the decimal comma comes from the locale in the user profile.
    """
    if shutil.which("soffice") is None:
        print("no soffice: the LibreOffice files are not made again")
        return
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        truth().to_excel(folder / "plain.xlsx", index=False, engine="openpyxl")
        truth().to_excel(folder / "german.ods", index=False, engine="odf")
        for source, name, profile, target in [
            ("plain.xlsx", "csv_libreoffice.csv", None, "csv"),
            (
                "german.ods",
                "csv_libreoffice_german.csv",
                GERMAN_PROFILE,
                "csv:Text - txt - csv (StarCalc):59,34,76,1,,1031,false,true",
            ),
        ]:
            user = folder / (source + "-profile") / "user"
            user.mkdir(parents=True)
            if profile:
                (user / "registrymodifications.xcu").write_text(profile, encoding="utf-8")
            subprocess.run(
                [
                    "soffice",
                    f"-env:UserInstallation={user.parent.as_uri()}",
                    "--headless",
                    "--convert-to",
                    target,
                    "--outdir",
                    str(folder),
                    str(folder / source),
                ],
                check=True,
                capture_output=True,
                timeout=120,
            )
            shutil.copyfile((folder / source).with_suffix(".csv"), HERE / name)


# -------------------------------------------------------------- Parquet


def make_parquet():
    import duckdb
    import polars as pl
    import pyarrow as pa
    import pyarrow.parquet as pq

    t = truth()
    for name, compression in [
        ("snappy", "snappy"),
        ("gzip", "gzip"),
        ("lz4", "lz4"),
        ("brotli", "brotli"),
        ("zstd", "zstd"),
        ("none", None),
    ]:
        if compression == "snappy":
            t.to_parquet(HERE / "parquet_snappy.parquet")  # every setting as it comes
        else:
            t.to_parquet(HERE / f"parquet_{name}.parquet", compression=compression)

    # Data pages of version 2, small pages, three row groups, many encodings.
    table = pa.table(
        {
            "time_s": pa.array(t["time_s"].to_numpy()),
            "speed_rpm": pa.array(t["speed_rpm"].to_numpy()),
            "torque_nm": pa.array(t["torque_nm"].to_numpy()),
            "sample": pa.array(range(N), pa.int64()),
            "torque_raw": pa.array(torque_steps(), pa.int32()),
            "note": pa.array(t["note"].tolist()),
            "note_lengths": pa.array(t["note"].tolist()),
            "note_prefixes": pa.array(t["note"].tolist()),
        }
    )
    pq.write_table(
        table,
        HERE / "parquet_v2_encodings.parquet",
        version="2.6",
        data_page_version="2.0",
        compression="snappy",
        row_group_size=80,
        data_page_size=256,
        write_batch_size=32,
        use_dictionary=["note", "torque_nm"],
        column_encoding={
            "time_s": "BYTE_STREAM_SPLIT",
            "speed_rpm": "BYTE_STREAM_SPLIT",
            "sample": "DELTA_BINARY_PACKED",
            "torque_raw": "DELTA_BINARY_PACKED",
            "note_lengths": "DELTA_LENGTH_BYTE_ARRAY",
            "note_prefixes": "DELTA_BYTE_ARRAY",
        },
    )

    # Many types, with gaps, and the time as the index of the frame.
    index = pd.DatetimeIndex(
        np.datetime64(START, "ns") + np.arange(N) * np.timedelta64(10_000_000, "ns"),
        name="time",
    )
    speed = t["speed_rpm"].to_numpy().copy()
    speed[50:55] = np.nan
    types = pd.DataFrame(
        {
            "speed_rpm": speed,
            "torque_nm": t["torque_nm"].to_numpy().astype(np.float32),
            "torque_raw": np.array(torque_steps(), np.int16),
            "count": pd.array([None if i % 10 == 7 else i for i in range(N)], "Int64"),
            "driving": t["torque_nm"].to_numpy() > 0.0,
            "note": [None if i % 25 == 24 else s for i, s in enumerate(t["note"])],
        },
        index=index,
    )
    types.to_parquet(HERE / "parquet_types_nulls.parquet")

    nested = pa.table(
        {
            "time_s": pa.array(t["time_s"].to_numpy()),
            "shaft": pa.array(
                [
                    None if i % 40 == 39 else {"angle_deg": i * 1.5, "turns": i // 7}
                    for i in range(N)
                ],
                pa.struct([("angle_deg", pa.float64()), ("turns", pa.int32())]),
            ),
            "speed_rpm": pa.array(t["speed_rpm"].to_numpy()),
            "peaks": pa.array(
                [None if i % 40 == 20 else [0.5 * i] * (i % 4) for i in range(N)],
                pa.list_(pa.float64()),
            ),
            "torque_nm": pa.array(t["torque_nm"].to_numpy()),
            "note": pa.array(t["note"].tolist()),
        }
    )
    pq.write_table(nested, HERE / "parquet_nested.parquet")

    pl.read_csv(HERE / "truth.csv").write_parquet(HERE / "parquet_polars.parquet")

    frame = t  # the name by which the query finds it
    target = HERE / "parquet_duckdb.parquet"
    with duckdb.connect() as connection:
        connection.register("frame", frame)
        connection.execute(f"COPY (SELECT * FROM frame) TO '{target}' (FORMAT parquet)")


# ------------------------------------------------------------------ MDF


def signal(name, unit, values, time, **more):
    return Signal(samples=values, timestamps=time, name=name, unit=unit, **more)


def signals():
    t = truth()
    time = t["time_s"].to_numpy()
    return [
        signal("speed_rpm", "rpm", t["speed_rpm"].to_numpy(), time),
        signal("torque_nm", "Nm", t["torque_nm"].to_numpy(), time),
        signal(
            "note",
            "",
            np.array([s.encode("utf-8") for s in t["note"]]),
            time,
            encoding="utf-8",
        ),
    ]


def slow_signals():
    slow = truth_10hz()
    return [
        signal(
            "temperature_degc",
            "\u00b0C",
            slow["temperature_degc"].to_numpy(),
            slow["time_s"].to_numpy(),
        )
    ]


def raw_signals():
    """int16 values and a linear conversion, as a control unit keeps them."""
    t = truth()
    time = t["time_s"].to_numpy()
    steps = np.array(torque_steps(), np.int16)
    to_torque = {"a": TORQUE_STEP, "b": TORQUE_OFFSET}
    speed = np.array([round(10 * v) for v in t["speed_rpm"]], np.int16)
    return [
        signal("speed_rpm", "rpm", speed, time, conversion={"a": 0.1, "b": 0.0}),
        signal("torque_nm", "Nm", steps, time, conversion=dict(to_torque)),
        signal("torque_motorola_nm", "Nm", steps.astype(">i2"), time, conversion=dict(to_torque)),
    ]


def save_mdf(name, groups, version="4.10", compression=0, fragment=None, columns=False):
    start = START.replace(tzinfo=datetime.timezone.utc)
    with MDF(version=version, column_storage=columns) as mdf:
        if fragment:
            mdf.configure(write_fragment_size=fragment)
        mdf.header.start_time = start
        for group, comment in groups:
            mdf.append(group, acq_name=comment, comment=comment)
        mdf.save(HERE / name, overwrite=True, compression=compression)
    # The file history has the time of writing: replace it, so that the file
    # comes out the same each time.
    data = bytearray((HERE / name).read_bytes())
    struct.pack_into("<Q", data, data.index(b"##FH") + 40, int(start.timestamp()) * 10**9)
    (HERE / name).write_bytes(data)


def read_blocks(data):
    """The blocks of an MDF file that can be reached: address -> [id, links, rest]."""
    blocks, todo = {}, [64]
    while todo:
        at = todo.pop()
        if at == 0 or at in blocks:
            continue
        kind, length, count = struct.unpack_from("<4s4xQQ", data, at)
        links = list(struct.unpack_from(f"<{count}Q", data, at + 24))
        blocks[at] = [kind, links, bytes(data[at + 24 + 8 * count : at + length])]
        todo.extend(links)
    return blocks


def write_blocks(head, blocks):
    """The file that read_blocks would read like this; the header block comes first."""
    place, end = {0: 0}, 64
    for at in sorted(blocks):
        place[at] = end
        _, links, rest = blocks[at]
        end += (24 + 8 * len(links) + len(rest) + 7) // 8 * 8
    data = bytearray(end)
    data[:64] = head
    for at, (kind, links, rest) in blocks.items():
        length = 24 + 8 * len(links) + len(rest)
        block = struct.pack("<4s4xQQ", kind, length, len(links))
        block += struct.pack(f"<{len(links)}Q", *(place[link] for link in links)) + rest
        data[place[at] : place[at] + length] = block
    return bytes(data)


def make_unsorted(source, target):
    """Two data groups of a sorted file become one, with a record id before each record.

    asammdf cannot write such a file, so the blocks that it wrote are arranged
    anew here. The records stand in the order of their times.
    """
    data = (HERE / source).read_bytes()
    blocks = read_blocks(data)
    first = blocks[blocks[64][1][0]]  # HD -> first data group
    second = blocks[first[1][0]]
    records = []
    for number, group in enumerate([first, second], start=1):
        channel_group = blocks[group[1][1]]
        fields = list(struct.unpack("<QQHH4xII", channel_group[2]))
        fields[0] = number
        channel_group[2] = struct.pack("<QQHH4xII", *fields)
        size = fields[4] + fields[5]
        raw = blocks[group[1][2]][2]
        for i in range(fields[1]):
            record = raw[i * size : (i + 1) * size]
            time = struct.unpack_from("<d", record)[0]
            records.append((time, number, record))
    records.sort(key=lambda r: r[:2])
    blocks[first[1][2]][2] = b"".join(bytes([n]) + record for _, n, record in records)
    blocks[first[1][1]][1][0] = second[1][1]  # next channel group
    first[1][0] = 0  # no next data group
    first[2] = b"\x01" + first[2][1:]  # one byte of record id
    kept = read_blocks(write_blocks(data[:64], blocks))  # drops what is out of use
    (HERE / target).write_bytes(write_blocks(data[:64], kept))


def make_mdf():
    fast = (signals, "100 Hz")
    slow = (slow_signals, "10 Hz")

    def build(*parts):
        return [(make(), comment) for make, comment in parts]

    save_mdf("mdf410_plain.mf4", build(fast))
    save_mdf("mdf410_deflate.mf4", build(fast), compression=1)
    save_mdf("mdf410_transposed.mf4", build(fast), compression=2)
    save_mdf("mdf420_plain.mf4", build(fast), version="4.20")
    save_mdf("mdf410_two_rates.mf4", build(fast, slow))
    save_mdf("mdf410_int16_linear.mf4", build((raw_signals, "100 Hz")))
    save_mdf("mdf410_block_list.mf4", build(fast), compression=2, fragment=2048)
    make_unsorted("mdf410_two_rates.mf4", "mdf410_unsorted.mf4")


def make_columns():
    group = [(signals(), "100 Hz")]
    save_mdf("mdf420_columns.mf4", group, version="4.20", columns=True)
    save_mdf("mdf420_columns_deflate.mf4", group, version="4.20", columns=True, compression=1)


# ---------------------------------------------------------------- check


def same(name, columns, notes=True, allow=0.0, rows=N):
    """Compares columns (name -> values) with the truth; time_s may be missing."""
    t = truth()
    compared = []
    for column in NUMBERS:
        if column in columns:
            got = np.array([float(v) for v in columns[column]][:rows])
            want = t[column].to_numpy()[:rows]
            assert len(got) == rows, (name, column, len(got))
            assert np.max(np.abs(got - want)) <= allow, (name, column)
            compared.append(column)
    assert compared[-2:] == NUMBERS[1:], (name, compared)
    if notes:
        assert list(columns["note"])[:rows] == t["note"].tolist()[:rows], (name, "note")
        compared.append("note")
    print(f"{name}: {', '.join(compared)}")


def rows_of(name, encoding="utf-8", separator=",", decimal="."):
    """The file by the csv module of Python: header and rows."""
    with open(HERE / name, encoding=encoding, newline="") as file:
        rows = list(csv.reader(file, delimiter=separator))
    if decimal != ".":
        number = [i for i, head in enumerate(rows[0]) if head != "note"]
        for row in rows[1:]:
            for i in number:
                row[i] = row[i].replace(decimal, ".")
    return rows


def by_name(rows):
    return {head: [row[i] for row in rows[1:]] for i, head in enumerate(rows[0])}


def check_csv():
    for name, how in [
        ("truth.csv", {}),
        ("csv_pandas_bom_crlf.csv", {"encoding": "utf-8-sig"}),
        ("csv_excel_german_cp1252.csv", {"encoding": "cp1252", "separator": ";", "decimal": ","}),
        ("csv_utf16le_tab.txt", {"encoding": "utf-16", "separator": "\t"}),
        ("csv_utf16be_comma.csv", {"encoding": "utf-16"}),
        ("csv_libreoffice.csv", {"encoding": "cp1252"}),
        ("csv_libreoffice_german.csv", {"separator": ";", "decimal": ","}),
    ]:
        same(name, by_name(rows_of(name, **how)))
    assert (HERE / "csv_pandas_bom_crlf.csv").read_bytes()[:3] == b"\xef\xbb\xbf"
    assert (HERE / "csv_utf16le_tab.txt").read_bytes()[:2] == b"\xff\xfe"
    assert (HERE / "csv_utf16be_comma.csv").read_bytes()[:2] == b"\xfe\xff"
    german = by_name(rows_of("csv_excel_german_cp1252.csv", "cp1252", ";", ","))
    slow = truth_10hz()["temperature_degc"].tolist()
    got = [float(v) for v in german["\u00d6ltemperatur_\u00b0C"]]
    assert got == [slow[i // 10] for i in range(N)]

    for name, shift in [
        ("csv_iso_t.csv", 0),
        ("csv_iso_z.csv", 0),
        ("csv_iso_offset.csv", 3600),
        ("csv_iso_space.csv", 0),
    ]:
        columns = by_name(rows_of(name))
        start = START.replace(tzinfo=datetime.timezone.utc).timestamp() - shift
        for i, text in enumerate(columns["time"]):
            at = datetime.datetime.fromisoformat(text)
            at = at if at.tzinfo else at.replace(tzinfo=datetime.timezone.utc)
            assert abs(at.timestamp() - start - i / 100) < 1e-6
        same(name, columns)

    rows = rows_of("csv_units_row.csv", separator=";")
    assert rows.pop(1) == ["s", "rpm", "Nm", "-"]
    same("csv_units_row.csv", by_name(rows))

    rows = rows_of("csv_same_name_twice.csv")
    assert rows[0] == ["time_s", "speed_rpm", "speed_rpm", "torque_nm", "note"]
    first, second = ([float(row[i]) for row in rows[1:]] for i in (1, 2))
    assert all(abs(b - a - 100.0) < 1e-9 for a, b in zip(first, second))
    rows[0][2] = "second"
    same("csv_same_name_twice.csv", by_name(rows))

    # Line by line, as the two broken files have to be read.
    for name in ["csv_stray_quote.csv", "csv_stray_quote_more_quotes.csv"]:
        lines = (HERE / name).read_text(encoding="utf-8").splitlines()
        rows = [line.split(",", 3) for line in lines]
        assert rows[STRAY_ROW + 1][0] == "1.0" and rows[STRAY_ROW + 1][3] == '"broken'
        quotes = sum(row[3].count('"') for row in rows[STRAY_ROW + 1 :])
        assert (quotes == 1) == (name == "csv_stray_quote.csv")
        same(name, by_name(rows), notes=False)
        good = [next(csv.reader([line])) for line in lines[: STRAY_ROW + 1]]
        same(name, by_name(good), rows=STRAY_ROW)

    import duckdb

    for name in ["csv_gzip.csv.gz"]:
        same(name, duckdb.read_csv(str(HERE / name)).fetchnumpy())


def check_parquet():
    import duckdb
    import polars as pl
    import pyarrow.parquet as pq

    def with_duckdb(name):
        return {
            column: list(values)
            for column, values in duckdb.read_parquet(str(HERE / name)).df().items()
        }

    def with_pyarrow(name):
        return pq.read_table(HERE / name).to_pydict()

    def with_polars(name):
        return pl.read_parquet(HERE / name).to_dict(as_series=False)

    for codec in ["snappy", "gzip", "lz4", "brotli", "zstd", "none"]:
        name = f"parquet_{codec}.parquet"
        same(name, with_duckdb(name))
        same(name, with_polars(name))
        used = pq.ParquetFile(HERE / name).metadata.row_group(0).column(1).compression
        assert used.lower().replace("uncompressed", "none") == codec, (name, used)
    for name in ["parquet_polars.parquet", "parquet_duckdb.parquet"]:
        same(name, with_pyarrow(name))

    name = "parquet_v2_encodings.parquet"
    for columns in [with_duckdb(name), with_polars(name)]:
        same(name, columns)
        assert list(columns["sample"]) == list(range(N))
        assert list(columns["torque_raw"]) == torque_steps()
        assert list(columns["note_lengths"]) == list(columns["note_prefixes"])
        assert list(columns["note_lengths"]) == truth()["note"].tolist()

    name = "parquet_types_nulls.parquet"
    columns = with_polars(name)
    t = truth()
    assert all(
        at == START + datetime.timedelta(milliseconds=10 * i)
        for i, at in enumerate(columns["time"])
    )
    for i in range(N):
        speed, count, text = (columns[c][i] for c in ("speed_rpm", "count", "note"))
        assert speed == (None if 50 <= i < 55 else t["speed_rpm"][i]), i
        assert count == (None if i % 10 == 7 else i), i
        assert text == (None if i % 25 == 24 else t["note"][i]), i
        assert columns["torque_nm"][i] == float(np.float32(t["torque_nm"][i])), i
        assert columns["driving"][i] == (t["torque_nm"][i] > 0.0), i
    assert columns["torque_raw"] == torque_steps()
    print(f"{name}: {', '.join(columns)}")

    name = "parquet_nested.parquet"
    columns = with_polars(name)
    same(name, columns)
    for i, (shaft, peaks) in enumerate(zip(columns["shaft"], columns["peaks"])):
        if i % 40 == 39:
            assert shaft is None or set(shaft.values()) == {None}, i
        else:
            assert shaft == {"angle_deg": i * 1.5, "turns": i // 7}, i
        assert peaks == (None if i % 40 == 20 else [0.5 * i] * (i % 4)), i
    columns = with_duckdb(name)
    same(name, columns)


def check_mdf():
    import mdfreader

    slow = truth_10hz()
    for path in sorted(HERE.glob("*.mf4")):
        name = path.name
        # asammdf 8.8.28 cannot read column storage
        readers = ["mdfreader"] if "columns" in name else ["mdfreader", "asammdf"]
        for reader in readers:
            columns = {}
            if reader == "mdfreader":
                file = mdfreader.Mdf(str(path))
                for channel in file:
                    columns[channel] = file.get_channel_data(channel)
                columns["time_s"] = columns["time"]
            else:
                with MDF(path) as file:
                    assert file.start_time.timestamp() == START.replace(
                        tzinfo=datetime.timezone.utc
                    ).timestamp()
                    for channel in file.channels_db:
                        if channel != "time":
                            found = file.get(channel)
                            columns[channel] = found.samples
                            columns[channel + "@"] = found.timestamps
                columns["time_s"] = columns["speed_rpm@"]
                if "note" in columns:
                    columns["note"] = [v.decode("utf-8") for v in columns["note"]]
            raw = name == "mdf410_int16_linear.mf4"
            if raw:
                # speed: half a step of 0.1; torque: the last digits of a product
                speed = truth()["speed_rpm"].to_numpy()
                torque = truth()["torque_nm"].to_numpy()
                assert np.max(np.abs(columns["speed_rpm"] - speed)) <= 0.05 + 1e-9
                for channel in ["torque_nm", "torque_motorola_nm"]:
                    assert np.max(np.abs(columns[channel] - torque)) < 1e-12
                print(f"{name}: by {reader}, within the steps of int16")
            else:
                # mdfreader gives offsets for the text of an unsorted file
                texts = not (reader == "mdfreader" and "unsorted" in name)
                same(f"{name} by {reader}", columns, notes=texts)
            if name in ("mdf410_two_rates.mf4", "mdf410_unsorted.mf4"):
                assert list(columns["temperature_degc"]) == slow["temperature_degc"].tolist()
                if reader == "asammdf":
                    assert list(columns["temperature_degc@"]) == slow["time_s"].tolist()


def check():
    check_csv()
    check_parquet()
    check_mdf()


def main():
    if sys.argv[1:] == ["check"]:
        check()
    elif sys.argv[1:] == ["columns"]:
        make_columns()
    elif len(sys.argv) == 1:
        make_csv()
        make_libreoffice()
        make_parquet()
        make_mdf()
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main()
