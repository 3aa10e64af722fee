"""Inputs of the records: random signals of an open loop, and the torque of a controller."""

import math

import numpy as np
from simulator import BODY_KEYS, integrate


def multisine(rng, samples, rate, cutoff):
    """Sines of random phase up to the cutoff."""
    t = np.arange(samples) / rate
    lowest = 1.0 / t[-1]
    frequencies = np.exp(rng.uniform(math.log(2.0 * lowest), math.log(max(cutoff, 4.0 * lowest)), size=12))
    return sum(np.sin(2.0 * math.pi * f * t + rng.uniform(0.0, 2.0 * math.pi)) for f in frequencies)


def steps(rng, samples, rate, cutoff):
    """Levels of random height and length."""
    out = np.zeros(samples)
    at = 0
    while at < samples:
        length = int(rng.uniform(0.3, 2.0) * rate / cutoff * 5.0) + 3
        out[at : at + length] = rng.uniform(-1.7, 1.7)
        at += length
    return out


def prbs(rng, samples, rate, cutoff):
    """Two levels with a random clock."""
    clock = max(2, int(rate / cutoff))
    return np.repeat(rng.choice([-1.0, 1.0], size=samples // clock + 1), clock)[:samples]


def chirp(rng, samples, rate, cutoff):
    """A sine whose frequency grows."""
    t = np.arange(samples) / rate
    length = t[-1]
    low = 2.0 / length
    growth = math.log(max(cutoff, 2.0 * low) / low)
    phase = 2.0 * math.pi * low * length / growth * (np.exp(growth * t / length) - 1.0)
    return math.sqrt(2.0) * np.sin(phase + rng.uniform(0.0, 2.0 * math.pi))


def servo(rng, samples, rate, _cutoff):
    """Steps of either sign and of random height, 0.5 to 3 s long; some too small to move anything."""
    out = np.zeros(samples)
    at, side = 0, 1.0
    while at < samples:
        length = int(rng.uniform(0.5, 3.0) * rate)
        side = -side if rng.random() < 0.6 else side
        out[at : at + length] = side * (0.05 if rng.random() < 0.15 else rng.uniform(0.15, 1.0))
        at += length
    return out


SIGNALS = {"multisine": multisine, "steps": steps, "prbs": prbs, "chirp": chirp, "servo": servo}


def draw_signal(rng, samples, rate, cutoff, kinds=None):
    kind = rng.choice(kinds or ["multisine", "steps", "prbs", "chirp"])
    return SIGNALS[str(kind)](rng, samples, rate, cutoff)


def profile(rng, samples, rate, speed):
    """Speeds of moves to and fro with ramps and pauses."""
    out = np.zeros(samples)
    at = int(0.02 * samples)
    side = rng.choice([-1.0, 1.0])
    while at < samples:
        ramp = int(rng.uniform(0.02, 0.08) * samples)
        run = int(rng.uniform(0.02, 0.15) * samples)
        up = np.linspace(0.0, 1.0, ramp)
        move = side * speed * rng.uniform(0.3, 1.0) * np.concatenate([up, np.ones(run), up[::-1]])
        end = min(samples, at + len(move))
        out[at:end] = move[: end - at]
        at = end + int(rng.uniform(0.0, 0.05) * samples)
        side = -side
    return out


def loop_input(rng, machine, rate, samples, speed):
    """The torque of a controller (speed, or position and speed) that follows a profile."""
    reference = profile(rng, samples, rate, speed)
    place = np.concatenate([[0.0], np.cumsum(reference)[:-1] / rate])
    bandwidth = 2.0 * math.pi * rate * rng.uniform(0.005, 0.03)
    gain = machine["inertia"] * bandwidth
    position_gain = bandwidth / 5.0 if rng.random() < 0.5 else 0.0
    numbers = np.array([machine[key] for key in BODY_KEYS])
    parts = 10
    level = np.full(parts, machine["coulomb"])
    x, total = np.zeros(6), 0.0
    out = np.zeros(samples)
    for i in range(samples):
        error = reference[i] + position_gain * (place[i] - x[0]) - x[1]
        total += gain * bandwidth / 5.0 * error / rate
        out[i] = gain * error + total
        inputs = np.full((parts, 3), out[i])
        x = integrate(numbers, x, 1.0 / (rate * parts), inputs, np.zeros(parts), level)[-1]
    return {"input": out, "rate": rate, "hold": True, "speed": 0.0}
