"""Which hold of an input fits: kept until the next sample, or a straight line between samples.

A wrong hold looks like half a sample of dead time. The problem is fitted anew, shortly, with either, and the squares of
the residuals are compared sample by sample: their mean difference over its standard error (Q. H. Vuong, Econometrica 57
(1989) 307, for models of which none contains the other; the standard error is that of a correlated series, W. K. Newey,
K. D. West, Econometrica 55 (1987) 703).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.simulate.simulator import Simulator
from plantfit.simulate.steps.grid import Held

SURE = 2.6  # standard errors from which on a hold is said to fit better: 1 % by chance
POWER = 3.0  # standard errors that the difference must be expected to have, or nothing is said
REFITS = 12  # Jacobians
CHORDS = 12  # steps with the Jacobian of the other hold


@dataclass(frozen=True)
class HoldFit:
    """Of one input: the cost with either hold after a short refit, and what that tells.

    `standard_errors` is the difference of the costs, previous minus linear, over its standard error; `power` how large
    that would be if one of both were true. `better` is None where the difference may be chance or the record cannot
    tell.
    """

    input: str
    better: str | None
    cost_previous: float
    cost_linear: float
    standard_errors: float
    power: float

    @property
    def sentence(self) -> str:
        costs = {Held.PREVIOUS: self.cost_previous, Held.LINEAR: self.cost_linear}
        if self.better is not None:
            worse = max(costs.values())
            share = 100.0 * (worse / max(min(costs.values()), 1e-300) - 1.0)
            return (
                f'hold = {{ {self.input} = "{self.better}" }} fits better: the cost of the other is {share:.3g} % '
                f"higher "
                f"({abs(self.standard_errors):.1f} standard errors)."
            )
        if self.power < POWER:
            return (
                f"The record cannot tell how {self.input} goes on between samples: both holds fit alike (power "
                f"{self.power:.1f})."
            )
        return (
            f"Neither hold of {self.input} fits better ({self.standard_errors:+.1f} standard errors, power "
            f"{self.power:.1f})."
        )


def check_holds(problem: Problem, z: np.ndarray, inputs: Sequence[str] | None = None) -> list[HoldFit]:
    """Compare both holds of every input, or of those named, from a cube point (d,) on; the other inputs keep theirs.

    Inputs that never change are left out. Raises SimulationError for a regression.
    """
    simulator, model = problem.predictor.stepping(), problem.model
    assert isinstance(model, Model)
    found = []
    for name in inputs if inputs is not None else model.inputs:
        if name not in model.inputs:
            raise SimulationError(f"check_holds names {name!r}, which is not one of the inputs {list(model.inputs)}.")
        if all(np.ptp(e.recording[name]) == 0.0 for e in problem.experiments.values()):
            continue
        holds = {n: Held.LINEAR if n in simulator.interpolated else Held.PREVIOUS for n in model.inputs}
        residuals = {
            kind: _refitted(_held(problem, {**holds, name: kind}), np.asarray(z, dtype=float))
            for kind in (Held.PREVIOUS, Held.LINEAR)
        }
        found.append(_compared(name, residuals[Held.PREVIOUS], residuals[Held.LINEAR]))
    return found


class Straight(NamedTuple):
    """What straight lines between the samples of an input tell: both holds compared, and with straight lines the
    problem, its answer (d,) and the scaled residuals (m,) there. Of the last three the next input can be looked at."""

    fit: HoldFit
    problem: Problem
    at: np.ndarray
    residuals: np.ndarray


def beside_linear(problem: Problem, z: np.ndarray, residuals: np.ndarray, jacobian: np.ndarray, name: str) -> Straight:
    """Both holds of an input that is held where the problem has these residuals (m,) at z (d,).

    `jacobian` (m, d) is that of the fit. The derivatives serve the other hold too, so that only its residuals are
    compiled.
    """
    own = dict.fromkeys(problem.predictor.stepping().interpolated, Held.LINEAR)
    linear = _held(problem, {**own, name: Held.LINEAR})
    straight, at = _followed(linear, z, jacobian)
    return Straight(_compared(name, residuals, straight), linear, at, straight)


def _followed(problem: Problem, z: np.ndarray, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest residuals (m,) and their point (d,) on Gauss-Newton's way with these derivatives."""
    norms = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    inverse = np.linalg.pinv(jacobian / norms, rcond=1e-8) / norms[:, None]
    best, at = np.asarray(problem.residuals(z)), np.asarray(z, dtype=float)
    for _ in range(CHORDS):
        trial = np.clip(at - inverse @ best, 0.0, 1.0)
        r = np.asarray(problem.residuals(trial))
        if not float(r @ r) < (1.0 - 1e-6) * float(best @ best):
            break
        best, at = r, trial
    return best, at


def _held(problem: Problem, hold: dict[str, str]) -> Problem:
    """The problem with other holds."""
    own = problem.predictor.stepping()
    model = own.vector.model
    simulator = Simulator.of(model, stepper=own.stepper, substeps=own.substeps, hold=hold)
    other = problem.unsmoothed._variant(predictor=problem.predictor.with_simulator(simulator), _compiled={})
    other._prepare()
    return other


def _refitted(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Residuals (m,) after a short local fit."""
    inside = np.clip(z, 1e-6, 1.0 - 1e-6)
    best = least_squares(
        lambda z: np.asarray(problem.residuals(z)),
        inside,
        jac=lambda z: problem.residuals_and_jacobian(z)[1],
        bounds=(0.0, 1.0),
        max_nfev=REFITS,
        x_scale="jac",
    )
    return np.asarray(problem.residuals(best.x))


def _compared(name: str, previous: np.ndarray, linear: np.ndarray) -> HoldFit:
    difference = previous**2 - linear**2
    apart = float(np.mean((previous - linear) ** 2))  # what the cost of the wrong one is expected to be more
    error = _standard_error(difference)
    costs = float(np.mean(previous**2)), float(np.mean(linear**2))
    tiny = 1e-12 * max(*costs, 1e-300)
    count = float(np.mean(difference)) / max(error, tiny)
    power = apart / max(error, tiny)
    better = None
    if power >= POWER and abs(count) >= SURE:
        better = Held.LINEAR if count > 0 else Held.PREVIOUS
    return HoldFit(name, better, *costs, count, power)


def _standard_error(values: np.ndarray) -> float:
    """Of the mean of a correlated series (Bartlett weights, 4 (n/100)^(2/9) lags)."""
    n = len(values)
    centred = values - np.mean(values)
    lags = min(int(4 * (n / 100.0) ** (2.0 / 9.0)) + 1, n - 1)
    total = float(centred @ centred)
    for k in range(1, lags + 1):
        total += 2.0 * (1.0 - k / (lags + 1.0)) * float(centred[k:] @ centred[:-k])
    return float(np.sqrt(max(total, 0.0))) / n


__all__ = ["HoldFit", "Straight", "beside_linear", "check_holds"]
