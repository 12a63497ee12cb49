"""Units that a problem gives to parameters which its model left without one."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from plantfit.models.check_model import check_dead_time
from plantfit.models.model import Declared, Model
from plantfit.models.remade import remade_with


def check_said_later(model: Model, said: Mapping[str, str | None]) -> None:
    """Check them as the model checks its own: dead times are in s, equations agree.

    Raises UnitError and EquationError.
    """
    for name in {d.parameter for d in (*model.delays, *model.state_delays)} & said.keys():
        check_dead_time(f"Model {model.name!r}", name, said[name])
    new = {p.name: replace(p, unit=said[p.name]) for p in model.parameters if p.unit is None and said.get(p.name) is not None}
    if new and model.text is not None:
        remade_with(model, "parameters", lambda given: _named(given) | {n: p for n, p in new.items() if not p.shape})


def _named(given: Any) -> dict[str, Any]:
    """Declarations by name, of a table or a list as `equations` takes them."""
    if isinstance(given, Mapping):
        return dict(given)
    return {getattr(entry, "name", entry): entry if isinstance(entry, Declared) else None for entry in given or ()}
