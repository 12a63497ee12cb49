"""The commands before there is a fit: what they take, and their lines in `plantfit --help`."""

from typing import Annotated

import typer

from plantfit.cli.options.shared import Json, Spec

Order = Annotated[
    str | None,
    typer.Option("--dates", help='"day first" or "month first", where dates of the recording do not tell it.'),
]


def demo(
    name: Annotated[str, typer.Argument(help="Name of a demo; see `plantfit demo --list`.")] = "gearmotor",
    out: Annotated[str, typer.Option("--out", "-o", help="Folder for the reports.")] = "out",
    list_: Annotated[bool, typer.Option("--list", help="List the demos and stop.")] = False,
    full: Annotated[
        bool, typer.Option("--full", help="Run the whole study and not the short one, where a demo has both.")
    ] = False,
    files: Annotated[
        bool, typer.Option("--files", help="Only copy its recordings and study files, so that you can work with them.")
    ] = False,
    json: Json = False,
) -> None:
    """Work a demo that comes with plantfit, end to end, and write its reports."""
    from plantfit.cli.commands.begin import demos

    if list_:
        demos.listed(json)
    elif files:
        demos.copied(name, out, json)
    else:
        demos.demo(name, out, full, json)


def init(
    file: Annotated[str, typer.Argument(help="A recording: CSV, CSV.gz, Parquet, XLSX, MAT, NPZ.")],
    out: Annotated[
        str | None,
        typer.Option("--out", "-o", help="The study file to write; NAME.toml beside the recording if left out."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing study file.")] = False,
    inputs: Annotated[
        list[str] | None, typer.Option("--input", help="A column that is an input (repeat); none: nothing drives it.")
    ] = None,
    outputs: Annotated[list[str] | None, typer.Option("--output", help="A column that is an output (repeat).")] = None,
    candidates: Annotated[
        bool, typer.Option("--candidates", help="Write several kinds of model, fit and compare them.")
    ] = False,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Ask nothing; take the columns for what they seem to be.")
    ] = False,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            help="dc_motor: all its constants where a current is recorded, else what the speed alone determines.",
        ),
    ] = None,
    dates: Order = None,
    json: Json = False,
) -> None:
    """Say what the columns of a recording seem to be, and write a commented study file that runs."""
    from plantfit.cli.commands.begin import init as command

    command.init(file, out, force, json, inputs or (), outputs or (), yes, candidates, model, dates)


def new(
    name: Annotated[
        str | None, typer.Argument(help="A list of parts, NAME.net; with --from the name of the new study.")
    ] = None,
    from_: Annotated[str | None, typer.Option("--from", help="A plant to begin with; --list names them.")] = None,
    recording: Annotated[
        str | None,
        typer.Option("--recording", help="The file of measurements; its columns are found by name and unit."),
    ] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option("--column", help="SIGNAL=COLUMN, for a column that is not found that way (repeat)."),
    ] = None,
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="The study file to write; NAME.toml if left out.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
    list_: Annotated[bool, typer.Option("--list", help="List the plants to begin with and stop.")] = False,
    parts: Annotated[bool, typer.Option("--parts", help="List the parts that may be used and stop.")] = False,
    dates: Order = None,
    json: Json = False,
) -> None:
    """Write the study file of a plant from its parts (resistors, springs, tanks, motors, ...), or of one from the
    library."""
    from plantfit.cli.commands.begin import new as command

    if parts or list_:
        return command.tell_parts(json) if parts else command.tell_plants(json)
    command.new(name, from_, recording, columns or [], out, force, json, dates)


def look(
    file: Annotated[str, typer.Argument(help="A study file (TOML), or a file of measurements.")],
    input_: Annotated[
        list[str] | None,
        typer.Option(
            "--input", help="An input (repeat); if left out, those of the study, else columns that seem to be."
        ),
    ] = None,
    output: Annotated[
        list[str] | None,
        typer.Option(
            "--output", help="An output (repeat); if left out, those of the study, else columns that seem to be."
        ),
    ] = None,
    recording: Annotated[
        str | None, typer.Option("--recording", help="Which recording of a study file; the first if left out.")
    ] = None,
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="Where the HTML page goes; NAME-look.html if left out.")
    ] = None,
    dates: Order = None,
    json: Json = False,
) -> None:
    """Look at a recording without equations: frequency and step response, delay, and how well any linear model does."""
    from plantfit.cli.commands.begin import look as command

    command.look(file, input_ or [], output or [], recording, out, json, dates)


def check(
    spec: Spec,
    verify: Annotated[
        bool, typer.Option("--verify", help="Also compare the simulation of every recording with a tight solver.")
    ] = False,
    at: Annotated[
        list[str] | None,
        typer.Option(help="Parameter values, as name=value (repeat); the others stay in the middle of their bounds."),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="With --verify: halve the steps until the largest error is below this (unit of the output)."),
    ] = None,
    holds: Annotated[
        bool,
        typer.Option(
            "--holds",
            help="Also fit briefly with every input held, and interpolated, between samples; say which fits better.",
        ),
    ] = False,
    identify: Annotated[
        bool,
        typer.Option(
            "--identify",
            help="Say what the records can determine also for models with events, dry friction or backlash.",
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Read a study file and its recordings, say what was understood, and simulate once."""
    from plantfit.cli.commands.begin import check as command

    command.check(spec, verify, json, at or [], tolerance, holds, identify)


COMMANDS = {
    "demo": (demo, "See a real machine worked end to end"),
    "init": (init, "Write a study file from a recording"),
    "new": (new, "Write a study file from a list of parts, or from the library"),
    "look": (look, "Responses, delay and best linear model, without equations"),
    "check": (check, "Read a study file; say what its records can determine"),
}
