"""`plantfit export`: the plant of a finished study for another program; without --to a study, as `plantfit
export-study`."""

from pathlib import Path

from plantfit.errors import SpecError


def export(
    study: str | None, to: str, recording: str | None, number: int | None, json: bool, out: str | None, store: str
) -> None:
    """Write the plant of a finished study for another program."""
    if study is None:
        raise SpecError(f"--to {to} needs a study file; write for example `plantfit export heater.toml --to {to}`.")
    from plantfit.cli.commands.next_step.tuned_study import answer_for, read_tables
    from plantfit.cli.terminal.out import out as screen
    from plantfit.cli.terminal.out import print_json

    table = read_tables(study)
    answer = answer_for(table, Path(study), number, store)
    from plantfit.bridges import export_plant

    files = export_plant(answer, to, out or ".", recording=recording)
    if json:
        return print_json({"to": to, "files": [str(f) for f in files]})
    screen.print(f"Written: {', '.join(str(f) for f in files)}", markup=False)


def export_study(study: str | None, json: bool, parquet: bool, out: str | None, store: str) -> None:
    """The older way to write a study of the store to a file."""
    from plantfit.cli.commands.store import exchange
    from plantfit.cli.terminal.out import warn

    if study is not None and not (study.isascii() and study.isdigit()):
        raise SpecError(
            f"What is {study} to be exported to? Write for example `plantfit export {study} "
            "--to python`; a study of the store is written by `plantfit export-study NUMBER`."
        )
    exchange.export(study, json, parquet, out, store)
    warn("`plantfit export` of a study is now `plantfit export-study`; this works as before.")
