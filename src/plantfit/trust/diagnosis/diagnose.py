"""What is missing in a model, by evidence: every addition of the catalogue is tried on the fitted problem, the best are fitted in full."""

from collections.abc import Callable, Sequence

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.models.model import Model
from plantfit.models.text.suggest import suggest
from plantfit.problem.problem import Problem
from plantfit.trust.diagnosis.catalogue import Extension, catalogue
from plantfit.trust.diagnosis.course import Course, Diagnosis
from plantfit.trust.diagnosis.meter import Meter
from plantfit.trust.diagnosis.plant.carrier import rows_of

ROUNDS = 3  # additions that may be named one after the other
STRONG = 3.0  # times the evidence that is needed: "very likely"


def diagnose(
    problem: Problem,
    z: np.ndarray,
    progress: Callable[[str], None] | None = None,
    rounds: int = ROUNDS,
    only: str | Sequence[str] | None = None,
    meter: Meter | None = None,
) -> Diagnosis:
    """Try every addition of the catalogue at the answer z (d,) of a problem, and name those that the data ask for.

    At most `rounds` additions are named, each beside those before it. With `only`, as in "dead time of u", this one alone is tried; of
    several each beside those before it. `progress` is told what is being tried. A `meter` limits the work: what takes least is tried
    first. Raises ModelError for a model that is not simulated over time, and for an addition that the catalogue does not have; Stopped
    where the meter is asked to stop.
    """
    demand_treatable(problem)
    say, meter = progress or (lambda text: None), meter or Meter()
    problem = problem.unsmoothed
    extensions = catalogue(problem, rows_of(problem))
    wanted = None if only is None else chosen(extensions, [only] if isinstance(only, str) else only)
    say("preparing")
    course = Course.begun(problem, z, meter, say)
    if wanted is not None:
        return course.diagnosis([one for e in wanted for one in course.alone(e)])
    course.one_by_one(extensions, rounds)
    if rounds > 1 and course.two_at_once(extensions):
        course.one_by_one(extensions, rounds - 2)
    return course.diagnosis(course.made)


def treatable(problem: Problem) -> bool:
    """Whether a problem is one of models that are simulated over time."""
    moving = not any(e.steady for e in problem.experiments.values())
    return isinstance(problem.model, Model) and problem.predictor.has_steps and moving


def demand_treatable(problem: Problem) -> None:
    """Raises ModelError for a problem that is not `treatable`."""
    if not treatable(problem):
        name = problem.model.name
        raise ModelError(f"Diagnosis is for models that are simulated over time, and {name!r} is not; look at its residuals instead.")


def chosen(extensions: Sequence[Extension], names: Sequence[str]) -> list[Extension]:
    """The additions of these names, each once. Raises ModelError for one that there is not, and lists those that there are."""
    by_name = {e.name: e for e in extensions}
    for name in names:
        if name.strip() not in by_name:
            raise ModelError(f"There is no {name!r} to try.{suggest(name, list(by_name))} There are: {', '.join(by_name)}.")
    return [by_name[n] for n in dict.fromkeys(name.strip() for name in names)]


__all__ = ["STRONG", "Diagnosis", "chosen", "demand_treatable", "diagnose", "treatable"]
