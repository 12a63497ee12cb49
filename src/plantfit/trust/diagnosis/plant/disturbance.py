"""The plant fitted with a disturbance on its output that wanders by itself, where what is left is one."""

from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.trust.diagnosis.catalogue import Extension
from plantfit.trust.diagnosis.plant.carrier import Carrier
from plantfit.trust.diagnosis.plant.hypothesis import Fitted, columns, limits, whole
from plantfit.trust.validate.wandering import HUGE, Left, Wandering, usable, wandering, whitened

STEPS, HALVED = 8, 6  # of the fit, and how often one is halved
ENDS = 1e-4  # relative decrease that ends it
SETTLED = 0.7  # standard errors, of all parameters together, that they may still be off: dry friction has kinks
PRESSED = 1e-6  # of the cube: a parameter at a bound
EVEN = 0.01  # of the period: how far steps of time may differ


@dataclass(frozen=True)
class Disturbed:
    """The `walk` in the unit of the output, samples `period` s apart, beside these `additions`, and what the
    parameters are with it: by coordinate a value with its standard error, in their units; none where one of them
    ends at a bound, those that the record shows else."""

    output: str
    additions: tuple[Extension, ...]
    walk: Wandering
    period: float
    values: dict[str, tuple[float, float]]


def disturbed(carrier: Carrier, one: Fitted, use: np.ndarray) -> Disturbed | None:
    """The plant and what was found (`one`) fitted beside a walk of the output over rows `use` (m,) bool: Gauss-Newton
    steps on innovations.

    None where what is left is no walk, where the fit does not settle, for several outputs, models that are not
    simulated, and records that are not evenly sampled.
    """
    if not _applies(carrier):
        return None
    free, (low, high) = columns(carrier, one.additions), limits(carrier, one.additions)
    point = np.r_[one.x, one.theta]

    def at(p: np.ndarray) -> list[Left]:
        residuals, jacobian = whole(carrier, one.additions, p)
        return _left(carrier, residuals, jacobian[:, free], use)

    left = at(point)
    if not _sound(left):
        return None
    best = whitened(left)
    for _ in range(STEPS):
        before, step = _square(left, best.gain), best.moved
        for _ in range(HALVED):
            trial = point.copy()
            trial[free] = np.clip(trial[free] - step, low[free], high[free])
            there = at(trial)
            now = _square(there, best.gain) if _sound(there) else np.inf
            if now <= before:
                break
            step = 0.5 * step
        else:
            break
        point, left = trial, there
        best = whitened(left)
        if now >= (1.0 - ENDS) * before:
            break
    pressed = np.any((point[: carrier.own] < PRESSED) | (point[: carrier.own] > 1.0 - PRESSED))
    if not pressed and _square(left, best.gain) - best.square > SETTLED**2 * best.variance:
        return None
    walk = wandering(left, best)
    if walk is None:
        return None
    values = {} if pressed else values_beside(carrier, one.additions, point, free, best.standard_errors)
    return Disturbed(carrier.given.outputs[0], one.additions, walk, float(np.median(_steps(carrier.given))), values)


def evidence_beside_a_walk(carrier: Carrier, base: Fitted, one: Fitted, use: np.ndarray) -> float:
    """Twice the gain of log-likelihood by what `one` has more than `base`, both beside a walk of the output, along
    their derivatives.

    A walk hides what an addition explains, for it moves more; on innovations it is seen.
    """
    if not _applies(carrier):
        return 0.0
    found = []
    for f in (base, one):
        left = _left(carrier, f.residuals, f.jacobian[:, columns(carrier, f.additions)], use)
        if not _sound(left):
            return 0.0
        found.append(whitened(left))
    return len(found[0].innovations) * float(np.log(found[0].square / found[1].square)) if found[1].square > 0 else 0.0


def even(problem: Problem) -> bool:
    """Whether all recordings are sampled evenly, with one period."""
    steps = _steps(problem)
    return bool(np.ptp(steps) <= EVEN * np.median(steps))


def _steps(problem: Problem) -> np.ndarray:
    """Of time between samples, s."""
    return np.concatenate([np.diff(e.recording.t) for e in problem.experiments.values()])


def _applies(carrier: Carrier) -> bool:
    """Whether there is one simulated output, evenly sampled."""
    given = carrier.given
    return len(given.outputs) == 1 and given.predictor.has_steps and even(given)


def _sound(left: list[Left]) -> bool:
    """Whether there is something left, of a plant that does not explode."""
    return bool(left) and all(
        np.max(np.abs(x), initial=0.0) < HUGE for one in left for x in (one.residuals, one.derivatives)
    )


def _square(left: list[Left], gain: float) -> float:
    """Sum of squared innovations with the parameters where they are."""
    return whitened([Left(one.residuals, one.derivatives[:, :0], one.inputs) for one in left], gain).square


def _left(carrier: Carrier, residuals: np.ndarray, jacobian: np.ndarray, use: np.ndarray) -> list[Left]:
    given, rows, found = carrier.given, carrier.rows, []
    output = given.outputs[0]
    for name, e in given.experiments.items():
        at = rows.part(name, output)
        at = at[rows.fit[at]]
        if len(at):
            size = given.scales[output] / rows.weight[at]
            inputs = {u: np.asarray(e.recording[u], dtype=float)[rows.sample[at]] for u in carrier.inputs[name]}
            found.append(Left(np.where(use[at], residuals[at] * size, np.nan), jacobian[at] * size[:, None], inputs))
    return usable(found)


def values_beside(
    carrier: Carrier, additions: tuple[Extension, ...], point: np.ndarray, free: np.ndarray, errors: np.ndarray
) -> dict[str, tuple[float, float]]:
    """By coordinate its value at a point (d + k,) and its standard error, in their units, from those (f,) of the
    `free` coordinates (f,); none where that is infinite."""
    space, own = carrier.given.space, carrier.own
    sizes = np.asarray(space.slopes(point[:own])) * errors[:own]
    found = dict(
        zip(space.names, zip(np.asarray(space.physical(point[:own])), np.abs(sizes), strict=True), strict=True)
    )
    for k, a in enumerate(additions):
        place = columns(carrier, [a])[-1] if a.place == "inside" else len(carrier.names) + k
        found[a.parameter] = point[place], errors[list(free).index(place)]
    return {n: (float(v), float(e)) for n, (v, e) in found.items() if np.isfinite(e)}
