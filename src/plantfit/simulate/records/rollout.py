"""All steps of a record, with derivatives in which only an n-vector recursion is sequential.

The Jacobians of all steps are computed at once, the tangent of every step likewise, and a small
linear scan joins them; backwards it is the adjoint recursion. A gradient then costs a few plain
evaluations instead of the twenty of `jax.grad` through a scan.
"""

from collections.abc import Callable

import plantfit.runtime  # noqa: F401
from plantfit.native import native_scan

import jax
import jax.numpy as jnp


def make_rollout(step: Callable, values: Callable | None = None, *, reverse: bool = False) -> Callable:
    """`rollout(p, x0, z)` for a `step(p, x, z_k) -> x` on tuples of scalars.

    `p` is a pytree, `x0` a tuple of n scalars, `z` a pytree of arrays with leading axis K (what
    changes from step to step); returns a tuple of n arrays (K,), the states after all steps.
    Records and candidates are batched by vmap.
    Differentiable forwards (and from there backwards); with `reverse` only backwards, in less time. `values` is the same step for where
    no derivatives are taken.
    """
    return _reverse(step, values or step) if reverse else _forward(step, values or step)


def _scan(step, p, x0, z):
    def body(x, zk):
        x1 = step(p, x, zk)
        return x1, x1

    return native_scan(body, x0, z, keep=True, fallback=True)[1]


def _before(x0, states):
    return tuple(jnp.concatenate([a[None], s])[:-1] for a, s in zip(x0, states, strict=True))


def _columns(all_steps, before):
    """Jacobians of all steps: [j][i] is d(state i after)/d(state j before), (K, ...)."""
    columns = []
    for j in range(len(before)):

        def moved(a, j=j):
            return all_steps((*before[:j], a, *before[j + 1 :]))

        columns.append(jax.jvp(moved, (before[j],), (jnp.ones_like(before[j]),))[1])
    return tuple(columns)


def _forward(step, values):
    all_steps = jax.vmap(step, in_axes=(None, 0, 0))

    @jax.custom_jvp
    def rollout(p, x0, z):
        return _scan(values, p, x0, z)

    @rollout.defjvp
    def _(primals, tangents):
        p, x0, z = primals
        dp, dx0, dz = tangents
        states = rollout(p, x0, z)
        before = _before(x0, states)
        n = len(states)
        columns = _columns(lambda x: all_steps(p, x, z), before)
        _, forcing = jax.jvp(lambda p, z: all_steps(p, before, z), (p, z), (dp, dz))

        def body(d, row):
            a, b = row
            d1 = tuple(sum((a[j][i] * d[j] for j in range(n)), b[i]) for i in range(n))
            return d1, d1

        # batched over the directions of forward mode, it also has to be transposable
        return states, jax.lax.scan(body, dx0, (columns, forcing))[1]

    return rollout


def _reverse(step, values):
    all_steps = jax.vmap(step, in_axes=(None, 0, 0))

    @jax.custom_vjp
    def rollout(p, x0, z):
        return _scan(values, p, x0, z)

    def forwards(p, x0, z):
        states = _scan(values, p, x0, z)
        return states, (p, x0, z, states)

    def backwards(saved, cotangents):
        p, x0, z, states = saved
        before = _before(x0, states)
        n = len(states)
        columns = _columns(lambda x: all_steps(p, x, z), before)

        def body(carried, row):
            given, a = row
            adjoint = tuple(g + c for g, c in zip(given, carried, strict=True))
            earlier = tuple(sum((a[j][i] * adjoint[i] for i in range(1, n)), a[j][0] * adjoint[0]) for j in range(n))
            return earlier, adjoint

        nothing = tuple(jnp.zeros_like(a) for a in x0)
        dx0, adjoints = native_scan(body, nothing, (cotangents, columns), keep=True, reverse=True, fallback=True)
        _, pull = jax.vjp(lambda p, z: all_steps(p, before, z), p, z)
        dp, dz = pull(adjoints)
        return dp, dx0, dz

    rollout.defvjp(forwards, backwards)
    return rollout
