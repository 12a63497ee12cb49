"""Inputs recorded by another clock than the outputs: read earlier or later by a free number of seconds."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from plantfit.errors import ModelError
from plantfit.models.model import Declared, Delay, Model
from plantfit.models.remade import remade


def shift_name(signal: str) -> str:
    """The parameter that holds the shift of a channel (s)."""
    return f"clock_shift_{signal}"


@remade
def with_clock_shift(model: Model, shifts: Mapping[str, tuple[float, float]]) -> Model:
    """The model whose input `name` acts clock_shift_name seconds later than it was recorded, between bounds (low, high)
    s that may be negative: a dead time without the sign of one, with its exact derivative.

    Raises ModelError for a channel that is no input, is delayed already, or bounds that are none.
    """
    for name, bounds in shifts.items():
        model = _shifted(model, name, bounds)
    return model


def _shifted(model: Model, name: str, bounds: Any) -> Model:
    where = f"Model {model.name!r}: clock_shift of {name!r}"
    if name not in model.inputs:
        kind = "an output; shift the inputs against it instead" if name in model.outputs else "no channel of the model"
        raise ModelError(f"{where}, which is {kind}; inputs are {list(model.inputs)}.")
    if any(d.input == name for d in model.delays):
        raise ModelError(
            f"{where}, which has a dead time already; a shift and a "
            "dead time add up to one number, so widen its bounds."
        )
    pair = tuple(bounds) if isinstance(bounds, list | tuple) else ()
    if len(pair) != 2 or not pair[0] < pair[1]:
        raise ModelError(f"{where} is {bounds!r}; write the bounds of the shift in seconds, as in (-0.1, 0.1).")
    parameter, channel = shift_name(name), f"clock_shift({name})"
    if parameter in {p.name for p in model.parameters}:
        raise ModelError(f"{where} needs the name {parameter!r}, which is taken; rename that parameter.")

    def read(function: Any) -> Any:
        return None if function is None else lambda x, u, p: function(x, {**u, name: u[channel]}, p)

    sentence = f"How much later than recorded {name} acts; negative: earlier."
    return replace(
        model,
        parameters=(*model.parameters, Declared(parameter, "s", (float(pair[0]), float(pair[1])), sentence=sentence)),
        delays=(*model.delays, Delay(channel, name, parameter)),
        derivative=read(model.derivative),
        output=read(model.output),
        events=tuple(replace(e, when=read(e.when), then=read(e.then)) for e in model.events),
        frictions=tuple(
            replace(f, sliding=read(f.sliding), breakaway=read(f.breakaway), effect=read(f.effect))
            for f in model.frictions
        ),
        backlashes=tuple(replace(b, drive=read(b.drive), gap=read(b.gap)) for b in model.backlashes),
    )
