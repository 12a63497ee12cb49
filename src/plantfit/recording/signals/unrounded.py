"""A signal that was read in whole steps: a smooth curve beside it, and what other places of the steps would have
read of that curve; and one that was read with other noise."""

import numpy as np

from plantfit.recording.record import Recording, Signal

WIDTHS = (9, 17, 33, 65, 129, 257, 513)  # samples of the windows over which a polynomial is tried
ORDER = 3
REST = 3  # times as long as the readings beside it
LONGER = 16.0  # steps by which a motion that is read anew may be longer
ABOUT = 1.0  # the same of one that goes back and forth over few steps, which more would change
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)  # its multiples lie evenly beside any even division (Weyl)
MOST = 0.5  # steps rms that the readings may lie off it; rounding alone gives 0.29


def unrounded(y: np.ndarray, rests: bool = True) -> np.ndarray:
    """A smooth curve (n,) beside readings y (n,) in steps of 1.

    Where readings move, a cubic at each sample over the longest window, of up to 513 samples, beside which no window
    reads more than half a step rms off, nor any shorter one. A signal that jumps by several steps from sample to sample
    stays as it is there, and so does one that `rests`: a motor that stands still does so anywhere within a step, while
    a signal that turns back only looks as if it rested.
    """
    curve = np.array(y, dtype=float)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~(_rests(curve) & rests), [False]]).astype(int)))
    for start, stop in edges.reshape(-1, 2):
        curve[start:stop] = _smooth(curve[start:stop])
    return curve


def _rests(y: np.ndarray) -> np.ndarray:
    """Samples (n,) of readings that stay the same for long, and much longer than before and after: not of a slow
    motion."""
    begins = np.concatenate([[0], np.flatnonzero(np.diff(y)) + 1])
    lengths = np.diff(np.append(begins, len(y)))
    beside = np.maximum(np.append(lengths[1:], 0), np.append(0, lengths[:-1]))
    return np.repeat((lengths >= WIDTHS[0]) & (lengths >= REST * beside), lengths)


def _smooth(y: np.ndarray) -> np.ndarray:
    n = len(y)
    x = np.linspace(-1.0, 1.0, n) if n > 1 else np.zeros(n)
    trend = np.polynomial.polynomial.polyval(x, np.polynomial.polynomial.polyfit(x, y, min(1, n - 1)))
    rest = y - trend
    curve, fits = rest.copy(), np.ones(n, dtype=bool)
    for width in (w for w in WIDTHS if w <= n):
        half = width // 2
        basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, width), ORDER + 1, increasing=True))[0].T
        parts = np.stack([np.convolve(rest, b[::-1], mode="valid") for b in basis])
        squares = np.convolve(rest**2, np.ones(width), mode="valid") - np.sum(parts**2, axis=0)
        near = squares <= width * MOST**2
        middle, inner = basis[:, half] @ parts, slice(half, n - half)
        good = np.zeros(n, dtype=bool)
        good[inner] = near & fits[inner]
        curve[inner] = np.where(good[inner], middle, curve[inner])
        for place, at, of in (
            (slice(0, half), 0, slice(0, half)),
            (slice(n - half, n), -1, slice(width - half, width)),
        ):
            if near[at] and fits[place].all():  # both ends by their first window
                curve[place], good[place] = basis[:, of].T @ parts[:, at], True
        fits = good
    return curve + trend


def misread(curve: np.ndarray, phase: float) -> np.ndarray:
    """By how much (n,) whole steps read a curve (n,) wrong, less than half a step either way, where they lie `phase`
    steps (0 to 1) off."""
    place = curve + phase
    return np.floor(place) - place + 0.5


def reread(recording: Recording, name: str, step: float, places: int, counted: bool) -> list[Recording]:
    """The recording with an input as steps at so many other places might have read it.

    The signal has the error of such steps more than as it was read. Not `counted`, its readings are rounded to
    multiples of `step`. `counted`, its integral is: the signal is a speed made of counts, held from sample to sample,
    and `step` (in its unit times seconds) is one count. Missing samples stay missing.

    The steps lie evenly over one step in turn. Where a signal rests its curve lies on a step, and two rests would be
    read wrong by the same; so each reading is also of a motion that is longer by up to `LONGER` steps (`ABOUT` if not
    counted), spread over the way that it goes.
    """
    values, t = recording[name], recording.t
    there = np.isfinite(values)
    held = np.diff(t, append=2.0 * t[-1] - t[-2] if len(t) > 1 else t[-1])
    read = np.where(there, values, 0.0)
    path = np.concatenate([[0.0], np.cumsum(read * held)[:-1]]) if counted else read
    curve = unrounded(path / step, rests=counted)
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(curve)))])
    longer = min(LONGER if counted else ABOUT, float(way[-1])) * way / max(float(way[-1]), 1e-300)
    found = []
    for k in range(places):
        error = step * misread(curve + longer * np.mod(k * GOLDEN, 1.0), (k + 0.5) / places)
        if counted:
            error = np.diff(error, append=error[-1]) / np.where(held > 0, held, 1.0)
        signals = {
            **recording.signals,
            name: Signal(np.where(there, values + error, values), recording.signals[name].unit),
        }
        found.append(Recording(t, signals, recording.name, recording.log, recording.clocked))
    return found


def renoised(recording: Recording, name: str, size: float, times: int) -> list[Recording]:
    """The recording with white noise of a standard deviation more on a signal, so many times; the same each time that
    it is asked for."""
    draw, own = np.random.default_rng([0, *name.encode()]), recording.signals[name]
    made = [Signal(own.values + size * draw.standard_normal(len(own.values)), own.unit) for _ in range(times)]
    return [
        Recording(recording.t, {**recording.signals, name: s}, recording.name, recording.log, recording.clocked)
        for s in made
    ]
