"""Drive files that were changed at random, and command lines that nobody would write."""

import os
import random
import re
import subprocess

from harness import Case, World

NUMBER = re.compile(r"(?<![\w.\"-])-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(?![\w\"])")
ODD_NUMBERS = [
    "0", "-0.0", "-1", "1", "2", "0.5", "1e308", "-1e308", "1e309", "1e-320", "5e-324", "nan", "-nan", "inf", "-inf", "1e15", "1e-15", "9007199254740993",
    "9223372036854775807", "-9223372036854775808", "9223372036854775808", "4294967296", "1e5", "1e-9", "1_000", "0x7f", "0b1", "00", "1.", ".5",
]  # fmt: skip
ODD_VALUES = ['""', '"text"', "true", "[]", "{}", "[1, 2]", '["driver", "driver"]', "{a = 1}", "1979-05-27", "'''x'''", '"\\u0000"', '"é漢\U0001f600"', '"\\uD800"']
CHAIN_RUN = ["run", "drive.toml", "--duration", "0.2ms", "--no-output"]


def drives(case: Case) -> None:
    name = case.rng.choices(["bush", "silent", "smartchain", "arm", "reduction-20-40", "tensioner"], [6, 3, 1, 5, 5, 5])[0]
    text = (case.world.repository / f"assets/drives/{name}-20-40.toml").read_text("utf-8")
    for _ in range(case.rng.choice([1, 1, 1, 2, 4])):
        text = mutate_toml(case.rng, text)
    data = text.encode("utf-8", "surrogateescape")
    if case.rng.random() < 0.1:
        data = mutate_bytes(case.rng, data)
    case.write("drive.toml", data)
    case.run(*case.rng.choice([["check", "drive.toml"]] * 6 + [["check", "drive.toml", "--json"], ["lump", "drive.toml"], CHAIN_RUN]))


def mutate_toml(rng: random.Random, text: str) -> str:
    """One change to a TOML file, most of which leave it a TOML file."""
    lines = text.split("\n")
    keys = [i for i, line in enumerate(lines) if "=" in line and not line.startswith("#")]
    tables = [i for i, line in enumerate(lines) if line.startswith("[")]
    kind = rng.randrange(16)
    if kind <= 5 or not keys or not tables:
        return _other_number(rng, text)
    line = rng.choice(keys)
    table = rng.choice(tables)
    name = lines[line].split("=")[0].strip()
    if kind == 6:
        del lines[line]
    elif kind == 7:
        lines.insert(rng.randrange(len(lines)), lines[line])
    elif kind == 8:
        lines[line] = lines[line].replace(name, rng.choice([name + "_x", name.upper(), name[:-1], "é", '""', f'"{name}"', "a.b.c", name + "." + name]), 1)
    elif kind == 9:
        end = next((i for i in tables if i > table), len(lines))
        block = lines[table:end]
        renamed = [block[0].replace("]", rng.choice(["_2]", "]", ".x]", "x.y]"])), *block[1:]]
        lines += rng.choice([block, renamed])
    elif kind == 10:
        end = next((i for i in tables if i > table), len(lines))
        del lines[table:end]
    elif kind == 11:
        lines[table] = rng.choice([f"[{lines[table]}]", lines[table][:-1], "[]", "[a." + "b." * 5000 + "c]", lines[table].replace(".", " . ")])
    elif kind == 12:
        lines[line] = f"{name} = {rng.choice(ODD_VALUES)}"
    elif kind == 13:
        depth = rng.choice([10, 127, 1000, 100_000])
        lines[line] = f"{name} = " + rng.choice(["[" * depth, "[" * depth + "]" * depth, "{a=" * depth, "{a=" * depth + "1" + "}" * depth])
    elif kind == 14:
        lines[line] = f"{name} = " + rng.choice(['"' + "x" * 100_000 + '"', "9" * 10_000, "1e" + "9" * 1000, '"""' + "\n" * 1000])
    else:
        return text[: rng.randrange(len(text))]
    return "\n".join(lines)


def _other_number(rng: random.Random, text: str) -> str:
    numbers = [m for m in NUMBER.finditer(text) if "#" not in text[text.rfind("\n", 0, m.start()) + 1 : m.start()]]
    if not numbers:
        return text + "\nx = 1\n"
    place = rng.choice(numbers)
    value = float(place.group())
    near = [repr(value * 2), repr(value / 2), repr(-value), repr(value * 1e3), repr(value / 1e3), repr(value + 1), repr(value - 1)]
    return text[: place.start()] + rng.choice(ODD_NUMBERS + near * 2) + text[place.end() :]


def mutate_bytes(rng: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice([1, 3, 20])):
        place = rng.randrange(len(changed))
        kind = rng.randrange(4)
        if kind == 0:
            changed[place] ^= 1 << rng.randrange(8)
        elif kind == 1:
            changed[place:place] = rng.choice([b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", "é".encode(), b"\xed\xa0\x80", b'"', b"\x1b[31m"])
        elif kind == 2:
            del changed[place : place + rng.choice([1, 10, 100])]
        else:
            changed[place] = rng.randrange(256)
        if not changed:
            changed = bytearray(b"\n")
    return bytes(changed)


WORDS = [
    "", "-", "--", "-0", "0", "1", "-1", "3", "12.3", "1e300", "-1e300", "nan", "inf", "NaN", "1e-320", "99999999999999999999", "18446744073709551615", "4294967295",
    "1e300s", "-1s", "0s", "nan s", "infms", "1e-300us", "0.3ms", "1 ms", "ms", "5furlongs", "frame:0", "frame:99999999999", "frame:-1",
    "0.1ms..0.3ms/3", "0.3ms..0.1ms/3", "0ms..1ms/0", "0ms..1ms/1000000000", "0ms..1ms/18446744073709551616", "..", "nan..nan/2",
    "nothing", "nothing.toml", "nothing.mcap", ".", "/", "/dev/null", "fifo", "x.mcap", "drive.toml", "bush-20-40", "driver", "sprockets.driver", "link:3", "link:-1", "37",
    "é漢\U0001f600", "x" * 100_000, "a=b", "=", "sprockets.driver.teeth=3", "sprockets.driver.teeth=1e9", "a.b=", "effects.gap_error.driver.gap=7", "[", "%n%s",
    "contact.normal_force > 500 N", "contact.normal_force > 500 furlongs", "(" * 1000, "not " * 20_000 + "1", "time > nan s", "energy", "links,links", ",", "csv", "parquet", "json",
    "out.svg", "out.png", "out.mcap", "out.rrd", "out.csv", "out.toml", "out", "out/deep/er.svg", "./out.svg", "out.txt", "0.2ms", "2", "min", "max", "silent", "silent-arc", "iso606", "8", "20", "40", "150",
]  # fmt: skip
COMMANDS = {
    "run": ["bush-20-40", "--no-output", "--duration", "0.2ms"],
    "run resume": ["--resume", "x.mcap", "--no-output", "--duration", "0.1ms"],
    "view": ["x.mcap", "-o", "x.rrd"],
    "impacts": ["x.mcap"],
    "explain": ["x.mcap", "--link", "3", "--at", "0.3ms"],
    "diff": ["x.mcap", "x.mcap"],
    "zoom": ["x.mcap", "--from", "0.3ms", "--to", "0.31ms", "-o", "zoom.mcap"],
    "replay": ["x.mcap", "--verify"],
    "snapshot": ["x.mcap", "--at", "0.3ms", "-o", "x.svg"],
    "drives": ["bush-20-40"],
    "effects": ["coulomb_friction"],
    "sensors": [],
    "lump": ["drive.toml"],
    "check": ["drive.toml"],
    "geometry sprocket": ["--teeth", "20", "--pitch-mm", "8", "--roller-mm", "5"],
    "geometry chain": ["--type", "silent", "--pitch-mm", "8"],
    "geometry smartchain": ["--teeth", "20", "--pitch-mm", "8", "--abutment-mm", "4.5"],
    "identify": ["rig-measured.toml", "--budget", "20"],
    "export": ["x.mcap", "-o", "tables"],
    "completions": ["bash"],
}
# Options that rightly take long, or that wait for somebody; `--web` and `--live` have classes of their own.
LEFT_OUT = {"--live", "--live-wait", "--live-speed", "--web", "--open", "--port", "--picture-every"}


def learn_options(world: World) -> None:
    """Options of every verb, and whether they take a value, from its own help."""
    for verb in COMMANDS:
        words = verb.replace(" resume", "").split()
        text = subprocess.run([world.binary, *words, "--help"], capture_output=True, text=True, check=True).stdout
        found = re.findall(r"^\s+(?:-\w, )?(--[a-z-]+)( <)?", text, re.MULTILINE)
        world.options[verb] = [(name, bool(value)) for name, value in found if name not in LEFT_OUT]


def command_lines(case: Case) -> None:
    rng = case.rng
    verb = rng.choice(list(COMMANDS))
    arguments = list(COMMANDS[verb])
    options = case.world.options[verb]
    for _ in range(rng.choice([1, 1, 2, 3, 6])):
        kind = rng.randrange(6)
        if kind <= 2 and options:
            name, takes_value = rng.choice(options)
            place = rng.randrange(len(arguments) + 1)
            value = rng.choice(WORDS)
            arguments[place:place] = [f"{name}={value}"] if takes_value and rng.random() < 0.7 else [name, value] if takes_value else [name]
        elif kind == 3 and arguments:
            arguments[rng.randrange(len(arguments))] = rng.choice(WORDS)
        elif kind == 4 and arguments:
            del arguments[rng.randrange(len(arguments))]
        else:
            arguments.insert(rng.randrange(len(arguments) + 1), rng.choice(WORDS))
    if verb.startswith("run") and "--duration" not in " ".join(arguments):
        arguments += ["--duration", "0.1ms"]
    if verb == "view" and not any(a.startswith(("-o", "--output")) for a in arguments):
        arguments += ["-o", "x.rrd"]
    provide_inputs(case)
    case.run(*verb.replace(" resume", "").split(), *arguments)


def provide_inputs(case: Case) -> None:
    """What command lines name: a recording, a drive, a measurement, a FIFO without another end."""
    world = case.world
    case.write("x.mcap", world.recordings["bush"].read_bytes())
    case.write("drive.toml", (world.repository / "assets/drives/bush-20-40.toml").read_bytes())
    for file in (world.folder / "rig").iterdir():
        case.write(file.name, file.read_bytes())
    os.mkfifo(case.path("fifo"))
