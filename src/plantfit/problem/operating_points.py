"""Where on its tables a model works along the recordings, and which entries that touches."""

from collections.abc import Mapping
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.tables import Table
from plantfit.problem.problem import Problem

import jax.numpy as jnp


def operating_points(problem: Problem, values: Any, name: str) -> dict[str, np.ndarray]:
    """The signals that the model's tables are over, each (n,), in one fitted recording simulated at `values` (d,).

    The n samples are those up to the last fitted one: what comes before the fitted part is simulated too.
    """
    wanted = {signal for table in getattr(problem.model, "tables", ()) for signal in table.over}
    if not wanted:
        return {}
    p = problem.space.tree(jnp.asarray(values), name)
    found = problem.compiled["trajectories"](p, problem.data["drive"][name])
    return {n: np.asarray(v) for n, v in found.items() if n in wanted}


def hat_weights(table: Table, points: Mapping[str, np.ndarray]) -> np.ndarray:
    """Weight (n, *shape) of every entry at every operating point (n,); those of one point add up to 1.

    The value that a table gives is the sum of its entries by these weights (`models.tables.lookup`, eq. 3). A point that is
    not finite has no weight.
    """
    parts = [_of_axis(np.asarray(nodes), np.asarray(points[signal])) for signal, nodes in zip(table.over, table.nodes, strict=True)]
    return parts[0] if len(parts) == 1 else parts[0][:, :, None] * parts[1][:, None, :]


def _of_axis(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    here = np.isfinite(x)
    inside = np.clip(np.where(here, x, nodes[0]), nodes[0], nodes[-1])
    cell = np.clip(np.searchsorted(nodes, inside, side="right") - 1, 0, len(nodes) - 2)
    share = (inside - nodes[cell]) / (nodes[cell + 1] - nodes[cell])
    weights, row = np.zeros((len(x), len(nodes))), np.arange(len(x))
    weights[row, cell], weights[row, cell + 1] = 1.0 - share, share
    return weights * here[:, None]
