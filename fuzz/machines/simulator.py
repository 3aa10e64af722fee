"""Simulates the true machines of the test set: up to two bodies, a measured input, dry friction, sensors.

Everything is in SI units. A machine is a dictionary of numbers (`DEFAULTS` lists the keys), a record a dictionary with the
sampled input and the state in which it starts. This code shares nothing with pitchline.
"""

import math

import numpy as np
from numba import njit

# Numbers of the bodies and of what acts on them. "Load" is the body that the loads act on.
BODY_KEYS = [
    "inertia", "inertia2", "stiffness", "damping", "gap",  # the second body hangs on the first by a spring
    "load_body",  # 0 or 1: on which body the loads act
    "viscous", "quadratic", "cubic", "constant",
    "stribeck", "stribeck_speed",
    "ripple", "ripple_order", "ripple_phase",
    "unbalance", "unbalance_phase",
    "lag",  # time constant of the input
    "crank",  # share by which the inertia goes with twice the angle
    "bristle", "bristle_damping",  # LuGre
]  # fmt: skip
DEFAULTS = dict.fromkeys(BODY_KEYS, 0.0) | {
    "stribeck_speed": 1.0,
    "coulomb": 0.0,
    "friction_per_input": 0.0,
    "gain_curve": 0.0,
    "saturation": 0.0,  # 1 / limit: 0 is off
    "dead_zone": 0.0,
    "input_offset": 0.0,
    "input_delay": 0.0,
    "gain_by_sign": 0.0,
    "hysteresis": 0.0,
    "hysteresis_width": 1.0,
    "fade": 0.0,  # time constant with which dry friction fades within a record
    "random_torque": 0.0,  # these three: times a course of the record
    "bump": 0.0,
    "brake": 0.0,
}
SENSOR_DEFAULTS = {
    "encoder_error": 0.0,
    "encoder_order": 1.0,
    "encoder_phase": 0.0,
    "latency": 0.0,
    "low_pass": 0.0,
    "gain_error": 0.0,
    "offset": 0.0,
    "drift": 0.0,
    "quantisation": 0.0,
}
(INERTIA, INERTIA2, STIFFNESS, DAMPING, GAP, LOAD_BODY, VISCOUS, QUADRATIC, CUBIC, CONSTANT, STRIBECK, STRIBECK_SPEED, RIPPLE,
 RIPPLE_ORDER, RIPPLE_PHASE, UNBALANCE, UNBALANCE_PHASE, LAG, CRANK, BRISTLE,
 BRISTLE_DAMPING) = range(len(BODY_KEYS))  # fmt: skip


@njit(cache=True)
def loads(p, q, v, extra):
    """Torque of all smooth loads on their body. Signs as in `pitchline effects`."""
    torque = extra - p[CONSTANT] - v * (p[VISCOUS] + p[QUADRATIC] * abs(v) + p[CUBIC] * v * v)
    if p[STRIBECK] != 0.0:
        x = v / p[STRIBECK_SPEED]
        torque -= p[STRIBECK] * math.exp(-x * x) * x / math.sqrt(x * x + 0.04)
    if p[RIPPLE] != 0.0:
        torque += p[RIPPLE] * math.sin(p[RIPPLE_ORDER] * q + p[RIPPLE_PHASE])
    if p[UNBALANCE] != 0.0:
        torque += p[UNBALANCE] * v * v * math.sin(q + p[UNBALANCE_PHASE])
    return torque


@njit(cache=True)
def shaft(p, stretch, rate):
    """Torque of the shaft between the bodies: nothing inside the gap."""
    half = 0.5 * p[GAP]
    if stretch > half:
        return p[STIFFNESS] * (stretch - half) + p[DAMPING] * rate
    if stretch < -half:
        return p[STIFFNESS] * (stretch + half) + p[DAMPING] * rate
    return p[STIFFNESS] * stretch + p[DAMPING] * rate if half == 0.0 else 0.0


@njit(cache=True)
def torques(p, x, u, extra):
    """Torques on both bodies without dry friction. x: angle, speed, angle2, speed2, lagged input, bristle."""
    drive = x[4] if p[LAG] > 0.0 else u
    first, second = drive, 0.0
    if p[INERTIA2] > 0.0:
        second = shaft(p, x[0] - x[2], x[1] - x[3])
        first -= second
    if p[LOAD_BODY] == 0.0:
        first += loads(p, x[0], x[1], extra)
    else:
        second += loads(p, x[2], x[3], extra)
    return first, second


@njit(cache=True)
def slopes(p, x, u, extra, level, sign, out):
    """Time derivative of the state. `sign`: direction of sliding friction, 0 while its body sticks."""
    first, second = torques(p, x, u, extra)
    out[5] = 0.0
    if level > 0.0:
        body = int(p[LOAD_BODY])
        friction = sign * level
        if p[BRISTLE] > 0.0:
            v = x[1 + 2 * body]
            out[5] = v - p[BRISTLE] * abs(v) / level * x[5]
            friction = p[BRISTLE] * x[5] + p[BRISTLE_DAMPING] * out[5]
        elif sign == 0.0:
            friction = second if body == 1 else first
        if body == 1:
            second -= friction
        else:
            first -= friction
    inertia = p[INERTIA]
    if p[CRANK] != 0.0:
        first += p[CRANK] * p[INERTIA] * math.sin(2.0 * x[0]) * x[1] * x[1]  # - J'(q) v^2 / 2
        inertia *= 1.0 + p[CRANK] * math.cos(2.0 * x[0])
    out[0] = x[1]
    out[1] = first / inertia
    out[2] = x[3]
    out[3] = second / p[INERTIA2] if p[INERTIA2] > 0.0 else 0.0
    out[4] = (u - x[4]) / p[LAG] if p[LAG] > 0.0 else 0.0


@njit(cache=True)
def add(x, h, slope, out):
    """out = x + h slope, without a new array."""
    for i in range(6):
        out[i] = x[i] + h * slope[i]


@njit(cache=True)
def runge_kutta(p, x, h, u, extra, level, sign, work):
    """One step of fourth order from x to work[5]. u: the input at the begin, the middle and the end."""
    slopes(p, x, u[0], extra, level, sign, work[0])
    add(x, 0.5 * h, work[0], work[4])
    slopes(p, work[4], u[1], extra, level, sign, work[1])
    add(x, 0.5 * h, work[1], work[4])
    slopes(p, work[4], u[1], extra, level, sign, work[2])
    add(x, h, work[2], work[4])
    slopes(p, work[4], u[2], extra, level, sign, work[3])
    for i in range(6):
        work[5, i] = x[i] + h / 6.0 * (work[0, i] + 2.0 * work[1, i] + 2.0 * work[2, i] + work[3, i])


@njit(cache=True)
def direction(p, x, u, extra, level):
    """Which way friction's body slides: 0 if it sticks."""
    body = int(p[LOAD_BODY])
    v = x[1 + 2 * body]
    if v != 0.0:
        return math.copysign(1.0, v)
    first, second = torques(p, x, u, extra)
    rest = second if body == 1 else first
    if abs(rest) <= level:
        return 0.0
    return math.copysign(1.0, rest)


@njit(cache=True)
def integrate(p, x, h, inputs, extra, level):
    """States at the begin of all steps and at the end of the last. Sliding friction stops and starts at its events."""
    n = inputs.shape[0]
    states = np.empty((n + 1, 6))
    work = np.empty((6, 6))
    states[0] = x
    x = x.copy()
    speed = 1 + 2 * int(p[LOAD_BODY])
    for i in range(n):
        u, e, f = inputs[i], extra[i], level[i]
        if f <= 0.0 or p[BRISTLE] > 0.0:
            runge_kutta(p, x, h, u, e, f, 0.0, work)
        else:
            sign = direction(p, x, u[0], e, f)
            runge_kutta(p, x, h, u, e, f, sign, work)
            before, after = x[speed], work[5, speed]
            if before * after < 0.0:  # it comes to rest within this step
                share = before / (before - after)
                runge_kutta(p, x, h * share, u, e, f, sign, work)
                x[:] = work[5]
                x[speed] = 0.0
                sign = direction(p, x, u[2], e, f)
                runge_kutta(p, x, h * (1.0 - share), u, e, f, sign, work)
        x[:] = work[5]
        states[i + 1] = x
    return states


@njit(cache=True)
def bouc_wen(u, width):
    """A hysteresis of height 1 that the input runs through."""
    z = np.zeros(len(u))
    for i in range(1, len(u)):
        parts = 20
        step = (u[i] - u[i - 1]) / (width * parts)
        z[i] = z[i - 1]
        for _ in range(parts):
            z[i] += step - 0.5 * (abs(step) * z[i] + step * abs(z[i]))
    return z


def shaped(machine, u):
    """The input after the effects on its value."""
    u = u + machine["input_offset"]
    u = u * (1.0 + machine["gain_curve"] * np.abs(u)) * (1.0 + machine["gain_by_sign"] * np.sign(u))
    if machine["dead_zone"] > 0.0:
        u = u - np.clip(u, -machine["dead_zone"], machine["dead_zone"])
    if machine["saturation"] > 0.0:
        u = np.tanh(u * machine["saturation"]) / machine["saturation"]
    return u


def fine_inputs(machine, record, parts):
    """The input at the begin, the middle and the end of every step, after delay and shape."""
    u, rate = record["input"], record["rate"]
    n = len(u)
    begin = np.arange((n - 1) * parts) / (rate * parts)
    h = 1.0 / (rate * parts)
    delay = machine["input_delay"]
    if record["hold"]:
        acting = shaped(machine, u)
        if machine["hysteresis"] != 0.0:
            acting = acting + machine["hysteresis"] * bouc_wen(u, machine["hysteresis_width"])
        if delay == 0.0:
            return np.repeat(np.repeat(acting[:-1], parts)[:, None], 3, axis=1)
        # The mean over each step of the delayed stairs; nothing acts before the record.
        total = np.concatenate([[0.0], np.cumsum(acting) / rate])
        times = np.arange(n + 1) / rate
        mean = (np.interp(begin + h - delay, times, total) - np.interp(begin - delay, times, total)) / h
        return np.repeat(mean[:, None], 3, axis=1)
    times = np.arange(n) / rate
    columns = [shaped(machine, np.interp(begin + k * h / 2 - delay, times, u)) for k in range(3)]
    return np.stack(columns, axis=1)


def simulate(machine, record, parts):
    """States on the fine grid, `parts` steps a sample.

    A record may have `factors` of the machine's numbers, and courses (one value a sample) of a random torque, of bumps and of
    a brake.
    """
    machine = machine | {key: machine[key] * factor for key, factor in record.get("factors", {}).items()}
    inputs = fine_inputs(machine, record, parts)
    samples = len(record["input"])
    nothing = np.zeros(samples)
    torque = machine["random_torque"] * record.get("random_torque", nothing)
    torque = torque + machine["bump"] * record.get("bump", nothing)
    extra = np.repeat(torque[:-1], parts)
    level = np.full(len(inputs), machine["coulomb"])
    if machine["fade"] > 0.0:
        level = level * np.exp(-(np.arange(len(level)) + 0.5) / (parts * record["rate"] * machine["fade"]))
    level = level + machine["friction_per_input"] * np.abs(inputs[:, 1])
    level = level + machine["brake"] * np.repeat(record.get("brake", nothing)[:-1], parts)
    numbers = np.array([machine[key] for key in BODY_KEYS])
    speed = record["speed"]
    start = np.array([0.0, speed, 0.0, speed, 0.0, 0.0])
    return integrate(numbers, start, 1.0 / (record["rate"] * parts), inputs, extra, level)


def read(sensor, states, parts, rate):
    """What a sensor shows at the samples, without noise."""
    column = 2 * sensor["body"] + (1 if sensor["kind"] == "speed" else 0)
    angle, speed = states[:, 2 * sensor["body"]], states[:, 2 * sensor["body"] + 1]
    y = states[:, column]
    if sensor["encoder_error"] != 0.0:
        n, turn = sensor["encoder_order"], sensor["encoder_order"] * angle + sensor["encoder_phase"]
        wave = n * speed * np.cos(turn) if sensor["kind"] == "speed" else np.sin(turn)
        y = y + sensor["encoder_error"] * wave
    times = np.arange(len(y)) / (rate * parts)
    if sensor["low_pass"] > 0.0:
        y = low_passed(y, sensor["low_pass"] * rate * parts)
    if sensor["latency"] > 0.0:
        y = np.interp(times - sensor["latency"], times, y)
    y, times = y[::parts], times[::parts]
    y = (1.0 + sensor["gain_error"]) * y + sensor["offset"] + sensor["drift"] * times
    if sensor["quantisation"] > 0.0:
        y = np.round(y / sensor["quantisation"]) * sensor["quantisation"]
    return y


@njit(cache=True)
def low_passed(y, steps):
    """First-order filter with a time constant of so many steps, exact for straight lines between them."""
    out = np.empty(len(y))
    out[0] = y[0]
    decay = math.exp(-1.0 / steps)
    for i in range(1, len(y)):
        slope = y[i] - y[i - 1]
        out[i] = y[i] - slope * steps + (out[i - 1] - y[i - 1] + slope * steps) * decay
    return out


def channels(machine, sensors, record, parts):
    """The noise-free channels of a record, one row a sensor."""
    states = simulate(machine, record, parts)
    return np.stack([read(sensor, states, parts, record["rate"]) for sensor in sensors])
