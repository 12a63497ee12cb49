"""How far unseen samples are from a simulation that begins at their first measured values less the noise of these."""

from collections.abc import Mapping, Sequence

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.findings.recordings import Score
from plantfit.problem.problem import Problem
from plantfit.trust.finish.start_corrections import ENDED, LARGEST, ROUNDS
from plantfit.trust.intervals.first_values import STEP, outputs_begun_at
from plantfit.trust.verdict.unseen import HOLDS, fitted_rmse


def with_started(problem: Problem, values: np.ndarray, scores: Sequence[Score]) -> list[Score]:
    """The scores, with `started` where an unseen output is followed worse than the fitted samples though the noise of
    first measured values may be why, at parameter values (d,) in their units.

    A simulation that begins at a measured value begins beside the state, and what does not settle stays beside it. The
    noise is estimated from the unseen samples, with parameters as they are, and is no larger than noise can be.
    """
    base = fitted_rmse(scores)
    worse = [
        s for s in scores if s.part == "validation" and s.rmse and s.output in base and s.rmse >= HOLDS * base[s.output]
    ]
    begun = [o for o in outputs_begun_at(problem, problem.space.cube(values)) if o in base] if worse else []
    found: dict[str, Mapping[str, float]] = {}
    for name in dict.fromkeys(s.recording for s in worse) if begun else ():
        if not np.any(problem.experiments[name].mask("fit")):
            found[name] = _started(problem, values, name, {o: base[o] for o in begun}, base)
    return [
        s.model_copy(update={"started": found.get(s.recording, {}).get(s.output)}) if s in worse else s for s in scores
    ]


def _started(
    problem: Problem, values: np.ndarray, name: str, noises: Mapping[str, float], base: Mapping[str, float]
) -> dict[str, float]:
    """The RMSE of each output once the noise of first values (`noises`, in their units) is estimated; none where that
    would have to be larger than noise is."""
    experiment, outputs = problem.experiments[name], list(noises)
    measured = {o: np.asarray(experiment.recording[o], dtype=float) for o in problem.outputs if o in base}
    use = {o: experiment.mask("validation") & np.isfinite(y) for o, y in measured.items()}

    def off(shares: np.ndarray) -> dict[str, np.ndarray]:
        moved = {o: float(share) * noises[o] for o, share in zip(outputs, shares, strict=True)}
        simulated = problem.with_starts({**problem.start_corrections, name: moved}).predict(values, name)
        return {o: (simulated[o] - y)[use[o]] for o, y in measured.items()}

    def rows(shares: np.ndarray) -> np.ndarray:
        return np.concatenate([*(e / base[o] for o, e in off(shares).items()), shares])

    shares = np.zeros(len(outputs))
    for _ in range(ROUNDS):
        here = rows(shares)
        columns = [(rows(shares + STEP * e) - rows(shares - STEP * e)) / (2 * STEP) for e in np.eye(len(shares))]
        if not np.all(np.isfinite(here)) or not np.all(np.isfinite(columns)):
            return {}
        step = -np.linalg.lstsq(np.array(columns).T, here, rcond=None)[0]
        shares = shares + step
        if np.max(np.abs(shares)) > LARGEST:
            return {}
        if np.max(np.abs(step)) <= ENDED:
            break
    return {o: float(np.sqrt(np.mean(e**2))) for o, e in off(shares).items() if len(e) and np.all(np.isfinite(e))}
