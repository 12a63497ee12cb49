"""The commands that fit a study and keep it: what they take, and their lines in `plantfit --help`."""

from typing import Annotated

import typer

from plantfit.cli.options.shared import (
    Json,
    NoDiagnose,
    OtherStudy,
    ReportPlace,
    Scheduler,
    StorePlace,
    StudyId,
    Workers,
)
from plantfit.study.store.addresses import STORE


def run(
    specs: Annotated[list[str], typer.Argument(help="Study files (TOML); several are worked on together.")],
    store: StorePlace = STORE,
    out: ReportPlace = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    try_: Annotated[
        list[str] | None,
        typer.Option(
            "--try",
            help='Add this to the model, as in --try "dead time of u" (repeat), keep the study file with it, and run '
            "that one.",
        ),
    ] = None,
    pieces: Annotated[
        float | None,
        typer.Option(
            help="Cut recordings into pieces of so many seconds with starts of their own, keep the study file with "
            "them, and run that one."
        ),
    ] = None,
    no_diagnose: NoDiagnose = False,
    json: Json = False,
) -> None:
    """Run a study, keep every run in the store, look for what is missing in its model where the residual is more
    than noise, and write the report. Ctrl-C saves; `plantfit resume` goes on."""
    from plantfit.cli.commands.fit import studies

    studies.run(specs, store, out, json, workers, scheduler, try_ or [], pieces, not no_diagnose)


def resume(
    study: Annotated[
        list[int] | None,
        typer.Argument(help="Numbers of studies in `plantfit list`; the newest unfinished if left out."),
    ] = None,
    store: StorePlace = STORE,
    out: ReportPlace = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    no_diagnose: NoDiagnose = False,
    json: Json = False,
) -> None:
    """Go on with interrupted studies, bit for bit as if they had not stopped."""
    from plantfit.cli.commands.fit import studies

    studies.resume(study or [], store, out, json, workers, scheduler, not no_diagnose)


def list_(store: StorePlace = STORE, json: Json = False) -> None:
    """List the studies of a store."""
    from plantfit.cli.commands.fit import studies

    studies.listed(store, json)


def report(
    study: StudyId = None,
    store: StorePlace = STORE,
    out: ReportPlace = None,
    no_diagnose: NoDiagnose = False,
    json: Json = False,
) -> None:
    """Write the report of a study again, or print its figures with --json."""
    from plantfit.cli.commands.fit import studies

    studies.report(study, store, out, json, not no_diagnose)


def predict(
    spec: Annotated[str, typer.Argument(help="The study file (TOML); its recordings may be new ones.")],
    out: Annotated[str, typer.Option("--out", "-o", help="CSV file to write.")] = "predicted.csv",
    values: Annotated[
        list[str] | None, typer.Option("--set", help="A parameter, as NAME=VALUE in its unit; may be repeated.")
    ] = None,
    study: OtherStudy = None,
    recording: Annotated[
        str | None, typer.Option("--recording", help="Which recording of the study file; the first if left out.")
    ] = None,
    bands: Annotated[
        bool,
        typer.Option(
            "--bands", help="Also give bands of the plant and of readings, over all parameters that the data allow."
        ),
    ] = False,
    level: Annotated[str, typer.Option("--level", help="Confidence level of the bands, as in 95%.")] = "95%",
    store: StorePlace = STORE,
    json: Json = False,
) -> None:
    """Simulate a study's model over a recording at its best parameters and write a CSV."""
    from plantfit.cli.commands.fit import predict as command

    command.predict(spec, out, values or [], study, recording, level if bands else None, store, json)


COMMANDS = {
    "run": (run, "Search the parameters, judge them, write the report"),
    "resume": (resume, "Go on with a study that was stopped, bit for bit"),
    "list": (list_, "List the studies of a store"),
    "report": (report, "Write the report of a study again"),
    "predict": (predict, "Simulate a fitted model over a recording, with bands"),
}
