"""How bent a table is: second differences of its entries along each of its axes, in units of the box."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpaceError
from plantfit.models.parts.tables import Table
from plantfit.space import Parameter, Space

AUTOMATIC = ("cross-validated", "reml")


@dataclass(frozen=True)
class Bends:
    """Second differences rows @ z + offset (k,) of one table along the axis over `signal`, of one set of its entries.

    `rows` (k, q), `columns` (q,) the places of the entries in the cube; those of `recording`, or shared (None). A value
    is counted from its lower bound in box widths, on the scale that it is searched on, and neighbours are one mean
    distance of nodes apart, so that tables compare.
    """

    parameter: str
    axis: int
    signal: str
    recording: str | None
    columns: np.ndarray
    rows: np.ndarray
    offset: np.ndarray


def bends_of(space: Space, tables: Mapping[str, Table]) -> list[Bends]:
    """Of every free parameter with `smooth`. Raises SpaceError where it is asked of something that has no bends."""
    found = []
    for name, p in space.parameters.items():
        if p.smooth is not None and p.value is None:
            _check(name, p)
            found += list(_of_parameter(space, name, tables.get(name)))
    return found


def second_differences(nodes: np.ndarray) -> np.ndarray:
    """Rows (n - 2, n) of f'' sqrt(dx) at the inner nodes (n,), lengths in mean distances of nodes: 1, -2, 1 where they
    are even.

    The sum of their squares is then the integral of f''^2 by the trapezoidal rule (Green and Silverman, Nonparametric
    Regression and Generalized Linear Models, 1994, section 2.1.2, with lumped masses).
    """
    h = np.diff(nodes) * (len(nodes) - 1) / (nodes[-1] - nodes[0])
    before, after, inner = h[:-1], h[1:], np.arange(len(nodes) - 2)
    rows, mean = np.zeros((len(nodes) - 2, len(nodes))), 0.5 * (before + after)
    rows[inner, inner], rows[inner, inner + 2] = 1.0 / before, 1.0 / after
    rows[inner, inner + 1] = -1.0 / before - 1.0 / after
    return rows / np.sqrt(mean)[:, None]


def _of_parameter(space: Space, name: str, table: Table | None) -> Iterator[Bends]:
    p = space.parameters[name]
    places = np.array([i for i, c in enumerate(space.coordinates) if c.parameter == name], dtype=int)
    low, high, log = space.lower[places], space.upper[places], space.log[places]
    low, high = (
        np.where(log, np.log(np.where(log, low, 1.0)), low),
        np.where(log, np.log(np.where(log, high, 1.0)), high),
    )
    start, width = (low - low.min()) / (high.max() - low.min()), (high - low) / (high.max() - low.min())
    size = int(np.prod(p.shape))
    for k, recording in enumerate(space.recordings if p.per_recording else (None,)):
        own = slice(k * size, (k + 1) * size)
        for axis in range(len(p.shape)):
            nodes = np.asarray(table.nodes[axis]) if table else np.arange(p.shape[axis], dtype=float)
            signal = table.over[axis] if table else f"entry {axis}"
            rows = _along(second_differences(nodes), p.shape, axis)
            if len(rows):
                yield Bends(name, axis, signal, recording, places[own], rows * width[own], rows @ start[own])


def _along(rows: np.ndarray, shape: tuple[int, ...], axis: int) -> np.ndarray:
    """Rows for one axis as rows for all entries of the table, flat in row-major order."""
    return (
        rows if len(shape) == 1 else np.kron(rows, np.eye(shape[1])) if axis == 0 else np.kron(np.eye(shape[0]), rows)
    )


def _check(name: str, p: Parameter) -> None:
    if not p.shape or max(p.shape) < 3:
        what = "a single number" if not p.shape else f"a table of {' x '.join(map(str, p.shape))} entries"
        raise SpaceError(
            f"Parameter {name!r} has smooth = {p.smooth!r}, but it is "
            f"{what}; take smooth out, or give it three nodes or more."
        )
    if p.tied is not None:
        raise SpaceError(
            f"Parameter {name!r} has smooth = {p.smooth!r}, but it is tied to {p.tied!r}; give smooth to {p.tied!r}."
        )
    if isinstance(p.smooth, str):
        good = p.smooth in AUTOMATIC
    else:
        values = np.atleast_1d(np.asarray(p.smooth, dtype=float))
        good = values.shape in ((1,), (len(p.shape),)) and bool(np.all(np.isfinite(values) & (values >= 0)))
    if not good:
        raise SpaceError(
            f"Parameter {name!r} has smooth = {p.smooth!r}; give 'cross-validated', 'reml' or a strength of 0 or more "
            "(over two signals also one for each)."
        )
