"""Runs the program under test on one generated case and judges how it ended."""

import contextlib
import hashlib
import os
import random
import re
import select
import shlex
import shutil
import signal
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path

ALLOWED_CODES = {0, 1, 2, 3, 130}
WALL_LIMIT_S = 10.0
KILL_AFTER_S = 14.0
RSS_LIMIT_MB = 1200.0
KILL_ABOVE_MB = 3000.0  # to leave memory for others
CRASH_WORDS = ("panicked", "internal error", "memory allocation of", "stack overflow")

# What a message says that tells of missing, damaged or contradicting data.
TELLING = re.compile(
    r"note:|warning:|error|not finished|not whole|cut off|lost|damag|missing|incomplete|corrupt|broken|checksum|crc|contradict|gap|skipped"
    r"|only in|differ|unreadable|unfinished|repaired",
    re.IGNORECASE,
)


@dataclass
class Result:
    """How one run of the program ended."""

    command: str
    code: int  # negative: the number of the signal that ended it
    stdout: str
    stderr: str
    wall_s: float
    cpu_s: float
    rss_mb: float
    timed_out: bool


@dataclass
class World:
    """What all cases share: the program, seed files, and the answers on undamaged recordings."""

    binary: Path
    seed: int
    folder: Path
    repository: Path
    recordings: dict[str, Path] = field(default_factory=dict)
    answers: dict[tuple[str, str], "Answer"] = field(default_factory=dict)
    options: dict[str, list[tuple[str, bool]]] = field(default_factory=dict)


@dataclass
class Answer:
    """What a verb says of an undamaged recording, and the digest of the files it writes."""

    stdout: str
    files: str


class Case:
    """One case: its own random numbers, its own folder, and what was found wrong in it."""

    def __init__(self, world: World, kind: str, number: int, folder: Path):
        self.world = world
        self.kind = kind
        self.number = number
        self.folder = folder
        self.rng = random.Random(f"{world.seed}:{kind}:{number}")
        self.label = ""
        self.commands: list[str] = []
        self.violations: list[str] = []
        self.slowest_s = 0.0
        self.largest_rss_mb = 0.0

    def path(self, name: str) -> Path:
        return self.folder / name

    def write(self, name: str, data: bytes | str) -> Path:
        path = self.path(name)
        path.write_bytes(data.encode("utf-8", "surrogateescape") if isinstance(data, str) else data)
        return path

    def note(self, text: str) -> None:
        """What the case is about, beside its command lines."""
        self.label = text

    def fail(self, text: str) -> None:
        self.violations.append(f"[{self.label}] {text}" if self.label else text)

    def start(self, *arguments: str, stdout=None, file_size: int | None = None, user: int | None = None) -> "Running":
        return Running(self, [str(a) for a in arguments], stdout, file_size, user)

    def run(self, *arguments: str, cpu_limit: float | None = None, judged: bool = True, **how) -> Result:
        """Run the program to its end and judge it by the rules that hold for every run."""
        result = self.start(*arguments, **how).finish()
        if judged:
            self.judge(result, cpu_limit)
        return result

    def judge(self, result: Result, cpu_limit: float | None = None, signals: tuple[int, ...] = (signal.SIGPIPE,)) -> None:
        self.slowest_s = max(self.slowest_s, result.wall_s)
        self.largest_rss_mb = max(self.largest_rss_mb, result.rss_mb)
        for text in broken_rules(result, cpu_limit, signals):
            self.fail(f"{text}: {result.command}")


class Running:
    """A started run of the program. Its output goes to files, so that no pipe can fill up."""

    def __init__(self, case: Case, arguments: list[str], stdout, file_size: int | None, user: int | None):
        argv = [str(case.world.binary), *(a.replace("\0", "?") for a in arguments)]
        self.command = "pitchline " + shlex.join(argv[1:])
        case.commands.append(self.command)
        if file_size is not None:
            argv = ["prlimit", f"--fsize={file_size}", "--", *argv]
        number = len(case.commands)
        outputs = case.folder.parent / f"{case.folder.name}.output"
        outputs.mkdir(exist_ok=True)
        self.stdout_path = outputs / f"{number}.stdout"
        self.stderr_path = outputs / f"{number}.stderr"
        self.began = time.monotonic()
        with open(self.stdout_path, "wb") as own_stdout, open(self.stderr_path, "wb") as stderr:
            self.process = subprocess.Popen(
                [a.encode("utf-8", "surrogateescape") for a in argv],
                cwd=case.folder,
                stdin=subprocess.DEVNULL,
                stdout=own_stdout if stdout is None else stdout,
                stderr=stderr,
                user=user,
                env={"PATH": os.environ["PATH"], "HOME": str(case.folder), "LANG": "C.UTF-8"},
            )
        self.pid = self.process.pid

    def wait(self, seconds: float) -> bool:
        """Whether the run ended within this time."""
        descriptor = os.pidfd_open(self.pid)
        try:
            return bool(select.select([descriptor], [], [], seconds)[0])
        finally:
            os.close(descriptor)

    def send(self, number: int) -> None:
        os.kill(self.pid, number)  # Popen's own would reap the process, and its use of memory with it

    def rss_mb(self) -> float:
        return int(Path(f"/proc/{self.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20

    def peak_mb(self) -> float:
        """The largest memory since the program began: what the kernel reports at the end includes the worker that started it."""
        with contextlib.suppress(OSError, ValueError):
            for line in Path(f"/proc/{self.pid}/status").read_text().splitlines():
                if line.startswith("VmHWM:"):
                    return int(line.split()[1]) / 1024
        return 0.0

    def threads(self) -> int:
        return len(os.listdir(f"/proc/{self.pid}/task"))

    def stderr_so_far(self) -> str:
        return self.stderr_path.read_text("utf-8", "replace")

    def stdout_so_far(self) -> str:
        return self.stdout_path.read_text("utf-8", "replace")

    def finish(self, limit_s: float = KILL_AFTER_S) -> Result:
        end = self.began + limit_s
        peak_mb = 0.0
        while not self.wait(0.2) and time.monotonic() < end and self.rss_mb() < KILL_ABOVE_MB:
            peak_mb = max(peak_mb, self.peak_mb())
        timed_out = time.monotonic() >= end and not self.wait(0.0)
        if not self.wait(0.0):
            self.send(signal.SIGKILL)
        _, status, usage = os.wait4(self.pid, 0)
        wall = time.monotonic() - self.began
        self.process.returncode = os.waitstatus_to_exitcode(status)
        return Result(
            command=self.command,
            code=self.process.returncode,
            stdout=self.stdout_so_far(),
            stderr=self.stderr_so_far(),
            wall_s=wall,
            cpu_s=usage.ru_utime + usage.ru_stime,
            rss_mb=peak_mb or usage.ru_maxrss / 1024,
            timed_out=timed_out,
        )


def broken_rules(result: Result, cpu_limit: float | None, signals: tuple[int, ...]) -> list[str]:
    """The rules that every run has to keep, whatever its input."""
    broken = []
    for word in CRASH_WORDS:
        if word in result.stderr or word in result.stdout:
            line = next((l for l in result.stderr.splitlines() if word in l), word)
            broken.append(f"crash ({line[:200]})")
            break
    if result.timed_out:
        broken.append(f"did not end within {KILL_AFTER_S:.0f} s")
    elif result.rss_mb > RSS_LIMIT_MB:
        broken.append(f"took {result.rss_mb:.0f} MB")
    elif result.code < 0 and -result.code not in signals:
        broken.append(f"ended by {signal.Signals(-result.code).name}")
    elif result.code >= 0 and result.code not in ALLOWED_CODES:
        broken.append(f"exit code {result.code}")
    elif cpu_limit is not None and result.cpu_s > cpu_limit:
        broken.append(f"took {result.cpu_s:.1f} s of CPU time")
    elif cpu_limit is None and result.wall_s > WALL_LIMIT_S:
        broken.append(f"took {result.wall_s:.1f} s")
    if "note: assembling goes on" in result.stderr:
        # Said, and ended by Ctrl-C: a chain as heavy as a feather takes steps of nanoseconds.
        broken = [reason for reason in broken if not reason.startswith(("took", "did not end", "ended by SIGKILL"))]
    # A comparison prints its outcome, 1, and `done, and not sure`, 3, on stdout.
    speaks = result.stderr.strip() or (result.code in (1, 3) and result.stdout.strip())
    if result.code > 0 and result.code != 130 and not speaks:
        broken.append(f"exit code {result.code} without a message")
    return broken


ANY_ORDER = {"events.csv", "impacts.csv"}


def digest(*paths: Path) -> str:
    """Hash of files, and of all files in folders."""
    total = hashlib.sha256()
    for path in paths:
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file():
                total.update(str(file.relative_to(path.parent)).encode())
                data = file.read_bytes()
                # Events and impacts of one time come in the order of their messages, which a repacked chunk may change.
                total.update(b"".join(sorted(data.splitlines(True))) if file.name in ANY_ORDER else data)
    return total.hexdigest()


def tells(result: Result, undamaged_stdout: str = "") -> bool:
    """Whether the program said that something is missing, damaged or contradicting."""
    known = set(undamaged_stdout.splitlines())
    new = [line for line in result.stdout.splitlines() if line not in known]
    return bool(TELLING.search(result.stderr)) or any(TELLING.search(line) for line in new)


def run_case(world: World, generator, kind: str, number: int, keep: Path | None) -> Case:
    """Run one case in its own folder. Where it was only too slow, look again: others use the machine too."""
    case = _run_once(world, generator, kind, number, keep)
    if case.violations and all("took" in text and "MB" not in text for text in case.violations):
        again = _run_once(world, generator, kind, number, keep)
        if not again.violations:
            return again
    return case


def _run_once(world: World, generator, kind: str, number: int, keep: Path | None) -> Case:
    folder = world.folder / "cases" / f"{kind}-{number}"
    outputs = folder.parent / f"{folder.name}.output"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    case = Case(world, kind, number, folder)
    try:
        generator(case)
        if case.violations and keep is not None:
            _keep(case, keep)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        shutil.rmtree(outputs, ignore_errors=True)
    return case


def _keep(case: Case, keep: Path) -> None:
    target = keep / f"{case.kind}-{case.number}"
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(case.folder, target, symlinks=True, ignore=_unreadable)
    lines = [f"# {case.kind}:{case.number}, seed {case.world.seed}", ""]
    lines += [f"* {text}" for text in case.violations]
    lines += ["", "Commands, in this folder:", "", *(f"    {command}" for command in case.commands), ""]
    (target / "README.md").write_text("\n".join(lines), "utf-8", "surrogateescape")


def _unreadable(folder: str, names: list[str]) -> list[str]:
    """FIFOs and devices cannot be copied; what is large need not be."""
    skipped = []
    for name in names:
        path = Path(folder, name)
        if not path.is_symlink() and not path.is_dir() and (not path.is_file() or path.stat().st_size > 64 << 20):
            skipped.append(name)
    return skipped
