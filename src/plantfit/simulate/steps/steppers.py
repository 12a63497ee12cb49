"""One step of an ordinary differential equation, on tuples of scalars.

Every stepper has the signature `step(rate, x, u0, u1, h, p, varying, pattern) -> x` where `u0`, `u1`
are the inputs at both ends of the step (linear between), `h` its length in seconds, possibly 0,
`varying` tells whether any input changes inside a step and `pattern` which entries of the Jacobian
can differ from zero (None: all). `registry.py` lists them.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import plantfit.runtime  # noqa: F401
from plantfit.models.parts.tables import shared_lookups

import jax
import jax.numpy as jnp

Scalars = tuple[Any, ...]
"""One traced or plain number for each state, input or parameter."""
Rate = Callable[[Scalars, Scalars, Scalars], Scalars]
"""f(x, u, p), the rates of the states."""
Matrix = Sequence[Sequence[Any]]
Pattern = Sequence[Sequence[bool]]
GAMMA = 1.0 - 1.0 / math.sqrt(2.0)


def rosenbrock(
    rate: Rate, x: Scalars, u0: Scalars, u1: Scalars, h: Any, p: Scalars, varying: bool, pattern: Pattern | None = None
) -> Scalars:
    """Two-stage, second-order, L-stable Rosenbrock method ROS2.

    Verwer, Spee, Blom, Hundsdorfer, SIAM J. Sci. Comput. 20 (1999) 1456, eq. (2.9), gamma = 1 - 1/sqrt 2,
    with the exact Jacobian; the term gamma h df/dt is gamma (df/du) (u1 - u0), safe at h = 0.
    """
    n = len(x)
    f0, jacobian = jacobian_of(rate, x, u0, p, pattern)
    matrix = [[plus(1.0 if i == j else 0.0, times(-GAMMA * h, jacobian[i][j])) for j in range(n)] for i in range(n)]
    solve = factored(matrix)
    drift = tuple(GAMMA * d for d in drift_of(rate, x, u0, u1, p)[1]) if varying else (0.0,) * n
    k1 = solve([a + b for a, b in zip(f0, drift, strict=True)])
    f1 = rate(tuple(a + h * k for a, k in zip(x, k1, strict=True)), u1 if varying else u0, p)
    k2 = solve([f - 2.0 * k - d for f, k, d in zip(f1, k1, drift, strict=True)])
    return tuple(a + h * (1.5 * b + 0.5 * c) for a, b, c in zip(x, k1, k2, strict=True))


def jacobian_of(rate: Rate, x: Scalars, u: Scalars, p: Scalars, pattern: Pattern | None) -> tuple[Scalars, Matrix]:
    """f (n,) and df/dx [i][j]; entries that the pattern rules out are the number 0.0, so that nothing is computed
    for them."""
    n = len(x)
    columns, f = [], None
    with shared_lookups(slopes=True):
        for j in range(n):
            found, column = jax.jvp(
                lambda a, j=j: rate((*x[:j], a, *x[j + 1 :]), u, p), (x[j],), (jnp.ones_like(x[j]),)
            )
            columns.append(column)
            f = found if f is None else f  # backwards all go through one evaluation as far as they can
        f = rate(x, u, p) if f is None else f
    return f, [[columns[j][i] if pattern is None or pattern[i][j] else 0.0 for j in range(n)] for i in range(n)]


def drift_of(rate: Rate, x: Scalars, u0: Scalars, u1: Scalars, p: Scalars) -> tuple[Scalars, Scalars]:
    """f and its change by the inputs over the step, (df/du) (u1 - u0)."""
    return jax.jvp(lambda u: rate(x, u, p), (u0,), (tuple(b - a for a, b in zip(u0, u1, strict=True)),))


# numbers that are known to be zero stay Python floats and cost nothing
def _zero(a) -> bool:
    return isinstance(a, float) and a == 0.0


def times(a: Any, b: Any) -> Any:
    return 0.0 if _zero(a) or _zero(b) else a * b


def plus(a: Any, b: Any) -> Any:
    return b if _zero(a) else a if _zero(b) else a + b


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    total: Any = 0.0
    for s, t in zip(a, b, strict=True):
        total = plus(total, times(s, t))
    return total


def rk4(
    rate: Rate, x: Scalars, u0: Scalars, u1: Scalars, h: Any, p: Scalars, varying: bool, pattern: Pattern | None = None
) -> Scalars:
    """The classical fourth-order Runge-Kutta method (Kutta 1901); for plants that are not stiff."""
    middle = tuple(0.5 * (a + b) for a, b in zip(u0, u1, strict=True)) if varying else u0
    end = u1 if varying else u0

    def moved(k, c):
        return tuple(a + c * h * b for a, b in zip(x, k, strict=True))

    k1 = rate(x, u0, p)
    k2 = rate(moved(k1, 0.5), middle, p)
    k3 = rate(moved(k2, 0.5), middle, p)
    k4 = rate(moved(k3, 1.0), end, p)
    return tuple(a + h / 6.0 * (b + 2.0 * c + 2.0 * d + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True))


def factored(m: Matrix) -> Callable[[Sequence[Any]], list[Any]]:
    """A solver for the small matrix `m` (rows of scalars): closed form to size 2, else elimination.

    With pivoting by rows, as selections rather than branches, so that a batch stays one program.
    """
    n = len(m)
    if n == 0:
        return lambda b: []
    if n == 1:
        inverse = 1.0 / m[0][0]
        return lambda b: [b[0] * inverse]
    if n == 2:
        inverse = 1.0 / plus(times(m[0][0], m[1][1]), times(-1.0, times(m[0][1], m[1][0])))
        return lambda b: [
            plus(times(m[1][1], b[0]), times(-1.0, times(m[0][1], b[1]))) * inverse,
            plus(times(m[0][0], b[1]), times(-1.0, times(m[1][0], b[0]))) * inverse,
        ]
    return _eliminated([list(row) for row in m])


def _eliminated(a):
    n = len(a)
    record = []  # (column, row, swapped?) and multipliers, to be repeated on right-hand sides
    for c in range(n):
        for r in range(c + 1, n):
            if _zero(a[r][c]):
                continue
            swap = jnp.abs(a[r][c]) > jnp.abs(a[c][c])
            upper = [jnp.where(swap, y, x) for x, y in zip(a[c], a[r], strict=True)]
            lower = [jnp.where(swap, x, y) for x, y in zip(a[c], a[r], strict=True)]
            factor = lower[c] / upper[c]
            a[c], a[r] = upper, [plus(y, times(-1.0, times(factor, x))) for x, y in zip(upper, lower, strict=True)]
            record.append((c, r, swap, factor))

    def solve(b):
        b = list(b)
        for c, r, swap, factor in record:
            top, bottom = jnp.where(swap, b[r], b[c]), jnp.where(swap, b[c], b[r])
            b[c], b[r] = top, bottom - factor * top
        for i in reversed(range(n)):
            for j in range(i + 1, n):
                b[i] = plus(b[i], times(-1.0, times(a[i][j], b[j])))
            b[i] = b[i] / a[i][i]
        return b

    return solve
