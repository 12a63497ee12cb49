"""Variable projection: the coordinates in which residuals are affine are solved for inside every evaluation.

With residuals r(z) = r0(n) + A(n) a, n the nonlinear coordinates and a the others, a search sees

    f(n) = min over the box of a of |r0(n) + A(n) a|^2 / m                                             (1)

G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413. On the free linear coordinates F (those not at a bound), P
= I - A_F A_F^+ and a at its optimum, the residual of (1) is P r and its derivative

    P J_n - (A_F^+)' [dA_F'/dn_i r]_i                                                                  (2)

L. Kaufman, BIT 15 (1975) 49 leaves the second term out: it is orthogonal to r, so that the gradient stays exact, and
small where the residual is. Its rows come with `full`; dA/dn_j is exact from Jacobians at two values of each free
coordinate, since J_n is affine in a as well. Everything is computed from triangles of QR decompositions on the host.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate import points
from plantfit.problem.evaluate.bounded_linear import Orthogonal, Within, solve_within
from plantfit.problem.evaluate.box_shares import BoxShares
from plantfit.problem.evaluate.triangle import compressed, triangle
from plantfit.problem.linear.affine import affine_coordinates
from plantfit.problem.problem import Problem

SMALL_STEP = 1e-6  # share of the box: what the second solution may change, beyond it the columns do not say where it is
DIGITS = 1e-8  # of what the linear coordinates move: a cost from one Jacobian counts down to the square of this
SURE = 1e-6  # relative excess from which on a cost from one Jacobian is sure to be above another
MADE_UP = 1e-10  # of a kept coordinate's effect: what is left of it beside the solved ones, up to which nothing is
LARGEST = (
    1e150  # of numbers that can be squared; a candidate beyond it cannot be simulated, one that is not a number neither
)

Blocks = list[tuple[np.ndarray, np.ndarray, np.ndarray]]  # as of `Problem.blocks`


class Rows(NamedTuple):
    """Of n candidates: residuals (n, k) and derivatives (n, k, dn) in k = dn + 1 rows, and the whole cube points z (n,
    d).

    Those that are not `whole` (n,) were left after their cost was known: their derivatives are 0.
    """

    r: np.ndarray
    jacobian: np.ndarray
    z: np.ndarray
    whole: np.ndarray


class _First(NamedTuple):
    """One candidate with its linear coordinates solved for from one Jacobian."""

    z: np.ndarray
    share: np.ndarray  # (p,) of the box
    cost: float


class _Lane(NamedTuple):
    """One candidate with its linear coordinates solved for; `root` is a triangle (k, p + dn + 1) of [A, J_n, r] at
    `before`."""

    z: np.ndarray
    root: np.ndarray
    free: np.ndarray  # (p,)
    step: np.ndarray  # (p,) from `before` to z, as shares of the box
    before: np.ndarray  # (d,)
    share: np.ndarray  # (p,) of the box, at `before`


@dataclass(frozen=True, eq=False)
class Projection:
    """A problem over the coordinates `kept`, places (dn,) in its cube; those at `solved` (p,) are solved for.

    A mean of squares of `rows` is the cost of the problem at z. A candidate that cannot be simulated has NaN rows and
    costs infinity. With `full` derivatives are those of eq. (2), else Kaufman's.
    """

    problem: Problem
    kept: np.ndarray
    solved: np.ndarray
    full: bool = False

    @classmethod
    def of(cls, problem: Problem, *, full: bool = False) -> "Projection | None":
        """None where no coordinate is linear; which are is found once for all variants of the problem."""
        solved = affine_coordinates(problem)
        kept = [i for i in range(problem.space.dimension) if i not in set(solved)]
        return cls(problem, np.array(kept, dtype=int), np.array(solved, dtype=int), full) if solved else None

    @property
    def dimension(self) -> int:
        return len(self.kept)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the coordinates that a search sees."""
        return tuple(self.problem.space.names[i] for i in self.kept)

    @property
    def solved_names(self) -> tuple[str, ...]:
        """Of those that are solved for."""
        return tuple(self.problem.space.names[i] for i in self.solved)

    @property
    def charge(self) -> float:
        """Evaluations of the cost that a row of `rows`, a cost or a `lift` is charged: two Jacobians, with `full`
        one more for each coordinate solved for and another."""
        return (2.0 + (1.0 + len(self.solved) if self.full else 0.0)) * self.problem.jacobian_charge

    @property
    def cost_charge(self) -> float:
        """Those that a cost of `sample` is charged, or a row that is left after its cost: one Jacobian."""
        return self.problem.jacobian_charge

    def restrict(self, z: Any) -> np.ndarray:
        """The coordinates (..., dn) of cube points (..., d)."""
        return np.asarray(z, dtype=float)[..., self.kept]

    def rows(self, zn: Any, below: np.ndarray | None = None) -> Rows:
        """Projected residuals and their derivatives by `kept` coordinates (n, dn).

        A candidate that surely costs more than its entry of `below` (n,) is left once that is known: one residual with
        its cost, no derivatives.
        """
        zn, k = self._points(zn), self.dimension + 1
        r, jacobian, z = np.full((len(zn), k), np.nan), np.full((len(zn), k, self.dimension), np.nan), self._begin(zn)
        whole = np.ones(len(zn), dtype=bool)
        for i, lane in self._lanes(zn, below):
            if isinstance(lane, _First):
                whole[i], z[i] = False, lane.z
                r[i], jacobian[i] = np.sqrt(lane.cost), 0.0
                continue
            with suppress(np.linalg.LinAlgError):
                found = self._projected(lane)
                r[i], jacobian[i], z[i] = np.sqrt(k) * found[:, -1], np.sqrt(k) * found[:, :-1], lane.z
        return Rows(r, jacobian, z, whole)

    def sample(self, zn: Any) -> tuple[np.ndarray, np.ndarray]:
        """Costs (n,) of eq. (1) from one Jacobian each, and cube points (n, d): where a search could begin.

        Rounding can make them a little too high, where large contributions cancel, and never too low.
        """
        zn = self._points(zn)
        f, z = np.full(len(zn), np.inf), self._begin(zn)
        for i, lane in self._lanes(zn, np.full(len(zn), -np.inf)):
            assert isinstance(lane, _First)
            f[i], z[i] = lane.cost, lane.z
        return f, z

    def costs(self, zn: Any) -> np.ndarray:
        """Costs (n,) of eq. (1) at coordinates (n, dn)."""
        zn = self._points(zn)
        f = np.full(len(zn), np.inf)
        for i, lane in self._lanes(zn):
            assert isinstance(lane, _Lane)
            p = len(self.solved)
            f[i] = np.sum((lane.root[:, -1] + lane.root[:, :p] @ lane.step) ** 2)
        return f

    def lift(self, zn: Any) -> np.ndarray:
        """Cube points (n, d) with the linear coordinates solved for; where a candidate cannot be simulated, at their
        value nearest 0."""
        zn = self._points(zn)
        z = self._begin(zn)
        for i, lane in self._lanes(zn):
            z[i] = lane.z
        return z

    # -- solving ------------------------------------------------------------------------------------

    @cached_property
    def _shares(self) -> BoxShares:
        return BoxShares.of(self.problem.space, self.solved)

    def _points(self, zn: Any) -> np.ndarray:
        return np.atleast_2d(np.asarray(zn, dtype=float))  # (1, 0) stands for the one point of no coordinates

    def _begin(self, zn: np.ndarray) -> np.ndarray:
        """Cube points with the linear coordinates nearest to 0, where little cancels."""
        z = np.empty((len(zn), self.problem.space.dimension))
        z[:, self.kept], z[:, self.solved] = zn, self._shares.cube(self._shares.nearest_zero)
        return z

    def _lanes(self, zn: np.ndarray, below: np.ndarray | None = None) -> Iterator[tuple[int, _Lane | _First]]:
        """The candidates that can be simulated, with their numbers.

        By the program that everything else about this problem uses too (`points`): another one takes seconds to
        compile.
        """
        width = points.WIDTH if points.shared(self.problem) else 1
        for first in range(0, len(zn), width):
            limits = np.full(len(zn), np.inf) if below is None else below * (1.0 + SURE)
            found = self._solved(self._begin(zn[first : first + width]), limits[first : first + width])
            yield from ((first + i, lane) for i, lane in found)

    def _solved(self, begin: np.ndarray, limits: np.ndarray) -> Iterator[tuple[int, _Lane | _First]]:
        """Solved from the derivatives at `begin` (n, d), and, where the cost is no higher than `limits` (n,), once
        more at the answers, where rounding no longer counts."""
        p, before, lanes = len(self.solved), begin.copy(), {}
        for i, blocks in enumerate(self._evaluated(begin)):
            root = self._root(begin[i], blocks, with_kept=False)
            with suppress(np.linalg.LinAlgError):
                if np.all(np.abs(root) < LARGEST):
                    lane = self._first(begin[i], root)
                    if lane.cost > limits[i]:
                        yield i, lane
                    else:
                        lanes[i], before[i] = lane, lane.z
        if not lanes:
            return
        for i, blocks in enumerate(self._evaluated(before)):
            if i not in lanes:
                continue
            root = self._root(before[i], blocks)
            with suppress(np.linalg.LinAlgError):
                if np.all(np.abs(root) < LARGEST):
                    again = self._polished(root[:, :p], root[:, -1], lanes[i].share)
                    yield (
                        i,
                        _Lane(self._at(before[i], again.s), root, again.free, again.step, before[i], lanes[i].share),
                    )

    def _first(self, begin: np.ndarray, root: np.ndarray) -> _First:
        columns = root[:, :-1]
        share = solve_within(columns, root[:, -1], self._shares.nearest_zero).s
        moved = columns @ (share - self._shares.nearest_zero)
        cost = max(float(np.sum((root[:, -1] + moved) ** 2)), DIGITS**2 * float(np.sum(moved**2)))
        return _First(self._at(begin, share), share, cost)

    def _evaluated(self, z: np.ndarray) -> Iterator[Blocks]:
        """The blocks of residuals and derivatives at points (n, d), at most `points.WIDTH`."""
        if not points.shared(self.problem):
            yield from (self.problem.blocks(a) for a in z)
            return
        every = np.arange(z.shape[1])
        filled = np.concatenate([z, np.repeat(z[:1], points.WIDTH - len(z), axis=0)])
        r, jacobian = points.several(self.problem.compiled["residuals_and_jacobian"])(filled, self.problem.arguments)
        yield from (
            [(a, b, every)] for a, b in zip(np.asarray(r)[: len(z)], np.asarray(jacobian)[: len(z)], strict=True)
        )

    def _at(self, z: np.ndarray, share: np.ndarray) -> np.ndarray:
        """The cube point with other linear coordinates."""
        moved = z.copy()
        moved[self.solved] = self._shares.cube(share)
        return moved

    @staticmethod
    def _polished(columns: np.ndarray, r: np.ndarray, share: np.ndarray) -> Within:
        again = solve_within(columns, r, share)
        if np.all(np.abs(again.step) <= SMALL_STEP):
            return again
        return Within(share, (share > 0.0) & (share < 1.0), np.zeros(len(share)))

    def _root(self, z: np.ndarray, blocks: Blocks, *, with_kept: bool = True) -> np.ndarray:
        """A triangle of [A, J_n, r], or of [A, r]; the sum of squares of its last column is the cost."""
        if len(blocks) == 1 and len(blocks[0][2]) == len(z):
            r, jacobian, own = blocks[0]
            jacobian = jacobian if np.array_equal(own, np.arange(len(z))) else jacobian[:, np.argsort(own)]
        else:
            r, jacobian = compressed(blocks, len(z))
        columns = jacobian[:, self.solved] / self._shares.slope(z[self.solved])
        middle = [jacobian[:, self.kept]] if with_kept else []
        return triangle(np.column_stack([columns, *middle, r])) / np.sqrt(len(r))

    # -- derivatives --------------------------------------------------------------------------------

    def _projected(self, lane: _Lane) -> np.ndarray:
        """[J, r] (dn + 1, dn + 1) of the projected residual; the sum of squares of its last column is the cost."""
        p, dn = len(self.solved), self.dimension
        columns, rest = lane.root[:, :p], lane.root[:, p:].copy()
        rest[:, -1] += columns @ lane.step
        if np.any(lane.free):
            factors = Orthogonal.of(columns[:, lane.free])
            below = factors.below(rest)
            # what the solved ones make up for wholly is rounding, which would send a search anywhere along the valley
            made_up = np.linalg.norm(below[:, :-1], axis=0) <= MADE_UP * np.linalg.norm(rest[:, :-1], axis=0)
            below[:, :-1][:, made_up] = 0.0
            if self.full and factors.rank and dn:
                forced = factors.forced(self._turned(lane))
                below = np.vstack([np.column_stack([forced, np.zeros(len(forced))]), below])
        else:
            below = rest
        found = np.zeros((dn + 1, dn + 1))
        small = triangle(below)
        found[: len(small)] = small
        return found

    def _turned(self, lane: _Lane) -> np.ndarray:
        """dA_j/dn_i' r of every free coordinate j and every kept one i, (free, dn), over the number of residuals."""
        blocks = self.problem.blocks(lane.before)
        base, found = self._products(blocks, blocks), []
        for j in np.flatnonzero(lane.free):
            share = lane.share.copy()
            share[j] = 1.0 if share[j] < 0.5 else 0.0
            there = self._products(self.problem.blocks(self._at(lane.before, share)), blocks)
            found.append((there - base) / (share[j] - lane.share[j]))
        return np.array(found) / sum(len(r) for r, _, _ in blocks)

    def _products(self, blocks: Blocks, residuals: Blocks) -> np.ndarray:
        """J_n' r (dn,) with the derivatives of one and the residuals of the other."""
        total = np.zeros(self.problem.space.dimension)
        for (_, jacobian, own), (r, _, _) in zip(blocks, residuals, strict=True):
            np.add.at(total, own, jacobian.T @ r)
        return total[self.kept]
