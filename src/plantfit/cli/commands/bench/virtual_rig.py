"""`plantfit rig`: a record of a plant whose truth is known, with the truth and a study file beside it."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from plantfit.cli.arguments.quantities import quantity
from plantfit.cli.terminal.out import out, print_json
from plantfit.errors import SimulationError, SpaceError


def listed(name: str | None, json: bool) -> None:
    """All rigs, or the numbers of one."""
    from plantfit.rig.offered import names, offered

    rigs = [offered(n) for n in ([name] if name else names())]
    if json:
        return print_json([_record_of(r) for r in rigs])
    for rig in rigs:
        out.print(f"[bold]{rig.name}[/bold]  ", end="")
        out.print(rig.sentence, markup=False)
        if name is None:
            out.print(f"    --set {', '.join(n.name for n in rig.numbers)}", markup=False)
    if name is None:
        return out.print(
            "\n`plantfit rig NAME --list` shows the numbers of one, `plantfit rig NAME` writes a record of it.",
            markup=False,
        )
    from rich.table import Table

    table = Table("number", "unit", "value", "what it is", box=None, pad_edge=False)
    for n in rigs[0].numbers:
        table.add_row(f"[bold]{n.name}[/bold]", n.unit, "" if n.value is None else f"{n.value:.6g}", n.sentence)
    out.print(table, soft_wrap=False)
    (rig,) = rigs
    out.print(
        f"\n{rig.duration:g} s, a sample every {rig.period:g} s, unless --duration and --period say otherwise.",
        markup=False,
    )
    out.print(f"--excitation: {rig.excitation or 'none, its controller moves it'}.", markup=False)
    if rig.loop:
        out.print(f"--controller: a PID that {rig.loop}.", markup=False)
    if rig.optional:
        out.print(f"--without: {', '.join(rig.optional)}.", markup=False)


def record(
    name: str, settings: Sequence[str], asked: dict[str, Any], place: str | None, files: dict[str, bool], json: bool
) -> None:
    """Record the rig `name` with NAME=VALUE `settings` to `place`; `asked` are the other arguments of `record_rig`
    as typed."""
    from plantfit.rig.offered import record_rig

    asked = dict(asked)
    for key in ("duration", "period"):
        asked[key] = quantity(f"--{key}", asked[key], "s")
    made = record_rig(name, _settings(settings), **asked)
    written = made.save(place or f"{name}.csv", **files)
    if json:
        return print_json(
            {
                "rig": name,
                "samples": len(made.recording),
                "truth": made.truth,
                "files": {k: str(p) for k, p in written.items()},
            }
        )
    for line in made.recording.log:
        out.print(line, markup=False)
    told = [_told(n, d) for n, d in made.truth["determined"].items() if n != "nodes"]
    if told:
        out.print(f"True values to hold the fit against: {', '.join(told)}", markup=False)
    for path in written.values():
        out.print(f"Written: {path}", markup=False)
    if files["study"]:
        out.print(f"Next: plantfit check {shlex.quote(str(written['study']))}", markup=False)


def _told(name: str, true: Mapping[str, Any]) -> str:
    """`Td = 0.5 s`, of a table its range."""
    value, unit = true["value"], true["unit"]
    if isinstance(value, list | tuple):
        return f"{name} = {min(value):.4g} to {max(value):.4g} {unit} (table of {len(value)})"
    return f"{name} = {value:.6g} {unit}"


def _settings(texts: Sequence[str]) -> dict[str, str]:
    found = {}
    for text in texts:
        name, given, value = text.partition("=")
        if not (given and name.strip() and value.strip()):
            raise SpaceError(f"--set {text!r} cannot be read; write NAME=VALUE, as in --set l1=0.25 or --set l1=25cm.")
        if name.strip() in found:
            raise SimulationError(f"--set gives {name.strip()} twice; keep one.")
        found[name.strip()] = value.strip()
    return found


def _record_of(rig: Any) -> dict[str, Any]:
    numbers = [
        {
            "name": n.name,
            "unit": n.unit,
            "value": n.value,
            "kind": n.kind,
            "sentence": n.sentence,
            "least": n.least,
            "most": n.most,
        }
        for n in rig.numbers
    ]
    return {
        "name": rig.name, "sentence": rig.sentence, "numbers": numbers, "duration_s": rig.duration,
        "period_s": rig.period,
        "excitation": rig.excitation, "without": list(rig.optional), "controller": rig.loop,
    }  # fmt: skip
