"""One step by a rational exponential, with derivatives through the solved system.

With Z = h J, the rates f at the start and their change d over the step, the mean rates v solve

    M v = f + d/2 - Z (f + d)/6,   M = I - 2/3 Z + 1/6 Z^2,                                                          (1)

which puts the Pade approximant R(z) = (1 + z/3)/(1 - 2z/3 + z^2/6) in the place of exp z. It is a case of

    M v = r - Z y/6,   r = sum of c_k y_k,   y = sum of e_k y_k.                                                     (2)

Moved by dZ and dy_k, v solves the same system, so that a derivative, forwards or backwards, takes one more solution and
not that of every operation of the first:

    M dv = (dr + dZ s) - Z (dy + dZ v)/6,   M s = (2/3 r - y/6) - Z r/6.                                             (3)
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import plantfit.runtime  # noqa: F401
from plantfit.models.parts.tangents import still
from plantfit.simulate.steps.steppers import (
    Matrix,
    Pattern,
    Rate,
    Scalars,
    dot,
    drift_of,
    factored,
    jacobian_of,
    plus,
    times,
)

import jax
import jax.numpy as jnp

Row = Sequence[Any]
Part = tuple[float, float, Row]
"""The shares c and e of a row y in eq. (2)."""


def exponential(
    rate: Rate, x: Scalars, u0: Scalars, u1: Scalars, h: Any, p: Scalars, varying: bool, pattern: Pattern | None = None
) -> Scalars:
    """Exponential Rosenbrock-Euler step with a rational exponential; one evaluation, L-stable.

    Order 2, and 3 where the rate is linear: x1 = x + (R(Z) - I) J^-1 f with Z = h J and the Pade approximant
    R(z) = (1 + z/3) / (1 - 2z/3 + z^2/6) of exp z, the stability function of Radau IIA. Hochbruck, Ostermann and
    Schweitzer, SIAM J. Numer. Anal. 47 (2009) 786, eq. (2.4), with this R; inputs that change by d = (df/du) (u1 - u0)
    enter as the last column of the Jacobian of the augmented system:
        (I - 2/3 Z + 1/6 Z^2) v = f + d/2 - Z (f + d) / 6,  x1 = x + h v.
    """
    f, jacobian = jacobian_of(rate, x, u0, p, pattern)
    z = [[times(h, a) for a in row] for row in jacobian]
    d = drift_of(rate, x, u0, u1, p)[1] if varying else (0.0,) * len(x)
    v = solution(z, (1.0, 1.0, f), (0.5, 1.0, d))
    return tuple(a + h * b for a, b in zip(x, v, strict=True))


def solution(z: Matrix, *parts: Part) -> list[Any]:
    """v (n,) of eq. (2) for Z (n, n), rows of scalars, and a part (c, e, row) for each y_k; what is the number 0.0
    costs nothing."""
    n = len(z)
    flat = [*(a for row in z for a in row), *(a for _, _, row in parts for a in row)]
    there = tuple(not (isinstance(a, float) and a == 0.0) for a in flat)
    if not any(there[n * n :]):
        return [0.0] * n
    given = (jnp.asarray(a, dtype=float) for a, some in zip(flat, there, strict=True) if some)
    return _ruled(n, tuple(part[:2] for part in parts), there)(*given)


@cache
def _ruled(n: int, shares: Sequence[tuple[float, float]], there: Sequence[bool]) -> Callable[..., list[Any]]:
    """`solution` as a function of those of the entries of Z and the rows that are not 0.0, with the rule of eq. (3)."""

    def rows_of(given: Sequence[Any]) -> tuple[list[list[Any]], list[list[Any]]]:
        left = iter(given)
        flat = [next(left) if some else 0.0 for some in there]
        rows = [flat[n * i : n * (i + 1)] for i in range(n + len(shares))]
        return rows[:n], rows[n:]

    def found(*given: Any) -> list[Any]:
        z, rows = rows_of(given)
        return [jnp.asarray(a, dtype=float) for a in (_of_pair if n == 2 else _of_any)(z, shares, rows)]

    ruled = jax.custom_jvp(found)

    def moved(primals: Any, tangents: Any) -> tuple[list[Any], list[Any]]:
        v = ruled(*primals)
        (z, rows), (dz, along) = rows_of(primals), rows_of([0.0 if still(a) else a for a in tangents])
        c, e = zip(*shares, strict=True)
        solve = (_pair_solver if n == 2 else _solver)(z)
        s = solve([2.0 / 3.0 * a - b / 6.0 for a, b in shares], c, rows)
        r, y = (
            [plus(a, dot(row, b)) for a, row in zip(_summed(w, along), dz, strict=True)] for w, b in ((c, s), (e, v))
        )
        dv = solve((1.0, 0.0), (0.0, 1.0), (r, y))
        return v, [jnp.zeros_like(a) if isinstance(b, float) else b for a, b in zip(v, dv, strict=True)]

    ruled.defjvp(moved, symbolic_zeros=True)
    return jax.jit(ruled, inline=True)


def _summed(shares: Sequence[float], rows: Sequence[Row]) -> list[Any]:
    total: list[Any] = [0.0] * len(rows[0])
    for share, row in zip(shares, rows, strict=True):
        total = [plus(a, b if share == 1.0 else times(share, b)) for a, b in zip(total, row, strict=True)]
    return total


def _of_any(z: Matrix, shares: Sequence[tuple[float, float]], rows: Sequence[Row]) -> list[Any]:
    return _solver(z)(*zip(*shares, strict=True), rows)


def _solver(z: Matrix) -> Callable[..., list[Any]]:
    """v of eq. (2) as a function of c, e and the rows."""
    n = len(z)
    square = [[dot(row, [z[k][j] for k in range(n)]) for j in range(n)] for row in z]
    solve = factored(
        [
            [
                plus(1.0 if i == j else 0.0, plus(times(-2.0 / 3.0, z[i][j]), times(1.0 / 6.0, square[i][j])))
                for j in range(n)
            ]
            for i in range(n)
        ]
    )

    def solved(c: Sequence[float], e: Sequence[float], rows: Sequence[Row]) -> list[Any]:
        y = _summed(e, rows)
        return solve([plus(a, times(-1.0 / 6.0, dot(row, y))) for a, row in zip(_summed(c, rows), z, strict=True)])

    return solved


def _of_pair(z: Matrix, shares: Sequence[tuple[float, float]], rows: Sequence[Row]) -> list[Any]:
    """v for two states, with the fewest operations: what M^-1 makes of c y - e Z y / 6 is a sum of y and Z y."""
    a, b, trace, det = inverse_of_pair(z)
    total: list[Any] = [0.0, 0.0]
    for (c, e), y in zip(shares, rows, strict=True):
        if not _nothing(y):
            own = plus(times(c, a), times(b, plus(times(c, trace), times(-e / 6.0, det))))
            turned = plus(times(c, b), times(e / 6.0, a))
            total = [
                plus(t, plus(times(own, r), times(-1.0, times(turned, dot(row, y)))))
                for t, r, row in zip(total, y, z, strict=True)
            ]
    return total


def _pair_solver(z: Matrix) -> Callable[..., list[Any]]:
    """`_solver` of two states, by M^-1 Z = a Z + b det I: what cancels where M is large is not formed."""
    a, b, trace, det = inverse_of_pair(z)
    own, other, turned = plus(a, times(b, trace)), times(-1.0 / 6.0, times(b, det)), times(1.0 / 6.0, a)

    def solved(c: Sequence[float], e: Sequence[float], rows: Sequence[Row]) -> list[Any]:
        there = [(i, k, y) for i, k, y in zip(c, e, rows, strict=True) if not _nothing(y)]
        if len(there) == 1:  # the same numbers for both states
            ((i, k, y),) = there
            inside, by_z = plus(times(i, own), times(k, other)), plus(times(i, b), times(k, turned))
            return [plus(times(inside, r), times(-1.0, times(by_z, dot(row, y)))) for r, row in zip(y, z, strict=True)]
        r, y = _summed(c, rows), _summed(e, rows)
        inner = [plus(times(b, p), times(turned, q)) for p, q in zip(r, y, strict=True)]
        return [
            plus(plus(times(own, p), times(other, q)), times(-1.0, dot(row, inner)))
            for p, q, row in zip(r, y, z, strict=True)
        ]

    return solved


def _nothing(y: Row) -> bool:
    return all(isinstance(a, float) and a == 0.0 for a in y)


def inverse_of_pair(z: Matrix) -> tuple[Any, Any, Any, Any]:
    """(a, b, trace, det) with M^-1 = (a + b trace) I - b Z: by Z^2 = trace Z - det I, M is a sum of I and Z."""
    trace = plus(z[0][0], z[1][1])
    det = plus(times(z[0][0], z[1][1]), times(-1.0, times(z[0][1], z[1][0])))
    a, b = plus(1.0, times(-1.0 / 6.0, det)), plus(-2.0 / 3.0, times(1.0 / 6.0, trace))
    # a^2 + a b trace + b^2 det, without the terms that cancel
    inverse = 1.0 / plus(times(a, a), times(b, plus(trace, times(-2.0 / 3.0, det))))
    return a * inverse, b * inverse, trace, det
