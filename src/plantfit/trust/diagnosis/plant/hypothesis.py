"""A plant with some additions, fitted from a point nearby: damped Gauss-Newton steps on exact and differenced derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plantfit.models.extensions.kinds import KINDS
from plantfit.models.extensions.of_packages import packages_kinds
from plantfit.trust.diagnosis.candidates import Before, Behind, Law
from plantfit.trust.diagnosis.catalogue import Extension
from plantfit.trust.diagnosis.plant.carrier import Carrier

STEP = 1e-4  # of the size of an addition: by how much it is moved for a derivative
DAMPING, GROWTH, LEAST = 1e-3, 4.0, 1e-9
ENDS = 1e-5  # relative decrease of the cost that ends a fit, promised without damping
SLOW = 0.5  # of what a whole step promises: with less the valley is bent, and steps follow it
STRAIGHT = 3  # steps before that
AHEAD, MOST_TURN = 0.1, 0.4  # of a step: where its bend is measured, and how far it may turn
SINGULAR = 1e-7  # of the largest singular value: directions that nothing shows


@dataclass(frozen=True)
class Fitted:
    """Additions, the carrier's parameters x (d,), the additions' own theta (k,), and the weighted residuals (m,) at all rows.

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
    if addition.place == "inside":
        x[carrier_places(carrier, addition)] = 0.0
    return fitted(carrier, [a for a in one.additions if a is not addition], x, np.delete(one.theta, k), use)


def columns(carrier: Carrier, additions: Sequence[Extension]) -> np.ndarray:
    """Places of the free columns among carrier parameters and theta."""
    inside = [i for a in additions if a.place == "inside" for i in carrier_places(carrier, a)]
    theta = [len(carrier.names) + k for k, a in enumerate(additions) if a.place != "inside"]
    return np.array([*range(carrier.own), *inside, *theta], dtype=int)


def carrier_places(carrier: Carrier, addition: Extension) -> list[int]:
    """Places of an effect inside the plant among the carrier's parameters."""
    wanted = [carrier.problem.space.names[i] for i in carrier.inside[addition.kind, addition.signal]]
    return [carrier.names.index(n) for n in wanted]


def evaluate(carrier: Carrier, additions: Sequence[Extension], x: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted residuals (m,) at all rows, NaN where nothing was measured, and derivatives (m, d + k) by x and linear theta.

    Columns of additions before and behind the plant that are not linear are left zero.
    """
    rows = carrier.rows
    predicted, jacobian = carrier.at(x, _inputs(carrier, additions, theta))
    jacobian = np.hstack([jacobian, np.zeros((len(predicted), len(additions)))])
    for k, a in _in_order(additions):
        if isinstance(a.candidate, Behind):
            column = len(carrier.names) + k
            predicted, jacobian = _behind(carrier, a.signal, a.candidate.law, column, float(theta[k]), predicted, jacobian)
    weight = rows.weight
    return (predicted - rows.measured) * weight, jacobian * weight[:, None]


def _inputs(carrier: Carrier, additions: Sequence[Extension], theta: np.ndarray) -> dict[str, dict[str, np.ndarray]] | None:
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
    kinds = (*KINDS, *packages_kinds())
    return sorted(enumerate(additions), key=lambda one: kinds.index(one[1].kind))


def _behind(
    carrier: Carrier, y: str, law: Law, column: int, value: float, predicted: np.ndarray, jacobian: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    predicted, jacobian = predicted.copy(), jacobian.copy()
    for name, e in carrier.problem.experiments.items():
        at = carrier.rows.part(name, y)
        predicted[at], jacobian[at], slope = law(e.recording.t, predicted[at], jacobian[at], value, carrier.given.scales[y])
        if slope is not None:
            jacobian[at, column] = slope
    return predicted, jacobian


def fitted(carrier: Carrier, additions: Sequence[Extension], x: np.ndarray, theta: np.ndarray, use: np.ndarray, steps: int = 30) -> Fitted:
    """The best fit near (x, theta) over the rows `use` (m,) bool, by at most so many steps.

    Damped Gauss-Newton steps; where these gain little of what they promise, they are turned along the bend of the valley by the second
    derivative along the step (geodesic acceleration; Transtrum, Machta and Sethna, Phys. Rev. E 83 (2011) 036701, section VII).
    """
    additions, theta, x = tuple(additions), np.array(theta, dtype=float), np.array(x, dtype=float)
    free, n = columns(carrier, additions), len(carrier.names)
    low, high = np.full(n + len(additions), -np.inf), np.full(n + len(additions), np.inf)
    low[: carrier.own], high[: carrier.own] = 0.0, 1.0
    for k, a in enumerate(additions):
        if a.place == "inside":
            for i in carrier_places(carrier, a):
                low[i], high[i] = a.low, a.high
        else:
            low[n + k], high[n + k] = a.low, a.high

    def whole(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, jacobian = evaluate(carrier, additions, point[:n], point[n:])
        for k, a in enumerate(additions):
            if not a.candidate.differenced:
                continue
            size = STEP * max(abs(point[n + k]), 1e-3 * min(a.high - a.low, 1e300))
            size = -size if point[n + k] + size > a.high else size
            moved = point.copy()
            moved[n + k] += size
            jacobian[:, n + k] = (evaluate(carrier, additions, moved[:n], moved[n:])[0] - r) / size
        return r, jacobian

    point, damping, slow, settled = np.r_[x, theta], DAMPING, False, False
    r, jacobian = whole(point)
    for taken in range(steps):
        a, b = jacobian[np.ix_(use, free)], r[use]
        norms = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
        cost = float(b @ b)
        if not np.isfinite(cost) or not np.all(np.isfinite(a)):
            break
        q, s, right = np.linalg.svd(a / norms, full_matrices=False)
        # what the damping holds back is promised as well: along a valley each damped step gains little, far from its end
        promised = _promised(point[free], low[free], high[free], a, b, q, s)
        if promised <= ENDS * cost:
            settled = True
            break
        s_inv = s / (s**2 + damping)
        step = -(right.T @ (s_inv * (q.T @ b))) / norms
        if slow and taken >= STRAIGHT:
            moved = point.copy()
            moved[free] = np.clip(point[free] + AHEAD * step, low[free], high[free])
            bend = 2.0 / AHEAD * ((evaluate(carrier, additions, moved[:n], moved[n:])[0][use] - b) / AHEAD - a @ step)
            turn = -0.5 * (right.T @ (s_inv * (q.T @ bend))) / norms
            if np.all(np.isfinite(turn)) and np.linalg.norm(turn * norms) <= MOST_TURN * np.linalg.norm(step * norms):
                step = step + turn
        trial = point.copy()
        trial[free] = np.clip(point[free] + step, low[free], high[free])
        r2, j2 = whole(trial)
        new = float(np.sum(r2[use] ** 2))
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


def _promised(x: np.ndarray, low: np.ndarray, high: np.ndarray, a: np.ndarray, b: np.ndarray, q: np.ndarray, s: np.ndarray) -> float:
    """The decrease of the sum of squares |b|^2 that a whole Gauss-Newton step would bring, from x (k,) inside its bounds (k,); a (m, k) are
    the derivatives, q and s of their singular value decomposition."""
    slope = a.T @ b
    held = ((x <= low) & (slope > 0)) | ((x >= high) & (slope < 0))
    if held.any():
        inside = a[:, ~held]
        q, s, _ = np.linalg.svd(inside / np.maximum(np.linalg.norm(inside, axis=0), 1e-300), full_matrices=False)
    shown = s > SINGULAR * np.max(s, initial=0.0)
    return float(np.sum((q[:, shown].T @ b) ** 2))
