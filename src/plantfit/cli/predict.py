"""`plantfit predict`: simulate at the best parameters, or at given ones, and write a CSV."""

import numpy as np

from plantfit.cli.assignments import numbers_by_name
from plantfit.cli.out import out, print_json
from plantfit.errors import SpaceError, StoreError


def predict(spec: str, place: str, values: list[str], study: int | None, recording: str | None, store: str, json: bool) -> None:
    """Write measured and simulated outputs over a whole recording."""
    from plantfit import recording as rec
    from plantfit import spec as specs
    from plantfit.problem.steps import choose_substeps

    loaded = specs.load(spec)
    problem = choose_substeps(loaded.problem)
    named = _known(numbers_by_name("--set", values), problem.space.names)
    if set(named) != set(problem.space.names):
        named = {**_stored(loaded.name, study, store), **named}
    vector = problem.space.vector(named)
    name = recording or next(iter(problem.experiments))
    predicted = problem.predict(vector, name)
    source = problem.experiments[name].recording
    signals = dict(source.signals)
    for output, y in predicted.items():
        signals[f"{output}_simulated"] = rec.Signal(y, source.signals[output].unit)
    path = rec.to_csv(rec.Recording(source.t, signals, source.name), place) or place
    scores = {}
    for output, y in predicted.items():
        error = y - source[output]
        scores[output] = float(np.sqrt(np.nanmean(error**2)))
    if json:
        return print_json({"file": str(path), "recording": name, "parameters": named, "rmse": scores})
    for output, rmse in scores.items():
        out.print(f"{output}: RMSE {rmse:.4g} {source.signals[output].unit or ''} over {len(source)} samples of {name}", markup=False)
    out.print(f"Written: {path}", markup=False)


def _known(named: dict[str, float], names: tuple[str, ...]) -> dict[str, float]:
    for name in named:
        if name not in names:
            raise SpaceError(f"--set {name} names no free parameter; the free ones are {list(names)}.")
    return named


def _stored(name: str, number: int | None, store: str) -> dict[str, float]:
    from plantfit.study import Store

    opened = Store.open(store, create=False)
    own = [r for r in opened.studies() if (r.id == number if number is not None else r.name == name)]
    if not own:
        raise StoreError(
            f"{store} holds no study {number if number is not None else repr(name)}; "
            "run it first, or give every parameter with --set NAME=VALUE."
        )
    runs = [r for r in opened.runs(own[-1].id) if np.isfinite(r.cost)]
    if not runs:
        raise StoreError(f"Study {own[-1].id} has no finished run yet; go on with `plantfit resume {own[-1].id}`.")
    return dict(min(runs, key=lambda r: r.cost).parameters)
