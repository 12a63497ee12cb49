"""Parameter values that a command works at: given on the command line, else those of a stored study."""

import math
from collections.abc import Sequence

from plantfit.cli.arguments.assignments import numbers_by_name
from plantfit.errors import SpaceError, StoreError


def values_at(
    names: Sequence[str], texts: Sequence[str], study: str, number: int | None, store: str
) -> dict[str, float]:
    """By coordinate name: NAME=VALUE `texts` of --set; what they leave out from study `number`, else the newest named
    `study`.

    Raises SpaceError for an unknown name, StoreError where values are missing and no study has them.
    """
    named = numbers_by_name("--set", texts)
    for name in named:
        if name not in names:
            raise SpaceError(f"--set {name} names no free parameter; the free ones are {list(names)}.")
    return named if set(named) == set(names) else {**_stored(study, number, store), **named}


def _stored(name: str, number: int | None, store: str) -> dict[str, float]:
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
    return dict(min(runs, key=lambda r: r.cost).parameters)
