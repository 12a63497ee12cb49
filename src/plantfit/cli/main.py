"""The command line: every command is a thin layer over the same Python calls.

Exit codes: 0 done; 2 wrong arguments; 3 recording; 4 unit; 5 model or equation; 6 parameters;
7 study file; 8 search; 9 simulation; 10 store; 11 missing extra; 12 file system; 130 stopped by Ctrl-C.
"""

import sys
from typing import Annotated

import typer

from plantfit.errors import PlantfitError

app = typer.Typer(
    name="plantfit",
    help="From recordings of machines and processes to physical parameters that can be trusted.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON value for scripts, nothing else, on standard output.")]
StorePlace = Annotated[str, typer.Option("--store", envvar="PLANTFIT_STORE", help="Study database: a file, or a SQLAlchemy URL.")]
StudyId = Annotated[int | None, typer.Argument(help="Number of the study in `plantfit list`; the newest if left out.")]
ReportPlace = Annotated[str | None, typer.Option("--out", "-o", help="Where the HTML report goes; NAME.html if left out.")]
STORE = "plantfit.db"


@app.command()
def demo(
    name: Annotated[str, typer.Argument(help="gearmotor, tanks or emps; see `plantfit demo --list`.")] = "gearmotor",
    out: Annotated[str, typer.Option("--out", "-o", help="Folder for the reports.")] = "out",
    list_: Annotated[bool, typer.Option("--list", help="Name the demos and stop.")] = False,
    json: Json = False,
) -> None:
    """Fit a real recording that comes with plantfit, end to end, and write its report."""
    from plantfit.cli import demos

    demos.listed(json) if list_ else demos.demo(name, out, json)


@app.command()
def init(
    file: Annotated[str, typer.Argument(help="A recording: CSV, CSV.gz, Parquet, XLSX, MAT, NPZ.")],
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="The study file to write; NAME.toml beside the recording if left out.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing study file.")] = False,
    json: Json = False,
) -> None:
    """Look at the columns of a recording and write a commented study file that runs."""
    from plantfit.cli import init as command

    command.init(file, out, force, json)


@app.command()
def check(
    spec: Annotated[str, typer.Argument(help="The study file (TOML).")],
    verify: Annotated[bool, typer.Option("--verify", help="Also compare the simulation of every recording with a tight solver.")] = False,
    at: Annotated[
        list[str] | None, typer.Option(help="Parameter values, as name=value (repeat); the others stay in the middle of their bounds.")
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="With --verify: halve the steps until the largest error is below this (unit of the output).")
    ] = None,
    json: Json = False,
) -> None:
    """Read a study file and its recordings, say what was understood, and simulate once."""
    from plantfit.cli import check as command

    command.check(spec, verify, json, at or [], tolerance)


@app.command()
def run(
    spec: Annotated[str, typer.Argument(help="The study file (TOML).")],
    store: StorePlace = STORE,
    out: ReportPlace = None,
    json: Json = False,
) -> None:
    """Run a study, keep every run in the store, and write the report. Ctrl-C saves; `plantfit resume` goes on."""
    from plantfit.cli import studies

    studies.run(spec, store, out, json)


@app.command()
def resume(study: StudyId = None, store: StorePlace = STORE, out: ReportPlace = None, json: Json = False) -> None:
    """Go on with an interrupted study, bit for bit as if it had not stopped."""
    from plantfit.cli import studies

    studies.resume(study, store, out, json)


@app.command("list")
def list_(store: StorePlace = STORE, json: Json = False) -> None:
    """List the studies of a store."""
    from plantfit.cli import studies

    studies.listed(store, json)


@app.command()
def report(study: StudyId = None, store: StorePlace = STORE, out: ReportPlace = None, json: Json = False) -> None:
    """Write the report of a study again, or print its figures with --json."""
    from plantfit.cli import studies

    studies.report(study, store, out, json)


@app.command()
def predict(
    spec: Annotated[str, typer.Argument(help="The study file (TOML); its recordings may be new ones.")],
    out: Annotated[str, typer.Option("--out", "-o", help="CSV file to write.")] = "predicted.csv",
    values: Annotated[list[str] | None, typer.Option("--set", help="A parameter, as NAME=VALUE in its unit; may be repeated.")] = None,
    study: Annotated[
        int | None, typer.Option("--study", help="Take the other parameters from this study; the newest of that name if left out.")
    ] = None,
    recording: Annotated[str | None, typer.Option("--recording", help="Which recording of the study file; the first if left out.")] = None,
    store: StorePlace = STORE,
    json: Json = False,
) -> None:
    """Simulate a study's model over a recording at its best parameters and write a CSV."""
    from plantfit.cli import predict as command

    command.predict(spec, out, values or [], study, recording, store, json)


@app.command()
def methods(json: Json = False) -> None:
    """List the search methods with what they need and their settings."""
    from plantfit.cli import catalogue

    catalogue.methods(json)


@app.command()
def models(name: Annotated[str | None, typer.Argument(help="Show one model in full.")] = None, json: Json = False) -> None:
    """List the models that come with plantfit."""
    from plantfit.cli import catalogue

    catalogue.models(name, json)


def run_cli() -> None:
    """Entry point: errors meant for the user become one line and an exit code."""
    try:
        app(standalone_mode=True)
    except PlantfitError as error:
        print(f"plantfit: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except OSError as error:
        place = f" {error.filename!r}" if error.filename else ""
        print(
            f"plantfit: the file system refused{place}: {error.strerror or error}. Free space or choose another place and run again.",
            file=sys.stderr,
        )
        sys.exit(12)
    except KeyboardInterrupt:
        print("plantfit: stopped before anything was begun.", file=sys.stderr)
        sys.exit(130)
