"""States that begin at first measured values, without the noise of these samples.

A state that begins at a measured value begins wrongly by the noise of that one sample, and so do the parameters that
make up for it: the time constant of a step has 1.8 times the spread that its record allows. The noise is estimated
together with the parameters, as a free start would be: the measured value is one sample of the output as the others
are. Recordings that are not fitted begin where they are measured.
"""

from collections.abc import Mapping, Sequence

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.measure.sample_noise import white_part
from plantfit.problem.problem import Problem
from plantfit.trust.finish.descent import Descent, descent
from plantfit.trust.intervals.first_values import ValueEffect, is_scored, value_effects
from plantfit.trust.intervals.linearised import named_blocks

Key = tuple[str, str]  # recording and output

# times the sample-to-sample noise that a first value may be off; more is no noise, and the start stays where it was
# measured
LARGEST = 5.0
TAKEN_UP = 0.01  # of what a first value does to the residuals, below which the parameters do it all
HALVED = (1.0, 0.5, 0.25, 0.125)  # parts of a step that are tried where the start is far from where it belongs
ROUNDS, ENDED = 5, 1e-3  # of estimates, and standard deviations of the noise that the last of them may move a start


def with_start_corrections(problem: Problem, last: Descent) -> tuple[Problem, Descent]:
    """The problem whose states begin at first measured values less their noise, and the search gone on there from where
    it stood (`last`).

    A first value that is not scored (`skip`) counts as a sample of the noise that the others have. One that would be
    off by more than noise can be stays where it was measured. Problem and search stay as they were where states begin
    elsewhere, and where the cost is not lower.
    """
    noises = _noises(problem, last.z)
    if not noises:
        return problem, last
    effects = _open(problem.with_starts(by_recording(dict.fromkeys(noises, 0.0))), last.z)
    while effects:
        made, end, far = _estimated(problem, last, effects, noises)
        if not far:
            return (made, end) if end.cost < last.cost else (problem, last)
        effects = [e for e in effects if (e.recording, e.output) not in far]
    return problem, last


def _estimated(
    problem: Problem, last: Descent, effects: Sequence[ValueEffect], noises: Mapping[Key, float]
) -> tuple[Problem, Descent, list[Key]]:
    """The problem with the starts that the `effects` are of estimated, the search gone on there, and those starts
    that are too far off."""
    starts = {(e.recording, e.output): 0.0 for e in effects}
    made, end = problem.with_starts(by_recording(starts)), last
    for _ in range(ROUNDS):
        times, moved = _step(made, end.z, effects, noises)
        for effect, share in zip(effects, times, strict=True):
            starts[effect.recording, effect.output] += float(share) * effect.noise
        if far := [k for k, v in starts.items() if not abs(v) <= LARGEST * noises[k]]:
            return made, end, far
        made = made.with_starts(by_recording(starts))
        end = descent(made, np.clip(end.z + moved, 0.0, 1.0))
        if np.max(np.abs(times)) <= ENDED:
            break
        effects = _effects(made, end.z)
    return made, end, []


def with_starts_from_afar(problem: Problem, last: Descent) -> tuple[Problem, Descent]:
    """The problem with all its `start_corrections` estimated anew from where they are, however far off they end, and
    the search gone on there from where it stood (`last`); as they were where the cost is not lower."""
    effects, made, end = _effects(problem, last.z), problem, last
    starts = {(e.recording, e.output): problem.start_corrections[e.recording][e.output] for e in effects}
    for _ in range(4 * ROUNDS):
        scored = [e for e in _effects(made, end.z) if is_scored(made, e)]
        if not scored:
            break
        times, moved = _step(made, end.z, scored, {})
        better = None
        for part in HALVED:
            tried = dict(starts)
            for effect, share in zip(scored, times, strict=True):
                tried[effect.recording, effect.output] += part * float(share) * effect.noise
            other = made.with_starts(by_recording(tried))
            gone = descent(other, np.clip(end.z + part * moved, 0.0, 1.0))
            if gone.cost < end.cost:
                better = other, gone, tried
                break
        if better is None:
            break
        made, end, starts = better
        if np.max(np.abs(times)) <= ENDED:
            break
    return made, end


def by_recording(found: Mapping[Key, float]) -> dict[str, dict[str, float]]:
    """The same by recording and then by output."""
    rows: dict[str, dict[str, float]] = {}
    for (name, output), value in found.items():
        rows.setdefault(name, {})[output] = value
    return rows


def _noises(problem: Problem, z: np.ndarray) -> dict[Key, float]:
    """The sample-to-sample noise of outputs that states begin at, where it can be told, in the output's unit."""
    if problem.start_corrections:
        return {}
    effects, found = _effects(problem, z), dict[Key, float]()
    if not effects:  # nothing begins at a measured value: no derivatives are compiled for it
        return found
    rows = {(name, output): block.rows for name, output, block in named_blocks(problem)}
    residuals = residuals_and_jacobian(problem.unsmoothed, z)[0]
    for effect in effects:
        key = name, output = effect.recording, effect.output
        weight = 1.0 if problem.weights is None else float(problem.weights[name])
        noise = white_part(residuals[rows[key]]) * float(problem.scales[output]) / np.sqrt(weight)
        if noise > 0:
            found[key] = noise
    return found


def _effects(problem: Problem, z: np.ndarray) -> list[ValueEffect]:
    found = value_effects(problem, z, [block for _, _, block in named_blocks(problem)])
    starts = problem.start_corrections
    return [e for e in found if e.output in starts.get(e.recording, ())] if starts else found


def _open(problem: Problem, z: np.ndarray) -> list[ValueEffect]:
    """Starts whose move is none of parameters: a model may say itself by how much a state begins off its first
    measured value."""
    effects, jacobian = _effects(problem, z), residuals_and_jacobian(problem.unsmoothed, z)[1]
    if not effects:
        return []
    columns = np.stack([e.column for e in effects], axis=1)
    left = np.linalg.norm(_beside(jacobian, columns), axis=0) > TAKEN_UP * np.linalg.norm(columns, axis=0)
    return [e for e, own in zip(effects, left, strict=True) if own]


def _beside(jacobian: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """What parameters with derivatives (m, d) cannot take up of the columns (m, k)."""
    scaled = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    return columns - scaled @ np.linalg.lstsq(scaled, columns, rcond=1e-12)[0]


def _step(
    problem: Problem, z: np.ndarray, effects: Sequence[ValueEffect], noises: Mapping[Key, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Moves of the starts (k,), in standard deviations of their noise, and of the cube point (d,), to the minimum of
    the linear problem."""
    residuals, jacobian = residuals_and_jacobian(problem.unsmoothed, z)
    columns = np.stack([e.column for e in effects], axis=1)
    if problem.smoothing is not None:
        bends, by = problem.smoothing.weighted(z)
        residuals, jacobian = np.r_[residuals, bends], np.vstack([jacobian, by])
        columns = np.vstack([columns, np.zeros((len(bends), len(effects)))])
    size = float(np.sqrt(np.mean(residuals**2)))
    for k, e in enumerate(effects):
        if not is_scored(problem, e):
            noise, row = noises[e.recording, e.output], np.zeros((1, len(effects)))
            row[0, k] = size * e.noise / noise
            residuals = np.r_[residuals, size * problem.start_corrections[e.recording][e.output] / noise]
            jacobian, columns = np.vstack([jacobian, np.zeros((1, len(z)))]), np.vstack([columns, row])
    inside = (z > 0.0) & (z < 1.0)
    j = np.hstack([jacobian[:, inside], columns])
    norms = np.maximum(np.linalg.norm(j, axis=0), 1e-300)
    step = -np.linalg.lstsq(j / norms, residuals, rcond=1e-12)[0] / norms
    moved = np.zeros_like(z)
    moved[inside] = step[: inside.sum()]
    return step[inside.sum() :], moved
