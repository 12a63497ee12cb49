"""How well any linear model does: orders and dead times tried, the least BIC kept."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plantfit.errors import RecordingError
from plantfit.first_look.data import Data
from plantfit.first_look.delay import reaction_delay
from plantfit.first_look.linear import LinearFit, fit_linear
from plantfit.problem.measure.long_run import inflation

ORDERS = (0, 1, 2, 3, 4)
LATEST = 0.1  # of the shortest record: the longest dead time that is tried
ROUGH = 2  # Gauss-Newton steps while dead times are sought


@dataclass(frozen=True)
class Baseline:
    """`fits` of all orders that could be made with their `bic` (less the least); `chosen` has the least. `share`
    (parts) of the variance explained and `rmse` by part, "fit" and "unseen", NaN where there is none."""

    fits: tuple[LinearFit, ...]
    bic: tuple[float, ...]
    chosen: LinearFit
    rmse: dict[str, float]
    share: dict[str, float]

    @property
    def sentence(self) -> str:
        """ "A linear model of order 2 with 0.4 s dead time", without what it explains."""
        what = f"A linear model of order {self.chosen.order}" if self.chosen.order else "A linear model without memory"
        late = [d for d in self.chosen.dead_times() if d > 0]
        return what + (f" with {' and '.join(f'{d:.3g}' for d in late)} s dead time" if late else "")


def baseline(records: Sequence[Data], orders: Sequence[int] = ORDERS) -> Baseline:
    """The output-error model of the least BIC over orders and dead times, judged on fitted samples alone, so that
    unseen ones stay unseen.

    BIC = n ln(s^2)/c + k ln(n/c) with the c by which correlation of the residuals of the best fit inflates the variance
    of a mean. Raises RecordingError where no model can be made.
    """
    shifts = _shifts(records)
    made = [f for order in orders if (f := fit_linear(records, order, shifts)) is not None]
    if not made:
        raise RecordingError(
            f"Recording {records[0].name!r}: no linear model can be "
            "fitted to so few samples; give a longer part to the fit."
        )
    chosen_bic = _bic(records, made)
    k = int(np.argmin(chosen_bic))
    finer = _refined(records, made[k])
    if finer.cost < made[k].cost:
        made[k] = finer
        chosen_bic = _bic(records, made)
        k = int(np.argmin(chosen_bic))
    rmse, share = {}, {}
    for part in ("fit", "unseen"):
        masks = [d.fitted if part == "fit" else d.unseen for d in records]
        errors = np.concatenate([(y - d.y)[m] for y, d, m in zip(made[k].simulated, records, masks, strict=True)])
        values = np.concatenate([d.y[m] for d, m in zip(records, masks, strict=True)])
        rmse[part] = float(np.sqrt(np.mean(errors**2))) if len(errors) else float("nan")
        share[part] = (
            float(1.0 - np.mean(errors**2) / np.var(values)) if len(errors) and np.var(values) > 0 else float("nan")
        )
    return Baseline(tuple(made), tuple(float(v) for v in chosen_bic - np.min(chosen_bic)), made[k], rmse, share)


def without(records: Sequence[Data], fit: LinearFit, hidden: Sequence[np.ndarray]) -> LinearFit | None:
    """The same order and dead times fitted without the hidden samples (n,) bool of each record. Where its first
    sample is hidden a record begins at rest: later ones do not tell initial states, which would run away back to it."""
    kept = [replace(d, fitted=d.fitted & ~h, rested=bool(h[0])) for d, h in zip(records, hidden, strict=True)]
    return fit_linear(kept, fit.order, fit.shifts, begin=fit)


def _shifts(records: Sequence[Data]) -> tuple[int, ...]:
    """Samples before each input acts: from the reaction that a correlation shows, else none, then made better by
    second-order fits."""
    fitted = [d for d in records if d.fitted.sum() > 2] or list(records)
    longest = max(fitted, key=lambda d: int(d.fitted.sum()))
    own = replace(longest, y=np.where(longest.fitted, longest.y, np.nan))
    found = [reaction_delay(own, k).value or 0.0 for k in range(longest.inputs.shape[1])]
    most = max(1, int(LATEST * min(len(d.y) for d in fitted)))
    start = tuple(min(most, round(v / longest.period)) for v in found)
    return _sought(records, start, 2, most, _grid(most))


def _grid(most: int) -> list[int]:
    return sorted({round(v) for v in np.geomspace(1, most, 6)} | {0, 1, 2})


def _sought(
    records: Sequence[Data], start: tuple[int, ...], order: int, most: int, grid: Sequence[int]
) -> tuple[int, ...]:
    """The shifts of the least cost, one input after the other: first over a grid, then between its neighbours."""
    known: dict[tuple[int, ...], float] = {}

    def cost(shifts: tuple[int, ...]) -> float:
        if shifts not in known:
            fit = fit_linear(records, order, shifts, ROUGH)
            known[shifts] = np.inf if fit is None else fit.cost
        return known[shifts]

    best = start
    for k in range(len(start)):
        tried = [(*best[:k], s, *best[k + 1 :]) for s in {*grid, best[k]}]
        best = min(tried, key=lambda s: (cost(s), s))
        width = max(1, best[k] // 2)
        while True:
            near = [(*best[:k], s, *best[k + 1 :]) for s in (best[k] - width, best[k] + width) if 0 <= s <= most]
            better = min(near, key=cost, default=best)
            if cost(better) < cost(best):
                best = better
            elif width == 1:
                break
            else:
                width //= 2
    return best


def _refined(records: Sequence[Data], fit: LinearFit) -> LinearFit:
    """Dead times one sample away tried for the chosen order."""
    best = fit
    for k in range(len(fit.shifts)):
        for move in (-1, 1):
            shift = best.shifts[k] + move
            if shift >= 0:
                trial = fit_linear(records, fit.order, (*best.shifts[:k], shift, *best.shifts[k + 1 :]))
                best = trial if trial is not None and trial.cost < best.cost else best
    return best


def _bic(records: Sequence[Data], made: Sequence[LinearFit]) -> np.ndarray:
    n = sum(int(d.fitted.sum()) for d in records)
    best = min(made, key=lambda f: f.cost)
    residuals = [(y - d.y)[d.fitted] for y, d in zip(best.simulated, records, strict=True)]
    powers = [float(np.sum(r**2)) for r in residuals]
    factors = [
        inflation(r, np.flatnonzero(d.fitted)) if len(r) else 1.0 for r, d in zip(residuals, records, strict=True)
    ]
    c = float(np.dot(powers, factors) / sum(powers)) if sum(powers) > 0 else 1.0
    floor = 1e-24 * max(float(np.sum(d.y[d.fitted] ** 2)) for d in records)  # exact data leave rounding
    return np.array([n / c * np.log(max(f.cost, floor, 1e-300) / n) + (f.count + 1) * np.log(n / c) for f in made])
