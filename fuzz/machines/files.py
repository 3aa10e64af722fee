"""Writes a case: the declared drive, the measurement, the records, and the truth in a tree of its own."""

import json
import math

import numpy as np
from effects import number_in_file, sign

UNITS = {
    ("speed", False): [("rad/s", 1.0), ("rpm", 30.0 / math.pi)],
    ("angle", False): [("rad", 1.0), ("deg", 180.0 / math.pi)],
    ("speed", True): [("m/s", 1.0), ("mm/s", 1e3)],
    ("angle", True): [("m", 1.0), ("mm", 1e3)],
}
SENSOR_KINDS = {
    ("speed", False): "tachometer",
    ("angle", False): "encoder",
    ("speed", True): "tachometer",
    ("angle", True): "displacement",
}
INERTIA_KEYS = {"inertia", "inertia2"}


def bodies(case):
    if case.slider:
        return ["carriage"]
    return ["motor", "load"] if "inertia2" in case.free else ["disc"]


def paths(case):
    """Where the declared numbers of the simulator stand in the drive file."""
    names = bodies(case)
    table, key = ("sliders", "mass_kg") if case.slider else ("rotors", "inertia_kg_m2")
    viscous = "force_n_s_per_m" if case.slider else "torque_nm_s_per_rad"
    return {
        "inertia": f"{table}.{names[0]}.{key}",
        "inertia2": f"{table}.{names[-1]}.{key}",
        "stiffness": "couplings.shaft.stiffness_nm_per_rad",
        "damping": "couplings.shaft.damping_nm_s_per_rad",
        "viscous": f"loads.viscous.{names[-1]}.{viscous}",
    }


def sensor_name(case, sensor):
    names = bodies(case)
    return sensor["kind"] if len(names) == 1 else f"{names[sensor['body']]}_{sensor['kind']}"


def target(case, name, sensor, part):
    """The effect as the program calls it, or an outside cause."""
    if part == "outside":
        return f"outside.{name}"
    if part == "sensor":
        return f"effects.{name}.{sensor_name(case, case.sensors[sensor])}"
    place = {"input": "drive", "coupling": "shaft", "body": bodies(case)[-1]}[part]
    return f"effects.{name}.{place}"


def draw_declared(rng, case, inertia_factor):
    """The numbers of the file: each a little wrong, the inertia perhaps by far."""
    width = {"inertia": 0.15, "inertia2": 0.15, "stiffness": 0.1, "damping": 0.2, "viscous": 0.1}
    factors = {key: math.exp(rng.uniform(-width[key], width[key])) for key in case.free}
    if inertia_factor:
        factors["inertia"] = inertia_factor
    elif case.free[:2] != ["inertia", "inertia2"] and rng.random() < 0.2:
        factors["inertia"] = rng.uniform(1.3, 2.0) ** sign(rng)
    return {key: case.machine[key] * factor for key, factor in factors.items()}


def table(path, value):
    head, key = path.rsplit(".", 1)
    return head, f"{key} = {value:.6g}"


def drive_text(case, numbers, with_truth=None):
    """The drive file. `numbers` are those of the simulator's free keys; `with_truth` adds effects."""
    tables = {}
    where = paths(case)
    for key in numbers:
        head, line = table(where[key], numbers[key])
        tables.setdefault(head, []).append(line)
    names = bodies(case)
    if len(names) == 2:
        tables["couplings.shaft"].insert(0, 'between = ["motor", "load"]')
    kind = "force" if case.slider else "torque"
    tables[f"inputs.{kind}.drive"] = [f'body = "{names[0]}"']
    for sensor in case.sensors:
        path = f"sensors.{SENSOR_KINDS[sensor['kind'], case.slider]}.{sensor_name(case, sensor)}"
        tables[path] = [f'body = "{names[sensor["body"]]}"']
    for path, values in (with_truth or {}).items():
        tables[path] = [f"{key} = {value:.9g}" for key, value in values.items()]
    return 'fidelity = "lumped"\n' + "".join(f"\n[{head}]\n" + "\n".join(lines) + "\n" for head, lines in tables.items())


def measured_text(case, ident, facts, units, with_time, spread):
    """The measurement file."""
    rate = case.records[0]["rate"]
    lines = [f'title = "{ident}"', 'drive = "drive.toml"']
    for i in range(len(case.records)):
        lines += ["", f"[files.r{i}]", f'path = "r{i}.csv"']
    kind, unit = ("force", "N") if case.slider else ("torque", "N m")
    for sensor, (name, _) in zip(case.sensors, units, strict=True):
        path = f"sensors.{SENSOR_KINDS[sensor['kind'], case.slider]}.{sensor_name(case, sensor)}"
        column = sensor_name(case, sensor)
        lines += ["", f"[channels.{column}]", f'sensor = "{path}"', f'column = "{column}"', f'unit = "{name}"']
    lines += ["", f"[inputs.{kind}]", f'input = "inputs.{kind}.drive"', f'column = "{kind}"', f'unit = "{unit}"']
    if case.records[0]["hold"]:
        lines.append("hold = true")
    for i, use in enumerate(facts["uses"]):
        lines += ["", f"[records.r{i}]", f'file = "r{i}"', f'use = "{use}"']
        lines += ['time_column = "t"', 'time_unit = "s"'] if with_time else [f"rate_hz = {rate:.6g}"]
        if facts.get("start_rest"):
            lines.append('start = "rest"')
    for key in case.free:
        lines += ["", f'[fit."{paths(case)[key]}"]']
        if key in INERTIA_KEYS and spread:
            lines.append("spread_percent = 20")
    return "\n".join(lines) + "\n"


def write_record(path, case, record, values, units, with_time):
    """One CSV file."""
    kind = "force" if case.slider else "torque"
    names = [kind] + [sensor_name(case, s) for s in case.sensors]
    columns = [record.get("measured_input", record["input"])] + [v * u[1] for v, u in zip(values, units, strict=True)]
    formats = ["%.9g"] * len(columns)
    if with_time:
        names.insert(0, "t")
        columns.insert(0, np.arange(len(columns[0])) / record["rate"])
        formats.insert(0, "%.9g")
    np.savetxt(path, np.stack(columns, axis=1), fmt=formats, delimiter=",", header=",".join(names), comments="")


def truth_effects(case, parts_of):
    """Names and numbers of the true effects, as the drive file writes them."""
    out = {}
    for name, sensor in case.effects:
        if parts_of(name) == "outside":
            continue
        place = case.machine if sensor is None else case.sensors[sensor]
        out[target(case, name, sensor, parts_of(name))] = number_in_file(name, place, case.slider)
    return out


def sharp(effects, speed):
    """The same effects with dry friction that is smoothed below this speed only."""
    out = {}
    for path, numbers in effects.items():
        name = path.split(".")[1]
        if name in ("coulomb_friction", "warming_friction", "load_friction"):
            key = "stick_speed_m_s" if "force_n" in numbers or path.endswith(".carriage") else "stick_speed_rad_s"
            numbers = numbers | {key: speed}
        out[path] = numbers
    return out


def write_json(path, value):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value, indent=1, default=lambda value: value.tolist()) + "\n")
