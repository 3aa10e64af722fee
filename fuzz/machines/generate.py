"""Generates machines with known effects, and measurements of them, as a blind test of `pitchline identify`.

    generate.py --seed 1 --cases 60 --out DIR [--kinds single,loop]

Each case is a folder DIR/ID with a drive, a measurement file and records. What is true stands in DIR/truth/ID.json. With
`--declare-truth` the drive has the true effects and numbers: then the program must find nothing, which tests this simulator.
"""

import argparse
from pathlib import Path

import files
import kinds
import numpy as np
import outside
from assess import sizes, twins, typical_speed
from effects import EFFECTS, log_uniform
from simulator import channels

KINDS = {
    "single": kinds.single,
    "double": kinds.double,
    "triple": kinds.triple,
    "clean": kinds.clean,
    "servo": kinds.servo,
    "loop": kinds.loop,
    "warming": kinds.warming,
    "wrong_inertia": kinds.wrong_inertia,
    "outside": outside.outside,
    "confusable": kinds.confusable,
}
SIZES = {"single": (0.3, 100.0), "double": (0.7, 60.0), "triple": (0.7, 60.0), "wrong_inertia": (4.0, 100.0)}
NOISE_SHARE = (2e-4, 0.1)  # of what a channel shows


def rival_names(case):
    """Effects that may look like a true one, with their sensors."""
    out = []
    for name in EFFECTS:
        if EFFECTS[name].draw is None:
            continue
        if EFFECTS[name].part == "sensor":
            for i, sensor in enumerate(case.sensors):
                if kinds.suits(name, [sensor], case.slider) or (name == "gain_error" and len(case.sensors) > 1):
                    out.append((name, i))
        elif kinds.suits(name, case.sensors, case.slider):
            sized = [EFFECTS[n].sized for n, _ in case.effects]
            taken = len(sized) > 1 and EFFECTS[name].sized in sized
            taken = taken or (name == "torsional_resonance" and case.machine["inertia2"] > 0.0)
            if not taken and not (name == "viscous_friction" and "viscous" in case.free):
                out.append((name, None))
    return out


def set_noise(rng, kind, case, scales):
    """Noise such that the smallest effect is as large beside it as drawn, within limits. Returns the sizes."""
    swing = scales.speed * min(scales.inertia / scales.viscous, scales.length / 10.0)
    large = np.array([scales.speed if s["kind"] == "speed" else swing for s in case.sensors])
    case.noise = large
    speed = typical_speed(case)
    found = sizes(case, speed) if case.effects else []
    if found:
        least = min(np.max(by_channel) for by_channel in found)
        share = least / log_uniform(rng, *SIZES.get(kind, (0.5, 100.0)))
    else:
        share = log_uniform(rng, 1e-3, 0.05)
    share = float(np.clip(share, *NOISE_SHARE))
    case.noise = share * large
    return [by_channel / share for by_channel in found], speed


def add_noise(rng, case, input_noise):
    """The measured channels, and the measured input where it is noisy."""
    for sensor, sigma in zip(case.sensors, case.noise, strict=True):
        if sensor["quantisation"] < 0.0:
            sensor["quantisation"] = sigma * log_uniform(rng, 0.5, 3.0)
    out = []
    for record in case.records:
        clean = channels(case.machine, case.sensors, record, case.parts)
        steps = np.array([s["quantisation"] for s in case.sensors])[:, None]
        noise = record.pop("noise", None)
        if noise is None:
            noise = rng.standard_normal(clean.shape)
        values = clean + noise * case.noise[:, None]
        out.append(np.where(steps > 0.0, np.round(values / np.maximum(steps, 1e-300)) * steps, values))
        if input_noise:
            record["measured_input"] = record["input"] + noise_of_input(rng, case, record, clean)
    return out


def noise_of_input(rng, case, record, clean):
    """White noise of the measured torque that would move the channels by a fifth to all of their noise."""
    white = rng.standard_normal(len(record["input"])) * 1e-3 * np.std(record["input"])
    moved = channels(case.machine, case.sensors, record | {"input": record["input"] + white}, case.parts) - clean
    return white * rng.uniform(0.2, 1.0) / np.max(np.std(moved, axis=1) / case.noise)


def draw_case(rng, kind):
    """A machine that moves, does not run away and stays within what the samples resolve."""
    while True:
        drawn = KINDS[kind](rng)
        if drawn is None:
            continue
        case, scales, facts = drawn
        rows = [channels(case.machine, case.sensors, r, case.parts) for r in case.records]
        if not all(np.all(np.isfinite(r)) for r in rows):
            continue
        speed = typical_speed(case)
        if 0.05 * scales.speed < speed < 20.0 * scales.speed:
            return case, scales, facts


def make_case(rng, kind, ident, out, declare_truth):
    while True:
        case, scales, facts = draw_case(rng, kind)
        found, speed = set_noise(rng, kind, case, scales)
        # Without one of its effects a machine may run away, and the size of the effect has no number then.
        if np.all(np.isfinite(case.noise)):
            break
    near = twins(case, rival_names(case), scales, rng, speed) if case.effects else []
    values = add_noise(rng, case, facts.get("input_noise", False))
    folder = out / ident
    folder.mkdir(parents=True)
    units = [pick(rng, files.UNITS[s["kind"], case.slider]) for s in case.sensors]
    with_time = bool(rng.random() < 0.5)
    facts["start_rest"] = facts["at_rest"] and bool(rng.random() < 0.5)
    for i, record in enumerate(case.records):
        files.write_record(folder / f"r{i}.csv", case, record, values[i], units, with_time)
    wrong = facts.get("inertia_factor")
    spread = not wrong and bool(rng.random() < 0.7)
    numbers = files.draw_declared(rng, case, wrong)
    effects = files.truth_effects(case, part)
    text = files.drive_text(case, numbers)
    if declare_truth:
        text = files.drive_text(case, {key: case.machine[key] for key in case.free}, files.sharp(effects, 1e-3 * speed))
    (folder / "drive.toml").write_text(text)
    (folder / "measured.toml").write_text(files.measured_text(case, ident, facts, units, with_time, spread))
    files.write_json(out / "truth" / f"{ident}.json", truth(kind, case, facts, found, near, numbers, effects, units))


def part(name):
    return EFFECTS[name].part


def pick(rng, items):
    return items[rng.integers(len(items))]


def truth(kind, case, facts, found, near, numbers, effects, units):
    """What is true of a case, in the words of the program."""
    where = files.paths(case)
    each = [float(np.max(x)) for x in found]
    names = [files.target(case, *effect, part(effect[0])) for effect in case.effects] + ["all"]
    return {
        "kind": kind,
        "class": facts.get("class", "+".join(name for name, _ in case.effects) or "nothing"),
        "effects": effects,
        "twins": [twin(case, *n) for n in near] + facts.get("twins", []),
        "together": together(case),
        "near": facts.get("near", []),
        "course": facts.get("course"),
        "size_over_noise": dict(zip(names, each, strict=True)) if each else {},
        "noise_si": case.noise,
        "noise_in_file": [sigma * unit[1] for sigma, unit in zip(case.noise, units, strict=True)],
        "numbers": {where[key]: case.machine[key] for key in case.free},
        "declared": {where[key]: value for key, value in numbers.items()},
        "uses": facts["uses"],
        "at_rest": facts["at_rest"],
        "rate_hz": case.records[0]["rate"],
        "samples": len(case.records[0]["input"]),
        "quantisation": [s["quantisation"] for s in case.sensors],
    }


def together(case):
    """Names that only all together are the same as an effect: a lag of every channel is a lag of the input."""
    out = {}
    for name, _ in case.effects:
        sensors = {"input_delay": "latency", "input_lag": "low_pass"}.get(name)
        if sensors:
            names = [files.target(case, sensors, i, "sensor") for i in range(len(case.sensors))]
            out[files.target(case, name, None, "input")] = names
    return out


def twin(case, effect, rival, sensor, squares):
    return {
        "of": files.target(case, *effect, part(effect[0])),
        "name": files.target(case, rival, sensor, part(rival)),
        "reason": f"in its place it leaves a sum of squares of {squares:.2g} noise variances in all records together",
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, required=True)
    parser.add_argument("--first", type=int, default=0, help="index of the first case, to go on with a set")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--declare-truth", action="store_true")
    args = parser.parse_args()
    chosen = args.kinds.split(",")
    np.seterr(over="ignore", invalid="ignore")  # fits of rivals may run away
    for i in range(args.first, args.cases):
        kind = chosen[i % len(chosen)]
        rng = np.random.default_rng([args.seed, i])
        make_case(rng, kind, f"{i:04}-{kind}", args.out, args.declare_truth)


if __name__ == "__main__":
    main()
