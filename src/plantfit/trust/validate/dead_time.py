"""The dead time that a recording shows, with its interval, and whether it can be told from zero."""

from dataclasses import dataclass
from typing import Any

from plantfit.errors import SpaceError
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.profile import CLOSE, Profile, profile
from plantfit.trust.verdict.words import with_unit


@dataclass(frozen=True)
class DeadTime:
    """`value` and `interval` (low, high) in s; `determined`: both ends lie inside the bounds, and above zero.
    `sentence` says it."""

    name: str
    value: float
    interval: tuple[float, float]
    determined: bool
    sentence: str
    profile: Profile


def dead_time(problem: Problem, answer: Any, name: str | None = None, level: float = 0.95) -> DeadTime:
    """The dead time `name` ("L", "Td[opening10]"; the model's only one if left out) with its interval at `level`.

    `answer` is a cube point (d,) or what `fit` returns. The interval is that of `trust.profile`: by likelihood ratio,
    every other parameter refitted, widened as correlated residuals ask. It says what the recording tells if the model
    is right; a model of another shape gives a wrong delay with a narrow interval. Raises SpaceError where no such dead
    time is free.
    """
    delays = {d.parameter for d in problem.model.delays} if isinstance(problem.model, Model) else set()
    free = [c.name for c in problem.space.coordinates if c.parameter in delays]
    if name is None and len(free) == 1:
        name = free[0]
    if name not in free:
        have = f"it has {free}; name one" if free else "it has none; use a model with dead time and give it bounds"
        raise SpaceError(
            f"{'No dead time is named' if name is None else f'{name!r} is no free dead time of this problem'}: {have}."
        )
    found = profile(problem, answer, name, level)
    near = found.low <= CLOSE * (found.value - found.low)  # as near to zero as ends are found
    told = not (found.at_lower or found.at_upper or near)
    return DeadTime(name, found.value, (found.low, found.high), told, _sentence(found, level, near), found)


def _sentence(p: Profile, level: float, near: bool) -> str:
    unit, share = p.unit or "s", f"{100 * level:g} % interval"
    if p.at_lower and p.at_upper:
        return (
            f"The recording does not tell the dead time {p.name}: all of {p.low:g} to {with_unit(p.high, unit)} fits."
        )
    if near and p.at_upper:
        return (
            f"The recording does not tell the dead time {p.name} from zero, nor from its upper bound, "
            f"{with_unit(p.high, unit)}."
        )
    if near:
        return (
            f"The dead time {p.name} cannot be told from zero: the {share} reaches from 0 to {with_unit(p.high, unit)}."
        )
    if p.at_lower:
        return (
            f"The dead time {p.name} is at most {with_unit(p.high, unit)}: the {share} reaches its lower bound, "
            f"{with_unit(p.low, unit)}."
        )
    if p.at_upper:
        return (
            f"The dead time {p.name} is at least {with_unit(p.low, unit)}: the {share} reaches its upper bound, "
            f"{with_unit(p.high, unit)}."
        )
    return f"The dead time {p.name} is {with_unit(p.value, unit)}, {share} {p.low:.3g} to {with_unit(p.high, unit)}."
