"""How much a plant wanders and its sensors err."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from plantfit.errors import SpaceError
from plantfit.models.model import Model
from plantfit.space import Parameter

Level = float | tuple[float, float]


@dataclass(frozen=True)
class Noise:
    """Standard deviations by name; a pair (low, high) instead of a number is a level that `maximum_likelihood` finds in
    between.

    `process`: by how much white noise on its rate moves a state in a second (its unit per sqrt s); states not named are
    not moved. `measurement`: of every output. `initial`: of every state at the first sample; by default ten times the
    measurement's for a state that is an output of the same name.
    """

    process: Mapping[str, Level]
    measurement: Mapping[str, Level]
    initial: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for kind in ("process", "measurement", "initial"):
            levels = dict(getattr(self, kind))
            for name, level in levels.items():
                _check(kind, name, level)
            object.__setattr__(self, kind, levels)

    def parameters(self, model: Model) -> dict[str, Parameter]:
        """The levels as parameters "process x" and "measurement y"; raises SpaceError where names do not fit the
        model."""
        for kind, levels, names in (
            ("process", self.process, model.states),
            ("measurement", self.measurement, model.outputs),
            ("initial", self.initial, model.states),
        ):
            wrong = [n for n in levels if n not in names]
            if wrong:
                raise SpaceError(
                    f"The noise names {wrong[0]!r} under {kind}; model {model.name!r} has {list(names)} there."
                )
        missing = [n for n in model.outputs if n not in self.measurement]
        if missing:
            raise SpaceError(f"Noise has no measurement level of output {missing[0]!r}; give its standard deviation.")
        rate = {n: f"({u})/s^0.5" if u else None for n, u in model.states.items()}
        process = {f"process {n}": _parameter(self.process.get(n, 0.0), rate[n]) for n in model.states}
        return process | {f"measurement {n}": _parameter(self.measurement[n], u) for n, u in model.outputs.items()}

    def initial_levels(self, model: Model) -> list[float]:
        """Standard deviation of every state at the first sample; raises SpaceError where one is missing."""
        result = []
        for name in model.states:
            seen = self.measurement.get(name) if name in model.outputs else None
            if name in self.initial:
                result.append(float(self.initial[name]))
            elif seen is not None:
                result.append(10.0 * float(seen[1] if isinstance(seen, tuple) else seen))
            else:
                raise SpaceError(
                    f"State {name!r} is not measured; give its standard deviation at the first sample under initial."
                )
        return result


def _parameter(level: Level, unit: str | None) -> Parameter:
    return Parameter(level, unit, "log") if isinstance(level, tuple) else Parameter(value=float(level), unit=unit)


def _check(kind: str, name: str, level: Any) -> None:
    numbers = level if isinstance(level, tuple) else (level,)
    good = all(isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) and v >= 0 for v in numbers)
    if not good or (
        isinstance(level, tuple) and (kind == "initial" or len(numbers) != 2 or not 0 < numbers[0] < numbers[1])
    ):
        wanted = (
            "a number of at least 0"
            if kind == "initial"
            else "a number of at least 0, or a pair (low, high) above 0 to find it in"
        )
        raise SpaceError(f"The {kind} level of {name!r} is {level!r}; give {wanted}.")
    if kind == "measurement" and numbers[0] == 0:
        raise SpaceError(
            f"The measurement level of {name!r} is 0; give a standard "
            "deviation above 0, quantum / sqrt(12) for rounding."
        )
