"""Root mean square over a moving window, as a meter shows a current."""

import numpy as np

from plantfit.errors import RecordingError, UnitError
from plantfit.recording.clean.sampling import by_stretch, lost, require_positive, signal_of, uniform_period, with_new
from plantfit.recording.record import Recording
from plantfit.units import is_point


def moving_rms(recording: Recording, signal: str, name: str, window: float) -> Recording:
    """Add the root mean square of a signal over the `window` seconds that end at each sample, as `name`, in its unit.

    The first samples of every stretch, whose window is not full, are missing. It has no sign and lags by half the
    window; a whole number of periods of a ripple takes it out. Needs even steps; raises RecordingError for a window
    below two of them, and UnitError for a signal in a unit such as degC, whose zero is not nothing, so that its squares
    mean nothing.
    """
    source = signal_of(recording, signal)
    step = f"moving_rms({signal!r})"
    if source.unit is not None and is_point(source.unit):
        raise UnitError(
            f"{step}: the signal is in {source.unit!r}, whose zero is not nothing, so that its mean square means "
            f"nothing; detrend it "
            'first, or write { step = "convert_units", units = { ' + signal + ' = "K" } }.'
        )
    n = round(require_positive(window, f"{step}: window") / uniform_period(recording, step))
    if not 2 <= n <= len(recording):
        raise RecordingError(
            f"{step}: window = {window:g} s is {n} samples; give seconds for 2 to {len(recording)} samples."
        )

    def rms(part: np.ndarray, _: slice) -> np.ndarray:
        mean = np.lib.stride_tricks.sliding_window_view(part**2, n).mean(axis=1)
        return np.concatenate([np.full(n - 1, np.nan), np.sqrt(mean)])

    values = by_stretch(source.values, n, rms)
    sentence = (
        f"{name!r} is the root mean square of {signal!r} over {n} samples ({window:g} s){lost(source.values, values)}."
    )
    return with_new(recording, name, values, source.unit, sentence, step)
