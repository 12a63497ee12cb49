"""`plantfit design`: the input to record next."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from plantfit.study.store.addresses import STORE, VARIABLE

if TYPE_CHECKING:
    from plantfit.experiment_design import ExperimentDesign


def design(
    spec: Annotated[str, typer.Argument(help="The study file (TOML) of a finished study.")],
    input_: Annotated[
        list[str] | None, typer.Option("--input", help="From where to where an input may go: u=0..100; as recorded if left out (repeat).")
    ] = None,
    limit: Annotated[
        list[str] | None, typer.Option("--limit", help="Keep an output or a state within: 'T=20..80 degC', T=..80 (repeat).")
    ] = None,
    slew: Annotated[list[str] | None, typer.Option("--slew", help="Fastest change of an input per second: u=5 (repeat).")] = None,
    duration: Annotated[str | None, typer.Option("--duration", help="Length of the new recording, as in 10min.")] = None,
    rate: Annotated[str | None, typer.Option("--rate", help="Samples a second, as in 100Hz.")] = None,
    hold: Annotated[str | None, typer.Option("--hold", help="Shortest time that a level lasts, as in 5s.")] = None,
    for_: Annotated[str | None, typer.Option("--for", help="Parameters that shall become certain, as in tau,K; all if left out.")] = None,
    criterion: Annotated[str, typer.Option("--criterion", help="D: the ellipsoid of all errors; A: their mean square.")] = "D",
    against: Annotated[
        str | None, typer.Option("--against", help="Study file of another model: the input then tells which one is right.")
    ] = None,
    alone: Annotated[bool, typer.Option("--alone", help="The new recording counts alone, without those of the study.")] = False,
    noise: Annotated[list[str] | None, typer.Option("--noise", help="Standard deviation of an output's noise: y=0.1 (repeat).")] = None,
    draws: Annotated[int, typer.Option("--draws", help="Other plants that the data allow, on which the input has to serve.")] = 8,
    budget: Annotated[int, typer.Option("--budget", help="Inputs to try.")] = 3000,
    seed: Annotated[int, typer.Option("--seed", help="Same seed, same input.")] = 1,
    study: Annotated[int | None, typer.Option("--study", help="Number of the study; the newest of that name if left out.")] = None,
    out: Annotated[str | None, typer.Option("--out", "-o", help="Where the input goes; NAME-next.csv if left out.")] = None,
    page: Annotated[str | None, typer.Option("--page", help="Where the page goes; beside the input if left out.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the CSV file if it is there.")] = False,
    store: Annotated[str, typer.Option("--store", envvar=VARIABLE, help="Study database.")] = STORE,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON value, nothing else, on standard output.")] = False,
) -> None:
    """The input that tells most about a study's parameters, or tells two models apart, within limits: a CSV for `record`, and a page."""
    from plantfit.cli.arguments.file_names import file_name
    from plantfit.cli.arguments.quantities import ranges_by_name, texts_by_name
    from plantfit.cli.commands.design.tuned_study import answer_for, read_tables
    from plantfit.errors import StoreError

    asked: dict[str, Any] = {
        "inputs": ranges_by_name("--input", input_ or []),
        "limits": ranges_by_name("--limit", limit or []),
        "slew": texts_by_name("--slew", slew or []),
        "noise": texts_by_name("--noise", noise or []),
        "parameters": [n.strip() for n in for_.split(",") if n.strip()] if for_ else [],
        "duration": duration, "rate": rate, "hold": hold, "criterion": criterion, "alone": alone, "draws": draws, "budget": budget,
        "seed": seed,
    }  # fmt: skip
    table, other = read_tables(spec), read_tables(against) if against else None
    target = Path(out or file_name(f"{table.name}-next", "csv"))
    drawn = Path(page) if page else target.with_suffix(".html")
    from plantfit.report.html import check_place

    check_place(drawn)
    if target.exists() and not force:
        raise StoreError(f"{target} is there already; give another place with --out, or --force to replace it.")
    answer = answer_for(table, Path(spec), study, store)
    rival = answer_for(other, Path(against), None, store) if other is not None and against else None
    from plantfit.cli.terminal.out import print_json, said_line
    from plantfit.experiment_design import design as designed

    with said_line(quiet=json) as say:
        found = designed(answer, against=rival, progress=_progress(say), **asked)
    files = _written(found, target, drawn)
    if json:
        return print_json(found.typed.printed(files=[str(f) for f in files]))
    _show(found)
    from plantfit.cli.terminal.out import out as screen

    screen.print(f"Written: {', '.join(str(f) for f in files)}", markup=False)
    screen.print(f"Next: plantfit record --excitation {target}", markup=False)


def _progress(say: Callable[[str], None] | None) -> Callable[[int, int, float], None] | None:
    """Inputs tried and the time left, in words."""
    if say is None:
        return None
    began = time.monotonic()

    def tell(tried: int, budget: int, cost: float) -> None:
        if tried % 20 == 0:
            if tried > budget:  # classical shapes are tried whatever was asked for
                return say(f"{tried} inputs tried; the classical shapes alone are more than the {budget} asked for")
            left = (time.monotonic() - began) * max(0.0, budget / tried - 1.0)
            say(f"{tried} of {budget} inputs tried, at most {left:.0f} s left")

    return tell


def _written(found: "ExperimentDesign", target: Path, page: Path) -> list[Path]:
    from plantfit.recording import to_csv
    from plantfit.report.pages.next_experiment import write_next_experiment_page

    to_csv(found.recording, target)
    signals = {n: (found.recording[n], s.unit) for n, s in found.recording.signals.items()}
    outputs = found.answer.problem.model.outputs
    predicted = {n: (y, outputs[n]) for n, y in found.predicted().items()}
    return [target, write_next_experiment_page(found.typed, found.t, signals, predicted, page, target.name)]


def _show(found: "ExperimentDesign") -> None:
    """Verdict and table on the terminal."""
    from plantfit.cli.terminal.out import out, verdict
    from plantfit.report.pages.next_experiment import COLUMNS, asked, error_rows
    from plantfit.report.text import columns

    verdict(found.record)
    for sentence in asked(found.typed):
        out.print(f"  {sentence}", markup=False)
    rows: Sequence[tuple[str, ...]] = error_rows(found.typed)
    out.print(columns(COLUMNS, rows, range(1, len(COLUMNS))), markup=False)
