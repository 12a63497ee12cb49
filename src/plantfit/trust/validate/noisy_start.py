"""Residuals without what noise of a first measured value leaves in them, where a simulation begins there.

A state that begins at a measured value begins wrongly by the noise of that sample, and the simulation comes back to the plant as fast as
the plant forgets. That is a pattern in the residuals of a right model.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.first_values import beside, value_effects
from plantfit.trust.intervals.linearised import named_blocks

LARGEST = 4.0  # standard deviations of the noise that a first value may be off; more is no noise


class Begun(NamedTuple):
    """What a first value leaves in the residuals of one output, and by how much the value is off, both in the output's unit."""

    left: np.ndarray  # (n,) of all samples of the recording, measured minus simulated
    off: float


def left_by_first_values(problem: Problem, z: np.ndarray) -> Mapping[tuple[str, str], Begun]:
    """By recording and output, at the answer z (d,); those whose own first value is no part of a start are left out.

    The likeliest errors of all first values, normally distributed with the noise of their outputs, beside what parameters take in.
    """
    if problem.start_corrections:
        return {}  # the fit has estimated these errors
    blocks = named_blocks(problem)
    effects = value_effects(problem, z, [block for _, _, block in blocks])
    if not effects:
        return {}
    residuals, jacobian = residuals_and_jacobian(problem.unsmoothed, z)
    columns = np.stack([e.column for e in effects], axis=1)
    columns = beside(jacobian, columns)
    before = max(float(np.mean(residuals**2)), 1e-300)
    rest = residuals - columns @ np.linalg.lstsq(columns, residuals, rcond=1e-12)[0]
    size = max(float(np.mean(rest**2)), 1e-12 * before)
    smaller = np.sqrt(size / before)  # the noise was taken from residuals that hold what first values leave
    columns *= smaller
    by_noise = np.linalg.solve(columns.T @ columns / size + np.eye(len(effects)), columns.T @ residuals / size)
    if np.max(np.abs(by_noise)) > LARGEST:
        return {}
    left, rows = columns @ by_noise, {(name, output): block.rows for name, output, block in blocks}
    found = {}
    for effect, times in zip(effects, by_noise, strict=True):
        key = effect.recording, effect.output
        weight = 1.0 if problem.weights is None else float(problem.weights[effect.recording])
        whole = np.zeros(len(problem.experiments[effect.recording].recording))
        whole[problem.data["index"][effect.recording][effect.output]] = (
            -left[rows[key]] * float(problem.scales[effect.output]) / np.sqrt(weight)
        )
        found[key] = Begun(whole, float(times * smaller) * effect.noise)
    return found
