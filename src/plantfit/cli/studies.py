"""`plantfit run`, `resume`, `list` and `report`."""

import shlex
import time
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.cli.out import out, print_json, progress_line, stoppable, verdict, warn
from plantfit.errors import Interrupted, StoreError


def run(spec: str, store: str, place: str | None, json: bool) -> None:
    """Run a study file from its beginning."""
    from plantfit import spec as specs
    from plantfit.study import Store

    study = specs.load(spec)
    opened = Store.open(store)
    _work(study, opened, store, place, json, None)


def resume(number: int | None, store: str, place: str | None, json: bool) -> None:
    """Go on with an unfinished study."""
    from plantfit.study import Store

    opened = Store.open(store, create=False)
    record = _record(opened, number, store, unfinished=number is None)
    _work(_study(record), opened, store, place, json, record.id)


def listed(store: str, json: bool) -> None:
    """Studies of a store, newest last."""
    from plantfit.study import Store

    records = Store.open(store, create=False).studies()
    if json:
        return print_json(
            [
                {
                    "id": r.id,
                    "name": r.name,
                    "created": r.created,
                    "state": r.state,
                    "methods": list(r.plan["methods"]),
                    "runs_done": r.runs_done,
                    "runs": r.runs_total,
                }
                for r in records
            ]
        )
    if not records:
        return out.print(f"{store} holds no study yet; start one with `plantfit run STUDY.toml`.", markup=False)
    from rich.table import Table

    table = Table("id", "name", "created", "state", "methods", "runs", box=None)
    for r in records:
        table.add_row(str(r.id), r.name, r.created[:19], r.state, ", ".join(r.plan["methods"]), f"{r.runs_done}/{r.runs_total}")
    out.print(table)


def report(number: int | None, store: str, place: str | None, json: bool) -> None:
    """The report of a stored study."""
    from plantfit.study import Store

    opened = Store.open(store, create=False)
    record = _record(opened, number, store)
    study = _study(record)
    answer = _answer(study, opened, record.id, store, {})
    _deliver(answer, place, study.name, json)


def _work(study, opened, store: str, place: str | None, json: bool, number: int | None) -> None:
    from plantfit import study as studies
    from plantfit.fitting import prepare

    started = time.perf_counter()
    problem = prepare(study.problem)
    prepared = time.perf_counter()
    common: dict[str, Any] = {"to_physical": problem.space.physical}
    with progress_line(json) as tell, stoppable() as stop:
        if number is None:
            number = studies.run(
                study.plan, studies.objective_of(problem), opened, spec_text=study.text, spec_path=str(study.path.resolve()),
                coordinates=problem.space.names, progress=tell, stop=stop, **common,
            )  # fmt: skip
        else:
            studies.resume(opened, number, studies.objective_of(problem), progress=tell, stop=stop, **common)
        stopped = stop()
    record = opened.study(number)
    if record.state != "done" and stopped:
        where = "" if store == "plantfit.db" else f" --store {shlex.quote(store)}"
        raise Interrupted(
            f"study {number} ({study.name}) is saved with {record.runs_done} of {record.runs_total} runs done; "
            f"go on with `plantfit resume {number}{where}`."
        )
    seconds = {"prepare": prepared - started, "search": time.perf_counter() - prepared}
    _deliver(_answer(study, opened, number, store, seconds), place, study.name, json)


def _answer(study, opened, number: int, store: str, seconds):
    from plantfit.fitting import Answer, finish, prepare
    from plantfit.optimize.contract import RunResult

    problem = prepare(study.problem)
    results = [
        RunResult(
            r.method,
            r.run,
            r.seed,
            np.asarray(r.x),
            r.cost,
            r.evaluations,
            r.seconds,
            r.status,
            r.history_evaluations,
            r.history_cost,
            r.failures,
            dict(r.extra),
        )
        for r in opened.runs(number)
    ]
    if not results:
        raise StoreError(f"Study {number} in {store} has no finished run yet; go on with `plantfit resume {number}`.")
    problem, results = finish(problem, results, study.plan.seed)
    return Answer(problem, results, study.plan.seed, study.text, f"plantfit run {study.path.name}", seconds)


def _deliver(answer, place: str | None, name: str, json: bool) -> None:
    path = answer.report(place or f"{name}.html")
    if json:
        return print_json({**_short(answer.findings), "report": str(path)})
    verdict(answer.findings)
    out.print(f"\nReport: {path}", markup=False)


def _short(findings: dict[str, Any]) -> dict[str, Any]:
    """The findings without the samples."""
    return {**findings, "recordings": [{"name": r["name"], "log": r["log"]} for r in findings["recordings"]]}


def _record(opened, number: int | None, store: str, unfinished: bool = False):
    records = opened.studies()
    if number is not None:
        return opened.study(number)
    chosen = [r for r in records if r.state != "done"] if unfinished else records
    if not chosen:
        what = "no unfinished study" if unfinished else "no study"
        raise StoreError(f"{store} holds {what}; see `plantfit list` or start one with `plantfit run STUDY.toml`.")
    return chosen[-1]


def _study(record):
    from plantfit import spec as specs

    if not record.spec_text:
        raise StoreError(f"Study {record.id} was made from Python without a study file; use its script to go on.")
    path = Path(record.spec_path or f"{record.name}.toml")
    if path.is_file() and path.read_text(encoding="utf-8") != record.spec_text:
        warn(f"{path.name} has changed since study {record.id} was started; the stored wording is used.")
    return specs.parse(record.spec_text, path)
