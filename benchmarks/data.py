"""The data of the timings S (steam chamber), T (pendubot torque), P (loop tuning) and D (motor): made once, then kept
in the cache.

Everything is synthetic, from fixed seeds; `steam()` takes about half a minute the first time.
"""

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np
from scipy.integrate import solve_ivp

from plantfit.folders import cache_folder

VERSION = 1  # part of the file names; raise it when anything below changes


@dataclass(frozen=True)
class Steam:
    """Ten step responses from rest. One opening has 31 parameters: k[10], A1[10], A2[10] over `nodes`, then Td.

    truth (10, 31); nodes (10,) bar; opening (10,) %; samples (10,) counts; period () s; clean and y (10, 4500) bar,
    NaN after the end of a record, sample j at period * (j + 1); lower and upper (31,).
    """

    truth: np.ndarray
    nodes: np.ndarray
    opening: np.ndarray
    samples: np.ndarray
    period: np.ndarray
    clean: np.ndarray
    y: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def draw(self, count: int, seed: int) -> np.ndarray:
        """Parameter vectors (count, 310), even over the box."""
        u = np.random.default_rng(seed).uniform(size=(count, *self.truth.shape))
        return (self.lower + (self.upper - self.lower) * u).reshape(count, -1)


@dataclass(frozen=True)
class Torque:
    """Motion of a two-link arm and the torque at its first joint.

    t (20000,) s; q, velocity, acceleration (2, 20000) rad; regressor (20000, 5); base (5,); truth, lower, upper (6,) =
    m1, lc1, I1, m2, lc2, I2; torque (20000,) N m with noise of 0.015.
    """

    t: np.ndarray
    q: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    regressor: np.ndarray
    base: np.ndarray
    truth: np.ndarray
    torque: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


@dataclass(frozen=True)
class Loop:
    """Constants of the speed loop: motor (5,) = R, L, K, B, J; period s; steps; set_point rad/s; box of the PID
    gains (3,)."""

    motor: np.ndarray
    period: np.ndarray
    steps: np.ndarray
    set_point: np.ndarray
    counts: np.ndarray
    volts: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


@dataclass(frozen=True)
class Motor:
    """A motor under a voltage held for 0.1 s: speed[j] at t[j], the end of the interval in which voltage[j] acts.

    t, voltage, clean, speed (1500,) in s, V, rad/s, rad/s; truth (6,) = R, L, K, B, J, Tf.
    """

    t: np.ndarray
    voltage: np.ndarray
    clean: np.ndarray
    speed: np.ndarray
    truth: np.ndarray


Data = TypeVar("Data", Steam, Torque, Loop, Motor)


def steam() -> Steam:
    """Workload S: 24 400 samples, noise of 0.05 bar."""
    return _kept(Steam, _make_steam)


def torque() -> Torque:
    """Workload T."""
    return _kept(Torque, _make_torque)


def loop() -> Loop:
    """Workload P."""
    motor_values = np.array([2.76, 0.0112, 0.005, 1.13e-6, 2.27e-8])
    numbers = (np.array(v) for v in (1e-3, 1000, 300.0, 255, 12.0))
    return Loop(motor_values, *numbers, lower=np.zeros(3), upper=np.array([50.0, 50.0, 1.0]))


def motor() -> Motor:
    """Workload D: noise of 0.5 rad/s."""
    return _kept(Motor, _make_motor)


def _kept(kind: type[Data], make: Callable[[], Data]) -> Data:
    folder = cache_folder() / "benchmarks"
    file = folder / f"{kind.__name__.lower()}-{VERSION}.npz"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        made = make()
        with tempfile.NamedTemporaryFile(dir=folder, suffix=".npz", delete=False) as part:
            np.savez_compressed(part, **vars(made))
        os.replace(part.name, file)  # whole or not at all, whoever else is making it
    with np.load(file) as stored:
        return kind(**{f.name: stored[f.name] for f in fields(kind)})


def _make_steam() -> Steam:
    nodes, period, opening = np.linspace(0, 20, 10), 0.1, np.arange(10, 101, 10.0)
    samples = np.rint(np.array([450, 400, 350, 300, 250, 200, 160, 130, 110, 90]) / period).astype(int)
    rank = np.arange(10.0)[:, None]
    gain = 0.15 + 0.03 * np.exp(-nodes / 10) + 0.002 * rank
    damping = 20 + 1.5 * rank + 1.5 * nodes
    inertia = 30 + 2 * nodes + rank
    truth = np.hstack([gain, damping, inertia, 0.25 + 0.05 * rank])
    clean = np.full((10, samples.max()), np.nan)
    for i, n in enumerate(samples):
        clean[i, :n] = steam_response(truth[i], opening[i], period * np.arange(1, n + 1), nodes)
    y = clean + np.random.default_rng(1).normal(0, 0.05, clean.shape)
    lower, upper = np.r_[np.full(31, 0.1)], np.r_[np.full(10, 1.5), np.full(20, 160.0), 1.0]
    return Steam(truth, nodes, opening, samples, np.array(period), clean, y, lower, upper)


def steam_response(row: np.ndarray, opening: float, t: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Pressure (n,) at times t (n,) by scipy's Radau at rtol 1e-9, begun at the delayed edge; row (31,) of one
    opening."""
    k, a1, a2, delay = row[:10], row[10:20], row[20:30], row[30]

    def rate(_, x):
        y = min(max(x[0], 0.0), 20.0)
        return [
            x[1],
            (np.interp(y, nodes, k) * opening - x[0] - np.interp(y, nodes, a1) * x[1]) / np.interp(y, nodes, a2),
        ]

    on, y = t > delay, np.zeros(t.shape)
    if on.any():
        y[on] = solve_ivp(rate, (delay, t[-1]), [0, 0], "Radau", t_eval=t[on], rtol=1e-9, atol=1e-11, max_step=1.0).y[0]
    return y


def _make_torque() -> Torque:
    t = 1e-3 * np.arange(20_000)
    q1, v1, a1 = _sines(t, np.pi / 2, [(0.5, 1.0, 0.0), (0.2, 2.3, 0.0)])
    q2, v2, a2 = _sines(t, 0.0, [(0.6, 1.7, 0.3)])
    truth = np.array([0.21, 0.12, 0.00053, 0.1, 0.15, 0.00077])
    m1, lc1, i1, m2, lc2, i2 = truth
    l1, g = 0.15, 9.81
    coupling = (2 * a1 + a2) * np.cos(q2) - np.sin(q2) * (2 * v1 * v2 + v2**2)
    regressor = np.stack([a1, a1 + a2, coupling, g * np.cos(q1), g * np.cos(q1 + q2)], 1)
    base = np.array([m1 * lc1**2 + m2 * l1**2 + i1, m2 * lc2**2 + i2, m2 * l1 * lc2, m1 * lc1 + m2 * l1, m2 * lc2])
    measured = regressor @ base + np.random.default_rng(2).normal(0, 0.015, t.size)
    lower = np.array([0.001, 0.001, 0.0001, 0.001, 0.001, 0.0001])
    upper = np.array([0.4, 0.15, 0.001, 0.4, 0.3, 0.001])
    return Torque(
        t, np.stack([q1, q2]), np.stack([v1, v2]), np.stack([a1, a2]), regressor, base, truth, measured, lower, upper
    )


def _sines(
    t: np.ndarray, offset: float, waves: list[tuple[float, float, float]]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Offset plus (amplitude, rad/s, phase) sines with their first and second derivatives."""
    q, v, a = np.full(t.shape, offset), np.zeros(t.shape), np.zeros(t.shape)
    for amplitude, w, phase in waves:
        q += amplitude * np.sin(w * t + phase)
        v += amplitude * w * np.cos(w * t + phase)
        a -= amplitude * w * w * np.sin(w * t + phase)
    return q, v, a


def _make_motor() -> Motor:
    truth = np.array([2.76, 0.0112, 0.005, 1.13e-6, 2.27e-8, 2e-4])
    r, ind, k, b, j, friction = truth
    start = 0.1 * np.arange(1500)
    sine, square = 12 * np.sin(2 * np.pi * 0.2 * start), 9 * np.sign(np.sin(2 * np.pi * 0.5 * start + 0.1))
    voltage = np.where((start // 10).astype(int) % 2 == 0, sine, square)
    x, speed = np.zeros(2), np.zeros(start.size)
    for sample, v in enumerate(voltage):

        def rate(_, x, v=v):
            return [(v - r * x[0] - k * x[1]) / ind, (k * x[0] - b * x[1] - friction * np.tanh(x[1] / 0.01)) / j]

        x = solve_ivp(rate, (0, 0.1), x, "Radau", rtol=1e-8, atol=1e-8).y[:, -1]
        speed[sample] = x[1]
    return Motor(start + 0.1, voltage, speed, speed + np.random.default_rng(4).normal(0, 0.5, start.size), truth)
