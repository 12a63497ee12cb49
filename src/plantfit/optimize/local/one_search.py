"""One local search from one start: bounded least squares and L-BFGS-B, robust at bounds and failures."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy  # its rooms are loaded at their first use: scipy.optimize takes a third of the time of jax

from plantfit.optimize.loop.counter import Counter

NEAR_BOUND = 1e-6
ON_BOUND = 1.1e-10  # just above the distance that scipy keeps at its start


@dataclass(frozen=True)
class Found:
    """Where a local search stands: point (d,), cost, whether its start could be simulated, and whether it came to its
    own end.

    A search that is not `finished` was cut off by its limit of steps.
    """

    x: np.ndarray
    cost: float
    started: bool = True
    finished: bool = True


@dataclass(frozen=True)
class Loss:
    """A loss of scipy.optimize.least_squares; `scale` is the residual where it turns robust."""

    name: str = "linear"
    scale: float = 1.0

    def rank(self, residuals: np.ndarray) -> float:
        """Mean loss: sum of rho((r / s)^2) s^2 over m, equal to the mean square for "linear"."""
        z = (residuals / self.scale) ** 2
        if self.name == "soft_l1":
            z = 2 * (np.sqrt(1 + z) - 1)
        elif self.name == "huber":
            z = np.where(z <= 1, z, 2 * np.sqrt(np.maximum(z, 1)) - 1)
        elif self.name == "cauchy":
            z = np.log1p(z)
        return float(np.mean(z) * self.scale**2)


class _Residuals:
    """Residuals and Jacobian over some coordinates, the others held; the last points are remembered.

    scipy asks for residuals and Jacobian apart; both come from one call here.
    """

    def __init__(self, counter: Counter, base: np.ndarray, free: np.ndarray, compressed: bool):
        self.counter, self.base, self.free, self.compressed = counter, base, free, compressed
        self.known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def full(self, z: np.ndarray) -> np.ndarray:
        x = self.base.copy()
        # the method comes within rounding of a bound but never onto it
        x[self.free] = np.where(z <= ON_BOUND, 0.0, np.where(z >= 1 - ON_BOUND, 1.0, z))
        return x

    def at(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        name = np.asarray(z, dtype=float).tobytes()
        if name not in self.known:
            if len(self.known) >= 4:
                del self.known[next(iter(self.known))]
            r, jacobian = self.counter.residuals_and_jacobian(self.full(z), compressed=self.compressed)
            self.known[name] = r, jacobian[:, self.free]
        return self.known[name]


def trust_region(counter: Counter, start: np.ndarray, loss: Loss, max_steps: int) -> Found:
    """Trust-region reflective least squares (Branch, Coleman and Li 1999, SIAM J. Sci. Comput. 21:1) from `start`.

    A trial point that cannot be simulated has NaN residuals, which scipy answers by a smaller step.
    The method stays inside the box; the answer is then moved onto the bounds it leans against.
    """
    found, gradient = _solve(counter, np.asarray(start, dtype=float), np.ones(len(start), dtype=bool), loss, max_steps)
    return _onto_bounds(counter, found, gradient, loss, max_steps) if found.started else found


def _solve(counter: Counter, x: np.ndarray, free: np.ndarray, loss: Loss, max_steps: int) -> tuple[Found, np.ndarray]:
    """Search over the free coordinates from x; the answer and the gradient over the free coordinates."""
    residuals = _Residuals(counter, x, free, compressed=loss.name == "linear")
    # scipy moves a start on a bound inside by this much; evaluate the point that it will take
    inside = np.clip(x[free], 1e-10, 1 - 1e-10)
    first, _ = residuals.at(inside)
    if not np.all(np.isfinite(first)):
        return Found(residuals.full(inside), np.inf, started=False), np.zeros(len(inside))
    # residuals of length 1 at the start, because the gradient tolerance of scipy is absolute
    unit = float(np.linalg.norm(first)) or 1.0
    tolerances: Any = {"ftol": 1e-12, "xtol": 1e-12, "gtol": 1e-15, "max_nfev": max_steps}
    answer = scipy.optimize.least_squares(
        lambda z: residuals.at(z)[0] / unit,
        inside,
        jac=lambda z: residuals.at(z)[1] / unit,
        bounds=(0.0, 1.0),
        method="trf",
        x_scale="jac",
        loss=loss.name,
        f_scale=loss.scale / unit,
        **tolerances,
    )
    return Found(residuals.full(answer.x), loss.rank(answer.fun * unit), finished=answer.status > 0), answer.grad


def _onto_bounds(counter: Counter, found: Found, gradient: np.ndarray, loss: Loss, max_steps: int) -> Found:
    """Set coordinates that lean against a bound onto it and solve again for the rest, if that costs no more."""
    low = (found.x < NEAR_BOUND) & (gradient > 0)
    high = (found.x > 1 - NEAR_BOUND) & (gradient < 0)
    if not np.any(low | high):
        return found
    x = np.where(low, 0.0, np.where(high, 1.0, found.x))
    free = ~(low | high)
    if np.any(free):
        polished, _ = _solve(counter, x, free, loss, max_steps)
    else:
        polished = Found(x, loss.rank(counter.residuals_and_jacobian(x)[0]))
    if polished.cost > found.cost:
        return found
    return polished if found.finished else replace(polished, finished=False)


def lbfgsb(counter: Counter, start: np.ndarray, max_steps: int, memory: int = 20) -> Found:
    """L-BFGS-B (Byrd, Lu, Nocedal and Zhu 1995, SIAM J. Sci. Comput. 16:1190) with the exact gradient.

    The cost is divided by its value at the start, because the stopping rules of scipy are partly absolute.
    """
    start = np.clip(np.asarray(start, dtype=float), 0.0, 1.0)
    first, slope = counter.value_and_gradient(start)
    if not np.isfinite(first):
        return Found(start, np.inf, started=False)
    unit = abs(first) if first != 0 else 1.0
    known = {start.tobytes(): (first, slope)}

    def scaled(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = known.pop(x.tobytes(), None) or counter.value_and_gradient(np.clip(x, 0.0, 1.0))
        # a failed trial looks like a high plateau, so that the line search comes back
        return (
            (value / unit, gradient / unit)
            if np.isfinite(value)
            else (1e6 * (abs(first) / unit + 1), np.zeros_like(gradient))
        )

    options: Any = {
        "maxcor": memory,
        "maxls": 40,
        "ftol": 1e-15,
        "gtol": 1e-10,
        "maxiter": max_steps,
        "maxfun": 4 * max_steps,
    }
    answer = scipy.optimize.minimize(
        scaled, start, jac=True, method="L-BFGS-B", bounds=[(0.0, 1.0)] * len(start), options=options
    )
    # status 1: the limit of steps or evaluations
    return Found(np.clip(answer.x, 0.0, 1.0), float(answer.fun) * unit, finished=answer.status != 1)
