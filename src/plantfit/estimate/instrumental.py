"""Linear regression with errors in the regressor, by instrumental variables."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtrc

from plantfit.errors import SearchError
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.whitening import usable, whitening
from plantfit.problem.measure.long_run import degrees_of_freedom, prewhitened_long_run, widening

ROUNDS = 10  # of residuals and whitening for one set of instruments
APART = 0.01  # p-value below which estimates with and without whitening are taken to differ
SHRUNK = 0.5  # of what the columns of an output explain without whitening: below it coefficients have gone to zero
SETTLED_AT_LAST = 1.0  # plain standard errors that rounds which have not settled may be away
SETTLED = 0.01  # change of every value, in standard errors, that ends the iterations

Instruments = np.ndarray | Callable[[Mapping[str, float]], np.ndarray]


def instrumental_variables(
    regressor: np.ndarray,
    target: np.ndarray,
    instruments: Instruments,
    names: Sequence[str] | None = None,
    *,
    start: np.ndarray | None = None,
    index: np.ndarray | None = None,
    whiten: bool = True,
    largest_order: int = 12,
    iterations: int = 10,
) -> Estimate:
    """target = regressor @ values + error, where the regressor (N, k) or, for m outputs, (N, m, k) has errors too.

    `instruments`, of the regressor's shape, move with it but not with the errors: the regressor of a noise-free
    simulation. As a function of the values by name they are made anew at every estimate, from `start` (instruments of
    the first one, the regressor itself if left out) on, until no value moves by 1 % of its standard error. With
    instruments = regressor it is least squares.

    Errors are made white by a vector autoregression of at most `largest_order` over samples numbered `index` (N,),
    which weights the outputs too, unless `whiten` is False: all rows then count alike. They do so too where whitening
    makes no error smaller, or leads away from the estimate without it by more than its errors. The covariance is the
    sandwich with leverages (HC3 of MacKinnon and White, J. Econometrics 29 (1985) 305), long-run (Newey-West), and
    widened to Student's t where it rests on few samples, as for a coefficient that one fast move tells
    (`Estimate.degrees`). Janot, Vandanjon, Gautier, IEEE Trans. Control Syst. Technol. 22 (2014) 132; filter of the
    errors: Young, Recursive Estimation and Time-Series Analysis, 2nd ed. (2011).

    Raises SearchError for shapes that do not fit, values that are not finite and instruments that do not move with the
    regressor.
    """
    x, y, index = _checked(regressor, target, index)
    k = x.shape[2]
    names = tuple(names) if names is not None else tuple(f"p{i + 1}" for i in range(k))
    if len(names) != k:
        raise SearchError(f"{len(names)} names for a regressor of {k} columns; give one for each.")
    largest = min(largest_order, max(0, len(x) // (4 * x.shape[1]) - 1)) if whiten else None
    data = _Data(x, y, names, index, largest)
    if not callable(instruments):
        return _solved(data, _shaped(instruments, x), 0)
    estimate = _solved(data, _shaped(regressor if start is None else start, x), 0)
    for iteration in range(1, iterations + 1):
        before = estimate.values
        estimate = _solved(data, _shaped(instruments(estimate.named), x), iteration)
        if np.all(np.abs(estimate.values - before) <= SETTLED * estimate.standard_error):
            break
    return estimate


class _Data(NamedTuple):
    """Columns (n, m, k), targets (n, m), sample numbers, and the largest order of whitening (None: not at all)."""

    x: np.ndarray
    y: np.ndarray
    names: tuple[str, ...]
    index: np.ndarray
    largest: int | None


class _Rows(NamedTuple):
    """Columns, targets and instruments of the rows that count, each whitened, and their numbers."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    kept: np.ndarray


def _solved(data: _Data, z: np.ndarray, iteration: int) -> Estimate:
    """With instruments z (n, m, k): plain, then with the whitening that the residuals ask for, where that is an
    improvement."""
    rows, order, settled = _Rows(data.x, data.y, z, np.arange(len(z))), 0, False
    values, inverse = _normal(rows, data.names)
    plain = _estimate(data, rows, values, inverse, order, iteration)
    if data.largest is None:
        return plain
    for _ in range(ROUNDS):
        filtered = whitening(data.y - data.x @ values, data.index, data.largest or 0)
        kept = usable(data.index, filtered.order)
        rows = _Rows(filtered(data.x, kept), filtered(data.y, kept), filtered(z, kept), kept)
        before, (values, inverse) = values, _normal(rows, data.names)
        settled = order == filtered.order and np.allclose(before, values, rtol=1e-6, atol=0.0)
        if settled:
            break
        order = filtered.order
    whitened = _estimate(data, rows, values, inverse, order, iteration)
    return whitened if _improves(data, whitened, plain, settled) else plain


def _improves(data: _Data, whitened: Estimate, plain: Estimate, settled: bool) -> bool:
    """Whether an estimate with whitening is to be taken: both are consistent, so it lies within the errors of the plain
    one, below them.

    Else the rounds have led astray: an equation whose target is zero holds exactly where all its coefficients are zero,
    and its ever smaller residuals get an ever larger weight.
    """
    errors = np.maximum(plain.standard_error, 1e-300)
    if not settled and np.max(np.abs(whitened.values - plain.values) / errors) > SETTLED_AT_LAST:
        return False
    explained = [np.sqrt(np.mean((data.x @ e.values) ** 2, axis=0)) for e in (whitened, plain)]
    if (
        np.any(explained[0] < SHRUNK * explained[1])
        or np.mean(np.log(np.maximum(whitened.standard_error, 1e-300) / errors)) > 0
    ):
        return False
    difference = (whitened.values - plain.values) / errors
    statistic = float(difference @ np.linalg.pinv(plain.covariance / np.outer(errors, errors), rcond=1e-6) @ difference)
    return bool(chdtrc(len(errors), statistic) > APART)


def _normal(rows: _Rows, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Values (k,) and the inverse (k, k) of Z'X."""
    zx = np.einsum("nmk,nml->kl", rows.z, rows.x)
    size_z, size_x = (np.sqrt(np.maximum(np.einsum("nmk,nmk->k", a, a), 1e-300)) for a in (rows.z, rows.x))
    correlation = zx / np.outer(size_z, size_x)
    if np.linalg.cond(correlation) > 1e12:
        raise SearchError(
            f"The instruments of {list(names)} do not tell them apart; take "
            "instruments that move with the regressor, or fewer parameters."
        )
    inverse = np.linalg.inv(correlation) / np.outer(size_x, size_z)
    return inverse @ np.einsum("nmk,nm->k", rows.z, rows.y), inverse


def _estimate(
    data: _Data, rows: _Rows, values: np.ndarray, inverse: np.ndarray, order: int, iteration: int
) -> Estimate:
    residuals = rows.y - rows.x @ values
    # what an error is without the fit that it has pulled itself: (I - H)^-1 r with H = X (Z'X)^-1 Z' of its own row
    leverage = np.einsum("nak,kl,nbl->nab", rows.x, inverse, rows.z)
    freed = np.linalg.solve(np.eye(rows.y.shape[1]) - leverage, residuals[:, :, None])[:, :, 0]
    influence = np.zeros((len(data.index), len(values)))
    influence[rows.kept] = np.einsum("kl,nml,nm->nk", inverse, rows.z, freed)
    index = data.index[rows.kept]
    covariance, degrees = (
        prewhitened_long_run(influence[rows.kept], index),
        _degrees(rows, inverse, residuals, influence, index),
    )
    covariance = covariance * np.outer(widening(degrees), widening(degrees))
    return Estimate(data.names, values, covariance, influence, data.index, residuals, order, iteration, degrees)


def _degrees(
    rows: _Rows, inverse: np.ndarray, residuals: np.ndarray, influence: np.ndarray, index: np.ndarray
) -> np.ndarray:
    """On how many independent errors the variance of each value (k,) rests."""
    weights = np.einsum("kl,nal->nka", inverse, rows.z)
    shares = np.einsum("nka,ab,nkb->nk", weights, residuals.T @ residuals, weights)
    return degrees_of_freedom(influence[rows.kept], shares, index)


def _checked(
    regressor: np.ndarray, target: np.ndarray, index: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x, y = np.asarray(regressor, dtype=float), np.asarray(target, dtype=float)
    if x.ndim not in (2, 3) or y.shape != x.shape[:-1]:
        raise SearchError(
            f"A regressor of shape {x.shape} with a target of {y.shape}; "
            "give (N, k) with (N,), or (N, m, k) with (N, m)."
        )
    if x.ndim == 2:
        x, y = x[:, None, :], y[:, None]
    if len(x) <= 2 * x.shape[2]:
        raise SearchError(f"{len(x)} samples for {x.shape[2]} parameters; give at least {2 * x.shape[2] + 1}.")
    for what, values in (("regressor", x), ("target", y)):
        if not np.all(np.isfinite(values)):
            raise SearchError(
                f"The {what} is not finite at sample {int(np.argwhere(~np.isfinite(values))[0, 0])}; "
                "leave such samples out, with index."
            )
    index = np.arange(len(x)) if index is None else np.asarray(index, dtype=int)
    if index.shape != (len(x),) or np.any(np.diff(index) <= 0):
        raise SearchError(
            f"index has shape {index.shape} for {len(x)} samples; give sample numbers that grow, one for each."
        )
    return x, y, index


def _shaped(instruments: Any, x: np.ndarray) -> np.ndarray:
    z = np.asarray(instruments, dtype=float)
    z = z[:, None, :] if z.ndim == 2 else z
    if z.shape != x.shape:
        raise SearchError(
            f"Instruments of shape {np.shape(instruments)} for a regressor of {x.shape}; give one for each column."
        )
    if not np.all(np.isfinite(z)):
        raise SearchError(
            f"The instruments are not finite at sample {int(np.argwhere(~np.isfinite(z))[0, 0])}; simulate others."
        )
    return z
