"""How far the simulation is from the exact solution: a tight solver, and step doubling."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.runtime import jit
from plantfit.simulate.check.tight import EVALUATIONS, Stopped, Tight, follow, simulated
from plantfit.simulate.simulator import Drive, Simulator
from plantfit.simulate.steps.registry import STEPPERS


@dataclass(frozen=True)
class StepError:
    """Errors of the outputs in their units over the samples [first, last] that were compared, and `checked_with` what.

    `stopped` tells where the tight solver could not follow, so that nothing is compared from there on. It was `spent`
    where it only took all its evaluations there.
    """

    max_error: dict[str, float]
    rms_error: dict[str, float]
    first: int
    last: int
    checked_with: str
    stopped: Stopped | None = None
    spent: bool = False


def check_steps(
    simulator: Simulator,
    p: Mapping[str, Any],
    drive: Drive,
    *,
    evaluations: int = EVALUATIONS,
    tight: Tight | None = None,
) -> StepError:
    """The error of a simulation over the whole record, against the solvers of `tight` and at most so many evaluations
    of theirs.

    `tight` is what they gave, where that is known. Never raises for what a model does: the result tells where it
    `stopped`. Where not one sample behind the first was reached, errors are infinite.
    """
    tight = follow(simulator, p, drive, evaluations=evaluations) if tight is None else tight
    ours = simulated(simulator, p, drive)
    largest, rms, last = {}, {}, 0
    for name, y in tight.outputs.items():
        error = np.abs(ours[name] - y)[np.isfinite(y)]
        error = np.where(np.isfinite(error), error, np.inf)
        last = max(last, len(error) - 1)
        known = len(error) > 1 or tight.stopped is None
        largest[name] = float(np.max(error, initial=0.0)) if known else np.inf
        rms[name] = float(np.sqrt(np.mean(error**2))) if known and len(error) else np.inf
    # with all evaluations spent the first part is compared
    spent = tight.stopped is not None and tight.stopped.spent
    return StepError(largest, rms, 0, last, tight.checked_with, None if spent else tight.stopped, spent)


def by_doubling(simulator: Simulator, p: Mapping[str, Any], drive: Drive) -> StepError:
    """The error of a simulation over the whole record, estimated by halving its steps."""
    estimate = doubling_error(simulator, p, drive)
    largest = {o: float(np.max(e)) for o, e in estimate.items()}
    rms = {o: float(np.sqrt(np.mean(e**2))) for o, e in estimate.items()}
    return StepError(largest, rms, 0, drive.t.shape[0] - 1, "step doubling")


def doubling_error(simulator: Simulator, p: Mapping[str, Any], drive: Drive) -> dict[str, np.ndarray]:
    """Estimated error (N,) of each output: its change when every step is halved, times q / (q - 1), q = 2 ** order."""
    q = 2.0 ** STEPPERS[simulator.stepper].order
    finer = simulator.refined(2)
    coarse, fine = jit(simulator.outputs)(p, drive), jit(finer.outputs)(p, drive)
    return {k: np.abs(np.asarray(coarse[k]) - np.asarray(fine[k])) * q / (q - 1.0) for k in coarse}
