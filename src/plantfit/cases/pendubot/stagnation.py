"""Why runs stop short of the optimum: other minima, a flat valley, a swarm that has drawn together, or bounds;
measured, in words."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cases.pendubot.study_runs import CLOSE, Floor, MethodRuns, refined
from plantfit.problem import Problem

REAL = 1e-7  # relative decrease of the cost that counts as an improvement
ENDS = 6  # answers from which least squares goes on
REACHED = 0.05 * CLOSE  # a gap that counts as closed; corners of the bounds closer than that do not matter here
STILL = 0.8  # share of the budget: a last improvement after it is that of a run that still goes on
NEGLIGIBLE = 1e-9  # a gap below it is rounding
ON_BOUND = 1e-9  # of the range


@dataclass(frozen=True)
class Stagnation:
    """What the answers of one method have in common.

    `distance`: median distance of the answers to the optimum, of the parameter farthest off, as a share of the bounds;
    `refined`: share of the ENDS worst answers from which least squares ends within REACHED; `last`: median share of the
    budget at the last improvement by more than REAL; `on_bound`: share of all coordinates that lie on a bound;
    `optimum_on_bound` that of the optimum's.
    """

    distance: float
    refined: float
    last: float
    on_bound: float
    optimum_on_bound: float


def stagnation(problem: Problem, floor: Floor, runs: MethodRuns, budget: int) -> Stagnation:
    """Measure the answers of `runs`."""
    x = np.array([r.x for r in runs.results])
    best = problem.space.cube([floor.values[n] for n in problem.space.names])
    worst = np.argsort(runs.gap)[-ENDS:]
    last = [_last_improvement(r.history_evaluations, r.history_cost) / budget for r in runs.results]
    return Stagnation(
        distance=float(np.median(np.max(np.abs(x - best), axis=1))),
        refined=float(np.mean(refined(problem, floor, x[worst]) < REACHED)),
        last=float(np.median(last)),
        on_bound=float(np.mean((x < ON_BOUND) | (x > 1 - ON_BOUND))),
        optimum_on_bound=float(np.mean((best < 1e-6) | (best > 1 - 1e-6))),
    )


def _last_improvement(evaluations: np.ndarray, cost: np.ndarray) -> float:
    """Evaluations spent when the cost last fell by more than REAL."""
    above = np.flatnonzero(np.asarray(cost) > cost[-1] * (1 + REAL))
    return float(evaluations[min(above[-1] + 1, len(cost) - 1)]) if len(above) else float(evaluations[0])


def _small(value: float) -> str:
    """A gap or width as a person reads it."""
    if value <= NEGLIGIBLE:
        return "0 to rounding"
    return f"{value:.2g}" if value >= 0.01 else f"{value:.1e}"


def with_more(runs: MethodRuns, longer: MethodRuns, times: int) -> str:
    """How near runs come, and with so many times the budget, in a sentence."""
    share, typical = runs.share_close[0], _small(float(np.median(runs.gap)))
    gain = np.median(runs.gap) / max(np.median(longer.gap), 1e-300)
    what = "more search does not help" if gain < 2 else f"{gain:.1f} times less"
    return (
        f"With its default settings {runs.label} ends within {CLOSE:g} of the optimum in {100 * share:.0f} % of "
        f"{len(runs.gap)} runs, at a "
        f"median gap of {typical}; with {times} times the budget at {_small(float(np.median(longer.gap)))}: {what}."
    )


def causes(found: Mapping[str, Stagnation]) -> list[str]:
    """Why the runs of each method stop where they do; methods with the same cause share a sentence."""
    told = [
        f"From {100 * (1 - s.refined):.0f} % of the {ENDS} worst answers of {n} least squares does not come within "
        f"{REACHED:g} either: "
        "other minima hold them, or its steps were too few."
        for n, s in found.items()
        if s.refined < 1
    ]
    free = {n: s for n, s in found.items() if s.refined == 1}
    if free:
        told.append(
            f"No other minimum above {REACHED:g} holds {_and(free)}: least squares from the "
            f"{ENDS} worst answers of each ends below that. At almost the same misfit their "
            f"answers lie {_and(f'{s.distance:.2f}' for s in free.values())} of the bounds' "
            "width away from the optimum (median; the parameter farthest off): a flat valley."
        )
    early, late = ({n: s for n, s in free.items() if (s.last < STILL) is is_early} for is_early in (True, False))
    if early:
        told.append(
            f"{_and(early)}: half of the runs made their last improvement above {REAL:g} in the first "
            f"{_shares(early)} of the budget, having drawn together on the valley's floor too early."
        )
    if late:
        told.append(
            f"{_and(late)}: half of the runs still improved after {_shares(late)} of the budget, creeping "
            "along the valley until it is spent."
        )
    return told


def _shares(found: Mapping[str, Stagnation]) -> str:
    return _and(f"{100 * s.last:.0f} %" for s in found.values())


def _and(words: Iterable[str]) -> str:
    """Words in a row, equal ones once."""
    *first, last = dict.fromkeys(words)
    return f"{', '.join(first)} and {last}" if first else last


@dataclass(frozen=True)
class Valley:
    """How far the parameters may move from the optimum within CLOSE of it, as a share of the bounds: across the
    valley and along it."""

    across: float
    along: float


def valley(problem: Problem, floor: Floor) -> Valley:
    """From the misfit's second derivatives at the optimum; along the flattest direction at most 1."""
    residuals, jacobian = problem.compressed(problem.space.cube([floor.values[n] for n in problem.space.names]))
    allowed = np.mean(residuals**2) * ((1 + CLOSE) ** 2 - 1)
    stiffness = np.linalg.svd(jacobian / np.sqrt(len(residuals)), compute_uv=False)
    widths = np.sqrt(allowed) / np.maximum(stiffness, 1e-300)
    return Valley(float(widths.min()), float(min(widths.max(), 1.0)))


def salps_in(found: Valley, generations: int) -> str:
    """What the published schedule of the salp swarm, c1 = 2 exp(-(4 l/L)^2), means in a valley."""
    along = "over the whole width" if found.along >= 1 else f"by {_small(found.along)}"
    begin = int(np.ceil(generations / 4 * np.sqrt(np.log(2 / found.across))))
    return (
        f"Within {CLOSE:g} of the optimum the parameters may move by {_small(found.across)} of the bounds' width "
        f"across the valley and {along} along it. The salp swarm draws jumps of one size, at most c1, for all "
        "parameters: while c1 is larger than the valley is wide nearly all of them miss it; from generation "
        f"{begin} of {generations} on they fit, but c1 falls so fast that they do not lead along it any more."
    )


def bound_bias(found: Sequence[tuple[str, Stagnation]]) -> str:
    """Which methods end on bounds more often than the optimum does."""
    parts = [f"{name} {100 * s.on_bound:.0f} %" for name, s in found]
    return (
        f"Coordinates of the answers on a bound: {', '.join(parts)}; of the optimum "
        f"{100 * found[0][1].optimum_on_bound:.0f} %."
    )
