"""Rows of the database to records and back."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from sqlalchemy import Row

from plantfit.errors import Status
from plantfit.study.store.codec import PACKED, from_blob, from_json, pack, to_blob, to_json, unpack
from plantfit.study.store.records import RunRecord, StudyRecord

if TYPE_CHECKING:
    from plantfit.optimize.contract import RunResult


def run_row(study: int, result: "RunResult | RunRecord", parameters: Mapping[str, float]) -> dict[str, Any]:
    """Columns of table run."""
    cost = float(result.cost)
    return {
        "study": study,
        "method": result.method,
        "run": int(result.run),
        "seed": int(result.seed),
        "cost": None if np.isnan(cost) else cost,
        "cost_bits": to_blob([cost]),
        "x": to_blob(result.x),
        "parameters": to_json(parameters),
        "evaluations": float(result.evaluations),
        "seconds": float(result.seconds),
        "status": Status(result.status).value,
        "failures": int(result.failures),
        "packing": PACKED,
        "history_evaluations": pack(result.history_evaluations),
        "history_cost": pack(result.history_cost),
        "extra": to_json(result.extra),
    }


def run_record(row: Row) -> RunRecord:
    """The inverse of `run_row`; TypeError or ValueError for a row with anything else in it, which SQLite lets in."""
    for name, kind in _KINDS.items():
        if isinstance(value := getattr(row, name), bool) or not isinstance(value, kind):
            raise TypeError(f"run {row.run!r}: {name} is {value!r:.60}")
    parameters, extra = from_json(row.parameters), from_json(row.extra)
    if (
        not isinstance(extra, dict)
        or not isinstance(parameters, dict)
        or not all(_is_number(v) for v in parameters.values())
    ):
        raise TypeError(f"run {row.run}: its parameters or extras are no table of numbers")
    return RunRecord(
        method=row.method,
        run=row.run,
        seed=row.seed,
        x=from_blob(row.x),
        cost=_cost(row),
        parameters=parameters,
        evaluations=row.evaluations,
        seconds=row.seconds,
        status=Status(row.status),
        failures=row.failures,
        history_evaluations=unpack(row.history_evaluations, row.packing),
        history_cost=unpack(row.history_cost, row.packing),
        extra=extra,
    )


_KINDS = {
    "method": str, "run": int, "seed": int, "cost": float | int | None, "cost_bits": bytes | None, "x": bytes,
    "parameters": str,
    "evaluations": float | int, "seconds": float | int, "status": str, "failures": int, "packing": int,
    "history_evaluations": bytes, "history_cost": bytes, "extra": str,
}  # fmt: skip


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _cost(row: Row) -> float:
    if row.cost_bits is not None:
        return float(from_blob(row.cost_bits)[0])
    return float("nan") if row.cost is None else row.cost


def study_record(row: Row, held: bool, runs_done: int) -> StudyRecord:
    """A study as it is now: a killed worker could not set the state."""
    plan = from_json(row.plan)
    texts = (row.name, row.created, row.state, row.cpu, row.spec or "", row.spec_path or "", *plan["methods"])
    if not all(isinstance(t, str) for t in texts) or not isinstance(row.probe, bytes):
        raise TypeError("a column is of another kind")
    runs_total = plan["runs"] * len(plan["methods"])
    unfinished = "interrupted" if row.state == "running" and not held else row.state
    return StudyRecord(
        id=row.id,
        name=row.name,
        created=row.created,
        state="done" if runs_done == runs_total else unfinished,
        plan=plan,
        spec_text=row.spec,
        spec_path=row.spec_path,
        coordinates=tuple(from_json(row.coordinates)),
        versions=from_json(row.versions),
        cpu=row.cpu,
        notes=tuple(from_json(row.notes)),
        runs_done=runs_done,
        runs_total=runs_total,
    )
