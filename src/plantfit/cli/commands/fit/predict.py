"""`plantfit predict`: simulate at the best parameters, or at given ones, and write a CSV."""

from typing import TYPE_CHECKING

import numpy as np

from plantfit.cli.arguments.quantities import fraction
from plantfit.cli.arguments.values import values_at
from plantfit.cli.terminal.out import out, print_json, said_line
from plantfit.errors import SpecError

if TYPE_CHECKING:
    from plantfit.answer import Answer
    from plantfit.problem import Experiment
    from plantfit.trust.intervals.bands import Band


def predict(
    spec: str,
    place: str,
    values: list[str],
    study: int | None,
    recording: str | None,
    level: str | None,
    store: str,
    json: bool,
) -> None:
    """Write measured and simulated outputs over a whole recording, with bands at `level` where it is given."""
    from plantfit import recording as rec
    from plantfit import spec as specs
    from plantfit.cli.commands.begin.check import say_inexact
    from plantfit.problem.accuracy.steps import choose_substeps, steps_and_error
    from plantfit.trust.intervals.first_values import outputs_begun_at

    loaded = specs.load(spec)
    share = None if level is None else fraction("--level", level)
    if share is not None and values:
        raise SpecError(
            "--bands are made for the parameters of the study; they "
            "cannot be used with --set, so leave one of the two out."
        )
    problem = choose_substeps(loaded.problem)
    named = values_at(problem, values, loaded.name, study, store)
    vector, answer = problem.space.vector(named), None
    if not values and (share is not None or outputs_begun_at(problem, np.asarray(problem.space.cube(vector)))):
        answer = _answer(loaded.name, study, store)
        named = {n: float(answer.values[n]) for n in named}  # with starts that were estimated beside them
        vector = problem.space.vector(named)
    problem, error = steps_and_error(problem, np.asarray(problem.space.cube(vector)))
    name = recording or next(iter(problem.experiments))
    experiment = problem.experiments[name]
    source = experiment.recording
    signals = dict(source.signals)
    found: dict[str, Band] = {}
    scatters: list[str] = []
    if answer is not None and share is not None:
        predicted, found, scatters = _bands(answer, experiment, share, json)
    elif answer is not None:  # the model of the file, which may have changed
        predicted = problem.with_starts({name: _starts(answer, name, experiment)}).predict(vector, name)
    else:
        predicted = problem.predict(vector, name)
    for output, y in predicted.items():
        signals[f"{output}_simulated"] = rec.Signal(y, source.signals[output].unit)
    held: dict[str, float] = {}
    for output, band in found.items():
        unit = source.signals[output].unit
        signals |= {f"{output}_low": rec.Signal(band.low, unit), f"{output}_high": rec.Signal(band.high, unit)}
        signals |= {
            f"{output}_read_low": rec.Signal(band.read_low, unit),
            f"{output}_read_high": rec.Signal(band.read_high, unit),
        }
        if np.any(np.isfinite(source[output])):
            held[output] = band.held(source[output])
    path = rec.to_csv(rec.Recording(source.t, signals, source.name), place) or place
    read = {output: int(np.sum(np.isfinite(source[output]))) for output in predicted}
    scores = {
        output: float(np.sqrt(np.nanmean((y - source[output]) ** 2))) for output, y in predicted.items() if read[output]
    }
    if json:
        from plantfit.findings.results.predicted import Predicted, PredictedBands

        rmse, inside = {o: scores.get(o) for o in predicted}, {o: held.get(o) for o in found}
        made = Predicted(file=str(path), recording=name, parameters=named, rmse=rmse, step_error=error)
        return print_json(
            made.printed(bands=PredictedBands(level=share or 0.0, held=inside, scatters=scatters))
            if found
            else made.printed()
        )
    for output, count in read.items():
        unit = f" {source.signals[output].unit}" if source.signals[output].unit not in (None, "", "1") else ""
        said = f"RMSE {scores[output]:.4g}{unit} over {count} samples of {name}" if count else f"not measured in {name}"
        out.print(f"{output}: {said}", markup=False)
    say_inexact(error)
    for output, part in held.items():
        out.print(
            f"{output}: {100 * part:.3g} % of the readings lie in the band of {100 * (share or 0):g} %.", markup=False
        )
    if scatters:
        which = ", ".join(scatters)
        out.print(
            f"Recordings of this plant scatter in {which}: the bands are those of the plant in another recording.",
            markup=False,
        )
    out.print(f"Written: {path}", markup=False)


def _bands(
    answer: "Answer", experiment: "Experiment", level: float, json: bool
) -> "tuple[dict[str, np.ndarray], dict[str, Band], list[str]]":
    """What an answer predicts over an experiment, its bands there, and the parameters that scatter between
    recordings."""
    with said_line(quiet=json) as say:
        if say:
            say("drawing plants that the data allow")
        scatters = [p["name"] for p in answer.findings["parameters"] if p["scatter"]]
        return answer.predict(experiment), answer.bands(experiment, level=level), scatters


def _starts(answer: "Answer", name: str, experiment: "Experiment") -> dict[str, float]:
    """By output how far off the answer's states begin in a recording; nothing of one that has changed since."""
    own = answer.problem.experiments.get(name)
    return {
        output: off
        for output, off in (own.start_corrections if own else {}).items()
        if own
        and output in experiment.recording.signals
        and np.array_equal(own.recording[output], experiment.recording[output], equal_nan=True)
    }


def _answer(name: str, number: int | None, store: str) -> "Answer":
    """The answer of the newest study of that name, or of study `number`."""
    from plantfit.reopen import open_study
    from plantfit.study import Store

    opened = Store.open(store, create=False)
    own = [r for r in opened.studies() if (r.id == number if number is not None else r.name == name)]
    return open_study(own[-1].id, opened)
