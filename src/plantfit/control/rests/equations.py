"""A model's rates and one output at a level, solved for states and input by a damped Newton's method."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from plantfit.runtime import jit
from plantfit.simulate.steps.vector import VectorModel

import jax
import jax.numpy as jnp

ROUNDS, FACTORS = 60, (1.0, 0.5, 0.2, 0.05)
FAR = 100.0  # times a start: what is left of the equations is small beside this at most


@dataclass(frozen=True)
class Equations:
    """A model's rates and one output, of states and of the value that each way of the input has; `held` are all
    other channels. States other than the `kept` reach no output that is measured; they stay where they are in a
    search for a rest."""

    vector: VectorModel
    ways: tuple[int, ...]
    held: tuple[float, ...]
    output: int
    kept: tuple[int, ...] = ()

    def channels(self, ways: Any) -> tuple[Any, ...]:
        values: list[Any] = list(self.held)
        for k, place in enumerate(self.ways):
            values[place] = ways[k]
        return tuple(values)

    def rate(self, x: Any, ways: Any, p: Any) -> Any:
        return jnp.stack(self.vector.rate(tuple(x), self.channels(ways), p))

    def out(self, x: Any, ways: Any, p: Any) -> Any:
        return self.vector.output(tuple(x), self.channels(ways), p)[self.output]


@partial(jit, static_argnums=0)
def solved(key: Equations, begin: Any, level: Any, rows: Any) -> Any:
    """States and input (starts, n, s + 1) at rest where the output is `level`, and what is left of the equations
    (starts, n), from starts (starts, s + 1)."""
    ways, n = len(key.ways), len(key.vector.states)

    kept = np.isin(np.arange(n), key.kept)

    def one(z, p):
        first = z[:n]

        def equations(z, p):
            x, u = z[:n], jnp.full(ways, z[n])
            rate = key.rate(x, u, p)
            return jnp.append(rate if np.all(kept) else jnp.where(kept, rate, x - first), key.out(x, u, p) - level)

        size = jnp.maximum(jnp.linalg.norm(jax.jacfwd(equations)(z, p), axis=1), 1e-300)

        def left(z):
            return jnp.linalg.norm(equations(z, p) / size)

        def step(z, _):
            move = jnp.linalg.lstsq(jax.jacfwd(equations)(z, p) / size[:, None], equations(z, p) / size)[0]
            tried = jnp.stack([z - f * move for f in FACTORS] + [z])
            return tried[jnp.nanargmin(jax.vmap(left)(tried))], None

        # far away, in a saturation, everything is small beside z; that is no rest
        largest = FAR * (jnp.linalg.norm(z) + jnp.abs(level))
        z = jax.lax.scan(step, z, None, length=ROUNDS)[0]
        return z, left(z) / (1.0 + jnp.minimum(jnp.linalg.norm(z), largest))

    return jax.vmap(jax.vmap(one, (None, 0)), (0, None))(begin, rows)
