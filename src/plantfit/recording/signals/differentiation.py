"""What a choice of differentiation does: methods side by side on a known path seen by a sensor."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.record import Recording, Signal
from plantfit.recording.signals.derivative import differentiate

DEFAULT_METHODS: tuple[Mapping[str, Any], ...] = (
    {"method": "central"},
    {"method": "savgol", "window": 21},
    {"method": "butterworth", "cutoff": "residual"},
    {"method": "butterworth", "cutoff": "gcv"},
    {"method": "kalman", "cutoff": "likelihood"},
    {"method": "spline"},
)


@dataclass(frozen=True)
class DerivativeError:
    """RMSE of one method against the true derivatives (signal's unit per s and per s^2), `log` its sentence with the
    cut-off."""

    settings: Mapping[str, Any]
    velocity: float
    acceleration: float
    log: str


def compare_derivatives(
    t: np.ndarray,
    path: Callable[[np.ndarray], np.ndarray],
    velocity: Callable[[np.ndarray], np.ndarray],
    acceleration: Callable[[np.ndarray], np.ndarray],
    *,
    step: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
    edge: float = 0.05,
    methods: Sequence[Mapping[str, Any]] = DEFAULT_METHODS,
) -> list[DerivativeError]:
    """Errors of each of `methods` (settings of `differentiate`) on a `path` with known derivatives, functions of time
    (s).

    The sensor adds white `noise` (standard deviation), then rounds to `step`; `seed` draws the noise. The first and
    last share `edge` of the samples is not scored. Raises RecordingError for settings that do not fit a method and for
    uneven times where one needs even.
    """
    t = np.asarray(t, dtype=float)
    if not 0 <= edge < 0.5:
        raise RecordingError(f"compare_derivatives: edge is {edge!r}; give a share from 0 to below 0.5.")
    seen = path(t) + noise * np.random.default_rng(seed).standard_normal(len(t))
    if step:
        seen = np.round(seen / step) * step
    recording = Recording(t, {"x": Signal(seen)}, "path")
    margin = int(edge * len(t))
    inside = slice(margin, len(t) - margin)
    rows = []
    for settings in methods:
        made = [differentiate(recording, "x", "d", derivative=k, **settings) for k in (1, 2)]
        true = velocity(t), acceleration(t)
        errors = [float(np.sqrt(np.mean((m["d"] - v)[inside] ** 2))) for m, v in zip(made, true, strict=True)]
        rows.append(DerivativeError(dict(settings), errors[0], errors[1], made[0].log[-1]))
    return rows
