"""Mass and friction of the drive by Kalman filters and maximum likelihood, beside the regression of force."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.estimate import FilterRun, MaximumLikelihood, Noise, ekf, maximum_likelihood, nis_test, ukf
from plantfit.fitting import Answer
from plantfit.problem import Problem
from plantfit.recording import Recording, Signal
from plantfit.report.figures.pages.constants import constants_figure

CONSTANTS = ("M", "Fv", "Fc", "offset")
EVERY = 10  # samples between the outputs that are used, as in the regression
NOISE = Noise({"v": 1e-6}, {"u": (1e-3, 1.0)}, {"q": 1e-4, "v": 0.02})


@dataclass(frozen=True)
class Estimates:
    """The likelihood's answer, both joint filters with its noise, and intervals (low, value, high) by method and
    constant."""

    likelihood: MaximumLikelihood
    extended: FilterRun
    unscented: FilterRun
    intervals: dict[str, dict[str, tuple[float, float, float]]]


def estimate(closed: Answer, force: Answer) -> Estimates:
    """From the closed loop of `closed`, where errors of the model enter as force and so as controller output, as in the
    regression.

    The loop is stepped at every sample of its reference and scored at every tenth, all of the record, as the regression
    does.
    """
    problem = closed.problem
    recording = next(iter(problem.experiments.values())).recording
    u = np.where(np.arange(len(recording)) % EVERY == 0, recording["u"], np.nan)
    signals = {"reference": recording.signals["reference"], "u": Signal(u, "V")}
    boxes: dict[str, Any] = {n: (c.lower, c.upper) for n in CONSTANTS for c in problem.space.coordinates if c.name == n}
    held = {n: float(p.value) for n, p in problem.space.parameters.items() if p.value is not None}
    start = {"q_start": float(recording["reference"][0]), "v_start": 0.0}
    loop = Problem(
        problem.model, Recording(recording.t, signals, "emps"), boxes | held | start, hold={"reference": "linear"}
    )
    found = maximum_likelihood(loop, NOISE, budget=100)
    runs = [kind(loop, found.noise, CONSTANTS).run() for kind in (ekf, ukf)]
    se = 1.959963984540054 * np.array([force_error(force, n) for n in CONSTANTS])
    regression = {
        n: (force.values[n] - s, force.values[n], force.values[n] + s) for n, s in zip(CONSTANTS, se, strict=True)
    }
    likelihood = {n: (found.interval[n][0], found.parameters[n], found.interval[n][1]) for n in CONSTANTS}
    filters = [{n: (r.interval[n][0], r.estimate.named[n], r.interval[n][1]) for n in CONSTANTS} for r in runs]
    names = ("force regression", "maximum likelihood", "extended Kalman filter", "unscented Kalman filter")
    return Estimates(found, runs[0], runs[1], dict(zip(names, (regression, likelihood, *filters), strict=True)))


def force_error(force: Answer, name: str) -> float:
    """Standard error of a parameter in an answer's findings."""
    return next(float(p["standard_error"]) for p in force.findings["parameters"] if p["name"] == name)


def apart(estimates: Estimates) -> list[str]:
    """Pairs of methods and constants whose 95 % intervals do not meet, a sentence each."""
    found, methods = [], list(estimates.intervals)
    for i, a in enumerate(methods):
        for b in methods[i + 1 :]:
            for n in CONSTANTS:
                (low, _, high), (other_low, _, other_high) = estimates.intervals[a][n], estimates.intervals[b][n]
                if low > other_high or other_low > high:
                    found.append(f"{n}: {a} {low:.4g} to {high:.4g}, {b} {other_low:.4g} to {other_high:.4g}.")
    return found


def section(estimates: Estimates, units: dict[str, str]) -> dict[str, Any]:
    """A section of the case's page: intervals side by side, how the constants settle, whether the filter is as sure
    as it should be."""
    rows = []
    for method, own in estimates.intervals.items():
        cells = [f"{v:.4g} ({low:.4g} to {high:.4g})" for low, v, high in (own[n] for n in CONSTANTS)]
        rows.append([method, *cells])
    apart_now = apart(estimates)
    white = estimates.extended.told["white"][estimates.extended.rank, 0][estimates.extended.measured > 0]
    memory = float(np.corrcoef(white[1:], white[:-1])[0, 1])
    sentences = [
        "All intervals meet." if not apart_now else "Intervals that do not meet: " + " ".join(apart_now),
        nis_test(estimates.extended).sentence,
        f"Neighbouring innovations are correlated ({memory:.2f}): the model's error is not white. "
        "The likelihood's and the regression's intervals allow for it, those of the filters do not.",
    ]
    reference = {n: (v, low, high) for n, (low, v, high) in estimates.intervals["force regression"].items()}
    figure = constants_figure([estimates.extended.track(n) for n in CONSTANTS], reference, "force regression, 95 %")
    table = {
        "caption": "95 % intervals",
        "columns": ["method", *(f"{n} [{units[n]}]" for n in CONSTANTS)],
        "rows": rows,
    }
    label = "the constants in the extended Kalman filter over time, with two standard deviations"
    return {
        "title": "Kalman filters and maximum likelihood",
        "sentences": sentences,
        "tables": [table],
        "figures": [{"figure": figure, "label": label}],
    }
