"""Trajectories to measure errors against: scipy's Radau at rtol 1e-9 and atol 1e-11, begun at the delayed edge, kept
in the cache."""

import hashlib
import os
import tempfile
from collections.abc import Sequence

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.data import Steam
from benchmarks.steam.plant import plant
from plantfit.folders import cache_folder


def reference(steam: Steam, theta: np.ndarray) -> np.ndarray:
    """Pressures (10, 4500) bar at the samples, NaN after the end of a record; theta (310,). About 5 s when not in
    the cache."""
    rows = np.ascontiguousarray(theta, dtype=float).reshape(10, 31)
    file = cache_folder() / "benchmarks" / f"steam-radau-{hashlib.sha256(rows.tobytes()).hexdigest()[:16]}.npy"
    if file.exists():
        return np.load(file)
    y = np.full(steam.y.shape, np.nan)
    for i, n in enumerate(steam.samples):
        y[i, :n] = _response(rows[i], float(steam.opening[i]), float(steam.period) * np.arange(1, n + 1))
    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=file.parent, suffix=".npy", delete=False) as part:
        np.save(part, y)
    os.replace(part.name, file)
    return y


def worst_error(steam: Steam, candidates: Sequence[np.ndarray], responses: Sequence[np.ndarray]) -> float:
    """Largest |response - reference| in bar over candidates of shape (310,) and their responses (10, 4500)."""
    return max(
        float(np.nanmax(np.abs(y - reference(steam, theta)))) for theta, y in zip(candidates, responses, strict=True)
    )


def _response(row: np.ndarray, opening: float, t: np.ndarray) -> np.ndarray:
    rate, jacobian = plant(row, opening)
    on, y = t > row[30], np.zeros(t.shape)
    if on.any():
        y[on] = solve_ivp(
            rate, (row[30], t[-1]), [0.0, 0.0], "Radau", t_eval=t[on], rtol=1e-9, atol=1e-11, jac=jacobian
        ).y[0]
    return y
