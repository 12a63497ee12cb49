"""`plantfit init`: look at a recording, say what its columns seem to be, and write a commented study file that runs."""

import os
import re
import sys
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import replace
from keyword import iskeyword
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plantfit.cli.arguments.dates import check_used, order
from plantfit.cli.commands.begin.at_rest import CLOCK, SPLITS, TOLD, rows_at_rest
from plantfit.cli.commands.begin.reads_back import checked, clock_that_reads, words_line
from plantfit.cli.commands.begin.study_text import AT_REST, SPLIT, WORDS, Kind, Link, Signal, clock_line, study_text
from plantfit.cli.terminal.out import out, print_json
from plantfit.errors import RecordingError, SpecError

if TYPE_CHECKING:
    from plantfit.recording.description import ColumnSummary, Description
    from plantfit.recording.readers.columns import Table
    from plantfit.recording.roles import Role, Roles

NONE = "none"  # as --input: nothing drives the plant
_NO_CLOCK = "No time column was found: put the seconds between rows where the file says period = 1.0."
_TOLD = {
    "set point": "left out",
    "copy": "left out",
    "text": "left out",
    "empty": "left out",
    "index": "left out",
    "constant": "left out",
}


def init(
    file: str, place: str | None, force: bool, json: bool, inputs: Sequence[str] = (), outputs: Sequence[str] = (),
    yes: bool = False,
    candidates: bool = False, model: str | None = None, dates: str | None = None,
) -> None:  # fmt: skip
    """Write a study file beside a recording (or at `place`), or with `candidates` one for each kind of model, and
    compare them.

    With `model` it is one of that model of the library; `dates` is the order of day and month in time stamps.
    """
    if model is not None and (model != "dc_motor" or candidates):
        raise SpecError(
            "--candidates compares models without physics and cannot be used with --model; leave one of the two out."
            if candidates
            else f"--model {model!r}: init writes a study of the model dc_motor only; for another model write [model] "
            f"kind yourself "
            "(`plantfit models`)."
        )
    from plantfit.recording.description import described
    from plantfit.recording.readers.any_format import table
    from plantfit.recording.readers.clock import may_be_milliseconds
    from plantfit.recording.readers.long_tables import widened
    from plantfit.recording.roles import roles_of

    source = Path(file)
    if source.is_dir():
        raise RecordingError(f"{file!r} is a folder; name a file in it.")
    name = source.name.split(".")[0]
    target = Path(place) if place else source.with_name(f"{name}.toml")
    targets = _targets(target, candidates, force)
    content = table(file)
    found, roles = described(content, order(dates)), roles_of(content)
    check_used(dates, found)
    known = {c.header: c for c in found.columns}
    if model is not None:
        return _motor(source, target, found, content, (*inputs, *outputs), name, json)
    free = _free(source.name, roles, known, inputs, outputs)
    if free is not None and candidates:
        raise SpecError(
            f"--candidates compares models with an input, and {source.name} shows a motion without one; leave it out."
        )
    if free is not None:
        roles = replace(roles, columns=tuple(_alone(r, free) for r in roles.columns))
    as_named = replace(roles, columns=tuple(_as_named(r, inputs, outputs) for r in roles.columns))
    ask = not (yes or json) and sys.stdin.isatty() and sys.stdout.isatty()
    if not json:
        _tell(source.name, found, as_named)
        if may_be_milliseconds(widened(content)):
            out.print(
                f"The file names no unit of {found.time!r}: s, {found.period:.4g} s apart. If it counts ms or min, "
                'write time_unit = "ms" or "min" below time in the study file.',
                markup=False,
            )
    if free is not None:
        return _free_motion(source, target, content, found, roles, free, name, json)
    chosen_in, chosen_out = _chosen(source.name, roles, known, inputs, outputs, ask)
    links = _links(roles, known, chosen_in, chosen_out)
    period = found.period or 1.0
    told = _columns(found, roles)
    read = [c.header for k in links for s in (*k.inputs, k.output) for c in s.read]
    rest = rows_at_rest(content, found, links)
    if rest is not None:
        targets = _targets(target, candidates, force, AT_REST)
        if not json:
            out.print(
                f"{source.name} has no column of times, and {TOLD[rest]}: the models are without dynamics. If the rows "
                "were recorded one after the other, put a column of their times into the file.",
                markup=False,
            )
    clock = (clock_line(found) if rest is None else CLOCK) + words_line(content, read, json)
    split = SPLIT if rest is None else SPLITS[rest]
    for kind, to in targets.items():
        path = os.path.relpath(source, to.parent)

        def text(clock: str, kind: Kind = kind, to: Path = to, path: str = path) -> str:
            return study_text(kind, links, source.name, path, to.name, to.stem if candidates else name, told, clock,
                              period,
                              period * max(found.rows - 1, 1), split)  # fmt: skip

        clock = clock_that_reads(text, clock, to, quiet=json)
        to.write_text(text(clock), encoding="utf-8")
    if candidates:
        return _compared(list(targets.values()), json)
    if json:
        return print_json(_record(str(target), links, found, as_named))
    _say_links(links, roles, sure=bool(inputs or outputs))
    if found.time is None and not found.period and rest is None:
        out.print(_NO_CLOCK, markup=False)
    kinds, (kind,) = WORDS if rest is None else AT_REST, targets
    out.print(f"Written: {target} ({kinds[kind]}; --candidates compares {len(kinds)} kinds)", markup=False)
    out.print(f"Next: plantfit check {target}", markup=False)


def _targets(target: Path, candidates: bool, force: bool, words: Mapping[Kind, str] = WORDS) -> dict[Kind, Path]:
    """The file to write for each kind of model."""
    alone: Kind = "dead_time" if words is WORDS else "line"
    kinds: list[Kind] = list(words) if candidates else [alone]
    targets: dict[Kind, Path] = {
        kind: target.with_stem(f"{target.stem}-{kind}") if candidates else target for kind in kinds
    }
    if not target.parent.is_dir():
        raise SpecError(
            f"There is no folder {str(target.parent)!r} to write "
            f"{target.name!r} into; make it, or give another place with --out."
        )
    there = next((t for t in targets.values() if t.exists()), None)
    if there is not None and not force:
        raise SpecError(f"{str(there)!r} exists already; give another name with --out, or --force to overwrite it.")
    return targets


def _columns(found: "Description", roles: "Roles") -> list[str]:
    """What each column seems to be, for the comments of a study file."""
    return [
        f"{c.header!r}{_unit(c)}: {_words(r)}{_range(c)}" for c, r in zip(found.columns, roles.columns, strict=True)
    ]


def _say_links(links: list[Link], roles: "Roles", sure: bool) -> None:
    """What answers to what, and of which columns the user should be asked where nobody named them (`sure`)."""
    from plantfit.recording.roles import UNMOVED

    unmoved = {r.header for r in roles.columns if UNMOVED in r.why}
    for link in links:
        of = " and ".join(u.told for u in link.inputs)
        if link.output.header in unmoved and not sure:
            way = f"--input {link.output.header!r}"
            told = f"{link.output.told} does not seem to answer to {of}: leave it out, or make it an input ({way})."
        else:
            told = f"{link.output.told} answers to {of}."
        out.print(told, markup=False)
    unsure = [r for r in roles.unsure if r.kind in ("input", "output")]
    if unsure and not sure:
        listed = ", ".join(f"{r.header!r} ({r.kind})" for r in unsure)
        out.print(
            f"Not sure of {listed}: change it in the file, or name them with --input and --output. Does nothing drive "
            "the plant, as a pendulum that was let go? Then --input none.",
            markup=False,
        )


def _free(
    source: str, roles: "Roles", known: dict[str, Any], inputs: Sequence[str], outputs: Sequence[str]
) -> str | None:
    """The header of the output whose motion no input drives: of the only column of numbers, or with `--input none`
    of the one that is named or alone changes; else None."""
    usable = [r for r in roles.columns if known[r.header].minimum is not None]
    moving = [r for r in usable if r.kind not in ("time", "constant", "index")]
    if [*inputs] == [NONE] and NONE not in {r.header for r in usable} | {r.name for r in usable}:
        named = _named(source, outputs, usable) or [r.header for r in moving]
        if len(named) != 1:
            raise RecordingError(
                f"{source}: --input none makes a study of one output; name it with --output, one of "
                f"{named if outputs else [r.header for r in moving]}."
            )
        return named[0]
    # an input or a sensor that was dead, or an input that is written in words (ON and OFF)
    other = any(r.kind == "constant" or _in_words(r, known) for r in roles.columns)
    return moving[0].header if len(moving) == 1 and not inputs and not other else None


def _in_words(role: "Role", known: "dict[str, ColumnSummary]") -> bool:
    """Whether a column holds text that is no time and no date."""
    from plantfit.recording.readers.clock import looks_like_time
    from plantfit.recording.readers.timestamps import is_date

    first = next((cell for cell in known[role.header].first if cell.strip()), "")
    return role.kind == "text" and not (looks_like_time(first) or is_date(first))


def _alone(role: "Role", free: str) -> "Role":
    """A column beside the output `free`, which no input drives."""
    if role.header == free:
        return replace(role, kind="output", why="nothing drives it", sure=True, answers=())
    return replace(role, kind="index", why="not asked for") if role.kind in ("input", "output") else role


def _as_named(role: "Role", inputs: Sequence[str], outputs: Sequence[str]) -> "Role":
    """The role that --input or --output gives a column."""
    if role.kind != "input" and {role.header, role.name} & {*inputs}:
        return replace(role, kind="input", why="named by --input")
    if role.kind != "output" and {role.header, role.name} & {*outputs}:
        return replace(role, kind="output", why="named by --output")
    return role


def _free_motion(
    source: Path, target: Path, content: Any, found: "Description", roles: "Roles", header: str, name: str, json: bool
) -> None:
    """The study of a motion that no input drives."""
    from plantfit.cli.commands.begin.free_motion import WORDS as MOTIONS
    from plantfit.cli.commands.begin.free_motion import free_text
    from plantfit.recording.readers.long_tables import widened
    from plantfit.recording.readers.numbers import casted

    table = widened(content)
    values = casted(table, table.column(header, "an output").cells).values
    by_header, period = {c.header: c for c in found.columns}, found.period or 1.0
    y = _links(roles, by_header, [], [header])[0].output
    told = _columns(found, roles)
    path = os.path.relpath(source, target.parent)

    def made(clock: str) -> Any:
        return free_text(y, values, source.name, path, target.name, name, told, clock, period,
                         period * max(found.rows - 1, 1))  # fmt: skip

    begun = clock_line(found) + words_line(content, [header], json)
    clock = clock_that_reads(lambda clock: made(clock)[0], begun, target, quiet=json)
    text, motion = made(clock)
    target.write_text(text, encoding="utf-8")
    if json:
        columns = [{"header": r.header, "role": r.kind, "why": r.why, "sure": r.sure} for r in roles.columns]
        return print_json({
            "file": str(target), "input": None, "output": y.symbol, "inputs": [], "outputs": [y.symbol],
            "period": found.period, "rows": found.rows, "columns": columns,
        })  # fmt: skip
    if found.time is None and not found.period:
        out.print(_NO_CLOCK, markup=False)
    out.print(f"Written: {target} ({MOTIONS[motion]})\nNext: plantfit check {target}", markup=False)


def _motor(
    source: Path, target: Path, found: "Description", content: "Table", wanted: Sequence[str], name: str, json: bool
) -> None:
    """The study of a DC motor."""
    from plantfit.cli.commands.begin.motor_study import motor_study

    period = found.period or 1.0
    made = motor_study(
        source.name, os.path.relpath(source, target.parent), target.name, name,
        clock_line(found) + words_line(content, [c.header for c in found.columns if c.kind == "number"], json),
        found.columns,
        wanted, period,
        period * max(found.rows - 1, 1),
    )  # fmt: skip
    checked(made.text, target)
    target.write_text(made.text, encoding="utf-8")
    if json:
        columns = {signal: c.header for signal, c in made.columns.items()}
        return print_json(
            {"file": str(target), "model": "dc_motor", "columns": columns, "period": found.period, "rows": found.rows}
        )
    for signal, column in made.columns.items():
        out.print(f"{signal}: column {column.header!r}", markup=False)
    for line in made.told:
        out.print(line, markup=False)
    out.print(f"Written: {target}\nNext: plantfit check {target}", markup=False)


def _tell(source: str, found: "Description", roles: "Roles") -> None:
    from plantfit.recording.readers.assemble import brackets_told
    from plantfit.recording.readers.columns import unknown_unit

    clock = f", {found.period:.4g} s apart" if found.period else ""
    out.print(f"{source}: {found.rows} rows{clock}", markup=False)
    width = min(32, max(len(c.header) for c in roles.columns))
    for summary, role in zip(found.columns, roles.columns, strict=True):
        out.print(f"  {role.header[:40]:<{width}}  {_words(role)}{_range(summary)}", markup=False)
    for header in (c.header for c in found.columns):
        if unknown := unknown_unit(header):
            out.print(f"{brackets_told(header, unknown)}.", markup=False)


def _words(role: "Role") -> str:
    kind = _TOLD.get(role.kind, role.kind)
    return f"{kind}, {role.why}" if role.why else kind


def _range(c: "ColumnSummary") -> str:
    if c.minimum is None or c.minimum == c.maximum:
        return ""
    return f"; {c.minimum:g} to {c.maximum:g}" + (f", {c.missing} missing" if c.missing else "")


def _unit(c: "ColumnSummary") -> str:
    if c.unit:
        return f" [{c.unit}]"
    from plantfit.recording.readers.columns import unit_in_name

    named = unit_in_name(c.header) if c.kind == "number" else None
    return f" [{named}, by its name]" if named else ""


def _chosen(
    source: str, roles: "Roles", known: dict[str, Any], inputs: Sequence[str], outputs: Sequence[str], ask: bool
) -> tuple[list[str], list[str]]:
    """Headers of the inputs and outputs: what the user said, answers to a question, or what they seem to be."""
    from plantfit.rig.board.rows import BOOKKEEPING

    recorded = {*BOOKKEEPING} <= {r.name for r in roles.columns}  # by `plantfit record`
    usable = [
        r for r in roles.columns if known[r.header].minimum is not None and not (recorded and r.name in BOOKKEEPING)
    ]
    moving = [r for r in usable if r.kind not in ("time", "constant", "index")]
    if len(moving) < 2:
        words = [repr(r.header) for r in roles.columns if _in_words(r, known)]
        told = (
            f" Not made of numbers: {', '.join(words)}; write 1 and 0 for words as ON and OFF, and numbers without 0x."
        )
        raise RecordingError(
            f"{source}: a study needs an input and an output, two columns of changing numbers besides the time; "
            f"{'only ' + repr(moving[0].header) + ' changes' if moving else 'no column changes'}."
            f"{told if words else ''}"
            f"{' If nothing drives the plant, give --input none.' if moving and not inputs else ''}"
        )
    said_in, said_out = _named(source, inputs, usable), _named(source, outputs, usable)
    guessed = {kind: [r.header for r in moving if r.kind == kind] for kind in ("input", "output")}
    own_in = said_in or [h for h in guessed["input"] if h not in said_out]
    own_out = said_out or [h for h in guessed["output"] if h not in own_in]
    rest = [r.header for r in moving if r.header not in (*own_in, *own_out)]
    own_in, own_out = own_in or rest[:1], own_out or [h for h in rest if h not in own_in][-1:]
    if ask and not (inputs and outputs) and any(r.header in (*own_in, *own_out) for r in roles.unsure):
        own_in = _asked("Inputs", own_in, usable, source)
        own_out = _asked(
            "Outputs", [h for h in own_out if h not in own_in] or [h for h in rest if h not in own_in], usable, source
        )
    headers = [r.header for r in roles.columns]
    twice = next((h for h in (*own_in, *own_out) if headers.count(h) > 1), None)
    if twice is not None:
        raise RecordingError(
            f"{source} has {headers.count(twice)} columns {twice!r}; give each its own name in the header."
        )
    both = {*own_in} & {*own_out}
    if both or not own_in or not own_out:
        what = (
            f"{sorted(both)[0]!r} is both input and output" if both else f"no {'output' if own_in else 'input'} is left"
        )
        raise RecordingError(f"{source}: {what}; name inputs with --input and outputs with --output.")
    return own_in, own_out


def _named(source: str, wanted: Sequence[str], usable: "list[Role]") -> list[str]:
    found = []
    for word in wanted:
        match = next((r.header for r in usable if word in (r.header, r.name)), None)
        if match is None:
            raise RecordingError(
                f"{source} has no column of numbers {word!r}; its columns of numbers are {[r.header for r in usable]}."
            )
        found.append(match)
    return list(dict.fromkeys(found))


def _asked(what: str, guess: list[str], usable: "list[Role]", source: str) -> list[str]:
    """What the user answers in the terminal; an empty line takes the guess."""
    while True:
        try:
            line = input(f"{what}, with commas between [{', '.join(guess)}]: ").strip()
        except EOFError:
            return guess
        if not line:
            return guess
        try:
            return _named(source, [word.strip() for word in line.split(",") if word.strip()], usable)
        except RecordingError as error:
            out.print(str(error), markup=False)


def _links(roles: "Roles", known: "dict[str, ColumnSummary]", inputs: list[str], outputs: list[str]) -> list[Link]:
    from plantfit.recording.readers.columns import unit_in_name
    from plantfit.units import gauge

    symbols: dict[str, str] = {}
    by_header = {r.header: r for r in roles.columns}
    for k, header in enumerate((*inputs, *outputs)):
        spare = ("u" if header in inputs else "y") + (str(k + 1) if len(inputs) + len(outputs) > 2 else "")
        symbol = _symbol(by_header[header].name, spare)
        while symbol in symbols.values():
            symbol = f"{symbol}_"
        symbols[header] = symbol

    def signal(header: str) -> Signal:
        c = known[header]
        if c.minimum is None or c.maximum is None or c.minimum == c.maximum:
            raise RecordingError(
                f"Column {header!r} never changes, so it can be neither input nor output; name another."
            )
        first = float(c.first_number if c.first_number is not None else c.minimum)
        named = gauge(c.unit) if c.unit else unit_in_name(header)  # the numbers of bar(g) are taken as bar
        gaps = c.missing + c.texts > 0
        return Signal(symbols[header], header, named or c.unit, c.minimum, c.maximum, first, named is not None, gaps)

    signals = {h: signal(h) for h in (*inputs, *outputs)}
    for h in inputs:
        if (way := by_header[h].direction) in inputs:
            signals[h] = signals[way] = _signed(signals[h], signals[way], {*symbols.values()})
    links = []
    for header in outputs:
        answers = [h for h in by_header[header].answers if h in inputs] or inputs
        links.append(Link(signals[header], tuple(dict.fromkeys(signals[h] for h in inputs if h in answers))))
    return links


def _signed(of: Signal, way: Signal, taken: set[str]) -> Signal:
    """The input that a column without sign and the one of its direction make; its header is both."""
    name = f"{of.symbol}_signed"
    while name in taken:
        name += "_"
    return Signal(name, f"{of.header} and {way.header}", of.unit, -of.high, of.high,
                  of.first if way.first == way.high else -of.first, of.named, False, (of, way))  # fmt: skip


_LETTERS = str.maketrans(
    {
        "ä": "ae",
        "ö": "oe",
        "ü": "ue",
        "Ä": "Ae",
        "Ö": "Oe",
        "Ü": "Ue",
        "ß": "ss",
        "æ": "ae",
        "œ": "oe",
        "ø": "oe",
        "ł": "l",
    }
)


def _symbol(name: str, spare: str) -> str:
    """A name that equations may use and the template does not."""
    from plantfit.models.text.declarations import RESERVED

    taken = re.fullmatch(r"(x|z|K|bend|L|tau|lag|rest|start)\d*", name)
    # a bare key of TOML has no accents
    plain = unicodedata.normalize("NFKD", name.translate(_LETTERS)).encode("ascii", "ignore").decode()
    usable = plain.isidentifier() and not iskeyword(plain) and plain not in RESERVED
    return plain if usable and not taken and len(plain) > len(name) // 2 else spare


def _compared(files: list[Path], json: bool) -> None:
    """What `plantfit compare` says of the candidates."""
    from plantfit.cli.commands.understand.models import compare_models
    from plantfit.study.store.addresses import STORE, VARIABLE

    given = [str(f) for f in files]
    if not json:
        out.print(f"Written: {', '.join(given)}\nComparing them: plantfit compare {' '.join(given)}", markup=False)
    page = str(files[0].with_name(files[0].stem.removesuffix("-first").removesuffix("-line") + "-candidates.html"))
    compare_models(given, given, os.environ.get(VARIABLE, STORE), page, True, None, json)


def _record(target: str, links: list[Link], found: "Description", roles: "Roles") -> dict[str, Any]:
    inputs = list(dict.fromkeys(u.symbol for link in links for u in link.inputs))
    return {
        "file": target,
        "input": inputs[0],
        "output": links[-1].output.symbol,
        "inputs": inputs,
        "outputs": [link.output.symbol for link in links],
        "period": found.period,
        "rows": found.rows,
        "columns": [{"header": r.header, "role": r.kind, "why": r.why, "sure": r.sure} for r in roles.columns],
    }
