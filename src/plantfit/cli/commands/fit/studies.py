"""`plantfit run`, `resume`, `list` and `report`."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plantfit.cli.arguments.file_names import file_name, report_places
from plantfit.cli.commands.begin.check import say_looks
from plantfit.cli.commands.understand.stored import number_given
from plantfit.cli.terminal.interrupts import saying, stoppable
from plantfit.cli.terminal.out import doing, out, print_json, said_line, verdict, warn
from plantfit.cli.terminal.working import ready, search, worker_count
from plantfit.errors import Interrupted, SpecError, StoreError
from plantfit.study.store.addresses import shown, store_option

if TYPE_CHECKING:
    from plantfit.answer import Answer
    from plantfit.spec import Study


def run(
    paths: Sequence[str], store: str, place: str | None, json: bool, workers: str | None, scheduler: str | None,
    additions: Sequence[str] = (), pieces: float | None = None, diagnose: bool = True,
) -> None:  # fmt: skip
    """Run study files from their beginning; with `additions` the one file with these added to its model, with
    `pieces` (s) the one file with its recordings in pieces."""
    from plantfit import spec as specs

    worker_count(workers, scheduler)  # what cannot work is said before anything is read
    if pieces is not None and (len(paths) > 1 or additions):
        raise SpecError("--pieces changes one study file; give one, without --try.")
    if additions:
        if len(paths) > 1:
            raise SpecError("--try changes one study file; give one, or run the others by themselves.")
        from plantfit.cli.commands.understand.diagnose import added

        paths = [added(paths[0], additions, json)]
        if not json:
            out.print(f"Runs {paths[0]}, the study file with {' and '.join(additions)}.", markup=False)
    if pieces is not None:
        from plantfit.cli.commands.fit.pieces import cut

        paths = [cut(paths[0], pieces, json)]
        if not json:
            out.print(f"Runs {paths[0]}, the study file in pieces of {pieces:g} s.", markup=False)
    read = [specs.load(path) for path in paths]
    solved = [study for study in read if study.regression is not None]
    if solved and len(solved) < len(read):
        raise SpecError(
            f"{solved[0].path.name} has a table [regression] and is solved "
            "at once, the others are searched; run them by themselves."
        )
    if solved:
        return _solve(solved, place, json)
    from plantfit.study import Store  # sqlalchemy, after the study files were understood

    places = report_places([study.name for study in read], place)
    _work([ready(study, None) for study in read], Store.open(store), store, places, json, workers, scheduler, diagnose)


def _solve(read: Sequence[Any], place: str | None, json: bool) -> None:
    """Studies that need no search."""
    from plantfit.cli.terminal.regressed import solved

    places = report_places([study.name for study in read], place)
    said = [solved(study, to, json) for study, to in zip(read, places, strict=True)]
    if json:
        print_json(said if len(said) > 1 else said[0])


def resume(
    numbers: Sequence[int],
    store: str,
    place: str | None,
    json: bool,
    workers: str | None,
    scheduler: str | None,
    diagnose: bool = True,
) -> None:
    """Go on with unfinished studies."""
    from plantfit.study import Store

    worker_count(workers, scheduler)
    opened = Store.open(store, create=False)
    records = [opened.study(n) for n in dict.fromkeys(numbers)] or [_record(opened, None, store, unfinished=True)]
    read = [_study(record) for record in records]
    places = report_places([study.name for study in read], place)
    chosen = [ready(study, record.id) for study, record in zip(read, records, strict=True)]
    _work(chosen, opened, store, places, json, workers, scheduler, diagnose)


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
        return out.print(f"{shown(store)} holds no study yet; start one with `plantfit run STUDY.toml`.", markup=False)
    from rich.table import Table

    table = Table("id", "name", "created", "state", "methods", "runs", box=None)
    for r in records:
        table.add_row(
            str(r.id), r.name, r.created[:19], r.state, ", ".join(r.plan["methods"]), f"{r.runs_done}/{r.runs_total}"
        )
    out.print(table)


def report(given: str | None, store: str, place: str | None, json: bool, diagnose: bool = True) -> None:
    """The report of a stored study."""
    study, answer = stored_answer(given, store)
    (to,) = report_places([study.name], place)
    said = _deliver(answer, to, study, json, diagnose)
    if json:
        print_json(said)


def stored_answer(given: str | None, store: str) -> "tuple[Study, Answer]":
    """A stored study, by number, name or file (the newest where nothing is given), and its answer."""
    from plantfit.study import Store

    opened = Store.open(store, create=False)
    record = _record(opened, number_given(given, store), store)
    study = _study(record)
    return study, _answer(study, opened, record.id, {})


def _work(
    chosen,
    opened,
    store: str,
    places: Sequence[Path],
    json: bool,
    workers: str | None,
    scheduler: str | None,
    diagnose: bool,
) -> None:
    started = time.perf_counter()
    numbers, stopped = search(opened, chosen, workers, scheduler, json)
    searched = time.perf_counter() - started
    records = [opened.study(number) for number in numbers]
    if stopped and any(r.state != "done" for r in records):
        raise Interrupted(_saved([r for r in records if r.state != "done"], store))
    said = []
    for one, number, place in zip(chosen, numbers, places, strict=True):
        seconds = {"prepare": one.prepared.seconds, "search": searched}
        with saying(_searched(number, store)):
            answer = _answer(one.study, opened, number, seconds, one.prepared)
            said.append(_deliver(answer, place, one.study, json, diagnose, len(chosen) > 1))
    if json:
        print_json(said if len(said) > 1 else said[0])


def _searched(number: int, store: str) -> str:
    """What Ctrl-C leaves of a study whose runs are done."""
    again = f"`plantfit report {number}{store_option(store)}`"
    return f"Stopped by {{cause}}. All runs of study {number} are kept; {again} works out what they are worth."


def _saved(records, store: str) -> str:
    where = store_option(store)
    each = [f"study {r.id} ({r.name}) is saved with {r.runs_done} of {r.runs_total} runs done" for r in records]
    return f"{', '.join(each)}; go on with `plantfit resume {' '.join(str(r.id) for r in records)}{where}`."


def _answer(study, opened, number: int, seconds, prepared=None):
    from plantfit.reopen import answer_of

    with doing(f"{study.name}: finishes its runs with finer steps and checks the answer"):
        return answer_of(opened, opened.study(number), study, seconds, prepared)


def _deliver(answer, place: Path, study, json: bool, diagnose: bool, several: bool = False) -> dict[str, Any]:
    """Judge, diagnose, write the report and say the verdict; gives back what `--json` prints."""
    from plantfit.recording.looks.look import IN_VERDICT, MISREAD
    from plantfit.report import uncertainty_text

    name = study.name
    if answer.errors and answer.draws:
        warn(f"{name}: carrying the stated errors to the parameters by {answer.draws} fits.")
    with doing(f"{name}: works out what the data determine"):
        _ = answer.findings
    if diagnose and study.table.diagnose:
        _diagnosed(answer, study, json)
    path = answer.report(place)
    if not json:
        if several:
            out.print(f"\n{name}", markup=False, style="bold")
        verdict(answer.findings)
        say_looks([look for look in answer.findings["data"] if look["kind"] not in {*IN_VERDICT, *MISREAD}])
        if answer.errors:
            out.print(f"\n{uncertainty_text(answer.findings)}", markup=False)
        if (answer.findings["diagnosis"] or {}).get("next"):
            out.print(f"\nNext: {answer.findings['diagnosis']['next']}", markup=False)
        out.print(f"\nReport: {path}", markup=False)
    return {**_short(answer.findings), "report": str(path)}


def _diagnosed(answer, study, quiet: bool) -> None:
    """Look for what is missing in the model where the findings ask for it. The answer is kept already: Ctrl-C ends
    the diagnosis alone."""
    from plantfit.spec import before_filter
    from plantfit.trust.diagnosis import asked_for

    regression = before_filter(study) if asked_for(answer.findings) else None
    with (
        said_line(quiet) as tell,
        stoppable("Stopping the diagnosis; the answer is kept. Ctrl-C again stops at once.", lambda: _KEPT) as stop,
    ):
        answer.diagnose(
            progress=None if tell is None else lambda text: tell(f"diagnosis: {text}"), stop=stop, regression=regression
        )


_KEPT = "Stopped at once; the study is kept, and `plantfit report` writes its report."


def _short(findings: dict[str, Any]) -> dict[str, Any]:
    """The findings without the samples."""
    short = {**findings, "recordings": [{"name": r["name"], "log": r["log"]} for r in findings["recordings"]]}
    if findings["diagnosis"] is not None:
        short["diagnosis"] = {k: v for k, v in findings["diagnosis"].items() if k != "residuals"}
    return short


def _record(opened, number: int | None, store: str, unfinished: bool = False):
    records = opened.studies()
    if number is not None:
        return opened.study(number)
    chosen = [r for r in records if r.state != "done"] if unfinished else records
    if not chosen:
        what = "no unfinished study" if unfinished else "no study"
        raise StoreError(
            f"{shown(store)} holds {what}; see `plantfit list` or start one with `plantfit run STUDY.toml`."
        )
    return chosen[-1]


def _differs(path: Path, text: str) -> bool:
    """Whether the file is there and says something else, as a file that is no text does."""
    try:
        return path.is_file() and path.read_text(encoding="utf-8-sig", errors="replace") != text.removeprefix("\ufeff")
    except (OSError, ValueError):
        return False


def _study(record):
    from plantfit.reopen import study_of

    study = study_of(record, file_name(record.name, "toml"))
    if _differs(study.path, record.spec_text):
        warn(f"{study.path.name} has changed since study {record.id} was started; the stored wording is used.")
    return study
