"""A generated set once more, with every inertia and mass declared 5 to 50 times wrong; and whether `identify` says the same of both.

    wrong_starts.py --set DIR --out DIR2 [--seed 1] [--cases 60]    copies the set's first cases and changes their drives
    wrong_starts.py --set DIR --out DIR2 --compare                  compares the results of both, after score.py has run on both
"""

import argparse
import json
import re
import shutil
from pathlib import Path

import numpy as np

NUMBER = re.compile(r"^((?:inertia_kg_m2|mass_kg) = )(\S+)", re.MULTILINE)
OF_THEM = re.compile(r'^(\[fit\."(?:rotors|sliders)\.[^"]+\.(?:inertia_kg_m2|mass_kg)"\])\nspread_percent = .*$', re.MULTILINE)
WRONG_ALREADY = "wrong_inertia"


def changed(rng, text):
    """A drive file with its inertias 5 to 50 times too large or too small, all by one factor."""
    factor = float(np.exp(rng.uniform(np.log(5.0), np.log(50.0)))) ** rng.choice([-1.0, 1.0])
    return NUMBER.sub(lambda m: f"{m[1]}{float(m[2]) * factor:.6g}", text)


def copy(args):
    rng = np.random.default_rng(args.seed)
    names = sorted(path.stem for path in (args.set / "truth").glob("*.json"))[: args.cases]
    (args.out / "truth").mkdir(parents=True)
    for name in names:
        if WRONG_ALREADY in name:
            continue
        shutil.copytree(args.set / name, args.out / name)
        shutil.copy(args.set / "truth" / f"{name}.json", args.out / "truth")
        drive = args.out / name / "drive.toml"
        drive.write_text(changed(rng, drive.read_text()))
        # A number that is said to be known to some percent would be held there.
        measured = args.out / name / "measured.toml"
        measured.write_text(OF_THEM.sub(r"\1", measured.read_text()))


def results(folder):
    lines = (folder / "results.jsonl").read_text().splitlines()
    return {r["id"]: r for r in map(json.loads, lines)}


def names(result):
    """Each effect with its alternatives, in one order."""
    return sorted(sorted([e["path"], *e["rivals"]]) for e in result.get("effects", []))


def same(a, b):
    """Whether two results name the same effects: each of one is among the alternatives of one of the other."""
    covers = lambda xs, ys: all(any(set(x) & set(y) for y in ys) for x in xs)  # noqa: E731
    return len(names(a)) == len(names(b)) and covers(names(a), names(b)) and covers(names(b), names(a))


def compare(args):
    before, after = results(args.set), results(args.out)
    ended = lambda r: r["end"] == "report"  # noqa: E731
    both = [name for name in after if name in before and ended(before[name]) and ended(after[name])]
    unchanged = [name for name in both if same(before[name], after[name])]
    for name in both:
        if name not in unchanged:
            told = [f"{r['outcome'].upper()} {', '.join(e['path'] for e in r['effects'])}" for r in (before[name], after[name])]
            print(f"{name:<22} {told[0]} -> {told[1]}")
    print(f"{len(unchanged)} of {len(both)} unchanged")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--compare", action="store_true")
    args = parser.parse_args()
    compare(args) if args.compare else copy(args)


if __name__ == "__main__":
    main()
