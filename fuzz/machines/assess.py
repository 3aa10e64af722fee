"""How large an effect is beside the noise, and which other effects the records cannot tell from it.

Both by fits to the noise-free truth with an own least-squares solver: the declared free numbers and the speeds at the start
are fitted again, without the effect or with a rival in its place.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from effects import EFFECTS, Effect
from simulator import channels

STEP = 1e-4  # of finite differences
STEPS = 10  # of a fit, at most
TWIN_BELOW = 30.0  # sum of squares of the difference over the noise: a rival so near is a twin
ENOUGH = 10000  # samples that rivals are fitted to
WORTH_FITTING = 0.5  # share of the squared difference that a rival must explain at first


@dataclass
class Case:
    """A true machine, its sensors and records; `noise` is the standard deviation of each sensor."""

    machine: dict
    sensors: list
    records: list
    parts: int
    free: list  # keys of the machine's numbers that are declared as free
    effects: list = field(default_factory=list)  # (name, index of the sensor or None)
    noise: np.ndarray | None = None
    slider: bool = False


@dataclass
class Model:
    """A machine that is fitted: its numbers and what may change."""

    machine: dict
    sensors: list
    starts: np.ndarray  # speed of each record at its begin
    free: list  # (kind, index of the sensor or None, key, scale)


def holder(model, number):
    return model.machine if number[0] == "machine" else model.sensors[number[1]]


def moved(model, delta):
    """The model with its free numbers and starts moved by `delta`."""
    out = Model(dict(model.machine), [dict(s) for s in model.sensors], model.starts.copy(), model.free)
    for number, d in zip(model.free, delta, strict=False):
        holder(out, number)[number[2]] += d * number[3]
    out.starts = out.starts + delta[len(model.free) :]
    return out


def run(model, case, parts):
    """All channels of all records over the noise."""
    rows = []
    for record, start in zip(case.records, model.starts, strict=True):
        values = channels(model.machine, model.sensors, record | {"speed": start}, parts)
        rows.append(values / case.noise[:, None])
    return rows


def sensitivities(model, case, parts, base, speed):
    """Columns of finite differences: one for each free number, one for the start of each record."""
    columns = []
    count = len(model.free) + len(model.starts)
    for k in range(len(model.free)):
        delta = np.zeros(count)
        delta[k] = STEP
        columns.append(flat(run(moved(model, delta), case, parts), base) / STEP)
    delta = np.zeros(count)
    delta[len(model.free) :] = STEP * speed
    together = run(moved(model, delta), case, parts)
    for i in range(len(base)):
        rows = [together[j] if j == i else base[j] for j in range(len(base))]
        columns.append(flat(rows, base) / (STEP * speed))
    return np.stack(columns, axis=1)


def flat(rows, base):
    return np.concatenate([(a - b).ravel() for a, b in zip(rows, base, strict=True)])


def solve(matrix, target):
    """Least squares with columns of one length."""
    length = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    return np.linalg.lstsq(matrix / length, target, rcond=1e-10)[0] / length


def fit(model, case, truth, parts, steps, speed):
    """Gauss and Newton with halved steps. Returns the model and its difference to the truth over the noise."""
    base = run(model, case, parts)
    left = flat(truth, base)
    for _ in range(steps):
        matrix = sensitivities(model, case, parts, base, speed)
        if not np.all(np.isfinite(matrix)):
            break  # a rival's numbers that the steps cannot follow
        delta = solve(matrix, left)
        for _ in range(5):
            tried = moved(model, delta)
            rows = run(tried, case, parts)
            new = flat(truth, rows)
            if np.all(np.isfinite(new)) and squares(new) < squares(left):
                break
            delta = delta / 2.0
        else:
            break
        gained = 1.0 - squares(new) / squares(left)
        model, base, left = tried, rows, new
        if gained < 1e-3 or squares(left) < 1.0:
            break
    return model, left


def declared(case, without):
    """The true machine without some of its effects, with its declared numbers free."""
    machine, sensors = dict(case.machine), [dict(s) for s in case.sensors]
    for name, sensor in without:
        remove(machine, sensors, name, sensor)
    free = [("machine", None, key, abs(case.machine[key])) for key in case.free]
    for name, sensor in case.effects:
        if (name, sensor) not in without:
            free += numbers_of(case, name, sensor)
    return Model(machine, sensors, np.array([r["speed"] for r in case.records]), free)


def remove(machine, sensors, name, sensor):
    """Takes an effect off."""
    effect = EFFECTS[name]
    (sensors[sensor] if effect.part == "sensor" else machine)[effect.sized] = 0.0


def numbers_of(case, name, sensor):
    """Free numbers of an effect that the case has."""
    effect = EFFECTS[name]
    place = case.sensors[sensor] if effect.part == "sensor" else case.machine
    kind = "sensor" if effect.part == "sensor" else "machine"
    return [(kind, sensor, key, abs(place[key]) or 1.0) for key in (effect.sized, *effect.fitted)]


def typical_speed(case):
    """Standard deviation of the speed of what the first sensor reads, in the record with most."""
    return max(float(np.std(channels(case.machine, [moving(case)], r, 2)[0])) for r in case.records)


def moving(case):
    return next(iter(case.sensors)) | {"kind": "speed"}


def sizes(case, speed):
    """For each effect, and for all together: rms over the noise, by channel, of what is missed without them."""
    parts = max(5, case.parts // 4)
    truth = run(declared(case, []), case, parts)
    out = []
    for without in [[e] for e in case.effects] + [list(case.effects)]:
        left = fit(declared(case, without), case, truth, parts, STEPS, speed)[1]
        out.append(by_channel(left, truth))
    return out


def by_channel(left, truth):
    """Root mean square of each channel over all records."""
    squares, counts, at = 0.0, 0, 0
    for rows in truth:
        part = left[at : at + rows.size].reshape(rows.shape)
        squares = squares + np.sum(part**2, axis=1)
        counts += rows.shape[1]
        at += rows.size
    return np.sqrt(squares / counts)


def twins(case, rivals, scales, rng, speed):
    """Rivals of each effect that leave next to nothing: [(effect, rival, sensor, sum of squares)]."""
    parts = max(5, case.parts // 4)
    out = [(effect, *twin, 0.0) for effect in case.effects for twin in exact_twins(case, effect[0])]
    whole = case
    for effect in case.effects:
        case, times = shortened(whole, effect, parts, speed)
        truth = run(declared(case, []), case, parts)
        model, missed = fit(declared(case, [effect]), case, truth, parts, STEPS, speed)
        base = run(model, case, parts)
        matrix = sensitivities(model, case, parts, base, speed)
        for name, sensor in rivals:
            if (name, sensor) in case.effects or (effect, name, sensor, 0.0) in out:
                continue
            left = squares(missed)
            for trial in promising(case, model, (name, sensor), scales, rng, (parts, base, matrix, missed)):
                left = min(left, squares(fit(trial, case, truth, parts, STEPS, speed)[1]))
            if left * times < TWIN_BELOW:
                out.append((effect, name, sensor, left * times))
    return out


def exact_twins(case, name):
    """Effects that are the same by their equations: a search need not find them."""
    on_input = [n for n, _ in case.effects if EFFECTS[n].part == "input" and n != name]
    single = len(case.sensors) == 1 and not on_input
    if name in ("constant_torque", "input_offset") and case.machine["load_body"] == 0.0 and not on_input:
        return [({"constant_torque": "input_offset"}.get(name, "constant_torque"), None)]
    if single and name == "input_delay":
        return [("latency", 0)]
    if single and name == "latency":
        return [("input_delay", None)]
    return []


def shortened(case, effect, parts, speed):
    """The case with the records that show the effect most, ENOUGH samples of them, and how many times longer it was."""
    truth = run(declared(case, []), case, parts)
    model, _ = fit(declared(case, [effect]), case, truth, parts, STEPS, speed)
    shown = [squares((a - b).ravel()) for a, b in zip(truth, run(model, case, parts), strict=True)]
    kept = max(2, ENOUGH // len(case.records[0]["input"]))
    most = sorted(range(len(shown)), key=lambda i: -shown[i])[:kept]
    return replace(case, records=[case.records[i] for i in most]), max(1.0, len(shown) / kept)


def promising(case, model, rival, scales, rng, state):
    """Models with the rival that, made linear, explain enough of what is missed. Several draws where it has a form."""
    parts, base, matrix, missed = state
    name, sensor = rival
    effect = EFFECTS[name]
    for _ in range(3 if effect.fitted else 1):
        numbers = effect.draw(rng, scales)
        trials = [with_effect(model, effect, sensor, numbers)]
        for key in effect.fitted:
            if key.endswith("phase"):
                trials.append(with_effect(model, effect, sensor, numbers | {key: numbers[key] + np.pi / 2.0}))
        columns = [flat(run(trial, case, parts), base) for trial in trials]
        together = np.column_stack([matrix, *columns])
        if not np.all(np.isfinite(together)):
            continue
        left = missed - together @ solve(together, missed)
        if squares(left) < (1.0 - WORTH_FITTING) * squares(missed):
            yield from trials


def squares(x):
    return float(x @ x)


def with_effect(model, effect: Effect, sensor, numbers):
    """The model with one more effect, small, whose numbers are free."""
    out = Model(dict(model.machine), [dict(s) for s in model.sensors], model.starts.copy(), list(model.free))
    kind = "sensor" if effect.part == "sensor" else "machine"
    for key, value in numbers.items():
        number = (kind, sensor, key, abs(value) or 1.0)
        small = 0.1 if key == effect.sized else 1.0
        holder(out, number)[key] = small * value
        if key == effect.sized or key in effect.fitted:
            out.free.append(number)
    return out
