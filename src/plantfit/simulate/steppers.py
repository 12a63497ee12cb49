"""One step of an ordinary differential equation, on tuples of scalars.

Every stepper has the signature `step(rate, x, u0, u1, h, p, varying) -> x` where `u0`, `u1` are the
inputs at both ends of the step (linear between), `h` its length in seconds, possibly 0, and
`varying` tells whether any input changes inside a step.
"""

import math

import plantfit.runtime  # noqa: F401

import jax
import jax.numpy as jnp

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)


def rosenbrock(rate, x, u0, u1, h, p, varying):
    """Two-stage, second-order, L-stable Rosenbrock method ROS2.

    Verwer, Spee, Blom, Hundsdorfer, SIAM J. Sci. Comput. 20 (1999) 1456, eq. (2.9), gamma = 1 - 1/sqrt 2,
    with the exact Jacobian; the term gamma h df/dt is gamma (df/du) (u1 - u0), safe at h = 0.
    """
    n = len(x)
    columns, f0 = [], None
    for j in range(n):
        direction = tuple(jnp.ones_like(x[i]) if i == j else jnp.zeros_like(x[i]) for i in range(n))
        f0, column = jax.jvp(lambda s: rate(s, u0, p), (x,), (direction,))
        columns.append(column)
    f0 = rate(x, u0, p) if f0 is None else f0
    matrix = [[(1.0 if i == j else 0.0) - GAMMA * h * columns[j][i] for j in range(n)] for i in range(n)]
    solve = _factored(matrix)
    if varying:
        change = tuple(b - a for a, b in zip(u0, u1, strict=True))
        _, drift = jax.jvp(lambda u: rate(x, u, p), (u0,), (change,))
        drift = tuple(GAMMA * d for d in drift)
    else:
        drift = (0.0,) * n
    k1 = solve([a + b for a, b in zip(f0, drift, strict=True)])
    f1 = rate(tuple(a + h * k for a, k in zip(x, k1, strict=True)), u1 if varying else u0, p)
    k2 = solve([f - 2.0 * k - d for f, k, d in zip(f1, k1, drift, strict=True)])
    return tuple(a + h * (1.5 * b + 0.5 * c) for a, b, c in zip(x, k1, k2, strict=True))


def rk4(rate, x, u0, u1, h, p, varying):
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


STEPPERS = {"rosenbrock": rosenbrock, "rk4": rk4}
ORDER = {"rosenbrock": 2, "rk4": 4}


def _factored(m):
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
        inverse = 1.0 / (m[0][0] * m[1][1] - m[0][1] * m[1][0])
        return lambda b: [
            (m[1][1] * b[0] - m[0][1] * b[1]) * inverse,
            (m[0][0] * b[1] - m[1][0] * b[0]) * inverse,
        ]
    return _eliminated([list(row) for row in m])


def _eliminated(a):
    n = len(a)
    record = []  # (column, row, swapped?) and multipliers, to be repeated on right-hand sides
    for c in range(n):
        for r in range(c + 1, n):
            swap = jnp.abs(a[r][c]) > jnp.abs(a[c][c])
            upper = [jnp.where(swap, y, x) for x, y in zip(a[c], a[r], strict=True)]
            lower = [jnp.where(swap, x, y) for x, y in zip(a[c], a[r], strict=True)]
            factor = lower[c] / upper[c]
            a[c], a[r] = upper, [y - factor * x for x, y in zip(upper, lower, strict=True)]
            record.append((c, r, swap, factor))

    def solve(b):
        b = list(b)
        for c, r, swap, factor in record:
            top, bottom = jnp.where(swap, b[r], b[c]), jnp.where(swap, b[c], b[r])
            b[c], b[r] = top, bottom - factor * top
        for i in reversed(range(n)):
            for j in range(i + 1, n):
                b[i] = b[i] - a[i][j] * b[j]
            b[i] = b[i] / a[i][i]
        return b

    return solve
