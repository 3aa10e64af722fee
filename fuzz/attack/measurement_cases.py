"""Measurements and their data files, damaged or odd, given to `identify`."""

import math
import random
import shutil

import pyarrow
import pyarrow.parquet
from harness import Case, World
from text_cases import mutate_bytes, mutate_toml

RIG = """title = "a disc with friction"
fidelity = "lumped"

[rotors.disc]
inertia_kg_m2 = 0.055

[loads.viscous.disc]
torque_nm_s_per_rad = 0.1

[inputs.torque.disc]

[sensors.tachometer.disc]
"""
MEASUREMENT = """title = "rig"
drive = "rig.toml"

[files.a]
path = "a.csv"

[files.b]
path = "b.csv"

[channels.speed]
sensor = "sensors.tachometer.disc"
column = "speed_rpm"
unit = "rpm"

[inputs.torque]
input = "inputs.torque.disc"
column = "torque"
unit = "N m"
hold = true

[records.a]
file = "a"
time_column = "time_ms"
time_unit = "ms"

[records.b]
file = "b"
use = "judge"
time_column = "time_ms"
time_unit = "ms"

[fit."rotors.disc.inertia_kg_m2"]
spread_percent = 20

[fit."loads.viscous.disc.torque_nm_s_per_rad"]
"""
MF4 = MEASUREMENT.replace('path = "a.csv"', 'path = "a.mf4"\ngroup = 0').replace('path = "b.csv"', 'path = "a.mf4"\ngroup = 0').replace(
    '"time_ms"', '"time"').replace('"speed_rpm"', '"speed"').replace('time_unit = "ms"', 'time_unit = "s"')  # fmt: skip
LINKS = """title = "links"
drive = "drive.toml"

[files.a]
path = "a.mcap"

[channels.torque]
sensor = "sensors.torque.driver"
column = "sensors.torque.driver"
unit = "N m"

[records.a]
file = "a"
time_column = "t_s"
time_unit = "s"
judge_share = 0.5
"""
CODECS = ["none", "snappy", "gzip", "brotli", "lz4", "zstd"]
HEADINGS = ["time_ms", "speed_rpm", "torque"]
CPU_LIMIT_S = 10.0


def write_rig(world: World) -> None:
    """A disc of known torque, measured twice."""
    folder = world.folder / "rig"
    folder.mkdir()
    (folder / "rig.toml").write_text(RIG)
    (folder / "rig-measured.toml").write_text(MEASUREMENT)
    for name, phase in (("a", 0.0), ("b", 1.0)):
        rows = [",".join(HEADINGS)] + [",".join(f"{value:.6g}" for value in row) for row in _samples(120, phase)]
        (folder / f"{name}.csv").write_text("\n".join(rows) + "\n")


def _samples(count: int, phase: float) -> list[list[float]]:
    step, speed, rows = 0.002, 0.0, []
    for i in range(count):
        torque = 2.0 * math.sin(3 * i * step + phase) + (2.0 if i // 40 % 2 else -1.0)
        rows.append([1000 * i * step, speed * 30 / math.pi, torque])
        speed += step * (torque - 0.1 * speed - 0.4 * math.copysign(1.0, speed)) / 0.05
    return rows


def measurements(case: Case) -> None:
    for file in (case.world.folder / "rig").iterdir():
        shutil.copy(file, case.folder)
    case.rng.choice([_toml, _toml, _csv, _csv, _csv, _parquet, _parquet, _mf4, _recording])(case)
    arguments = ["identify", "rig-measured.toml", "--budget", case.rng.choice(["20", "60", "1s"])]
    extra = case.rng.choice([[], [], [], ["--facts"], ["--json"], ["--report", "report.html", "-o", "new.toml", "-o", "loop.rrd"], ["--threads", "3"]])
    case.run(*arguments, *extra, cpu_limit=CPU_LIMIT_S)


def _toml(case: Case) -> None:
    name = case.rng.choice(["rig.toml", "rig-measured.toml", "rig-measured.toml"])
    text = case.path(name).read_text()
    for _ in range(case.rng.choice([1, 1, 2, 4])):
        text = _mutate_measurement(case.rng, text)
    case.write(name, text)


def _mutate_measurement(rng: random.Random, text: str) -> str:
    if rng.random() < 0.6:
        return mutate_toml(rng, text)
    additions = [
        ("[files.a]", rng.choice(["header = false", 'separator = ";"', 'separator = ""', "skip_lines = 1", "skip_lines = 99999999999", "group = 3", 'decimal = ","'])),
        ("[records.a]", rng.choice(["rate_hz = 200", "rate_hz = 0", "rate_hz = 1e300", "rate_hz = -1", "from_row = 90", "to_row = 0", "to_row = 3", "judge_from_row = 60",
                                    "judge_from_row = 99999999999", "judge_share = 0.5", "judge_share = 2", 'start = "rest"', 'split = "coasting"',
                                    'set."loads.viscous.disc.torque_nm_s_per_rad" = 1e300', 'columns.speed = "torque"', 'columns.speed = "none"'])),
        ("[channels.speed]", rng.choice(["noise = 0", "noise = -1", "noise = 1e300", "noise = 1e-300", "noise = nan", 'values = "times"'])),
        ('[fit."rotors.disc.inertia_kg_m2"]', rng.choice(["low = 1\nhigh = 0", "low = 0\nhigh = 0", "low = -1\nhigh = inf", "low = 1e-300\nhigh = 1e300", 'per = "record"', 'per = "part"'])),
        ("[inputs.torque]", rng.choice(['unit = "V"', "hold = 3", "scale = 0"])),
    ]  # fmt: skip
    anchor, line = rng.choice(additions)
    if rng.random() < 0.15:
        return text + rng.choice(["\n[candidates]\nonly = []\n", '\n[candidates]\nonly = ["none"]\n', "\n[candidates]\nwithout = 3\n"])
    return text.replace(anchor, f"{anchor}\n{line}", 1)


def _odd_samples(rng: random.Random) -> list[list[float]]:
    """Samples with something wrong in them."""
    rows = _samples(rng.choice([0, 1, 2, 3, 10, 120, 400]), 0.0)
    if not rows:
        return rows
    column, place = rng.randrange(3), rng.randrange(len(rows))
    kind = rng.randrange(10)
    if kind == 0:
        rows[place][column] = rng.choice([math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 1e30])
    elif kind == 1:
        for row in rows:
            row[column] = rng.choice([math.nan, math.inf, 1e308]) if rng.random() < 0.7 else row[column]
    elif kind == 2:
        rows.reverse()
    elif kind == 3:
        for i, row in enumerate(rows):
            row[0] = rng.choice([i * 1e-12, 1e15 + i, i * 1e12, 0.0, -i * 1.0])
    elif kind == 4:
        rows[place][column] *= 1e9
    elif kind == 5:
        for row in rows:
            row[column] = rows[0][column]
    elif kind == 6:
        rows[place:] = [[row[0] + 1e9, *row[1:]] for row in rows[place:]]
    elif kind == 7:
        rows[place][0] = rows[0][0]
    elif kind == 8:
        for i, row in enumerate(rows):
            row[0] = i * rng.choice([1e-12, 1.0, 1e-3])
    else:
        del rows[place : place + rng.choice([1, 60])]
    return rows


def _csv(case: Case) -> None:
    rng = case.rng
    rows = _odd_samples(rng) if rng.random() < 0.6 else _samples(120, 0.0)
    headings = list(HEADINGS)
    separator, end, decimal, before, encoding = ",", "\n", ".", "", "utf-8"
    kind = rng.randrange(18)
    if kind == 0:
        before = "\ufeff"
    elif kind == 1:
        end = rng.choice(["\r\n", "\r", "\n\n"])
    elif kind == 2:
        separator, decimal = ";", ","
    elif kind == 3:
        encoding = rng.choice(["utf-16", "utf-16-be", "utf-32", "latin-1"])
        headings.append("é")
        rows = [[*row, 0.0] for row in rows]
    elif kind == 4:
        separator = rng.choice(["\t", " ", "|", ";", ", "])
    elif kind == 5:
        headings[rng.randrange(3)] = rng.choice(["", "speed_rpm", '"', "a\0b", '"speed\n_rpm"', "torque"])
    elif kind == 6:
        count = rng.choice([1000, 100_000])
        headings += [f"c{i}" for i in range(count)]
        rows = [[*row, *[0] * count] for row in rows[:5]]
    lines = [separator.join(headings)]
    lines += [separator.join(f"{value:.6g}".replace(".", decimal) for value in row) for row in rows]
    place = rng.randrange(len(lines))
    if kind == 7:
        lines = [] if rng.random() < 0.5 else lines[:1]
    elif kind == 8:
        lines[place] = rng.choice(["1," * 5_000_000, "9" * 5_000_000, '"' + "x" * 5_000_000])
    elif kind == 9:
        lines[place] += rng.choice([",", ",7", '"', "\0", "#", ",,,,"])
    elif kind == 10:
        lines[place] = rng.choice(["", ",,", "a,b,c", '"1","2","3"', '1,"2,3', "1", "0x1,1e,--1", "1e400,1,1", "1,000.5,2,3", "inf,nan,-inf"])
    elif kind == 11:
        before = rng.choice(["# comment\n", "\n\n\n", "units\n", "x" * 1_000_000 + "\n"])
    data = before + end.join(lines) + rng.choice(["", end])
    raw = data.encode(encoding, "replace")
    if kind == 12 and raw:
        raw = mutate_bytes(rng, raw)
    case.write("a.csv", raw)


def _parquet(case: Case) -> None:
    rng = case.rng
    rows = _odd_samples(rng) if rng.random() < 0.5 else _samples(120, 0.0)
    columns = {name: [row[i] for row in rows] for i, name in enumerate(HEADINGS)}
    victim = rng.choice(HEADINGS)
    values = columns[victim]
    arrays = {name: pyarrow.array(column, pyarrow.float64()) for name, column in columns.items()}
    finite = [value if math.isfinite(value) and abs(value) < 1e9 else 0.0 for value in values]
    odd = {
        "nulls": lambda: pyarrow.array([None if rng.random() < 0.3 else v for v in values], pyarrow.float64()),
        "all null": lambda: pyarrow.nulls(len(values)),
        "text": lambda: pyarrow.array([str(v) for v in values]),
        "whole": lambda: pyarrow.array([int(v) for v in finite], rng.choice([pyarrow.int64(), pyarrow.int32()])),
        "half": lambda: pyarrow.array(finite, pyarrow.float32()),
        "lists": lambda: pyarrow.array([[v] for v in values]),
        "structures": lambda: pyarrow.array([{"a": v} for v in values], pyarrow.struct([("a", pyarrow.float64())])),
        "times": lambda: pyarrow.array([int(v) for v in finite], pyarrow.timestamp(rng.choice(["ns", "us", "ms"]))),
        "truths": lambda: pyarrow.array([v > 0 for v in values]),
        "bytes": lambda: pyarrow.array([b"\0" for _ in values], pyarrow.binary()),
        "decimals": lambda: pyarrow.array([int(v) for v in finite], pyarrow.decimal128(20, 0)),
        "categories": lambda: pyarrow.array([str(v) for v in values]).dictionary_encode(),
    }
    if rng.random() < 0.5:
        arrays[victim] = odd[rng.choice(list(odd))]()
    table = pyarrow.table(arrays)
    if rng.random() < 0.1:
        table = pyarrow.Table.from_arrays([*table.columns, table.column(0)], [*table.column_names, victim])
    path = case.path("a.parquet")
    pyarrow.parquet.write_table(
        table, path, compression=rng.choice(CODECS), use_dictionary=rng.random() < 0.5, row_group_size=rng.choice([1, 7, 10_000]),
        data_page_version=rng.choice(["1.0", "2.0"]),
    )  # fmt: skip
    data = path.read_bytes()
    if rng.random() < 0.3:
        data = data[: rng.randrange(len(data))]
    elif rng.random() < 0.5:
        data = _flip(rng, data, tail=rng.random() < 0.5)
    path.write_bytes(data)
    case.write("rig-measured.toml", MEASUREMENT.replace("a.csv", "a.parquet"))


def _mf4(case: Case) -> None:
    data = (case.world.repository / "tests/data/bench.mf4").read_bytes()
    if case.rng.random() < 0.2:
        data = data[: case.rng.randrange(len(data))]
    else:
        data = _flip(case.rng, data, tail=False)
    case.write("a.mf4", data)
    case.write("rig-measured.toml", MF4.replace("group = 0", f"group = {case.rng.choice([0, 0, 0, 1, 2])}"))


def _recording(case: Case) -> None:
    data = case.world.recordings["sensors"].read_bytes()
    kind = case.rng.random()
    if kind < 0.4:
        data = data[: case.rng.randrange(len(data))]
    elif kind < 0.9:
        data = _flip(case.rng, data, tail=case.rng.random() < 0.5)
    case.write("a.mcap", data)
    shutil.copy(case.world.folder / "sensors.toml", case.path("drive.toml"))
    case.write("rig-measured.toml", LINKS)


def _flip(rng: random.Random, data: bytes, tail: bool) -> bytes:
    changed = bytearray(data)
    first = max(0, len(changed) - 600) if tail else 0
    for _ in range(rng.choice([1, 1, 3, 20])):
        changed[rng.randrange(first, len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)
