"""Costs of candidates side by side, their gradients, and slopes of one candidate's residuals, in native loops over
whole records.

Many candidates are the lanes of the machine code, and records are worked off one after the other, each to its own end.
Of few candidates the records are the lanes (`steps_first`). Arrays have the axes that the code wants, so that nothing
is transposed on the way. An interval into which the edge of a delayed input can fall takes another branch.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import plantfit.runtime  # noqa: F401
from plantfit.native import native_scan
from plantfit.simulate.records.rows import Records
from plantfit.simulate.simulator import Simulator
from plantfit.simulate.steps.intervals import Row, backwards_through, counted, interval, residuals

import jax
import jax.numpy as jnp


def squares_of_records(
    simulator: Simulator,
    windows: str,
    p: Any,
    x0: Any,
    records: Records,
    weight: Any = None,
    *,
    steps_first: bool = False,
) -> tuple[Any, ...]:
    """Sum of squared residuals of every output, a tuple of (n,), for n candidates; it can be differentiated backwards
    by p and x0.

    `windows` as in `RecordRows`; leaves of `p` are (..., L, n) in the order of the simulator's parameters, those of
    `x0` (L, n); squares of record l count `weight[l]` times, (L,), once without. `steps_first` tells that `records` are
    those of `RecordRows`. Raises NativeUnsupported for a model without native code.
    """
    loops = _Loops(simulator, windows, 1 if steps_first else 0)

    @jax.custom_vjp
    def totals(p, x0):
        return _joined(loops.forwards(p, x0, records, keep=False)[0], weight)

    def forwards(p, x0):
        squares, before = loops.forwards(p, x0, records, keep=True)
        return _joined(squares, weight), (p, before)

    def backwards(saved, cotangents):
        p, before = saved
        weights = tuple(
            jnp.ones((records.used.shape[0], 1)) * c if weight is None else weight[:, None] * c for c in cotangents
        )
        return loops.backwards(p, before, weights, records)

    totals.defvjp(forwards, backwards)
    return totals(p, x0)


def slopes_of_records(
    simulator: Simulator, windows: str, p: Any, x0: Any, directions: Any, records: Records, steps_first: Records
) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Residuals (K, L) of every output, and its derivatives (L, K, q) along q directions, for one candidate.

    Leaves of `p` are (L, ...), those of `x0` (L,); `directions` is a pair like (p, x0) with axes (L, q, ...), `records`
    and `steps_first` those of `RecordRows`. Forward mode with the directions as lanes, so that what they share, the
    whole step but its linear part, is computed once. Raises NativeUnsupported for a model without native code.
    """
    step = _chosen(windows, lambda edges: interval(simulator, edges, derived=True))
    moving, begin = directions

    def along(p, moving, begin, before, rows, used):
        def body(s, now):
            x, (row, late, knots) = now
            _, (later, slopes) = jax.jvp(lambda p, x: step(late, p, x, row, knots), (p, x), (moving, s))
            return later, slopes

        return native_scan(body, begin, (before, rows), keep=True, used=used)[1]

    before, found = _forwards(simulator, windows, p, x0, steps_first)
    before = jax.tree.map(jnp.transpose, before)
    side_by_side = jax.vmap(along, in_axes=(None, 0, 0, None, None, None), out_axes=-1)
    return found, jax.vmap(side_by_side)(p, moving, begin, before, _rows(records), records.used)


def residuals_of_records(simulator: Simulator, windows: str, p: Any, x0: Any, steps_first: Records) -> tuple[Any, ...]:
    """The residuals that `slopes_of_records` gives, without the loop for their derivatives."""
    return _forwards(simulator, windows, p, x0, steps_first)[1]


def _forwards(simulator: Simulator, windows: str, p: Any, x0: Any, steps_first: Records) -> tuple[Any, Any]:
    """The states before every interval and the residuals of every output (K, L)."""
    step = _chosen(windows, lambda edges: interval(simulator, edges))

    def forwards(p, x0, rows):
        def body(x, now):
            row, late, knots = now
            later, y = step(late, p, x, row, knots)
            return later, (x, residuals(y, row))

        return native_scan(body, x0, rows, keep=True)[1]

    return jax.vmap(forwards, in_axes=(0, 0, 1), out_axes=1)(p, x0, _rows(steps_first))


def _joined(squares: tuple[Any, ...], weight: Any) -> tuple[Any, ...]:
    """Sums over the records (L, n)."""
    return tuple(jnp.sum(s if weight is None else weight[:, None] * s, axis=0) for s in squares)


@dataclass(frozen=True)
class _Loops:
    """`place` is the axis of the records in what changes from interval to interval."""

    simulator: Simulator
    windows: str
    place: int

    def forwards(self, p: Any, x0: Any, records: Records, *, keep: bool) -> tuple[Any, Any]:
        """Squares by output (L, n); with `keep` the states before every interval, a tuple of (L, K, n) or (K, L, n)."""
        step = _chosen(self.windows, lambda edges: partial(counted, interval(self.simulator, edges)))

        def run(p, x0, rows, used):
            def body(carry, now):
                row, late, knots = now
                return step(late, p, row, knots, carry), carry[0]

            begin = x0, tuple(jnp.zeros(()) for _ in rows[0].measured)
            (_, totals), before = native_scan(body, begin, rows, keep=keep, used=used)
            return totals, before if keep else ()

        over = self._over_all(run, ("tables", "numbers", "rows", "ends"), ("numbers", "states"))
        return over(p, x0, _rows(records), self._ends(records))

    def backwards(self, p: Any, before: Any, weights: Any, records: Records) -> tuple[Any, Any]:
        """Derivatives by p and x0."""
        pull = _chosen(self.windows, lambda edges: backwards_through(self.simulator, edges))

        def run(p, before, weights, rows, used):
            def body(carry, step):
                x, (row, late, knots) = step
                return pull(late, p, x, row, knots, carry, weights), None

            begin = tuple(jnp.zeros(()) for _ in before), jax.tree.map(jnp.zeros_like, p)
            (adjoint, found), _ = native_scan(body, begin, (before, rows), reverse=True, used=used)
            return found, adjoint

        over = self._over_all(run, ("tables", "states", "numbers", "rows", "ends"), ("tables", "numbers"))
        return over(p, before, weights, _rows(records), self._ends(records))

    def _over_all(self, run: Callable, given: tuple[str, ...], found: tuple[str, ...]) -> Callable:
        """`run` over candidates and records: "tables" are (..., L, n), "numbers" (L, n), "rows" have no candidates,
        "states" have both."""
        candidates = {"tables": -1, "numbers": -1, "rows": None, "states": -1, "ends": None}
        records = {
            "tables": -2,
            "numbers": 0,
            "rows": self.place,
            "states": self.place,
            "ends": None if self.place else 0,
        }
        for axes in (candidates, records):
            run = jax.vmap(run, in_axes=tuple(axes[a] for a in given), out_axes=tuple(axes[a] for a in found))
        return run

    def _ends(self, records: Records) -> Any:
        # as lanes the records go on together to the end of the longest
        return None if self.place else records.used


def _rows(records: Records) -> tuple[Row, Any, Any]:
    """The rows of a loop, whether edges can fall into them, and the edges."""
    r = records
    return Row(r.begin, r.end, r.start, r.slope, r.at, r.measured, r.scored), r.late, r.knots


def _chosen(windows: str, of: Callable[[bool], Callable]) -> Callable:
    """The function for intervals with edges or the one without: by a first argument where there are both."""
    if windows != "some":
        one = of(windows == "all")
        return lambda late, *given: one(*given)
    with_edges, without = of(True), of(False)
    return lambda late, *given: jax.lax.cond(late, with_edges, without, *given)
