"""The additions by name, and a model with some of them."""

from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

from plantfit.errors import ModelError
from plantfit.models.extensions import inputs, outputs, states
from plantfit.models.model import Model
from plantfit.models.remade import remade
from plantfit.models.text.suggest import suggest


class Kind(NamedTuple):
    """An addition: what it is made to (a field of `Model`), how, and its sentence with the signal as {}."""

    to: Literal["inputs", "outputs", "states"]
    make: Callable[[Model, str, tuple[float, float], str], Model]
    sentence: str


KINDS: dict[str, Kind] = {
    "start": Kind("states", states.start, "{} begins above its initial value"),
    "coulomb": Kind("states", states.coulomb, "dry friction slows {}"),
    "quadratic": Kind("states", states.quadratic, "a drag slows {}, with the square of it"),
    "dead_time": Kind("inputs", inputs.dead_time, "{} acts late"),
    "lag": Kind("inputs", inputs.lag, "{} acts through a lag of first order"),
    "dead_zone": Kind("inputs", inputs.dead_zone, "{} does nothing near zero"),
    "saturation": Kind("inputs", inputs.saturation, "{} does nothing more beyond a size"),
    "backlash": Kind("inputs", inputs.backlash, "{} acts through play"),
    "sensor_lag": Kind("outputs", outputs.sensor_lag, "the sensor of {} is a lag of first order"),
    "offset": Kind("outputs", outputs.offset, "the sensor of {} has an offset"),
    "drift": Kind("outputs", outputs.drift, "the sensor of {} drifts"),
    "sensor_high": Kind("outputs", outputs.sensor_high, "the sensor of {} ends above"),
    "sensor_low": Kind("outputs", outputs.sensor_low, "the sensor of {} ends below"),
}
"""In the order in which they are made: dynamics of the plant, what is before it, what is behind it."""


def parameter_name(kind: str, signal: str) -> str:
    """The parameter that an addition brings."""
    return f"{kind}_{signal}"


@remade
def with_extensions(model: Model, given: Mapping[str, Mapping[str, tuple[float, float]]]) -> Model:
    """The model with additions: kind -> signal -> bounds (low, high) of the parameter KIND_SIGNAL, in the order of `KINDS`.

    Dry friction brings the parameter creep_SIGNAL, too, whose value the study must give. Raises ModelError for a kind, signal or bounds
    that cannot be, and for a dead time of an input that has one already.
    """
    where = f"Model {model.name!r}: extensions"
    for kind in given:
        if kind not in KINDS:
            raise ModelError(f"{where} name {kind!r}.{suggest(kind, KINDS)} Known are {', '.join(KINDS)}.")
    for kind, made in KINDS.items():
        for signal, bounds in given.get(kind, {}).items():
            known = getattr(model, made.to)
            if signal not in known:
                raise ModelError(f"{where} give {kind} to {signal!r}, which is not one of its {made.to} {list(known)}.")
            if kind == "dead_time" and any(d.input == signal for d in model.delays):
                raise ModelError(f"{where} give {signal!r} a dead time, and it has one already; widen the bounds of that one.")
            model = made.make(model, signal, _pair(f"{where}: {kind} of {signal!r}", bounds), parameter_name(kind, signal))
    return model


def _pair(what: str, bounds: Any) -> tuple[float, float]:
    pair = tuple(bounds) if isinstance(bounds, list | tuple) else ()
    if len(pair) != 2 or not all(isinstance(b, int | float) and not isinstance(b, bool) for b in pair) or not pair[0] < pair[1]:
        raise ModelError(f"{what} is {bounds!r}; write the bounds of its parameter, as in [0, 1].")
    return float(pair[0]), float(pair[1])
