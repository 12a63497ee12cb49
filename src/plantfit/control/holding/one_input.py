"""A model of several inputs as one that a regulator drives by one of them."""

from collections.abc import Mapping
from dataclasses import replace

from plantfit.models.model import Model, Named


def driven_by(model: Model, input_: str, others: Mapping[str, float]) -> Model:
    """The model with `input_` alone; `others` are held at their values by name, in the units of the model."""

    def derivative(x: Named, u: Named, p: Named) -> Named:
        assert model.derivative is not None
        return model.derivative(x, {**others, **u}, p)

    def output(x: Named, u: Named, p: Named) -> Named:
        return model.output(x, {**others, **u}, p)

    if not others:
        return model
    return replace(
        model, inputs={input_: model.inputs[input_]}, derivative=derivative if model.states else None, output=output,
        initial_state=None, text=None,
    )  # fmt: skip
