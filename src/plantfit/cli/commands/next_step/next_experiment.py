"""`plantfit design`: the input to record next."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plantfit.experiment_design import ExperimentDesign


def design(
    spec: str, limits: Mapping[str, Sequence[str]], wanted: str | None, asked: Mapping[str, Any], against: str | None,
    study: int | None, out: str | None, page: str | None, force: bool, store: str, json: bool,
) -> None:  # fmt: skip
    """The input that tells most about a study's parameters, or tells two models apart, within limits: a CSV for
    `record`, and a page."""
    from plantfit.cli.arguments.file_names import file_name
    from plantfit.cli.arguments.quantities import ranges_by_name, texts_by_name
    from plantfit.cli.commands.next_step.tuned_study import answer_for, read_tables
    from plantfit.errors import StoreError

    inputs, kept = ranges_by_name("--input", limits["inputs"]), ranges_by_name("--limit", limits["limits"])
    slew, noise = (texts_by_name(f"--{name}", limits[name]) for name in ("slew", "noise"))
    parameters = [n.strip() for n in wanted.split(",") if n.strip()] if wanted else []
    table, other = read_tables(spec), read_tables(against) if against else None
    target = Path(out or file_name(f"{table.name}-next", "csv"))
    drawn = Path(page) if page else target.with_suffix(".html")
    from plantfit.report.html import check_place

    check_place(drawn)
    if target.exists() and not force:
        raise StoreError(f"{target} exists already; give another place with --out, or --force to overwrite it.")
    answer = answer_for(table, Path(spec), study, store)
    rival = answer_for(other, Path(against), None, store) if other is not None and against else None
    from plantfit.cli.terminal.out import print_json, said_line
    from plantfit.experiment_design import design as designed

    with said_line(quiet=json) as say:
        found = designed(
            answer, against=rival, inputs=inputs, limits=kept, slew=slew, noise=noise, parameters=parameters,
            progress=_progress(say),
            **asked,
        )  # fmt: skip
    files = _written(found, target, drawn)
    if json:
        return print_json(found.typed.printed(files=[str(f) for f in files]))
    _show(found)
    from plantfit.cli.terminal.out import out as screen

    screen.print(f"Written: {', '.join(str(f) for f in files)}", markup=False)
    if found.typed.levels:
        return screen.print(f"Next: measure at the levels of {target}", markup=False)
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
