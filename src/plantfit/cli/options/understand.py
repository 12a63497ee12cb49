"""The commands that say what a fit is worth: what they take, and their lines in `plantfit --help`."""

from typing import Annotated

import typer

from plantfit.cli.options.shared import FitWorkers, Given, Json, OtherStudy, Spec, StorePlace, StudyId, Workers
from plantfit.study.store.addresses import STORE


def diagnose(
    spec: Spec,
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="The study file to write; NAME-with-....toml if left out.")
    ] = None,
    try_: Annotated[
        list[str] | None,
        typer.Option(
            "--try",
            help='Try only this and write it, as in --try "dead time of u" (repeat); an unknown word lists all that '
            "can be tried.",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file if it exists.")] = False,
    json: Json = False,
) -> None:
    """Fit a study, try what may be missing in its model, say what each explains, and write the study file with what
    is missing."""
    from plantfit.cli.commands.understand import diagnose as command

    command.diagnose(spec, out, try_ or [], force, json)


def compare(
    given: Annotated[
        list[str] | None,
        typer.Argument(
            help="Study files (TOML) of models of the same data; or numbers or names of stored studies, the newest if "
            "left out."
        ),
    ] = None,
    store: StorePlace = STORE,
    out: Annotated[str, typer.Option("--out", "-o", help="Where the HTML comparison goes.")] = "compare.html",
    models: Annotated[
        bool | None,
        typer.Option(
            "--models/--methods", help="What stored studies are compared by; if left out, what is given decides."
        ),
    ] = None,
    linear: Annotated[
        bool,
        typer.Option(
            "--linear/--no-linear", help="Models: also fit the best linear model without physics, as a baseline."
        ),
    ] = True,
    workers: Workers = None,
    latex: Annotated[
        str | None, typer.Option("--latex", help="Also write a table for papers (booktabs) to this file.")
    ] = None,
    csv: Annotated[str | None, typer.Option("--csv", help="Also write the table to this CSV file.")] = None,
    target: Annotated[
        list[float] | None, typer.Option("--target", help="A cost that counts as reached (repeat).")
    ] = None,
    floor: Annotated[float | None, typer.Option("--floor", help="The cost that noise alone leaves, if known.")] = None,
    optimum: Annotated[float | None, typer.Option("--optimum", help="The lowest cost there can be, if known.")] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the bootstrap intervals.")] = 0,
    json: Json = False,
) -> None:
    """Compare models of the same data, or search methods.

    Study files, or stored studies of different models of the same data: fits what is not fitted yet and says which
    predicts unseen data better, by how much, and what AICc and BIC choose. Otherwise the methods of the studies over
    their runs: who wins, by how much, how sure; studies of one problem are put together, studies of different
    problems are the replicates of one comparison."""
    from plantfit.cli.commands.understand import chosen

    chosen.compare(
        given or [], store, out, latex, csv, target or [], floor, optimum, seed, models, linear, workers, json
    )


def compare_records(
    given: Given,
    store: StorePlace = STORE,
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="Where the HTML page goes; NAME-records.html if left out.")
    ] = None,
    workers: Workers = None,
    json: Json = False,
) -> None:
    """Fit each recording of a study alone; say whether they agree on the parameters, and which one no longer fits
    the others."""
    from plantfit.cli.commands.understand import records

    records.compare_records(given, store, out, workers, json)


def intervals(
    given: Given,
    kinds: Annotated[
        str,
        typer.Option(
            "--kinds", help="Kinds of interval, with commas between: covariance, profile, bootstrap, posterior."
        ),
    ] = "covariance,profile,bootstrap",
    posterior: Annotated[
        bool, typer.Option("--posterior", help="Also draw the posterior, by NUTS; needs plantfit[posterior].")
    ] = False,
    only: Annotated[
        str | None, typer.Option("--only", help="Only these parameters, as in tau,K; all if left out.")
    ] = None,
    level: Annotated[str, typer.Option("--level", help="Confidence level, as in 95% or 0.95.")] = "95%",
    replicates: Annotated[int, typer.Option("--replicates", help="Number of refits of the bootstrap.")] = 400,
    chains: Annotated[int, typer.Option("--chains", help="Number of chains of the posterior.")] = 4,
    draws: Annotated[int, typer.Option("--draws", help="Number of draws of each chain.")] = 1000,
    prior: Annotated[
        list[str] | None, typer.Option("--prior", help="Prior knowledge, for the posterior: 'tau=138 +- 5 s' (repeat).")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the draws; the same seed gives the same numbers.")] = 1,
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="Where the HTML page goes; NAME-intervals.html if left out.")
    ] = None,
    save_draws: Annotated[
        str | None, typer.Option("--save-draws", help="Also write the posterior's draws, as netCDF.")
    ] = None,
    store: StorePlace = STORE,
    workers: FitWorkers = None,
    json: Json = False,
) -> None:
    """Intervals by covariance, profile likelihood, bootstrap and posterior, side by side, and where they disagree."""
    from plantfit.cli.commands.understand import intervals as command

    numbers = {"replicates": replicates, "chains": chains, "draws": draws, "seed": seed}
    command.intervals(given, kinds, posterior, only, level, numbers, prior or [], out, save_draws, store, workers, json)


def estimate(
    given: Given,
    methods: Annotated[
        list[str] | None,
        typer.Option(
            "--method",
            help="maximum likelihood, generalised least squares, ekf, ukf or kalman (repeat); those of the [estimate] "
            "table if left out.",
        ),
    ] = None,
    store: StorePlace = STORE,
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="Also write an HTML page that shows how each constant settles.")
    ] = None,
    states: Annotated[
        str | None,
        typer.Option(
            "--states",
            help="Also write a CSV file of the states over each recording, filtered and smoothed, with their errors.",
        ),
    ] = None,
    workers: Workers = None,
    json: Json = False,
) -> None:
    """Parameters by maximum likelihood and Kalman filters beside least squares; noise levels, and whether the
    methods agree."""
    from plantfit.cli.commands.understand import estimators

    estimators.estimate(given, methods or [], store, out, states, workers, json)


def sensitivity(
    spec: Spec,
    method: Annotated[
        str, typer.Option("--method", "-m", help="morris (effects around an answer) or sobol (shares of variance).")
    ] = "morris",
    radius: Annotated[
        float | None,
        typer.Option(
            "--radius", help="How far from the point, as a share of the bounds; 0.01 for morris, the box for sobol."
        ),
    ] = None,
    box: Annotated[bool, typer.Option("--box", help="Look at the whole box, and not around a point.")] = False,
    groups: Annotated[
        list[str] | None,
        typer.Option(
            "--group",
            help="Parameters that move together, NAME=k,tau (repeat); the others stay. Each alone if left out.",
        ),
    ] = None,
    trajectories: Annotated[int, typer.Option("--trajectories", help="morris: number of trajectories.")] = 20,
    samples: Annotated[
        int,
        typer.Option(
            "--samples",
            help="sobol: number of samples, a power of two; the evaluations are this number times (groups + 2).",
        ),
    ] = 1024,
    confidence: Annotated[
        float, typer.Option("--confidence", help="Confidence level of the bootstrap intervals.")
    ] = 0.95,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the points; the same seed gives the same points.")] = 1,
    values: Annotated[
        list[str] | None, typer.Option("--set", help="A parameter of the point, as NAME=VALUE in its unit (repeat).")
    ] = None,
    study: OtherStudy = None,
    page: Annotated[
        str | None, typer.Option("--out", "-o", help="Also write a page with the table and a figure.")
    ] = None,
    store: StorePlace = STORE,
    json: Json = False,
) -> None:
    """Say which parameters the cost reacts to: Morris screening around an answer, or Sobol indices over the box."""
    from plantfit.cli.commands.understand import sensitivity as command

    counts = {"trajectories": trajectories, "samples": samples, "seed": seed}
    command.sensitivity(
        spec, method, radius, box, groups or [], counts, confidence, values or [], study, page, store, json
    )


def combine(
    study: StudyId = None,
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="The study file to write; NAME-combined.toml if left out.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file if it exists.")] = False,
    store: StorePlace = STORE,
    json: Json = False,
) -> None:
    """Write a study file whose parameters are the combinations that the data determine."""
    from plantfit.cli.commands.understand import combine as command

    command.combine(study, out, force, store, json)


COMMANDS = {
    "diagnose": (diagnose, "What is missing in the model, and how much it explains"),
    "compare": (compare, "Which of several models, or search methods, is better"),
    "compare-records": (compare_records, "Whether recordings agree, and which one does not"),
    "intervals": (intervals, "Covariance, profile, bootstrap, posterior side by side"),
    "estimate": (estimate, "Maximum likelihood and Kalman filters beside the fit"),
    "sensitivity": (sensitivity, "Which parameters the cost reacts to"),
    "combine": (combine, "Write a study of the combinations that are determined"),
}
