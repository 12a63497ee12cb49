"""One segment as pure functions of its local coordinates and its initial states."""

from dataclasses import dataclass

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.problem.shooting.segments import Segments

import jax
import jax.numpy as jnp

INVERSIONS = 8  # Newton steps from measured outputs to states


@dataclass(frozen=True)
class Local:
    """Pure functions of one segment: local coordinates (q,), initial states (n,) in their units."""

    problem: Problem
    factor: tuple[float, ...]  # per output: from its unit to residuals whose squares add up to the merit

    def _parameters(self, z):
        space = self.problem.space.of_one_recording()
        return space.tree(space.physical(z))

    def initial(self, z: jax.Array, segment: Segments) -> jax.Array:
        """What the model gives at the first sample of the record (n,)."""
        drive = segment.drive
        return jnp.stack(
            self.problem.predictor.stepping().initial(self._parameters(z), drive.first_input, drive.first_output)
        )

    def _run(self, z, s, segment: Segments):
        simulator, p = self.problem.predictor.stepping(), self._parameters(z)
        x0 = jnp.where(segment.first, self.initial(z, segment), s)
        x = simulator.states(p, segment.drive, tuple(x0), forwards=True)
        y = jax.vmap(simulator.vector.output, in_axes=(0, 0, None))(
            x, simulator.channels(p, segment.drive), simulator.positional(p)
        )
        return x, y

    def simulated(self, z: jax.Array, s: jax.Array, segment: Segments) -> jax.Array:
        """States (n, T)."""
        return jnp.stack(self._run(z, s, segment)[0])

    def linearised(self, z: jax.Array, s: jax.Array, segment: Segments) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Rows (k, q + n + 1) as in `Linear`, final states (n,) and their derivatives (n, q + n)."""
        q = z.shape[0]

        def values(v):
            x, y = self._run(v[:q], v[q:], segment)
            parts = [
                jnp.where(scored, f * (a - m), 0.0)
                for a, m, scored, f in zip(y, segment.measured, segment.scored, self.factor, strict=True)
            ]
            result = jnp.concatenate(parts), jnp.stack([a[-1] for a in x])
            return result, result

        (by_v, end_by_v), (r, end) = jax.jacfwd(values, has_aux=True)(jnp.concatenate([z, s]))
        return jnp.linalg.qr(jnp.concatenate([by_v, r[:, None]], axis=1), mode="r"), end, end_by_v

    def inverted(self, z: jax.Array, s: jax.Array, segment: Segments) -> jax.Array:
        """States (n,) near `s` whose outputs are those measured at the first scored samples: Newton steps of least
        length."""
        simulator, p = self.problem.predictor.stepping(), self._parameters(z)
        at = jnp.stack([jnp.argmax(scored) for scored in segment.scored])
        known = jnp.stack([jnp.any(scored) for scored in segment.scored])
        wanted = jnp.stack([m[i] for m, i in zip(segment.measured, at, strict=True)])
        u = tuple(c[at[0]] for c in simulator.channels(p, segment.drive))
        factor = jnp.asarray(self.factor)

        def miss(x):
            y = jnp.stack(simulator.vector.output(tuple(x), u, simulator.positional(p)))
            return jnp.where(known, (y - wanted) * factor, 0.0)

        def newton(x, _):
            slope = jnp.where(known[:, None], jax.jacfwd(miss)(x), 0.0)
            return x - jnp.linalg.pinv(slope, rtol=1e-8) @ miss(x), None

        found, _ = jax.lax.scan(newton, s, None, length=INVERSIONS)
        better = jnp.sum(miss(found) ** 2) < jnp.sum(miss(s) ** 2)
        return jnp.where(better, found, s)
