"""Runs that found the same cost, and how far apart their answers lie."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # its rooms are loaded at their first use, not for a study of one run

APART = 0.05  # share of the bounds by which a coordinate must differ for answers to be distinct
MOST = 1500  # answers that are told apart, the best ones


@dataclass(frozen=True)
class Basin:
    """Runs of one cost: `members` (indices into the runs, best first), their `share` of all runs.

    `cost` and `x` (d,) are those of the best member; `spread` (d,) is the widest difference of each
    coordinate within the basin. One cost with a wide spread means a direction that the data leave free.
    """

    cost: float
    members: tuple[int, ...]
    share: float
    x: np.ndarray
    spread: np.ndarray


def basins(costs: Any, x: Any, tolerance: float = 1e-6, floor: float = 0.0) -> list[Basin]:
    """Clusters of costs (n,) at x (n, d), best first; runs without a finite cost belong to none.

    A basin holds every run within `tolerance` * |cost| + `floor` above its best. `floor` is an
    absolute cost below which differences mean nothing (rounding of a perfect fit).
    """
    costs, x = np.asarray(costs, dtype=float), np.asarray(x, dtype=float)
    order = [int(k) for k in np.argsort(costs, kind="stable") if np.isfinite(costs[k])]
    groups: list[list[int]] = []
    for k in order:
        if groups and costs[k] <= _edge(costs[groups[-1][0]], tolerance, floor):
            groups[-1].append(k)
        else:
            groups.append([k])
    return [
        Basin(float(costs[g[0]]), tuple(g), len(g) / len(costs), x[g[0]].copy(), np.ptp(x[g], axis=0)) for g in groups
    ]


def _edge(best: float, tolerance: float, floor: float) -> float:
    return best + tolerance * abs(best) + floor


def optima(costs: Any, x: Any, within: float, apart: float = APART) -> list[Basin]:
    """Distinct answers of the same cost: runs at most `within` above the best, in groups that lie apart, largest first.

    Answers x (n, d) in the unit cube belong together when a chain of answers joins them, each within `apart` of the
    next in every coordinate; a group with a wide spread is a valley. Of more than 1500 such runs the best are taken.
    """
    costs, x = np.asarray(costs, dtype=float), np.asarray(x, dtype=float)
    order = np.argsort(costs, kind="stable")
    order = order[np.isfinite(costs[order])]
    near = order[costs[order] <= costs[order[0]] + within][:MOST] if len(order) else order
    if not len(near):
        return []
    if len(near) == 1:
        return [
            Basin(float(costs[near[0]]), (int(near[0]),), 1.0 / len(costs), x[near[0]].copy(), np.zeros(x.shape[1]))
        ]
    pairs = scipy.spatial.KDTree(x[near]).query_pairs(apart, p=np.inf, output_type="ndarray")
    graph = scipy.sparse.coo_matrix(
        (np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(len(near), len(near))
    )
    count, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    groups = sorted((near[label == k] for k in range(count)), key=lambda g: (-len(g), costs[g[0]]))
    return [
        Basin(float(costs[g[0]]), tuple(g.tolist()), len(g) / len(costs), x[g[0]].copy(), np.ptp(x[g], axis=0))
        for g in groups
    ]
