"""Linear-quadratic-Gaussian control along a trajectory: state feedback and observer for small deviations from it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import cont2discrete

from plantfit.control.linear.riccati import filter_gain, regulator_gain
from plantfit.errors import SimulationError


class Weights(NamedTuple):
    """What the design takes as large: deviations of the states (0: any), of the input, and the disturbance and noise to
    expect.

    By Bryson's rule the cost is the sum of the squares of state / `states` and input / `input`. `disturbance` is the
    standard deviation per sample of a disturbance at the input, `noise` that of every measurement.
    """

    states: tuple[float, ...]
    input: float
    disturbance: float
    noise: float


class Lqg(NamedTuple):
    """Arrays over a trajectory of N samples for a plant of n states, one input and m measured states (the first m).

    Deviation e of the states from the reference, y - y_ref measured, v the input beyond the feedforward:
    e += observer (y - y_ref - e[:m]);  v = -gain e;  e = transition e + input v.
    """

    gain: np.ndarray  # (N, n)
    transition: np.ndarray  # (N, n, n)
    input: np.ndarray  # (N, n)
    observer: np.ndarray  # (N, n, m)


def scheduled_lqg(
    linearised: Callable[[float], tuple[np.ndarray, np.ndarray]],
    along: np.ndarray,
    period: float,
    weights: Weights,
    measured: int,
    nodes: int = 25,
) -> Lqg:
    """LQG designs at `nodes` values of a scheduling variable, straight lines between, at its values `along` (N,).

    `linearised(value)` gives A (n, n) and B (n, 1) in continuous time at the equilibrium of that value; the input is
    held over `period` (s). Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., chapter 9. Raises
    SimulationError where no controller holds the plant.
    """
    values = np.linspace(along.min(), along.max(), nodes if np.ptp(along) > 0 else 1)
    designs = [_design(float(value), *linearised(float(value)), period, weights, measured) for value in values]
    share = np.interp(along, values, np.arange(len(values)))
    below = np.minimum(share.astype(int), max(len(values) - 2, 0))
    above = np.minimum(below + 1, len(values) - 1)

    def along_the_way(k: int) -> np.ndarray:
        table = np.stack([design[k] for design in designs])
        part = (share - below).reshape(-1, *([1] * (table.ndim - 1)))
        return (1.0 - part) * table[below] + part * table[above]

    return Lqg(*(along_the_way(k) for k in range(4)))


def _design(value: float, a: np.ndarray, b: np.ndarray, period: float, weights: Weights, measured: int) -> Any:
    seen, noise = np.eye(measured, len(a)), weights.noise**2 * np.eye(measured)
    sampled: Any = cont2discrete((a, b, seen, np.zeros((measured, 1))), period, "zoh")
    transition, push = sampled[:2]
    cost = np.diag([0.0 if w == 0 else 1.0 / w**2 for w in weights.states])
    regulator = regulator_gain(transition, push, cost, np.array([[1.0 / weights.input**2]]))
    observer = filter_gain(transition, seen, weights.disturbance**2 * push @ push.T, noise)
    if regulator is None or observer is None:
        raise SimulationError(
            f"No LQG design with {weights} holds the plant at {value:g}; weigh a state that grows, or measure more."
        )
    return regulator[0][0], transition, push[:, 0], observer
