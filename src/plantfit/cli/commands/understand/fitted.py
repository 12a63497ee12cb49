"""Answers that a comparison needs: those of the store where there are, else fitted now and kept there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plantfit.cli.commands.understand.stored import number_of
from plantfit.cli.terminal.out import warn
from plantfit.cli.terminal.working import Ready, ready, search
from plantfit.errors import Interrupted, StoreError

if TYPE_CHECKING:
    from plantfit.problem.problem import Problem
    from plantfit.study.store.records import StudyRecord
    from plantfit.study.store.store import Store


@dataclass(frozen=True)
class Fitted:
    """A study to compare: its name in the comparison, its study prepared, and whether the store has its answer."""

    name: str
    ready: Ready
    fitted: bool


def one_given(
    given: str, store: str, check: Callable[["Problem"], object] = lambda problem: None
) -> tuple["Store", Fitted]:
    """The store and the study that a file, a number or a name gives; `check` refuses problems before anything is
    prepared or made.

    Raises SpecError, StoreError, and what `check` raises.
    """
    from plantfit import spec as specs
    from plantfit.study import Store

    file = given.endswith(".toml") or Path(given).is_file()
    if not file:
        opened = Store.open(store, create=False)
        one = from_store(opened, given, number_of(given, store))
        check(one.ready.study.problem)
        return opened, one
    study = specs.load(given)
    check(study.problem)
    opened = Store.open(store, create=True)
    return opened, from_file(opened, given, study)


def from_file(opened: "Store", name: str, study: Any) -> Fitted:
    """A study file, with its study in the store where there is one of the same wording, data and bounds."""
    from plantfit.study.running.probe import check_same, probe

    one = ready(study, None)
    now = probe(one.prepared.objective, one.prepared.to_physical)
    same = [r for r in reversed(opened.studies()) if r.spec_text == study.text]
    for record in sorted(same, key=lambda r: r.state != "done"):
        try:
            check_same(opened.probe(record.id), now, record.id)
        except StoreError:
            continue  # the recordings have changed
        return Fitted(name, Ready(study, one.prepared, record.id), record.state == "done")
    return Fitted(name, one, False)


def from_store(opened: "Store", name: str, number: int) -> Fitted:
    """A stored study."""
    from plantfit.reopen import study_of

    record = opened.study(number)
    return Fitted(name, ready(study_of(record), number), record.state == "done")


def answers_of(
    opened: "Store", chosen: Sequence[Fitted], workers: str | None, json: bool
) -> tuple[dict[str, Any], dict[str, int | None]]:
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
    made = {}
    for m in chosen:
        seconds = {"prepare": m.ready.prepared.seconds}
        made[m.name] = answer_of(opened, opened.study(numbers[m.name] or 0), m.ready.study, seconds, m.ready.prepared)
    return made, numbers
