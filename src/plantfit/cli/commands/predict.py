"""`plantfit predict`: simulate at the best parameters, or at given ones, and write a CSV."""

import numpy as np

from plantfit.cli.arguments.values import values_at
from plantfit.cli.terminal.out import out, print_json


def predict(spec: str, place: str, values: list[str], study: int | None, recording: str | None, store: str, json: bool) -> None:
    """Write measured and simulated outputs over a whole recording."""
    from plantfit import recording as rec
    from plantfit import spec as specs
    from plantfit.problem.accuracy.steps import choose_substeps, steps_for

    loaded = specs.load(spec)
    problem = choose_substeps(loaded.problem)
    named = values_at(problem.space.names, values, loaded.name, study, store)
    vector = problem.space.vector(named)
    problem = steps_for(problem, np.asarray(problem.space.cube(vector)))
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
