"""`plantfit estimate`: the parameters of a study by several methods."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plantfit.cli.arguments.file_names import file_name
from plantfit.cli.commands.understand.fitted import answers_of, one_given
from plantfit.cli.terminal.out import out, print_json, said_line, verdict
from plantfit.cli.terminal.working import worker_count
from plantfit.errors import StoreError

if TYPE_CHECKING:
    from plantfit.estimators import Estimators

STATES = "States by the"  # begins the file


def estimate(
    given: str, methods: Sequence[str], store: str, place: str | None, states: str | None, workers: str | None, json: bool
) -> None:
    """Estimate the parameters of a study; fits it first if the store has no answer of it."""
    from plantfit.report.html import check_place

    worker_count(workers, None)
    if place is not None:
        check_place(Path(place))
    if states is not None:
        _check_states(Path(states))
    from plantfit.estimators import check_estimable, estimate_parameters

    wishes: dict[str, Any] = {"methods": list(methods)} if methods else {}
    opened, one = one_given(given, store, lambda problem: check_estimable(problem, wishes))
    answers, numbers = answers_of(opened, [one], workers, json)
    with said_line(json) as say:
        table = one.ready.study.table.estimate.model_dump(exclude_unset=True)
        found = estimate_parameters(answers[given], progress=say, table=table, **wishes)
    written = {} if place is None else {"report": str(found.report(Path(place)))}
    if states is not None:
        written |= _write_states(found, Path(states))
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


def _check_states(file: Path) -> None:
    """Raise StoreError where states could not be written, or would be written over something else."""
    if not file.parent.is_dir():
        raise StoreError(f"--states {file}: there is no folder {file.parent}; create it or give another place.")
    with suppress(FileNotFoundError, UnicodeDecodeError):
        if file.is_dir() or STATES not in file.read_text("utf-8").split("\n", 1)[0]:
            raise StoreError(f"--states {file} exists already and holds no states; give another place.")


def _write_states(found: "Estimators", file: Path) -> dict[str, str]:
    """Write the states over every recording by the first filter: the file of each, by what it holds."""
    from plantfit import recording as rec

    found.states()  # refuses where no filter ran
    names = list(next(iter(found.runs.values())))
    if len(names) == 1:
        return {"states": str(rec.to_csv(found.states(names[0]), file))}
    places = {n: file.with_name(file_name(f"{file.stem}-{n}", "csv")) for n in names}
    for place in places.values():
        _check_states(place)
    return {f"states over {n}": str(rec.to_csv(found.states(n), place)) for n, place in places.items()}
