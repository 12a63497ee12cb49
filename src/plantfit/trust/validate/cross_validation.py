"""Cross-validation by whole recordings: each left out in turn, and the choice between candidates."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from plantfit.errors import RecordingError

Data = TypeVar("Data")
Fitted = TypeVar("Fitted")


@dataclass(frozen=True)
class LeftOut(Generic[Fitted]):
    """What was fitted without a recording, and its scores on it by name (RMSE of an output, or what else was asked)."""

    fitted: Fitted
    scores: Mapping[str, float]


def leave_one_out(
    recordings: Mapping[str, Data],
    fit: Callable[[dict[str, Data]], Fitted],
    score: Callable[[Fitted, Data], Mapping[str, float]],
) -> dict[str, LeftOut[Fitted]]:
    """By recording: `fit` to all the others, `score` on it.

    Everything learned from data belongs into `fit`, the choice of a filter or of a shape as well, or the score is no
    longer of unseen data. Samples of one recording are never split, because neighbours in time are nearly the same.
    Raises RecordingError for fewer than two recordings.
    """
    if len(recordings) < 2:
        raise RecordingError(
            f"leave_one_out: there are {len(recordings)} recordings; give at least two, or cut one into parts."
        )
    made = {}
    for name, held in recordings.items():
        fitted = fit({n: r for n, r in recordings.items() if n != name})
        made[name] = LeftOut(fitted, dict(score(fitted, held)))
    return made


@dataclass(frozen=True)
class Choice:
    """The candidate of the least mean score; `gains`: by how much its mean is below each other's, with that gain's
    standard error."""

    best: str
    means: Mapping[str, float]
    gains: Mapping[str, tuple[float, float]]


def choose(scores: Mapping[str, Sequence[float]]) -> Choice:
    """The best of candidates scored on the same recordings, each (recordings,), the less the better.

    Gains are paired by recording, so that recordings which are hard for all do not hide them; with few recordings their
    standard errors are rough. Raises RecordingError for lists of different lengths.
    """
    sizes = {len(s) for s in scores.values()}
    if len(sizes) != 1 or sizes == {0}:
        raise RecordingError(
            f"choose: the candidates have {sorted(sizes)} scores; score all of them on the same recordings."
        )
    means = {n: float(np.mean(s)) for n, s in scores.items()}
    best = min(means, key=lambda n: means[n])
    gains = {}
    for name, own in scores.items():
        if name != best:
            gain = np.asarray(own, dtype=float) - np.asarray(scores[best], dtype=float)
            error = float(np.std(gain, ddof=1) / np.sqrt(len(gain))) if len(gain) > 1 else float("nan")
            gains[name] = (float(np.mean(gain)), error)
    return Choice(best, means, gains)
