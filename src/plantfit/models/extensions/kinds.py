"""The additions to a model by name."""

from collections.abc import Callable
from typing import Literal, NamedTuple

from plantfit.models.extensions import changes, inputs, outputs, parts, states, steps
from plantfit.models.model import Model


class Kind(NamedTuple):
    """An addition: what it is made to (a field of `Model`), how, and its sentence with the signal as {}.

    `make(model, signal, bounds, name)` gives the model with the addition, whose parameter has that name and these
    bounds (low, high). Of "changes" and "parts" the signal is a pair, as in "K with u", of
    "products" as in "y with u and v". `beside` are parameters that come with it,
    as in "creep" for creep_SIGNAL. One `over` "time" is a table, whose nodes (n,) s are given to `make` behind the
    name; one over a "period" gets its length (s) and how many values it has, one over a "moment" the bounds of that
    (low, high) s, which is the parameter KIND_SIGNAL_at.
    """

    to: Literal["inputs", "outputs", "states", "changes", "numbers", "parts", "products"]
    make: Callable[..., Model]
    sentence: str
    beside: tuple[str, ...] = ()
    over: Literal["", "time", "period", "moment"] = ""

    def signals(self, model: Model) -> tuple[str, ...]:
        """What it can be made to in a model."""
        if self.to in _PAIRS:
            return _PAIRS[self.to](model)
        return tuple(getattr(model, self.to))


_PAIRS: dict[str, Callable[[Model], tuple[str, ...]]] = {
    "numbers": steps.numbers_of,
    "changes": changes.changes_of,
    "parts": parts.parts_of,
    "products": parts.products_of,
}


KINDS: dict[str, Kind] = {
    "change": Kind(
        "changes", changes.change, "what a parameter or input is changes with a signal: {}", (changes.REFERENCE,)
    ),
    "start": Kind("states", states.start, "{} begins above its initial value"),
    "viscous": Kind("states", states.viscous, "friction slows {}, in proportion to it"),
    "coulomb": Kind("states", states.coulomb, "dry friction slows {}", ("creep",)),
    "stribeck": Kind("states", states.stribeck, "friction that falls with speed slows {}", ("stribeck_speed", "creep")),
    "quadratic": Kind("states", states.quadratic, "a drag slows {}, with the square of it"),
    "cycle": Kind("states", states.cycle, "what moves {} has a pattern that repeats", over="period"),
    "step": Kind("numbers", steps.parameter, "{} is another one from a moment on", over="moment"),
    "load_step": Kind("states", steps.load, "what moves {} is more or less from a moment on", over="moment"),
    "dead_time": Kind("inputs", inputs.dead_time, "{} acts late"),
    "lag": Kind("inputs", inputs.lag, "{} acts through a lag of first order"),
    "dead_zone": Kind("inputs", inputs.dead_zone, "{} does nothing near zero"),
    "saturation": Kind("inputs", inputs.saturation, "{} does nothing more beyond a size"),
    "backlash": Kind("inputs", inputs.backlash, "{} acts through play"),
    "input_offset": Kind("inputs", inputs.offset, "the sensor of {}, by which the plant is driven, has an offset"),
    "power": Kind("parts", parts.power, "a power of an input is a factor of an output: {}", (changes.REFERENCE,)),
    "proportional": Kind("parts", parts.part("proportional"), "an output has a part in proportion to an input: {}"),
    "square": Kind("parts", parts.part("square"), "an output has a part by the square of an input: {}"),
    "signed_square": Kind(
        "parts", parts.part("signed_square"), "an output has a part by the square of an input, with its sign: {}"
    ),
    "sign": Kind("parts", parts.part("sign"), "an output has a part by the sign of an input: {}"),
    "product": Kind("products", parts.part("product"), "an output has a part by the product of two inputs: {}"),
    "sensor_lag": Kind("outputs", outputs.sensor_lag, "the sensor of {} is a lag of first order"),
    "offset": Kind("outputs", outputs.offset, "the sensor of {} has an offset"),
    "drift": Kind("outputs", outputs.drift, "the sensor of {} drifts"),
    "slow_drift": Kind("outputs", outputs.slow_drift, "the sensor of {} drifts along a curve in time", over="time"),
    "sensor_cycle": Kind("outputs", outputs.cycle, "the sensor of {} has an error that repeats", over="period"),
    "sensor_step": Kind("outputs", steps.sensor, "the sensor of {} shows more or less from a moment on", over="moment"),
    "sensor_high": Kind("outputs", outputs.sensor_high, "the sensor of {} ends above"),
    "sensor_low": Kind("outputs", outputs.sensor_low, "the sensor of {} ends below"),
}
"""In the order in which they are made: dynamics of the plant, what is before it, what is behind it."""


def brought(kind: str, signal: str) -> tuple[str, ...]:
    """All parameters that an addition brings, also those of a package."""
    own = KINDS.get(kind)
    names = [parameter_name(part, signal) for part in (kind, *(own.beside if own else ()))]
    return (*names, *([steps.moment_of(names[0])] if own is not None and own.over == "moment" else ()))


def parameter_name(kind: str, signal: str) -> str:
    """The parameter that an addition brings, and any beside it."""
    return f"{kind}_{signal.replace(' ', '_')}"
