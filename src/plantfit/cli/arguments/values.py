"""Parameter values that a command works at: given on the command line, else those of a stored study."""

import math
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from plantfit.cli.arguments.assignments import numbers_by_name
from plantfit.cli.terminal.out import warn
from plantfit.errors import SpaceError, StoreError

if TYPE_CHECKING:
    from plantfit.problem.problem import Problem


def values_at(problem: "Problem", texts: Sequence[str], study: str, number: int | None, store: str) -> dict[str, float]:
    """By coordinate name: NAME=VALUE `texts` of --set; what they leave out from study `number`, else the newest named
    `study`. A stored study of another problem than this prepared one is told on standard error.

    Raises SpaceError for an unknown name, StoreError where values are missing and no study has them.
    """
    named, names = numbers_by_name("--set", texts), problem.space.names
    for name in named:
        if name not in names:
            raise SpaceError(f"--set {name} names no free parameter; the free ones are {list(names)}.")
    return named if set(named) == set(names) else {**_stored(problem, study, number, store, {*named}), **named}


def _stored(problem: "Problem", name: str, number: int | None, store: str, given: Collection[str]) -> dict[str, float]:
    from plantfit.study import Store
    from plantfit.study.store.addresses import shown

    opened = Store.open(store, create=False)
    own = [r for r in opened.studies() if (r.id == number if number is not None else r.name == name)]
    if not own:
        raise StoreError(
            f"{shown(store)} holds no study {number if number is not None else repr(name)}; "
            "run it first, or give every parameter with --set NAME=VALUE."
        )
    runs = [r for r in opened.runs(own[-1].id) if math.isfinite(r.cost)]
    if not runs:
        raise StoreError(f"Study {own[-1].id} has no finished run yet; go on with `plantfit resume {own[-1].id}`.")
    found = dict(min(runs, key=lambda r: r.cost).parameters)
    wanted = [n for n in problem.space.names if n not in given]
    if lacking := [n for n in wanted if n not in found]:
        raise StoreError(
            f"Study {own[-1].id} has no value for {', '.join(lacking)}, which the file has: it has changed since. "
            f"Run it again, or give --set {lacking[0]}=VALUE."
        )
    if not _same(problem, opened.probe(own[-1].id), own[-1].id):
        warn(
            f"The values of {', '.join(wanted)} are those of study {own[-1].id}, which was of another problem: the "
            "study file or its recordings have changed since. Run it again, or give every parameter with "
            "--set NAME=VALUE."
        )
    return {n: found[n] for n in wanted}


def _same(problem: "Problem", before: bytes, number: int) -> bool:
    """Whether a stored study was of this problem, so that its values are its answer."""
    from plantfit.study.objective import objective_of
    from plantfit.study.running.probe import check_same, probe

    try:
        check_same(before, probe(objective_of(problem, None), problem.space.physical), number)
    except StoreError:
        return False
    return True
