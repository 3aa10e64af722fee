"""Attacks the pitchline program with generated input: files, command lines, signals and connections on this machine.

Every case follows from the seed, the name of its class and its number; `--case CLASS:N` runs one of them again. A case is a
violation where the program crashes, hangs, takes too much memory, changes its input, fails without a word, or answers
otherwise than on undamaged data without saying so. The exit code is 1 if there was any.
"""

import argparse
import multiprocessing
import os
import random
import shutil
import tempfile
import time
from collections import Counter, defaultdict
from pathlib import Path

import measurement_cases
import network_cases
import output_cases
import recording_cases
import text_cases
from harness import Case, World, run_case

REPOSITORY = Path(__file__).resolve().parents[2]
# Cases of every class among 50 000.
CLASSES = {
    "drives": (text_cases.drives, 10_000),
    "cut": (recording_cases.cut, 8_000),
    "flipped": (recording_cases.flipped, 8_000),
    "repacked": (recording_cases.repacked, 10_000),
    "bombs": (recording_cases.bombs, 250),
    "measurements": (measurement_cases.measurements, 5_000),
    "command-lines": (text_cases.command_lines, 6_000),
    "outputs": (output_cases.outputs, 2_000),
    "kills": (output_cases.kills, 700),
    "http": (network_cases.http, 30),
    "websocket": (network_cases.websocket, 20),
}
SENSORS = """
[sensors.tachometer.driven]
[sensors.torque.driver]
[sensors.strain_gauge.tight]
span = ["driven", "driver"]
"""
SEED_RUNS = {
    "bush": ["bush-20-40", "--duration", "2ms"],
    "bush-dense": ["bush-20-40", "--duration", "1ms", "--break", "impact.peak_force > 200 N", "--around", "0.1ms"],
    "bush-long": ["bush-20-40", "--duration", "12ms"],
    "silent": ["silent-20-40", "--duration", "1ms"],
    "smartchain": ["smartchain-20-40", "--duration", "0.5ms"],
    "sensors": ["sensors.toml", "--duration", "1ms"],
}

_world: World


def main() -> int:
    options = parse_options()
    folder = Path(tempfile.mkdtemp(prefix="attack-", dir=options.work))
    folder.chmod(0o755)
    try:
        _set_world(prepare(options, folder))
        if options.case:
            return run_one(options)
        return run_many(options)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def parse_options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", type=Path, default=REPOSITORY / "target/release/pitchline", help="program to attack")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=50_000, help="how many cases at most, over all classes")
    parser.add_argument("--minutes", type=float, default=60.0, help="start no case after so many minutes")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="how many cases at a time")
    parser.add_argument("--only", metavar="CLASS,...", help=f"only these classes of {', '.join(CLASSES)}")
    parser.add_argument("--case", metavar="CLASS:N", help="run this one case and print what it did")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="copy the files of every violation here")
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()), help="folder for the cases")
    return parser.parse_args()


def prepare(options: argparse.Namespace, folder: Path) -> World:
    """Copy the program, so that a new build does not change it meanwhile; make seed recordings; learn the right answers."""
    binary = folder / "pitchline"
    shutil.copy(options.binary, binary)
    world = World(binary, options.seed, folder, REPOSITORY)
    (folder / "sensors.toml").write_text((REPOSITORY / "assets/drives/bush-20-40.toml").read_text("utf-8") + SENSORS, "utf-8")
    measurement_cases.write_rig(world)
    text_cases.learn_options(world)

    def make_case(kind: str, number: int) -> Case:
        own = folder / "seeds" / f"{kind}-{number}"
        own.mkdir(parents=True)
        return Case(world, kind, number, own)

    case = make_case("recordings", 0)
    shutil.copy(folder / "sensors.toml", case.folder)
    for name, arguments in SEED_RUNS.items():
        result = case.run("run", *arguments, "-o", f"{name}.mcap")
        if result.code != 0:
            raise SystemExit(f"cannot make a seed recording: {result.command}\n{result.stderr}")
        world.recordings[name] = case.path(f"{name}.mcap")
    recording_cases.learn_answers(world, make_case)
    return world


def _set_world(world: World) -> None:
    global _world
    _world = world


def chosen_classes(options: argparse.Namespace) -> list[str]:
    return options.only.split(",") if options.only else list(CLASSES)


def plan(options: argparse.Namespace) -> list[tuple[str, int, Path | None]]:
    """All cases, mixed so that every class has its share however early the time is up."""
    names = chosen_classes(options)
    total = sum(CLASSES[name][1] for name in names)
    cases = []
    for name in names:
        count = max(1, round(options.cases * CLASSES[name][1] / total))
        cases += [((i + 0.5) / count, name, i) for i in range(count)]
    order = random.Random(options.seed)
    return [(name, number, options.keep) for _, name, number in sorted(cases, key=lambda c: (c[0], order.random()))]


def run_one(options: argparse.Namespace) -> int:
    kind, number = options.case.rsplit(":", 1)
    case = run_case(_world, CLASSES[kind][0], kind, int(number), options.keep)
    print("\n".join(case.commands))
    print("\n".join(f"VIOLATION: {text}" for text in case.violations) or "no violation")
    return 1 if case.violations else 0


def _work(job: tuple[str, int, Path | None]) -> tuple[str, int, list[str], float, float]:
    kind, number, keep = job
    try:
        case = run_case(_world, CLASSES[kind][0], kind, number, keep)
    except Exception as error:
        raise RuntimeError(f"case {kind}:{number} could not be run") from error
    return kind, number, case.violations, case.slowest_s, case.largest_rss_mb


def run_many(options: argparse.Namespace) -> int:
    deadline = time.monotonic() + 60 * options.minutes
    jobs = plan(options)
    done, failed = Counter(), Counter()
    slowest, largest = defaultdict(float), defaultdict(float)
    due = (job for job in jobs if time.monotonic() < deadline)
    context = multiprocessing.get_context("fork")
    # What a child is said to have used at least is what its parent used, so the parents are replaced often.
    with context.Pool(options.jobs, maxtasksperchild=50) as pool:
        for results in _batches(pool, due, options.jobs):
            for kind, number, violations, wall, rss in results:
                done[kind] += 1
                failed[kind] += bool(violations)
                slowest[kind] = max(slowest[kind], wall)
                largest[kind] = max(largest[kind], rss)
                for text in violations[:6]:
                    print(f"{kind}:{number}: {text[:400]}", flush=True)
    print_table(done, failed, slowest, largest)
    if sum(done.values()) < len(jobs):
        print(f"the time was up after {sum(done.values())} of {len(jobs)} cases")
    print(f"{sum(done.values()) - sum(failed.values())} passed, {sum(failed.values())} failed")
    return 1 if sum(failed.values()) else 0


def _batches(pool, due, jobs: int):
    """Hand out cases some at a time, so that none is handed out after the time is up."""
    while True:
        batch = [job for _, job in zip(range(64 * jobs), due)]
        if not batch:
            return
        yield pool.imap_unordered(_work, batch)


def print_table(done: Counter, failed: Counter, slowest: dict[str, float], largest: dict[str, float]) -> None:
    print(f"{'class':<14} {'cases':>7} {'violations':>10} {'slowest [s]':>11} {'largest [MB]':>12}")
    for kind in done:
        print(f"{kind:<14} {done[kind]:>7} {failed[kind]:>10} {slowest[kind]:>11.2f} {largest[kind]:>12.0f}")


if __name__ == "__main__":
    raise SystemExit(main())
