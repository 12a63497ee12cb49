"""The text of a first study file: linear models between the inputs and outputs of a recording, with comments and
bounds from the data."""

import json as encoder
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from plantfit.recording.readers.columns import split_header

if TYPE_CHECKING:
    from plantfit.recording.description import Description

Kind = Literal["first", "dead_time", "second", "integrating", "line", "parabola"]
WORDS: dict[Kind, str] = {
    "first": "first order",
    "dead_time": "first order with dead time",
    "second": "second order (two lags) with dead time",
    "integrating": "first order in the rate, which the output sums up, with dead time",
}
# of rows that are no motion
AT_REST: dict[Kind, str] = {
    "line": "a straight line of the inputs, without dynamics",
    "parabola": "a parabola in every input, without dynamics",
}

HEAD = """\
# A study for plantfit, made by `plantfit init {source}`. Run it with:  plantfit run {spec}
# Its model is of {words}: a start that runs. Change the equations to your plant;
# `plantfit check {spec}` tells what it understands.

name = {name}

# ---- what was measured ----------------------------------------------------------------------
# Columns of the file:
{columns}
[recording.data]
file = {path}
{time}
signals = {{ {signals} }}
{units}{split}"""
SPLIT = "split = 0.7            # the first 70 % are fitted, the rest shows whether the model holds\n"
SEARCH = """\
# ---- how to search ---------------------------------------------------------------------------
[search]
methods = ["auto"]     # more, to compare: ["auto", "cmaes", "pso"]; see `plantfit methods`
runs = 1
seed = 1
"""
_MIDDLE = """\
# before = {{ {input} = {first:.4g} }}    # the input before the first sample, if it differed from the first value
# skip = 0.0           # seconds at the start of each part that are simulated but not scored
{clean} = [{{ step = "drop_outliers", signal = "{output}", window = 11, threshold = 4.0 }},
#          {{ step = "fill_gaps", signal = "{input}", longest = {gap:.3g} }}]

# ---- how the plant works --------------------------------------------------------------------
# Library models instead: kind = "dc_motor" (see `plantfit models`).
[model]
equations = \"\"\"
{equations}
\"\"\"
inputs = {{ {inputs} }}
states = {{ {states} }}
outputs = {{ {outputs} }}

# ---- what is unknown, and within which bounds --------------------------------------------------
{parameters}
# ---- what the instruments may be wrong by: intervals allow for it (docs/study-file.md) ------------
# [uncertainty.sensor]
# of = "{output}"
# kind = "gain"          # of the reading; or "offset", "zero", "full scale"
# limit = 1.0            # half width from the data sheet
# unit = "%"

"""


AWAY = 0.1  # of the range of an input: farther from zero it has not been there


@dataclass(frozen=True)
class Signal:
    """A column as a signal of the study: `symbol` in the equations, its header, unit, extremes and first value.

    `named` where the unit is the end of its name, `gaps` where cells hold no number. `of` a column without sign and the
    one that gives it its sign, where it is made of both.
    """

    symbol: str
    header: str
    unit: str | None
    low: float
    high: float
    first: float
    named: bool = False
    gaps: bool = False
    of: "tuple[Signal, Signal] | None" = None

    @property
    def told(self) -> str:
        """Its name as the user knows it: that of its column, with the symbol where the file has another one."""
        own = split_header((self.of[0] if self.of else self).header)[0]
        same = own.replace(" ", "_") == self.symbol.removesuffix("_signed" if self.of else "")
        whole = self.header if self.of else own
        return self.symbol if same else f"{whole!r} ({self.symbol} in the study file)"

    @property
    def read(self) -> "tuple[Signal, ...]":
        """The columns that it is read from."""
        return self.of or (self,)


@dataclass(frozen=True)
class Link:
    """An output and the inputs that it answers to."""

    output: Signal
    inputs: tuple[Signal, ...]


def study_text(
    kind: Kind, links: Sequence[Link], source: str, path: str, spec: str, name: str, columns: Sequence[str], time: str,
    period: float,
    duration: float, split: str = SPLIT,
) -> str:  # fmt: skip
    """A study file of one model of `kind` for each output.

    `path` is that of the recording as the file sees it, `time` the line of its clock, `columns` what is told of each
    column; `period` and `duration` are in s.
    """
    inputs = list({s.symbol: s for link in links for s in link.inputs}.values())
    outputs = [link.output for link in links]
    plants = [
        _Plant(kind, link, str(k) if len(links) > 1 else "", inputs, period, duration)
        for k, link in enumerate(links, 1)
    ]
    states = [(x, p) for p in plants for x in p.states]
    bare = not any(s.unit for s in (*inputs, *outputs))
    read = list({s.symbol: s for made in (*inputs, *outputs) for s in made.read}.values())
    # an input needs a value everywhere
    steps = [
        f'{{ step = "fill_gaps", signal = "{c.symbol}", longest = {5 * period:.3g}, method = "previous" }}'
        for u in inputs
        for c in u.read
        if c.gaps
    ]
    steps += [
        f'{{ step = "signed", signal = "{u.of[0].symbol}", direction = "{u.of[1].symbol}", name = "{u.symbol}" }}'
        for u in inputs
        if u.of
    ]
    middle = (
        _MIDDLE
        if kind not in AT_REST
        else _MIDDLE[_MIDDLE.index("\n# ---- how the plant") :].replace("states = {{ {states} }}\n", "")
    )
    return (HEAD + middle + SEARCH).format(
        source=" ".join(source.split()), spec=" ".join(spec.split()), words=(WORDS | AT_REST)[kind], name=quoted(name),
        path=quoted(path),
        time=time, split=split, gap=5 * period,
        columns="".join(f"#   {c}\n" for c in columns),
        signals=", ".join(f"{s.symbol} = {quoted(s.header)}" for s in read),
        units=_units([s for s in read if s.named], bare)
        + (f"clean = [{', '.join(steps)}]\n" if steps else ""),
        clean="# further steps of clean" if steps else "# clean",
        input=inputs[0].symbol, first=inputs[0].first, output=outputs[0].symbol,
        equations="\n".join(line for p in plants for line in p.equations),
        inputs=", ".join(f"{s.symbol} = {quoted(s.unit or '1')}" for s in inputs),
        outputs=", ".join(f"{s.symbol} = {quoted(s.unit or '1')}" for s in outputs),
        states=", ".join(p.state(x) for x, p in states),
        parameters="".join(p.parameters for p in plants),
    )  # fmt: skip


def quoted(text: str) -> str:
    """A text as TOML has it."""
    return encoder.dumps(text, ensure_ascii=False)


def clock_line(found: "Description") -> str:
    """The line of the time in a study file."""
    if found.time is not None:
        order = ""
        if found.dates is not None:
            order = f"\ndates = {quoted(found.dates)}".ljust(23) + " # of day and month, as --dates says"
        return f"time = {quoted(found.time)}{order}"
    return f"period = {found.period or 1.0:.9g}".ljust(22) + (
        " # seconds between rows, from the file" if found.period else _NO_TIME
    )


_NO_TIME = " # seconds between rows: no time column was found, put yours"


class _Plant:
    """One output's equations and parameters; with several outputs these carry its `number`, and gains that of the
    input too, as in K12."""

    def __init__(
        self, kind: Kind, link: Link, number: str, inputs: Sequence[Signal], period: float, duration: float
    ) -> None:
        self.link, self.kind, self.number, self.period, self.duration = link, kind, number, period, duration
        places = [str(inputs.index(u) + 1) if len(inputs) > 1 else "" for u in link.inputs]
        self.gains = [f"K{number}{place}" for place in places]
        self.squares = [f"bend{number}{place}" for place in places] if kind == "parabola" else []

    @property
    def states(self) -> list[str]:
        if self.kind in AT_REST:
            return []
        return [f"{n}{self.number}" for n in {"second": ("z", "x"), "integrating": ("v", "x")}.get(self.kind, ("x",))]

    def state(self, name: str) -> str:
        """The entry of a state: a rate begins at 0, any other where the output does."""
        y, rate = self.link.output, name == f"v{self.number}" and self.kind == "integrating"
        unit = _ratio(y.unit, "s") if rate else y.unit
        begins = "0.0" if rate else f'"{self.start}"'
        return f"{name} = {{ unit = {quoted(unit or '1')}, initial = {begins} }}"

    @property
    def start(self) -> str:
        return f"start{self.number}"

    @property
    def equations(self) -> list[str]:
        late = [
            u.symbol if self.kind in ("first", *AT_REST) else f"delay({u.symbol}, L{self.number})"
            for u in self.link.inputs
        ]
        own = "drift" if self.kind == "integrating" else "rest"
        goal = " + ".join([*(f"{k}*{u}" for k, u in zip(self.gains, late, strict=True)), f"{own}{self.number}"])
        x, y = f"x{self.number}", self.link.output.symbol
        if self.kind in AT_REST:
            squares = [f"{q}*{u.symbol}^2" for q, u in zip(self.squares, self.link.inputs, strict=False)]
            return [f"{y} = {' + '.join([goal, *squares])}"]
        if self.kind == "second":
            z = f"z{self.number}"
            return [f"{z}' = ({goal} - {z}) / tau{self.number}", f"{x}' = ({z} - {x}) / lag{self.number}", f"{y} = {x}"]
        if self.kind == "integrating":
            v = f"v{self.number}"
            return [f"{v}' = ({goal} - {v}) / tau{self.number}", f"{x}' = {v}", f"{y} = {x}"]
        return [f"{x}' = ({goal} - {x}) / tau{self.number}", f"{y} = {x}"]

    @property
    def parameters(self) -> str:
        y, sums = self.link.output, self.kind == "integrating"
        span, reach = y.high - y.low, 0.0
        # of an output that sums up: the rate by which it would pass its range in five samples
        moved = span / (5 * self.period) if sums else span
        unit = _ratio(y.unit, "s") if sums else y.unit
        text = ""
        for name, u in zip(self.gains, self.link.inputs, strict=True):
            wide = u.high - u.low
            far = max(abs(u.low), abs(u.high)) / wide
            gain = (1 if sums else 20) * moved / wide * (1 + 4 * far * bool(self.squares))
            reach = max(reach, far)
            what = "rate" if sums else "slope" if self.kind in AT_REST else "static gain"
            text += _parameter(name, f"{what} from {u.symbol} to {y.symbol}", -gain, gain, _ratio(unit, u.unit))
        for name, u in zip(self.squares, self.link.inputs, strict=False):  # none of a line
            bend = 80 * moved / (u.high - u.low) ** 2
            squared = f"({u.unit})^2" if u.unit else None
            text += _parameter(name, f"bend of {y.symbol} over {u.symbol}", -bend, bend, _ratio(unit, squared))
        room = moved * (1 + 5 * reach * (1 + 4 * reach * bool(self.squares)))
        if sums:
            told = f"rate of {y.symbol} without input{self._beyond()}"
            text += _parameter(f"drift{self.number}", told, -room, room, unit)
        else:
            told = f"where {y.symbol} rests without input{self._beyond()}"
            text += _parameter(f"rest{self.number}", told, y.low - room, y.high + room, y.unit)
        if self.kind in AT_REST:
            return text
        # a parameter holds also where the first value is missing or wrong
        text += _parameter(self.start, f"{y.symbol} at the first sample", y.first - span, y.first + span, y.unit)
        for name in [f"tau{self.number}", *([f"lag{self.number}"] if self.kind == "second" else [])]:
            of = f"the rate of {y.symbol}" if sums else y.symbol
            text += _parameter(name, f"time constant of {of}", self.period / 5, self.duration, "s", log=True)
        if self.kind != "first":
            text += _parameter(
                f"L{self.number}", f"dead time of {y.symbol}", 0.0, max(self.duration / 20, 5 * self.period), "s"
            )
        return text

    def _beyond(self) -> str:
        """That no input came near zero, so that a rest without input is what the straight line says there."""
        away = [
            u
            for u in self.link.inputs
            if not u.low <= 0.0 <= u.high and min(abs(u.low), abs(u.high)) > AWAY * (u.high - u.low)
        ]
        told = [
            f"{u.symbol} was never {'below' if u.low > 0 else 'above'} "
            f"{u.low if u.low > 0 else u.high:.4g} {u.unit or ''}".strip()
            for u in away
        ]
        return f" (an extrapolation: {' and '.join(told)})" if told else ""


def _units(named: Sequence[Signal], bare: bool) -> str:
    """The line of units that no header gives in brackets."""
    if named:
        table = ", ".join(f"{s.symbol} = {quoted(s.unit or '1')}" for s in named)
        return f"units = {{ {table} }}    # by the names of the columns: correct them\n"
    return "# units = { ... }      # for columns whose header gives none\n" if bare else ""


def _parameter(name: str, told: str, low: float, high: float, unit: str | None, log: bool = False) -> str:
    lines = [f"[parameters.{name}]", f"bounds = [{low:.4g}, {high:.4g}]"]
    lines += ['scale = "log"'] * log + ([f"unit = {quoted(unit)}"] if unit else []) + [f"sentence = {quoted(told)}"]
    return "\n".join(lines) + "\n\n"


def _ratio(over: str | None, under: str | None) -> str | None:
    def part(unit: str, below: bool) -> str:
        return f"({unit})" if any(c in unit for c in ("*/ " if below else " ")) else unit

    if over and under:
        return None if over == under else f"{part(over, False)}/{part(under, True)}"
    return part(over, False) if over else f"1/{part(under, True)}" if under else None
