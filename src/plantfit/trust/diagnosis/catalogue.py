"""The additions that are tried: where each applies, the sizes from which it is tried, and what the study file says of it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plantfit import units
from plantfit.models.extensions import parameter_name
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.trust.diagnosis.candidates import Before, Behind, Candidate, Inside, candidate_of, candidates
from plantfit.trust.diagnosis.plant.carrier import Rows
from plantfit.trust.diagnosis.ranges import Seen, Tried


@dataclass(frozen=True)
class Extension:
    """An addition `kind` to a signal: its parameter between bounds (low, high), in `unit`, tried at `starts`; none for linear effects.

    `name` is "dead time of u", `article` goes before it. `place` is "before" (it changes the recorded input), "inside" (it is a parameter
    of the compiled model) or "behind" (it changes the simulated output).
    """

    kind: str
    signal: str
    name: str
    article: str
    unit: str | None
    low: float
    high: float
    starts: tuple[float, ...] = ()

    @property
    def candidate(self) -> Before | Inside | Behind:
        """The row of its kind; raises KeyError for a kind that there is not."""
        return candidate_of(self.kind)

    @property
    def place(self) -> str:
        return self.candidate.place

    @property
    def parameter(self) -> str:
        return parameter_name(self.kind, self.signal)

    @property
    def linear(self) -> bool:
        """Whether its effect on the outputs is a straight line near zero, whose slope is known exactly."""
        return self.candidate.linear


def inside_kinds(problem: Problem) -> dict[str, tuple[str, ...]]:
    """Effects inside the plant that a model can have: kind -> states."""
    model = problem.model
    assert isinstance(model, Model)
    still = {b.state for b in model.backlashes}
    moving = tuple(s for s in model.states if s not in still)
    fast = tuple(s for s in moving if _velocity(model.states[s]) and s not in {f.velocity for f in model.frictions})
    had = {p.name for p in model.parameters}
    kinds = {kind: fast if c.of_speeds else moving for kind, c in candidates(Inside).items()}
    return {kind: tuple(s for s in states if parameter_name(kind, s) not in had) for kind, states in kinds.items()}


def _velocity(unit: str | None) -> bool:
    """Whether a unit is one of a speed; unknown and missing ones may be."""
    if not unit or unit == "1":
        return True
    return any(units.compatible(unit, other) for other in ("m/s", "rad/s", "rpm"))


def catalogue(problem: Problem, rows: Rows) -> list[Extension]:
    """Every addition that applies to a problem, in the order in which equals are named."""
    model = problem.model
    assert isinstance(model, Model)
    had = {p.name for p in model.parameters}
    every = [*_of_inputs(problem, model), *_of_states(problem, model), *_of_outputs(problem, model, rows)]
    return [e for e in every if e.parameter not in had]


def _of_inputs(problem: Problem, model: Model) -> Iterator[Extension]:
    for u, unit in model.inputs.items():
        values = np.concatenate([e.recording[u] for e in problem.experiments.values()])
        if np.ptp(values) > 0:
            seen = _seen(problem, unit, values, any(d.input == u for d in model.delays))
            for kind, candidate in candidates(Before).items():
                yield from _made(kind, candidate, u, candidate.tried(seen))


def _of_states(problem: Problem, model: Model) -> Iterator[Extension]:
    for kind, states in inside_kinds(problem).items():
        candidate = candidates(Inside)[kind]
        for s in states:
            yield from _made(kind, candidate, s, Tried(candidate.unit(model.states[s]), candidate.low, np.inf))


def _of_outputs(problem: Problem, model: Model, rows: Rows) -> Iterator[Extension]:
    for y, unit in model.outputs.items():
        seen = _seen(problem, unit, rows.measured[(rows.output == y) & (rows.fit | rows.unseen)] * problem.scales[y])
        for kind, candidate in candidates(Behind).items():
            yield from _made(kind, candidate, y, candidate.tried(seen))


def _seen(problem: Problem, unit: str | None, values: np.ndarray, late: bool = False) -> Seen:
    length = min(float(np.ptp(e.recording.t)) for e in problem.experiments.values())
    period = float(np.median(np.concatenate([np.diff(e.recording.t) for e in problem.experiments.values()])))
    times = tuple(float(v) for v in period * np.array([1.0, 3.0, 9.0, 27.0]) if v < 0.2 * length)
    return Seen(unit, values, length, period, times, late)


def _made(kind: str, candidate: Candidate, signal: str, tried: Tried | None) -> Iterator[Extension]:
    if tried is not None:
        low, high = float(tried.low), float(tried.high)
        yield Extension(kind, signal, candidate.name.format(signal), candidate.article, tried.unit, low, high, tried.starts)
