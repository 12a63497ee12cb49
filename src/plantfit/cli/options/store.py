"""The commands that move and watch studies in stores: what they take, and their lines in `plantfit --help`."""

from typing import Annotated

import typer

from plantfit.cli.options.shared import Json, StorePlace, StudyId
from plantfit.study.store.addresses import STORE


def export_study(
    study: StudyId = None,
    json: Annotated[
        bool, typer.Option("--json", help="As JSON, NAME.json unless --out says otherwise; the default.")
    ] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="As Parquet, one row per run: NAME.parquet.")] = False,
    out: Annotated[str | None, typer.Option("--out", "-o", help="The file to write.")] = None,
    store: StorePlace = STORE,
) -> None:
    """Write a study, finished or not, to a file that `plantfit import` brings back bit for bit."""
    from plantfit.cli.commands.store import exchange

    exchange.export(study, json, parquet, out, store)


def import_(
    files: Annotated[list[str], typer.Argument(help="Files that `plantfit export-study` wrote.")],
    spec: Annotated[
        str | None,
        typer.Option(
            "--spec", help="Place of the study file on this machine; its recordings are looked for beside it."
        ),
    ] = None,
    store: StorePlace = STORE,
    json: Json = False,
) -> None:
    """Bring exported studies into a store; an unfinished one goes on with `plantfit resume`."""
    from plantfit.cli.commands.store import exchange

    exchange.import_(files, spec, store, json)


def merge(
    sources: Annotated[list[str], typer.Argument(help="Stores or exported files of other machines.")],
    store: StorePlace = STORE,
    json: Json = False,
) -> None:
    """Bring the studies of other stores into this one; runs of the same study become one study."""
    from plantfit.cli.commands.store import exchange

    exchange.merge(sources, store, json)


def workers(
    study: Annotated[
        int | None, typer.Argument(help="Number of a study in `plantfit list`; all unfinished ones if left out.")
    ] = None,
    store: StorePlace = STORE,
    watch: Annotated[bool, typer.Option("--watch", help="Show it again every second until Ctrl-C.")] = False,
    json: Json = False,
) -> None:
    """Show what every worker does now: machine, task, share of its budget, last sign of life."""
    from plantfit.cli.terminal import watching

    watching.workers(study, store, watch, json)


COMMANDS = {
    "export-study": (export_study, "Write a study to a file for another store"),
    "import": (import_, "Bring exported studies into a store"),
    "merge": (merge, "Bring the studies of other stores into this one"),
    "workers": (workers, "Show what every worker does now"),
}
