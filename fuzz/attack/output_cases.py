"""Outputs that are inputs by another name, outputs that cannot be written, and runs that are ended from outside."""

import hashlib
import os
import shutil
import signal
import subprocess

from harness import Case, Result
from mcap_file import MAGIC
from text_cases import provide_inputs

RRD_MAGIC = b"RRF"
NOBODY = 65534
# Verbs with the input they read and the kind of file they write; `{o}` is where the output goes.
WRITERS = [
    (["run", "--resume", "x.mcap", "--duration", "0.2ms", "-o", "{o}"], "x.mcap", ".mcap"),
    (["run", "--resume", "x.mcap", "--duration", "0.2ms", "-o", "{o}"], "x.mcap", ".rrd"),
    (["run", "drive.toml", "--duration", "0.2ms", "-o", "{o}"], "drive.toml", ".mcap"),
    (["zoom", "x.mcap", "--from", "0.3ms", "--to", "0.33ms", "-o", "{o}"], "x.mcap", ".mcap"),
    (["zoom", "x.mcap", "--from", "0.3ms", "--to", "0.33ms", "-o", "{o}"], "x.mcap", ".rrd"),
    (["replay", "x.mcap", "--repair", "-o", "{o}"], "x.mcap", ".mcap"),
    (["view", "x.mcap", "-o", "{o}"], "x.mcap", ".rrd"),
    (["snapshot", "x.mcap", "--at", "0.3ms", "-o", "{o}"], "x.mcap", ".svg"),
    (["explain", "x.mcap", "--link", "3", "--at", "0.3ms", "-o", "{o}"], "x.mcap", ".svg"),
    (["export", "x.mcap", "--tables", "contacts", "-o", "{o}"], "x.mcap", ".csv"),
    (["export", "x.mcap", "--tables", "contacts", "-o", "{o}"], "x.mcap", ".parquet"),
    (["lump", "drive.toml", "-o", "{o}"], "drive.toml", ".toml"),
    (["identify", "rig-measured.toml", "--budget", "20", "-o", "{o}"], "rig.toml", ".toml"),
    (["identify", "rig-measured.toml", "--budget", "20", "-o", "{o}"], "rig-measured.toml", ".toml"),
    (["identify", "rig-measured.toml", "--budget", "20", "-o", "{o}"], "a.csv", ".rrd"),
    (["identify", "rig-measured.toml", "--budget", "20", "--report", "{o}"], "a.csv", ".html"),
]
PAIRS = [
    ["run", "drive.toml", "--duration", "0.2ms", "-o", "{a}", "-o", "{b}"],
    ["run", "--resume", "x.mcap", "--duration", "0.2ms", "-o", "{a}", "-o", "{b}"],
    ["zoom", "x.mcap", "--from", "0.3ms", "--to", "0.33ms", "-o", "{a}", "-o", "{b}"],
]


def outputs(case: Case) -> None:
    provide_inputs(case)
    if case.rng.random() < 0.5:
        (case.folder / "tables").mkdir()
    before = _inputs(case)
    case.rng.choice([_input_by_another_name, _input_by_another_name, _one_file_twice, _not_writable, _stdout_lost])(case)
    for name, known in _inputs(case).items():
        if before.get(name, known) != known:
            case.fail(f"the input {name} was changed: {case.commands[-1]}")
    for name in set(before) - set(_inputs(case)):
        case.fail(f"the input {name} is gone: {case.commands[-1]}")


def _inputs(case: Case) -> dict[str, str]:
    names = ["x.mcap", "drive.toml", "rig.toml", "rig-measured.toml", "a.csv", "b.csv"]
    return {name: hashlib.sha256(case.path(name).read_bytes()).hexdigest() for name in names if case.path(name).is_file()}


def _other_name(case: Case, target: str, suffix: str) -> str:
    """A name with this suffix by which the file `target` can be reached too."""
    kinds = ["hard", "soft", "soft twice", "absolute"]
    if target.endswith(suffix):
        kinds += ["same", "dot", "folder", "up", "slashes", "full"]
    kind = case.rng.choice(kinds)
    case.note(f"{kind} alias of {target}")
    name = f"alias{suffix}"
    if kind == "hard" and case.path(target).exists():
        os.link(case.path(target), case.path(name))
    elif kind == "soft twice":
        case.path("between").symlink_to(target)
        case.path(name).symlink_to("between")
    elif kind == "absolute":
        case.path(name).symlink_to(case.path(target))
    elif kind == "folder":
        case.path("linked").symlink_to(".")
        return f"linked/{target}"
    elif kind in ("same", "dot", "up", "slashes", "full"):
        return {"same": target, "dot": f"./{target}", "up": f"../{case.folder.name}/{target}", "slashes": f".//.//{target}", "full": str(case.path(target))}[kind]
    else:
        case.path(name).symlink_to(target)
    return name


def _filled(arguments: list[str], **names: str) -> list[str]:
    return [a.format(**names) if a.startswith("{") else a for a in arguments]


def _input_by_another_name(case: Case) -> None:
    arguments, target, suffix = case.rng.choice(WRITERS)
    case.run(*_filled(arguments, o=_other_name(case, target, suffix)))


def _one_file_twice(case: Case) -> None:
    first = case.rng.choice(["out.mcap", "out.rrd"])
    if case.rng.random() < 0.3:
        case.write(first, b"earlier")
    second = _other_name(case, first, case.rng.choice([".mcap", ".rrd", os.path.splitext(first)[1]]))
    result = case.run(*_filled(case.rng.choice(PAIRS), a=first, b=second))
    if result.code != 0:
        return
    for name in (first, second):
        magic = MAGIC if name.endswith(".mcap") else RRD_MAGIC
        path = case.path(name)
        if not path.exists() or not path.read_bytes().startswith(magic):
            case.fail(f"exit code 0, but {name} is no such file: {result.command}")


def _not_writable(case: Case) -> None:
    arguments, _, suffix = case.rng.choice(WRITERS)
    user = None
    name = f"out{suffix}"
    kind = case.rng.choice(["fifo", "folder", "read-only", "full", "proc", "no folder", "name too long", "a file as folder", "device"])
    case.note(f"output: {kind}")
    if kind == "fifo":
        os.mkfifo(case.path(name))
    elif kind == "folder":
        case.path(name).mkdir()
    elif kind == "read-only" and os.getuid() == 0:
        user = NOBODY
    elif kind == "read-only":
        case.folder.chmod(0o555)
    elif kind == "full":
        case.path(name).symlink_to("/dev/full")
    elif kind == "proc":
        name = f"/proc/out{suffix}"
    elif kind == "no folder":
        case.path(name).symlink_to("nowhere/at/all")
    elif kind == "name too long":
        name = "n" * 300 + suffix
    elif kind == "a file as folder":
        name = f"a.csv/out{suffix}"
    else:
        case.path(name).symlink_to("/dev/null")
    result = case.run(*_filled(arguments, o=name), user=user)
    case.folder.chmod(0o755)
    if result.code == 0 and kind not in ("device", "no folder", "fifo"):
        written = case.path(name)
        # `export` takes a folder for one that gets its tables.
        files = list(written.iterdir()) if written.is_dir() and "export" in arguments else [written]
        if not files or any(not file.is_file() or file.stat().st_size == 0 for file in files):
            case.fail(f"exit code 0, but nothing was written: {result.command}")


def _stdout_lost(case: Case) -> None:
    arguments = case.rng.choice(
        [["impacts", "x.mcap"], ["impacts", "x.mcap", "--json"], ["drives", "bush-20-40"], ["check", "drive.toml"], ["diff", "x.mcap", "x.mcap"],
         ["run", "drive.toml", "--no-output", "--duration", "0.2ms"], ["identify", "rig-measured.toml", "--budget", "20"], ["completions", "bash"],
         ["--help"], ["effects"], ["sensors"], ["geometry", "chain", "--type", "silent", "--pitch-mm", "8"], ["lump", "drive.toml"]]
    )  # fmt: skip
    if case.rng.random() < 0.5:
        with open("/dev/full", "wb") as full:
            result = case.run(*arguments, stdout=full)
        if result.code == 0:
            case.fail(f"exit code 0, though stdout could not be written: {result.command} > /dev/full")
        return
    reader, writer = os.pipe()
    os.close(reader)
    try:
        case.run(*arguments, stdout=writer)
    finally:
        os.close(writer)


def kills(case: Case) -> None:
    rng = case.rng
    folder = "small" if rng.random() < 0.15 and os.getuid() == 0 else "."
    if folder == "small":
        case.path(folder).mkdir()
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", case.path(folder)], check=True)
    try:
        _killed_run(case, folder)
    finally:
        if folder == "small":
            subprocess.run(["umount", "-l", case.path(folder)], check=True)


def _killed_run(case: Case, folder: str) -> None:
    rng = case.rng
    kind = "full disk" if folder == "small" else rng.choice(["SIGKILL", "SIGKILL", "SIGTERM", "SIGINT", "SIGHUP", "two SIGINT", "file size", "pipe"])
    place = case.path(folder)
    case.write("x.mcap", case.world.recordings["bush"].read_bytes())
    earlier = rng.random() < 0.5
    output = place / "out.mcap"
    if earlier:
        shutil.copy(case.world.recordings["bush"], output)
        os.utime(output, ns=(1, 1))
    before = output.read_bytes() if earlier else None
    source = rng.choice([["bush-20-40"]] * 3 + [["--resume", "x.mcap"]])
    arguments = ["run", *source, "--duration", "50ms", "-o", f"{folder}/out.mcap", *rng.choice([[], [], ["-o", f"{folder}/out.rrd"]])]
    delay = rng.uniform(0.0, 0.15)
    signals = (signal.SIGPIPE,)
    if kind == "file size":
        running = case.start(*arguments, file_size=rng.choice([20_000, 100_000, 1_000_000, 5_000_000]))
        result = running.finish()
    elif kind == "pipe":
        reader, writer = os.pipe()
        os.close(reader)
        try:
            result = case.start(*arguments, stdout=writer).finish()
        finally:
            os.close(writer)
    elif kind == "full disk":
        result = case.start(*arguments).finish()
    else:
        numbers = {"SIGKILL": [signal.SIGKILL], "SIGTERM": [signal.SIGTERM], "SIGINT": [signal.SIGINT], "SIGHUP": [signal.SIGHUP], "two SIGINT": [signal.SIGINT] * 2}[kind]
        running = case.start(*arguments)
        running.wait(delay)
        for number in numbers:
            running.send(number)
            running.wait(0.01)
        signals += tuple(numbers)
        result = running.finish()
    case.note(kind + (f" after {delay:.3f} s" if kind.startswith(("SIG", "two")) else ""))
    case.judge(result, signals=signals)
    _judge_what_is_left(case, result, place, before)


def _judge_what_is_left(case: Case, result: Result, place, before: bytes | None) -> None:
    output = place / "out.mcap"
    if before is not None:
        intact = output.exists() and output.read_bytes() == before
        if result.code not in (0, 130) and not intact:
            case.fail(f"the earlier recording is not intact after a run that ended with {result.code}")
        if not output.exists():
            return
    for path in sorted(place.glob("*out*")):
        if path.is_file() and path.suffix != ".rrd" and ".rrd" not in path.name:
            _judge_leftover(case, result, path)


def _judge_leftover(case: Case, result: Result, path) -> None:
    name = str(path.relative_to(case.folder))
    data = path.read_bytes()
    flushed = data.count(b"zstd") > 1 or len(data) > 300_000
    look = case.run("impacts", name)
    finished = result.code in (0, 130) and path.name == "out.mcap"
    if look.code == 0 and not (finished and "not finished" in look.stderr):
        return
    if finished:
        case.fail(f"exit code {result.code}, but {name} is not finished: {look.stderr.strip()[:200]}")
        return
    case.run("replay", "--repair", name, "-o", "repaired.mcap")
    if not case.path("repaired.mcap").exists():
        if flushed:
            case.fail(f"{name} ({len(data)} bytes) cannot be repaired")
        return
    if case.run("impacts", "repaired.mcap").code != 0:
        case.fail(f"{name} cannot be opened after it was repaired")
    case.path("repaired.mcap").unlink()
