"""Runs `pitchline identify` on a generated set and holds its reports against the truth.

    score.py --set DIR [--budget 120s] [--jobs 1] [--only GLOB]    runs what is not in DIR/results.jsonl yet
    score.py --set DIR --table                                     prints the results
"""

import argparse
import fnmatch
import json
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import table

WALL_LIMIT_S = 240.0
PITCHLINE = Path(__file__).resolve().parents[2] / "target" / "release" / "pitchline"


def run_case(args, ident):
    """One run of the program: how it ended, and what of its report the table needs."""
    command = [args.pitchline, "identify", "measured.toml", "--json", "--budget", args.budget, "--threads", "1"]
    begin = time.monotonic()
    try:
        done = subprocess.run(command, cwd=args.set / ident, capture_output=True, text=True, timeout=WALL_LIMIT_S)
    except subprocess.TimeoutExpired:
        return {"id": ident, "end": "time-out", "wall_s": WALL_LIMIT_S}
    out = {"id": ident, "wall_s": time.monotonic() - begin, "code": done.returncode, "end": ending(done.returncode)}
    if out["end"] != "report":
        return out | {"message": done.stderr[-500:]}
    report = json.loads(done.stdout)
    kept = ["outcome", "explained", "doubts", "warnings", "varying", "budget_spent", "model_runs", "numbers_after"]
    out |= {key: report[key] for key in kept}
    out["unnamed"] = report["unnamed"] and report["unnamed"]["formula"]
    out["effects"] = [
        {"path": e["path"], "rivals": [r["path"] for r in e["rivals"]], "parameters": e["parameters"]}
        for e in report["effects"]
    ]
    floors = [c["times_floor"] for c in report["noise_floor"]]
    return out | {"times_floor": floors}


def ending(code):
    if code < 0:
        return f"signal {-code}"
    if code == 101:
        return "panic"
    return "report" if code in (0, 3) else "error"


def run_all(args):
    """Appends a line for each case that has none."""
    results = args.set / "results.jsonl"
    done = {json.loads(line)["id"] for line in results.read_text().splitlines()} if results.exists() else set()
    idents = sorted(path.stem for path in (args.set / "truth").glob("*.json"))
    wanted = [i for i in idents if i not in done and fnmatch.fnmatch(i, args.only)]
    with results.open("a") as file, ThreadPoolExecutor(args.jobs) as pool:
        for result in pool.map(lambda ident: run_case(args, ident), wanted):
            file.write(json.dumps(result) + "\n")
            file.flush()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", type=Path, required=True)
    parser.add_argument("--pitchline", type=Path, default=PITCHLINE)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--budget", default="120s")
    parser.add_argument("--only", default="*")
    parser.add_argument("--table", action="store_true")
    args = parser.parse_args()
    if args.table:
        print(table.table(args.set, args.only))
    else:
        run_all(args)


if __name__ == "__main__":
    main()
