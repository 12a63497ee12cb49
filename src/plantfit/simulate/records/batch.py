"""Costs, residuals and derivatives of many records at once, in one compiled loop over chunks of steps.

When only the cost is asked, the residual is accumulated inside the loop and no trajectory is kept.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import plantfit.runtime  # noqa: F401
from plantfit.simulate.records.rollout import make_rollout
from plantfit.simulate.records.schedule import Chunks
from plantfit.simulate.simulator import Simulator, exact_ends
from plantfit.simulate.steps.grid import merge
from plantfit.simulate.steps.intervals import MOST_EDGES, Row, sensitivities, substeps, summed
from plantfit.simulate.steps.switching import values_of

import jax
import jax.numpy as jnp


@dataclass(frozen=True, eq=False)
class Batch:
    """A simulator over the chunks of a schedule; `windows` as in `Schedule`.

    `p` is a tuple of arrays with a leading axis of L records, `x0` a tuple of (L,), in the order of
    the simulator's parameters and states.
    """

    simulator: Simulator
    windows: str

    def squares(self, p: Any, x0: Any, chunks: Chunks, weight: Any = None, *, reverse: bool = False) -> Any:
        """Sum of squared residuals of every output, a tuple of scalars; derivatives only with `reverse`, and backwards.

        Squares of record l count `weight[l]` times, (L,), once without.
        """

        def body(carry, chunk: Chunks):
            x, own, totals = carry
            p_rows, x = self._enter(p, x0, x, chunk)
            # in the order of the steps, so that a record's sum has the bits that `whole_records` gives it
            own = tuple(jnp.where(chunk.first, 0.0, a) for a in own)
            plain = lambda: self._running(p_rows, x, own, chunk, False, reverse)  # noqa: E731
            late = lambda: self._running(p_rows, x, own, chunk, True, reverse)  # noqa: E731
            x, own = self._choose(chunk, plain, late)
            return (x, own, tuple(a.at[chunk.lane].set(b) for a, b in zip(totals, own, strict=True))), None

        none = tuple(0.0 * x0[0] for _ in chunks.measured)
        empty = self._empty(x0, chunks)
        begin = (empty, tuple(0.0 * empty[0] for _ in none), none)
        (_, _, totals), _ = jax.lax.scan(body, begin, chunks)
        return tuple(jnp.sum(t if weight is None else weight * t) for t in totals)

    def few_edges(self, chunks: Chunks) -> bool:
        """Whether `slopes` can be used: no chunk has more late edges than straight code is written for."""
        return self.windows == "none" or sum(k.knots.shape[1] for k in chunks.knots) <= MOST_EDGES

    def slopes(self, p: Any, x0: Any, chunks: Chunks) -> Any:
        """Residuals (M, C, R) of every output, and their derivatives by p and x0 of the record that runs there.

        Derivatives are pairs (tree like p, tuple of n) with axes (M, R, C, ...). Needs `few_edges`.
        """
        n, rows = len(x0), chunks.lane.shape[1]
        nothing = jax.tree.map(lambda a: jnp.zeros((rows, *a.shape[1:])), p)
        begin = tuple((nothing, tuple(jnp.full(rows, 1.0 * (i == j)) for j in range(n))) for i in range(n))

        def body(carry, chunk: Chunks):
            x, s = carry
            p_rows, x = self._enter(p, x0, x, chunk)
            s = jax.tree.map(lambda a, b: jnp.where(chunk.first.reshape(-1, *(1,) * (a.ndim - 1)), b, a), s, begin)
            row = Row(chunk.t[:-1], chunk.t[1:], chunk.start, chunk.slope, chunk.at, chunk.measured, chunk.scored)

            def over_rows(late):
                run = sensitivities(self.simulator, late)
                return jax.vmap(run, in_axes=(0, 0, 0, -1, -1))(p_rows, x, s, row, chunk.knots)

            carry, (residuals, slopes) = self._choose(chunk, lambda: over_rows(False), lambda: over_rows(True))
            return carry, (tuple(r.T for r in residuals), slopes)

        return jax.lax.scan(body, (self._empty(x0, chunks), begin), chunks)[1]

    def residuals(self, p: Any, x0: Any, chunks: Chunks) -> Any:
        """Simulated minus measured at every place, a tuple of (M, C, R) by output; 0 where nothing is scored."""

        def body(x, chunk: Chunks):
            p_rows, x = self._enter(p, x0, x, chunk)
            plain = lambda: self._trajectory(p_rows, x, chunk, False)  # noqa: E731
            late = lambda: self._trajectory(p_rows, x, chunk, True)  # noqa: E731
            x, y = self._choose(chunk, plain, late)
            return x, tuple(_scored(a, m, w) for a, m, w in zip(y, chunk.measured, chunk.scored, strict=True))

        return jax.lax.scan(body, self._empty(x0, chunks), chunks)[1]

    def _choose(self, chunk: Chunks, plain: Callable, late: Callable) -> Any:
        if self.windows == "none":
            return plain()
        if self.windows == "all":
            return late()
        return jax.lax.cond(chunk.window, late, plain)

    def _empty(self, x0, chunks: Chunks):
        return tuple(jnp.zeros(chunks.lane.shape[1:]) + 0.0 * jnp.sum(a) for a in x0)

    def _enter(self, p, x0, x, chunk: Chunks):
        """Parameters of the records in the rows, and their initial states where they begin."""
        p_rows = jax.tree.map(lambda a: a.at[chunk.lane].get(mode="promise_in_bounds"), p)
        begin = tuple(a.at[chunk.lane].get(mode="promise_in_bounds") for a in x0)
        return p_rows, tuple(jnp.where(chunk.first, b, a) for a, b in zip(x, begin, strict=True))

    # -- the inputs of a chunk ----------------------------------------------------------------------

    def _delays(self, p_rows):
        vector = self.simulator.vector
        return tuple(p_rows[vector.parameters.index(d.parameter)] for d in vector.model.delays)

    def _plain(self, p_rows, chunk: Chunks):
        """Per interval: inputs at its start, at its end (None when they do not change), length."""
        length = chunk.t[1:] - chunk.t[:-1]
        delays = (*(None for _ in chunk.at), *self._delays(p_rows))
        start = tuple(
            v if s is None or d is None else v - s * d for v, s, d in zip(chunk.start, chunk.slope, delays, strict=True)
        )
        time = self._time(chunk.t[:-1])
        if not self.simulator.varying:
            return (*start, time), None, length
        end = tuple(v if s is None else v + s * length for v, s in zip(start, chunk.slope, strict=True))
        return (*start, time), (*end, self._time(chunk.t[1:])), length

    def _time(self, t):
        return t if self.simulator.vector.uses_time else jnp.zeros(t.shape[0])

    def _at_plain(self, p_rows, chunk: Chunks):
        """Every channel at the samples that end the intervals."""
        start, end, _ = self._plain(p_rows, chunk)
        late = (start if end is None else end)[len(chunk.at) : -1]
        return (*chunk.at, *late, chunk.t[1:])

    # -- sums without trajectories ------------------------------------------------------------------

    def _running(self, p_rows, x, totals, chunk: Chunks, late: bool, reverse: bool):
        """States at the end, and the sums (R,) with those over the chunk."""
        if late and sum(k.knots.shape[0] for k in chunk.knots) > MOST_EDGES:
            x, y = self._trajectory(p_rows, x, chunk, True, reverse)
            more = (
                jnp.sum(_scored(a, m, w) ** 2, axis=0) for a, m, w in zip(y, chunk.measured, chunk.scored, strict=True)
            )
            return x, tuple(a + b for a, b in zip(totals, more, strict=True))
        run = summed(self.simulator, late, reverse=reverse)
        row = Row(chunk.t[:-1], chunk.t[1:], chunk.start, chunk.slope, chunk.at, chunk.measured, chunk.scored)
        return jax.vmap(run, in_axes=(0, 0, 0, -1, -1))(p_rows, x, totals, row, chunk.knots)

    # -- trajectories -------------------------------------------------------------------------------

    def _trajectory(self, p_rows, x, chunk: Chunks, late: bool, reverse: bool = False):
        """States at the end, and every output (C, R) at the samples."""
        if late:
            states, at = self._states_in_window(p_rows, x, chunk, reverse)
        else:
            z = _over_rows(self._plain(p_rows, chunk), chunk.t[1:].shape)
            states, at = self._rolled(p_rows, x, z, reverse), self._at_plain(p_rows, chunk)
        at = tuple(jnp.broadcast_to(_column(a, states[0]), states[0].shape) for a in at)
        y = jax.vmap(jax.vmap(self.simulator.vector.output), in_axes=(0, 0, None))(states, at, p_rows)
        return tuple(s[-1] for s in states), y

    def _rolled(self, p_rows, x, z, reverse: bool):
        """States (K, R) after all steps."""
        values = substeps(self.simulator, values_of(self.simulator.step))
        rollout = make_rollout(substeps(self.simulator, pulled=True), values, reverse=reverse)
        return jax.vmap(rollout, in_axes=(0, 0, -1), out_axes=-1)(p_rows, x, z)

    def _states_in_window(self, p_rows, x, chunk: Chunks, reverse: bool):
        """States (C, R) at the samples, with steps that also end at the late edges; and every channel there."""
        # every row has a grid of its own
        over_rows = jax.vmap(self._window_of_row, in_axes=(0, -1), out_axes=-1)
        z, rank, at = over_rows(
            p_rows, chunk._replace(lane=chunk.lane, first=chunk.first, window=jnp.broadcast_to(0, chunk.lane.shape))
        )
        later = self._rolled(p_rows, x, z, reverse)
        fine = (jnp.concatenate([a[None], b]) for a, b in zip(x, later, strict=True))
        return tuple(jnp.take_along_axis(a, rank[1:], axis=0) for a in fine), at

    def _window_of_row(self, p_row, chunk: Chunks):
        """Steps of one row of a chunk: z as in `_plain` over the merged grid, rank of the samples, channels at the
        samples."""
        delays = self._delays(p_row)
        steps = merge(chunk.t, tuple(k.knots for k in chunk.knots), delays)
        end = steps.start + steps.length
        u0, u1 = [], []
        count = len(chunk.at)
        interval = jnp.minimum(steps.sample, chunk.t.shape[0] - 2)
        for value, slope in zip(chunk.start[:count], chunk.slope[:count], strict=True):
            v = jnp.take(value, interval)
            if slope is None:
                u0.append(v)
                u1.append(v)
                continue
            s, origin = jnp.take(slope, interval), jnp.take(chunk.t, interval)
            u0.append(v + s * (steps.start - origin))
            u1.append(v + s * (end - origin))
        at = list(chunk.at)
        for pieces, piece, delay in zip(chunk.knots, steps.piece, delays, strict=True):
            v, s, origin = (jnp.take(a, piece) for a in pieces[:3])
            u0.append(v + s * (steps.start - delay - origin))
            u1.append(v + s * (end - delay - origin))
            index = jnp.searchsorted(pieces.knots, chunk.t[1:] - delay, side="right")
            v, s, origin = (jnp.take(a, index) for a in pieces[:3])
            at.append(v + s * (chunk.t[1:] - delay - origin))
        u0.append(steps.start)
        u1.append(exact_ends(steps.start, end) if self.simulator.vector.timed_events else end)
        varying = self.simulator.varying
        return (tuple(u0), tuple(u1) if varying else None, steps.length), steps.rank, (*at, chunk.t[1:])


def _column(a, like):
    return a if a.ndim == like.ndim else a[:, None]


def _scored(y, measured, scored):
    return jnp.where(scored, y - measured, 0.0)


def _over_rows(tree, shape):
    """Every array (C,) or (C, R) as (C, R)."""
    return jax.tree.map(lambda a: jnp.broadcast_to(a if a.ndim == 2 else a[:, None], shape), tree)
