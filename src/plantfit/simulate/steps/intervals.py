"""From one sample to the next, as a function of scalars: the body of the loops that native code runs.

An interval with edges of delayed inputs is cut at them, in straight code without branches.
"""

from collections.abc import Callable
from functools import partial, wraps
from itertools import chain
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.native import native_scan
from plantfit.simulate.records.schedule import Knots
from plantfit.simulate.simulator import Simulator
from plantfit.simulate.steps.switching import Switching, values_of

import jax
import jax.numpy as jnp

MOST_EDGES = 4  # that straight code is written for; with more, edges are merged into a grid of steps
# substeps that are written out, where nothing can happen in them; more become a loop
UNROLLED = 8
# of a model that reads tables: a loop of its long steps is as fast, and made in a fifth of the time. Pulled back it is
# slower by a third; loops of short steps are slower by up to a half.
UNROLLED_TABLES = 1


class Row(NamedTuple):
    """What changes from interval to interval in one row of chunks; arrays (C,). Channels as in `schedule.Chunks`."""

    begin: Any  # s
    end: Any  # s
    start: tuple[Any, ...]
    slope: tuple[Any, ...]
    at: tuple[Any, ...]
    measured: tuple[Any, ...]
    scored: tuple[Any, ...]


def _kept(make: Callable) -> Callable:
    """Functions made for a simulator once, so that each is traced once wherever it is called; they live as long as
    the simulator."""

    @wraps(make)
    def kept(simulator: Simulator, edges: bool, *, reverse: bool = False) -> Callable:
        made, key = simulator.__dict__.setdefault("_made", {}), (make, edges, reverse)
        if key not in made:
            made[key] = make(simulator, edges, reverse=reverse) if reverse else make(simulator, edges)
        return made[key]

    return kept


def _written_out(simulator: Simulator, pulled: bool) -> int:
    """How many substeps are written out at most; `pulled`: they are differentiated backwards."""
    if isinstance(simulator.step, Switching):
        return 1
    model = simulator.vector.model
    tables = any(model.declared(n).shape for n in simulator.vector.parameters)
    # inputs that change within an interval have shares of it that are known before only where they are written out
    return UNROLLED_TABLES if tables and not simulator.varying and not pulled else UNROLLED


def substeps(simulator: Simulator, stepper: Callable | None = None, *, pulled: bool = False) -> Callable:
    """`step(p, x, z)`: all substeps over z = (inputs at the start, at the end or None, length), of the simulator's
    stepper or another; `pulled` tells that it is differentiated backwards."""
    vector, m, varying = simulator.vector, simulator.parts, simulator.varying
    stepper, most = simulator.step if stepper is None else stepper, _written_out(simulator, pulled)

    def part(p, x, u0, u1, h):
        return stepper(vector.rate, x, u0, u0 if u1 is None else u1, h, p, varying, vector.pattern)

    def step(p, x, z):
        u0, u1, h = z
        h = h / m

        def between(share):
            if u1 is None:
                return u0
            u = tuple(a + (b - a) * share for a, b in zip(u0, u1, strict=True))
            # time ends where the next interval begins, to the last bit
            return (*u[:-1], jnp.where(share == 1.0, u1[-1], u[-1])) if vector.timed_events else u

        def one(j, x):
            return part(p, x, between(j / m), None if u1 is None else between((j + 1) / m), h)

        if m > most:
            return jax.lax.fori_loop(0, m, one, x)
        for j in range(m):
            x = one(j, x)
        return x

    return step


def interval(simulator: Simulator, edges: bool, *, derived: bool = False, pulled: bool = False) -> Callable:
    """`advance(p, x, row, around) -> (x, y)`: the states and outputs at the next sample; to be differentiated only when
    `derived`, and backwards better when `pulled` too.

    `row` is one interval of a `Row`; `around` the `Knots` (E,) of every delayed channel, looked at only with `edges`.
    """
    stepper = simulator.step if derived else values_of(simulator.step)
    return _interval(simulator, edges, stepper, lambda x: x, pulled)


def quiet_interval(simulator: Simulator, edges: bool) -> Callable | None:
    """`advance(p, x, row, around) -> ((x, y), may)` as if nothing happened in its steps, and whether something may;
    None where nothing can.

    See `switching.Switching`.
    """
    step = simulator.step
    if not isinstance(step, Switching):
        return None

    def noted(rate, x, *given):
        states, may = x
        states, more = step.quiet(rate, states, *given)
        return states, may | more

    inner = _interval(simulator, edges, noted, lambda x: x[0])

    def advance(p, x, row: Row, around: tuple[Knots, ...]):
        (x, may), y = inner(p, (x, jnp.zeros((), dtype=bool)), row, around)
        return (x, y), may

    return advance


def _interval(simulator: Simulator, edges: bool, stepper: Callable, states: Callable, pulled: bool = False) -> Callable:
    vector, step = simulator.vector, substeps(simulator, stepper, pulled=pulled)
    places = [vector.parameters.index(d.parameter) for d in vector.model.delays]

    def advance(p, x, row: Row, around: tuple[Knots, ...]):
        delays = [p[i] for i in places]
        moving = (
            [[k + d for k in own.knots] for own, d in zip(around, delays, strict=True)]
            if edges
            else [[] for _ in delays]
        )
        now = row.begin
        for part in range(1 + sum(map(len, moving))):
            # an edge on the sample itself ends a first part of length 0: the derivative to its right
            passed = [[(e < now) if part == 0 else (e <= now) for e in channel] for channel in moving]
            then = row.end
            for edge, gone in zip(chain(*moving), chain(*passed), strict=True):
                then = jnp.where(~gone & (edge < then), edge, then)
            u0 = _inputs(row, around, delays, passed, now)
            u1 = _inputs(row, around, delays, passed, then) if simulator.varying else None
            x = step(p, x, (u0, u1, then - now))
            now = then
        late = _late(row, around, delays, [[e <= row.end for e in channel] for channel in moving], row.end)
        return x, vector.output(states(x), (*row.at, *late, row.end), p)

    def _inputs(row, around, delays, passed, when):
        """Every channel at `when`, on the straight lines that hold behind the edges that are `passed`."""
        count = len(row.at)
        own = tuple(
            v if s is None else v + s * (when - row.begin)
            for v, s in zip(row.start[:count], row.slope[:count], strict=True)
        )
        return (*own, *_late(row, around, delays, passed, when), when if vector.uses_time else 0.0 * when)

    def _late(row, around, delays, passed, when):
        count = len(row.at)
        if not edges:
            return tuple(
                v if s is None else v + s * (when - row.begin - d)
                for v, s, d in zip(row.start[count:], row.slope[count:], delays, strict=True)
            )
        found = []
        for own, s, d, gone in zip(around, row.slope[count:], delays, passed, strict=True):
            v, rate, origin = own.value[0], own.slope[0], own.origin[0]
            for i, behind in enumerate(gone):
                v = jnp.where(behind, own.value[i + 1], v)
                if s is not None:
                    rate, origin = (
                        jnp.where(behind, own.slope[i + 1], rate),
                        jnp.where(behind, own.origin[i + 1], origin),
                    )
            found.append(v if s is None else v + rate * (when - d - origin))
        return tuple(found)

    return advance


@_kept
def summed(simulator: Simulator, edges: bool, *, reverse: bool = False) -> Callable:
    """`run(p, x, totals, rows, around) -> (x, totals)`: the states after all intervals of one row, the sums with its
    squares by output.

    With `reverse` it can be differentiated backwards by p, x and totals.
    """
    advance, pulled = interval(simulator, edges), backwards_through(simulator, edges)

    @partial(jax.jit, static_argnums=5, inline=True)
    def loop(p, x, totals, rows: Row, around, keep: bool):
        def body(carry, row):
            return counted(advance, p, row, around, carry), carry[0]

        return native_scan(body, (x, totals), rows, keep=keep, fallback=True)

    @partial(jax.jit, inline=True)
    def pull(p, before, rows: Row, around, adjoint, weights):
        def body(carry, step):
            x, row = step
            return pulled(p, x, row, around, carry, weights), None

        begin = adjoint, jax.tree.map(jnp.zeros_like, p)
        return native_scan(body, begin, (before, rows), reverse=True, fallback=True)[0]

    if not reverse:
        return lambda p, x, totals, rows, around: loop(p, x, totals, rows, around, False)[0]

    @jax.custom_vjp
    def run(p, x, totals, rows, around):
        return loop(p, x, totals, rows, around, False)[0]

    def forwards(p, x, totals, rows, around):
        ended, before = loop(p, x, totals, rows, around, True)
        return ended, (p, before, rows, around)

    def backwards(saved, cotangents):
        adjoint, weights = cotangents
        dx, dp = pull(*saved, adjoint, weights)
        return dp, dx, weights, None, None

    run.defvjp(forwards, backwards)
    return run


def counted(advance: Callable, p: Any, row: Row, around: Any, carry: Any) -> Any:
    """(states, sums of squares by output) after an interval, of those before it, for an `advance` as `interval`
    makes it."""
    x, totals = carry
    x, y = advance(p, x, row, around)
    return x, tuple(a + r**2 for a, r in zip(totals, residuals(y, row), strict=True))


def residuals(y: Any, row: Row) -> Any:
    """Simulated minus measured of every output, 0 where nothing is scored."""
    return tuple(jnp.where(s, a - m, 0.0) for a, m, s in zip(y, row.measured, row.scored, strict=True))


@_kept
def backwards_through(simulator: Simulator, edges: bool) -> Callable:
    """`pull(p, x, row, around, carry, weights)`: (adjoint, gradient) before an interval, of those after it.

    `x` are the states before the interval, `weights` the derivatives by the sums of squares. Where nothing happens in
    an interval, its steps are differentiated as steps in which nothing can.
    """
    quiet, step = quiet_interval(simulator, edges), simulator.step
    if quiet is None:
        return jax.jit(partial(_pulled, interval(simulator, edges, derived=True, pulled=True)), inline=True)
    assert isinstance(step, Switching)  # else there is no quiet interval
    # of one step it is known where something may have happened in it
    step = step.whole if simulator.parts == 1 else step
    whole = partial(_pulled, _interval(simulator, edges, step, lambda x: x))
    plain = partial(_pulled, lambda *given: quiet(*given)[0])

    @partial(jax.jit, inline=True)
    def pull(p: Any, x: Any, row: Row, around: Any, carry: Any, weights: Any) -> Any:
        _, may = quiet(p, x, row, around)
        return jax.lax.cond(may, whole, plain, p, x, row, around, carry, weights)

    return pull


def _pulled(advance: Callable, p: Any, x: Any, row: Row, around: Any, carry: Any, weights: Any) -> Any:
    adjoint, gradient = carry
    (_, y), back = jax.vjp(lambda p, x: advance(p, x, row, around), p, x)
    dp, dx = back((adjoint, tuple(2.0 * w * r for w, r in zip(weights, residuals(y, row), strict=True))))
    return dx, jax.tree.map(jnp.add, gradient, dp)


@_kept
def sensitivities(simulator: Simulator, edges: bool) -> Callable:
    """`run(p, x, s, rows, around) -> ((x, s), (residuals, slopes))` over all intervals of one row, forwards.

    `s` holds, for every state, its derivatives by what p and the initial states are made of: a pair (tree like p, tuple
    of n). Residuals (C,) and slopes of the output, such pairs with a leading axis C, are given for every output. The
    derivatives of a step are pulled back from its few results, so that the work does not grow with the number of
    parameters but for one recursion.
    """
    advance = interval(simulator, edges, derived=True, pulled=True)

    @partial(jax.jit, inline=True)
    def run(p, x, s, rows: Row, around):
        def body(carry, row):
            x, s = carry
            (later, y), pull = jax.vjp(lambda p, x: advance(p, x, row, around), p, x)
            no_state, no_output = tuple(0.0 for _ in later), tuple(0.0 for _ in y)

            def chained(dp, dx):
                by_p, by_start = jax.tree.map(lambda *a: sum(d * b for d, b in zip(dx, a, strict=True)), *s)
                return jax.tree.map(jnp.add, dp, by_p), by_start

            moved = tuple(chained(*pull((_unit(no_state, i), no_output))) for i in range(len(later)))
            slopes = tuple(chained(*pull((no_state, _unit(no_output, i)))) for i in range(len(y)))
            return (later, moved), (residuals(y, row), slopes)

        return native_scan(body, (x, s), rows, keep=True, fallback=True)

    return run


def _unit(zeros: tuple[float, ...], i: int) -> tuple[float, ...]:
    return tuple(1.0 if k == i else z for k, z in enumerate(zeros))
