"""A static curve that is linear in its parameters, as a regression."""

from collections.abc import Mapping
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Model
from plantfit.models.remade import remade

ROUNDING = 1e-9  # relative size of a difference that rounding explains


@remade
def as_regression(model: Model) -> LinearModel:
    """The same equations as columns: output = sum of parameter * column, where column is the output per unit of that
    parameter.

    Raises ModelError for a model with states, with tables, and for one that is not linear in its parameters or has a
    part without any.
    """
    if model.states:
        raise ModelError(f"{model.name!r} has states and is simulated; a regression has equations of outputs alone.")
    arrays = [p.name for p in model.parameters if p.shape]
    if arrays or not model.parameters:
        what = f"the table {arrays[0]!r}" if arrays else "no parameter"
        raise ModelError(f"{model.name!r} has {what}; a regression has one number for each column.")
    names = [p.name for p in model.parameters]

    def value(signals: Mapping[str, Any], values: Mapping[str, float]) -> dict[str, np.ndarray]:
        shape = np.shape(next(iter(signals.values())))
        made = model.output({}, signals, values)
        return {o: np.broadcast_to(np.asarray(made[o], dtype=float), shape) for o in model.outputs}

    def regressor(signals: Mapping[str, Any]) -> dict[str, np.ndarray]:
        read = {n: np.asarray(signals[n], dtype=float) for n in model.inputs}
        zero = value(read, dict.fromkeys(names, 0.0))
        units = [value(read, {**dict.fromkeys(names, 0.0), n: 1.0}) for n in names]
        columns = {o: np.stack([u[o] - zero[o] for u in units], axis=-1) for o in model.outputs}
        some = np.random.default_rng(0).uniform(0.5, 2.0, len(names))
        mixed = value(read, dict(zip(names, some, strict=True)))
        for o, own in columns.items():
            if np.any(zero[o] != 0.0) or not np.all(np.isfinite(own)):
                raise ModelError(
                    f"{model.name!r}: with all parameters 0 {o!r} is not 0, so it is no sum of parameters "
                    "times columns; write the part that is known into the target of the regression."
                )
            size = np.max(np.abs(own) @ some, initial=0.0)
            if np.max(np.abs(mixed[o] - own @ some), initial=0.0) > ROUNDING * size:
                raise ModelError(
                    f"{model.name!r}: {o!r} is not linear in {', '.join(names)}; "
                    "write it with one parameter for each column."
                )
        return columns

    return LinearModel(
        name=model.name,
        outputs=model.outputs,
        parameters=model.parameters,
        regressor=regressor,
        signals=dict(model.inputs),
        sentence=model.sentence,
        source=model.source,
    )
