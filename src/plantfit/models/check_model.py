"""Whether what a model declares beside its equations fits its states, inputs and parameters."""

from collections.abc import Collection
from typing import Any

from plantfit import units
from plantfit.errors import ModelError, UnitError

_DIRECTIONS = ("falling", "rising", "both")


def check_declared(model: Any) -> None:
    """Check a `Model` as it is made.

    Raises ModelError for delays, events, frictions, backlashes and tables that name what the model does not have.
    """
    where = f"Model {model.name!r}"
    _check_delays(where, model)
    for event in model.events:
        if event.direction not in _DIRECTIONS:
            raise ModelError(
                f"{where}: event {event.name!r} has direction {event.direction!r}; use one of {list(_DIRECTIONS)}."
            )
        if not model.states:
            raise ModelError(f"{where} has the event {event.name!r} but no states that could jump; declare states.")
    for kind, names in (
        ("friction", [f.velocity for f in model.frictions]),
        ("backlash", [b.state for b in model.backlashes]),
        ("event", [e.name for e in model.events]),
    ):
        if kind != "event":
            for name in names:
                _check_known(f"{where}: {kind} acts on {name!r}", name, "states", model.states)
        _check_once(where, kind, names)
    both = sorted({f.velocity for f in model.frictions} & {b.state for b in model.backlashes})
    if both:
        raise ModelError(
            f"{where}: state {both[0]!r} has friction and backlash; backlash alone gives its value, so drop one."
        )
    _check_tables(where, model)


def _check_delays(where: str, model: Any) -> None:
    known = [p.name for p in model.parameters if not p.shape]
    for delay in model.delays:
        _check_known(f"{where} delays {delay.input!r}", delay.input, "inputs", model.inputs)
        # dead time over the input itself, see simulate.dead_time
        tables = [t.name for t in model.tables if t.over == (delay.input,)]
        _check_known(f"{where} delays by {delay.parameter!r}", delay.parameter, "parameters", [*known, *tables])
    for late in model.state_delays:
        _check_known(f"{where} delays the state {late.state!r}", late.state, "states", model.states)
        _check_known(f"{where} delays by {late.parameter!r}", late.parameter, "parameters", known)
        if late.state in {b.state for b in model.backlashes}:
            raise ModelError(
                f"{where} delays {late.state!r}, which follows with backlash; delay what drives it instead."
            )
    for name in sorted(
        {d.parameter for d in (*model.delays, *model.state_delays)} & {p.name for p in model.parameters}
    ):
        check_dead_time(where, name, model.declared(name).unit)
    channels = [*model.inputs, *(d.channel for d in (*model.delays, *model.state_delays)), "t"]
    _check_once(where, "channel", channels)


def check_dead_time(where: str, name: str, unit: str | None) -> None:
    """A dead time counts in seconds, whatever its unit says; a number without unit is one."""
    if unit is not None and not any(units.equal(unit, own) for own in ("s", "1")):
        raise UnitError(
            f"{where}: the dead time {name!r} has the unit {unit!r}, but dead times are in s; give its numbers in s."
        )


def _check_tables(where: str, model: Any) -> None:
    shapes = {p.name: p.shape for p in model.parameters}
    _check_once(where, "table", [table.name for table in model.tables])
    for table in model.tables:
        _check_known(f"{where} has the table {table.name!r}", table.name, "parameters", shapes)
        if shapes[table.name] != table.shape:
            raise ModelError(
                f"{where}: table {table.name!r} has nodes of shape {table.shape}, but its parameter has shape "
                f"{shapes[table.name]}; "
                "declare the parameter with shape = table.shape."
            )


def _check_known(what: str, name: str, kind: str, known: Collection[str]) -> None:
    if name not in known:
        raise ModelError(f"{what}, which is not one of its {kind} {sorted(known)}.")


def _check_once(where: str, kind: str, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"{where}: the {kind} {name!r} is declared twice; keep one.")
