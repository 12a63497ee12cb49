"""Whether standard errors allow for residuals that are correlated in time, where the user did not say."""

from collections.abc import Sequence

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.measure.long_run import first_correlation
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording
from plantfit.trust.intervals.covariance import Block
from plantfit.trust.validate.residuals.residual_tests import whiteness

TESTED = 20  # samples of an output in one recording from which on its residuals are tested
# how often white residuals are taken for correlated by either test, and the normal quantile of that
CHANCE, ONE_SIDED = (0.01, 2.326)


def robust_errors(problem: Problem, residuals: np.ndarray, blocks: Sequence[Block]) -> bool:
    """Whether standard errors are robust, from the residuals (m,) at an answer.

    They are as the user asked, and for models in time. A model without time has classical ones, for its rows may stand
    in any order. But where its rows have times, and their residuals are correlated beyond chance, the rows are samples
    one after another and count for fewer than they are.
    """
    if problem.standard_errors is not None or problem.in_time:
        return problem.robust
    return timed(problem) and _correlated(residuals, blocks)


def timed(problem: Problem) -> bool:
    """Whether rows of any recording of the problem have times, and not only numbers from 0 or 1 that no column of time
    gave."""
    return any(has_times(e.recording) for e in problem.experiments.values())


def has_times(recording: Recording) -> bool:
    """Whether the rows of a recording have times, and not only such numbers."""
    t = recording.t
    return recording.clocked or t[0] not in (0.0, 1.0) or not np.array_equal(t - t[0], np.arange(len(t)))


def _correlated(residuals: np.ndarray, blocks: Sequence[Block]) -> bool:
    """Whether neighbours are alike (the mean first correlation of all blocks), or any block fails the test of Ljung
    and Box."""
    own = [residuals[b.rows] for b in blocks]
    tested = [r - np.mean(r) for r in own if len(r) >= TESTED and np.std(r) > 0.0]
    if not tested:
        return False
    counts = np.array([len(r) for r in tested])
    first = np.array([first_correlation(r[:, None])[0] for r in tested])
    alike = float(counts @ first) / float(np.sqrt(counts.sum()))
    return bool(alike > ONE_SIDED or min(whiteness(r)[1] for r in tested) < CHANCE / len(tested))
