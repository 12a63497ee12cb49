"""The chamber as one plant for any opening: the tables and dead times of all openings side by side."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from plantfit.models.library.steam_chamber import steam_chamber
from plantfit.models.model import Declared, Model
from plantfit.models.parts.tables import Table
from plantfit.problem.problem import Problem
from plantfit.rig.steam_chamber import NODES, OPENINGS, TABLES

FINE = tuple(float(u) for u in range(2, 101, 2))  # openings (%) at which the truth is tabled for a loop


def whole_plant(openings: Sequence[float] = OPENINGS, dead_time: bool = True) -> Model:
    """k, A1, A2 over pressure and delayed opening, bilinear; Td over the opening of now."""
    grid = [float(u) for u in openings]
    plain = steam_chamber(nodes=NODES.tolist(), opening_nodes=grid, dead_time=dead_time)
    if not dead_time:
        return plain
    late = Table("Td", ("u",), (tuple(grid),), "s")
    parameters = tuple(
        Declared("Td", "s", (0.0, 1.0), shape=late.shape) if p.name == "Td" else p for p in plain.parameters
    )
    return replace(plain, parameters=parameters, tables=(*plain.tables, late))


def plants_of(problem: Problem, points: Sequence[Any]) -> dict[str, np.ndarray]:
    """Parameters of `whole_plant` with a leading axis for cube points (310,) of a dynamic problem of all openings,
    in their order."""
    members = []
    for z in points:
        values = np.asarray(problem.space.physical(np.asarray(z)))
        trees = [problem.space.tree(values, name) for name in problem.experiments]
        members.append({n: np.stack([np.asarray(t[n]) for t in trees], axis=-1) for n in (*TABLES, "Td")})
    return {n: np.stack([m[n] for m in members]) for n in (*TABLES, "Td")}


def true_plant(truth: Callable[[float], Mapping[str, Any]], openings: Sequence[float] = FINE) -> dict[str, np.ndarray]:
    """Parameters of `whole_plant(openings)` from a rig's truth, with a leading axis of 1."""
    each = [truth(u) for u in openings]
    return {n: np.stack([np.asarray(p[n], dtype=float) for p in each], axis=-1)[None] for n in (*TABLES, "Td")}
