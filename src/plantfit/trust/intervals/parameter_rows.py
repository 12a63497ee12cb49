"""Rows of the findings record on parameters, entry by entry, and on the tables that entries belong to."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.findings.tables import OperatingTable
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.space import Coordinate, Parameter, Space
from plantfit.trust.identify.table_visits import Visits
from plantfit.trust.intervals.linearised import Local, natural_sizes
from plantfit.trust.intervals.ranges import Range, linear_range, pulled_beyond

Row = dict[str, Any]


NOT_VISITED = "not visited"
ROUGH = 0.25  # standard error over the value from which on it is only roughly known
FREE = 1e3  # natural sizes, from which on an error may be what is assumed beside the data (`ranges.FAR`)
CUT = 3.0  # times that of the range: a linearised standard error above it means nothing


def parameter_rows(
    space: Space, local: Local, unseen: Collection[str] = (), ranges: Mapping[int, Range] | None = None
) -> list[Row]:
    """Free coordinates in the order of the space, then every fixed entry; `unseen` are coordinates that no sample
    depends on.

    `ranges` by place are those of `trust/intervals/follow/following.py`; by default those of the linearised problem.
    Problems without one, which have tables or many coordinates, are judged by standard errors that know no box.
    """
    rows, sizes = [], natural_sizes(space, local.values)
    for i, c in enumerate(space.coordinates):
        if c.name in unseen:
            rows.append(_unseen(c, local, i))
        elif local.linear is None:
            rows.append(_free(c, local, i, float(sizes[i])))
        else:
            rows.append(_ranged(c, local, i, ranges[i] if ranges is not None else linear_range(local.linear, i)))
    for name, p in space.parameters.items():
        if p.value is not None and p.tied is None:
            values = np.broadcast_to(np.asarray(p.value, dtype=float), p.shape)
            rows += [_fixed(name, p, index, float(values[index])) for index in np.ndindex(p.shape)]
    return rows


def with_delays(model: Model | Any, rows: Sequence[Row]) -> list[Row]:
    """The rows, those of dead times at a bound with what they delay."""
    late = {d.parameter: d.input for d in getattr(model, "delays", ())}
    late |= {d.parameter: d.state for d in getattr(model, "state_delays", ())}
    return [{**r, "delays": late.get(r["parameter"])} if r["at_bound"] else r for r in rows]


def table_rows(problem: Problem, rows: Sequence[Row], visits: Sequence[Visits] = ()) -> list[OperatingTable]:
    """One for each parameter with a shape and each recording that has its own; entries flat in row-major order."""
    seen = {(v.table.name, v.recording): v.samples.ravel().tolist() for v in visits}
    found: dict[tuple[str, str | None], list[Row]] = {}
    for row in rows:
        if row["index"]:
            found.setdefault((row["parameter"], row["recording"]), []).append(row)
    axes = {t.name: t for t in getattr(problem.model, "tables", ())}
    units = _signal_units(problem.model)
    result = []
    for (name, recording), entries in found.items():
        table, shape = axes.get(name), problem.space.parameters[name].shape
        over = list(table.over) if table else [f"entry {k}" for k in range(len(shape))]
        result.append(
            OperatingTable(
                name=name,
                unit=entries[0]["unit"],
                over=over,
                over_units=[units.get(signal) for signal in over],
                nodes=[list(map(float, n)) for n in table.nodes]
                if table
                else [list(map(float, range(n))) for n in shape],
                recording=recording,
                samples=seen.get((name, recording)),
                values=[e["value"] for e in entries],
                low=[e["low"] for e in entries],
                high=[e["high"] for e in entries],
                status=[e["status"] for e in entries],
            )
        )
    return result


def _free(c: Coordinate, local: Local, i: int, size: float) -> Row:
    """A row of an entry of a table or one of many coordinates, by its standard error without the box.

    It is open where that is above its natural `size`; `low` and `high` are bounds of the search then. Not a number
    whose interval lies inside of the bounds: an offset near zero is known, however large its error is against it.
    """
    assert local.unboxed is not None
    value, error, bound = float(local.values[i]), float(local.unboxed[i]), local.at_bound[i]
    status = "at bound" if bound else _status(c, value, error, size)
    inside = c.lower < value - 1.96 * error and value + 1.96 * error < c.upper and error < FREE * size
    if status == "flat" and not c.index and inside:
        status = "weak"
    end = (
        (min(c.lower, value), max(c.upper, value)) if status == "flat" else (value - 1.96 * error, value + 1.96 * error)
    )
    return {
        **_row(c, local, i),
        "standard_error": None if bound or status == "flat" else error,
        "low": None if bound else max(end[0], c.limits[0]),
        "high": None if bound else min(end[1], c.limits[1]),
        "open": "both" if status == "flat" else None,
        "limits": [float(v) if np.isfinite(v) else None for v in c.limits],
        "status": status,
    }


def _row(c: Coordinate, local: Local, i: int) -> Row:
    """What every row of a free coordinate has, its standard error, range and status to come."""
    return {
        "name": c.name,
        "parameter": c.parameter,
        "recording": c.recording,
        "index": list(c.index),
        "unit": c.unit,
        "value": float(local.values[i]),
        "standard_error": None,
        "low": None,
        "high": None,
        "open": None,
        "limits": None,
        "lower_bound": c.lower,
        "upper_bound": c.upper,
        "scale": "log" if c.log else "linear",
        "at_bound": local.at_bound[i],
        "status": NOT_VISITED,
    }


def _ranged(c: Coordinate, local: Local, i: int, found: Range) -> Row:
    """A row from a range. Where the data set no end to it, `low` and `high` are bounds of the search and `open` says
    which."""
    assert local.linear is not None
    value, bound = float(local.values[i]), local.at_bound[i]
    ends = [e for e, at in (("lower", found.low), ("upper", found.high)) if not np.isfinite(at)]
    low = found.low if np.isfinite(found.low) else min(c.lower, value)
    high = found.high if np.isfinite(found.high) else max(c.upper, value)
    error = (
        None if ends or bound else _error(found, value, c, float(local.linear.standard_error[i]), local.linear.quantile)
    )
    return {
        **_row(c, local, i),
        "standard_error": error,
        "low": float(low),
        "high": float(high),
        "open": None if not ends else ends[0] if len(ends) == 1 else "both",
        "limits": [float(v) if np.isfinite(v) else None for v in c.limits],
        "pulled": pulled_beyond(local.linear, i, -1.0 if bound == "lower" else 1.0) if bound else None,
        "status": "at bound" if bound else judged(c, value, found, local.linear.sound),
    }


def _error(found: Range, value: float, c: Coordinate, linear: float, quantile: float) -> float:
    """The standard error of the linearised problem; the range's where limits keep the value from going so far."""
    sides = [abs(end - value) for end, limit in zip((found.low, found.high), c.limits, strict=True) if end != limit]
    reach = max(sides, default=abs(found.high - found.low)) / quantile
    return float(reach) if linear > CUT * reach else linear


def judged(c: Coordinate, value: float, found: Range, sound: bool) -> str:
    """How well the data fix a value, by its range against its size or the size that matters: the box has no part in it.

    Where intervals are not `sound` nothing is called determined.
    """
    if not (np.isfinite(found.low) and np.isfinite(found.high)) or (found.low, found.high) == c.limits:
        return "flat"
    farther = max(found.high - value, value - found.low)
    return "determined" if sound and farther <= 1.96 * ROUGH * max(abs(value), c.typical) else "weak"


def _unseen(c: Coordinate, local: Local, i: int) -> Row:
    """A value that a search left where it was, or a prior put there: it has no standard error and leans on no bound."""
    return {**_row(c, local, i), "at_bound": None}


def _status(c: Coordinate, value: float, error: float, size: float) -> str:
    """How well the data fix an entry of a table or one of many coordinates, by the value as where ranges are; the
    box has no part in it."""
    if not error <= size:
        return "flat"
    return "weak" if error > ROUGH * max(abs(value), c.typical) else "determined"


def _fixed(name: str, p: Parameter, index: tuple[int, ...], value: float) -> Row:
    return {
        "name": f"{name}[{','.join(map(str, index))}]" if index else name,
        "parameter": name,
        "recording": None,
        "index": list(index),
        "unit": p.unit,
        "value": value,
        "standard_error": None,
        "low": None,
        "high": None,
        "lower_bound": None,
        "upper_bound": None,
        "scale": p.scale,
        "at_bound": None,
        "status": "fixed",
    }


def _signal_units(model: Any) -> Mapping[str, str | None]:
    """Units of what tables may be over: signals, their delayed copies, time."""
    if not isinstance(model, Model):
        return {}
    late = {d.channel: model.inputs[d.input] for d in model.delays} | {
        d.channel: model.states[d.state] for d in model.state_delays
    }
    return {"t": "s", **late, **model.outputs, **model.states, **model.inputs}
