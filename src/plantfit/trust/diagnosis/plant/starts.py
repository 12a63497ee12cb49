"""Starts at first measured values less their noise, estimated anew beside what was found.

A fit that lacks something puts a part of it into these starts. Held there, they would ask for an initial value that
nothing is wrong with, as soon as what is missing was found.
"""

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.measure.sample_noise import white_part
from plantfit.trust.diagnosis.plant.carrier import Carrier
from plantfit.trust.diagnosis.plant.hypothesis import Fitted, columns, fitted, lengths, residuals_at
from plantfit.trust.finish.start_corrections import LARGEST, TAKEN_UP
from plantfit.trust.intervals.first_values import outputs_begun_at

STEP = 1e-3  # of the noise of an output: by how much starts are moved for a derivative
ROUNDS = 3  # of estimates; of linear plants the second one changes nothing
STAYS = 0.01  # of the noise: a move that changes nothing

Starts = dict[tuple[str, str], float]  # recording and output -> what is added to the first measured value


def begun_anew(carrier: Carrier, base: Fitted, use: np.ndarray) -> tuple[Carrier, Fitted] | None:
    """The carrier with starts as they are best beside the additions of a fit, and that fit there; None where nothing
    changes.

    Only starts at first values that are samples of the fit, over the rows `use` (m,) bool. One that would be off by
    more than noise can be begins where it was measured, and an initial value is looked for there. Where the additions
    have one, it is in the place of all.
    """
    starts = _scored(carrier, use)
    if not starts or any(a.kind == "start" for a in base.additions):
        return None
    begun, at, moved = carrier, base, False
    for _ in range(ROUNDS):
        noises = _noises(begun, at, starts)
        steps = _steps(begun, at, use, starts, noises)
        if all(abs(step) <= STAYS * noises[k] for k, step in steps.items()):
            break
        moved = True
        tried = {k: starts[k] + step for k, step in steps.items()}
        starts = {**starts, **{k: v if abs(v) <= LARGEST * noises[k] else 0.0 for k, v in tried.items()}}
        begun = begun.with_starts(_by_recording(carrier, starts))
        at = fitted(begun, at.additions, at.x, at.theta, use)
    return (begun, at) if moved and at.cost(use) < base.cost(use) else None


def _scored(carrier: Carrier, use: np.ndarray) -> Starts:
    """What is added to the first measured values that states begin at and that are samples of the fit."""
    found, rows, given = {}, carrier.rows, carrier.given
    for output in outputs_begun_at(given, carrier.z):
        for name, experiment in given.experiments.items():
            at = rows.part(name, output)
            seen = at[np.isfinite(rows.measured[at])]
            if len(seen) and use[seen[0]]:
                found[name, output] = float(experiment.start_corrections.get(output, 0.0))
    return found


def _noises(carrier: Carrier, at: Fitted, starts: Starts) -> Starts:
    """The noise of each output from sample to sample that a fit leaves, in its unit."""
    rows, scales = carrier.rows, carrier.given.scales
    found = {}
    for name, output in starts:
        own = rows.part(name, output)
        noise = white_part(at.residuals[own] / rows.weight[own]) * float(scales[output])
        found[name, output] = noise if noise > 0 else 1e-9 * float(scales[output])
    return found


def _steps(carrier: Carrier, at: Fitted, use: np.ndarray, starts: Starts, noises: Starts) -> Starts:
    """Moves of the starts, in their units, to the minimum of the linear problem with all that is fitted; none of those
    that parameters take up, as a model may say itself by how much a state begins off its first measured value."""
    own: dict[tuple[str, str], np.ndarray] = {}
    for output in dict.fromkeys(output for _, output in starts):
        tried = {k: v + STEP * noises[k] for k, v in starts.items() if k[1] == output}
        moved = carrier.with_starts(_by_recording(carrier, {**starts, **tried}))
        change = (residuals_at(moved, at.additions, at.x, at.theta) - at.residuals) / STEP
        own |= {k: np.where(carrier.rows.recording == k[0], change, 0.0)[use] for k in tried}
    known = at.jacobian[np.ix_(use, columns(carrier, at.additions))]
    known = known / lengths(known)
    for k, column in list(own.items()):
        left = column - known @ np.linalg.lstsq(known, column, rcond=1e-12)[0]
        if not np.linalg.norm(left) > TAKEN_UP * np.linalg.norm(column):
            del own[k]
    a = np.column_stack([known, *own.values()])
    norms = lengths(a)
    step = -np.linalg.lstsq(a / norms, at.residuals[use], rcond=1e-12)[0] / norms
    found = {k: float(v) * noises[k] for k, v in zip(own, step[known.shape[1] :], strict=True)}
    return {k: found.get(k, 0.0) for k in starts}


def _by_recording(carrier: Carrier, starts: Starts) -> dict[str, dict[str, float]]:
    """All starts of a carrier, these among them."""
    found = {n: dict(own) for n, own in carrier.given.start_corrections.items()}
    for (name, output), value in starts.items():
        found.setdefault(name, {})[output] = value
    return found
