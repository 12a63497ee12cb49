"""`plantfit estimate`: the parameters of a study by several methods."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plantfit.cli.commands.understand.fitted import answers_of, one_given
from plantfit.cli.terminal.out import out, print_json, said_line, verdict
from plantfit.cli.terminal.working import worker_count


def estimate(given: str, methods: Sequence[str], store: str, place: str | None, workers: str | None, json: bool) -> None:
    """Estimate the parameters of a study; fits it first if the store has no answer of it."""
    from plantfit.report.html import check_place

    worker_count(workers, None)
    if place is not None:
        check_place(Path(place))
    from plantfit.estimators import check_estimable, estimate_parameters

    wishes: dict[str, Any] = {"methods": list(methods)} if methods else {}
    opened, one = one_given(given, store, lambda problem: check_estimable(problem, wishes))
    answers, numbers = answers_of(opened, [one], workers, json)
    with said_line(json) as say:
        table = one.ready.study.table.estimate.model_dump(exclude_unset=True)
        found = estimate_parameters(answers[given], progress=say, table=table, **wishes)
    written = {} if place is None else {"report": str(found.report(Path(place)))}
    if json:
        return print_json(found.typed.printed(study=numbers[given], written=written))
    out.print(found.table() + "\n", markup=False)
    verdict(found.record)
    if found.typed.assumed:
        out.print("\nAssumed, as the study file does not say ([estimate], docs/kalman.md):", markup=False)
        for sentence in found.typed.assumed:
            out.print(f"  {sentence}", markup=False)
    if written:
        out.print(f"\nReport: {written['report']}", markup=False)
