"""Regressions that need instruments and have none: their columns are derivatives of measured signals."""

from collections.abc import Sequence
from typing import Any

from plantfit import units
from plantfit.errors import UnitError
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Model
from plantfit.spec.tables import SpecTable

DERIVED = ("differentiate", "smooth_motion")  # cleaning steps that make derivatives
HOW = (
    'fit it by instrumental variables: a table [regression] with reference = { SIGNAL = "SIGNAL_ref" }, the motion '
    "that the controller "
    "was to follow, and derivatives (docs/regression.md)"
)


def differentiated(table: SpecTable, model: Any) -> tuple[tuple[str, ...], bool]:
    """Signals whose errors stand in the columns of a regression by least squares, and whether the study file makes them
    by differentiation (else they are accelerations of a file, which a sensor may measure)."""
    if not isinstance(model, LinearModel) and not (isinstance(model, Model) and not model.states):
        return (), False
    if table.regression is not None and table.regression.method == "instrumental variables":
        return (), False
    reads = _signals_read(model)
    made = tuple(n for n in reads if n in _derived(table))
    return made or tuple(n for n in reads if _is_acceleration(reads[n])), bool(made)


def missing_instruments(names: Sequence[str], made: bool) -> dict[str, str] | None:
    """What to say of a regression whose columns are derivatives of measured signals (`differentiated`); None where all
    is well."""
    if not names:
        return None
    listed = ", ".join(names)
    if made:
        told = f"The columns of this regression are made of {listed}, derivatives of measured signals"
    else:
        told = f"The columns of this regression hold {listed}, which is made of derivatives unless a sensor measures it"
    return {
        "level": "warning",
        "sentence": f"{told}, so the columns have errors of measurement; least squares then differs from the truth by "
        f"more than "
        "its standard "
        f"errors say. Instead {HOW}.",
        "write": '[regression] method = "instrumental variables"',
    }


def _signals_read(model: LinearModel | Model) -> dict[str, str | None]:
    """Signals by name with their units; of a model of filtered columns those before the filter are not known any
    more."""
    return dict(model.signals) if isinstance(model, LinearModel) else dict(model.inputs)


def _derived(table: SpecTable) -> set[str]:
    """Signals that cleaning steps, or [regression], make by differentiation."""
    found: set[str] = set()
    for r in table.recording.values():
        for step in r.clean:
            if step.get("step") not in DERIVED:
                continue
            if step["step"] == "differentiate":
                found.add(str(step.get("name") or f"{step.get('signal')}{'d' * int(step.get('derivative', 1))}"))
            else:
                found |= {str(step[k]) for k in ("velocity", "acceleration") if k in step}
    if table.regression is not None:
        found |= {n for pair in table.regression.derivatives.values() for n in pair}
    return found


def _is_acceleration(unit: str | None) -> bool:
    if unit is None:
        return False
    try:
        return any(units.compatible(unit, u) for u in ("rad/s^2", "m/s^2"))
    except UnitError:
        return False
