"""Which parameter has changed, told from the others: each may have changed at any time around the alarm."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

ONSETS = 48  # times at which a change may begin, at most
TOLD = 13.8  # 2 log(1000): of twice the logarithm of the likelihood, the lead that tells one cause from another
# a lead that is no lead, of what the best change explains: slopes are not exact for large changes, and the block of the
# alarm shows little of any change
FIRST, LATER = 0.3, 0.03
# the least that a cause of innovations that are too large explains, in units of what it leaves, and of all squares
CLEAR, MOST = 50.0, 0.5
FOLLOWED = 32  # blocks behind an alarm in which its cause is still looked for


@dataclass(frozen=True)
class Causes:
    """Changes of one parameter that explain the innovations, the best first: places of the watched parameters, where
    each begins (s), its size in units of the parameter's. Those behind the first explain as much as it does, as far as
    the samples tell. `clear`: the first explains most of the squares, and more than chance lets any cause explain."""

    places: tuple[int, ...]
    since: tuple[float, ...]
    change: tuple[float, ...]
    clear: bool


def onsets(t: np.ndarray) -> np.ndarray:
    """Times of samples (B,) at which a change may begin, `ONSETS` at most; a new one takes a few samples to be seen."""
    early = t[: max(1, len(t) - 2)]
    return early[np.unique(np.linspace(0, len(early) - 1, min(ONSETS, len(early))).astype(int))]


def causes(
    white: np.ndarray,
    slopes: np.ndarray,
    times: np.ndarray,
    tested: Sequence[int],
    room: tuple[np.ndarray, np.ndarray],
    noise: float,
    share: float,
) -> Causes:
    """What explains innovations (B, m), given their slopes (o, B, m, w) by changes that begin at `times` (o,).

    `room` are the least and the largest change (w,) that a parameter can have, `noise` is at least 1: how much more
    squares of a healthy plant scatter than white ones. Twice the logarithm of a likelihood is counted in units of it,
    or of the mean square that the best change leaves where that is larger; a `share` of what it explains is no lead.
    """
    own = np.einsum("obmw,obmw->ow", slopes, slopes)
    scores = -np.einsum("obmw,bm->ow", slopes, white)
    change = np.where(own > 0, scores / np.where(own > 0, own, 1.0), 0.0)
    change = np.clip(change, *room)
    worth = 2.0 * change * scores - change**2 * own
    first = np.argmax(worth, axis=0)
    best = {j: float(worth[first[j], j]) for j in tested}
    order = sorted(tested, key=lambda j: -best[j])
    most, squares, count = best[order[0]], float(np.sum(white**2)), max(int(np.count_nonzero(white)), 1)
    scale = max(noise, (squares - most) / count)
    alike = [j for j in order if most - best[j] < TOLD * scale + share * most]
    return Causes(
        tuple(alike),
        tuple(float(times[first[j]]) for j in alike),
        tuple(float(change[first[j], j]) for j in alike),
        most > CLEAR * scale and most > MOST * squares,
    )
