"""Frequency responses by Welch's averages, with coherence and the disc in which each value lies."""

from dataclasses import dataclass

import numpy as np
import scipy
from scipy import special

from plantfit.errors import RecordingError
from plantfit.first_look.data import Data

SEGMENTS = 8  # a record is cut into, half overlapping: 15 in all
# of K half-overlapping Hann segments, what counts as independent (Welch 1967)
OVERLAP = 1.0 / (1.0 + 2.0 * (1.0 / 6.0) ** 2)
FAINT = 1e-6  # of the largest power of an input, below which a frequency tells nothing


@dataclass(frozen=True)
class FrequencyResponse:
    """From one input to the output at frequencies `f` (k,) in Hz: `response` (k,) complex, in units of output per
    input; the truth lies within `radius` (k,) of it with 95 %. `coherence` (k,) is the share of the output's power
    that all inputs explain."""

    f: np.ndarray
    response: np.ndarray
    radius: np.ndarray
    coherence: np.ndarray


def frequency_response(data: Data, level: float = 0.95) -> list[FrequencyResponse]:
    """For every input the frequency response to the output, over the longest stretch without missing samples.

    Hann segments of an eighth of the stretch, half overlapping. With spectra S over K effective segments and m inputs,
    H = S_yu S_uu^-1, the noise S_ee = S_yy - H S_uy, |H_i - true|^2 <= F S_ee (S_uu^-1)_ii/(K - m), F the quantile of
    F(2, 2(K - m)) (Bendat and Piersol, Random Data, 4th ed. 2010, sections 9.1 and 9.2.4). Leakage of a plant whose
    memory is not short against a segment is not in the disc. Raises RecordingError where no stretch is long enough.
    """
    start, stop = _stretch(np.isfinite(data.y))
    n, moving = stop - start, [k for k in range(data.inputs.shape[1]) if np.ptp(data.inputs[start:stop, k]) > 0]
    m, length = len(moving), (stop - start) // SEGMENTS
    if length < 8 or not moving:
        raise RecordingError(
            f"Recording {data.name!r}: its longest stretch without "
            f"gaps has {n} samples, too few for a frequency response."
        )
    settings = {
        "fs": 1.0 / data.period,
        "window": "hann",
        "nperseg": length,
        "noverlap": length // 2,
        "detrend": "constant",
    }
    signals = [*(data.inputs[start:stop, k] for k in moving), data.y[start:stop]]
    count = (n - length // 2) // (length - length // 2)
    f = np.fft.rfftfreq(length, data.period)
    s = np.empty((len(f), m + 1, m + 1), dtype=complex)
    for a in range(m + 1):
        for b in range(m + 1):
            s[:, a, b] = scipy.signal.csd(signals[a], signals[b], **settings)[1]
    uu, uy, yy = s[:, :m, :m], s[:, :m, m], np.real(s[:, m, m])
    power = np.array([np.real(uu[:, i, i]) for i in range(m)])
    seen = (np.arange(len(f)) > 0) & np.all(power > FAINT * power.max(axis=1, keepdims=True), axis=0)
    if not seen.any():
        raise RecordingError(f"Recording {data.name!r}: the inputs have no power at any frequency of its segments.")
    uu, uy, yy, f = uu[seen], uy[seen], yy[seen], f[seen]
    inverse = np.linalg.pinv(np.conj(uu), hermitian=True)  # csd(a, b) is conj(A) B
    h = np.einsum("kij,kj->ki", np.linalg.pinv(uu, hermitian=True), uy)
    explained = np.einsum("ki,ki->k", np.conj(uy), h).real
    coherence = np.clip(explained / np.maximum(yy, 1e-300), 0.0, 1.0)
    freedom = max(1.0, count * OVERLAP - m)
    quantile = float(special.fdtri(2.0, 2.0 * freedom, level))
    made = []
    for i in range(m):
        own = quantile * np.maximum(yy - explained, 0.0) * inverse[:, i, i].real / freedom
        made.append(FrequencyResponse(f, h[:, i], np.sqrt(np.maximum(own, 0.0)), coherence))
    whole = {k: made[j] for j, k in enumerate(moving)}
    nothing = np.full(len(f), np.nan)
    return [whole.get(k, FrequencyResponse(f, nothing + 0j, nothing, coherence)) for k in range(data.inputs.shape[1])]


def _stretch(known: np.ndarray) -> tuple[int, int]:
    """The longest run of True."""
    edges = np.flatnonzero(np.diff(np.r_[0, known.astype(int), 0]))
    starts, stops = edges[::2], edges[1::2]
    if not len(starts):
        return 0, 0
    k = int(np.argmax(stops - starts))
    return int(starts[k]), int(stops[k])
