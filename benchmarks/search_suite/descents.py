"""Local searches that share no code with plantfit.optimize: scipy's one at a time, and Levenberg-Marquardt of many
lanes by QR."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import optimize

import plantfit as pf
import plantfit.runtime

import jax

HUGE = 1e150  # residuals whose squares overflow
LONGEST = 1000  # evaluations of one search; those of the suite take 10 to 300
ENTRIES = 2_000_000  # of Jacobians evaluated at once
TOLERANCE = 1e-12


@dataclass(frozen=True)
class End:
    """Where a local search ended: cube point (d,), cost (mean square of the residuals, +inf where the start failed),
    evaluations."""

    z: np.ndarray
    cost: float
    evaluations: int


def descend(problem: pf.Problem, z: np.ndarray, longest: int = LONGEST) -> End:
    """Trust-region reflective least squares of scipy with the exact Jacobian from a cube point to its end."""
    known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def at(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = z.tobytes()
        if key not in known:
            known.clear()
            r, jacobian = problem.residuals_and_jacobian(z)
            fine = bool(np.all(np.abs(r) < HUGE)) and bool(np.all(np.isfinite(jacobian)))
            known[key] = (
                (np.array(r), np.array(jacobian)) if fine else (np.full(r.shape, np.nan), np.zeros(jacobian.shape))
            )
        return known[key]

    z = np.clip(np.asarray(z, dtype=float), 1e-10, 1 - 1e-10)
    first, _ = at(z)
    if not np.all(np.isfinite(first)):
        return End(z, np.inf, 1)
    unit = float(np.linalg.norm(first)) or 1.0  # the gradient tolerance of scipy is absolute
    answer = optimize.least_squares(
        lambda z: at(z)[0] / unit,
        z,
        jac=lambda z: at(z)[1] / unit,
        bounds=(0.0, 1.0),
        method="trf",
        x_scale="jac",
        ftol=TOLERANCE,
        xtol=TOLERANCE,
        gtol=1e-15,
        max_nfev=longest,
    )
    return End(answer.x, float(np.mean((answer.fun * unit) ** 2)), int(answer.nfev))


def descend_many(problem: pf.Problem, zs: np.ndarray, longest: int = LONGEST) -> tuple[np.ndarray, np.ndarray]:
    """Projected Levenberg-Marquardt from cube points (n, d), each to its end: points (n, d) and costs (n,), +inf where
    a start failed.

    Steps by QR of the Jacobian, never of its square; steps are cut at the box and taken when the cost falls (Kanzow,
    Yamashita and Fukushima 2004, J. Comput. Appl. Math. 172:375).
    """
    function = jax.jit(jax.vmap(problem.compiled["residuals_and_jacobian"], in_axes=(0, None)))
    rows = len(np.asarray(problem.residuals(zs[0])))
    width = int(np.clip(ENTRIES // (rows * zs.shape[1]), 8, 256))

    def evaluate(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        full = np.concatenate([z, np.repeat(z[:1], width - len(z), axis=0)])
        r, j = (np.asarray(a, dtype=float)[: len(z)] for a in function(full, problem.arguments))
        fine = np.all(np.abs(r) < HUGE, axis=1) & np.all(np.abs(j) < HUGE, axis=(1, 2))
        r, j = np.where(fine[:, None], r, 0.0), np.where(fine[:, None, None], j, 0.0)
        cost = np.where(fine, np.mean(r**2, axis=1), np.inf)
        return cost, *_triangles(j, r)

    points, costs, at = np.array(zs), np.full(len(zs), np.inf), 0
    lanes: _Lanes | None = None
    while at < len(zs) or lanes is not None:
        room = (
            0
            if lanes is not None and len(lanes.place) > width // 2
            else width - (0 if lanes is None else len(lanes.place))
        )
        if room and at < len(zs):
            fresh = _Lanes.begin(np.arange(at, min(at + room, len(zs))), points, evaluate)
            lanes = fresh if lanes is None else lanes.joined(fresh)
            at += room
        assert lanes is not None
        ended = lanes.advance(evaluate, longest)
        points[lanes.place[ended]], costs[lanes.place[ended]] = lanes.z[ended], lanes.cost[ended]
        lanes = None if np.all(ended) else lanes.kept(~ended)
    return points, costs


Evaluate = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


@dataclass
class _Lanes:
    """Searches under way: their places among all, points, costs, triangles with right sides, dampings, column norms,
    steps."""

    place: np.ndarray
    z: np.ndarray
    cost: np.ndarray
    upper: np.ndarray
    right: np.ndarray
    damping: np.ndarray
    scale: np.ndarray
    steps: np.ndarray

    @classmethod
    def begin(cls, place: np.ndarray, points: np.ndarray, evaluate: Evaluate) -> "_Lanes":
        z = points[place]
        cost, upper, right = evaluate(z)
        scale = np.maximum(np.linalg.norm(upper, axis=1), 1e-300)
        return cls(place, z, cost, upper, right, np.full(len(place), 1e-3), scale, np.zeros(len(place)))

    def joined(self, other: "_Lanes") -> "_Lanes":
        return _Lanes(*(np.concatenate(pair) for pair in zip(vars(self).values(), vars(other).values(), strict=True)))

    def kept(self, keep: np.ndarray) -> "_Lanes":
        return _Lanes(*(a[keep] for a in vars(self).values()))

    def advance(self, evaluate: Evaluate, longest: int) -> np.ndarray:
        """One step of every search; which have ended (n,)."""
        step, promised = _steps(self.z, self.upper, self.right, self.damping, self.scale)
        trial = np.clip(self.z + step, 0.0, 1.0)
        cost, upper, right = evaluate(trial)
        gained = self.cost - cost
        with np.errstate(invalid="ignore", divide="ignore"):
            good = np.isfinite(cost) & (gained > 0) & (gained >= 1e-4 * promised)
            ratio = np.where(promised > 0, gained / promised, 0.0)
        moved = np.linalg.norm(trial - self.z, axis=1)
        ended = (moved <= 1e-11 * (1e-11 + np.linalg.norm(self.z, axis=1))) | (promised <= TOLERANCE * self.cost)
        ended |= (
            ~np.isfinite(self.cost)
            | (good & (gained <= TOLERANCE * self.cost))
            | (self.damping > 1e14)
            | (self.steps >= longest)
        )
        self.z, self.cost = np.where(good[:, None], trial, self.z), np.where(good, cost, self.cost)
        self.upper, self.right = (
            np.where(good[:, None, None], upper, self.upper),
            np.where(good[:, None], right, self.right),
        )
        self.scale = np.maximum(self.scale, np.linalg.norm(self.upper, axis=1))
        easier = self.damping * np.where(ratio > 0.75, 0.2, np.where(ratio < 0.25, 2.0, 0.7))
        self.damping = np.maximum(np.where(good, easier, 5.0 * self.damping), 1e-16)
        self.steps = self.steps + 1
        return ended


def _triangles(j: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R (n, d, d) and Q'r (n, d) of J = QR, both divided by the root of the number of residuals."""
    q, upper = np.linalg.qr(j)
    root = np.sqrt(r.shape[1])
    short = j.shape[2] - upper.shape[1]  # fewer residuals than coordinates
    upper, right = upper / root, np.einsum("nmd,nm->nd", q, r) / root
    return np.pad(upper, ((0, 0), (0, short), (0, 0))), np.pad(right, ((0, 0), (0, short)))


def _steps(
    z: np.ndarray, upper: np.ndarray, right: np.ndarray, damping: np.ndarray, scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Damped steps (n, d) with coordinates on a bound that the gradient holds there left out, and the decrease that
    is promised."""
    d = z.shape[1]
    gradient = np.einsum("nij,ni->nj", upper, right)
    held = ((z <= 0) & (gradient > 0)) | ((z >= 1) & (gradient < 0))
    own = np.maximum(scale, 1e-10 * scale.max(axis=1, keepdims=True))
    columns = np.where(held[:, None, :], 0.0, upper / own[:, None, :])
    damped = np.sqrt(damping)[:, None, None] * np.eye(d)
    q, triangle = np.linalg.qr(np.concatenate([columns, damped], axis=1))
    back = -np.einsum("nij,ni->nj", q[:, :d], right)
    p = np.linalg.solve(triangle, back[:, :, None])[:, :, 0]
    step = np.clip(z + np.where(held, 0.0, p / own), 0.0, 1.0) - z
    model = right + np.einsum("nij,nj->ni", upper, step)
    return step, np.sum(right**2, axis=1) - np.sum(model**2, axis=1)
