"""The additions that are tried: where each applies, the sizes from which it is tried, and what the study file says of it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plantfit import units
from plantfit.models.extensions import KINDS, parameter_name
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.trust.diagnosis.carrier import Rows

LEVELS = (0.999, 0.9, 0.7)  # of the range of a signal at which saturation is tried


@dataclass(frozen=True)
class Extension:
    """An addition `kind` to a signal: its parameter between bounds (low, high), in `unit`, tried at `starts`; none for linear effects.

    `name` is "dead time of u", `article` goes before it. `inside` means that it is a parameter of the compiled model, `behind` that it
    changes the simulated output, else it changes the recorded input.
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
    def place(self) -> str:
        return {"inputs": "before", "outputs": "behind", "states": "inside"}[KINDS[self.kind].to]

    @property
    def parameter(self) -> str:
        return parameter_name(self.kind, self.signal)

    @property
    def linear(self) -> bool:
        """Whether its effect on the outputs is a straight line near zero, whose slope is known exactly."""
        return self.kind in ("coulomb", "quadratic", "start", "offset", "drift")


_NAMES = {
    "dead_time": ("a", "dead time of {}"),
    "lag": ("a", "further lag of {}"),
    "dead_zone": ("a", "dead zone of {}"),
    "saturation": ("a", "saturation of {}"),
    "backlash": ("a", "backlash of {}"),
    "sensor_lag": ("a", "sensor lag of {}"),
    "offset": ("an", "offset of {}"),
    "drift": ("a", "drift of {}"),
    "sensor_high": ("an", "upper end of the sensor of {}"),
    "sensor_low": ("a", "lower end of the sensor of {}"),
    "coulomb": ("", "dry friction of {}"),
    "quadratic": ("", "drag of {} by its square"),
    "start": ("another", "initial value of {}"),
}


def inside_kinds(problem: Problem) -> dict[str, tuple[str, ...]]:
    """Effects inside the plant that a model can have: kind -> states."""
    model = problem.model
    assert isinstance(model, Model)
    still = {b.state for b in model.backlashes}
    moving = tuple(s for s in model.states if s not in still)
    fast = tuple(s for s in moving if _velocity(model.states[s]) and s not in {f.velocity for f in model.frictions})
    had = {p.name for p in model.parameters}
    kinds = {"coulomb": fast, "quadratic": fast, "start": moving}
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
    length = min(float(np.ptp(e.recording.t)) for e in problem.experiments.values())
    period = float(np.median(np.concatenate([np.diff(e.recording.t) for e in problem.experiments.values()])))
    times = tuple(float(v) for v in period * np.array([1.0, 3.0, 9.0, 27.0]) if v < 0.2 * length)
    for u, unit in model.inputs.items():
        values = np.concatenate([e.recording[u] for e in problem.experiments.values()])
        moves = np.ptp(values) > 0
        if not moves:
            continue
        if not any(d.input == u for d in model.delays):
            yield _made("dead_time", u, "s", 0.0, 0.3 * length, times)
        yield _made("lag", u, "s", 0.02 * period, length, times)
        size = np.abs(values)
        top, least = float(np.max(size)), float(np.min(size))
        inside = tuple(least + s * (top - least) for s in (0.05, 0.15, 0.35)) if least < top else ()
        # an input that keeps away from zero shows a zone below it as a shift
        below = tuple(s * least for s in (0.3, 0.7)) if least > 0.1 * top else ()
        yield _made("dead_zone", u, unit, 0.0, top, (*below, *inside))
        yield _made("saturation", u, unit, least + 1e-3 * (top - least), top, tuple(least + s * (top - least) for s in (0.9, 0.7, 0.5)))
        gaps = tuple(s * float(np.ptp(values)) for s in (0.02, 0.07, 0.2))
        yield _made("backlash", u, unit, 0.0, 0.5 * float(np.ptp(values)), gaps)


def _of_states(problem: Problem, model: Model) -> Iterator[Extension]:
    for kind, states in inside_kinds(problem).items():
        for s in states:
            unit = model.states[s]
            if kind == "start":
                yield _made(kind, s, units.difference_of(unit), -np.inf, np.inf)
            else:
                own = None if unit is None else (_joined(unit, "/s") if kind == "coulomb" else f"1/s/({unit or '1'})")
                yield _made(kind, s, own, 0.0, np.inf)


def _joined(unit: str, end: str) -> str:
    if end == "/s" and unit.endswith("/s") and unit.count("/") == 1:
        return f"{unit}^2"
    return f"{unit}{end}" if unit.replace("_", "a").isalpha() else f"({unit or '1'}){end}"


def _of_outputs(problem: Problem, model: Model, rows: Rows) -> Iterator[Extension]:
    length = min(float(np.ptp(e.recording.t)) for e in problem.experiments.values())
    period = float(np.median(np.concatenate([np.diff(e.recording.t) for e in problem.experiments.values()])))
    times = tuple(float(v) for v in period * np.array([1.0, 3.0, 9.0, 27.0]) if v < 0.2 * length)
    for y, unit in model.outputs.items():
        step = units.difference_of(unit)
        yield _made("sensor_lag", y, "s", 0.02 * period, length, times)
        yield _made("offset", y, step, -np.inf, np.inf)
        yield _made("drift", y, None if step is None else _joined(step, "/s"), -np.inf, np.inf)
        own = rows.measured[(rows.output == y) & (rows.fit | rows.unseen)] * problem.scales[y]
        low, high = float(np.min(own)), float(np.max(own))
        if high > low:
            yield _made("sensor_high", y, unit, low, high, tuple(low + s * (high - low) for s in LEVELS))
            yield _made("sensor_low", y, unit, low, high, tuple(high - s * (high - low) for s in LEVELS))


def _made(kind: str, signal: str, unit: str | None, low: float, high: float, starts: tuple[float, ...] = ()) -> Extension:
    article, name = _NAMES[kind]
    return Extension(kind, signal, name.format(signal), article, unit, float(low), float(high), starts)
