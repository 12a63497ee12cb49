"""Damped Gauss-Newton steps of multiple shooting at a fixed weight of continuity.

The damping follows the ratio of what a step gained to what it promised (Levenberg 1944; Marquardt, SIAM J. Appl. Math.
11 (1963) 431).
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.shooting.elimination import Linear, step

FIRST_DAMPING, MOST_DAMPING, LEAST_DAMPING = 1e-2, 1e8, 1e-10
ROUNDING = 1e-13  # of the merit: a promise below it is nothing


@dataclass(frozen=True)
class Point:
    """Cube point `z` (d,), scaled initial states `s` (L, n), and the problem linearised there."""

    z: np.ndarray
    s: np.ndarray
    linear: Linear
    damping: float = FIRST_DAMPING


Linearise = Callable[[np.ndarray, np.ndarray], Point | None]


def descend(
    linearise: Linearise, point: Point, weight: float, rounds: int, settled: float, *, held: bool = False
) -> Point:
    """At most `rounds` steps, until the merit falls by less than `settled` of itself; `held` moves the states only.

    `linearise(z, s)` gives None where the problem cannot be simulated; the step is then made smaller.
    """
    damping = min(point.damping, FIRST_DAMPING)
    for _ in range(rounds):
        dz, ds = step(point.linear, weight, damping, point.z, held=held)
        before = point.linear.merit(weight)
        promised = before - point.linear.merit(weight, dz, ds)
        if abs(promised) <= ROUNDING * before:
            break
        moved = linearise(point.z + dz, point.s + ds) if promised > 0 else None
        gained = -np.inf if moved is None else before - moved.linear.merit(weight)
        if moved is None or not gained > 1e-3 * promised:
            damping *= 5.0
            if damping > MOST_DAMPING:
                break
            continue
        if gained > 0.5 * promised:
            damping = max(0.2 * damping, LEAST_DAMPING)
        point = moved
        if gained <= settled * before:
            break
    return dataclasses.replace(point, damping=damping)
