"""Rows of the database to records and back."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from sqlalchemy import Row

from plantfit.errors import Status
from plantfit.study.codec import PACKED, from_blob, from_json, pack, to_blob, to_json, unpack
from plantfit.study.records import RunRecord, StudyRecord

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
    """The inverse of `run_row`."""
    return RunRecord(
        method=row.method,
        run=row.run,
        seed=row.seed,
        x=from_blob(row.x),
        cost=_cost(row),
        parameters=from_json(row.parameters),
        evaluations=row.evaluations,
        seconds=row.seconds,
        status=Status(row.status),
        failures=row.failures,
        history_evaluations=unpack(row.history_evaluations, row.packing),
        history_cost=unpack(row.history_cost, row.packing),
        extra=from_json(row.extra),
    )


def _cost(row: Row) -> float:
    if row.cost_bits is not None:
        return float(from_blob(row.cost_bits)[0])
    return float("nan") if row.cost is None else row.cost


def study_record(row: Row, held: bool, runs_done: int) -> StudyRecord:
    """A study as it is now: a killed worker could not set the state."""
    plan = from_json(row.plan)
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
