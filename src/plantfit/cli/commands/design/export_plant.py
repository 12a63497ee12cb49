"""`plantfit export`: the plant of a finished study for another program; without --to a study, as `plantfit export-study`."""

from pathlib import Path
from typing import Annotated

import typer

from plantfit.errors import SpecError
from plantfit.study.store.addresses import STORE, VARIABLE


def export(
    study: Annotated[
        str | None, typer.Argument(help="The study file (TOML) whose plant is exported; a number of `plantfit list` without --to.")
    ] = None,
    to: Annotated[str | None, typer.Option("--to", help="python, c, casadi, control, matlab, csv, fmu or arviz.")] = None,
    recording: Annotated[
        str | None, typer.Option("--recording", help="Whose first values the plant begins at; the first recording if left out.")
    ] = None,
    number: Annotated[
        int | None, typer.Option("--study", help="With --to: number of the study; the newest of that name if left out.")
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Without --to: the study as JSON; with --to: print the names of the files as JSON.")
    ] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="Without --to: the study as Parquet.")] = False,
    out: Annotated[str | None, typer.Option("--out", "-o", help="With --to the folder, else the file to write.")] = None,
    store: Annotated[str, typer.Option("--store", envvar=VARIABLE, help="Study database.")] = STORE,
) -> None:
    """Write the plant of a finished study for another program (--to); without --to the study itself, as `export-study` does."""
    if to is None:
        return _study(study, json, parquet, out, store)
    if study is None:
        raise SpecError(f"--to {to} needs a study file; write for example `plantfit export heater.toml --to {to}`.")
    from plantfit.cli.commands.design.tuned_study import answer_for, read_tables
    from plantfit.cli.terminal.out import out as screen
    from plantfit.cli.terminal.out import print_json

    table = read_tables(study)
    answer = answer_for(table, Path(study), number, store)
    from plantfit.bridges import export_plant

    files = export_plant(answer, to, out or ".", recording=recording)
    if json:
        return print_json({"to": to, "files": [str(f) for f in files]})
    screen.print(f"Written: {', '.join(str(f) for f in files)}", markup=False)


def _study(study: str | None, json: bool, parquet: bool, out: str | None, store: str) -> None:
    from plantfit.cli.commands import exchange
    from plantfit.cli.terminal.out import warn

    if study is not None and not (study.isascii() and study.isdigit()):
        raise SpecError(
            f"What is {study} to be exported to? Write for example `plantfit export {study} --to python`; a study of the store "
            f"is written by "
            "`plantfit export-study NUMBER`."
        )
    exchange.export(None if study is None else int(study), json, parquet, out, store)
    warn("`plantfit export` of a study is now `plantfit export-study`; this works as before.")
