"""Linear models of one output: output-error by variable projection, begun from a regression (ARX) and
Steiglitz-McBride iterations."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

import plantfit.runtime  # noqa: F401
from plantfit.first_look.data import Data
from plantfit.problem.measure.long_run import inflation

PASSES = 4  # of Steiglitz and McBride
STEPS = 25  # of Gauss-Newton
SETTLED = 1e-6  # relative decrease of the cost that ends them
WEIGHTY = 0.05  # of the largest coefficient, from which on one counts as an answer
EXPLODED = 1e100  # of a column, in which nothing can be told: squares stay numbers


@dataclass(frozen=True)
class LinearFit:
    """F(q) y = sum_i B_i(q) u_i(k - shift_i) + c, simulated from the inputs alone: `f` (order,) of F = 1 + f_1/q +
    ..., `b` (m, order + 1), `offset` c, `shifts` (m,) samples. `simulated` (n,) of every record; `cost` that of
    squared errors over fitted samples, `arx_rmse` the RMSE of the ARX model that the search began from, simulated
    too. `count` free numbers, initial states included."""

    order: int
    f: np.ndarray
    b: np.ndarray
    offset: float
    shifts: tuple[int, ...]
    period: float
    simulated: tuple[np.ndarray, ...]
    cost: float
    arx_rmse: float
    count: int

    @property
    def poles(self) -> np.ndarray:
        """Poles (order,) in the z plane."""
        return np.roots(np.r_[1.0, self.f]) if self.order else np.zeros(0)

    @property
    def stable(self) -> bool:
        """Whether all poles lie inside the unit circle."""
        return bool(np.all(np.abs(self.poles) < 1.0))

    @property
    def gains(self) -> np.ndarray:
        """What the output does at last for a step of one of each input (m,)."""
        return np.sum(self.b, axis=1) / (1.0 + np.sum(self.f))

    def dead_times(self) -> tuple[float, ...]:
        """Of every input, s: the samples before its first coefficient that counts, less the one that a held input
        takes."""
        first = [int(np.argmax(np.abs(row) >= WEIGHTY * np.max(np.abs(row)))) if np.any(row) else 0 for row in self.b]
        return tuple(self.period * max(0, shift + lag - 1) for shift, lag in zip(self.shifts, first, strict=True))

    def step(self, k: int, samples: int) -> np.ndarray:
        """Answer (samples,) of the output to a unit step of input k."""
        u = np.r_[np.zeros(self.shifts[k]), np.ones(max(0, samples - self.shifts[k]))][:samples]
        return scipy.signal.lfilter(self.b[k], np.r_[1.0, self.f], u)

    def response(self, k: int, f: np.ndarray) -> np.ndarray:
        """Frequency response (len(f),) complex of input k at f in Hz."""
        q = np.exp(-2j * np.pi * np.asarray(f) * self.period)
        top = np.polyval(self.b[k][::-1], q) * q ** self.shifts[k]
        return top / np.polyval(np.r_[1.0, self.f][::-1], q)


def fit_linear(
    records: Sequence[Data], order: int, shifts: Sequence[int], steps: int = STEPS, begin: LinearFit | None = None
) -> LinearFit | None:
    """The output-error model of an order with given shifts (samples) that simulates the fitted samples best; None where
    none is found.

    All records share F, B and c. A record with fitted samples has initial states of its own; one without begins at its
    first measured output, as if it had rested there. F starts from ARX (least squares of the equation error) and
    Steiglitz and McBride (IEEE Trans. Automatic Control 10 (1965) 461); then damped Gauss-Newton over F, linear numbers
    solved for (Golub and Pereyra, SIAM J. Numerical Analysis 10 (1973) 413). With `begin` F starts from a fit of the
    same order to more of the samples, and stays stable where that one is: a pole outside the unit circle would run away
    over samples that were left out.
    """
    shifts = tuple(int(s) for s in shifts)
    f, arx = np.zeros(order), None
    best = _solved(records, f if begin is None else begin.f, shifts) if order == 0 or begin is not None else None
    for turn in range(PASSES if order and begin is None else 0):
        f = _prefiltered(records, f, shifts)
        found = _solved(records, _inside(f), shifts)
        arx = found if turn == 0 else arx
        if found is not None and (best is None or found.cost < best.cost):
            best = found
    if best is None:
        return None
    fitted = sum(int(d.fitted.sum()) for d in records)
    rmse = float(np.sqrt(arx.cost / fitted)) if arx is not None else float(np.sqrt(best.cost / fitted))
    best, damping = replace(best, arx_rmse=rmse), 1e-3
    for _ in range(steps if order else 0):
        jacobian, errors = _slopes(records, best)
        norms = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        jacobian = jacobian / norms
        normal, right = jacobian.T @ jacobian, jacobian.T @ errors
        trial = None
        for _ in range(8):
            move = (
                np.linalg.lstsq(normal + damping * np.diag(np.diag(normal) + 1e-300), right, rcond=None)[0][:order]
                / norms[:order]
            )
            trial = _solved(records, best.f + move, shifts)
            if trial is not None and trial.cost < best.cost and (trial.stable or begin is None or not begin.stable):
                damping = max(damping / 10.0, 1e-12)
                break
            trial, damping = None, damping * 10.0
        if trial is None:
            break
        gain, best = 1.0 - trial.cost / max(best.cost, 1e-300), replace(trial, arx_rmse=rmse)
        if gain < SETTLED:
            break
    return best


def _inside(f: np.ndarray) -> np.ndarray:
    """F with poles outside the unit circle mirrored into it."""
    poles = np.roots(np.r_[1.0, f])
    far = np.abs(poles) > 1.0
    return np.real(np.poly(np.where(far, 1.0 / np.conj(np.where(far, poles, 1.0)), poles)))[1:]


def _shifted(u: np.ndarray, by: int) -> np.ndarray:
    """u (n,) later by so many samples; before the record it had its first value."""
    return u if by == 0 else np.r_[np.full(min(by, len(u)), u[0]), u[: max(0, len(u) - by)]]


def _filled(d: Data) -> np.ndarray:
    known = np.isfinite(d.y)
    return np.interp(np.arange(len(d.y)), np.flatnonzero(known), d.y[known])


def _prefiltered(records: Sequence[Data], f: np.ndarray, shifts: tuple[int, ...]) -> np.ndarray:
    """F (order,) by least squares of the equation error, inputs and output filtered by the last 1/F."""
    order, rows, right = len(f), [], []
    down = np.r_[1.0, _inside(f)]
    for d in records:
        y = _filled(d)
        y = scipy.signal.lfilter([1.0], down, y - y[0])
        columns = [-_lag0(y, j) for j in range(1, order + 1)]
        for k, shift in enumerate(shifts):
            u = scipy.signal.lfilter([1.0], down, d.inputs[:, k] - d.inputs[0, k])
            columns += [_lag0(u, shift + j) for j in range(order + 1)]
        impulse = np.r_[1.0, np.zeros(len(y) - 1)]
        answer = scipy.signal.lfilter([1.0], down, impulse)
        columns += [np.cumsum(answer), *(_lag0(answer, j) for j in range(order))]
        use = d.fitted
        rows.append(np.column_stack(columns)[use])
        right.append(y[use])
    a = np.vstack(rows)
    norms = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    return (np.linalg.lstsq(a / norms, np.concatenate(right), rcond=1e-12)[0] / norms)[:order]


def _lag0(v: np.ndarray, by: int) -> np.ndarray:
    return v if by == 0 else np.r_[np.zeros(min(by, len(v))), v[: max(0, len(v) - by)]]


def _columns(d: Data, f: np.ndarray, shifts: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shared columns (n, p), columns of this record's initial states (n, order), and the answer to a past at rest
    (n,)."""
    order, down, n = len(f), np.r_[1.0, f], len(d.y)
    shared = []
    for k, shift in enumerate(shifts):
        shared += [scipy.signal.lfilter([1.0], down, _shifted(d.inputs[:, k], shift + j)) for j in range(order + 1)]
    shared.append(scipy.signal.lfilter([1.0], down, np.ones(n)))
    impulse = scipy.signal.lfilter([1.0], down, np.r_[1.0, np.zeros(n - 1)])
    own = np.column_stack([_lag0(impulse, j) for j in range(order)]) if order else np.zeros((n, 0))
    first = float(d.y[np.isfinite(d.y)][0])
    begun = scipy.signal.lfiltic([1.0], down, np.full(order, first)) if order else np.zeros(0)
    past = scipy.signal.lfilter([1.0], down, np.zeros(n), zi=begun)[0] if order else np.zeros(n)
    return np.column_stack(shared), own, past


def _solved(records: Sequence[Data], f: np.ndarray, shifts: tuple[int, ...]) -> LinearFit | None:
    """The model with this F, all else by linear least squares; None where it does not stay finite."""
    with np.errstate(all="ignore"):
        made = [_columns(d, f, shifts) for d in records]
    if not all(np.all(np.abs(part) < EXPLODED) for one in made for part in one):
        return None
    p, order = made[0][0].shape[1], len(f)
    free = [bool(d.fitted.any()) and not d.rested for d in records]
    starts = np.cumsum([0, *(order if own else 0 for own in free)])
    rows, right = [], []
    for k, (d, (shared, own, past)) in enumerate(zip(records, made, strict=True)):
        if d.fitted.any():
            block = np.zeros((len(d.y), p + starts[-1]))
            block[:, :p] = shared
            if free[k]:
                block[:, p + starts[k] : p + starts[k + 1]] = own
            rows.append(block[d.fitted])
            right.append((d.y - past)[d.fitted])
    a = np.vstack(rows)
    norms = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    x = np.linalg.lstsq(a / norms, np.concatenate(right), rcond=1e-10)[0] / norms
    simulated, cost = [], 0.0
    for k, (d, (shared, own, past)) in enumerate(zip(records, made, strict=True)):
        y = shared @ x[:p] + past + (own @ x[p + starts[k] : p + starts[k + 1]] if free[k] else 0.0)
        simulated.append(y)
        cost += float(np.sum((y - d.y)[d.fitted] ** 2))
    m = len(shifts)
    b = x[: m * (order + 1)].reshape(m, order + 1)
    count = order + p + int(starts[-1]) + m
    return LinearFit(
        order,
        np.array(f, dtype=float),
        b,
        float(x[p - 1]),
        shifts,
        records[0].period,
        tuple(simulated),
        cost,
        np.nan,
        count,
    )


def _slopes(records: Sequence[Data], fit: LinearFit) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (k, .) of the simulated fitted samples by F and all linear numbers, and the errors (k,)."""
    rows, errors, order, down = [], [], fit.order, np.r_[1.0, fit.f]
    used = [d for d in records if d.fitted.any()]
    free = sum(not d.rested for d in used)
    start = order + (order + 1) * len(fit.shifts) + 1
    for d in used:
        y = fit.simulated[[id(r) for r in records].index(id(d))]
        first = float(d.y[np.isfinite(d.y)][0])
        slopes = [
            -scipy.signal.lfilter([1.0], down, np.r_[np.full(min(j, len(y)), first), y[: len(y) - j]])
            for j in range(1, order + 1)
        ]
        shared, own, _ = _columns(d, fit.f, fit.shifts)
        block = np.zeros((len(y), order + shared.shape[1] + order * free))
        if order:
            block[:, :order] = np.column_stack(slopes)
        block[:, order : order + shared.shape[1]] = shared
        if not d.rested:
            block[:, start : start + order] = own
            start += order
        rows.append(block[d.fitted])
        errors.append((d.y - y)[d.fitted])
    return np.vstack(rows), np.concatenate(errors)


def step_band(records: Sequence[Data], fit: LinearFit, k: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Answer (samples,) to a unit step of input k, and the half width (samples,) of its 95 % interval if order and dead
    times are right.

    From the covariance of the linearised fit, widened by the correlation of the residuals, and differences of the
    answer.
    """
    jacobian, errors = _slopes(records, fit)
    norms = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    inverse = np.linalg.pinv((jacobian / norms).T @ (jacobian / norms), rcond=1e-12, hermitian=True)
    index = np.concatenate([np.flatnonzero(d.fitted) for d in records])
    variance = (
        float(np.sum(errors**2))
        / max(1, len(errors) - fit.count)
        * (inflation(errors, index) if len(records) == 1 else 1.0)
    )
    own = [*range(fit.order), *(fit.order + k * (fit.order + 1) + j for j in range(fit.order + 1))]
    spread = inverse[np.ix_(own, own)] * variance / np.outer(norms[own], norms[own])
    middle, slopes = fit.step(k, samples), []
    for j in range(len(own)):
        size = 1e-2 * np.sqrt(max(spread[j, j], 1e-300))
        f, b = fit.f.copy(), fit.b.copy()
        if j < fit.order:
            f[j] += size
        else:
            b[k, j - fit.order] += size
        slopes.append((replace(fit, f=f, b=b).step(k, samples) - middle) / size)
    a = np.array(slopes)
    return middle, 1.96 * np.sqrt(np.maximum(np.einsum("is,ij,js->s", a, spread, a), 0.0))
