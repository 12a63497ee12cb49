"""Costs at the points of a sensitivity study: which coordinates move together, in what box, evaluated in batches."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from plantfit.errors import Interrupted, SearchError, SpaceError
from plantfit.optimize.loop.progress import estimate
from plantfit.space import Space

BATCH = 128  # points side by side; one shape, so that one program serves all

Groups = Mapping[str, Sequence[str]]


class Costed(Protocol):
    """What is studied: a `Problem`, or anything with a space and costs (n,) of cube points (n, d)."""

    @property
    def space(self) -> Space: ...

    def costs(self, zs: Any) -> Any: ...


@dataclass(frozen=True)
class Box:
    """Coordinates that move, their groups, and how far: a design for SALib. The others stay at `at` (d,)."""

    at: np.ndarray
    moving: np.ndarray  # places (q,) in the cube
    groups: tuple[str, ...]  # of each moving coordinate (q,)
    low: np.ndarray  # (q,)
    high: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """Groups in the order in which SALib gives them, that of their first coordinates."""
        return tuple(dict.fromkeys(self.groups))

    def design(self, names: Sequence[str]) -> dict[str, Any]:
        """SALib's description of the box; a group that it does not know is a parameter alone."""
        bounds = list(zip(self.low.tolist(), self.high.tolist(), strict=True))
        return {
            "num_vars": len(self.moving),
            "names": [names[i] for i in self.moving],
            "groups": list(self.groups),
            "bounds": bounds,
        }

    def points(self, rows: np.ndarray) -> np.ndarray:
        """Cube points (n, d) of moving coordinates (n, q)."""
        whole = np.tile(self.at, (len(rows), 1))
        whole[:, self.moving] = rows
        return whole


def box_around(space: Space, at: Any, radius: float | None, groups: Groups | None) -> Box:
    """The neighbourhood of `at` (d,) within `radius` of the cube's edge, inside the cube; the whole cube for None.

    `groups` name parameters or coordinates that move together, others rest; None makes a group of every parameter, its
    table entries and copies for each recording together. Raises SpaceError for names, SearchError for numbers that do
    not fit.
    """
    at = np.full(space.dimension, 0.5) if at is None else np.asarray(at, dtype=float)
    if at.shape != (space.dimension,) or not np.all((at >= 0) & (at <= 1)):
        raise SearchError(
            f"at has shape {at.shape} or leaves the unit cube; give a point ({space.dimension},) such as answer.best.x."
        )
    if radius is not None and not 0 < radius <= 1:
        raise SearchError(f"radius = {radius}; give a share of the bounds above 0 and at most 1, such as 0.01.")
    member = _members(space, groups)
    moving = np.array(sorted(member), dtype=int)
    low, high = (
        (np.zeros(len(at)), np.ones(len(at)))
        if radius is None
        else (np.maximum(at - radius, 0.0), np.minimum(at + radius, 1.0))
    )
    return Box(at, moving, tuple(member[i] for i in moving), low[moving], high[moving])


def _members(space: Space, groups: Groups | None) -> dict[int, str]:
    """Group by place in the cube."""
    if groups is None:
        return {i: c.parameter for i, c in enumerate(space.coordinates)}
    if not groups:
        raise SpaceError(
            "groups is empty; name at least one group of parameters, or leave groups out for one for each parameter."
        )
    found: dict[int, str] = {}
    for group, wanted in groups.items():
        for name in [wanted] if isinstance(wanted, str) else wanted:
            places = [i for i, c in enumerate(space.coordinates) if name in (c.parameter, c.name)]
            if not places:
                known = list(dict.fromkeys(c.parameter for c in space.coordinates))
                raise SpaceError(
                    f"Group {group!r} names {name!r}, which is no free parameter; the free ones are {known}."
                )
            for i in places:
                if i in found:
                    raise SpaceError(
                        f"{space.names[i]!r} is in the groups {found[i]!r} and {group!r}; put it into one."
                    )
                found[i] = group
    return found


def costs_at(
    problem: Costed,
    points: np.ndarray,
    progress: Callable[[Any], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> np.ndarray:
    """Costs (n,) of cube points (n, d); inf or nan where a run failed. Raises Interrupted once `stop()` is true."""
    n, began, found = len(points), time.monotonic(), np.empty(len(points))
    for first in range(0, n, BATCH):
        if stop is not None and stop():
            raise Interrupted(f"Stopped after {first} of {n} points; nothing is kept, run it again.")
        rows = points[first : first + BATCH]
        filled = np.concatenate([rows, np.repeat(rows[-1:], BATCH - len(rows), axis=0)]) if n > BATCH else rows
        found[first : first + len(rows)] = np.asarray(problem.costs(filled))[: len(rows)]
        if progress is not None:
            done = first + len(rows)
            best = float(np.min(found[:done], initial=np.inf, where=np.isfinite(found[:done])))
            progress(estimate(int(done == n), 1, float(done), 0.0, float(n), best, time.monotonic() - began))
    return found


def whole_number(what: str, value: Any, least: int) -> None:
    """SearchError unless `value` is a whole number of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise SearchError(f"{what} = {value!r}; give a whole number of at least {least}.")


def check_confidence(value: float) -> None:
    """SearchError unless `value` lies between 0 and 1."""
    if not 0 < value < 1:
        raise SearchError(f"confidence = {value}; give a probability between 0 and 1, such as 0.95.")
