"""How far unseen samples are from a simulation that begins at their first measured values less the noise of these."""

from collections.abc import Mapping, Sequence

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.findings.recordings import Score
from plantfit.findings.residuals import ResidualTest, ShortRecordings
from plantfit.problem.measure.sample_noise import white_part
from plantfit.problem.problem import Problem
from plantfit.trust.finish.start_corrections import ENDED, LARGEST, ROUNDS
from plantfit.trust.intervals.first_values import STEP, outputs_begun_at
from plantfit.trust.validate.foretold import coloured
from plantfit.trust.validate.spare_samples import telling
from plantfit.trust.verdict.unseen import HOLDS

LESS = 0.9  # of the RMSE, from which on noise of the start counts as a part of it


def with_started(
    problem: Problem, values: np.ndarray, scores: Sequence[Score], tests: Sequence[ResidualTest | ShortRecordings]
) -> list[Score]:
    """The scores, with `started` where an unseen output is followed worse than the fitted samples, the noise of first
    measured values is a part of it and no residual speaks against the model, at values (d,) in their units.

    A simulation that begins at a measured value begins beside the state, and what does not settle stays beside it. The
    noise is estimated from the unseen samples, with parameters as they are, and is no larger than it is from sample to
    sample. Of a model that lacks something it cannot be told from what is lacking.
    """
    base: dict[str, float] = {}
    for s in telling(scores):
        base[s.output] = min(s.rmse or 0.0, base.get(s.output, np.inf))
    worse = (
        []
        if coloured(tests)
        else [
            s
            for s in scores
            if s.part == "validation" and s.rmse and s.output in base and s.rmse >= HOLDS * base[s.output]
        ]
    )
    begun = [o for o in outputs_begun_at(problem, problem.space.cube(values)) if o in base] if worse else []
    found = {
        name: _started(problem, values, name, begun, base)
        for name in {s.recording for s in worse if begun}
        if not np.any(problem.experiments[name].mask("fit"))
    }

    def less(s: Score) -> float | None:
        rmse = found.get(s.recording, {}).get(s.output)
        return rmse if rmse is not None and rmse < LESS * (s.rmse or 0.0) else None

    return [s.model_copy(update={"started": less(s)}) if s in worse else s for s in scores]


def _started(
    problem: Problem, values: np.ndarray, name: str, begun: Sequence[str], base: Mapping[str, float]
) -> dict[str, float]:
    """The RMSE of each output of a recording once the noise of the first values of outputs (`begun`) is estimated, in
    their units; none where that would have to be larger than noise is."""
    experiment = problem.experiments[name]
    measured = {o: np.asarray(experiment.recording[o], dtype=float) for o in base}
    use = {o: experiment.mask("validation") & np.isfinite(y) for o, y in measured.items()}

    def off(moved: Mapping[str, float]) -> dict[str, np.ndarray]:
        simulated = problem.with_starts({**problem.start_corrections, name: moved}).predict(values, name)
        return {o: (simulated[o] - y)[use[o]] for o, y in measured.items()}

    first = off({})
    noises = np.array([min(base[o], white_part(first[o])) for o in begun])
    if not np.all(noises > 0):
        return {}

    def errors(shares: np.ndarray) -> dict[str, np.ndarray]:
        return off(dict(zip(begun, (shares * noises).tolist(), strict=True)))

    def rows(shares: np.ndarray) -> np.ndarray:
        return np.concatenate([*(e / base[o] for o, e in errors(shares).items()), shares])

    shares = np.zeros(len(begun))
    for _ in range(ROUNDS):
        here = rows(shares)
        columns = [(rows(shares + STEP * e) - rows(shares - STEP * e)) / (2 * STEP) for e in np.eye(len(shares))]
        if not np.all(np.isfinite(here)) or not np.all(np.isfinite(columns)):
            return {}
        step = -np.linalg.lstsq(np.array(columns).T, here, rcond=None)[0]
        shares = shares + step
        if not np.max(np.abs(shares)) <= LARGEST:
            return {}
        if np.max(np.abs(step)) <= ENDED:
            break
    return {o: float(np.sqrt(np.mean(e**2))) for o, e in errors(shares).items() if len(e) and np.all(np.isfinite(e))}
