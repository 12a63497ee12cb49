"""The study file of a plant that is known by its parts or from the library."""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from plantfit.cli.commands.begin.study_text import quoted

if TYPE_CHECKING:
    from plantfit.models.model import Model
    from plantfit.models.networks.network import Network

_HEAD = """\
# A study for plantfit, made by `plantfit new {words}`. Run it with:  plantfit run {spec}
name = {name}

# ---- what is measured ------------------------------------------------------------------------
[recording.data]
file = {file}
{clock}
signals = {{ {signals} }}
{units}split = 0.7            # the first 70 % are fitted, the rest shows whether the model holds
{before}
# ---- how the plant works ---------------------------------------------------------------------
"""
_TAIL = """\

# ---- how to search ---------------------------------------------------------------------------
[search]
methods = ["auto"]     # more, to compare: ["auto", "cmaes", "pso"]; see `plantfit methods`
seed = 1
"""


@dataclass(frozen=True)
class Plant:
    """Inputs and outputs with their units, and the text of [model] and [parameters]."""

    inputs: Mapping[str, str | None]
    outputs: Mapping[str, str | None]
    text: str


@dataclass(frozen=True)
class Measurements:
    """The recording of a study: its file as the study sees it, the line of the clock, columns by signal, units of
    those without one."""

    file: str
    clock: str
    columns: Mapping[str, str]
    units: Mapping[str, str] = field(default_factory=dict)


def expected(plant: Plant, file: str) -> Measurements:
    """A recording that is still to be made: the columns that it shall have."""
    signals = {**plant.inputs, **plant.outputs}
    return Measurements(
        file, 'time = "t [s]"', {s: f"{s} [{u}]" if u not in (None, "1") else s for s, u in signals.items()}
    )


def study(plant: Plant, measured: Measurements, name: str, words: str, spec: str) -> str:
    """The text of the study file, which `plantfit new` with these `words` writes to `spec`."""
    first = next(iter(plant.inputs), "")
    before = (
        f"# before = {{ {first} = 0.0 }}    # inputs before the first "
        "sample, where they were others than the first values\n"
    )
    return _HEAD.format(
        words=words, spec=spec, name=quoted(name), file=quoted(measured.file), clock=measured.clock,
        signals=", ".join(f"{s} = {quoted(c)}" for s, c in measured.columns.items()),
        units=f"units = {_table(measured.units)}    # of columns whose header gives none\n" if measured.units else "",
        before=before if first else "",
    ) + plant.text.rstrip("\n") + "\n" + _TAIL  # fmt: skip


def of_network(network: "Network", parts: str) -> Plant:
    """A network as its equations; `parts` is the list that it was made of."""
    lines = network.equations.splitlines()
    wide = min(max(map(len, lines)), 60)
    told = [
        f"{line:<{wide}}    # {said}" if (said := network.sentences.get(line.partition(" = ")[0].rstrip("'"))) else line
        for line in lines
    ]
    text = "# Its parts; after a change of them write the file anew, or change the equations:\n"
    text += "".join(f"#   {line.rstrip()}\n" for line in parts.strip("\n").split("\n"))
    text += '[model]\nequations = """\n' + "\n".join(told) + '\n"""\n'
    text += f"inputs = {_table(network.inputs)}\n"
    states = ", ".join(
        f"{s} = {{ unit = {quoted(e['unit'])}, initial = {_value(e['initial'])} }}" for s, e in network.states.items()
    )
    text += f"states = {{ {states} }}\noutputs = {_table(network.outputs)}\n"
    text += f"constants = {_table(network.constants)}\n" if network.constants else ""
    text += "\n# ---- what is unknown, and within which bounds; `value = ...` holds what you know ---------------\n"
    return Plant(network.inputs, network.outputs, text + _parameters(network.parameters))


def of_library(name: str, model: "Model", options: Mapping[str, Any]) -> Plant:
    """A model of the library with its own bounds."""
    text = f'[model]\nkind = "{name}"\n'
    if options:
        listed = ", ".join(f"{o} = {_value(v)}" for o, v in options.items() if isinstance(v, bool | str | int | float))
        text += "".join(
            f"{line}\n"
            for line in textwrap.wrap(f"options = {{ {listed} }}", 120, initial_indent="# ", subsequent_indent="#   ")
        )
        text += f"# these are the defaults; `plantfit models {name}` tells what they do\n"
    text += "\n# ---- what is unknown, and within which bounds; `value = ...` holds what you know ---------------\n"
    entries = {
        p.name: {"bounds": p.bounds, "unit": p.unit, "scale": p.scale, "sentence": p.sentence, "value": p.value}
        for p in model.parameters
    }
    return Plant(model.inputs, model.outputs, text + _parameters(entries))


def _parameters(entries: Mapping[str, Mapping[str, Any]]) -> str:
    text = ""
    for name, entry in entries.items():
        known = entry.get("value") is not None
        lines = [f"[parameters.{name}]"]
        lines.append(
            f"value = {_value(entry['value'])}" if known else f"bounds = [{', '.join(map(_value, entry['bounds']))}]"
        )
        lines += ['scale = "log"'] * (not known and entry.get("scale") == "log")
        lines += [f"{key} = {quoted(entry[key])}" for key in ("unit", "sentence") if entry.get(key)]
        text += "\n".join(lines) + "\n\n"
    return text


def _table(entries: Mapping[str, Any]) -> str:
    return "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in entries.items()) + " }" if entries else "{}"


def _value(value: Any) -> str:
    """A value as TOML has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_value, value))}]"
    return f"{value:.6g}" if isinstance(value, int | float) else quoted(str(value))
