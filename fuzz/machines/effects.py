"""The effects of pitchline's catalogue that the test set uses: their keys, and how large they are drawn.

A number is (key in the drive file, key of a slider or None, key of the simulator, factor from SI to the file's unit).
"""

import math
from dataclasses import dataclass

import numpy as np

DEG = 180.0 / math.pi


@dataclass
class Scales:
    """What is large and small in a machine: the sizes of effects are drawn beside it."""

    inertia: float
    viscous: float
    torque: float  # rms of the input
    speed: float  # rms of the speed
    rate: float
    length: float  # of a record, s
    cutoff: float  # highest frequency of the inputs, Hz


@dataclass
class Effect:
    part: str  # "body", "input", "coupling", "sensor" or "outside" of the catalogue
    numbers: list
    draw: object  # (random generator, Scales) -> numbers of the simulator
    sized: str  # the number that makes the effect large or small
    fitted: tuple = ()  # further numbers that a fit may change
    at_rest: bool = False  # records must begin at rest, since the past of the record matters


def log_uniform(rng, low, high):
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def sign(rng):
    return rng.choice([-1.0, 1.0])


def order(rng, s, highest):
    """An order whose frequency the samples resolve."""
    limit = int(s.rate / 10.0 / max(s.speed / (2.0 * math.pi), 1e-9))
    return float(rng.integers(1, max(1, min(highest, limit)) + 1))


def angle(rng):
    return rng.uniform(-math.pi, math.pi)


def lag_time(rng, s):
    """Half a sample to ten, and short beside the machine's own time constant."""
    return min(log_uniform(rng, 0.5, 10.0) / s.rate, 0.3 * s.inertia / s.viscous)


def draw_stribeck(rng, s):
    return {"stribeck": s.torque * log_uniform(rng, 0.1, 0.6), "stribeck_speed": s.speed * rng.uniform(0.2, 0.6)}


def draw_presliding(rng, s):
    torque = s.torque * log_uniform(rng, 0.1, 0.5)
    slip = s.speed * s.inertia / s.viscous * log_uniform(rng, 0.01, 0.2)
    return {"coulomb": torque, "bristle": torque / slip}


def draw_ripple(rng, s):
    return {
        "ripple": s.torque * log_uniform(rng, 0.05, 0.5),
        "ripple_order": order(rng, s, 12),
        "ripple_phase": angle(rng),
    }


def draw_unbalance(rng, s):
    return {"unbalance": s.torque / s.speed**2 * log_uniform(rng, 0.03, 0.3), "unbalance_phase": angle(rng)}


def draw_resonance(rng, s):
    attached = s.inertia * log_uniform(rng, 0.05, 0.8)
    frequency = 2.0 * math.pi * s.cutoff * rng.uniform(0.2, 0.9)
    damping = 2.0 * log_uniform(rng, 0.02, 0.2) * attached * frequency
    return {"inertia2": attached, "stiffness": attached * frequency**2, "damping": damping}


def draw_encoder(rng, s):
    return {
        "encoder_error": log_uniform(rng, 0.2, 5.0) / DEG,
        "encoder_order": order(rng, s, 4),
        "encoder_phase": angle(rng),
    }


EFFECTS = {
    "coulomb_friction": Effect(
        "body",
        [("torque_nm", "force_n", "coulomb", 1.0)],
        lambda rng, s: {"coulomb": s.torque * log_uniform(rng, 0.03, 0.4)},
        "coulomb",
    ),
    "stribeck_friction": Effect(
        "body",
        [
            ("torque_nm", "force_n", "stribeck", 1.0),
            ("stribeck_speed_rad_s", "stribeck_speed_m_s", "stribeck_speed", 1.0),
        ],
        draw_stribeck,
        "stribeck",
        ("stribeck_speed",),
    ),
    "presliding_friction": Effect(
        "body",
        [("torque_nm", "force_n", "coulomb", 1.0)],
        draw_presliding,
        "coulomb",
        ("bristle",),
    ),
    "warming_friction": Effect(
        "body",
        [("torque_nm", "force_n", "coulomb", 1.0), ("time_s", "time_s", "fade", 1.0)],
        lambda rng, s: {
            "coulomb": s.torque * log_uniform(rng, 0.1, 0.4),
            "fade": s.length * rng.uniform(0.2, 0.8),
        },
        "coulomb",
        ("fade",),
    ),
    "viscous_friction": Effect(
        "body",
        [("torque_nm_s_per_rad", "force_n_s_per_m", "viscous", 1.0)],
        lambda rng, s: {"viscous": s.viscous},
        "viscous",
    ),
    "quadratic_drag": Effect(
        "body",
        [("torque_nm_s2_per_rad2", "force_n_s2_per_m2", "quadratic", 1.0)],
        lambda rng, s: {"quadratic": s.viscous / s.speed * log_uniform(rng, 0.1, 1.0)},
        "quadratic",
    ),
    "constant_torque": Effect(
        "body",
        [("torque_nm", "force_n", "constant", 1.0)],
        lambda rng, s: {"constant": sign(rng) * s.torque * log_uniform(rng, 0.02, 0.3)},
        "constant",
    ),
    "torque_ripple": Effect(
        "body",
        [
            ("torque_nm", None, "ripple", 1.0),
            ("phase_deg", None, "ripple_phase", DEG),
            ("order", None, "ripple_order", 1.0),
        ],
        draw_ripple,
        "ripple",
        ("ripple_phase",),
    ),
    "unbalance": Effect(
        "body",
        [("inertia_kg_m2", None, "unbalance", 1.0), ("phase_deg", None, "unbalance_phase", DEG)],
        draw_unbalance,
        "unbalance",
        ("unbalance_phase",),
    ),
    "torsional_resonance": Effect(
        "body",
        [("inertia_kg_m2", "mass_kg", "inertia2", 1.0)],
        draw_resonance,
        "inertia2",
        ("stiffness", "damping"),
        at_rest=True,
    ),
    "backlash": Effect("coupling", [("gap_um", None, "gap", 1e6)], None, "gap", at_rest=True),
    "input_gain_curve": Effect(
        "input",
        [("per_unit", "per_unit", "gain_curve", 1.0)],
        lambda rng, s: {"gain_curve": sign(rng) * log_uniform(rng, 0.02, 0.15) / s.torque},
        "gain_curve",
    ),
    "input_gain_by_sign": Effect(
        "input",
        [("difference_percent", "difference_percent", "gain_by_sign", 100.0)],
        lambda rng, s: {"gain_by_sign": sign(rng) * log_uniform(rng, 0.01, 0.2)},
        "gain_by_sign",
    ),
    "load_friction": Effect(
        "input",
        [("loss_percent", "loss_percent", "friction_per_input", 100.0)],
        lambda rng, s: {"friction_per_input": log_uniform(rng, 0.03, 0.4)},
        "friction_per_input",
    ),
    "input_saturation": Effect(
        "input",
        [("limit", "limit", "saturation", 1.0)],
        lambda rng, s: {"saturation": 1.0 / (s.torque * log_uniform(rng, 1.0, 5.0))},
        "saturation",
    ),
    "input_dead_zone": Effect(
        "input",
        [("width", "width", "dead_zone", 1.0)],
        lambda rng, s: {"dead_zone": s.torque * log_uniform(rng, 0.03, 0.4)},
        "dead_zone",
    ),
    "input_offset": Effect(
        "input",
        [("offset", "offset", "input_offset", 1.0)],
        lambda rng, s: {"input_offset": sign(rng) * s.torque * log_uniform(rng, 0.02, 0.3)},
        "input_offset",
    ),
    "input_delay": Effect(
        "input",
        [("delay_ms", "delay_ms", "input_delay", 1e3)],
        lambda rng, s: {"input_delay": lag_time(rng, s)},
        "input_delay",
        at_rest=True,
    ),
    "input_lag": Effect(
        "input",
        [("time_ms", "time_ms", "lag", 1e3)],
        lambda rng, s: {"lag": lag_time(rng, s)},
        "lag",
        at_rest=True,
    ),
    "encoder_error": Effect(
        "sensor",
        [
            ("amplitude_deg", None, "encoder_error", DEG),
            ("phase_deg", None, "encoder_phase", DEG),
            ("order", None, "encoder_order", 1.0),
        ],
        draw_encoder,
        "encoder_error",
        ("encoder_phase",),
    ),
    "latency": Effect(
        "sensor",
        [("delay_ms", "delay_ms", "latency", 1e3)],
        lambda rng, s: {"latency": lag_time(rng, s)},
        "latency",
        at_rest=True,
    ),
    "low_pass": Effect(
        "sensor",
        [("time_ms", "time_ms", "low_pass", 1e3)],
        lambda rng, s: {"low_pass": lag_time(rng, s)},
        "low_pass",
        at_rest=True,
    ),
    "gain_error": Effect(
        "sensor",
        [("gain_percent", "gain_percent", "gain_error", 100.0)],
        lambda rng, s: {"gain_error": sign(rng) * log_uniform(rng, 0.01, 0.2)},
        "gain_error",
    ),
    "offset": Effect(
        "sensor",
        [("offset", "offset", "offset", 1.0)],
        lambda rng, s: {"offset": sign(rng) * s.speed * log_uniform(rng, 0.01, 0.2)},
        "offset",
    ),
    "drift": Effect(
        "sensor",
        [("per_s", "per_s", "drift", 1.0)],
        lambda rng, s: {"drift": sign(rng) * s.speed / s.length * log_uniform(rng, 0.02, 0.3)},
        "drift",
    ),
}
OUTSIDE = ["random_torque", "bump", "brake", "cubic", "hysteresis", "crank"]  # their numbers have the same names
EFFECTS |= {name: Effect("outside", [], None, name) for name in OUTSIDE}
ON_ROTORS_ONLY = {"torque_ripple", "unbalance", "encoder_error", "backlash"}


def number_in_file(name, numbers, slider):
    """Numbers of an effect as the drive file writes them."""
    if name == "input_saturation":
        return {"limit": 1.0 / numbers["saturation"]}
    if name == "torsional_resonance":
        w = math.sqrt(numbers["stiffness"] / numbers["inertia2"])
        return {
            "mass_kg" if slider else "inertia_kg_m2": numbers["inertia2"],
            "frequency_hz": w / (2.0 * math.pi),
            "damping_ratio": numbers["damping"] / (2.0 * numbers["inertia2"] * w),
        }
    if name == "presliding_friction":
        keys = ("force_n", "slip_m") if slider else ("torque_nm", "slip_rad")
        return {keys[0]: numbers["coulomb"], keys[1]: numbers["coulomb"] / numbers["bristle"]}
    out = {}
    for key, slider_key, ours, factor in EFFECTS[name].numbers:
        out[slider_key if slider else key] = float(np.float64(numbers[ours]) * factor)
    return out
