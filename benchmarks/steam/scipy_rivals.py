"""The ten responses by scipy: BDF in plain floats with the exact Jacobian, and LSODA with a compiled right-hand
side."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.integrate import odeint, solve_ivp

from benchmarks.data import Steam
from benchmarks.steam.compiler import extension
from benchmarks.steam.plant import plant

Responses = Callable[[], np.ndarray]


def cost_of(steam: Steam, responses: np.ndarray) -> float:
    """Sum over the openings of the mean squared error, bar^2; responses (10, 4500)."""
    return float(sum(np.mean((responses[i, :n] - steam.y[i, :n]) ** 2) for i, n in enumerate(steam.samples)))


def bdf(steam: Steam, theta: np.ndarray, rtol: float, atol: float) -> Responses:
    """A call that gives the pressures (10, 4500) of one candidate (310,); each opening starts at its delayed edge."""
    plants = [plant(row, float(u)) for row, u in zip(theta.reshape(10, 31), steam.opening, strict=True)]

    def run() -> np.ndarray:
        y = np.full(steam.y.shape, np.nan)
        for i, (delay, t) in enumerate(_times(steam, theta)):
            rate, jacobian = plants[i]
            rest = int(np.searchsorted(t, delay + 1e-9))
            solved = solve_ivp(
                rate, (delay, t[-1]), [0.0, 0.0], "BDF", t_eval=t[rest:], rtol=rtol, atol=atol, jac=jacobian
            )
            y[i, :rest], y[i, rest : len(t)] = 0.0, solved.y[0]
        return y

    return run


def lsoda(steam: Steam, theta: np.ndarray, rtol: float, atol: float) -> Responses | None:
    """As `bdf`, by odeint over a rate written in C; None without a compiler or without Python's headers."""
    compiled = extension(Path(__file__).with_name("rate.c"))
    if compiled is None:
        return None
    answer, rates = np.empty(2), []
    for row, u in zip(theta.reshape(10, 31), steam.opening, strict=True):
        parameters = np.array(row, dtype=float)
        parameters[:10] *= u
        rates.append(compiled.bind(parameters, answer))

    def run() -> np.ndarray:
        y = np.full(steam.y.shape, np.nan)
        for i, (delay, t) in enumerate(_times(steam, theta)):
            rest = int(np.searchsorted(t, delay + 1e-9))
            y[i, :rest] = 0.0
            y[i, rest : len(t)] = odeint(
                rates[i], [0.0, 0.0], np.r_[delay, t[rest:]], rtol=rtol, atol=atol, mxstep=100_000
            )[1:, 0]
        return y

    return run


def _times(steam: Steam, theta: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Delay and sample times of every opening, s."""
    delays = theta.reshape(10, 31)[:, 30]
    return [(float(d), float(steam.period) * np.arange(1, n + 1)) for d, n in zip(delays, steam.samples, strict=True)]
