"""The scheme of twin.c in numpy, written from the formulas with 2x2 solves by numpy, to check the C."""

import numpy as np

from benchmarks.data import Steam
from benchmarks.steam.twin import Scheme, Twin

GAMMA = 1 - np.sqrt(0.5)


def numpy_costs(steam: Steam, theta: np.ndarray, scheme: Scheme = "exponential", substeps: int = 1) -> np.ndarray:
    """Sum over the openings of the mean squared error, bar^2: (P, 310) to (P,)."""
    rows = theta.reshape(-1, 10, 31)
    step = _exponential if scheme == "exponential" else _ros2
    x, total, period = np.zeros((*rows.shape[:2], 2)), np.zeros(rows.shape[:2]), float(steam.period)
    for j in range(int(steam.samples.max())):
        h = np.clip((j + 1) * period - rows[..., 30], 0.0, period) / substeps
        for _ in range(substeps):
            x = step(steam, rows, x, h[..., None, None])
        total += np.where(j < steam.samples, (x[..., 0] - steam.y[:, j]) ** 2, 0.0)
    return (total / steam.samples).sum(axis=1)


def check(twin: Twin) -> float:
    """Largest relative difference of the C costs from numpy's: the truth and 4 vectors, which fill more than a
    block."""
    theta = np.vstack([twin.steam.truth.ravel(), twin.steam.draw(4, 2)])
    expected = numpy_costs(twin.steam, theta, twin.scheme, twin.substeps)
    return float(np.max(np.abs(twin.cost_batch(theta) / expected - 1)))


def _rate(steam: Steam, rows: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """f (P, 10, 2) and its Jacobian (P, 10, 2, 2)."""
    place = np.clip(x[..., 0], 0.0, 20.0) * (9 / 20)
    piece = np.minimum(place.astype(int), 8)
    inside = (x[..., 0] >= 0.0) & (x[..., 0] < 20.0)

    def table(first: int) -> tuple[np.ndarray, np.ndarray]:
        below, above = (np.take_along_axis(rows, (first + piece + i)[..., None], -1)[..., 0] for i in (0, 1))
        return below + (place - piece) * (above - below), np.where(inside, (above - below) * (9 / 20), 0.0)

    (k, dk), (a1, da1), (a2, da2) = table(0), table(10), table(20)
    f2 = (k * steam.opening - x[..., 0] - a1 * x[..., 1]) / a2
    by_x = (dk * steam.opening - 1 - da1 * x[..., 1] - da2 * f2) / a2
    one = np.ones_like(f2)
    return np.stack([x[..., 1], f2], -1), np.stack([np.stack([0 * one, one], -1), np.stack([by_x, -a1 / a2], -1)], -2)


def _exponential(steam: Steam, rows: np.ndarray, x: np.ndarray, h: np.ndarray) -> np.ndarray:
    f, jacobian = _rate(steam, rows, x)
    z, one = h * jacobian, np.eye(2)
    right = (one - z / 6) @ f[..., None]
    return x + (h * np.linalg.solve(one - 2 / 3 * z + z @ z / 6, right))[..., 0]


def _ros2(steam: Steam, rows: np.ndarray, x: np.ndarray, h: np.ndarray) -> np.ndarray:
    f, jacobian = _rate(steam, rows, x)
    left = np.eye(2) - GAMMA * h * jacobian
    k1 = np.linalg.solve(left, f[..., None])
    again, _ = _rate(steam, rows, x + (h * k1)[..., 0])
    k2 = np.linalg.solve(left, again[..., None] - 2 * k1)
    return x + (h * (1.5 * k1 + 0.5 * k2))[..., 0]
