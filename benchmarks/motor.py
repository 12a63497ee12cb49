"""A motor with friction under a voltage held for 100 ms, 1500 samples, through `Problem`: against scipy and C."""

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.integrate import odeint, solve_ivp

import plantfit.runtime  # noqa: F401
from benchmarks import data
from benchmarks.c_twins import c_twin
from benchmarks.steam.compiler import extension
from benchmarks.steam.interleaved import interleaved
from plantfit.models.text.equations import equations
from plantfit.problem import Problem
from plantfit.problem.accuracy.steps import choose_substeps, refined_at
from plantfit.recording.record import Recording, Signal
from plantfit.simulate.simulator import ADAPTIVE
from plantfit.space import Parameter

import jax
import jax.numpy as jnp

NAMES = ("R", "L", "K", "B", "J", "Tf")
WIDTH = 0.01  # rad/s over which friction changes sign
POPULATION = 70
PERIOD = 0.1  # s
EVEN_TWIN = 1024  # equal steps of the C twin beside adaptive ones
RTOL = 1e-2  # of scipy; the columns of errors tell what each reaches
EQUATIONS = f"i' = (V - R*i - K*w)/L\nw' = (K*i - B*w - Tf*tanh(w/{WIDTH}))/J"


class Row(NamedTuple):
    """One line of the table: a call, how many of them the population takes, and speed errors at the truth in rad/s."""

    call: Callable[[], object]
    calls: float
    error: np.ndarray


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures."""
    task = data.motor()
    coarse = choose_substeps(_problem(task))
    values: dict[str, float] = dict(zip(NAMES, map(float, task.truth), strict=True))
    truth = coarse.space.cube(coarse.space.vector(values))
    batch = np.random.default_rng(11).uniform(size=(POPULATION, 6))
    rows: dict[str, Row] = {}
    figures: dict[str, float] = {}
    pairs: dict[str, tuple[str, str]] = {}  # names of the rows whose times are compared
    answer = refined_at(coarse, truth)
    stepping = answer.predictor.stepping()
    between = answer.with_simulator(dataclasses.replace(stepping, substeps=stepping.substeps + 1))
    finer = answer.with_simulator(stepping.refined(2))
    for stage, problem in (("search", coarse), ("answer", answer), ("between", between), ("finer", finer)):
        simulator = problem.predictor.stepping()
        even = simulator.stepper != ADAPTIVE
        substeps = simulator.substeps if even else EVEN_TWIN
        ours = (
            f"plantfit, {substeps} substeps ({stage})"
            if even
            else f"plantfit, adaptive, fineness {simulator.substeps} ({stage})"
        )
        # the record also has the start, free of error
        costs = np.asarray(problem.costs(batch)) * (len(task.t) + 1) / len(task.t)
        error = problem.predict(problem.space.physical(truth))["w"][1:] - task.clean
        rows[ours] = Row(lambda problem=problem: problem.costs(jnp.asarray(batch)), 1.0, error)
        figures[f"motor_substeps_{stage}"] = float(simulator.substeps)
        theirs, name = _twin(task, substeps), f"C, {substeps} substeps"
        if theirs is not None:
            candidates = np.asarray(jax.vmap(problem.space.physical)(jnp.asarray(batch)))
            if name not in rows:
                _, track = theirs(np.array(task.truth, dtype=float)[None, :])
                rows[name] = Row(
                    lambda theirs=theirs, candidates=candidates: theirs(candidates), 1.0, track - task.clean
                )
            pairs[f"motor_speed_over_c_twin_{stage}"] = (name, ours)
            if even:  # else the two have errors of their own
                figures[f"motor_disagreement_{stage}"] = float(np.max(np.abs(costs / theirs(candidates)[0] - 1.0)))
        pairs[f"motor_per_s_{stage}"] = ("", ours)
    part = 40 if quick else 150
    rivals = {f"scipy {m}": (_scipy(task, values, m, part), part) for m in ("Radau", "LSODA")}
    compiled = _compiled_lsoda(task, values)
    if compiled is not None:
        rivals["scipy LSODA, rate in C"] = (compiled, len(task.t))
    for name, (simulate, samples) in rivals.items():
        rows[name] = Row(simulate, POPULATION * len(task.t) / samples, simulate() - task.clean[:samples])
        key = name.removeprefix("scipy ").lower().replace(", rate in ", "_")
        for stage, (_, ours) in [(s, pairs[f"motor_per_s_{s}"]) for s in ("between", "finer")]:
            pairs[f"motor_scipy_{key}_over_plantfit_{stage}"] = (name, ours)
    timings = interleaved({name: row.call for name, row in rows.items()}, 3 if quick else 7)
    seconds = {name: timings[name].cpu * row.calls for name, row in rows.items()}
    for key, (over, under) in pairs.items():
        figures[key] = seconds[over] / seconds[under] if over else POPULATION / seconds[under]
    print(
        f"{len(task.t)} samples of {PERIOD:g} s, {POPULATION} candidates; seconds of this process. scipy: rtol "
        f"{RTOL:g}, {part} samples of "
        "one candidate, scaled up (with the rate in C all of one)"
    )
    print(f"{'':42}{'median':>14}{'candidates/s':>15}{'rms error':>14}{'worst':>14}")
    for name, row in rows.items():
        rms, worst = np.sqrt(np.mean(row.error**2)), np.max(np.abs(row.error))
        print(
            f"{name:42}{1000 * seconds[name]:11.1f} "
            f"ms{POPULATION / seconds[name]:15.1f}{rms:8.1e} rad/s{worst:8.1e} rad/s"
        )
    return figures


def _twin(task: data.Motor, substeps: int) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None:
    """Candidates (n, 6) to mean squared errors (n,) and the speeds (1500,) of the first, in C; None without a
    compiler."""
    c_costs = c_twin("motor", "motor_costs")
    if c_costs is None:
        return None
    voltage, speed = np.ascontiguousarray(task.voltage), np.ascontiguousarray(task.speed)

    def costs(candidates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found, track = np.empty(len(candidates)), np.empty(len(speed))
        columns = np.ascontiguousarray(candidates.T)
        c_costs(len(candidates), len(speed), substeps, PERIOD, WIDTH, columns, voltage, speed, found, track)
        return found, track

    return costs


def _problem(task: data.Motor) -> Problem:
    model = equations(
        EQUATIONS, inputs=["V"], states=["i", "w"], outputs=["w"], parameters=dict.fromkeys(NAMES), name="motor"
    )
    signals = {"V": Signal(np.r_[task.voltage, task.voltage[-1]]), "w": Signal(np.r_[0.0, task.speed])}
    box = {n: Parameter((0.5 * v, 2.0 * v), scale="log") for n, v in zip(NAMES, map(float, task.truth), strict=True)}
    return Problem(model, Recording(np.r_[0.0, task.t], signals), box)


def _scipy(task: data.Motor, p: dict[str, float], method: str, samples: int) -> Callable[[], np.ndarray]:
    """Speeds (samples,) in plain floats with the exact Jacobian, begun anew at every change of the voltage."""
    r, inductance, k, b, j, friction = (p[n] for n in NAMES)

    def jacobian(t, x):
        slope = friction * (1.0 - np.tanh(x[1] / WIDTH) ** 2) / WIDTH
        return [[-r / inductance, -k / inductance], [k / j, (-b - slope) / j]]

    def run() -> np.ndarray:
        x, speeds = np.zeros(2), np.empty(samples)
        for n in range(samples):
            v = float(task.voltage[n])

            def rate(t, x, v=v):
                return [
                    (v - r * x[0] - k * x[1]) / inductance,
                    (k * x[0] - b * x[1] - friction * np.tanh(x[1] / WIDTH)) / j,
                ]

            x = solve_ivp(rate, (0.0, PERIOD), x, method, rtol=RTOL, atol=RTOL, jac=jacobian).y[:, -1]
            speeds[n] = x[1]
        return speeds

    return run


def _compiled_lsoda(task: data.Motor, p: dict[str, float]) -> Callable[[], np.ndarray] | None:
    """The same by odeint over rate and Jacobian written in C; None without a compiler or without Python's headers."""
    compiled = extension(Path(__file__).with_name("motor_rate.c"))
    if compiled is None:
        print("SKIPPED LSODA with the rate in C: no C compiler (gcc), or no headers of Python")
        return None
    numbers = np.array([*(p[n] for n in NAMES), WIDTH, 0.0])
    rate, jacobian = compiled.rate(numbers, np.empty(2)), compiled.jacobian(numbers, np.empty((2, 2)))
    ends = np.array([0.0, PERIOD])

    def run() -> np.ndarray:
        x, speeds = np.zeros(2), np.empty(len(task.voltage))
        for n, numbers[7] in enumerate(task.voltage):
            x = odeint(rate, x, ends, Dfun=jacobian, rtol=RTOL, atol=RTOL)[1]
            speeds[n] = x[1]
        return speeds

    return run


if __name__ == "__main__":
    run("--quick" in sys.argv[1:])
