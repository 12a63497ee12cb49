"""Division whose derivatives are taken by the quotient, in fewer operations than through powers of the divisor."""

from typing import Any

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.models.parts.tangents import still

# isort: split
import jax
import jax.numpy as jnp


def quotient(a: Any, b: Any) -> Any:
    """q = a/b of numbers or arrays that broadcast, with dq = (da - q db)/b, also in nested derivatives."""
    if not isinstance(a, jax.Array) and not isinstance(b, jax.Array):
        return a / b
    return _quotient(jnp.asarray(a, dtype=float), jnp.asarray(b, dtype=float))


@jax.custom_jvp
def _ruled(a: Any, b: Any) -> Any:
    return a / b


_quotient = jax.jit(_ruled, inline=True)  # numpy arrays under vmap become jax's, which custom rules need


def _moved(primals: Any, tangents: Any) -> Any:
    (a, b), (da, db) = primals, tangents
    q = _quotient(a, b)
    if still(db):
        return q, jnp.zeros_like(q) if still(da) else jnp.broadcast_to(_quotient(da, b), q.shape)
    return q, _quotient(-q * db if still(da) else da - q * db, b)


_ruled.defjvp(_moved, symbolic_zeros=True)
