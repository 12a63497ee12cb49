"""All steps of a record, with derivatives in which only an n-vector recursion is sequential.

One rule serves forward and reverse mode: the Jacobians of all steps are computed at once, the
tangent of every step likewise, and a small linear scan joins them; jax transposes that scan into
the adjoint recursion. A gradient then costs a few plain evaluations instead of the twenty of
`jax.grad` through a scan.
"""

from collections.abc import Callable

import plantfit.runtime  # noqa: F401

import jax
import jax.numpy as jnp


def make_rollout(step: Callable, unroll: int = 1) -> Callable:
    """`rollout(p, x0, z)` for a `step(p, x, z_k) -> x` on tuples of scalars.

    `p` and `x0` are tuples of scalars, `z` a pytree of arrays with leading axis K (what changes
    from step to step); returns a tuple of n arrays (K + 1,), the states before and after all steps.
    """

    @jax.custom_jvp
    def rollout(p, x0, z):
        def body(x, zk):
            x1 = step(p, x, zk)
            return x1, x1

        _, later = jax.lax.scan(body, x0, z, unroll=unroll)
        return tuple(jnp.concatenate([jnp.reshape(a, (1,)), b]) for a, b in zip(x0, later, strict=True))

    @rollout.defjvp
    def _(primals, tangents):
        p, x0, z = primals
        dp, dx0, dz = tangents
        states = rollout(p, x0, z)
        before = tuple(s[:-1] for s in states)
        n = len(states)
        all_steps = jax.vmap(step, in_axes=(None, 0, 0))
        columns = []
        for j in range(n):
            direction = tuple(jnp.ones_like(s) if i == j else jnp.zeros_like(s) for i, s in enumerate(before))
            columns.append(jax.jvp(lambda x: all_steps(p, x, z), (before,), (direction,))[1])
        _, forcing = jax.jvp(lambda p, z: all_steps(p, before, z), (p, z), (dp, dz))

        def body(d, row):
            a, b = row
            d1 = tuple(sum((a[j][i] * d[j] for j in range(n)), b[i]) for i in range(n))
            return d1, d1

        _, later = jax.lax.scan(body, dx0, (tuple(columns), forcing), unroll=unroll)
        return states, tuple(jnp.concatenate([jnp.reshape(a, (1,)), b]) for a, b in zip(dx0, later, strict=True))

    return rollout
