"""`plantfit estimate`: the parameters of a study by several methods."""

import gzip
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plantfit.cli.arguments.file_names import file_name
from plantfit.cli.commands.understand.fitted import answers_of, one_given
from plantfit.cli.terminal.out import out, print_json, said_line, verdict
from plantfit.cli.terminal.working import worker_count
from plantfit.errors import SpecError, StoreError
from plantfit.recording.write import to_csv

if TYPE_CHECKING:
    from plantfit.problem.problem import Problem

STATES, LONGEST = "States by the", 200  # what a file of states begins with, within so many characters


def estimate(
    given: str,
    methods: Sequence[str],
    store: str,
    place: str | None,
    states: str | None,
    workers: str | None,
    json: bool,
) -> None:
    """Estimate the parameters of a study; fits it first if the store has no answer of it."""
    from plantfit.report.html import check_place

    worker_count(workers, None)
    if place is not None:
        check_place(Path(place))
    from plantfit.estimators import check_estimable, estimate_parameters

    wishes: dict[str, Any] = {"methods": list(methods)} if methods else {}

    def checked(problem: "Problem") -> None:
        table, _ = check_estimable(problem, wishes)
        if states is not None:
            _check_states(_states_files(problem, Path(states)).values(), table.methods)

    opened, one = one_given(given, store, checked)
    answers, numbers = answers_of(opened, [one], workers, json)
    with said_line(json) as say:
        table = one.ready.study.table.estimate.model_dump(exclude_unset=True)
        found = estimate_parameters(answers[given], progress=say, table=table, **wishes)
    written = {} if place is None else {"report": str(found.report(Path(place)))}
    if states is not None:
        files = _states_files(found.problem, Path(states))
        written |= {
            f"states over {n}" if len(files) > 1 else "states": str(to_csv(found.states(n), file))
            for n, file in files.items()
        }
    if json:
        return print_json(found.typed.printed(study=numbers[given], written=written))
    out.print(found.table() + "\n", markup=False)
    verdict(found.record)
    if found.typed.assumed:
        out.print("\nAssumed, as the study file does not say ([estimate], docs/kalman.md):", markup=False)
        for sentence in found.typed.assumed:
            out.print(f"  {sentence}", markup=False)
    if written:
        out.print("", markup=False)
    for what, file in written.items():
        out.print(f"{what[0].upper()}{what[1:]}: {file}", markup=False)


def _states_files(problem: "Problem", file: Path) -> dict[str, Path]:
    """The file of states of each fitted recording: `file` of one, with the recording's name added of several."""
    names = [n for n, e in problem.experiments.items() if e.mask("fit").any()]
    return {
        n: file if len(names) == 1 else file.with_name(file_name(f"{file.stem}-{n}", file.suffix.lstrip(".") or "csv"))
        for n in names
    }


def _check_states(files: Iterable[Path], methods: Sequence[str]) -> None:
    """Before anything is computed: raise StoreError where states could not be written, or would be written over
    something else, SpecError where no filter is among the methods."""
    from plantfit.estimate.methods.filtered import FILTERS

    if not FILTERS.keys() & set(methods):
        raise SpecError(
            f"--states: no filter is among the methods {list(methods)}, "
            "so there are no states; add --method ekf, ukf or kalman."
        )
    for file in files:
        if not file.parent.is_dir():
            raise StoreError(f"--states {file}: there is no folder {file.parent}; create it or give another place.")
        if file.exists() and not _holds_states(file):
            raise StoreError(f"--states {file} exists already and holds no states; give another place.")


def _holds_states(file: Path) -> bool:
    try:
        with gzip.open(file, "rt", encoding="utf-8") if file.suffix == ".gz" else file.open(encoding="utf-8") as opened:
            return STATES in opened.readline(LONGEST)
    except (OSError, EOFError, UnicodeDecodeError):
        return False
