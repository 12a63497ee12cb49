"""`plantfit init`: look at a recording and write a commented study file that runs."""

import json as encoder
import os
from pathlib import Path

from plantfit.cli.terminal.out import out, print_json
from plantfit.errors import PlantfitError, RecordingError, SpecError

TEMPLATE = """\
# A study for plantfit, made by `plantfit init {file}`. Run it with:  plantfit run {spec}
# It holds a first-order model with dead time between one input and one output: a start that runs.
# Change the equations to your plant; `plantfit check {spec}` tells what it understands.

name = {name}

# ---- what was measured ----------------------------------------------------------------------
# Columns of the file:
{columns}
[recording.data]
file = {path}
{time}signals = {{ {input} = {input_header}, {output} = {output_header} }}
{units}split = 0.7            # the first 70 % are fitted, the rest shows whether the model holds
# skip = 0.0           # seconds at the start of each part that are simulated but not scored
# clean = [{{ step = "drop_outliers", signal = "{output}", window = 11, threshold = 4.0 }},
#          {{ step = "fill_gaps", signal = "{input}", longest = {gap:.3g} }}]

# ---- how the plant works --------------------------------------------------------------------
# Library models instead: kind = "dc_motor" (see `plantfit models`).
[model]
equations = \"\"\"
x' = (K * (delay({input}, L) - {input}0) - x) / tau
{output} = x
\"\"\"
inputs = {{ {input} = {input_unit} }}
states = {{ x = {{ unit = {output_unit}, initial = "{output}" }} }}     # starts at the first measured value
outputs = {{ {output} = {output_unit} }}

# ---- what is unknown, and within which bounds --------------------------------------------------
[parameters.K]         # static gain
bounds = [{k_low:.3g}, {k_high:.3g}]
{k_unit}
[parameters.{input}0]        # input at which the output rests at zero
bounds = [{u_low:.4g}, {u_high:.4g}]
{u_unit}
[parameters.tau]       # time constant
bounds = [{tau_low:.3g}, {tau_high:.3g}]
scale = "log"
unit = "s"

[parameters.L]         # dead time
bounds = [0.0, {delay:.3g}]
unit = "s"

# ---- what the instruments may be wrong by: intervals allow for it (docs/study-file.md) ------------
# [uncertainty.sensor]
# of = "{output}"
# kind = "gain"          # of the reading; or "offset", "zero", "full scale"
# limit = 1.0            # half width from the data sheet
# unit = "%"

# ---- how to search ---------------------------------------------------------------------------
[search]
methods = ["auto"]     # more, to compare: ["auto", "cmaes", "pso"]; see `plantfit methods`
runs = 1
seed = 1
"""


def init(file: str, place: str | None, force: bool, json: bool) -> None:
    """Write a study file beside a recording (or at `place`)."""
    from plantfit import recording as rec
    from plantfit.rig.board.rows import BOOKKEEPING

    found = rec.describe(file)
    source = Path(file)
    name = source.name.split(".")[0]
    target = Path(place) if place else source.with_name(f"{name}.toml")
    if target.exists() and not force:
        raise SpecError(f"{str(target)!r} exists already; give another name with --out, or --force to overwrite it.")
    recorded = {*BOOKKEEPING} <= {c.name for c in found.columns}  # by `plantfit record`
    signals = [c for c in found.columns if not (recorded and c.name in BOOKKEEPING)]
    numbers = [c for c in signals if c.kind == "number" and c.minimum is not None and c.maximum is not None and c.minimum < c.maximum]
    if len(numbers) < 2:
        raise RecordingError(
            f"{source.name}: a study needs an input and an output, two columns of changing numbers beside the time; "
            f"found {[c.header for c in numbers]}."
        )
    if found.problem:
        raise RecordingError(found.problem)
    u, y = numbers[0], numbers[-1]
    own = {u: _symbol(u.name, "u"), y: _symbol(y.name, "y")}
    if own[u] == own[y]:
        own[u], own[y] = "u", "y"
    period = found.period or 1.0
    duration = period * max(found.rows - 1, 1)
    text = TEMPLATE.format(
        file=source.name,
        spec=target.name,
        name=_quoted(name),
        path=_quoted(os.path.relpath(source, target.parent)),
        columns="".join(f"#   {_column(c)}\n" for c in found.columns),
        time=f"time = {_key(found.time)}\n"
        if found.time is not None
        else "period = 1.0           # seconds between rows: no time column was found, put yours\n",
        units=_units({own[c]: c.unit for c in (u, y) if c.unit}),
        input=own[u],
        output=own[y],
        input_header=_key(u.header),
        output_header=_key(y.header),
        input_unit=_quoted(u.unit or "1"),
        output_unit=_quoted(y.unit or "1"),
        gap=5 * period,
        k_unit=_unit_line(f"({y.unit})/({u.unit})" if u.unit and y.unit else y.unit or (f"1/({u.unit})" if u.unit else None)),
        u_unit=_unit_line(u.unit),
        **_bounds(u, y, period, duration),
    )
    _checked(text, target)
    target.write_text(text, encoding="utf-8")
    if json:
        return print_json({"file": str(target), "input": own[u], "output": own[y], "period": found.period, "rows": found.rows})
    for c in found.columns:
        out.print(f"  {_column(c)}", markup=False)
    out.print(f"input {own[u]} <- {u.header!r}, output {own[y]} <- {y.header!r}; change them in the file if that is wrong.", markup=False)
    out.print(f"Written: {target}\nNext: plantfit run {target}", markup=False)


def _symbol(name: str, spare: str) -> str:
    """A name that equations may use and the template does not."""
    taken = {"x", "K", "L", "tau", "t", "e", "pi"}
    return name if name.isidentifier() and name not in taken else spare


def _bounds(u, y, period: float, duration: float) -> dict[str, float]:
    span_u, span_y = u.maximum - u.minimum, y.maximum - y.minimum
    gain = 20 * span_y / span_u
    reach = span_u + abs(u.minimum) + abs(u.maximum)
    return {
        "k_low": -gain,
        "k_high": gain,
        "u_low": u.minimum - reach,
        "u_high": u.maximum + reach,
        "tau_low": period / 5,
        "tau_high": duration,
        "delay": max(duration / 20, 5 * period),
    }


def _checked(text: str, target: Path) -> None:
    """The file must read back and give a problem before it is written."""
    from plantfit import spec

    try:
        spec.parse(text, target)
    except PlantfitError as error:  # of a file that the user has not seen
        raise RecordingError(
            f"No study file that runs can be made of this recording ({str(error).splitlines()[0]}); look at the names and values of its "
            "columns, or write one by hand (docs/study-file.md)."
        ) from error


def _column(c) -> str:
    unit = f" [{c.unit}]" if c.unit else ""
    values = f"{c.minimum:g} .. {c.maximum:g}" if c.minimum is not None else f"text, for example {c.first[0]!r}" if c.first else "empty"
    return f"{c.header!r}{unit}: {c.kind}, {values}" + (f", {c.missing} missing" if c.missing else "")


def _quoted(text: str) -> str:
    return encoder.dumps(text, ensure_ascii=False)


def _key(header: str | None) -> str:
    return _quoted(str(header))


def _units(units: dict[str, str]) -> str:
    if not units:
        return "# units = { ... }      # for columns whose header gives none\n"
    return ""


def _unit_line(unit: str | None) -> str:
    return f"unit = {_quoted(unit)}\n" if unit else ""
