"""How often the recordings use every entry of a model's tables, and which entries nothing was measured at."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.parts.tables import Table
from plantfit.problem.measure.operating_points import hat_weights, operating_points
from plantfit.problem.problem import Problem


@dataclass(frozen=True)
class Visits:
    """Use of the entries of one table, in one recording or, for entries that recordings share (None), in all of them.

    `samples` and `weight` have the table's shape: samples in the cells around a node, and the sum of their hat-function
    weights, which over all entries is `total`, the number of samples.
    """

    table: Table
    recording: str | None
    samples: np.ndarray
    weight: np.ndarray
    total: int

    @property
    def visited(self) -> np.ndarray:
        """Entries (shape) that at least one sample depends on."""
        return self.weight > 0.0

    @property
    def share(self) -> np.ndarray:
        """Share of the hat-function weight (shape)."""
        return self.weight / max(self.total, 1)

    @property
    def names(self) -> tuple[str, ...]:
        """The entries as coordinates of the space, in row-major order."""
        end = "" if self.recording is None else f"[{self.recording}]"
        return tuple(f"{self.table.name}[{','.join(map(str, i))}]{end}" for i in np.ndindex(self.weight.shape))


def table_visits(problem: Problem, values: Any) -> list[Visits]:
    """Visits of every table with free entries at parameter values (d,), one for each recording with entries of its own.

    The operating point is the simulated one, where the tables were looked up. A tied table counts as use of the one it
    is tied to.
    """
    used = _used(problem)
    return _visits(problem, used, operating_points(problem, values) if used else {})


def recorded_visits(problem: Problem, values: Any) -> dict[str, bool]:
    """Whether a recorded sample depends on an entry, by coordinate; without those of tables over what is not recorded.

    Recorded are inputs, and what an output gives as it is: the two are alike in a simulation at values (d,).
    """
    used, simulated = _used(problem), operating_points(problem, values)
    recorded = {name: _recorded(problem, name, points, values) for name, points in simulated.items()}
    tables = {t.name: t for t in problem.model.tables}  # pyrefly: ignore[missing-attribute]
    known = {n: root for n, root in used.items() if all({*tables[n].over} <= {*own} for own in recorded.values())}
    found = _visits(problem, known, recorded)
    return {name: bool(seen) for v in found for name, seen in zip(v.names, v.visited.ravel(), strict=True)}


def _recorded(problem: Problem, recording: str, points: Mapping[str, np.ndarray], values: Any) -> dict[str, np.ndarray]:
    """Of simulated signals (n,) those that the recording holds, as it holds them."""
    record, found = problem.experiments[recording].recording, {}
    outputs = problem.predict(values, recording)
    for signal, simulated in points.items():
        n = len(simulated)
        same = [
            o for o, y in outputs.items()
            if o in record.signals and np.allclose(np.asarray(y)[:n], simulated, rtol=1e-6, atol=1e-9 * np.ptp(y))
        ]  # fmt: skip
        if signal in getattr(problem.model, "inputs", {}):
            found[signal] = simulated
        elif same:
            found[signal] = np.asarray(record[same[0]], dtype=float)[:n]
    return found


def _used(problem: Problem) -> dict[str, str]:
    """Tables with free entries, each with the one that it is tied to or itself."""
    space = problem.space
    names = [t.name for t in getattr(problem.model, "tables", ())]
    return {n: space.root(n) for n in names if space.parameters[space.root(n)].value is None}


def _visits(problem: Problem, used: Mapping[str, str], places: Mapping[str, Mapping[str, np.ndarray]]) -> list[Visits]:
    """Visits of the tables `used` at operating points by recording and signal."""
    space, tables = problem.space, {t.name: t for t in getattr(problem.model, "tables", ())}
    found: dict[tuple[str, str | None], Visits] = {}
    for recording, points in places.items():
        weights: dict[Any, np.ndarray] = {}  # tables over the same nodes have the same
        for name, root in used.items():
            table, own = tables[name], recording if space.parameters[root].per_recording else None
            place = table.over, table.nodes
            w = weights[place] if place in weights else weights.setdefault(place, hat_weights(table, points))
            here = Visits(tables.get(root, table), own, np.sum(w > 0, axis=0), np.sum(w, axis=0), len(w))
            found[root, own] = _joined(found.get((root, own)), here)
    return list(found.values())


def _joined(a: Visits | None, b: Visits) -> Visits:
    return (
        b if a is None else Visits(a.table, a.recording, a.samples + b.samples, a.weight + b.weight, a.total + b.total)
    )


def unvisited(visits: Sequence[Visits]) -> set[str]:
    """The coordinates, by name, that no sample depends on."""
    return {name for v in visits for name, seen in zip(v.names, v.visited.ravel(), strict=True) if not seen}


def agreeing(visits: Sequence[Visits], touched: Mapping[str, bool]) -> tuple[list[Visits], set[str]]:
    """The visits that hold, and the coordinates that no sample depends on, by name; `touched` tells who has a
    derivative.

    A model that reads a table at something else than the signal it is over (k(2 u), k(|v|)) has derivatives where no
    sample seems to be; the visits of such a table are left out.
    """
    good = [v for v in visits if not any(touched[n] for n in unvisited([v]))]
    return good, {n for n in unvisited(visits) if not touched[n]}
