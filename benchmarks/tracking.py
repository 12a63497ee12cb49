"""How often `plantfit track` raises a false alarm, and how soon it sees a parameter change: python -m
benchmarks.tracking

Three plants with known truth, simulated outside plantfit: the motor of a small robot with current and speed measured
(linear, by exact discretisation), a tank that empties by Torricelli (nonlinear, by Euler-Maruyama in 50 steps a sample)
and a heater with a dead time of 6.6 samples (by exact discretisation between the edges of its late input), all with
process noise. A study of one record finds parameters and levels; then new records of the same plant are tracked. A
false alarm is any alarm over a whole record of a healthy plant, five times as long as the study's. A change happens
after a fifth of such a record.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import expm

from plantfit import Problem, Recording, equations, from_arrays
from plantfit.tracking import Tracker, track

INPUTS = ("telegraph", "white", "coloured")
LONGER, AFTER = 5, 0.2
SIZES = (0.1, 0.2, 0.3)


@dataclass(frozen=True)
class Plant:
    """A plant with known truth: `record(rng, n, input, truth, after)` simulates, `truth` holds from sample `after`
    on."""

    name: str
    truth: dict[str, float]
    samples: int
    problem: Callable[[Recording], Problem]
    record: Callable[..., Recording]


def excitation(rng: np.random.Generator, n: int, kind: str, low: float, high: float, hold: int) -> np.ndarray:
    """An input between two levels: a random telegraph, a new level at every sample, or white noise through a slow
    first-order filter."""
    if kind == "telegraph":
        return np.where(rng.random(n // hold + 1) < 0.5, low, high).repeat(hold)[:n]
    if kind == "white":
        return rng.uniform(low, high, n)
    slow, x = np.exp(-1.0 / (2 * hold)), np.empty(n)
    x[0] = rng.standard_normal()
    for k, e in enumerate(rng.standard_normal(n - 1) * np.sqrt(1 - slow**2)):
        x[k + 1] = slow * x[k] + e
    return low + (high - low) * np.clip(0.5 + 0.3 * x, 0.0, 1.0)


MOTOR = {"Ra": 2.759854, "La": 1.118658e-2, "kw": 5.008705e-3, "B": 1.13284e-6, "J": 2.2748e-8}


def _motor_step(p: dict[str, float], h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    a = np.array([[-p["Ra"] / p["La"], -p["kw"] / p["La"]], [p["kw"] / p["J"], -p["B"] / p["J"]]])
    d = np.diag([1.0**2, 300.0**2])
    big = expm(h * np.block([[-a, d], [np.zeros((2, 2)), a.T]]))
    f = big[2:, 2:].T
    q = f @ big[:2, 2:]
    return f, np.linalg.solve(a, (f - np.eye(2)) @ np.array([1.0 / p["La"], 0.0])), np.linalg.cholesky(0.5 * (q + q.T))


def motor_record(
    rng: np.random.Generator, n: int, kind: str, then: dict[str, float] | None = None, after: int = 0
) -> Recording:
    """Current and speed under a voltage of 0 to 3 V, 1 kHz; parameters `then` from sample `after` on."""
    h, x, y = 1e-3, np.array([0.1, 10.0]) * rng.standard_normal(2), np.empty((n, 2))
    voltage = excitation(rng, n, kind, 0.0, 3.0, 20)
    now, later = _motor_step(MOTOR, h), _motor_step(then or MOTOR, h)
    push = rng.standard_normal((n, 2))
    for k in range(n):
        y[k] = x
        f, b, root = later if then is not None and k >= after else now
        x = f @ x + b * voltage[k] + root @ push[k]
    y += rng.standard_normal(y.shape) * [0.01, 2.0]
    return from_arrays(
        h * np.arange(n), signals={"V": (voltage, "V"), "i": (y[:, 0], "A"), "w": (y[:, 1], "rad/s")}, name="run"
    )


def motor_problem(recording: Recording) -> Problem:
    """The motor with boxes that are not centred at the truth."""
    units = {"Ra": "ohm", "La": "H", "kw": "V*s/rad", "B": "N*m*s/rad", "J": "kg*m^2"}
    model = equations(
        "i' = (V - Ra*i - kw*w)/La\nw' = (kw*i - B*w)/J",
        name="motor",
        inputs={"V": "V"},
        states={"i": "A", "w": "rad/s"},
        outputs={"i": "A", "w": "rad/s"},
        parameters={n: {"unit": units[n], "bounds": (v / 3.1, v * 2.3), "scale": "log"} for n, v in MOTOR.items()},
    )
    return Problem(model, recording)


TANK = {"k": 0.5, "area": 2.0}


def tank_record(
    rng: np.random.Generator, n: int, kind: str, then: dict[str, float] | None = None, after: int = 0
) -> Recording:
    """The level under an inflow of 0.2 to 0.9 m^3/s, a sample every 0.5 s."""
    h, fine, x = 0.5, 50, 1.0 + 0.1 * rng.standard_normal()
    flow, level = excitation(rng, n, kind, 0.2, 0.9, 15), np.empty(n)
    push = rng.standard_normal((n, fine)) * 0.02 * np.sqrt(h / fine)
    for k in range(n):
        level[k] = x
        p = then if then is not None and k >= after else TANK
        for e in push[k]:
            x = max(x + h / fine * (flow[k] - p["k"] * np.sqrt(x)) / p["area"] + e, 1e-3)
    signals = {"flow": (flow, "m^3/s"), "level": (level + 0.05 * rng.standard_normal(n), "m")}
    return from_arrays(period=h, signals=signals, name="run")


def tank_problem(recording: Recording) -> Problem:
    """The tank, its boxes not centred at the truth."""
    model = equations(
        "level' = (flow - k*sqrt(level))/area",
        name="tank",
        inputs={"flow": "m^3/s"},
        states={"level": {"unit": "m", "initial": 1.0}},
        outputs={"level": "m"},
        parameters={"k": {"bounds": (0.1, 1.5)}, "area": {"unit": "m^2", "bounds": (0.5, 8.0), "scale": "log"}},
    )
    return Problem(model, recording)


HEATER = {"K": 0.8, "tau": 12.0, "L": 3.3}


def heater_record(
    rng: np.random.Generator, n: int, kind: str, then: dict[str, float] | None = None, after: int = 0
) -> Recording:
    """The rise of temperature under 0 to 100 % of power, a sample every 0.5 s."""
    h, x, y = 0.5, 40.0 + 5.0 * rng.standard_normal(), np.empty(n)
    power = excitation(rng, n, kind, 0.0, 100.0, 15)
    push = rng.standard_normal(n)
    for k in range(n):
        y[k] = x
        p = then if then is not None and k >= after else HEATER
        whole, share = divmod(p["L"] / h, 1.0)
        old, new = power[max(k - int(whole) - 1, 0)], power[max(k - int(whole), 0)]
        f, edge = np.exp(-h / p["tau"]), np.exp(-h * (1.0 - share) / p["tau"])
        x = (
            f * x
            + p["K"] * ((edge - f) * old + (1.0 - edge) * new)
            + 0.3 * np.sqrt(0.5 * p["tau"] * (1.0 - f * f)) * push[k]
        )
    return from_arrays(period=h, signals={"u": (power, "%"), "T": (y + 0.1 * rng.standard_normal(n), "K")}, name="run")


def heater_problem(recording: Recording) -> Problem:
    """The heater, its boxes not centred at the truth."""
    model = equations(
        "T' = (K*delay(u, L) - T)/tau",
        name="heater",
        inputs={"u": "%"},
        states={"T": {"unit": "K", "initial": 40.0}},
        outputs={"T": "K"},
        parameters={
            "K": {"unit": "K/%", "bounds": (0.1, 9.0), "scale": "log"},
            "tau": {"unit": "s", "bounds": (2.0, 90.0), "scale": "log"},
            "L": {"unit": "s", "bounds": (0.0, 10.0)},
        },
    )
    return Problem(model, recording)


PLANTS = (
    Plant("motor", MOTOR, 1000, motor_problem, motor_record),
    Plant("tank", TANK, 600, tank_problem, tank_record),
    Plant("heater", HEATER, 600, heater_problem, heater_record),
)


def tracked(tracker: Tracker, recording: Recording) -> Tracker:
    """The tracker after a recording, begun anew."""
    tracker.restart()
    tracker.feed(recording)
    tracker.finish()
    return tracker


def false_alarms(plant: Plant, trackers: list[Tracker], records: int, kind: str, seed: int) -> int:
    """How many of so many healthy records raise an alarm; the studies take turns."""
    count = 0
    for k in range(records):
        rng = np.random.default_rng((seed, k))
        count += bool(tracked(trackers[k % len(trackers)], plant.record(rng, LONGER * plant.samples, kind)).alarms)
    return count


def delays(
    plant: Plant, trackers: list[Tracker], records: int, size: float, seed: int
) -> list[tuple[str, float | None, tuple[str, ...]]]:
    """For each record: the parameter that changed, seconds to the alarm (None: none, negative: before), the
    parameters that it named, of which the data at its end tell none apart."""
    found, names, n = [], list(plant.truth), LONGER * plant.samples
    for k in range(records):
        rng = np.random.default_rng((seed, k))
        name, sign = names[k % len(names)], 1 if (k // len(names)) % 2 == 0 else -1
        then = plant.truth | {name: plant.truth[name] * (1 + sign * size)}
        after = int(AFTER * n)
        recording = plant.record(rng, n, INPUTS[k % len(INPUTS)], then, after)
        tracker = tracked(trackers[k % len(trackers)], recording)
        alarm = tracker.alarms[0] if tracker.alarms else None
        found.append(
            (
                name,
                None if alarm is None else alarm.t - float(recording.t[after]),
                () if alarm is None or alarm.parameter is None else (alarm.parameter, *alarm.alike),
            )
        )
    return found


def main(words: list[str] | None = None) -> dict[str, Any]:
    """Print the tables of docs/kalman.md."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--studies", type=int, default=4)
    options.add_argument("--healthy", type=int, default=200)
    options.add_argument("--changed", type=int, default=120)
    options.add_argument("--alpha", type=float, default=0.01)
    options.add_argument("--plant", action="append", choices=[p.name for p in PLANTS])
    given = options.parse_args(words)
    told: dict[str, Any] = {}
    for plant in [p for p in PLANTS if not given.plant or p.name in given.plant]:
        trackers = []
        for s in range(given.studies):
            recording = plant.record(np.random.default_rng((7, s)), plant.samples, "telegraph")
            trackers.append(track(plant.problem(recording), false_alarm=given.alpha))
        own: dict[str, Any] = {"false": {}, "delay": {}}
        for kind in INPUTS:
            own["false"][kind] = false_alarms(plant, trackers, given.healthy, kind, 100)
            print(
                f"{plant.name}, {kind} input: {own['false'][kind]} of {given.healthy} healthy records raise an alarm",
                flush=True,
            )
        for size in SIZES:
            runs = delays(plant, trackers, given.changed, size, 200)
            own["delay"][str(size)] = runs
            early = sum(d is not None and d < 0 for _, d, _ in runs)
            for name in plant.truth:
                mine = [(d, named) for n, d, named in runs if n == name]
                seen = [d for d, _ in mine if d is not None and d >= 0]
                after = [named for d, named in mine if d is not None and d >= 0]
                alone, among = sum(n == (name,) for n in after), sum(name in n and len(n) > 1 for n in after)
                middle, late = (np.median(seen), np.quantile(seen, 0.9)) if seen else (np.nan, np.nan)
                print(
                    f"{plant.name}, {name} by {100 * size:.0f} %: {len(seen)} of {len(mine)} "
                    f"seen, delay {middle:.3g} s (90 %: {late:.3g} s), named alone {alone}, among others {among}, "
                    f"not {len(after) - alone - among}",
                    flush=True,
                )
            print(f"{plant.name}, {100 * size:.0f} %: {early} alarms before the change", flush=True)
        told[plant.name] = own
    return told


if __name__ == "__main__":
    main()
