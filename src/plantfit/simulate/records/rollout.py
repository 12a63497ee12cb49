"""All steps of a record, with derivatives in which only an n-vector recursion is sequential.

The Jacobians of all steps are computed at once, the tangent of every step likewise, and a small
linear scan joins them; backwards it is the adjoint recursion. A gradient then costs a few plain
evaluations instead of the twenty of `jax.grad` through a scan.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.native import native_scan

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero


def make_rollout(
    step: Callable, values: Callable | None = None, *, reverse: bool = False, forwards: bool = False
) -> Callable:
    """`rollout(p, x0, z)` for a `step(p, x, z_k) -> x` on tuples of scalars.

    `p` is a pytree, `x0` a tuple of n scalars, `z` a pytree of arrays with leading axis K (what
    changes from step to step); returns a tuple of n arrays (K,), the states after all steps.
    Records and candidates are batched by vmap.
    Differentiable forwards (and from there backwards); with `reverse` only backwards and with `forwards` only forwards,
    in less time. `values` is the same step for where no derivatives are taken.
    """
    make = _reverse if reverse else _only_forwards if forwards else _forward
    return make(step, values or step)


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


def _only_forwards(step, values):
    @jax.custom_jvp
    def rollout(p, x0, z):
        return _scan(values, p, x0, z)

    @partial(rollout.defjvp, symbolic_zeros=True)
    def _(primals, tangents):
        (p, x0, z), (dp, dx0, dz) = primals, tangents
        states = rollout(p, x0, z)
        moving, rows = _moved((p, dp)), _moved((z, dz))

        def body(d, row):
            # the step itself is the same in all directions, so it is computed once for all lanes of a vector
            x, zk, dzk = row
            _, later = jax.jvp(
                lambda q, x, r: step(moving.joined(q), x, rows.joined(r, zk)),
                (moving.values, x, rows.of(zk)),
                (moving.tangents, d, dzk),
            )
            return later, later

        begin = tuple(jnp.zeros_like(a) if _still(t) else t for a, t in zip(x0, dx0, strict=True))
        return states, native_scan(body, begin, (_before(x0, states), z, rows.tangents), keep=True, fallback=True)[1]

    return rollout


class _Moved(NamedTuple):
    """The leaves of a pytree that have tangents, `values` and `tangents`."""

    leaves: list
    tree: Any
    moving: list[bool]
    tangents: list

    @property
    def values(self):
        return self.of_leaves(self.leaves)

    def of_leaves(self, leaves):
        return [a for a, moves in zip(leaves, self.moving, strict=True) if moves]

    def of(self, thing):
        return self.of_leaves(jax.tree.leaves(thing))

    def joined(self, values, still=None):
        """The pytree with other values of what moves."""
        given, leaves = iter(values), self.leaves if still is None else jax.tree.leaves(still)
        return jax.tree.unflatten(
            self.tree, [next(given) if moves else a for a, moves in zip(leaves, self.moving, strict=True)]
        )


def _still(tangent):
    return isinstance(tangent, SymbolicZero)


def _moved(pair):
    leaves, tree = jax.tree.flatten(pair[0])
    tangents = jax.tree.leaves(pair[1], is_leaf=_still)
    moving = [not _still(t) and jnp.issubdtype(a.dtype, jnp.floating) for a, t in zip(leaves, tangents, strict=True)]
    return _Moved(leaves, tree, moving, [t for t, moves in zip(tangents, moving, strict=True) if moves])


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
