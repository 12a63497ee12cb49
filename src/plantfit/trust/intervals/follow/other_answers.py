"""Ranges that hold other answers of about the cost, where none are followed: models with tables, many coordinates."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.special import chdtri, stdtrit

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate import points
from plantfit.problem.measure.long_run import NORMAL
from plantfit.problem.problem import Problem
from plantfit.space import Coordinate
from plantfit.study.comparing.symmetry import same_by_symmetry
from plantfit.trust.finish.unknown_noise import as_known
from plantfit.trust.identify.table_visits import table_visits
from plantfit.trust.intervals.covariance import known_variance
from plantfit.trust.intervals.linearised import Local, linearise, residual_blocks
from plantfit.trust.intervals.parameter_rows import ROUGH, parameter_rows
from plantfit.trust.intervals.ranges import LEVEL, degrees_left

Row = dict[str, Any]

LOOKED = 12  # other answers that are looked at
EVEN = 1e-6  # of a step between nodes: how far others may differ from it
APART = 1e-3  # of the cube: answers that are nearer are one


def holding_others(
    problem: Problem, z: np.ndarray, local: Local, rows: Sequence[Row], others: Sequence[np.ndarray]
) -> list[Row]:
    """The `rows` at the cube point z (d,), their intervals widened to those around other answers, where these cost so
    little more that noise may have chosen between the two: `others` (d,), which searches ended at, and tables moved
    along their nodes.

    A table of another length goes with another rate of the state that it is over. At whole nodes the fit is the same,
    and between them it is worse, so that standard errors tell of half a node. An answer that reads more entries of
    tables costs less by chance, one variance for each. Each interval is held as wide as it is there, less for a higher
    cost. What is one model written twice is left out.
    """
    problem = as_known(problem)
    looked = [(np.asarray(o, dtype=float), None) for o in others][:LOOKED] + list(_moved(problem, z))
    if not looked:
        return list(rows)
    residuals, blocks = points.residuals(problem, z), residual_blocks(problem)
    fitted = round(float(np.sum(local.effective)))
    square, count = float(residuals @ residuals), len(residuals)
    variance = max(square / max(1, count - fitted), known_variance(blocks, count, fitted), 1e-300)
    samples, _, degrees = degrees_left(residuals, blocks, fitted, local.robust)
    # wider than a normal distribution's, and for samples that are worth fewer
    wider = (float(stdtrit(degrees, 0.5 + LEVEL / 2)) / NORMAL) ** 2 * max(1.0, count / max(samples, 1.0))
    entries = _entries(problem, z)
    found, known = list(rows), [np.asarray(z)]
    for other, table in looked:
        if min(float(np.max(np.abs(other - k))) for k in known) <= APART:
            continue
        known.append(other)
        left = points.residuals(problem, other)
        growth = (float(left @ left) - square) / variance  # by the data alone: a smoothing is none
        if not growth <= wider * float(chdtri(1 + entries, 1.0 - LEVEL)):  # also where it cannot be simulated
            continue
        top = wider * float(chdtri(1 + max(entries - _entries(problem, other), 0), 1.0 - LEVEL))
        if growth > top or same_by_symmetry(problem, z, other) is not None:
            continue
        share = float(np.sqrt(1.0 - max(growth, 0.0) / top))
        # a moved table leaves errors as they are
        there = rows if table is not None else parameter_rows(problem.space, linearise(problem, other))
        values = np.asarray(problem.space.physical(other))
        free = [
            _held(row, own, beside, c, float(value), share, table) if own["status"] in ("determined", "weak") else row
            for row, own, beside, c, value in zip(found, rows, there, problem.space.coordinates, values, strict=False)
        ]
        found = free + found[len(free) :]  # what is fixed comes last
    return found


def _moved(problem: Problem, z: np.ndarray) -> Iterator[tuple[np.ndarray, str]]:
    """Answers (d,) with all tables over a state moved along their nodes, and a value in the state's unit with them, as
    that which it starts at; and the name of a table."""
    space, states = problem.space, getattr(problem.model, "states", {})
    places: dict[str, list[int]] = {}
    for i, c in enumerate(space.coordinates):
        if c.index and c.recording is None:
            places.setdefault(c.parameter, []).append(i)
    values = np.asarray(space.physical(z))
    for state, unit in states.items():
        own = [t for t in getattr(problem.model, "tables", ()) if t.over == (state,) and t.name in places]
        steps = np.concatenate([np.diff(t.nodes[0]) for t in own]) if own else np.zeros(0)
        if not len(steps) or np.ptp(steps) > EVEN * steps[0] or any(len(places[t.name]) != t.shape[0] for t in own):
            continue
        for j, c in enumerate(space.coordinates):
            for k in range(1, max(t.shape[0] for t in own)) if not c.index and (c.unit or "1") == (unit or "1") else ():
                for way in (-k, k):
                    if not space.lower[j] <= values[j] + way * steps[0] <= space.upper[j]:
                        continue
                    moved = values.copy()
                    moved[j] += way * steps[0]
                    for t in own:
                        at = np.asarray(places[t.name])
                        moved[at] = _continued(values[at], np.arange(len(at)) - way)
                    yield np.clip(space.cube(moved), 0.0, 1.0), own[0].name


def _continued(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Entries (n,) of a table at the places `at` (n,), in a straight line beyond its ends, which no smoothing minds."""
    n, last = len(values), len(values) - 1
    beyond = np.minimum(at, 0) * (values[1] - values[0]) + np.maximum(at - last, 0) * (values[-1] - values[-2])
    return values[np.clip(at, 0, n - 1)] + beyond


def _entries(problem: Problem, z: np.ndarray) -> int:
    """How many entries of tables the simulation at a cube point (d,) reads."""
    return sum(int(v.visited.sum()) for v in table_visits(problem, np.asarray(problem.space.physical(z))))


def _held(row: Row, own: Row, beside: Row, c: Coordinate, value: float, share: float, table: str | None) -> Row:
    """A row whose interval holds another value, with a `share` of the width that it has there (`beside`), or where it
    is open there of that at the answer (`own`); `table` was moved for it."""
    known = beside if beside["status"] in ("determined", "weak") else own
    low = max(min(row["low"], value - share * (known["value"] - known["low"])), c.limits[0])
    high = min(max(row["high"], value + share * (known["high"] - known["value"])), c.limits[1])
    wide = max(high - row["value"], row["value"] - low) > NORMAL * ROUGH * max(abs(row["value"]), c.typical)
    status = "weak" if row["status"] == "determined" and wide else row["status"]
    moved = {"moved_with": table} if table is not None and not c.index and value != row["value"] else {}
    return {**row, "low": low, "high": high, "status": status, **moved}
