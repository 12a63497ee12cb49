"""`plantfit compare` of models: what is not yet fitted is fitted, then all are compared."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plantfit.cli.commands.comparing.stored import number_of
from plantfit.cli.terminal.out import out, print_json, verdict, warn
from plantfit.cli.terminal.working import Ready, ready, search, worker_count
from plantfit.errors import Interrupted, SearchError, StoreError

if TYPE_CHECKING:
    from plantfit.study.store.records import StudyRecord
    from plantfit.study.store.store import Store


@dataclass(frozen=True)
class Model:
    """A model to compare: its name in the comparison, its study prepared, and whether the store has its answer."""

    name: str
    ready: Ready
    fitted: bool


def compare_models(
    given: Sequence[str], files: Sequence[str], store: str, place: str, linear: bool, workers: str | None, json: bool
) -> None:
    """Compare study files and stored studies as models of the same data."""
    from plantfit import spec as specs
    from plantfit.report.html import check_place
    from plantfit.study import Store

    worker_count(workers, None)
    if len(set(given)) < len(given):
        raise SearchError(f"{next(g for g in given if list(given).count(g) > 1)} is given twice; give each model once.")
    if len(given) + linear < 2:
        raise SearchError("One model alone is compared with nothing; give two or more, or leave --no-linear out.")
    check_place(Path(place))
    read = {g: specs.load(g) for g in given if g in files}
    opened = Store.open(store, create=bool(files))
    names = _names(given, files)
    chosen = [_from_file(opened, names[g], read[g]) if g in read else _stored(opened, names[g], number_of(g, store)) for g in given]
    _same_data(chosen)  # said before anything is fitted
    answers, numbers = _answers(opened, chosen, workers, json)
    from plantfit.which_model import compare_models as compared

    found = compared(answers, linear=linear)
    path = found.report(place)
    if json:
        short = {k: v for k, v in found.record.items() if k != "series"}
        return print_json({**short, "studies": numbers, "written": {"report": str(path)}})
    verdict(dict(found.record))
    out.print("\n" + found.table(), markup=False)
    out.print(f"\nReport: {path}", markup=False)


def _names(given: Sequence[str], files: Sequence[str]) -> dict[str, str]:
    """Names of files where these differ, else what was given; a stored study by its number or name."""
    short = {g: Path(g).name if g in files else f"study {g}" if g.isdigit() else g for g in given}
    repeated = {s for s in short.values() if list(short.values()).count(s) > 1}
    return {g: g if s in repeated else s for g, s in short.items()}


def _from_file(opened: "Store", name: str, study: Any) -> Model:
    """A study file, with its study in the store where there is one of the same wording, data and bounds."""
    from plantfit.study.running.probe import check_same, probe

    one = ready(study, None)
    now = probe(one.objective, one.problem.space.physical)
    same = [r for r in reversed(opened.studies()) if r.spec_text == study.text]
    for record in sorted(same, key=lambda r: r.state != "done"):
        try:
            check_same(opened.probe(record.id), now, record.id)
        except StoreError:
            continue  # the recordings have changed
        return Model(name, Ready(study, one.problem, one.objective, record.id, one.seconds), record.state == "done")
    return Model(name, one, False)


def _stored(opened: "Store", name: str, number: int) -> Model:
    from plantfit.reopen import study_of

    record = opened.study(number)
    return Model(name, ready(study_of(record), number), record.state == "done")


def _same_data(chosen: Sequence[Model]) -> None:
    from plantfit.trust.which_model.common_data import shared_data

    shared_data({m.name: m.ready.problem for m in chosen})


def _answers(opened: "Store", chosen: Sequence[Model], workers: str | None, json: bool) -> tuple[dict[str, Any], dict[str, int | None]]:
    """The answers and the numbers of their studies by name; fits what has none."""
    from plantfit.reopen import answer_of

    left = [m for m in chosen if not m.fitted]
    numbers = {m.name: m.ready.number for m in chosen if m.fitted}
    for m in chosen:
        if m.fitted and not json:
            warn(f"{m.name}: study {m.ready.number} has its answer.")
    if left:
        found, stopped = search(opened, [m.ready for m in left], workers, None, json)
        records: list[StudyRecord] = [opened.study(n) for n in found]
        if stopped and any(r.state != "done" for r in records):
            raise Interrupted("Stopped; what was found is saved, and the same command goes on from there.")
        numbers |= {m.name: n for m, n in zip(left, found, strict=True)}
    made = {
        m.name: answer_of(opened, opened.study(numbers[m.name] or 0), m.ready.study, {"prepare": m.ready.seconds}, m.ready.problem)
        for m in chosen
    }
    return made, numbers
