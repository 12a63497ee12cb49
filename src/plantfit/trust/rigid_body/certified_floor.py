"""A proven lower bound on the cost of a rigid-body regression over a box of physical parameters, by branch and
bound."""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import ModelError
from plantfit.problem.evaluate.compress import Compressed
from plantfit.runtime import jit
from plantfit.trust.identify.combinations import Base, stacked
from plantfit.trust.rigid_body.convex_bound import ConvexProblem, lower_bound
from plantfit.trust.rigid_body.feasibility import LinkNames
from plantfit.trust.verdict.words import number

import jax
import jax.numpy as jnp

BOXES = 400  # examined at most
Box = tuple[np.ndarray, np.ndarray]  # lower and upper bounds of the parameters


@dataclass(frozen=True)
class Floor:
    """No point of the box has a mean square below `cost`; `gap` is how far the known point lies above it, relative
    to its cost."""

    cost: float
    gap: float
    boxes: int

    @property
    def sentence(self) -> str:
        proof = f"proven by branch and bound over {self.boxes} box{'es' if self.boxes > 1 else ''}"
        known = f"No parameters inside the bounds reach an RMSE below {np.sqrt(self.cost):.6g}, {proof}"
        return f"{known}: the optimum is global to {number(max(self.gap, 1e-15))} of its mean square."


def certified_floor(
    compressed: Compressed,
    base: Base,
    names: Sequence[str],
    lower: Any,
    upper: Any,
    links: Sequence[LinkNames],
    known: float,
    inside_links: bool = False,
    tolerance: float = 1e-6,
) -> Floor:
    """Lower bound on the mean square of `constrained_optimum`'s problem, to prove that its cost `known` is global.

    In mass m, first moment h = m lc and inertia about the joint J = I + m lc^2 of every link the coefficients of a
    rigid body are linear, and all bounds are convex but the upper one of I, for which h^2/m is replaced by its chord
    over the box; boxes are halved in lc until chord and curve agree to `tolerance` of the cost. Each bound is that of
    Lagrange's dual, so that an inexact solution makes it lower, never wrong. `inside_links` adds `link_constraints`.
    Raises ModelError when `base` is not linear in m, h and J (or in another parameter), or a mass may be 0.
    """
    whole: Box = (np.asarray(lower, dtype=float), np.asarray(upper, dtype=float))
    places = _places(tuple(names), links, whole)
    slope, constant = _affine(stacked(base, names), places, _variables(places, *whole))
    scale = 1.0 / np.sqrt(float(compressed.n) * max(float(known), 1e-300))
    triangle = np.asarray(compressed.R)
    rows, target = triangle @ slope * scale, (np.asarray(compressed.projected) - triangle @ constant) * scale
    lifted = _Lifted(rows, target, float(compressed.rest) * scale**2, places, tuple(links), inside_links)
    queue = [(lifted.bound(whole), 0, whole)]
    boxes = 1
    while queue[0][0] < 1.0 - tolerance and boxes < BOXES:
        parent, _, box = heapq.heappop(queue)
        for half in lifted.halves(box):
            heapq.heappush(queue, (max(parent, lifted.bound(half)), boxes, half))
            boxes += 1
    lowest = min(max(queue[0][0], 0.0), 1.0)
    return Floor(lowest * float(known), 1.0 - lowest, boxes)


Places = list[tuple[int, int, int]]  # of m, lc and I of each link; in the lifted variables those of m, h and J


def _places(names: tuple[str, ...], links: Sequence[LinkNames], box: Box) -> Places:
    missing = [n for k in links for n in (k.mass, k.centre, k.inertia) if n not in names]
    if missing:
        raise ModelError(
            f"The links name a parameter {missing[0]!r}, but the parameters are {list(names)}; use one of these."
        )
    found = [(names.index(k.mass), names.index(k.centre), names.index(k.inertia)) for k in links]
    for link, (m, _, _) in zip(links, found, strict=True):
        if not box[0][m] > 0:
            raise ModelError(
                f"{link.mass} may be {box[0][m]:g}; give a lower bound above 0, or there is no centre of mass."
            )
    return found


def _variables(places: Places, low: np.ndarray, high: np.ndarray) -> Box:
    """Bounds of the lifted variables over a box of parameters."""
    least, most = low.copy(), high.copy()
    for m, c, i in places:
        least[c], most[c] = min(low[c] * low[m], low[c] * high[m]), max(high[c] * high[m], high[c] * low[m])
        least[i], most[i] = low[i], high[i] + high[m] * max(low[c] ** 2, high[c] ** 2)
    return least, most


def _affine(vector: Any, places: Places, ends: Box) -> tuple[np.ndarray, np.ndarray]:
    """Slope (k, d) and constant (k,) of the coefficients by the lifted variables; ModelError where they are not
    linear."""

    def coefficients(v: Any) -> Any:
        p = v
        for m, c, i in places:
            p = p.at[c].set(v[c] / v[m]).at[i].set(v[i] - v[c] ** 2 / v[m])
        return vector(p)

    points = np.random.default_rng(0).uniform(*ends, (8, len(ends[0])))
    values, slopes = jit(jax.vmap(lambda v: (coefficients(v), jax.jacfwd(coefficients)(v))))(jnp.asarray(points))
    slope = np.asarray(slopes)[0]
    constant = np.asarray(values)[0] - slope @ points[0]
    size = np.abs(slope) @ ends[1] + np.abs(constant)
    if np.max(np.abs(np.asarray(values) - points @ slope.T - constant) / np.maximum(size, 1e-300)) > 1e-9:
        raise ModelError(
            "The coefficients are not linear in m, m*lc and I + m*lc^2 of the links; use constrained_optimum alone."
        )
    return slope, constant


@dataclass(frozen=True)
class _Lifted:
    """The regression |rows v - target|^2 + rest in variables (m, h, J) of the links and the other parameters, 1
    being the known cost."""

    rows: np.ndarray
    target: np.ndarray
    rest: float
    places: Places
    links: tuple[LinkNames, ...]
    inside: bool

    def bound(self, box: Box) -> float:
        """Lower bound on the cost in a box."""
        low, high = box
        least, most = _variables(self.places, low, high)
        linear, offset, cones = [], [], []
        for link, (m, c, i) in zip(self.links, self.places, strict=True):
            a, b = low[c], high[c]
            parts = [({c: 1.0, m: -a}, 0.0), ({c: -1.0, m: b}, 0.0), ({i: -1.0, c: a + b, m: -a * b}, high[i])]
            if self.inside and link.length is not None:
                parts += [({c: link.length, i: -1.0}, 0.0), ({c: -1.0, m: link.length}, 0.0), ({c: 1.0}, 0.0)]
            for terms, shift in parts:
                row = np.zeros(len(low))
                row[list(terms)] = list(terms.values())
                linear.append(row)
                offset.append(shift)
            cones.append((m, c, i, low[i]))
        return lower_bound(
            ConvexProblem(
                self.rows, self.target, self.rest, np.array(linear), np.array(offset), tuple(cones), least, most
            )
        )

    def halves(self, box: Box) -> list[Box]:
        """The box cut in the middle of the lc whose chord leaves h^2/m furthest."""
        low, high = box
        cut = max(self.places, key=lambda q: high[q[0]] * (high[q[1]] - low[q[1]]) ** 2 / (high[q[2]] - low[q[2]]))[1]
        below, above = high.copy(), low.copy()
        below[cut] = above[cut] = 0.5 * (low[cut] + high[cut])
        return [(low, below), (above, high)]
