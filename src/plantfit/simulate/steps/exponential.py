"""One step by a rational exponential, with derivatives through the solved system.

With Z = h J, the rates f at the start and their change d over the step, the mean rates v solve

    M v = f + d/2 - Z (f + d)/6,   M = I - 2/3 Z + 1/6 Z^2,                                                          (1)

which puts the Pade approximant R(z) = (1 + z/3)/(1 - 2z/3 + z^2/6) in the place of exp z. Moved by dZ, df and dd, it solves

    M dv = df + dd/2 + dZ s - Z y/6,   y = df + dd + dZ v,   M s = f/2 + d/6 - Z (f + d/2)/6,                         (2)

so that a derivative, forwards or backwards, takes one more solution and not that of every operation of the first.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.models.parts.tangents import still
from plantfit.simulate.steps.steppers import Matrix, Pattern, Rate, Scalars, dot, drift_of, factored, jacobian_of, plus, times

import jax
import jax.numpy as jnp

Row = Sequence[Any]


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
    v = mean_rates(z, f, d)
    return tuple(a + h * b for a, b in zip(x, v, strict=True))


def mean_rates(z: Matrix, f: Row, d: Row) -> list[Any]:
    """v (n,) of eq. (1) for Z (n, n), f and d (n,), rows of scalars; entries that are the number 0.0 cost nothing."""
    n = len(f)
    flat = [*(a for row in z for a in row), *f, *d]
    there = tuple(not (isinstance(a, float) and a == 0.0) for a in flat)
    if n == 0 or not any(there):
        return [0.0] * n
    return _ruled(n, there)(*(jnp.asarray(a, dtype=float) for a, some in zip(flat, there, strict=True) if some))


@cache
def _ruled(n: int, there: tuple[bool, ...]) -> Callable[..., list[Any]]:
    """v as a function of those of the entries of Z, f and d that are not 0.0."""

    def parts(given: Sequence[Any]) -> tuple[list[list[Any]], list[Any], list[Any]]:
        left = iter(given)
        flat = [next(left) if some else 0.0 for some in there]
        return [flat[n * i : n * (i + 1)] for i in range(n)], flat[n * n : n * n + n], flat[n * n + n :]

    def found(*given: Any) -> list[Any]:
        return [jnp.asarray(a, dtype=float) for a in (_pair if n == 2 else _any)(*parts(given))]

    ruled = jax.custom_jvp(found)

    def moved(primals: Any, tangents: Any) -> tuple[list[Any], list[Any]]:
        v = ruled(*primals)
        (z, f, d), (dz, df, dd) = parts(primals), parts([0.0 if still(a) else a for a in tangents])
        solution = (_pair_solved if n == 2 else _solved)(z)
        s = [plus(a, b) for a, b in zip(solution.of(0.5, 1.0, f), solution.of(1.0 / 6.0, 0.5, d), strict=True)]
        y = [plus(plus(b, c), dot(row, v)) for b, c, row in zip(df, dd, dz, strict=True)]
        r = [plus(plus(b, times(0.5, c)), dot(by, s)) for b, c, by in zip(df, dd, dz, strict=True)]
        dv = solution.between(r, y)
        return v, [jnp.zeros_like(a) if isinstance(b, float) else b for a, b in zip(v, dv, strict=True)]

    ruled.defjvp(moved, symbolic_zeros=True)
    return jax.jit(ruled, inline=True)


def _any(z: Matrix, f: Row, d: Row) -> list[Any]:
    moved = [plus(a, b) for a, b in zip(f, d, strict=True)]
    return _solved(z).between([plus(a, times(0.5, b)) for a, b in zip(f, d, strict=True)], moved)


class _Solution(NamedTuple):
    """What M^-1 makes of r - Z y / 6 for two rows, and of c y - e Z y / 6 for two numbers and a row."""

    between: Callable[[Row, Row], list[Any]]
    of: Callable[[float, float, Row], list[Any]]


def _solved(z: Matrix) -> _Solution:
    solve = factored(_matrix(z))

    def between(r: Row, y: Row) -> list[Any]:
        return solve([plus(a, times(-1.0 / 6.0, dot(row, y))) for a, row in zip(r, z, strict=True)])

    def of(c: float, e: float, y: Row) -> list[Any]:
        return (
            [0.0] * len(y) if _nothing(y) else solve([plus(times(c, a), times(-e / 6.0, dot(row, y))) for a, row in zip(y, z, strict=True)])
        )

    return _Solution(between, of)


def _pair_solved(z: Matrix) -> _Solution:
    """That of two states, by M^-1 Z = a Z + b det I: what cancels where M is large is not formed."""
    a, b, trace, det = _inverse_of_pair(z)
    own, other, turned = plus(a, times(b, trace)), times(-1.0 / 6.0, times(b, det)), times(1.0 / 6.0, a)

    def between(r: Row, y: Row) -> list[Any]:
        inner = [plus(times(b, c), times(turned, e)) for c, e in zip(r, y, strict=True)]
        return [plus(plus(times(own, c), times(other, e)), times(-1.0, dot(row, inner))) for c, e, row in zip(r, y, z, strict=True)]

    def of(c: float, e: float, y: Row) -> list[Any]:
        if _nothing(y):
            return [0.0, 0.0]
        inside, by_z = plus(times(c, own), times(e, other)), plus(times(c, b), times(e, turned))
        return [plus(times(inside, a), times(-1.0, times(by_z, dot(row, y)))) for a, row in zip(y, z, strict=True)]

    return _Solution(between, of)


def _nothing(y: Row) -> bool:
    return all(isinstance(a, float) and a == 0.0 for a in y)


def _matrix(z: Matrix) -> list[list[Any]]:
    """M of eq. (1)."""
    n = len(z)
    square = [[dot(row, [z[k][j] for k in range(n)]) for j in range(n)] for row in z]
    return [
        [plus(1.0 if i == j else 0.0, plus(times(-2.0 / 3.0, z[i][j]), times(1.0 / 6.0, square[i][j]))) for j in range(n)] for i in range(n)
    ]


def _pair(z: Matrix, f: Row, d: Row) -> list[Any]:
    """v for two states: what M^-1 makes of c y - Z y / 6 is a sum of y and Z y."""
    a, b, trace, det = _inverse_of_pair(z)

    def solved(c: float, y: Row) -> list[Any]:
        if _nothing(y):
            return [0.0, 0.0]
        own = plus(times(c, a), times(b, plus(times(c, trace), times(-1.0 / 6.0, det))))
        turned = plus(times(c, b), times(1.0 / 6.0, a))
        return [plus(times(own, r), times(-1.0, times(turned, dot(row, y)))) for row, r in zip(z, y, strict=True)]

    return [plus(s, t) for s, t in zip(solved(1.0, f), solved(0.5, d), strict=True)]


def _inverse_of_pair(z: Matrix) -> tuple[Any, Any, Any, Any]:
    """(a, b, trace, det) with M^-1 = (a + b trace) I - b Z: by Z^2 = trace Z - det I, M is a sum of I and Z."""
    trace = plus(z[0][0], z[1][1])
    det = plus(times(z[0][0], z[1][1]), times(-1.0, times(z[0][1], z[1][0])))
    a, b = plus(1.0, times(-1.0 / 6.0, det)), plus(-2.0 / 3.0, times(1.0 / 6.0, trace))
    # a^2 + a b trace + b^2 det, without the terms that cancel
    inverse = 1.0 / plus(times(a, a), times(b, plus(trace, times(-2.0 / 3.0, det))))
    return a * inverse, b * inverse, trace, det
