"""Angles of a run simulated from its torques over short windows, and the encoder zeros that its torques reveal."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit.cases.double_pendulum.fits.fit_law import predicted
from plantfit.cases.double_pendulum.fits.laws import PLAIN, Fitted, model_of
from plantfit.cases.double_pendulum.fits.runs import Run
from plantfit.cases.double_pendulum.reference import GEAR, L1, published, reference_torque
from plantfit.models.library.pendubot import pendubot
from plantfit.trust.validate.windows import Windows, simulate_windows

WINDOW = 0.5  # s


def published_law(name: str) -> Fitted:
    """Published parameters as a law."""
    values = published(name)
    return Fitted(PLAIN, PLAIN.grid[0], {n: values[n] for n in model_of(PLAIN, PLAIN.grid[0]).coefficients}, np.nan)


def simulated(fitted: Mapping[str, Fitted], runs: Mapping[str, Run]) -> dict[str, Windows]:
    """Windows of 0.5 s of every run, from its own parameters in `fitted`, each begun at the smoothed angles and
    rates."""
    made: dict[str, Windows] = {}
    for law, shape in dict.fromkeys((f.law, f.shape) for f in fitted.values()):
        names = [n for n, f in fitted.items() if (f.law, f.shape) == (law, shape)]
        options: dict[str, Any] = {law.shape: shape, "gear_ratio": GEAR, "sign": law.sign, "l1": L1}
        model = pendubot("base", "hanging", joints=(1, 2), friction=law.parts, velocity_output=True, **options)
        recordings = {n: runs[n].signals(law, shape, None, even=False) for n in names}
        made |= simulate_windows(model, recordings, {n: fitted[n].values for n in names}, WINDOW)
    return {n: made[n] for n in runs}


def angle_scores(windows: Windows) -> dict[str, float]:
    """RMSE (rad) of both angles and of the two together."""
    rmse = windows.rmse()
    first, second = rmse["theta1"], rmse["theta2"]
    return {"joint 1": first, "joint 2": second, "both": float(np.hypot(first, second) / np.sqrt(2))}


def encoder_zeros(fitted: Fitted, run: Run) -> np.ndarray:
    """What to add to both angles (2,) in rad so that the torque of this run fits best, to first order."""
    error = reference_torque(run.raw) - predicted(fitted, run)
    slopes = run.slopes(fitted.law, fitted.shape, fitted.first)
    columns = [(d @ np.array(list(fitted.values.values()))).ravel() for d in slopes]
    return np.linalg.lstsq(np.stack(columns, axis=1), error.ravel(), rcond=None)[0]
