"""Options and arguments that several commands take."""

from typing import Annotated

import typer

from plantfit.study.store.addresses import VARIABLE

Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON value for scripts on standard output, and nothing else.")
]
StorePlace = Annotated[
    str, typer.Option("--store", envvar=VARIABLE, help="Study database: a file, or a SQLAlchemy URL.")
]
StudyId = Annotated[
    str | None,
    typer.Argument(help="The study: its number or name in `plantfit list`, or its file; the newest if left out."),
]
ReportPlace = Annotated[
    str | None, typer.Option("--out", "-o", help="Where the HTML report goes; NAME.html if left out.")
]
Workers = Annotated[
    str | None,
    typer.Option(
        "--workers",
        help="Worker processes: a number, or auto for one per core. 1 if left out; short studies need no more.",
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        help="Address of a dask scheduler that does the work, as in tcp://host:8786, or local for one on this machine.",
    ),
]
NoDiagnose = Annotated[bool, typer.Option("--no-diagnose", help="Do not look for what is missing in the model.")]
OtherStudy = Annotated[
    int | None,
    typer.Option("--study", help="Take the other parameters from this study; the newest of that name if left out."),
]
StudyNumber = Annotated[
    int | None, typer.Option("--study", help="Number of the study; the newest of that name if left out.")
]
FitWorkers = Annotated[
    str | None, typer.Option("--workers", help="Worker processes, if the study has to be fitted first.")
]
Given = Annotated[str, typer.Argument(help="The study file (TOML), or the number or name of a stored study.")]
Spec = Annotated[str, typer.Argument(help="The study file (TOML).")]
FinishedSpec = Annotated[str, typer.Argument(help="The study file (TOML) of a finished study.")]
