"""Samples that nothing is left of once the parameters follow them: that a model follows these shows nothing."""

from collections.abc import Sequence

import numpy as np

from plantfit.findings.recordings import Score
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.evaluate.triangle import triangle
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.covariance import Block
from plantfit.trust.intervals.linearised import Local, named_blocks
from plantfit.trust.verdict.outputs import SPARE

RANK = 1e-10  # of the largest singular value, columns normed


def with_spare(problem: Problem, z: np.ndarray, local: Local, scores: Sequence[Score]) -> list[Score]:
    """The scores, with `spare` for fitted samples that are no more than there are free parameters."""
    few = {(s.recording, s.output) for s in scores if s.part == "fit" and s.n <= problem.space.dimension}
    if not few:
        return list(scores)
    left = spare_samples(problem, z, np.array([b is None for b in local.at_bound]))
    return [
        s.model_copy(update={"spare": left[key]}) if s.part == "fit" and (key := (s.recording, s.output)) in few else s
        for s in scores
    ]


def telling(scores: Sequence[Score]) -> list[Score]:
    """Those of fitted samples whose RMSE tells how well the model follows its output."""
    return [s for s in scores if s.part == "fit" and s.rmse and not (s.spare is not None and s.spare < SPARE)]


def spare_samples(problem: Problem, z: np.ndarray, free: np.ndarray) -> dict[tuple[str, str], float]:
    """As `spare_of`, at the cube point z (d,) with the problem's weights; coordinates not `free` (d,), on their
    bounds, follow nothing."""
    j = residuals_and_jacobian(problem.unsmoothed, z)[1][:, free]
    return spare_of(j, named_blocks(problem), problem.smoothing.weighted(z)[1][:, free] if problem.smoothing else None)


def spare_of(
    j: np.ndarray, named: Sequence[tuple[str, str, Block]], bends: np.ndarray | None = None
) -> dict[tuple[str, str], float]:
    """By recording and output, how many fitted samples there are beyond the parameters that follow them: n less the
    leverages' sum.

    By the derivatives (m, d) of the residuals, and of what smoothing adds (k, d) (D. A. Belsley and others, Regression
    Diagnostics, 1980, section 2.1).
    """
    rows = j if bends is None else np.vstack([j, bends])
    size = np.sqrt(np.sum(rows**2, axis=0))
    size = np.where(size > 0.0, size, 1.0)
    _, singular, right = np.linalg.svd(triangle(rows / size), full_matrices=False)
    kept = singular > RANK * max(float(np.max(singular, initial=0.0)), 1e-300)
    turn = right[kept].T / singular[kept] / size[:, None]
    return {(name, o): len(j[block.rows]) - float(np.sum((j[block.rows] @ turn) ** 2)) for name, o, block in named}
