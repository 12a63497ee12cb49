"""The commands that say what there is: what they take, and their lines in `plantfit --help`."""

from typing import Annotated

import typer

from plantfit.cli.options.shared import Json, Spec


def methods(
    name: Annotated[str | None, typer.Argument(help="Show one method in full.")] = None, json: Json = False
) -> None:
    """List the search methods and what they need, or one with its paper and settings."""
    from plantfit.cli.commands.reference import catalogue

    catalogue.methods(name, json)


def models(
    name: Annotated[str | None, typer.Argument(help="Show one model in full.")] = None, json: Json = False
) -> None:
    """List the models that come with plantfit."""
    from plantfit.cli.commands.reference import catalogue

    catalogue.models(name, json)


def schema(
    findings: Annotated[
        bool, typer.Option("--findings", help="The schema of the findings, which `plantfit run --json` prints.")
    ] = False,
    of: Annotated[
        str | None,
        typer.Option("--of", help="The schema of what another command prints with --json, as in compare-records."),
    ] = None,
) -> None:
    """Print the JSON schema of study files, by which editors complete and check keys."""
    from plantfit.cli.terminal.out import print_json

    if of is not None:
        from plantfit.findings.results.all_results import result_schema

        return print_json(result_schema(of))
    if findings:
        from plantfit.findings.whole import findings_schema

        return print_json(findings_schema())
    from plantfit.spec.tables import json_schema

    print_json(json_schema())


def tune_search(
    spec: Spec,
    method: Annotated[
        str, typer.Option("--method", "-m", help="The method whose settings are tuned; see `plantfit methods`.")
    ],
    outer: Annotated[str, typer.Option("--outer", help="The method that searches the settings.")] = "pso",
    budget: Annotated[
        int | None, typer.Option("--budget", help="Evaluations of a run; that of the study file if left out.")
    ] = None,
    runs: Annotated[int, typer.Option("--runs", help="How many seeds the settings are compared on.")] = 20,
    trials: Annotated[int, typer.Option("--trials", help="How many settings to try; the default is one of them.")] = 60,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the tuning; the same seed gives the same answer.")] = 1,
    only: Annotated[
        str | None, typer.Option("--only", help="Settings to tune, as in inertia,social; all if left out.")
    ] = None,
    ranges: Annotated[
        list[str] | None,
        typer.Option("--range", help="Narrow a setting: inertia=0.4:0.9, or topology=global,ring (repeat)."),
    ] = None,
    hold: Annotated[
        list[str] | None, typer.Option("--hold", help="A setting to hold at a value: population=50 (repeat).")
    ] = None,
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="Also write the settings block to this TOML file.")
    ] = None,
    json: Json = False,
) -> None:
    """Tune the settings of a search method on your own problem, and say whether that paid. Ctrl-C keeps the best so
    far."""
    from plantfit.cli.commands.reference import tune_search as tune

    tune.tune_search(spec, method, outer, budget, runs, trials, seed, only, ranges or [], hold or [], out, json)


COMMANDS = {
    "methods": (methods, "The search methods, or one with its settings"),
    "models": (models, "The models of the library, or one with its equations"),
    "schema": (schema, "The JSON schema of study files, for editors"),
    "tune-search": (tune_search, "Tune the settings of a search method on your problem"),
}
