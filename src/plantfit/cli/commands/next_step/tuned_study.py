"""What `plantfit tune` and `plantfit export --to` share: the finished study of a study file, wishes from the command
line, files."""

import json
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plantfit.errors import PlantfitError, SpecError, StoreError
from plantfit.spec.tables import SpecTable, validated

if TYPE_CHECKING:
    from plantfit.answer import Answer
    from plantfit.controllers import Controller
    from plantfit.findings.results.held_plant import HeldPlant
    from plantfit.findings.results.tuned_controller import TunedController
    from plantfit.holding import Held


def read_tables(spec: str) -> SpecTable:
    """The tables of a study file; nothing heavy is imported. Raises SpecError."""
    from plantfit.spec.reading import read_text

    return validated(read_text(Path(spec)), Path(spec))


def asked_of(spec: str, set_points: Sequence[str], wishes: Mapping[str, Any]) -> tuple[SpecTable, dict[str, Any]]:
    """The study file's tables, and the wishes with the set point of "T1=60 degC" and the output that it names."""
    table, found = read_tables(spec), dict(wishes)
    for text in set_points:
        name, sign, value = text.partition("=")
        if sign and found.get("output") not in (None, name.strip()):
            raise SpecError(
                f"--set-point {text!r} names {name.strip()!r}, but the "
                f"output is {found['output']!r}; tune one loop at a time."
            )
        if sign:
            found["output"] = name.strip()
        found["set_point"] = value if sign else text
    if len(set_points) > 1:
        raise SpecError(f"--set-point is given {len(set_points)} times; tune one loop at a time.")
    return table, found


@contextmanager
def named_file(spec: str, table: SpecTable, wishes: Mapping[str, Any]) -> Generator[None]:
    """Errors about a key of [control] that the study file has, and the command line has not, begin with the file."""
    try:
        yield
    except PlantfitError as error:
        text, begin = str(error), "[control] "
        key = text.removeprefix(begin).split()[0].partition(".")[0] if text.startswith(begin) else ""
        if key in table.control.model_fields_set and not wishes.get(key):
            error.args = (f"{Path(spec).name}, {text}",)
        raise


def tolerances_of(texts: Sequence[str]) -> dict[str, str] | None:
    """By name, of texts such as "tau=10 %"; None for no text. Raises SpecError."""
    found = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not sign or not name.strip():
            raise SpecError(f"--tolerance {text!r} names no parameter; write for example 'tau=10 %'.")
        found[name.strip()] = value.strip()
    return found or None


def weights_in(text: str | None) -> dict[str, float] | None:
    """Weights by name of "iae=1,travel=0.2". Raises SpecError."""
    if text is None:
        return None
    found = {}
    for part in text.split(","):
        name, sign, value = part.partition("=")
        try:
            found[name.strip()] = float(value) if sign else 1.0
        except ValueError:
            raise SpecError(
                f"--minimise {part.strip()!r} gives no weight; write for example iae=1,travel=0.2."
            ) from None
    return found


def held_in(texts: Sequence[str] | None) -> dict[str, str] | None:
    """By name, of texts such as "theta1=90 deg"; None for no text. Raises SpecError."""
    return named_in("--hold", texts, "theta1=90 deg", "state")


def named_in(option: str, texts: Sequence[str] | None, example: str, what: str = "signal") -> dict[str, str] | None:
    """Values by name, of texts such as "T=100 degC"; None for no text. Raises SpecError."""
    found = {}
    for text in texts or ():
        name, sign, value = text.partition("=")
        if not sign or not name.strip():
            raise SpecError(f"{option} {text!r} names no {what}; write for example {example!r}.")
        found[name.strip()] = value.strip()
    return found or None


def levels_in(text: str | None) -> int | list[str] | None:
    """Levels of "20 degC,40 degC", or how many."""
    if text is None:
        return None
    return int(text) if text.strip().isdigit() else [v.strip() for v in text.split(",") if v.strip()]


def front_in(text: str | None) -> list[str] | None:
    """The figures of "iae,input_noise"."""
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()]


def refuse_regression(table: SpecTable, spec: str) -> None:
    """Raises SpecError for a regression, which is solved at once and has no loop of one output."""
    if table.regression is not None:
        raise SpecError(
            f"{spec} is a regression, which is solved at once and closes no loop of one output; say where its plant is "
            f"held, as in "
            '--hold "theta1=90 deg" ([control] hold).'
        )


def check_signals(table: SpecTable, wishes: Mapping[str, Any]) -> None:
    """Raises SpecError where a model of equations has several outputs or inputs and none is named, or another one:
    before the study is prepared, which may take long."""
    if table.model.equations is None:
        return
    from plantfit.loop_of_study import signal_of

    for what, names in (("output", table.model.outputs), ("input", table.model.inputs)):
        signal_of(what, wishes.get(what) or getattr(table.control, what), tuple(names))


def answer_for(table: SpecTable, spec: Path, number: int | None, store: str) -> "Answer":
    """The finished study of a study file. Raises StoreError with what to run where there is none, or where it was
    another problem."""
    from plantfit.study import Store
    from plantfit.study.store.addresses import shown, store_option

    where = store_option(store)
    try:
        opened = Store.open(store, create=False)
    except StoreError as error:
        if "://" not in store and not Path(store).exists():
            raise StoreError(
                f"There is no store {store} here, so the study {table.name!r} has not been run; run it first: "
                f"`plantfit run {spec}{where}`."
            ) from None
        raise error
    records = [r for r in opened.studies() if (r.id == number if number is not None else r.name == table.name)]
    if not records:
        raise StoreError(
            f"{shown(store)} holds no study {number if number is not None else repr(table.name)}; "
            f"run it first: `plantfit run {spec}{where}`."
        )
    record = records[-1]
    if record.runs_done == 0:
        raise StoreError(
            f"Study {record.id} ({record.name}) has no finished run yet; go on with `plantfit resume "
            f"{record.id}{where}`."
        )
    if record.spec_text and record.name == table.name:
        stored = validated(record.spec_text, spec)
        changed = [n for n in ("model", "parameters", "recording") if getattr(stored, n) != getattr(table, n)]
        if changed:
            raise StoreError(
                f"{spec} has another [{changed[0]}] than study {record.id} in "
                f"{shown(store)} was run with; run it again: `plantfit run {spec}{where}`."
            )
    from plantfit.reopen import open_study

    return open_study(record.id, opened)


def written(found: "Controller", page: Path, folder: Path) -> list[Path]:
    """Page, JSON and C files of a controller. Raises StoreError where a file of the user would be replaced."""
    from plantfit.report.pages.controller import write_controller_page

    return _files(found, page, folder, write_controller_page)


def written_held(found: "Held", page: Path, folder: Path) -> list[Path]:
    """Page, JSON and C files of a regulator. Raises StoreError where a file of the user would be replaced."""
    from plantfit.report.pages.held import write_held_page

    return _files(found, page, folder, write_held_page)


def _files(found: "Controller | Held", page: Path, folder: Path, write_page: Callable[..., Path]) -> list[Path]:
    from plantfit.cli.terminal.out import plain
    from plantfit.folders import may_be_written

    data = page.with_suffix(".json")
    if not may_be_written(data):
        raise StoreError(f"{data} exists and was not written by plantfit; move it, or name another page with --out.")
    folder.mkdir(parents=True, exist_ok=True)
    c = found.to_c(folder)
    data.write_text(
        json.dumps({"made_by": "plantfit", **plain(found.record)}, indent=1, allow_nan=False) + "\n", "utf-8"
    )
    return [write_page(found.typed, found.curves, page), data, c.source, c.header]


def show_held(record: "HeldPlant") -> None:
    """Verdict, wishes and the table of a regulator on the terminal."""
    from plantfit.cli.terminal.out import out, verdict
    from plantfit.report.pages.held import asked, heads, settings, table_rows
    from plantfit.report.text import columns

    verdict(record.plain())
    for sentence in [settings(record), *asked(record)]:
        out.print(f"  {sentence}", markup=False)
    out.print(columns(heads(record), table_rows(record), range(1, len(heads(record)))), markup=False)


def show(record: "TunedController") -> None:
    """Verdict, wishes and the table on the terminal."""
    from plantfit.cli.terminal.out import out, verdict
    from plantfit.report.pages.controller import (
        asked,
        front_heads,
        front_rows,
        front_told,
        heads,
        level_heads,
        level_rows,
        reduction,
        settings,
        table_rows,
    )
    from plantfit.report.text import columns

    verdict(record.plain())
    out.print(f"{record.form}: {settings(record)}", markup=False)
    for sentence in asked(record):
        out.print(f"  {sentence}", markup=False)
    out.print(columns(heads(record), table_rows(record), range(1, len(heads(record)))), markup=False)
    out.print(reduction(record), markup=False)
    if record.schedule is not None:
        out.print(columns(level_heads(record), level_rows(record), range(len(level_heads(record)))), markup=False)
    if record.front is not None:
        out.print(columns(front_heads(record), front_rows(record), range(len(front_heads(record)))), markup=False)
        out.print(front_told(record), markup=False)
