"""Predictive LQ servo: the feedback of `linear.servo`, and a plan that keeps limits of the input, of its rate and of
the output."""

import math
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.predictive.quadratic import Prepared, Split, solved
from plantfit.control.linear.servo import Servo
from plantfit.errors import SimulationError
from plantfit.simulate.loop.controller import Controller

import jax.numpy as jnp

STEPS = 20  # of the iteration, every sample


class Plan(NamedTuple):
    """What a servo is to keep, rows of inputs first, then of their changes, then of outputs; z = (states when the
    inputs on their way have arrived, less those at rest; input at rest without the load; output at rest).

        z = X x + Q (u[k-1], .., u[k-p]) + g s,   rows = free z where no limit acts, row 0 being the command

    X (m, n), Q (m, p), g (m,), free (rows, m); `task` of the quadratic program; `low`, `high` (rows,) deviations;
    `rate` () the largest change of the input from sample to sample.
    """

    X: Any
    Q: Any
    g: Any
    free: Any
    task: Prepared
    low: Any
    high: Any
    rate: Any


class Predictive(NamedTuple):
    """Parameters of `servo_mpc`: the servo that it is where no limit acts, and its plan."""

    servo: Servo
    plan: Plan


def servo_mpc(inputs: int, rated: bool, *, steps: int = STEPS) -> Controller:
    """The controller whose parameters are (`Predictive`, the input at which the loop rests before the first sample).

    Its plans have `inputs` rows of inputs, then as many of changes where `rated`. Every sample takes `steps` steps of
    `quadratic.solved` from where the last sample's ended; the command lies within the limits of input and rate whatever
    these steps reached. Where no limit acts it is that of `linear.servo`. Source: Rawlings, Mayne, Diehl, Model
    Predictive Control, 2nd ed., sections 1.3, 1.5 (offset-free by an estimated load) and 8.8 (condensing about the
    regulator, as Rossiter, Kouvaritakis, Rice, Automatica 34 (1998) 65).
    """
    if isinstance(steps, bool) or not isinstance(steps, int) or steps < 1:
        raise SimulationError(f"steps = {steps!r}; give a whole number of at least 1.")

    def init(measurement, parameters):
        (s, plan), rest = parameters
        dy, du = measurement - s.y0, rest - s.u0
        x = s.rest * dy - du * (jnp.arange(s.rest.shape[0]) == s.rest.shape[0] - 1)
        none = jnp.zeros(plan.low.shape)
        return x, jnp.full(s.P.shape, du), dy, du * jnp.ones(()), Split(none, none)

    def update(state, measurement, reference, parameters):
        (x, past, followed, last, split), ((s, plan), _) = state, parameters
        through = s.D * past[0] if past.shape[0] else 0.0
        x = x + s.gain * (measurement - s.y0 - s.C @ x - through)
        followed = followed + s.share * (reference - s.y0 - followed)
        free = plan.free @ (plan.X @ x + plan.Q @ past + plan.g * followed)
        if rated:
            free = free - last * (jnp.arange(free.shape[0]) == inputs)
        split = solved(plan.task, free, plan.low, plan.high, split, steps)
        command = free[0] + split.moved[0]
        if rated:
            command = jnp.clip(command, last - plan.rate, last + plan.rate)
        command = jnp.clip(command, plan.low[0], plan.high[0])
        now = jnp.concatenate([command[None], past])
        return (s.A @ x + s.B @ now, now[: past.shape[0]], followed, command, split), command + s.u0

    return Controller(init, update)


def multiplications(given: Predictive, steps: int = STEPS) -> int:
    """Multiplications of doubles that one sample takes; additions are about as many."""
    n, p = len(given.servo.C), len(given.servo.P)
    rows, m = np.shape(given.plan.free)
    return n * (n + p + 3) + m * (n + p + 1) + rows * m + steps * rows * (rows + 3)


def growing(samples: int, moves: int) -> np.ndarray:
    """Lengths (k,) of at most `moves` parts of `samples`, 1 at first, then growing evenly in their logarithms."""
    if samples <= moves:
        return np.ones(samples, dtype=int)
    low, high = 1.0, float(samples)
    for _ in range(60):  # bisection on the ratio between two lengths
        ratio = math.sqrt(low * high)
        if np.sum(np.maximum(1, np.floor(ratio ** np.arange(moves)))) > samples:
            high = ratio
        else:
            low = ratio
    found = np.maximum(1, np.floor(low ** np.arange(moves))).astype(int)
    found[-1] += samples - found.sum()
    return found
