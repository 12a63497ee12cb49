"""How large an error on unseen samples the uncertainty of the parameters and the noise foretell, for a model that is
right."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import fdtri

import plantfit.runtime  # noqa: F401
from plantfit.findings.recordings import Score
from plantfit.findings.residuals import ResidualTest, ShortRecordings
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.linearised import Local, natural_sizes
from plantfit.trust.validate.spare_samples import telling
from plantfit.trust.verdict.unseen import HOLDS

CHANCE = 0.01  # of a larger error, if the model is right
MOST = 60  # parameters: beyond, so many simulations take too long
FAR = 0.5  # of the size of a parameter: no step of a derivative is longer


def with_foretold(
    problem: Problem, local: Local, scores: Sequence[Score], tests: Sequence[ResidualTest | ShortRecordings]
) -> list[Score]:
    """The scores, with `foretold` where an unseen output is followed worse than the fitted samples and its residuals
    do not speak against the model: they are white in all recordings, as far as they were tested."""
    fitted = telling(scores)
    samples, d = sum(s.n for s in fitted), len(local.values)
    sound = local.linear is None or local.linear.sound
    if d > MOST or samples <= d or not sound:
        return list(scores)
    against = coloured(tests)
    left = (samples if local.linear is None else min(samples, local.linear.samples)) - d
    moved: dict[str, Mapping[str, np.ndarray] | None] = {}
    found = []
    for s in scores:
        own = [f for f in fitted if f.output == s.output and f.recording == s.recording] or [
            f for f in fitted if f.output == s.output
        ]
        if (
            s.part == "fit"
            or s.output in against
            or not own
            or not s.rmse
            or (s.rmse if s.started is None else s.started) < HOLDS * min(f.rmse or 0.0 for f in own)
        ):
            found.append(s)
            continue
        noise = sum(f.n * (f.rmse or 0.0) ** 2 for f in own) / sum(f.n for f in own) * samples / (samples - d)
        if s.recording not in moved:
            moved[s.recording] = deviations(problem, local, s.recording)
        found.append(s.model_copy(update={"foretold": _most(problem, s, moved[s.recording], noise, max(left, 1.0))}))
    return found


def coloured(tests: Sequence[ResidualTest | ShortRecordings]) -> set[str]:
    """Outputs whose residuals speak against the model, in any recording and by more than chance."""
    return {t.output for t in tests if (t.p_value or 0.0) <= CHANCE / sum(o.output == t.output for o in tests)}


def deviations(problem: Problem, local: Local, name: str) -> dict[str, np.ndarray] | None:
    """What a standard deviation along each principal direction of the parameters' covariance does to every output
    (d, n) of a recording, linearised at the answer by differences of up to a standard deviation; None where it
    cannot be simulated nearby."""
    size = natural_sizes(problem.space, local.values)
    size = np.where(size > 0.0, size, problem.space.upper - problem.space.lower)
    least, most = np.array([c.limits for c in problem.space.coordinates]).reshape(-1, 2).T
    squares, vectors = np.linalg.eigh(local.covariance / np.outer(size, size))
    found: dict[str, list[np.ndarray]] = {o: [] for o in problem.outputs}
    for deviation, direction in zip(np.sqrt(np.maximum(squares, 0.0)), vectors.T, strict=True):
        step = deviation * direction
        if not (longest := float(np.max(np.abs(step)))):
            continue
        part = min(1.0, FAR / longest)
        ends = [
            problem.predict(np.clip(local.values + sign * part * step * size, least, most), name)
            for sign in (-1.0, 1.0)
        ]
        for output, courses in found.items():
            change = (ends[1][output] - ends[0][output]) / (2.0 * part)
            if not np.all(np.isfinite(change)):
                return None
            courses.append(change)
    return {o: np.array(courses).reshape(len(courses), -1) for o, courses in found.items()}


def _most(
    problem: Problem, score: Score, moved: Mapping[str, np.ndarray] | None, noise: float, left: float
) -> float | None:
    """The RMSE that is exceeded by `CHANCE`: a sum of weighted squares of normal numbers, noise and directions, over
    its variance's own estimate, of `left` degrees of freedom; the weights' sum as one chi-square (Satterthwaite,
    Biometrics Bull. 2 (1946) 110)."""
    if moved is None:
        return None
    experiment = problem.experiments[score.recording]
    use = experiment.mask("validation") & np.isfinite(experiment.recording[score.output])
    courses = moved[score.output][:, use]
    by_direction = np.maximum(np.linalg.eigvalsh(courses @ courses.T / score.n), 0.0)
    mean = noise + float(np.sum(by_direction))
    degrees = mean**2 / (noise**2 / score.n + float(np.sum(by_direction**2)))
    return float(np.sqrt(mean * fdtri(degrees, left, 1.0 - CHANCE)))
