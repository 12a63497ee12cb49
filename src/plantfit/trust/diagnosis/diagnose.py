"""What is missing in a model, by evidence: every addition of the catalogue is tried on the fitted problem, the best are fitted in full."""

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
from plantfit.trust.diagnosis.judge import needed, times_noise
from plantfit.trust.diagnosis.meter import Meter
from plantfit.trust.diagnosis.plant.carrier import Carrier, rows_of
from plantfit.trust.diagnosis.plant.disturbance import disturbed, evidence_beside_a_walk
from plantfit.trust.diagnosis.plant.regression import Regression, carrier_of_regression
from plantfit.trust.diagnosis.plant.terms import extensions_of, terms_of
from plantfit.trust.diagnosis.rounds import ALIKE

ROUNDS = 3  # additions that may be named one after the other
SOME = 1.3  # times the sample-to-sample noise: a disturbance or a linear model is looked at
WALKS = 10  # simulations with derivatives that a disturbance takes at most, about
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

    At most `rounds` additions are named, each beside those before it. With `only`, as in "dead time of u", this one alone is tried; of
    several each beside those before it. `progress` is told what is being tried. A `meter` limits the work: what takes least is tried
    first. Of a regression whose columns were filtered `regression` is what it was before. Raises ModelError for a model that is neither
    simulated over time nor a regression, and for an addition that the catalogue does not have; Stopped where the meter is asked to stop.
    """
    demand_treatable(problem)
    say, meter = progress or (lambda text: None), meter or Meter()
    problem = problem.unsmoothed
    if isinstance(problem.model, LinearModel):
        regression = (regression or Regression.of(problem)).in_units()
    extensions = additions(problem, regression)
    wanted = None if only is None else chosen(extensions, [only] if isinstance(only, str) else only)
    say("preparing")
    if regression is None:
        carrier = Carrier.of(problem, z, inside_kinds(problem), meter)
    else:
        carrier = carrier_of_regression(problem, z, regression, terms_of(regression), meter)
    course = Course.begun(carrier, say)
    if wanted is not None:
        return course.diagnosis([one for e in wanted for one in course.alone(e)])
    course.one_by_one(extensions, rounds)
    if rounds > 1 and course.two_at_once(extensions):
        course.one_by_one(extensions, rounds - 2)
    return _with_a_walk(course, course.diagnosis(course.made))


def _with_a_walk(course: Course, found: Diagnosis) -> Diagnosis:
    """The diagnosis with a disturbance on the output, where more than noise is left and that is one."""
    if times_noise(course.carrier, found.end, course.apart) <= SOME or not course.carrier.meter.holds(WALKS * course.carrier.charge(False)):
        return found
    course.say("fitting with a disturbance that wanders")
    for one in (found.base, found.end) if found.found else (found.base,):  # what wanders may look like a drift
        walk = disturbed(course.carrier, one, course.use)
        if walk is not None:
            return replace(found, disturbed=walk)
    return found if found.found else _beside_a_walk(course, found)


def _beside_a_walk(course: Course, found: Diagnosis) -> Diagnosis:
    """What a walk of the output had hidden: the addition with most evidence beside one, if what is left then is a walk."""
    carrier, use, first = course.carrier, course.use, found.rounds[0]
    tried = [(evidence_beside_a_walk(carrier, first.base or found.base, t.at, use), k, t) for k, t in enumerate(first.trials) if t.at]
    most, k, t = max(tried, default=(0.0, 0, None), key=lambda one: one[0])
    if t is None or t.at is None or most < needed(len(first.trials)) or not course.carrier.meter.holds(WALKS * carrier.charge(True)):
        return found
    walk = disturbed(carrier, t.at, use)
    if walk is None:
        return found
    value, error = walk.values.get(t.extension.parameter, (t.value, t.standard_error))
    hidden = replace(t, value=value, standard_error=error, evidence=most)
    alike = [other for gained, _, other in tried if other is not t and most - gained < ALIKE]
    rounds = (replace(first, found=(hidden, *alike), trials=(*first.trials[:k], hidden, *first.trials[k + 1 :])), *found.rounds[1:])
    return replace(found, rounds=rounds, disturbed=walk)


def additions(problem: Problem, regression: Regression | None = None) -> list[Extension]:
    """What is tried on a problem, in the order in which equals are named; of a regression the columns that it may lack."""
    if not isinstance(problem.model, LinearModel):
        return catalogue(problem, rows_of(problem))
    return extensions_of((regression or Regression.of(problem)).in_units())


def treatable(problem: Problem) -> bool:
    """Whether a problem is one of models that are simulated over time."""
    moving = not any(e.steady for e in problem.experiments.values())
    return isinstance(problem.model, Model) and problem.predictor.has_steps and moving


def demand_treatable(problem: Problem) -> None:
    """Raises ModelError for a problem that is neither `treatable` nor a regression."""
    if not treatable(problem) and not isinstance(problem.model, LinearModel):
        name = problem.model.name
        raise ModelError(
            f"Diagnosis is for models that are simulated over time and for regressions, and {name!r} is neither; look at its residuals."
        )


def chosen(extensions: Sequence[Extension], names: Sequence[str]) -> list[Extension]:
    """The additions of these names, each once. Raises ModelError for one that there is not, and lists those that there are."""
    by_name = {e.name: e for e in extensions}
    for name in names:
        if name.strip() not in by_name:
            raise ModelError(f"There is no {name!r} to try.{suggest(name, list(by_name))} There are: {', '.join(by_name)}.")
    return [by_name[n] for n in dict.fromkeys(name.strip() for name in names)]


__all__ = ["STRONG", "Diagnosis", "additions", "chosen", "demand_treatable", "diagnose", "treatable"]
