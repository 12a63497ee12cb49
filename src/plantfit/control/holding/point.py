"""The point where a regulator holds a plant: its equilibrium within the input's range, and how long a loop takes
there."""

from collections.abc import Mapping

import numpy as np
import scipy

from plantfit.control.linear.linear_plant import LinearPlant, equilibrium
from plantfit.errors import SimulationError
from plantfit.models.model import Model

STILL = 1e-9  # of a balanced matrix: a smaller singular value is 0
TINY = 1e-6  # of the fastest pole: a slower one counts as an integrator
SHORTEST, LONGEST = 1e-9, 1e9  # s
STARTS = 33  # inputs over their range that an equilibrium is looked for from, where the middle leads to none


def held_point(
    model: Model, best: Mapping[str, float], at: Mapping[str, float], input_: str | None, lower: float, upper: float
) -> tuple[dict[str, float], dict[str, float]]:
    """States and input at rest with the states `at` as they are, looked for from the middle of the input's range.

    Where that leads nowhere, as in the saturation of a current limit, from inputs all over the range, those near to
    the middle first. Raises SimulationError as `equilibrium` does, of the search from the middle.
    """
    middle = 0.5 * (lower + upper)
    if input_ is None:
        return equilibrium(model, best, at, None, [*at])
    try:
        return equilibrium(model, best, at, {input_: middle}, [*at])
    except SimulationError as none:
        grid = np.linspace(lower, upper, STARTS)
        for u in sorted(grid, key=lambda u: abs(u - middle)):
            try:
                return equilibrium(model, best, at, {input_: float(u)}, [*at])
            except SimulationError:
                continue
        raise none


def moving_poles(a: np.ndarray) -> np.ndarray:
    """Poles (k,) of a matrix (s, s) in 1/s that are not 0.

    Those at 0 are taken out by the null space, again and again (the eigenvalue 0 of a chain of s integrators is
    known to the s-th root of rounding only, so that its size does not tell).
    """
    a = np.asarray(scipy.linalg.matrix_balance(a, permute=False)[0])
    whole = float(np.max(np.abs(a), initial=0.0))
    while len(a) and whole > 0:
        _, strength, right = np.linalg.svd(a)
        kept = strength > STILL * whole
        if np.all(kept):
            found = np.linalg.eigvals(a)
            return found[np.abs(found) > TINY * np.max(np.abs(found))]
        a = right[kept] @ a @ right[kept].T  # a is 0 on the others: in these coordinates it is block triangular
    return np.zeros(0)


def reach_seconds(plant: LinearPlant, state: str, distance: float, push: float) -> float:
    """Seconds in which the only input, moved by `push` from the point, moves a state by `distance`; inf where it never
    does."""
    n, at = len(plant.states), plant.states.index(state)
    big = np.zeros((n + 1, n + 1))
    big[:n, :n], big[:n, n] = plant.A, plant.B[:, 0] * push

    def reached(t: float) -> bool:
        with np.errstate(over="ignore", invalid="ignore"):
            moved = scipy.linalg.expm(big * t)[at, n]
        return not abs(moved) < distance  # not a number has gone far

    low, high = SHORTEST, 2.0 * SHORTEST
    while not reached(high):
        low, high = high, 2.0 * high
        if high > LONGEST:
            return float("inf")
    for _ in range(12):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if reached(middle) else (middle, high)
    return high


def slow_time(plant: LinearPlant, state: str, distance: float, push: float) -> tuple[float | None, bool]:
    """The slowest time (s) of a plant at the point, and whether it is that of its integrators: what `push` of the
    input takes to move `state` by `distance`. None where nothing tells."""
    moving = moving_poles(plant.A)
    own = float(1.0 / np.min(np.abs(moving))) if len(moving) else 0.0
    if len(moving) < len(plant.A):
        reach = reach_seconds(plant, state, distance, push)
        if np.isfinite(reach) and reach > own:
            return reach, True
    return (own, False) if own > 0 else (None, False)
