"""Times that are known before a simulation begins: events that depend on time alone, nodes of tables over time.

What a guard depends on is read from its traced program (`dependencies`). A guard that reads the time and parameters,
but no state and no input, is timed. Is it a straight line in t, g = g(0) + s t, then its moment is T = -g(0)/s,
whatever the states do; the step ends there exactly, and derivatives by parameters know how T moves
(`switching.events`). Moments that depend on no parameter either are part of the grid of the record, as are the nodes of
tables over t.
"""

from collections.abc import Callable

import numpy as np

from plantfit.errors import SimulationError
from plantfit.runtime import jit
from plantfit.simulate.steps.dependencies import dependencies
from plantfit.simulate.steps.vector import VectorModel, placeholders

import jax
import jax.numpy as jnp

FINE = 32  # places of a sample interval at which a guard that is no straight line is looked at
HALVINGS = 60


def on_channels(function: Callable, vector: VectorModel) -> Callable:
    """A function of named values as one of tuples in the order of `vector`."""
    names = vector.states, vector.channels, vector.parameters
    return lambda x, u, p: function(*(dict(zip(n, v, strict=True)) for n, v in zip(names, (x, u, p), strict=True)))


def timed(guard: Callable, vector: VectorModel) -> bool:
    """Whether guard(x, u, p), on tuples, reads the time and neither a state nor an input."""
    t, found = _reads(guard, vector)
    return t in found and found.isdisjoint(range(t))


def fixed(guard: Callable, vector: VectorModel) -> bool:
    """Whether a guard reads no parameter."""
    t, found = _reads(guard, vector)
    return all(i <= t for i in found)


def straight(guard: Callable, vector: VectorModel) -> bool:
    """Whether a timed guard is a straight line in time."""
    x, u, p = placeholders(vector.model)

    def slope(t, p):
        return jax.jacfwd(lambda t: guard(x, (*u[:-1], t), p))(t)

    return 0 not in dependencies(slope, u[-1], p)[0]


def moment(guard: Callable, u: tuple, p: tuple, x: tuple) -> tuple:
    """(T, slope) of a straight guard: it passes zero at T (s) with that slope."""
    nothing = jnp.zeros_like(u[-1])
    at_zero, slope = jax.jvp(lambda t: guard(x, (*u[:-1], t), p), (nothing,), (jnp.ones_like(nothing),))
    return -at_zero / slope, slope


def known_times(vector: VectorModel, t: np.ndarray) -> np.ndarray:
    """Times (k,) s inside (t[0], t[-1]) at which steps have to end whatever the parameters are, for samples `t` (N,).

    Raises SimulationError for an event at t[0], where nothing is passed.
    """
    found = [
        np.asarray(table.kinks[i], dtype=float)
        for table in vector.model.tables
        for i, s in enumerate(table.over)
        if s == "t"
    ]
    for event in vector.model.events:
        guard = on_channels(event.when, vector)
        if not (timed(guard, vector) and fixed(guard, vector)):
            continue
        passed = _passed(guard, vector, t)
        if len(t) > 1 and np.any(passed == t[0]):
            raise SimulationError(
                f"Model {vector.model.name!r}: the event {event.name} is at t = {t[0]:g} "
                "s, where the simulation begins, so that nothing is passed; put what it "
                "does into the initial values, or begin earlier with initial_time."
            )
        found.append(passed)
    every = np.unique(np.concatenate(found)) if found else np.zeros(0)
    return every[(every > t[0]) & (every < t[-1])]


def _passed(guard: Callable, vector: VectorModel, t: np.ndarray) -> np.ndarray:
    """Where a guard of time alone passes zero."""
    x, u, p = placeholders(vector.model)
    if straight(guard, vector):
        when, slope = moment(guard, tuple(map(jnp.asarray, u)), p, x)
        return np.array([float(when)]) if float(slope) != 0.0 else np.zeros(0)
    value = jit(jax.vmap(lambda t: guard(x, (*u[:-1], t), p)))
    fine = np.unique(np.concatenate([t, *(t[:-1] + np.diff(t) * k / FINE for k in range(1, FINE))]))
    sign = np.sign(np.asarray(value(fine)))
    low, high = fine[:-1][sign[:-1] * sign[1:] < 0], fine[1:][sign[:-1] * sign[1:] < 0]
    rising = np.asarray(value(high)) > 0 if len(high) else np.zeros(0, bool)
    for _ in range(HALVINGS if len(high) else 0):
        middle = 0.5 * (low + high)
        below = (np.asarray(value(middle)) < 0) == rising
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.unique(np.concatenate([high, fine[1:-1][sign[1:-1] == 0]]))


def _reads(guard: Callable, vector: VectorModel) -> tuple[int, set[int]]:
    """The place of the time among the leaves of (x, u, p), and the places that a guard reads."""
    t = len(vector.states) + len(vector.channels) - 1
    return t, set().union(*dependencies(guard, *placeholders(vector.model)))


__all__ = ["fixed", "known_times", "moment", "on_channels", "straight", "timed"]
