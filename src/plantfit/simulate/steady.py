"""Steady states: the points where a model comes to rest under constant inputs, with their exact derivatives.

All points of a record are solved at once, elementwise. Newton's method is damped by the natural monotonicity test
(P. Deuflhard, Newton Methods for Nonlinear Problems, Springer 2004, sec. 3.3). Points that it does not bring to rest
are followed in time by implicit Euler steps of growing length (pseudo-transient continuation: C. T. Kelley, D. E.
Keyes, SIAM J. Numer. Anal. 35 (1998) 508) and handed to Newton again. Derivatives come from the implicit function
theorem.
"""

from collections.abc import Mapping
from functools import partial, reduce
from typing import Any

from plantfit.errors import ModelError
from plantfit.runtime import jit
from plantfit.simulate.steps.steppers import factored
from plantfit.simulate.steps.vector import Scalars, VectorModel

import jax
import jax.numpy as jnp

NEWTON_STEPS = 30
TRANSIENT_STEPS = 200
SHARES = tuple(0.5**k for k in range(7))  # of a Newton step, longest first
RELATIVE = 1e-9  # a step so short ends the iteration, which its last step squares once more
ROUNDING = 1e-14  # of the way from the guess, for states at rest at zero
TINY = 1e-300
NUDGE = 0.1


def steady_states(vector: VectorModel, u: Scalars, p: Scalars, guess: Scalars) -> Scalars:
    """The states at rest, rate(x, u, p) = 0, for N constant inputs at once: n arrays (N,).

    `u` holds every channel of the model, each (N,) or a scalar (delayed copies equal their input, see `rest_channels`),
    `p` scalars, `guess` the states to begin from, each (N,) or a scalar. With several points of rest the answer is the
    one Newton's method reaches from the guess, otherwise one where the motion from the guess ends. Points without an
    answer are NaN, also those where the rate leaves a state free (the angle of a motor). Derivatives by `u` and `p` are
    exact in both modes, none flows through `guess`. Raises ModelError for a model whose rate depends on time.
    """
    if vector.rate_uses_time:
        raise ModelError(
            f"Model {vector.model.name!r} never rests, because its rate "
            "depends on the time t; remove t or use records in time."
        )
    if not vector.states:
        return ()
    shape = jnp.broadcast_shapes(*(jnp.shape(v) for v in (*u, *guess)))
    spread = tuple(jnp.broadcast_to(jnp.asarray(v, dtype=float), shape) for v in u)
    begin = tuple(jnp.broadcast_to(jnp.asarray(v, dtype=float), shape) for v in guess)
    values = tuple(jnp.asarray(v, dtype=float) for v in p)
    return _jitted(vector, spread, values, jax.lax.stop_gradient(begin))


def rest_channels(vector: VectorModel, inputs: Mapping[str, Any]) -> Scalars:
    """Every channel at rest from the named inputs (N,): late copies equal their input, time is 0.

    Raises ModelError when an input is missing.
    """
    missing = [name for name in vector.model.inputs if name not in inputs]
    if missing:
        raise ModelError(f"Model {vector.model.name!r} needs input {missing[0]!r} at rest; given are {sorted(inputs)}.")
    late = {delay.channel: delay.input for delay in vector.model.delays}
    zero = jnp.zeros(jnp.broadcast_shapes(*(jnp.shape(inputs[name]) for name in vector.model.inputs)))
    return tuple(
        zero if name == "t" else jnp.asarray(inputs[late.get(name, name)], dtype=float) for name in vector.channels
    )


def steady_outputs(
    vector: VectorModel, p: Scalars, inputs: Mapping[str, Any], guess: Scalars | None = None
) -> dict[str, Any]:
    """Every output at rest by name, each (N,), for the named inputs (N,); NaN where the model does not come to rest.

    `guess` as for `steady_states`, zero when not given.
    """
    u = rest_channels(vector, inputs)
    x = steady_states(vector, u, p, guess or (0.0,) * len(vector.states))
    shape = jnp.broadcast_shapes(*(jnp.shape(v) for v in (*u, *x)))
    return {name: jnp.broadcast_to(y, shape) for name, y in zip(vector.outputs, vector.output(x, u, p), strict=True)}


@partial(jit, static_argnums=0)
def _jitted(vector, u, p, guess):
    return _solved(vector, u, p, guess)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _solved(vector, u, p, guess):
    def attempt(carry, stage):
        found, done = carry
        nudge, in_time = stage
        start = tuple(g + nudge * (1.0 + jnp.abs(g)) for g in guess)
        x, rests = _newton(vector, u, p, start, _followed(vector, u, p, start, done | ~in_time), done)
        found = tuple(jnp.where(rests & ~done, new, old) for new, old in zip(x, found, strict=True))
        return (found, done | rests), None

    nowhere = tuple(jnp.full_like(g, jnp.nan) for g in guess)
    stages = jnp.array([0.0, 0.0, NUDGE, NUDGE]), jnp.array([False, True, False, True])
    return jax.lax.scan(attempt, (nowhere, jnp.zeros(jnp.shape(guess[0]), bool)), stages)[0][0]


@_solved.defjvp
def _(vector, primals, tangents):
    (u, p, guess), (du, dp, _) = primals, tangents
    x = _solved(vector, u, p, guess)
    _, solve = _linearised(vector, x, u, p)
    _, forcing = jax.jvp(lambda u, p: vector.rate(x, u, p), (u, p), (du, dp))
    return x, tuple(-d for d in solve(forcing))


def _linearised(vector, x, u, p, pace=0.0):
    """The Jacobian J of the rates at x, as rows, and a solver for (J - pace) d = b."""
    n = len(x)
    columns = []
    for j in range(n):
        direction = tuple(jnp.ones_like(v) if i == j else jnp.zeros_like(v) for i, v in enumerate(x))
        columns.append(jax.jvp(lambda s: vector.rate(s, u, p), (x,), (direction,))[1])
    matrix = [[columns[j][i] - (pace if i == j else 0.0) for j in range(n)] for i in range(n)]
    solve = factored(matrix)
    # an infinite slope would make a step of zero, which is not rest
    regular = _all([jnp.isfinite(entry) for row in matrix for entry in row])
    return matrix, lambda b: [jnp.where(regular, d, jnp.nan) for d in solve(list(b))]


def _newton(vector, u, p, start, x, skip):
    """Damped Newton from x; the last points and whether each is at rest. `skip` marks points that need no answer."""

    def shortened(x, step, solve):
        """x after the longest share of the step that decreases the level enough, else after the shortest."""
        scale = [jnp.abs(a) + jnp.abs(d) + TINY for a, d in zip(x, step, strict=True)]
        before = _largest(step, scale)

        def tried(share):
            trial = tuple(a + share * d for a, d in zip(x, step, strict=True))
            return trial, _largest(solve(vector.rate(trial, u, p)), scale) < (1.0 - 0.25 * share) * before

        trials, enough = jax.vmap(tried)(jnp.array(SHARES))
        first = jnp.where(jnp.any(enough, axis=0), jnp.argmax(enough, axis=0), len(SHARES) - 1)
        return tuple(jnp.take_along_axis(a, first[None], axis=0)[0] for a in trials)

    def body(carry):
        k, x, rests, lost = carry
        _, solve = _linearised(vector, x, u, p)
        step = [-d for d in solve(vector.rate(x, u, p))]
        near = _all(
            [
                jnp.abs(d) <= RELATIVE * jnp.abs(a) + ROUNDING * jnp.abs(a - b)
                for a, b, d in zip(x, start, step, strict=True)
            ]
        )
        whole = tuple(a + d for a, d in zip(x, step, strict=True))
        following = _where(near, whole, shortened(x, step, solve))
        finite = _all([jnp.isfinite(v) for v in (*following, *vector.rate(following, u, p))])
        x = _where(rests | lost, x, following)
        return k + 1, x, rests | (near & finite & ~lost), lost | ~finite

    def unfinished(carry):
        k, _, rests, lost = carry
        return (k < NEWTON_STEPS) & ~jnp.all(rests | lost)

    _, x, rests, _ = jax.lax.while_loop(unfinished, body, (0, x, jnp.zeros_like(skip), skip))
    return x, rests


def _followed(vector, u, p, x, skip):
    """The motion from x by linearly implicit Euler steps, which double while the rates do not grow."""
    slopes, _ = _linearised(vector, x, u, p)
    fastest = reduce(jnp.maximum, [jnp.abs(slopes[i][i]) for i in range(len(x))])
    fastest = jnp.where(jnp.isfinite(fastest) & (fastest > 0), fastest, 1.0)

    def body(carry):
        k, x, length = carry
        _, solve = _linearised(vector, x, u, p, 1.0 / length)
        step = [-d for d in solve(vector.rate(x, u, p))]
        scale = [jnp.abs(a) + jnp.abs(d) + TINY for a, d in zip(x, step, strict=True)]
        trial = tuple(a + d for a, d in zip(x, step, strict=True))
        # a short step may pass a hump, a long one must not jump over the point of rest
        allowed = 1.0 + 1.0 / (1.0 + (length * fastest) ** 2)
        good = _largest(solve(vector.rate(trial, u, p)), scale) <= allowed * _largest(step, scale)
        return k + 1, _where(good, trial, x), jnp.where(good, 2.0 * length, 0.25 * length)

    def unfinished(carry):
        return (carry[0] < TRANSIENT_STEPS) & ~jnp.all(skip)

    return jax.lax.while_loop(unfinished, body, (0, x, 0.1 / fastest))[1]


def _largest(steps, scale):
    """The largest relative step; NaN when any is."""
    return reduce(jnp.maximum, [jnp.abs(d) / s for d, s in zip(steps, scale, strict=True)])


def _all(conditions):
    return reduce(jnp.logical_and, conditions)


def _where(condition, yes, no):
    return tuple(jnp.where(condition, a, b) for a, b in zip(yes, no, strict=True))
