"""Ways to the parameters of one drive: force regression, free run, closed loop; Kalman filters and maximum
likelihood."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.cases.emps import kalman
from plantfit.cases.shared.files import unpack
from plantfit.cases.shared.fitting import fit_file, part, residual, rms
from plantfit.cases.shared.record import figure, record
from plantfit.fitting import Answer

REGRESSED = {"M": 95.116, "Fv": 203.37, "Fc": 20.409, "offset": -3.170}
UNITS = {"M": "kg", "Fv": "N*s/m", "Fc": "N", "offset": "N"}
IDIM = "separate inverse dynamic regression, same record"


def run(folder: str | Path, progress: Callable[[Any], None] | None = None) -> dict[str, Any]:
    """See `plantfit.cases.shared.registry.demos`."""
    folder = unpack("emps", folder)
    files = [folder / name for name in ("force.toml", "free_run.toml", "closed_loop.toml")]
    force, free, closed = (fit_file(file, progress) for file in files)
    estimates = kalman.estimate(closed, force)
    figures = [*_regression(force), *_free_run(free, force), *_closed_loop(closed), *_kalman(estimates)]
    sentences = [
        "The plant is a pure integrator: in the free run every error of force adds up twice, so millimetres over 25 s "
        "are a hard test.",
        "In closed loop the position follows its reference whatever "
        "the model, so the controller output is what is scored.",
        "The controller gains are held at what the recorded controller law itself shows, 159.5 1/s and 266.8 V s/m.",
        "Force regression, free run and closed loop in turn give "
        + "; ".join(
            f"{n} {', '.join(f'{a.values[n]:.4g}' for a in (force, free, closed))} {UNITS[n]}" for n in REGRESSED
        )
        + ".",
        "Regression, maximum likelihood, extended and unscented Kalman filter agree within their 95 % intervals."
        if not (differ := kalman.apart(estimates))
        else "These 95 % intervals do not meet: " + " ".join(differ),
    ]
    sections = [kalman.section(estimates, UNITS)]
    return record("emps", "Linear drive with friction", figures, sentences, [force, free, closed], files, sections)


def _kalman(estimates: kalman.Estimates) -> list[dict[str, Any]]:
    short = {
        "maximum likelihood": "maximum likelihood",
        "extended Kalman filter": "EKF",
        "unscented Kalman filter": "UKF",
    }
    own = estimates.intervals
    return [
        figure(f"{short[m]}: {n}", own[m][n][1], UNITS[n], own["force regression"][n][1], "force regression above")
        for m in short
        for n in REGRESSED
    ]


def _regression(answer: Answer) -> list[dict[str, Any]]:
    error = residual(answer, "force")
    measured = answer.problem.experiments["emps"].recording["force"]
    return [
        *(figure(f"force regression: {n}", answer.values[n], UNITS[n], value, IDIM) for n, value in REGRESSED.items()),
        figure("force regression: residual", rms(error), "N", 2.16, IDIM),
        figure(
            "force regression: relative residual",
            100 * float(np.linalg.norm(error) / np.linalg.norm(measured)),
            "%",
            4.04,
            IDIM,
        ),
    ]


def _free_run(answer: Answer, force: Answer) -> list[dict[str, Any]]:
    error = 1e3 * residual(answer, "q")
    problem = answer.problem
    values = np.array([{**force.values, "v_start": 0.0}[n] for n in problem.space.names])
    regressed = 1e3 * (problem.predict(values)["q"] - problem.experiments["emps"].recording["q"])
    unseen = part(answer, "validation")
    here = "parameters of the force regression above, which saw all"
    return [
        figure("free run: position RMSE, whole record", rms(error), "mm", 5.09, f"simulated with {IDIM}"),
        figure(
            "free run: position RMSE, fitted three quarters", rms(error[~unseen]), "mm", rms(regressed[~unseen]), here
        ),
        figure("free run: position RMSE, unseen quarter", rms(error[unseen]), "mm", rms(regressed[unseen]), here),
    ]


def _closed_loop(answer: Answer) -> list[dict[str, Any]]:
    error, unseen = residual(answer, "u"), part(answer, "validation")
    measured = answer.problem.experiments["emps"].recording["u"]
    relative = 100 * float(np.linalg.norm(error[unseen]) / np.linalg.norm(measured[unseen]))
    return [
        figure("closed loop: controller output RMSE, fitted half", rms(error[~unseen]), "V"),
        figure("closed loop: controller output RMSE, unseen half", rms(error[unseen]), "V"),
        figure("closed loop: relative error, unseen half", relative, "%", 4.04, f"force residual, {IDIM}"),
    ]
