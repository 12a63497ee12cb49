"""Has a plant left what a study knows of it: a test that is made again after every block of samples, with a stated
false-alarm rate."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

LONGEST = 64  # blocks that a window holds at most
SUM = 2.10974  # of 1 / (n log(n)^2) over n = 2, 3, ...
HINT = 1e-3  # p-value of a parameter that is believed beside innovations that are too large


@dataclass(frozen=True)
class Change:
    """What a look found: at `t` (s), in the window that begins at `since`, `scored` by a parameter or by the size of
    innovations alone. `factor` is by how much these are larger than expected. `p` is what chance gives, `allowed` below
    which it is an alarm.
    """

    t: float
    since: float
    scored: bool
    factor: float
    p: float
    allowed: float


@dataclass(frozen=True)
class Calibration:
    """What the recordings of the study say of the test: `colour` (d,) at least 1, how much more scores scatter than
    independent innovations; `level` and `heavy` at least 1, mean and scatter of squared innovations against those of
    white normal ones; `degrees` of freedom behind them."""

    colour: np.ndarray
    level: float
    heavy: float
    degrees: float


class Changes:
    """Scores of parameters and squares of innovations over the last 1, 2, 4, ... blocks, each look at its share of the
    false-alarm rate.

    With the parameters as the study has them, the score of parameter j over a window is normal with mean 0 and variance
    I_jj + (I C I)_jj: I is the information of the window, C the covariance of the study's values, both in units of
    their sizes (the local approach: Benveniste, Basseville, Moustakides, IEEE Trans. Automatic Control 32 (1987) 583,
    eq. (22)). A change of that parameter alone moves it by I_jj times the change. Squared innovations are chi-squared.

    The k-th look may raise a false alarm with the chance alpha / (2.11 (k + 1) log(k + 1)^2), shared evenly by its
    windows and parameters (Bonferroni): the chance of any false alarm, however long the plant runs, is at most `alpha`.
    """

    def __init__(self, correlation: np.ndarray, tested: np.ndarray, calibration: Calibration, alpha: float):
        self.correlation, self.tested = np.asarray(correlation), np.flatnonzero(tested)
        self.calibration, self.alpha, self.looks = calibration, alpha, 0
        self.begin: list[float] = []
        self.parts: list[tuple[np.ndarray, np.ndarray, float, int]] = []

    def look(
        self, begin: float, end: float, scores: np.ndarray, information: np.ndarray, nis: float, measured: int
    ) -> Change | None:
        """Add a block, from `begin` to `end` (s), with sums of scores (d,), information (d, d), squared innovations
        and measurements."""
        self.begin.append(begin)
        self.parts.append((scores, information, nis, measured))
        self.begin, self.parts = self.begin[-LONGEST:], self.parts[-LONGEST:]
        self.looks += 1
        lengths = [2**i for i in range(LONGEST.bit_length()) if 2**i <= len(self.parts)]
        share = self.alpha / (SUM * (self.looks + 1) * math.log(self.looks + 1) ** 2)
        allowed = share / (len(lengths) * (len(self.tested) + 1))
        found = [self._window(n, end, allowed) for n in lengths]
        best = min(found, key=lambda c: c.p)
        return best if best.p < allowed else None

    def _window(self, blocks: int, end: float, allowed: float) -> Change:
        parts, cal = self.parts[-blocks:], self.calibration
        scores, information = np.sum([p[0] for p in parts], axis=0), np.sum([p[1] for p in parts], axis=0)
        nis, measured = sum(p[2] for p in parts), sum(p[3] for p in parts)
        own = np.diag(information)
        spread = cal.colour * own + np.diag(information @ self.correlation @ information)
        some = spread > 0
        size = np.where(some, np.abs(scores) / np.sqrt(np.where(some, spread, 1.0)), 0.0)
        p = 2.0 * special.stdtr(cal.degrees, -size)
        factor, p_nis = 1.0, 1.0
        if measured:
            ratio = nis / (measured * cal.level)
            n = measured / cal.heavy
            p_nis = 2.0 * min(
                float(special.fdtrc(n, cal.degrees, ratio)), float(special.fdtr(n, cal.degrees, ratio)), 0.5
            )
            factor = math.sqrt(ratio)
        best = int(self.tested[np.argmin(p[self.tested])]) if len(self.tested) else -1
        scored = best >= 0 and bool(p[best] <= p_nis or p[best] < HINT)
        chance = min(p[best], p_nis) if scored else p_nis
        return Change(end, self.begin[-blocks], scored, factor, float(chance), allowed)
