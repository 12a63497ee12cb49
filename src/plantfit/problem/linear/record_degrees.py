"""The degree of a problem's residuals in its coordinates: equations followed through the states to a fixed point.

Steppers keep what is affine. Let S be coordinates and D the states that depend on them. Where every rate is affine in S
and D jointly, the Jacobian of the states is block triangular: its blocks within D and outside of D are free of S, and
the block that leads into D is affine in S. Every rational or exponential function of it, as the steps of
`simulate.steps.steppers` and `simulate.steps.linear` are, has the same form, so that states after a step are affine in
S where those before it are. The rules of `degree_rules`, applied to rates with the degrees of the states put in, say
just that.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.library.regression import LinearModel
from plantfit.problem.linear.degree import CONSTANT, Degree, added, bent, chosen, coordinate, summed
from plantfit.problem.linear.degree_rules import Value, degrees, of
from plantfit.problem.predictor import AtRest
from plantfit.problem.problem import Problem
from plantfit.simulate.simulator import Simulator
from plantfit.simulate.steps.switching import bind_backlash, bind_event, bind_friction
from plantfit.simulate.steps.vector import VectorModel, placeholders
from plantfit.space import Space

import jax.numpy as jnp


def residual_degree(problem: Problem) -> Degree:
    """One degree for all residuals; bits are the places among the coordinates of `space.of_one_recording()`."""
    p = parameter_degrees(problem.space)
    if isinstance(problem.model, LinearModel):
        return _of_regression(problem.model, p)
    simulator = problem.predictor.stepping()
    values = [p[n] for n in simulator.vector.parameters]
    resting = {isinstance(d, AtRest) for d in problem.data["drive"].values()}
    return summed((_at_rest if rest else _moving)(simulator, values) for rest in resting)


def parameter_degrees(space: Space) -> dict[str, Value]:
    """That of every parameter as one recording has it; tied ones are those that they are tied to."""
    place = {(c.parameter, c.index): i for i, c in enumerate(space.of_one_recording().coordinates)}

    def degree(name: str) -> Value:
        parameter = space.parameters[name]
        if parameter.value is not None:
            return np.broadcast_to(np.asarray(parameter.value, dtype=float), parameter.shape)
        if not parameter.shape:
            return coordinate(place[name, ()])
        entries = np.empty(parameter.shape, dtype=object)
        for index in np.ndindex(parameter.shape):
            entries[index] = coordinate(place[name, index])
        return entries

    return {name: degree(space.root(name)) for name in space.parameters}


def _of_regression(model: LinearModel, p: dict[str, Value]) -> Degree:
    names, base = [d.name for d in model.parameters], model.base
    if base is None:
        return summed(of(p[n]) for n in names)

    def coefficients(*values: Any) -> list[Any]:
        return [jnp.asarray(c, dtype=float) for c in model.coefficient_values(dict(zip(names, values, strict=True)))]

    return summed(map(of, degrees(coefficients, [jnp.ones(d.shape) for d in model.parameters])(*(p[n] for n in names))))


def _at_rest(simulator: Simulator, p: list[Value]) -> Degree:
    """Points of rest are found by iterations, and count as nonlinear in all that enters the rates."""
    vector = simulator.vector
    channels = [CONSTANT] * len(vector.channels)
    rates = _traced(vector.rate, vector)([CONSTANT] * len(vector.states), channels, p) if vector.states else []
    x = [bent(*rates)] * len(vector.states)
    return summed(_traced(vector.output, vector)(x, channels, p))


def _moving(simulator: Simulator, p: list[Value]) -> Degree:
    vector = simulator.vector
    x, u = _States(simulator, p).settled()
    return summed(_traced(vector.output, vector)(x, u, p))


def _traced(function: Callable, vector: VectorModel) -> Callable[..., list[Degree]]:
    """Degrees of the results of a function (x, u, p) on tuples."""
    given = placeholders(vector.model)
    sizes = [len(g) for g in given]

    def flat(*values: Any) -> list[Any]:
        x, u, p = values[: sizes[0]], values[sizes[0] : sizes[0] + sizes[1]], values[sizes[0] + sizes[1] :]
        found = function(x, u, p)
        return list(found) if isinstance(found, tuple) else [found]

    run = degrees(flat, [v for g in given for v in g])
    return lambda x, u, p: list(map(of, run(*x, *u, *p)))


class _States:
    """The degrees of states and channels over a whole record."""

    def __init__(self, simulator: Simulator, p: list[Value]):
        self.vector, self.p = simulator.vector, p
        model = self.vector.model
        self.begin = _initial(simulator, p)
        self.rate = _traced(self.vector.rate, self.vector)
        self.jumps = [self._event(bind_event(e, self.vector)) for e in model.events]
        self.jumps += [self._friction(bind_friction(f, self.vector)) for f in model.frictions]
        self.jumps += [self._backlash(bind_backlash(b, self.vector)) for b in model.backlashes]
        self.lags = [self._parameter(d.parameter) for d in (*model.delays, *model.state_delays)]

    def settled(self) -> tuple[list[Degree], list[Degree]]:
        x = self.begin
        while True:
            u = self._channels(x)
            after = [added(a, b) for a, b in zip(x, self.rate(x, u, self.p), strict=True)]
            for jump in self.jumps:
                after = [added(a, b) for a, b in zip(after, jump(after, u), strict=True)]
            # steps end where delayed inputs jump
            after = [chosen(bent(*self.lags), [a]) for a in after]
            if after == x:
                return x, u
            x = after

    def _parameter(self, name: str) -> Degree:
        return of(self.p[self.vector.parameters.index(name)])

    def _channels(self, x: Sequence[Degree]) -> list[Degree]:
        model = self.vector.model
        late = [bent(self._parameter(d.parameter)) for d in model.delays]
        late += [
            chosen(self._parameter(d.parameter), [x[self.vector.states.index(d.state)]]) for d in model.state_delays
        ]
        return [*(CONSTANT for _ in model.inputs), *late, CONSTANT]

    # where something jumps, the times of the jumps are nonlinear in all that enters the condition

    def _event(self, event: Any) -> Callable:
        when, then = _traced(event.when, self.vector), _traced(event.then, self.vector)
        return lambda x, u: [chosen(when(x, u, self.p)[0], [new]) for new in then(x, u, self.p)]

    def _friction(self, friction: Any) -> Callable:
        parts = [_traced(f, self.vector) for f in (friction.sliding, friction.breakaway, friction.effect)]

        def jump(x: list[Degree], u: list[Degree]) -> list[Degree]:
            rate = self.rate(x, u, self.p)[friction.velocity]
            force = bent(x[friction.velocity], rate, *(d for part in parts for d in part(x, u, self.p)))
            return [force] * len(x)

        return jump

    def _backlash(self, play: Any) -> Callable:
        parts = [_traced(f, self.vector) for f in (play.drive, play.gap)]
        return lambda x, u: [bent(x[play.state], *(d for part in parts for d in part(x, u, self.p)))] * len(x)


def _initial(simulator: Simulator, p: list[Value]) -> list[Degree]:
    vector = simulator.vector
    if not vector.states:
        return []
    n, m = len(vector.channels), len(vector.outputs)

    def flat(*values: Any) -> list[Any]:
        return list(
            simulator.initial(dict(zip(vector.parameters, values[n + m :], strict=True)), values[:n], values[n : n + m])
        )

    run = degrees(flat, [*(1.0,) * (n + m), *(jnp.ones(d.shape) if d.shape else 1.0 for d in vector.model.parameters)])
    return list(map(of, run(*(CONSTANT,) * (n + m), *p)))
