"""What a closed loop is closed with and watched by, as pure functions."""

from collections.abc import Callable
from typing import Any, NamedTuple


class Controller(NamedTuple):
    """A sampled controller as two pure functions.

    `init(measurement, parameters)` is its state at rest at the first measurement;
    `update(state, measurement, reference, parameters)` gives (state, command), once a sample.

    A measurement or command is a scalar in a loop over one signal, a mapping from names to scalars in a
    loop over several; the reference has the form that the simulation was given.
    """

    init: Callable[[Any, Any], Any]
    update: Callable[[Any, Any, Any, Any], tuple[Any, Any]]


class Observer(NamedTuple):
    """A fold over the samples, for what is wanted without the trajectory.

    `init(y, reference)` at the first sample; `update(state, t, y, u, reference)` at every sample, the
    first too, gives the next state; `result(state)` is returned. Signals have the forms that they have
    for the `Controller`.
    """

    init: Callable[[Any, Any], Any]
    update: Callable[[Any, Any, Any, Any, Any], Any]
    result: Callable[[Any], Any]


class Trajectory(NamedTuple):
    """One closed loop: times (N,) in s; controlled output, measurement, command, plant input, (N,) each or by name;
    states by name."""

    t: Any
    y: Any
    measured: Any
    command: Any
    u: Any
    states: dict[str, Any]
