"""What acts on an output and nobody measured, where more than noise is left in the end: a disturbance that wanders,
a slow drift, a pattern that repeats every day, or a step at a moment."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from plantfit.trust.diagnosis.course import CLEAR, Course, Diagnosis
from plantfit.trust.diagnosis.judge import by_output, independent_share, needed, times_noise
from plantfit.trust.diagnosis.plant.curves import curve_of
from plantfit.trust.diagnosis.plant.cycles import Repeating, repeating, shows, work
from plantfit.trust.diagnosis.plant.disturbance import Disturbed, disturbed, evidence_beside_a_walk
from plantfit.trust.diagnosis.plant.hypothesis import Fitted
from plantfit.trust.diagnosis.plant.slow_drift import Drifting, Rival, drifting, evidence_beside_a_drift, rival
from plantfit.trust.diagnosis.plant.slow_mode import SlowMode, better, promising, slow_mode
from plantfit.trust.diagnosis.plant.slow_mode import work as mode_work
from plantfit.trust.diagnosis.plant.stepping import steps
from plantfit.trust.diagnosis.rounds import ALIKE

SOME = 1.3  # times the sample-to-sample noise: a disturbance or a linear model is looked at
WORK = 10  # simulations with derivatives that one takes at most, about
BETTER = 0.8  # of what additions leave that a daily pattern may leave in their place, as it has more numbers
NUMBERS = 2  # of a step: its size and its moment
NODES = 2  # of straight lines for a cubic spline
Told = Disturbed | Drifting


@dataclass(frozen=True)
class Kind:
    """A walk or a drift: whether a fit leaves one (`told`), and the evidence for what a second fit has more than a
    first beside it."""

    says: str
    told: Callable[[Fitted], Told | None]
    evidence: Callable[[Fitted, Fitted], float]


def repeats(course: Course) -> Repeating | None:
    """A pattern that repeats every day in what the model as it is leaves, where that is more than noise; the course is
    not whole where the work that may be done does not suffice for it."""
    carrier, base = course.carrier, course.base
    if times_noise(carrier, base, course.apart) <= SOME or not shows(carrier, base, course.use):
        return None
    if not carrier.meter.holds(work(carrier, base)):
        course.whole = False
        return None
    return repeating(carrier, base, course.use, course.kept)


def mode_of(course: Course) -> SlowMode | None:
    """A slow mode that an input drives, in what the model as it is leaves, where that is more than noise; the course is
    not whole where the work that may be done does not suffice for it."""
    carrier, base = course.carrier, course.base
    if times_noise(carrier, base, course.apart) <= SOME or not carrier.given.predictor.has_steps:
        return None
    lag = promising(carrier, base, course.use, course.kept)
    if lag is None:
        return None
    if not carrier.meter.holds(mode_work(carrier)):
        course.whole = False
        return None
    return slow_mode(carrier, base, lag, course.use, course.kept)


def steps_of(course: Course, found: Diagnosis) -> steps.Stepping | None:
    """A step at a moment in what the model as it is leaves, where that is more than noise and not what one addition
    alone explains to the noise; the course is not whole where the work that may be done does not suffice for it."""
    if times_noise(course.carrier, course.bare, course.apart) <= SOME:
        return None
    if len(found.end.additions) < NUMBERS and times_noise(course.carrier, found.end, course.apart) <= CLEAR:
        return None
    carrier, bare = course.carrier, course.bare
    places = steps.worth_a_fit(carrier, bare, course.use)
    if not places:
        return None
    if not carrier.meter.holds(steps.work(carrier, places)):
        course.whole = False
        return None
    course.say("fitting with a step at a moment")
    return steps.stepping(carrier, bare, places, course.use, course.kept)


def with_unmeasured(
    course: Course,
    found: Diagnosis,
    cycle: Repeating | None = None,
    step: steps.Stepping | None = None,
    mode: SlowMode | None = None,
) -> Diagnosis:
    """The diagnosis with what nobody measured, where that is what the model, or what was found, leaves; `cycle` is a
    pattern that may be it, `step` one at a moment. What a lag of an input explains, a slow `mode`, is
    none of these."""
    if mode is not None and _told(course, found, mode, cycle, step):
        return replace(found, mode=mode)
    if step is not None and _prefers(course, found, step, cycle):
        return replace(found, stepping=step, stepped=(step.steps[0].place,))
    left = float(np.sum(cycle.left[course.use] ** 2)) if cycle is not None else np.inf
    if times_noise(course.carrier, found.end, course.apart) > SOME and left < BETTER * found.end.cost(course.use):
        return replace(found, repeating=cycle, places=cycle.places[:1] if cycle is not None else ())
    found = replace(found, rival=_rival(course, found))
    meter = course.carrier.meter
    if times_noise(course.carrier, found.end, course.apart) <= SOME or not meter.holds(
        WORK * course.carrier.charge(False)
    ):
        return found
    for kind in _kinds(course):
        course.say(kind.says)
        for one in (
            (found.base, found.end) if found.found else (found.base,)
        ):  # what wanders may look like a drift of one rate
            told = kind.told(one)
            if told is not None:
                return _said(course, found, told)
    for kind in () if found.found else _kinds(course):
        hidden = _hidden(course, found, kind)
        if hidden is not None:
            return hidden
    return found


def _told(
    course: Course, found: Diagnosis, mode: SlowMode, cycle: Repeating | None, step: steps.Stepping | None
) -> bool:
    """Whether a slow mode is told: all that was found leaves more than noise and more than it does, and so does a
    pattern or a step."""
    carrier, use = course.carrier, course.use
    if times_noise(carrier, found.end, course.apart) <= SOME or not better(mode, carrier, found.end, use):
        return False
    others = [float(np.sum(one.left[use] ** 2)) for one in (cycle, step) if one is not None]
    return float(np.sum(mode.residuals[use] ** 2)) < BETTER * min(others, default=np.inf)


def _prefers(course: Course, found: Diagnosis, step: steps.Stepping, cycle: Repeating | None) -> bool:
    """Whether the record prefers a step to all that was found in its place, by the Bayesian information criterion over
    independent residuals, and to a pattern that repeats."""
    use, carrier = course.use, course.carrier
    n, left = int(use.sum()), float(np.sum(step.left[use] ** 2))
    if cycle is not None and float(np.sum(cycle.left[use] ** 2)) < BETTER * left:
        return False
    worth = n / independent_share(step.left, carrier.rows, use)
    gained = worth * float(np.log(max(found.end.cost(use), 1e-300) / max(left, 1e-300)))
    return gained > float(np.log(n)) * (NUMBERS - len(found.end.additions))


def curves_for(course: Course, outputs: Sequence[str], found: Diagnosis) -> Diagnosis:
    """The diagnosis with curves in time for outputs whose drift was asked for, as dense as what wanders there asks
    for."""
    if not outputs:
        return found
    walk = disturbed(course.carrier, course.base, course.use)
    wanders = None if walk is None else walk.walk
    return replace(found, curves=tuple(curve_of(course.carrier.given, y, wanders) for y in outputs))


def _kinds(course: Course) -> tuple[Kind, Kind]:
    carrier, use = course.carrier, course.use

    def outputs(one: Fitted) -> list[str]:
        if not carrier.given.predictor.has_steps:
            return []
        return [y for y, times in by_output(carrier, one, course.apart).items() if times > SOME]

    return (
        Kind(
            "fitting with a disturbance that wanders",
            lambda one: disturbed(carrier, one, use),
            lambda base, one: evidence_beside_a_walk(carrier, base, one, use),
        ),
        Kind(
            "fitting with a slow drift",
            lambda one: drifting(carrier, one, outputs(one), use),
            lambda base, one: evidence_beside_a_drift(carrier, base, one, outputs(base), use),
        ),
    )


def _rival(course: Course, found: Diagnosis) -> Rival | None:
    """A slow drift that explains as much as all that was found, where that is more than drifts of one rate."""
    end = found.end
    if all(e.kind == "drift" for e in end.additions) or not course.carrier.given.predictor.has_steps:
        return None
    return rival(course.carrier, found.base, end, course.use)


def _said(course: Course, found: Diagnosis, told: Told) -> Diagnosis:
    given = course.carrier.given
    found = replace(found, rival=None)  # one of the two is enough
    if isinstance(told, Disturbed):
        return replace(found, disturbed=told, curves=(curve_of(given, told.output, told.walk),))
    return replace(
        found, drifting=told, curves=tuple(curve_of(given, d.output, least=NODES * d.count) for d in told.drifts)
    )


def _hidden(course: Course, found: Diagnosis, kind: Kind) -> Diagnosis | None:
    """What it had hidden: the addition with most evidence beside it, if what is then left is that."""
    carrier, first = course.carrier, found.rounds[0]
    tried = [(kind.evidence(first.base or found.base, t.at), k, t) for k, t in enumerate(first.trials) if t.at]
    most, k, t = max(tried, default=(0.0, 0, None), key=lambda one: one[0])
    if (
        t is None
        or t.at is None
        or most < needed(len(first.trials))
        or not carrier.meter.holds(WORK * carrier.charge(True))
    ):
        return None
    told = kind.told(t.at)
    if told is None:
        return None
    value, error = told.values.get(t.extension.parameter, (t.value, t.standard_error))
    hidden = replace(t, value=value, standard_error=error, evidence=most)
    alike = [other for gained, _, other in tried if other is not t and most - gained < ALIKE]
    rounds = (
        replace(first, found=(hidden, *alike), trials=(*first.trials[:k], hidden, *first.trials[k + 1 :])),
        *found.rounds[1:],
    )
    return _said(course, replace(found, rounds=rounds), told)


__all__ = ["SOME", "curves_for", "mode_of", "repeats", "steps_of", "with_unmeasured"]
