"""`plantfit compare` of models: what is not yet fitted is fitted, then all are compared."""

from collections.abc import Sequence
from pathlib import Path

from plantfit.cli.commands.understand.fitted import Fitted, answers_of, from_file, from_store
from plantfit.cli.commands.understand.stored import number_of
from plantfit.cli.terminal.out import out, print_json, verdict
from plantfit.cli.terminal.working import worker_count
from plantfit.errors import SearchError


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
        raise SearchError("One model alone cannot be compared; give two or more, or leave --no-linear out.")
    check_place(Path(place))
    read = {g: specs.load(g) for g in given if g in files}
    opened = Store.open(store, create=bool(files))
    names = _names(given, files)
    chosen = [
        from_file(opened, names[g], read[g]) if g in read else from_store(opened, names[g], number_of(g, store))
        for g in given
    ]
    _same_data(chosen)  # said before anything is fitted
    answers, numbers = answers_of(opened, chosen, workers, json)
    from plantfit.which_model import compare_models as compared

    found = compared(answers, linear=linear)
    path = found.report(place)
    if json:
        return print_json(found.typed.printed(studies=numbers, written={"report": str(path)}))
    verdict(found.record)
    out.print("\n" + found.table(), markup=False)
    out.print(f"\nReport: {path}", markup=False)


def _names(given: Sequence[str], files: Sequence[str]) -> dict[str, str]:
    """Names of files where these differ, else what was given; a stored study by its number or name."""
    short = {g: Path(g).name if g in files else f"study {g}" if g.isdigit() else g for g in given}
    repeated = {s for s in short.values() if list(short.values()).count(s) > 1}
    return {g: g if s in repeated else s for g, s in short.items()}


def _same_data(chosen: Sequence[Fitted]) -> None:
    from plantfit.trust.which_model.common_data import shared_data

    shared_data({m.name: m.ready.prepared.problem for m in chosen})
