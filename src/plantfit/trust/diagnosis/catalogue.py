"""The additions that are tried: where each applies, the sizes from which it is tried, and what the study file says
of it."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from plantfit import units
from plantfit.models.extensions import KINDS, brought, parameter_name
from plantfit.models.extensions.changes import WITH, changes_of, drivers_of
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.trust.diagnosis.candidates import Before, Behind, Candidate, Changing, Inside, candidate_of, candidates
from plantfit.trust.diagnosis.plant.carrier import Rows
from plantfit.trust.diagnosis.ranges import Seen, Tried

MOST_PAIRS = 40  # of what may change with what


@dataclass(frozen=True)
class Extension:
    """An addition `kind` to a signal: its parameter between bounds (low, high), in `unit`, tried at `starts`; none for
    linear effects.

    `name` is "dead time of u", `article` goes before it. `place` is "before" (it changes the recorded input), "inside"
    (it is a parameter of the compiled model) or "behind" (it changes the simulated output). `starts` of a speed beside
    it are shares of the state's spread.
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
    """Effects inside the plant that a model can have: kind -> states, or pairs as "K with u"."""
    model = problem.model
    assert isinstance(model, Model)
    still = {b.state for b in model.backlashes}
    moving = tuple(s for s in model.states if s not in still)
    fast = tuple(s for s in moving if _velocity(model.states[s]) and s not in {f.velocity for f in model.frictions})
    had = {p.name for p in model.parameters}
    pairs = tuple(islice(_pairs(problem, model, moving), MOST_PAIRS))
    kinds = {
        k: pairs if isinstance(c, Changing) else fast if c.of_speeds else moving for k, c in candidates(Inside).items()
    }
    return {kind: tuple(s for s in states if parameter_name(kind, s) not in had) for kind, states in kinds.items()}


def _pairs(problem: Problem, model: Model, moving: tuple[str, ...]) -> Iterator[str]:
    """What may change with what, as "K with u": fitted parameters with every input that moves, time and every state,
    and inputs with each other; those with states last, for there are many."""
    known = changes_of(model)
    ways = [u for u in model.inputs if any(np.ptp(e.recording[u]) > 0 for e in problem.experiments.values())]
    added = {name for kind, own in KINDS.items() for s in own.signals(model) for name in brought(kind, s)}
    free = dict.fromkeys(c.parameter for c in problem.space.coordinates if c.parameter not in added)
    for subjects, drivers in ((free, [*ways, "t"]), (ways, ways), (free, moving)):
        yield from (pair for s in subjects for d in drivers if (pair := f"{s}{WITH}{d}") in known)


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
    every.sort(key=lambda e: isinstance(e.candidate, Changing))  # many, and each stands for much: last among equals
    return [e for e in every if e.parameter not in had]


def _of_inputs(problem: Problem, model: Model) -> Iterator[Extension]:
    for u, unit in model.inputs.items():
        values = np.concatenate([e.recording[u] for e in problem.experiments.values()])
        if np.ptp(values) > 0:
            seen = seen_of(problem, unit, values, any(d.input == u for d in model.delays))
            for kind, candidate in candidates(Before).items():
                yield from made_of(kind, candidate, u, candidate.tried(seen))


def _of_states(problem: Problem, model: Model) -> Iterator[Extension]:
    for kind, states in inside_kinds(problem).items():
        candidate = candidates(Inside)[kind]
        for s in states:
            unit = drivers_of(model)[s.split(WITH)[1]] if isinstance(candidate, Changing) else model.states[s]
            yield from made_of(kind, candidate, s, Tried(candidate.unit(unit), candidate.low, np.inf, candidate.shares))


def _of_outputs(problem: Problem, model: Model, rows: Rows) -> Iterator[Extension]:
    for y, unit in model.outputs.items():
        seen = seen_of(problem, unit, rows.measured[(rows.output == y) & (rows.fit | rows.unseen)] * problem.scales[y])
        for kind, candidate in candidates(Behind).items():
            yield from made_of(kind, candidate, y, candidate.tried(seen))


def seen_of(problem: Problem, unit: str | None, values: np.ndarray, late: bool = False) -> Seen:
    """What the recordings show of a signal."""
    length = min(float(np.ptp(e.recording.t)) for e in problem.experiments.values())
    period = float(np.median(np.concatenate([np.diff(e.recording.t) for e in problem.experiments.values()])))
    times = tuple(float(v) for v in period * np.array([1.0, 3.0, 9.0, 27.0]) if v < 0.2 * length)
    return Seen(unit, values, length, period, times, late)


def made_of(kind: str, candidate: Candidate, signal: str, tried: Tried | None) -> Iterator[Extension]:
    """The addition of a kind to a signal, none where it is not tried."""
    if tried is not None:
        low, high = float(tried.low), float(tried.high)
        yield Extension(
            kind, signal, candidate.name.format(signal), candidate.article, tried.unit, low, high, tried.starts
        )
