"""`plantfit new`: the study file of a plant made of parts, or of one of the library."""

import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from plantfit import units
from plantfit.cli.arguments.dates import check_used, order
from plantfit.cli.commands.begin.plant_study import Measurements, Plant, expected, of_library, of_network, study
from plantfit.cli.commands.begin.reads_back import clock_that_reads
from plantfit.cli.commands.begin.study_text import clock_line
from plantfit.cli.terminal.out import out, print_json
from plantfit.errors import ModelError, RecordingError, SpecError
from plantfit.models.text.suggest import suggest

if TYPE_CHECKING:
    from plantfit.recording.description import ColumnSummary, Description

_ENDS = ".net"


@dataclass(frozen=True)
class _Made:
    """A plant, the list of parts that belongs to it and has to be written ("" without), and what is told."""

    plant: Plant
    parts: str
    told: Sequence[str]


def new(
    name: str | None, kind: str | None, recording: str | None, columns: Sequence[str], place: str | None, force: bool,
    json: bool, dates: str | None = None
) -> None:  # fmt: skip
    """Write the study file of the list of parts `name`, or of the plant `kind` under this name; `columns` are
    SIGNAL=COLUMN, and `dates` the order of day and month in the time stamps of the recording."""
    if name is None:
        raise SpecError(
            "Name a list of parts, as in `plantfit new circuit.net`, or a plant to begin with, as in `plantfit new "
            "motor --from dc_motor` "
            "(`plantfit new --list`, `plantfit new --parts`)."
        )
    source = Path(name)
    if kind is None and source.suffix != _ENDS:
        raise SpecError(
            f"{name!r} is not a list of parts (NAME{_ENDS}); say what to "
            "begin with, as in --from dc_motor (`plantfit new --list`)."
        )
    target = (
        Path(place)
        if place
        else source.with_suffix(".toml")
        if source.suffix in (_ENDS, ".toml")
        else Path(f"{name}.toml")
    )
    if not target.parent.is_dir():
        raise SpecError(
            f"There is no folder {str(target.parent)!r} to write "
            f"{target.name!r} into; make it, or give another place with --out."
        )
    if kind is None:
        made, words = _of_file(source), source.name
    else:
        made, words = _of_kind(kind, f"{source.name} --from {kind}")
    listed = target.with_suffix(_ENDS)
    there = next((f for f in (target, *([listed] if made.parts else [])) if f.exists()), None)
    if there is not None and not force:
        raise SpecError(
            f"{str(there)!r} exists already; give another name, another place with --out, or --force to overwrite it."
        )
    said = {signal.strip(): column.strip() for signal, _, column in (c.partition("=") for c in columns)}
    if said and recording is None:
        raise SpecError("--column names columns of a recording; give its file with --recording.")
    if dates is not None and recording is None:
        raise SpecError("--dates is of the times of a recording; give its file with --recording.")
    measured, missing = expected(made.plant, f"{target.stem}.csv"), []
    if recording is not None:
        measured, missing = _columns(made.plant, Path(recording), target, said, dates)

    def text(clock: str) -> str:
        return study(made.plant, replace(measured, clock=clock), target.stem, words, target.name)

    clock = measured.clock
    if recording is not None and not missing:
        clock = clock_that_reads(text, clock, target, quiet=json)
    target.write_text(text(clock), encoding="utf-8")
    if made.parts:
        listed.write_text(made.parts, encoding="utf-8")
    if json:
        signals = {
            "inputs": list(made.plant.inputs),
            "outputs": list(made.plant.outputs),
            "columns": dict(measured.columns),
        }
        return print_json(
            {"file": str(target), "parts": str(listed) if made.parts else None, **signals, "without_column": missing}
        )
    for line in made.told:
        out.print(line, markup=False)
    if made.parts:
        out.print(
            f"Written: {listed}, its parts; change them and write the study anew: plantfit new {listed} --force",
            markup=False,
        )
    if recording is None:
        columns = ", ".join(["t [s]", *measured.columns.values()])
        out.print(
            f"It reads the recording {target.with_name(measured.file)} "
            f"with the columns {columns}: put your file and columns there.",
            markup=False,
        )
    for signal, column in measured.columns.items() if recording is not None else ():
        told = (
            f"no column was found, put yours there or write --column {signal}=NAME"
            if signal in missing
            else f"column {column!r}"
        )
        out.print(f"{signal}: {told}", markup=False)
    out.print(f"Written: {target}\nNext: plantfit check {target}", markup=False)


def _of_file(source: Path) -> _Made:
    from plantfit.models.networks.network import network

    try:
        text = source.read_text("utf-8")
    except FileNotFoundError:
        raise SpecError(
            f"There is no file {str(source)!r}; write the parts into it, or begin with `plantfit new NAME --from rlc`."
        ) from None
    except (UnicodeDecodeError, IsADirectoryError):
        raise SpecError(f"{str(source)!r} is not text; a list of parts has lines such as: R1 resistor a b.") from None
    made = network(text, source.name)
    return _Made(of_network(made, text), "", _told(made.states, made.idle))


def _told(states: Sequence[str] | dict, idle: Sequence[str]) -> list[str]:
    lines = [
        f"States: {', '.join(states)}." if states else "There are no states: the plant follows its inputs at once."
    ]
    if idle:
        lines.append(
            f"Left out, as nothing that is measured hangs on {'it' if len(idle) == 1 else 'them'}: {', '.join(idle)}."
        )
    return lines


def _of_kind(kind: str, words: str) -> tuple[_Made, str]:
    """A drawing, or a model of the library."""
    from plantfit.models.drawings.offered import drawings
    from plantfit.models.library.catalogue import listed, names

    drawn = drawings()
    if kind in drawn:
        drawing = drawn[kind]
        if drawing.parts:
            from plantfit.models.networks.network import network

            made = network(drawing.text, f"{kind}{_ENDS}")
            return _Made(
                of_network(made, drawing.text), f"# {drawing.sentence}\n{drawing.text}", _told(made.states, made.idle)
            ), words
        model = tomllib.loads(drawing.text)["model"]
        return _Made(Plant(model["inputs"], model["outputs"], drawing.text), "", []), words
    known = [*drawn, *names()]
    if kind not in known:
        raise ModelError(
            f"There is no plant {kind!r} to begin with.{suggest(kind, known)} There are {', '.join(known)}."
        )
    from plantfit.models.model import Model

    entry = listed(kind)
    model = entry.make()
    if not isinstance(model, Model):
        raise ModelError(f"{kind} is a regression of measured signals; see docs/regression.md for its study file.")
    return _Made(of_library(kind, model, {o.name: o.default for o in entry.options}), "", []), words


def _columns(
    plant: Plant, recording: Path, target: Path, said: Mapping[str, str], dates: str | None
) -> tuple[Measurements, list[str]]:
    """Columns of a recording by signal, and signals that found none: what the user `said`, else by name, by a unit
    that only one column fits, and by unit and role in their order where as many columns as signals are left."""
    from plantfit.recording.description import described
    from plantfit.recording.readers.any_format import table
    from plantfit.recording.roles import roles_of

    content = table(str(recording))
    found = described(content, order(dates))
    check_used(dates, found)
    roles = {r.header: r.kind for r in roles_of(content).columns}
    free = [
        c
        for c in found.columns
        if c.kind == "number" and c.header != found.time and roles.get(c.header) not in ("index", "set point")
    ]
    signals = {**plant.inputs, **plant.outputs}
    taken = {s: _said(s, column, signals, found) for s, column in said.items()}
    for fits in (_same_name, _same_unit):
        for signal, unit in signals.items():
            own = [c for c in free if c not in taken.values() and fits(signal, unit, c)]
            if signal not in taken and len(own) == 1:
                taken[signal] = own[0]
    for kind, own in (("input", plant.inputs), ("output", plant.outputs)):
        for unit in dict.fromkeys(own.values()):
            left = [s for s, u in own.items() if u == unit and s not in taken]
            columns = [
                c for c in free if c not in taken.values() and roles.get(c.header) == kind and _same_unit("", unit, c)
            ]
            if len(left) == len(columns):
                taken |= zip(left, columns, strict=True)
    wrong = next(((s, c) for s, c in taken.items() if c.unit and not _converts(c.unit, signals[s])), None)
    if wrong is not None:
        signal, column = wrong
        raise RecordingError(
            f"{recording.name}: column {column.header!r} is in {column.unit}, and "
            f"{signal} in {signals[signal]}; name another, as in --column {signal}=NAME."
        )
    bare = {s: u for s, u in signals.items() if s in taken and not taken[s].unit and u not in (None, "1")}
    headers = {s: taken[s].header if s in taken else f"{s} [{u}]" for s, u in signals.items()}
    path = os.path.relpath(recording, target.parent)
    return Measurements(path, clock_line(found), headers, bare), [s for s in signals if s not in taken]


def _said(signal: str, column: str, signals: Mapping[str, str | None], found: "Description") -> "ColumnSummary":
    """The column that the user names for a signal."""
    if signal not in signals:
        raise SpecError(
            f"--column {signal}={column}: there is no signal {signal!r}.{suggest(signal, signals)} There are "
            f"{', '.join(signals)}."
        )
    own = next((c for c in found.columns if column in (c.header, c.name)), None)
    if own is None:
        headers = [c.header for c in found.columns]
        raise RecordingError(
            f"--column {signal}={column}: {found.file} has no such column.{suggest(column, headers)} It has {headers}."
        )
    return own


def _same_name(signal: str, unit: str | None, column: "ColumnSummary") -> bool:
    return signal.lower() in (column.name.lower(), column.header.partition("[")[0].strip().lower())


def _same_unit(signal: str, unit: str | None, column: "ColumnSummary") -> bool:
    return bool(column.unit and unit not in (None, "1") and _converts(column.unit, unit))


def _converts(given: str, wanted: str | None) -> bool:
    return wanted is None or (units.known(given) and units.compatible(given, wanted))


def tell_parts(json: bool) -> None:
    """Every kind of part with its nodes."""
    from plantfit.models.networks.netlist import letters
    from plantfit.models.networks.parts import PARTS

    if json:
        return print_json(
            [
                {"kind": p.kind, "domain": p.domain.name, "nodes": p.nodes, "what": p.what, "unit": p.unit}
                for p in PARTS.values()
            ]
        )
    domain = None
    for p in PARTS.values():
        if p.domain is not domain:
            domain = p.domain
            out.print(f"\n{domain.name}", markup=False)
        unit = f" [{p.unit}{'/unit of its input' if p.given == 'gain' else ''}]" if p.unit not in ("", "1") else ""
        out.print(f"  NAME {p.kind} {' '.join(p.nodes)}".ljust(44) + f"{p.what}{unit}", markup=False)
    out.print(f"\nmeasure\n{letters()}", markup=False)


def tell_plants(json: bool) -> None:
    """Every plant to begin with."""
    from plantfit.models.drawings.offered import drawings
    from plantfit.models.library.catalogue import listing
    from plantfit.models.model import Model

    rows = [(d.name, d.sentence, "parts" if d.parts else "equations") for d in drawings().values()]
    rows += [(m.name, m.sentence.rstrip("."), "library") for m in listing() if isinstance(m.make(), Model)]
    if json:
        return print_json([{"name": n, "sentence": s, "kind": k} for n, s, k in rows])
    for name, sentence, kind in rows:
        out.print(f"{name:<20}{kind:<11}{sentence}", markup=False)
    out.print("\nplantfit new NAME --from one of these", markup=False)
