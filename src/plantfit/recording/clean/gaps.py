"""Short gaps filled, long ones left."""

from typing import Literal

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.sampling import require_positive, signal_of, with_signal
from plantfit.recording.record import Recording


def fill_gaps(
    recording: Recording, name: str, longest: float, method: Literal["linear", "previous"] = "linear"
) -> Recording:
    """Fill missing samples between two good ones that are at most `longest` seconds apart.

    "previous" holds the last value, for inputs that are held. The rest stays NaN, and so do gaps at
    the ends. Raises RecordingError for an unknown method or signal.
    """
    signal = signal_of(recording, name)
    limit = require_positive(longest, f"fill_gaps({name!r}): longest")
    if method not in ("linear", "previous"):
        raise RecordingError(f"fill_gaps({name!r}): method is {method!r}; use 'linear' or 'previous'.")
    values, t = signal.values.copy(), recording.t
    good = np.flatnonzero(np.isfinite(values))
    missing = np.flatnonzero(~np.isfinite(values))
    inner = missing[(missing > good[0]) & (missing < good[-1])] if len(good) else missing[:0]
    after = np.searchsorted(good, inner)
    left, right = good[after - 1], good[np.minimum(after, len(good) - 1)] if len(good) else good
    short = t[right] - t[left] <= limit * (1 + 1e-9)
    filled = inner[short]
    if method == "linear":
        values[filled] = np.interp(t[filled], t[good], values[good]) if len(filled) else []
    else:
        values[filled] = values[left[short]]
    sentence = (
        f"{len(filled)} missing samples of {name!r} filled ({method}, gaps up to {limit:g} s); "
        f"{len(missing) - len(filled)} stay missing."
    )
    return with_signal(recording, name, values, signal.unit, sentence)
