"""What is missing in a model, by evidence: every addition of the catalogue is tried on the fitted problem, the best
are fitted in full."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Model
from plantfit.models.text.suggest import suggest
from plantfit.problem.problem import Problem
from plantfit.trust.diagnosis.catalogue import Extension, catalogue, inside_kinds
from plantfit.trust.diagnosis.course import Course, Diagnosis
from plantfit.trust.diagnosis.meter import Meter
from plantfit.trust.diagnosis.plant.carrier import Carrier, rows_of
from plantfit.trust.diagnosis.plant.curves import driftable
from plantfit.trust.diagnosis.plant.cycles import Place, places_of
from plantfit.trust.diagnosis.plant.stepping.moments import StepPlace, looked_at, step_places
from plantfit.trust.diagnosis.plant.timeless.regression import Regression, carrier_of_regression
from plantfit.trust.diagnosis.plant.timeless.static import carrier_of_static, extensions_of_static, static
from plantfit.trust.diagnosis.plant.timeless.terms import extensions_of, terms_of
from plantfit.trust.diagnosis.plant.unmeasured import curves_for, mode_of, repeats, steps_of, with_unmeasured

ROUNDS = 3  # additions that may be named one after the other
STRONG = 3.0  # times the evidence that is needed: "very likely"


def diagnose(
    problem: Problem,
    z: np.ndarray,
    progress: Callable[[str], None] | None = None,
    rounds: int = ROUNDS,
    only: str | Sequence[str] | None = None,
    meter: Meter | None = None,
    regression: Regression | None = None,
) -> Diagnosis:
    """Try every addition of the catalogue at the answer z (d,) of a problem, and name those that the data ask for.

    At most `rounds` additions are named, each beside those before it. With `only`, as in "dead time of u", this one
    alone is tried; of several each beside those before it. `progress` is told what is being tried. A `meter` limits the
    work: what takes least is tried first. Of a regression whose columns were filtered `regression` is what it was
    before. Raises ModelError for a model with recordings over time and others at rest, and for an addition that
    the catalogue does not have; Stopped where the meter is asked to stop.
    """
    demand_treatable(problem)
    say, meter = progress or (lambda text: None), meter or Meter()
    problem = problem.unsmoothed
    if isinstance(problem.model, LinearModel):
        regression = (regression or Regression.of(problem)).in_units()
    extensions = additions(problem, regression)
    wanted = None if only is None else chosen(problem, extensions, [only] if isinstance(only, str) else only, z)
    say("preparing")
    if regression is not None:
        carrier = carrier_of_regression(problem, z, regression, terms_of(regression), meter)
    elif static(problem):
        carrier = carrier_of_static(problem, z, meter)
    else:
        carrier = Carrier.of(problem, z, inside_kinds(problem), meter)
    course = Course.begun(carrier, say)
    if wanted is not None:
        made = course.diagnosis([one for e in wanted[0] for one in course.alone(e)])
        asked = [p.name for p in wanted[3]]
        steps = looked_at(carrier, course.base, course.use) if asked else []
        made = curves_for(course, wanted[1], made)
        return replace(made, places=tuple(wanted[2]), stepped=tuple(p for p in steps if p.name in asked))
    cycle, mode = (None, None) if static(problem) else (repeats(course), mode_of(course))
    course.one_by_one(extensions, rounds)
    if rounds > 1 and course.two_at_once(extensions):
        course.one_by_one(extensions, rounds - 2)
    made = course.diagnosis(course.made)
    if static(problem):
        return replace(made, whole=made.whole and course.whole)
    step = steps_of(course, made)
    return with_unmeasured(course, replace(made, whole=made.whole and course.whole), cycle, step, mode)


def additions(problem: Problem, regression: Regression | None = None) -> list[Extension]:
    """What is tried on a problem, in the order in which equals are named; of a regression the columns that it may
    lack."""
    if static(problem):
        return extensions_of_static(problem)
    if not isinstance(problem.model, LinearModel):
        return catalogue(problem, rows_of(problem))
    return extensions_of((regression or Regression.of(problem)).in_units())


def treatable(problem: Problem) -> bool:
    """Whether a problem is one of models that are simulated over time, or of static ones."""
    moving = not any(e.steady for e in problem.experiments.values())
    return isinstance(problem.model, Model) and (static(problem) or (problem.predictor.has_steps and moving))


def demand_treatable(problem: Problem) -> None:
    """Raises ModelError for a problem that is neither `treatable` nor a regression, as some of its recordings are at
    rest, and others not."""
    if not treatable(problem) and not isinstance(problem.model, LinearModel):
        name = problem.model.name
        raise ModelError(
            f"Diagnosis is for recordings that are all over time or all at rest, and those of {name!r} are mixed; "
            "diagnose them in two study files."
        )


def chosen(
    problem: Problem, extensions: Sequence[Extension], names: Sequence[str], z: np.ndarray | None = None
) -> tuple[list[Extension], list[str], list[Place], list[StepPlace]]:
    """The additions of these names, each once, the outputs whose slow drift is asked for, where a daily pattern is, and
    what changes at a moment, sized for the answer z (d,) where there is one. Raises ModelError for a name that there is
    not, and lists those that there are."""
    by_name, curves = {e.name: e for e in extensions}, driftable(problem)
    z = np.full(problem.space.dimension, 0.5) if z is None else z
    places = {p.name: p for p in places_of(problem, z)}
    steps = {p.name: p for p in step_places(problem, z)}
    asked = list(dict.fromkeys(name.strip() for name in names))
    known = [*by_name, *curves, *places, *steps]
    for name in asked:
        if name not in known:
            raise ModelError(f"There is no {name!r} to try.{suggest(name, known)} There are: {', '.join(known)}.")
    named, drifting = [by_name[n] for n in asked if n in by_name], [curves[n] for n in asked if n in curves]
    return named, drifting, [places[n] for n in asked if n in places], [steps[n] for n in asked if n in steps]


__all__ = ["STRONG", "Diagnosis", "additions", "chosen", "demand_treatable", "diagnose", "treatable"]
