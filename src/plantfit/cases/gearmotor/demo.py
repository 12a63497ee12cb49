"""Fit the first half of the PRBS record, score the second, predict the static curve; then fit both together."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.cases.gearmotor.joint import SETTLING, joint_figures, joint_sentence
from plantfit.cases.gearmotor.steady import steady_speed
from plantfit.cases.shared.files import unpack
from plantfit.cases.shared.fitting import fit_file, part, residual, rms
from plantfit.cases.shared.record import figure, record
from plantfit.fitting import Answer
from plantfit.recording import read

LINEAR = "first-order model with dead time about the mean, same halves"


def run(folder: str | Path, progress: Callable[[Any], None] | None = None) -> dict[str, Any]:
    """See `plantfit.cases.shared.registry.demos`."""
    file = unpack("gearmotor", folder) / "gearmotor.toml"
    both = file.with_name("static_and_prbs.toml")
    answer, joint = fit_file(file, progress), fit_file(both, progress)
    error, seen, unseen = residual(answer, "y"), part(answer, "fit"), part(answer, "validation")
    settled = unseen & (answer.problem.experiments["prbs"].recording.t >= _start(answer, unseen) + SETTLING)
    low, high = _range(answer)
    static = static_curve(Path(folder) / "static.csv", answer.values, low, high)
    figures = [
        figure("RMSE on the fitted half", rms(error[seen]), "deg/s", 5.06, LINEAR),
        figure("RMSE on the unseen half, after 3 s, mean error removed", float(np.std(error[settled])), "deg/s", 5.38, LINEAR),
        figure("RMSE on the unseen half, nothing removed", rms(error[unseen]), "deg/s"),
        figure("mean error on the unseen half after 3 s", float(np.mean(error[settled])), "deg/s"),
        *static,
        *joint_figures(joint),
    ]
    sentences = [
        "The state runs on into the unseen half; the score there leaves out 3 s and the mean error, as the reference does.",
        (
            f"The mean error there, {np.mean(error[settled]):.1f} deg/s simulated minus measured, is a drift that "
            "constant parameters do not follow."
        ),
        f"The record holds only {low:.2f} to {high:.2f} V; the static curve up to 5 V is an extrapolation with the same parameters.",
        joint_sentence(joint),
    ]
    return record("gearmotor", "Geared DC motor on a PRBS", figures, sentences, [answer, joint], [file, both])


def static_curve(path: Path, values: dict[str, float], low: float, high: float) -> list[dict[str, Any]]:
    """How well the fitted parameters predict the measured static curve; `low` to `high` V is what the fit has seen."""
    curve = read(path, period=1.0, signals={"u": "u", "y": "y"}, units={"u": "V", "y": "deg/s"})
    u, y = curve["u"], curve["y"]
    predicted = steady_speed(u, values)
    moving = u[(u > 0) & (y > 0)]
    at_top, inside = u == u.max(), (u >= low) & (u <= high)
    return [
        figure("static curve inside the range of the record, RMSE of the prediction", rms(predicted[inside] - y[inside]), "deg/s"),
        figure(
            "static curve, -5 to 5 V, RMSE of the prediction", rms(predicted - y), "deg/s", float(np.std(y)), "spread of the curve itself"
        ),
        figure("static speed at 5 V, predicted", float(predicted[at_top][0]), "deg/s", float(y[at_top][0]), "measured static curve"),
        figure("dead zone, predicted edge", values["threshold"], "V", float(moving.min()), "lowest positive voltage that turned the motor"),
    ]


def _start(answer: Answer, mask: np.ndarray) -> float:
    return float(answer.problem.experiments["prbs"].recording.t[mask][0])


def _range(answer: Answer) -> tuple[float, float]:
    u = answer.problem.experiments["prbs"].recording["u"]
    return float(u.min()), float(u.max())
