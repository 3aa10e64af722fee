"""The kinds of machines: each function draws one true machine with its records."""

import math

import numpy as np
from assess import Case
from effects import EFFECTS, ON_ROTORS_ONLY, Scales, log_uniform, sign
from signals import draw_signal, loop_input
from simulator import DEFAULTS, SENSOR_DEFAULTS, simulate

MEAN_SPEED = 4.3  # in machines that turn one way, beside the rms of what is added to it


def sensor(kind, body=0):
    return {"kind": kind, "body": body} | SENSOR_DEFAULTS


def draw_sensors(rng, angle_alone=True):
    """Speed, angle or both of the first body."""
    kinds = [["speed"], ["angle"], ["speed", "angle"]]
    chosen = kinds[rng.choice(3, p=[0.6, 0.2, 0.2] if angle_alone else [0.75, 0.0, 0.25])]
    return [sensor(kind) for kind in chosen]


def draw_uses(rng, count):
    """Which records judge: two or three, not the first and the last."""
    judges = rng.choice(np.arange(1, count - 1), size=min(count - 2, 2 + int(count > 6)), replace=False)
    return ["judge" if i in judges else "fit" for i in range(count)]


def free_body(rng):
    """A body with viscous friction, and how its records are taken."""
    rate = log_uniform(rng, 50.0, 2000.0)
    rate = float(f"{rate:.2g}")
    samples = int(rng.integers(600, 4001))
    machine = dict(DEFAULTS)
    machine["inertia"] = log_uniform(rng, 1e-5, 1.0)
    constant = log_uniform(rng, max(10.0 / rate, 0.01 * samples / rate), 0.2 * samples / rate)
    machine["viscous"] = machine["inertia"] / constant
    return machine, rate, samples


def draw_records(rng, machine, rate, samples, speed, one_way, at_rest, kinds=None):
    """Records whose inputs move the bare machine at about this speed (rms)."""
    count = int(rng.integers(5, 9))
    cutoff = min(rate / 20.0, 20.0 * machine["viscous"] / machine["inertia"] / (2.0 * math.pi))
    hold = bool(rng.random() < 0.7)
    signals = [draw_signal(rng, samples, rate, cutoff, kinds) for _ in range(count)]
    records = [{"input": s, "rate": rate, "hold": hold, "speed": 0.0} for s in signals]
    inertia = machine["inertia"] + machine["inertia2"]
    bare = dict(DEFAULTS) | {"inertia": inertia, "viscous": machine["viscous"]}
    reached = np.sqrt(np.mean([np.mean(simulate(bare, r, 2)[:, 1] ** 2) for r in records]))
    for record in records:
        record["input"] = record["input"] * speed / reached
        if one_way:
            mean = speed * rng.uniform(3.5, 5.0)
            record["input"] = record["input"] + mean * machine["viscous"]
            record["speed"] = 0.0 if at_rest else mean * rng.uniform(0.9, 1.1)
    torque = float(np.sqrt(np.mean([np.mean(r["input"] ** 2) for r in records])))
    all_speeds = speed * (MEAN_SPEED if one_way else 1.0)
    return records, Scales(inertia, machine["viscous"], torque, all_speeds, rate, samples / rate, cutoff)


def draw_speed(rng, rate, length, slider):
    """A speed (rms) at which the samples resolve a turn, and a record holds some."""
    if slider:
        return log_uniform(rng, 0.02, 2.0)
    return log_uniform(rng, max(1.0, 20.0 / length), min(300.0, 2.0 * math.pi * rate / 20.0))


def steps_per_sample(machine, scales):
    """So many that the fastest part of the machine takes small steps."""
    fastest = machine["viscous"] / machine["inertia"]
    if machine["inertia2"] > 0.0:
        both = 1.0 / machine["inertia"] + 1.0 / machine["inertia2"]
        fastest = max(fastest, math.sqrt(machine["stiffness"] * both), machine["damping"] * both)
    if machine["stribeck"] > 0.0:
        fastest = max(fastest, 5.0 * machine["stribeck"] / machine["stribeck_speed"] / machine["inertia"])
    if machine["bristle"] > 0.0:
        fastest = max(fastest, math.sqrt(machine["bristle"] / machine["inertia"]))
    if machine["lag"] > 0.0:
        fastest = max(fastest, 1.0 / machine["lag"])
    return int(np.clip(math.ceil(20.0 * fastest / scales.rate), 10, 50))


def suits(name, sensors, slider):
    """Whether a machine with these sensors can have the effect, and on which sensor."""
    if slider and name in ON_ROTORS_ONLY:
        return None
    if EFFECTS[name].part != "sensor":
        return (name, None)
    places = range(len(sensors))
    if name in ("offset", "drift"):
        places = [i for i in places if sensors[i]["kind"] == "speed"]
    if name == "gain_error" and len(sensors) < 2:
        return None
    return (name, places[-1]) if places else None


def free_numbers(names):
    """The declared numbers that are fitted."""
    return ["inertia"] if "viscous_friction" in names else ["inertia", "viscous"]


def with_effects(rng, names, one_way=None, wide=False):
    """A machine with one body and these effects. None where they do not suit."""
    slider = bool(rng.random() < 0.15)
    sensors = draw_sensors(rng)
    if "gain_error" in names:
        sensors = [sensor("speed"), sensor("angle")]
    places = [suits(name, sensors, slider) for name in names]
    if None in places:
        return None
    machine, rate, samples = free_body(rng)
    at_rest = any(EFFECTS[name].at_rest for name in names) or rng.random() < 0.4
    if one_way is None:
        one_way = bool(rng.random() < 0.5)
    speed = draw_speed(rng, rate, samples / rate, slider) / (MEAN_SPEED if one_way else 1.0)
    kinds = ["steps", "multisine"] if wide else None
    records, scales = draw_records(rng, machine, rate, samples, speed, one_way, at_rest, kinds)
    for name, place in places:
        numbers = EFFECTS[name].draw(rng, scales)
        (machine if place is None else sensors[place]).update(numbers)
    parts = steps_per_sample(machine, scales)
    case = Case(machine, sensors, records, parts, free_numbers(names), places, slider=slider)
    return case, scales, {"uses": draw_uses(rng, len(records)), "at_rest": all(r["speed"] == 0.0 for r in records)}


def single(rng):
    """One body, one effect."""
    names = [name for name, effect in EFFECTS.items() if effect.draw]
    if rng.random() < 0.12:
        return two_bodies(rng)
    return with_effects(rng, [str(rng.choice(names))])


def several(rng, count):
    """Effects of different parts, and no two lags."""
    groups = [
        ["coulomb_friction", "stribeck_friction", "presliding_friction", "load_friction"],
        ["quadratic_drag", "viscous_friction"],
        ["constant_torque", "input_offset"],
        ["torque_ripple", "unbalance", "encoder_error"],
        ["input_gain_curve", "input_saturation", "input_dead_zone", "input_gain_by_sign"],
        ["input_delay", "input_lag", "latency", "low_pass"],
        ["torsional_resonance"],
        ["gain_error", "drift"],
    ]
    chosen = rng.choice(len(groups), size=count, replace=False)
    return with_effects(rng, [str(rng.choice(groups[i])) for i in chosen], one_way=bool(rng.random() < 0.3))


def double(rng):
    return several(rng, 2)


def triple(rng):
    return several(rng, 3)


def clean(rng):
    """Nothing is missing; one sensor in four is quantised."""
    drawn = with_effects(rng, [])
    case = drawn[0]
    if rng.random() < 0.25:
        case.sensors[0]["quantisation"] = -1.0  # a multiple of the noise, once this is known
    return drawn


def two_bodies(rng):
    """Motor, spring, load: with backlash, friction of the load or a delay."""
    machine, rate, samples = free_body(rng)
    share = rng.uniform(0.3, 0.7)
    inertia = machine["inertia"]
    machine["inertia"], machine["inertia2"] = share * inertia, (1.0 - share) * inertia
    machine["load_body"] = 1.0
    frequency = 2.0 * math.pi * rate * rng.uniform(0.02, 0.05)
    reduced = share * (1.0 - share) * inertia
    machine["stiffness"] = reduced * frequency**2
    machine["damping"] = 2.0 * log_uniform(rng, 0.03, 0.2) * reduced * frequency
    sensors = [[sensor("speed", 1)], [sensor("speed", 0), sensor("speed", 1)]][rng.choice(2)]
    speed = draw_speed(rng, rate, samples / rate, False)
    records, scales = draw_records(rng, machine, rate, samples, speed, False, True, ["steps", "prbs", "multisine"])
    name = str(rng.choice(["backlash", "coulomb_friction", "input_delay", "quadratic_drag"]))
    if name == "backlash":
        machine["gap"] = scales.torque / machine["stiffness"] * log_uniform(rng, 0.1, 3.0)
    else:
        machine.update(EFFECTS[name].draw(rng, scales))
    case = Case(machine, sensors, records, steps_per_sample(machine, scales), free_numbers([]), [(name, None)])
    case.free = ["inertia", "inertia2", "stiffness", "damping", "viscous"]
    return case, scales, {"uses": draw_uses(rng, len(records)), "at_rest": True}


def wrong_inertia(rng):
    """A clear effect, and an inertia that is declared 5 to 50 times wrong."""
    names = ["coulomb_friction", "quadratic_drag", "viscous_friction", "constant_torque", "torque_ripple",
             "input_dead_zone", "input_delay", "latency", "unbalance"]  # fmt: skip
    drawn = with_effects(rng, [str(rng.choice(names))])
    if drawn:
        drawn[2]["inertia_factor"] = log_uniform(rng, 5.0, 50.0) ** sign(rng)
    return drawn


def warming(rng):
    """Friction falls from record to record."""
    name = str(rng.choice(["coulomb_friction", "viscous_friction"]))
    drawn = with_effects(rng, [name], one_way=False, wide=True)
    case, _, facts = drawn
    step = rng.uniform(0.05, 0.2)
    course = (1.0 - step) ** np.arange(len(case.records))
    key = EFFECTS[name].sized
    for record, factor in zip(case.records, course, strict=True):
        record["factors"] = {key: float(factor)}
    facts["course"] = (case.machine[key] * course).tolist()
    facts["uses"] = ["judge" if i % 3 == 1 and i + 1 < len(course) else "fit" for i in range(len(course))]
    return drawn


def servo(rng):
    """A light rotor, open loop, steps of torque little above its dry friction, both ways, 20 s."""
    rate = float(rng.choice([200.0, 250.0, 400.0, 500.0, 1000.0]))
    samples = int(20 * rate)
    machine = dict(DEFAULTS)
    machine["inertia"] = log_uniform(rng, 1e-5, 1e-2)
    machine["viscous"] = machine["inertia"] / log_uniform(rng, 0.03, 0.5)
    top = log_uniform(rng, 3.0, 100.0)
    machine["coulomb"] = machine["viscous"] * top * log_uniform(rng, 0.8, 8.0)
    records = []
    for _ in range(int(rng.integers(4, 7))):
        u = draw_signal(rng, samples, rate, 1.0, ["servo"])
        torque = np.sign(u) * (machine["coulomb"] + np.abs(u) * machine["viscous"] * top)
        torque = np.where(np.abs(u) < 0.1, np.sign(u) * 0.7 * machine["coulomb"], torque)
        records.append({"input": torque, "rate": rate, "hold": True, "speed": 0.0})
    size = float(np.sqrt(np.mean([np.mean(r["input"] ** 2) for r in records])))
    scales = Scales(machine["inertia"], machine["viscous"], size, 0.5 * top, rate, 20.0, 1.0)
    case = Case(machine, draw_sensors(rng), records, 10, ["inertia", "viscous"], [("coulomb_friction", None)])
    return case, scales, {"uses": draw_uses(rng, len(records)), "at_rest": True}


def loop(rng):
    """An axis that a controller moves to and fro; its torque is measured with a little noise."""
    rate = float(rng.choice([200.0, 250.0, 500.0, 1000.0]))
    samples = int(rng.integers(1500, 4001))
    length = samples / rate
    machine = dict(DEFAULTS)
    machine["inertia"] = log_uniform(rng, 1e-5, 1.0)
    machine["viscous"] = machine["inertia"] / (length * log_uniform(rng, 0.02, 0.3))
    speed = log_uniform(rng, 2.0, 100.0)
    peak = machine["inertia"] * speed / (0.05 * length)
    names = [["coulomb_friction"], ["coulomb_friction", "constant_torque"], ["viscous_friction"]][rng.choice(3)]
    if "coulomb_friction" in names:
        machine["coulomb"] = peak * log_uniform(rng, 0.03, 0.6)
    if "constant_torque" in names:
        machine["constant"] = sign(rng) * machine["coulomb"] * rng.uniform(0.1, 0.6)
    count = int(rng.integers(4, 8))
    records = [loop_input(rng, machine, rate, samples, speed) for _ in range(count)]
    torque = float(np.sqrt(np.mean([np.mean(r["input"] ** 2) for r in records])))
    scales = Scales(machine["inertia"], machine["viscous"], torque, 0.5 * speed, rate, length, rate / 20.0)
    places = [(name, None) for name in names]
    case = Case(machine, draw_sensors(rng), records, 10, free_numbers(names), places)
    return case, scales, {"uses": draw_uses(rng, count), "at_rest": True, "input_noise": True}


def confusable(rng):
    """Records in which nothing reverses, or nothing changes much: two effects look alike."""
    name = str(rng.choice(["coulomb_friction", "constant_torque", "input_offset", "input_delay", "latency",
                           "input_lag", "low_pass", "encoder_error", "unbalance", "torque_ripple"]))  # fmt: skip
    return with_effects(rng, [name], one_way=True)
