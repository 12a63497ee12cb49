"""Why runs stop short of the optimum: other minima, a flat valley, a swarm that has drawn together, or bounds; measured, in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cases.pendubot.study_runs import CLOSE, Floor, MethodRuns, refined
from plantfit.problem import Problem

REAL = 1e-7  # relative decrease of the cost that counts as an improvement
ENDS = 6  # answers from which least squares goes on
REACHED = 0.05 * CLOSE  # a gap that counts as closed; corners of the bounds closer than that do not matter here
NEGLIGIBLE = 1e-9  # a gap below it is rounding
ON_BOUND = 1e-9  # of the range


@dataclass(frozen=True)
class Stagnation:
    """What the answers of one method have in common.

    `distance`: median distance of the answers to the optimum, of the parameter farthest off, as a share of the bounds; `refined`: share
    of the ENDS worst answers from which least squares ends within REACHED; `last`: median share of the budget at the last improvement
    by more than REAL; `on_bound`: share of all coordinates that lie on a bound; `optimum_on_bound` that of the optimum's.
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


def explained(runs: MethodRuns, found: Stagnation, longer: MethodRuns | None = None, times: int = 5) -> list[str]:
    """The measurements as sentences."""
    (share, (low, high)), typical = runs.share_close, _small(float(np.median(runs.gap)))
    told = [
        f"{runs.label}: {100 * share:.1f} % of {len(runs.gap)} runs end within {CLOSE:g} of the optimum "
        f"(95 % interval {100 * low:.1f} to {100 * high:.1f} %), median gap {typical}, largest {_small(runs.gap.max())}."
    ]
    if longer is not None:
        gain = np.median(runs.gap) / max(np.median(longer.gap), 1e-300)
        what = "more search does not help" if gain < 2 else f"{gain:.1f} times less"
        told.append(f"With {times} times the budget its median gap is {_small(float(np.median(longer.gap)))}: {what}.")
    told.append(_cause(found))
    return told


def _cause(found: Stagnation) -> str:
    if found.refined < 1:
        return (
            f"From {100 * (1 - found.refined):.0f} % of its {ENDS} worst answers least squares does not come within {REACHED:g} either: "
            "other minima hold them, or its steps were too few."
        )
    reached = f"No other minimum above {REACHED:g} holds them: least squares from the {ENDS} worst answers ends below that."
    valley = (
        f"The answers lie {found.distance:.2f} of the bounds' width away from it (median; the parameter farthest off) "
        "at almost the same misfit: a flat valley."
    )
    share = f"{100 * found.last:.0f} % of the budget"
    if found.last < 0.8:
        how = (
            f"Half of the runs made their last improvement above {REAL:g} in the first {share}: they drew together on its floor too early."
        )
    else:
        how = f"Half of the runs still improved after {share}: they creep along it until the budget is spent."
    return f"{reached} {valley} {how}"


@dataclass(frozen=True)
class Valley:
    """How far the parameters may move from the optimum within CLOSE of it, as a share of the bounds: across the valley and along it."""

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
        f"Within {CLOSE:g} of the optimum the parameters may move by {_small(found.across)} of the bounds' width across the valley and "
        f"{along} along it. The salp swarm draws jumps of one size, at most c1, for all parameters: while c1 is larger than the "
        f"valley is wide nearly all of them miss it; from generation {begin} of {generations} on they fit, but c1 falls so fast that they "
        "do not lead along it any more."
    )


def bound_bias(found: Sequence[tuple[str, Stagnation]]) -> str:
    """Which methods end on bounds more often than the optimum does."""
    parts = [f"{name} {100 * s.on_bound:.0f} %" for name, s in found]
    return f"Coordinates of the answers on a bound: {', '.join(parts)}; of the optimum {100 * found[0][1].optimum_on_bound:.0f} %."
