"""Machines with causes outside of the catalogue: no name is right, some are near."""

import math

import numpy as np
from effects import log_uniform, order, sign
from kinds import with_effects

NEAR = {
    "cubic": ["quadratic_drag", "viscous_friction"],
    "brake": ["coulomb_friction", "warming_friction", "presliding_friction"],
    "hysteresis": ["input_dead_zone", "input_lag", "load_friction"],
    "crank": ["unbalance", "torque_ripple", "encoder_error"],
    "random_phase": ["torque_ripple"],
    "coloured_noise": [],
    "random_torque": [],
    "bump": [],
}


def coloured(rng, samples, correlation):
    """Noise of variance 1 that remembers its past (Ornstein and Uhlenbeck)."""
    white = rng.standard_normal(samples)
    out = np.empty(samples)
    out[0] = white[0]
    for i in range(1, samples):
        out[i] = correlation * out[i - 1] + math.sqrt(1.0 - correlation**2) * white[i]
    return out


def bumps(rng, samples):
    """Two short pushes at the same times in every record."""
    out = np.zeros(samples)
    for place in (0.3, 0.7):
        at, width = int(place * samples), max(2, int(0.02 * samples))
        out[at : at + width] = 1.0
    return out


def outside(rng):
    """One cause that no effect of the catalogue describes."""
    cause = str(rng.choice(list(NEAR)))
    drawn = with_effects(rng, [], one_way=bool(rng.random() < 0.3))
    case, scales, facts = drawn
    if case.slider and cause in ("crank", "random_phase"):
        return None
    samples = len(case.records[0]["input"])
    facts["class"] = cause
    facts["near"] = NEAR[cause]
    machine = case.machine
    case.effects = [(cause, None)]
    for record in case.records:
        if cause == "random_torque":
            record[cause] = coloured(rng, samples, math.exp(-machine["viscous"] / machine["inertia"] / record["rate"]))
        elif cause == "bump":
            record[cause] = bumps(rng, samples)
        elif cause == "brake":
            record[cause] = np.where(np.arange(samples) > rng.uniform(0.3, 0.6) * samples, 1.0, 0.0)
        elif cause == "coloured_noise":
            record["noise"] = np.stack([coloured(rng, samples, 0.95) for _ in case.sensors])
        elif cause == "random_phase":
            record["factors"] = {"ripple_phase": rng.uniform(-math.pi, math.pi)}
    if cause in ("random_torque", "bump", "brake"):
        machine[cause] = scales.torque * log_uniform(rng, 0.1, 0.5)
    elif cause == "cubic":
        machine[cause] = machine["viscous"] / scales.speed**2 * log_uniform(rng, 0.1, 1.0)
    elif cause == "hysteresis":
        machine[cause] = sign(rng) * scales.torque * log_uniform(rng, 0.05, 0.3)
        machine["hysteresis_width"] = scales.torque * log_uniform(rng, 0.2, 1.0)
        for record in case.records:
            record["hold"] = True
    elif cause == "crank":
        machine[cause] = rng.uniform(0.05, 0.4)
    elif cause == "random_phase":
        machine.update({"ripple": scales.torque * log_uniform(rng, 0.1, 0.4), "ripple_phase": 1.0})
        machine["ripple_order"] = order(rng, scales, 4)
        case.effects = [("torque_ripple", None)]
    if cause == "coloured_noise":
        case.effects = []
    return drawn
