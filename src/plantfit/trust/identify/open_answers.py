"""Other answers that fit about as well: what the data leave open is drawn anew within its bounds."""

import numpy as np

from plantfit.errors import SearchError
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.linearised import linearise

HALVINGS = 20


def open_answers(
    problem: Problem, z: np.ndarray, count: int, *, known: float = 1e-3, worst: float | None = None, seed: int = 1
) -> np.ndarray:
    """Cube points (count, d) like the answer z (d,), their open coordinates drawn evenly over the box.

    Open is what the data fix by less than the share `known` (`Local.effective`) and do not press onto a bound: cells of
    a table that were never or hardly visited. Everything else stays as it is, so that costs hardly differ; compare
    them. With `worst`, a draw whose cost is more than so many times that of z comes half as far from z, as often as it
    takes: many cells that hardly matter alone may matter together. Raises SearchError where nothing is open.
    """
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise SearchError(f"count = {count!r}; give a whole number of at least 1.")
    if worst is not None and not worst > 1.0:
        raise SearchError(
            f"worst = {worst!r}; give how many times the cost of the answer its copies may have, above 1."
        )
    z = np.asarray(z, dtype=float)
    local = linearise(problem, z)
    free = np.array([bound is None for bound in local.at_bound]) & (local.effective < known)
    if not np.any(free):
        raise SearchError(
            f"The data fix every parameter by a share of {known:g} or "
            "more, so that nothing can be drawn anew; raise known."
        )
    points = np.tile(z, (count, 1))
    points[:, free] = np.random.default_rng(seed).uniform(size=(count, int(free.sum())))
    if worst is not None:
        most, poor = worst * float(problem.cost(z)), np.zeros(count, dtype=bool)
        for _ in range(HALVINGS):
            poor = ~(np.asarray(problem.costs(points)) <= most)
            if not np.any(poor):
                break
            points[poor] = 0.5 * (points[poor] + z)
        else:
            points[poor] = z
    return points
