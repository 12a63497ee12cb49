"""A plant with some additions, fitted from a point nearby: damped Gauss-Newton steps on exact and differenced
derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plantfit.models.extensions.kinds import KINDS
from plantfit.models.extensions.of_packages import packages_kinds
from plantfit.trust.diagnosis.candidates import Before, Behind, Changing, Law
from plantfit.trust.diagnosis.catalogue import Extension
from plantfit.trust.diagnosis.plant.carrier import FASTEST, SLOWEST, Carrier

STEP = 1e-4  # of the size of an addition: by how much it is moved for a derivative
DAMPING, GROWTH, LEAST = 1e-3, 4.0, 1e-9
ENDS = 1e-5  # relative decrease of the cost that ends a fit, promised without damping
SLOW = 0.5  # of what a whole step promises: with less the valley is bent, and steps follow it
STRAIGHT = 3  # steps before that
AHEAD, MOST_TURN = 0.1, 0.4  # of a step: where its bend is measured, and how far it may turn
SINGULAR = 1e-7  # of the largest singular value: directions that nothing shows


@dataclass(frozen=True)
class Fitted:
    """Additions, the carrier's parameters x (d,), the additions' own theta (k,), and the weighted residuals (m,) at all
    rows.

    `jacobian` (m, d + k) is by those of `free` columns. `settled`: no further step of the fit promised anything.
    """

    additions: tuple[Extension, ...]
    x: np.ndarray
    theta: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    settled: bool = True

    def cost(self, rows: np.ndarray) -> float:
        """Sum of squares over rows (m,) bool."""
        return float(np.sum(self.residuals[rows] ** 2))

    def value(self, addition: Extension, carrier: Carrier) -> float:
        """The parameter of an addition, in its unit (of initial values in several recordings the largest)."""
        k = self.additions.index(addition)
        if addition.place != "inside":
            return float(self.theta[k])
        own = self.x[list(carrier.inside[addition.kind, addition.signal])]
        return float(own[np.argmax(np.abs(own))])


def without(carrier: Carrier, one: Fitted, addition: Extension, use: np.ndarray) -> Fitted:
    """The fit without one of the additions, from where the fit with it ended."""
    k, x = one.additions.index(addition), one.x.copy()
    x[carrier_places(carrier, addition)] = 0.0
    return fitted(carrier, [a for a in one.additions if a is not addition], x, np.delete(one.theta, k), use)


def columns(carrier: Carrier, additions: Sequence[Extension]) -> np.ndarray:
    """Places of the free columns among carrier parameters and theta."""
    inside = [i for a in additions for i in (*carrier_places(carrier, a), *speed_places(carrier, a))]
    theta = [len(carrier.names) + k for k, a in enumerate(additions) if a.place != "inside"]
    return np.array([*range(carrier.own), *inside, *theta], dtype=int)


def carrier_places(carrier: Carrier, addition: Extension) -> list[int]:
    """Places of an effect inside the plant among the carrier's parameters; none of others."""
    wanted = [carrier.problem.space.names[i] for i in carrier.inside.get((addition.kind, addition.signal), ())]
    return [carrier.names.index(n) for n in wanted]


def speed_places(carrier: Carrier, addition: Extension) -> list[int]:
    """The place of the speed that is fitted beside an addition; none where there is none."""
    speed = carrier.speeds.get((addition.kind, addition.signal))
    return [] if speed is None else [carrier.names.index(carrier.problem.space.names[speed[0]])]


def changing(additions: Sequence[Extension]) -> bool:
    """Whether one of the additions changes with a signal."""
    return any(isinstance(a.candidate, Changing) for a in additions)


def evaluate(
    carrier: Carrier, additions: Sequence[Extension], x: np.ndarray, theta: np.ndarray, changes: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted residuals (m,) at all rows, NaN where nothing was measured, and derivatives (m, d + k) by x and linear
    theta.

    Columns of additions before and behind the plant that are not linear are left zero; without `changes` also those of
    all that changes with a signal, where none of that is among the additions.
    """
    rows = carrier.rows
    predicted, jacobian = carrier.at(x, _inputs(carrier, additions, theta), changes or changing(additions))
    jacobian = np.hstack([jacobian, np.zeros((len(predicted), len(additions)))])
    for k, a in _in_order(additions):
        if isinstance(a.candidate, Behind):
            column = len(carrier.names) + k
            predicted, jacobian = _behind(
                carrier, a.signal, a.candidate.law, column, float(theta[k]), predicted, jacobian
            )
    weight = rows.weight
    return (predicted - rows.measured) * weight, jacobian * weight[:, None]


def residuals_at(carrier: Carrier, additions: Sequence[Extension], x: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Weighted residuals (m,) at all rows, as `evaluate` gives them, without derivatives."""
    rows = carrier.rows
    predicted, none = carrier.at(x, _inputs(carrier, additions, theta), changing(additions), slopes=False)
    for k, a in _in_order(additions):
        if isinstance(a.candidate, Behind):
            predicted, _ = _behind(carrier, a.signal, a.candidate.law, None, float(theta[k]), predicted, none)
    return (predicted - rows.measured) * rows.weight


def _inputs(
    carrier: Carrier, additions: Sequence[Extension], theta: np.ndarray
) -> dict[str, dict[str, np.ndarray]] | None:
    own = [(k, a.signal, a.candidate.law) for k, a in reversed(_in_order(additions)) if isinstance(a.candidate, Before)]
    if not own:
        return None
    held = carrier.problem.predictor.stepping().interpolated
    made: dict[str, dict[str, np.ndarray]] = {}
    for name, e in carrier.problem.experiments.items():
        t, inputs = e.recording.t, dict(carrier.inputs[name])
        for k, u, law in own:
            inputs[u] = law(t, inputs[u], float(theta[k]), u not in held)
        made[name] = inputs
    return made


def _in_order(additions: Sequence[Extension]) -> list[tuple[int, Extension]]:
    """Places and additions as the study file has them, the nearest to the plant first, whichever was found first."""
    kinds = {kind: k for k, kind in enumerate((*KINDS, *packages_kinds()))}
    return sorted(enumerate(additions), key=lambda one: kinds.get(one[1].kind, len(kinds)))


def _behind(
    carrier: Carrier, y: str, law: Law, column: int | None, value: float, predicted: np.ndarray, jacobian: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    predicted, jacobian = predicted.copy(), jacobian.copy()
    for name, e in carrier.problem.experiments.items():
        at = carrier.rows.part(name, y)
        predicted[at], jacobian[at], slope = law(
            e.recording.t, predicted[at], jacobian[at], value, carrier.given.scales[y]
        )
        if slope is not None and column is not None:
            jacobian[at, column] = slope
    return predicted, jacobian


def whole(carrier: Carrier, additions: Sequence[Extension], point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted residuals (m,) and derivatives (m, d + k) at x with theta; those of additions that are not linear by
    differences."""
    n = len(carrier.names)
    r, jacobian = evaluate(carrier, additions, point[:n], point[n:])
    for k, a in enumerate(additions):
        if not a.candidate.differenced:
            continue
        size = STEP * max(abs(point[n + k]), 1e-3 * min(a.high - a.low, 1e300))
        size = -size if point[n + k] + size > a.high else size
        moved = point.copy()
        moved[n + k] += size
        with np.errstate(invalid="ignore"):  # of a plant that explodes
            jacobian[:, n + k] = (residuals_at(carrier, additions, moved[:n], moved[n:]) - r) / size
    return r, jacobian


def limits(carrier: Carrier, additions: Sequence[Extension]) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and highest of every coordinate of a point (d + k,)."""
    n = len(carrier.names)
    low, high = np.full(n + len(additions), -np.inf), np.full(n + len(additions), np.inf)
    low[: carrier.own], high[: carrier.own] = 0.0, 1.0
    for k, a in enumerate(additions):
        if a.place == "inside":
            for i in carrier_places(carrier, a):
                low[i], high[i] = a.low, a.high
            for i in speed_places(carrier, a):
                spread = carrier.speeds[a.kind, a.signal][1]
                low[i], high[i] = SLOWEST * spread, FASTEST * spread
        else:
            low[n + k], high[n + k] = a.low, a.high
    return low, high


def fitted(
    carrier: Carrier, additions: Sequence[Extension], x: np.ndarray, theta: np.ndarray, use: np.ndarray,
    steps: int = 30,
    beside: np.ndarray | None = None, held: Sequence[int] = (),
) -> Fitted:  # fmt: skip
    """The best fit near (x, theta) over the rows `use` (m,) bool, by at most so many steps; `beside` is an orthonormal
    base (n, k) over these n rows of what is fitted beside it and is not in the residuals. Coordinates that are `held`
    stay where they are.

    Damped Gauss-Newton steps; where these gain little of what they promise, they are turned along the bend of the
    valley by the second derivative along the step (geodesic acceleration; Transtrum, Machta and Sethna, Phys. Rev. E 83
    (2011) 036701, section VII).
    """
    additions, theta, x = tuple(additions), np.array(theta, dtype=float), np.array(x, dtype=float)
    free, n = columns(carrier, additions), len(carrier.names)
    free = free[~np.isin(free, list(held))]
    low, high = limits(carrier, additions)
    point, damping, slow, settled = np.r_[x, theta], DAMPING, False, False

    def own(v: np.ndarray) -> np.ndarray:
        return v if beside is None else v - beside @ (beside.T @ v)

    r, jacobian = whole(carrier, additions, point)
    for taken in range(steps):
        a, b = own(jacobian[np.ix_(use, free)]), own(r[use])
        norms, cost = lengths(a), float(b @ b)
        if not np.isfinite(cost) or not np.all(np.isfinite(norms)):
            break
        q, s, right = np.linalg.svd(a / norms, full_matrices=False)
        # what the damping holds back is promised as well: along a valley each damped step gains little, far from its
        # end
        promised = _promised(point[free], low[free], high[free], a, b, q, s)
        if promised <= ENDS * cost:
            settled = True
            break
        s_inv = s / (s**2 + damping)
        step = -(right.T @ (s_inv * (q.T @ b))) / norms
        if slow and taken >= STRAIGHT:
            moved = point.copy()
            moved[free] = np.clip(point[free] + AHEAD * step, low[free], high[free])
            bend = (
                2.0
                / AHEAD
                * ((own(residuals_at(carrier, additions, moved[:n], moved[n:])[use]) - b) / AHEAD - a @ step)
            )
            turn = -0.5 * (right.T @ (s_inv * (q.T @ bend))) / norms
            if np.all(np.isfinite(turn)) and np.linalg.norm(turn * norms) <= MOST_TURN * np.linalg.norm(step * norms):
                step = step + turn
        trial = point.copy()
        trial[free] = np.clip(point[free] + step, low[free], high[free])
        r2, j2 = whole(carrier, additions, trial)
        with np.errstate(over="ignore", invalid="ignore"):  # of a plant that explodes
            new = float(np.sum(own(r2[use]) ** 2))
        if np.isfinite(new) and new < cost:
            point, r, jacobian, damping = trial, r2, j2, max(damping / GROWTH, LEAST)
            slow = cost - new <= SLOW * promised
            if cost - new <= ENDS * cost and damping <= LEAST:
                settled = True
                break
        else:
            damping, slow = damping * GROWTH**2, True
            if damping > 1e4:
                break
    return Fitted(additions, point[:n], point[n:], r, jacobian, settled)


def lengths(a: np.ndarray) -> np.ndarray:
    """Of columns (m, k), infinite or NaN where one is too large, never zero."""
    with np.errstate(over="ignore", invalid="ignore"):  # a plant that explodes has such derivatives
        return np.maximum(np.linalg.norm(a, axis=0), 1e-300)


def _promised(
    x: np.ndarray, low: np.ndarray, high: np.ndarray, a: np.ndarray, b: np.ndarray, q: np.ndarray, s: np.ndarray
) -> float:
    """The decrease of the sum of squares |b|^2 that a whole Gauss-Newton step would bring, from x (k,) inside its
    bounds (k,); a (m, k) are the derivatives, q and s of their singular value decomposition."""
    slope = a.T @ b
    held = ((x <= low) & (slope > 0)) | ((x >= high) & (slope < 0))
    if held.any():
        inside = a[:, ~held]
        q, s, _ = np.linalg.svd(inside / lengths(inside), full_matrices=False)
    shown = s > SINGULAR * np.max(s, initial=0.0)
    return float(np.sum((q[:, shown].T @ b) ** 2))
