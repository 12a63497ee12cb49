"""Units that stand beside a model of equations: those that a problem gives to its parameters, and those of
recordings."""

from collections.abc import Callable, Mapping

from plantfit import units
from plantfit.errors import UnitError
from plantfit.models.check_model import check_dead_time
from plantfit.models.model import Model
from plantfit.models.text.dimensions.contradictions import other_time, with_seconds

_CHECK = "_units_said_later"  # no field: a copy made by `dataclasses.replace` is another model


def check_said_later(model: Model, parameters: Mapping[str, str | None], recorded: Mapping[str, str]) -> None:
    """Check units of parameters, and recorded units of signals, that the model has without unit: dead times are in s,
    equations agree.

    Of a model that is not of equations nothing is known but that its times are in s.

    Raises UnitError and EquationError.
    """
    for name in {d.parameter for d in (*model.delays, *model.state_delays)} & parameters.keys():
        check_dead_time(f"Model {model.name!r}", name, parameters[name])
    new = {p.name: unit for p in model.parameters if p.unit is None and (unit := parameters.get(p.name)) is not None}
    check = getattr(model, _CHECK, None)
    if check is not None:
        check(new, recorded)
        return
    for name, unit in new.items():
        units.parse(unit)
        if other_time(unit):
            raise UnitError(
                f"Parameter {name!r} is given in {unit!r}, but the model has no unit for it, "
                f"and computes with time in s; give its numbers in {with_seconds(unit)!r}."
            )


def checked_later(model: Model, check: Callable[[Mapping[str, str], Mapping[str, str]], None]) -> Model:
    """The model, which `check_said_later` checks by a function of units of parameters and of recorded signals."""
    object.__setattr__(model, _CHECK, check)
    return model
