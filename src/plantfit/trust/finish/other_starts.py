"""First measured values that states cannot begin at, of a record that is not followed: an epidemic of which nobody is
infected at first, or fewer than nobody."""

from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.measure.sample_noise import white_part
from plantfit.problem.problem import Problem
from plantfit.sobol import Sobol
from plantfit.trust.finish.descent import Descent, descent
from plantfit.trust.finish.start_corrections import Key, by_recording, with_starts_from_afar
from plantfit.trust.intervals.first_values import outputs_begun_at
from plantfit.trust.intervals.linearised import named_blocks

FIRST = 5  # samples that tell where a record may begin
PLACES = (0.5, 0.8)  # of them, in order of size, at which it is tried to begin
SEARCHES = 8  # from each place, and as many Jacobians each
STEPS = 60
LEFT = 0.1  # of the cost, at most, that other starts leave
NOISES = 2.0  # times the sample-to-sample noise, at most, that they leave
LONG, MANY = 20_000, 60  # samples of all records, and coordinates, beyond which that takes too long


@dataclass(frozen=True)
class OtherStarts:
    """First measured values by recording and output, `measured` and those that the record asks for (`instead`), in the
    output's unit; RMSE of each output `before` and `after`, the noise from sample to sample that is left (`noise`)."""

    measured: dict[Key, float]
    instead: dict[Key, float]
    before: dict[str, float]
    after: dict[str, float]
    noise: dict[str, float]


def other_starts(problem: Problem, z: np.ndarray) -> OtherStarts | None:
    """Where the states of a problem begin at first measured values, and other values in their place follow the records
    down to their noise, which its answer z (d,) does not; None elsewhere, and where looking would take long."""
    outputs = outputs_begun_at(problem, z)
    samples = sum(len(e.recording) for e in problem.experiments.values())
    if not outputs or samples > LONG or problem.space.dimension > MANY or problem.weights is not None:
        return None
    problem = problem.unsmoothed
    seen = {
        (name, o): y[np.isfinite(y)]
        for name in problem.data["drive"]
        for o in outputs
        for y in (np.asarray(problem.experiments[name].recording[o], dtype=float),)
        if np.isfinite(y).any()
    }
    measured = {key: float(y[0]) for key, y in seen.items()}
    before = float(problem.costs(z[None])[0])
    found: tuple[Problem, Descent] | None = None
    # the answer itself, and points elsewhere: of a start that says nothing the search has learnt nothing
    starts = [z, *Sobol(problem.space.dimension, np.random.default_rng(1)).random(SEARCHES - 1)]
    for place in PLACES:
        moved = {key: float(np.quantile(y[1 : FIRST + 1], place)) - y[0] for key, y in seen.items() if len(y) > FIRST}
        made = problem.with_starts(by_recording(moved))
        costs = np.asarray(made.costs(np.array(starts)))
        for k in np.argsort(costs)[: SEARCHES // 2]:
            if not np.isfinite(costs[k]):
                continue
            end = descent(made, starts[k], STEPS * problem.jacobian_charge)
            if np.isfinite(end.cost) and (found is None or end.cost < found[1].cost):
                found = made, end
    if found is None or not found[1].cost < before:
        return None
    made, end = with_starts_from_afar(*found)
    if end.cost > LEFT * before:
        return None
    after, noise = rmse_and_noise(made, end.z)
    if any(after[o] > NOISES * noise[o] for o in after if noise[o] > 0):
        return None
    corrections = made.start_corrections
    instead = {k: v + corrections.get(k[0], {}).get(k[1], 0.0) for k, v in measured.items()}
    return OtherStarts(measured, instead, rmse_and_noise(problem, z)[0], after, noise)


def rmse_and_noise(problem: Problem, z: np.ndarray) -> tuple[dict[str, float], dict[str, float]]:
    """RMSE and sample-to-sample noise of each output over all recordings, in its unit; no number where it cannot be
    simulated at z (d,). Outputs without fitted samples are left out."""
    residuals = np.asarray(problem.residuals(z))
    own: dict[str, list[np.ndarray]] = {}
    for _, output, block in named_blocks(problem):
        own.setdefault(output, []).append(residuals[block.rows] * problem.scales[output])
    with np.errstate(all="ignore"):
        size = {o: float(np.sqrt(np.mean(np.concatenate(r) ** 2))) for o, r in own.items()}
        return size, {o: float(np.sqrt(np.mean([white_part(one) ** 2 for one in r]))) for o, r in own.items()}


__all__ = ["OtherStarts", "other_starts", "rmse_and_noise"]
