"""What `plantfit compare` was given: study files or stored studies, and whether models or methods are compared."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plantfit.cli.commands.understand.stored import is_number, number_of
from plantfit.errors import SearchError


def compare(
    given: Sequence[str], store: str, place: str, latex: str | None, table: str | None, asked: Sequence[float],
    floor: float | None,
    optimum: float | None, seed: int, models: bool | None, linear: bool, workers: str | None, json: bool,
) -> None:  # fmt: skip
    """Models where study files are given, or studies of different models that one method searched; else methods."""
    from plantfit.cli.commands.understand import methods
    from plantfit.cli.commands.understand import models as of_models

    files = [g for g in given if not is_number(g) and (g.endswith(".toml") or Path(g).is_file())]
    if files and models is False:
        raise SearchError(
            "--methods compares the runs of stored studies, and "
            f"{files[0]!r} is a study file; give numbers or names of studies."
        )
    if files or models:
        for option, value in (
            ("--latex", latex),
            ("--csv", table),
            ("--floor", floor),
            ("--optimum", optimum),
            ("--target", asked or None),
        ):
            if value is not None:
                raise SearchError(f"{option} is for comparisons of search methods, and these are models; leave it out.")
        return of_models.compare_models(given, files, store, place, linear, workers, json)
    numbers = [number_of(g, store) for g in given]
    if models is None and latex is None and table is None and not asked and _of_models(numbers, store):
        return of_models.compare_models(given, [], store, place, linear, workers, json)
    return methods.compare(numbers, store, place, latex, table, asked, floor, optimum, seed, json)


def _of_models(numbers: Sequence[int], store: str) -> bool:
    """Whether stored studies are different models of the same data that one method searched: methods cannot be what
    is asked for."""
    if len(set(numbers)) < 2:
        return False
    from plantfit.errors import PlantfitError
    from plantfit.study import Store

    opened = Store.open(store, create=False)
    records = [opened.study(n) for n in dict.fromkeys(numbers)]
    methods = {m for r in records for m in r.plan["methods"]}
    texts: set[Any] = {r.spec_text for r in records}
    if len(methods) > 1 or None in texts or len(texts) < len(records):
        return False
    from plantfit.reopen import study_of
    from plantfit.trust.which_model.common_data import shared_data

    try:
        shared_data({str(r.id): study_of(r).problem for r in records})
    except PlantfitError:
        return False
    return True
