"""A lag of first order from an input to an output, beside the model: a part of the plant that stores and gives back, as
a second RC pair of a cell, which a drift and much else look like."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.trust.diagnosis.catalogue import Extension
from plantfit.trust.diagnosis.effects import lagged
from plantfit.trust.diagnosis.judge import Unseen, blocks_of, independent_share, needed, times_noise, validated
from plantfit.trust.diagnosis.plant.carrier import Carrier
from plantfit.trust.diagnosis.plant.disturbance import values_beside
from plantfit.trust.diagnosis.plant.hypothesis import Fitted, columns, fitted

TIMES = 16  # time constants that are looked at
SHORTEST, LONGEST = 3.0, 0.5  # sample periods and of a record: the least and the largest
CLOSER = (1.35, 1.1, 1.03)  # factors around the best one, by which it is looked for
NUMBERS = 2  # of a mode: its gain and its time constant
AT_NOISE = 1.5  # times the sample-to-sample noise that may be left beside it
# times that much, beyond which no fit is begun after a look along derivatives, and none is led on
NEAR, CLOSE = (3.0, 1.5)
HALF = 0.5  # of what the model leaves that it must explain, and of that what it must explain of unseen data
STEPS, NEXT = 8, 3  # of the first fit beside it, and of those beside it with time constants around that
FITS = STEPS + 2 * len(CLOSER) * NEXT


@dataclass(frozen=True)
class SlowMode:
    """A lag of `input` to `output` with a time constant of `time` s (with its standard error) and a static `gain`, in
    units of both. With it these `additions` are needed; the `residuals` (m,) at all rows, and the RMSE of fitted
    and of `unseen` samples without it and with it, in the unit of the output, `times` the noise that is left."""

    output: str
    input: str
    time: tuple[float, float]
    gain: tuple[float, float]
    explains: float
    rmse: tuple[float, float]
    unseen: Unseen
    times: float
    residuals: np.ndarray
    values: dict[str, tuple[float, float]]
    additions: tuple[Extension, ...] = ()


@dataclass(frozen=True)
class _Beside:
    """A fit beside the column (m,) of a lag, whose factor is `gain`, and what is left at all rows (m,)."""

    lag: "Lag"
    gain: float
    column: np.ndarray
    fit: Fitted
    left: np.ndarray

    def cost(self, use: np.ndarray) -> float:
        return float(np.sum(self.left[use] ** 2))


@dataclass(frozen=True)
class Lag:
    """A lag of `input` to `output` with a time constant of `time` s, which begins at rest or where the input is."""

    output: str
    input: str
    time: float
    rests: bool


def work(carrier: Carrier) -> float:
    """What `slow_mode` costs at most where a part of the data is unseen, in evaluations."""
    return FITS * carrier.charge(False)


def promising(carrier: Carrier, bare: Fitted, use: np.ndarray, kept: np.ndarray) -> Lag | None:
    """The lag that leaves least of what the model as it is (`bare`) leaves, as far as derivatives tell; None where that
    is far from the noise, and of an output that the model does not follow: a lag would take its place, as where a gain
    has the wrong sign. No simulation is made for it."""
    looked = _looked_at(carrier, bare, use)
    if looked is None or times_noise(carrier, bare, ~kept) * looked[1] > NEAR * AT_NOISE:
        return None
    return looked[0] if _follows(carrier, bare, looked[0].output, use) else None


def slow_mode(carrier: Carrier, bare: Fitted, lag: Lag, use: np.ndarray, kept: np.ndarray) -> SlowMode | None:
    """The mode that the model as it is (`bare`) lacks over rows `use` (m,) bool, fitted beside its parameters from a
    `promising` lag on.

    None where no lag leaves the noise, or where it predicts unseen samples less than half as well as it should: a drift
    has a lag that looks like it, which then goes elsewhere.
    """
    best = _fitted_beside(carrier, bare, lag, use, STEPS)
    if times_noise(carrier, replace(best.fit, residuals=best.left), ~kept) > CLOSE * AT_NOISE:
        return None
    for factor in CLOSER:
        around = [replace(best.lag, time=best.lag.time * f) for f in (1 / factor, factor)]
        near = [_fitted_beside(carrier, best.fit, one, use, NEXT) for one in around]
        best = min((best, *near), key=lambda one: one.cost(use))
    before, after = bare.cost(use), best.cost(use)
    explains = 1.0 - after / before
    left = times_noise(carrier, replace(best.fit, residuals=best.left), ~kept)
    if explains < HALF or left > AT_NOISE or not np.isfinite(after):
        return None
    worth = float(use.sum()) / independent_share(best.left, carrier.rows, use)
    if worth * float(np.log(before / after)) < needed(TIMES * len(_pairs(carrier)), NUMBERS):
        return None
    later = _unseen(carrier, bare, best, use, kept)
    if later is None or 1.0 - later.extended / later.base < HALF * explains:
        return None
    unit = next(iter(carrier.given.scales.values())) if len(carrier.given.scales) == 1 else 1.0
    rmse = float(np.sqrt(before / use.sum())) * unit, float(np.sqrt(after / use.sum())) * unit
    roots = Unseen(float(np.sqrt(later.base)) * unit, float(np.sqrt(later.extended)) * unit, later.blocks)
    of_gain, of_time, of_values = _errors(carrier, best, use)
    scale = carrier.given.scales[lag.output]
    return SlowMode(
        lag.output, lag.input, (best.lag.time, of_time), (best.gain * scale, of_gain * scale), explains, rmse, roots,
        left, best.left, _values(carrier, best, of_values),
    )  # fmt: skip


def better(mode: SlowMode, carrier: Carrier, end: Fitted, use: np.ndarray) -> bool:
    """Whether a record prefers a mode to all that was found in its place (`end`), by the Bayesian information criterion
    over independent residuals."""
    after = float(np.sum(mode.residuals[use] ** 2))
    worth = float(use.sum()) / independent_share(mode.residuals, carrier.rows, use)
    more = NUMBERS - len(end.additions)
    return worth * float(np.log(max(end.cost(use), 1e-300) / after)) > float(np.log(use.sum())) * more


def _pairs(carrier: Carrier) -> list[tuple[str, str]]:
    """Every output with every input that moves in some recording."""
    records = [e.recording for e in carrier.given.experiments.values()]
    moving = [u for u in getattr(carrier.given.model, "inputs", ()) if any(np.ptp(r[u]) > 0 for r in records)]
    return [(y, u) for y in carrier.given.outputs for u in moving]


def _column(carrier: Carrier, lag: Lag) -> np.ndarray:
    """What a lag with gain 1 adds to its output at all rows (m,), weighted as residuals are; it begins at 0 where the
    plant `rests` at first, else where the input is."""
    found, rows = np.zeros(len(carrier.rows.sample)), carrier.rows
    held = carrier.given.predictor.stepping().interpolated
    for record, e in carrier.given.experiments.items():
        t, u = e.recording.t, np.asarray(e.recording[lag.input], dtype=float)
        at = rows.part(record, lag.output)
        own = lagged(t, u, lag.time, lag.input not in held)
        own = own - u[0] * np.exp(-(t - t[0]) / lag.time) if lag.rests else own
        found[at] = own[rows.sample[at]] * rows.weight[at]
    return found


def _looked_at(carrier: Carrier, bare: Fitted, use: np.ndarray) -> tuple[Lag, float] | None:
    """The lag that leaves least, the parameters moving along their derivatives, and what share of the RMSE that leaves;
    None where it leaves half of the mean square."""
    r, a = bare.residuals[use], bare.jacobian[np.ix_(use, columns(carrier, bare.additions))]
    if not (np.all(np.isfinite(r)) and np.all(np.isfinite(a))):
        return None
    q, s, _ = np.linalg.svd(a / np.maximum(np.linalg.norm(a, axis=0), 1e-300), full_matrices=False)
    q = q[:, s > 1e-7 * np.max(s, initial=0.0)]
    square = float(r @ r)
    r = r - q @ (q.T @ r)
    rest = float(r @ r)
    best: tuple[float, Lag] | None = None
    for y, u in _pairs(carrier):
        for time in _times(carrier):
            for lag in (Lag(y, u, time, rests) for rests in (True, False)):
                whole = _column(carrier, lag)[use]
                c = whole - q @ (q.T @ whole)
                size = float(c @ c)
                if not size > 1e-10 * float(whole @ whole):
                    continue
                told = float(c @ r) ** 2 / size
                if best is None or told > best[0]:
                    best = told, lag
    if best is None or rest - best[0] > (1.0 - HALF) * square:
        return None
    return best[1], float(np.sqrt(max(rest - best[0], 0.0) / square))


def _follows(carrier: Carrier, bare: Fitted, output: str, use: np.ndarray) -> bool:
    """Whether the model leaves less than half of the mean square of what an output does."""
    left = does = 0.0
    for record, e in carrier.given.experiments.items():
        at = carrier.rows.part(record, output)
        y = np.asarray(e.recording[output], dtype=float)[carrier.rows.sample[at]] * carrier.rows.weight[at]
        own = y[use[at]]
        does += float(np.sum((own - np.mean(own)) ** 2)) if own.size else 0.0
        left += float(np.sum(bare.residuals[at][use[at]] ** 2))
    return left < HALF * does


def _times(carrier: Carrier) -> Iterator[float]:
    records = [e.recording for e in carrier.given.experiments.values()]
    period = float(np.median(np.concatenate([np.diff(r.t) for r in records])))
    longest = LONGEST * max(float(np.ptp(r.t)) for r in records)
    if longest > SHORTEST * period:
        yield from np.geomspace(SHORTEST * period, longest, TIMES).tolist()


def _fitted_beside(carrier: Carrier, near: Fitted, lag: Lag, use: np.ndarray, steps: int) -> _Beside:
    column = _column(carrier, lag)
    base = column[use] / max(float(np.linalg.norm(column[use])), 1e-300)
    fit = fitted(carrier, near.additions, near.x, near.theta, use, steps, beside=base[:, None])
    gain = -float(column[use] @ fit.residuals[use]) / max(float(column[use] @ column[use]), 1e-300)
    return _Beside(lag, gain, column, fit, fit.residuals + gain * column)


def _unseen(carrier: Carrier, bare: Fitted, best: _Beside, use: np.ndarray, kept: np.ndarray) -> Unseen | None:
    later = carrier.rows.unseen & kept
    if validated(carrier.rows, kept):
        return Unseen(bare.cost(later) / later.sum(), best.cost(later) / later.sum(), False)
    blocks = blocks_of(carrier.rows, use)
    if not carrier.meter.holds(2 * len(blocks) * STEPS * carrier.charge(False)):
        return None
    sums = np.zeros(2)
    for block in blocks:
        rest = use & ~block
        sums[0] += fitted(carrier, bare.additions, bare.x, bare.theta, rest, STEPS).cost(block)
        again = _fitted_beside(carrier, best.fit, best.lag, rest, STEPS)
        sums[1] += again.cost(block)
    return Unseen(float(sums[0] / use.sum()), float(sums[1] / use.sum()), True)


def _errors(carrier: Carrier, best: _Beside, use: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Standard errors of gain, time constant and parameters (d,), from the linearised fit."""
    step = 1.01
    slower = _column(carrier, replace(best.lag, time=best.lag.time * step))
    by_time = best.gain * (slower - best.column) / ((step - 1.0) * best.lag.time)
    free = columns(carrier, best.fit.additions)
    a = np.column_stack([best.column, by_time, best.fit.jacobian[:, free]])[use]
    norms = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    share = independent_share(best.left, carrier.rows, use)
    variance = best.cost(use) / max(1, int(use.sum()) - a.shape[1]) * share
    inverse = np.linalg.pinv((a / norms).T @ (a / norms), rcond=1e-12)
    errors = np.sqrt(np.maximum(np.diag(inverse), 0.0) * variance) / norms
    return float(errors[0]), float(errors[1]), errors[2:]


def _values(carrier: Carrier, best: _Beside, errors: np.ndarray) -> dict[str, tuple[float, float]]:
    point = np.r_[best.fit.x, best.fit.theta]
    return values_beside(carrier, best.fit.additions, point, columns(carrier, best.fit.additions), errors)
