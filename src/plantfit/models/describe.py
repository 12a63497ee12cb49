"""A model as a table of plain text."""

import numpy as np

from plantfit.models.library import catalogue as library
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Declared, Model

Row = tuple[str, str, str, str, str]

_HEAD: Row = ("kind", "name", "unit", "range", "meaning")


def describe(model: str | Model | LinearModel) -> str:
    """States, inputs, outputs and parameters of a model, one a line under a head; ends without a newline.

    Of a name the library model with its source and options before them; raises ModelError for an unknown one.
    """
    if isinstance(model, str):
        return f"{library.listed(model).describe()}\n\n{_table(library.make(model))}"
    return _table(model)


def _table(model: Model | LinearModel) -> str:
    rows = [_HEAD, *_rows(model)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(_HEAD))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    title = f"{model.name}: {model.sentence}" if model.sentence else model.name
    return "\n".join([title, *lines])


def _rows(model: Model | LinearModel) -> list[Row]:
    signals = {"state": model.states, "input": model.inputs} if isinstance(model, Model) else {"signal": model.signals}
    rows: list[Row] = []
    for kind, names in {**signals, "output": model.outputs}.items():
        rows += [(kind, name, _unit(unit), "", "") for name, unit in names.items()]
    if isinstance(model, Model):
        rows += [
            ("delay", d.channel, _unit(model.inputs[d.input]), "", f"{d.input} delayed by {d.parameter}")
            for d in model.delays
        ]
        rows += [
            ("delay", d.channel, _unit(model.states[d.state]), "", f"{d.state} delayed by {d.parameter}")
            for d in model.state_delays
        ]
        rows += [("event", e.name, "", "", f"states jump ({e.direction})") for e in model.events]
        rows += [("friction", f.velocity, "", "", "dry friction that sticks") for f in model.frictions]
        rows += [("backlash", b.state, "", "", "follows with play") for b in model.backlashes]
    rows += [("parameter", p.name, _unit(p.unit), _range(p), p.sentence) for p in model.parameters]
    return rows


def _unit(unit: str | None) -> str:
    return "?" if unit is None else unit or "1"


def _range(p: Declared) -> str:
    entries = f"{' x '.join(map(str, p.shape))} values, " if p.shape else ""
    if p.value is not None:
        return f"{entries}= {_span(np.min(p.value), np.max(p.value))}"
    if p.bounds is None:
        return f"{entries}to be given"
    return f"{entries}{np.min(p.bounds[0]):g} to {np.max(p.bounds[1]):g}" + (" (log)" if p.scale == "log" else "")


def _span(low: float, high: float) -> str:
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
