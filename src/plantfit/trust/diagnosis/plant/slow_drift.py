"""The plant fitted beside a slow drift of its outputs, each a curve in time, where what is left is one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

import plantfit.runtime  # noqa: F401
from plantfit.trust.diagnosis.catalogue import Extension
from plantfit.trust.diagnosis.judge import independent_share, times_noise
from plantfit.trust.diagnosis.plant.carrier import Carrier
from plantfit.trust.diagnosis.plant.disturbance import PRESSED, values_beside
from plantfit.trust.diagnosis.plant.hypothesis import Fitted, columns, fitted
from plantfit.trust.validate.wandering import ALONE, answers, followed

SPLINES = (5, 8, 12, 18, 27)  # of a curve, that are compared
LARGE = 0.5  # of the mean square of what is left that the curves have to account for
AT_NOISE = 1.3  # times the sample-to-sample noise that may be left beside them
# of the variance of what the plant does that a curve must be unable to follow, or it stands for errors of the model
SLOWER = 0.15
FINER = 2.25  # times as many splines beside which parameters are told
FEWEST = 4  # samples for each spline
STIFF = (3, 4)  # splines of a curve that may stand for what was found, before those above
# of the Bayesian information criterion, by which a curve may be worse than what was found and still explain as much
AS_WELL = 2.0


@dataclass(frozen=True)
class SlowDrift:
    """The drift of an `output`: a curve of so many cubic B-splines that moves over `moves`, in the unit of the
    output."""

    output: str
    count: int
    moves: float


@dataclass(frozen=True)
class Rival:
    """A `drift` in the place of all that was found, and the share of what the model leaves that it accounts for."""

    drift: SlowDrift
    explains: float


@dataclass(frozen=True)
class Drifting:
    """`drifts` beside these `additions`, which together account for this share of what is left of their outputs
    (`explains`), and what the parameters are with them: by coordinate a value with its standard error, in their
    units; none where one of them ends at a bound, those that the record shows else."""

    additions: tuple[Extension, ...]
    drifts: tuple[SlowDrift, ...]
    explains: float
    values: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Curves:
    """An orthonormal base (n, k) over the n used rows of all curves of `count` cubic B-splines on these outputs."""

    outputs: tuple[str, ...]
    count: int
    base: np.ndarray

    def without(self, v: np.ndarray) -> np.ndarray:
        """What no curve follows of used rows (n,) or (n, d)."""
        return v - self.base @ (self.base.T @ v)


def drifting(carrier: Carrier, one: Fitted, outputs: Sequence[str], use: np.ndarray) -> Drifting | None:
    """The plant and what was found (`one`) fitted beside curves in time on `outputs` over rows `use` (m,) bool.

    None where what is left is no slow drift: curves have to account for half of it and leave the noise, what is then
    left must not follow the inputs, and what the plant does must be too fast for them, as errors of a model are of that
    speed.
    """
    curves = chosen_curves(carrier, one, outputs, use)
    if curves is None:
        return None
    fit = fitted(carrier, one.additions, one.x, one.theta, use, beside=curves.base)
    left = curves.without(fit.residuals[use])
    on = np.isin(carrier.rows.output[use], curves.outputs)
    before, after = float(np.sum(one.residuals[use][on] ** 2)), float(np.sum(left[on] ** 2))
    if not np.isfinite(after) or before <= 0 or after > (1.0 - LARGE) * before:
        return None
    if times_noise(carrier, replace(fit, residuals=_of_all(left, use)), ~use) > AT_NOISE or _follows(
        carrier, fit, curves, left, use
    ):
        return None
    drifts = tuple(_drift(carrier, fit, curves, y, use) for y in curves.outputs)
    return Drifting(fit.additions, drifts, 1.0 - after / before, _values(carrier, fit, curves, use))


def rival(carrier: Carrier, bare: Fitted, end: Fitted, use: np.ndarray) -> Rival | None:
    """The slow drift of one output that does as well beside the model as it is (`bare`) as all that was found does
    (`end`), the parameters moving along their derivatives; None where no curve does, or the plant is too slow for
    one."""
    r, a = bare.residuals[use], bare.jacobian[np.ix_(use, columns(carrier, bare.additions))]
    if not (np.all(np.isfinite(r)) and np.all(np.isfinite(a))):
        return None
    price = float(np.log(len(r)))
    most = (
        len(r) * float(np.log(max(end.cost(use), 1e-300)))
        + price * (len(end.additions) - len(bare.additions))
        + AS_WELL
    )
    found: list[tuple[float, float, Curves, np.ndarray]] = []
    for y in carrier.given.outputs:
        for count in (*STIFF, *SPLINES):
            curves = _curves(carrier, (y,), count, use)
            if curves is None or curves.base.shape[1] * FEWEST > np.sum(carrier.rows.output[use] == y):
                break
            q = _orthonormal(curves.without(a))
            left = curves.without(r)
            left = left - q @ (q.T @ left)
            square = max(float(left @ left), 1e-300)
            criterion = len(r) * float(np.log(square)) + price * curves.base.shape[1]
            if criterion < most and _faster(carrier, bare, curves, use):
                found.append(
                    (criterion, square, curves, np.linalg.lstsq(np.hstack([curves.base, a]), r, rcond=1e-10)[0])
                )
    if not found:
        return None
    _, square, curves, x = min(found, key=lambda one: one[0])
    drift = _moved(carrier, curves, curves.base @ x[: curves.base.shape[1]], curves.outputs[0], use)
    return Rival(drift, 1.0 - square / max(float(r @ r), 1e-300))


def evidence_beside_a_drift(
    carrier: Carrier, base: Fitted, one: Fitted, outputs: Sequence[str], use: np.ndarray
) -> float:
    """Twice the gain of log-likelihood by what `one` has more than `base`, both beside the same curves, along their
    derivatives."""
    curves = chosen_curves(carrier, one, outputs, use)
    if curves is None:
        return 0.0
    squares = []
    for f in (base, one):
        r, a = curves.without(f.residuals[use]), curves.without(f.jacobian[np.ix_(use, columns(carrier, f.additions))])
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(a))):
            return 0.0
        q = _orthonormal(a)
        squares.append(float(np.sum((r - q @ (q.T @ r)) ** 2)))
    freedom = max(int(use.sum()) - curves.base.shape[1], 1)
    return freedom * float(np.log(squares[0] / squares[1])) if squares[1] > 0 else 0.0


def chosen_curves(carrier: Carrier, one: Fitted, outputs: Sequence[str], use: np.ndarray) -> Curves | None:
    """Those with the least Bayesian information criterion, where the parameters may move along their derivatives;
    None where the plant is no faster than such a curve, or what is left is not finite."""
    r, a = one.residuals[use], one.jacobian[np.ix_(use, columns(carrier, one.additions))]
    if not outputs or not (np.all(np.isfinite(r)) and np.all(np.isfinite(a))):
        return None
    found: list[tuple[float, Curves]] = []
    for count in SPLINES:
        made = _curves(carrier, outputs, count, use)
        if made is None or made.base.shape[1] * FEWEST > np.isin(carrier.rows.output[use], list(outputs)).sum():
            break
        q = _orthonormal(made.without(a))
        left = made.without(r)
        left = left - q @ (q.T @ left)
        found.append(
            (len(r) * float(np.log(max(left @ left, 1e-300))) + made.base.shape[1] * float(np.log(len(r))), made)
        )
    if not found:
        return None
    curves = min(found, key=lambda one: one[0])[1]
    return curves if _faster(carrier, one, curves, use) else None


def _curves(carrier: Carrier, outputs: Sequence[str], count: int, use: np.ndarray) -> Curves | None:
    rows, given = carrier.rows, carrier.given
    place = np.cumsum(use) - 1
    blocks = []
    for y in outputs:
        for name, e in given.experiments.items():
            at = rows.part(name, y)
            at = at[use[at]]
            if len(at) < FEWEST:
                continue
            t = e.recording.t[rows.sample[at]]
            own = _orthonormal(_splines(t, min(count, max(2, len(at) // FEWEST))) * rows.weight[at][:, None])
            block = np.zeros((int(use.sum()), own.shape[1]))
            block[place[at]] = own
            blocks.append(block)
    return Curves(tuple(outputs), count, np.hstack(blocks)) if blocks else None


def _splines(t: np.ndarray, count: int) -> np.ndarray:
    """So many cubic B-splines, or fewer of lower degree, on even knots (n, count) at increasing times (n,)."""
    degree = min(3, count - 1)
    inner = np.linspace(t[0], t[-1], count - degree + 1)
    knots = np.r_[[t[0]] * degree, inner, [t[-1]] * degree]
    return BSpline.design_matrix(t, knots, degree).toarray()


def _orthonormal(a: np.ndarray) -> np.ndarray:
    """A base of the columns (n, k)."""
    if not a.shape[1]:
        return a
    q, s, _ = np.linalg.svd(a / np.maximum(np.linalg.norm(a, axis=0), 1e-300), full_matrices=False)
    return q[:, s > 1e-7 * s[0]]


def _faster(carrier: Carrier, one: Fitted, curves: Curves, use: np.ndarray) -> bool:
    """Whether curves cannot follow what the plant does."""
    rows = carrier.rows
    simulated = rows.measured[use] * rows.weight[use] + one.residuals[use]
    on = np.isin(rows.output[use], curves.outputs)
    level = _curves(carrier, curves.outputs, 2, use)  # and its straight line: what drifts more slowly than anything
    assert level is not None
    moved, missed = level.without(simulated)[on], curves.without(simulated)[on]
    return float(missed @ missed) >= SLOWER * float(moved @ moved) > 0


def _follows(carrier: Carrier, fit: Fitted, curves: Curves, left: np.ndarray, use: np.ndarray) -> bool:
    """Whether what is left beside the curves follows the changes of an input or of its square."""
    rows, place = carrier.rows, np.cumsum(use) - 1
    a = curves.without(fit.jacobian[np.ix_(use, columns(carrier, fit.additions))])
    q = _orthonormal(a)
    left = left - q @ (q.T @ left)
    blocks = []
    for y in curves.outputs:
        own = np.zeros((int(use.sum()), 0))
        for name, e in carrier.given.experiments.items():
            at = rows.part(name, y)
            at = at[use[at]]
            told = [
                c[rows.sample[at]]
                for u in carrier.inputs[name]
                for c in answers(np.asarray(e.recording[u], dtype=float))
            ]
            if len(at) and told:
                block = np.zeros((int(use.sum()), len(told)))
                block[place[at]] = np.column_stack(told) * rows.weight[at][:, None]
                own = block if not own.shape[1] else own + block
        blocks.append(own)
    told = np.hstack(blocks)
    return bool(told.shape[1]) and followed(left, np.hstack([curves.base, q]), told) < ALONE


def _of_all(left: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Residuals of used rows (n,) among all rows (m,), zero elsewhere."""
    found = np.zeros(len(use))
    found[use] = left
    return found


def _drift(carrier: Carrier, fit: Fitted, curves: Curves, output: str, use: np.ndarray) -> SlowDrift:
    curve = -(curves.base @ (curves.base.T @ fit.residuals[use]))  # residuals are simulated less measured
    return _moved(carrier, curves, curve, output, use)


def _moved(carrier: Carrier, curves: Curves, curve: np.ndarray, output: str, use: np.ndarray) -> SlowDrift:
    """The drift of an output that is a curve over the used rows (n,), weighted as residuals are."""
    rows, moves = carrier.rows, 0.0
    for name in carrier.given.experiments:
        at = rows.part(name, output)
        at = at[use[at]]
        if len(at):
            own = curve[(np.cumsum(use) - 1)[at]] / rows.weight[at] * carrier.given.scales[output]
            moves = max(moves, float(np.ptp(own)))
    return SlowDrift(output, curves.count, moves)


def _values(carrier: Carrier, fit: Fitted, curves: Curves, use: np.ndarray) -> dict[str, tuple[float, float]]:
    """The parameters beside finer curves: what the criterion thinks too little to follow would draw them. None where
    one is at a bound."""
    finer = _curves(carrier, curves.outputs, int(np.ceil(FINER * curves.count)), use)
    assert finer is not None
    fit = fitted(carrier, fit.additions, fit.x, fit.theta, use, beside=finer.base)
    if np.any((fit.x[: carrier.own] < PRESSED) | (fit.x[: carrier.own] > 1.0 - PRESSED)):
        return {}
    free = columns(carrier, fit.additions)
    own = fit.jacobian[np.ix_(use, free)]
    a, left = finer.without(own), finer.without(fit.residuals[use])
    size = np.maximum(np.linalg.norm(own, axis=0), 1e-300)
    _, s, right = np.linalg.svd(a / size, full_matrices=False)
    shown = s > 1e-7 * max(s[0], 1e-300)
    variance = float(left @ left) / max(len(left) - finer.base.shape[1] - int(shown.sum()), 1)
    variance *= independent_share(_of_all(left, use), carrier.rows, use)
    spread = np.linalg.norm(right[shown].T / s[shown], axis=1) / size
    errors = np.where(np.sum(right[~shown] ** 2, axis=0) > 1e-7, np.inf, spread * np.sqrt(variance))
    return values_beside(carrier, fit.additions, np.r_[fit.x, fit.theta], free, errors)
