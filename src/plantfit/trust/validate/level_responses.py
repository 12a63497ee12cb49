"""Which steps of a staircase moved an output by more than it wanders on its own."""

from dataclasses import dataclass

import numpy as np

from plantfit.recording.clean.levels import levels
from plantfit.recording.record import Recording
from plantfit.trust.verdict.words import with_unit

SETTLED = 0.5  # share at the end of a level over which it counts as settled
MARGIN = (
    2.0  # either of two settled means may be off by half of the drift, so that a response this large is known to a half
)
SMOOTHED = 20  # pieces of the settled part whose means show how the output wanders


@dataclass(frozen=True)
class LevelResponse:
    """A step of an input from `before` to `level` at `start` (s): by how much the settled output moved, and its
    `drift`, the range over which it wanders while the input stays (both in its unit). `told`: the response is over
    twice that range."""

    start: float
    before: float
    level: float
    response: float
    drift: float
    told: bool
    sentence: str


def level_responses(recording: Recording, input: str, output: str) -> list[LevelResponse]:
    """Every step of a staircase of `input`, judged without a model.

    The response is the difference of means over the last half of two levels; the drift is the larger range, on either
    level, of means over twentieths of that half. Where twice the drift is as large as the response, a gain or a dead
    time fitted to that step may describe the drift. Raises RecordingError where the input has no steps.
    """
    pieces = levels(recording, input)
    settled = [_settled(p[output]) for p in pieces]
    unit_in, unit = recording.signals[input].unit, recording.signals[output].unit
    judged = []
    for old, new, was, now in zip(pieces[:-1], pieces[1:], settled[:-1], settled[1:], strict=True):
        before, level = float(old[input][-1]), float(new[input][0])
        response, drift = float(now.mean() - was.mean()), float(max(np.ptp(was), np.ptp(now)))
        told = abs(response) > MARGIN * drift
        step = (
            f"The step of {input} from {before:.3g} to {with_unit(level, unit_in)} moved {output} by "
            f"{with_unit(response, unit)}, and it"
        )
        tail = "wanders by {} at rest: " + (
            "the step shows." if told else "neither its gain nor its dead time can be told."
        )
        judged.append(
            LevelResponse(
                float(new.t[0]), before, level, response, drift, told, f"{step} {tail.format(with_unit(drift, unit))}"
            )
        )
    return judged


def _settled(values: np.ndarray) -> np.ndarray:
    """Means over pieces of the last half; missing samples left out."""
    late = values[len(values) - max(2, int(SETTLED * len(values))) :]
    return np.array([np.nanmean(part) for part in np.array_split(late, min(SMOOTHED, len(late)))])
