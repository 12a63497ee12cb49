"""`plantfit compare` of search methods."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plantfit.cli.terminal.out import MARKS, out, print_json
from plantfit.errors import SearchError, StoreError
from plantfit.findings.results.methods_compared import ComparisonOfMethods, MethodRuns
from plantfit.study.store.addresses import shown


def compare(
    numbers: Sequence[int], store: str, place: str, latex: str | None, table: str | None,
    asked: Sequence[float], floor: float | None, optimum: float | None, seed: int, json: bool,
) -> None:  # fmt: skip
    """Compare the methods of one study or several, which may be of one problem or several."""
    from plantfit.report import write_comparison
    from plantfit.report.html import check_place
    from plantfit.report.sections.paper_tables import csv_table, latex_table
    from plantfit.study import Store
    from plantfit.study.comparing.gathering import gather
    from plantfit.study.comparing.record import compared

    _check_numbers({"--target": asked, "--floor": [floor], "--optimum": [optimum]})
    check_place(Path(place))
    opened = Store.open(store, create=False)
    chosen = _chosen(opened, numbers, store)
    problems = gather(opened, chosen, floor=floor, optimum=optimum)
    record = compared(problems, asked=asked, seed=seed).having(reproduction=_reproduction(opened, chosen, store, seed))
    written = {"report": str(write_comparison(record, place))}
    for key, target, text in (("latex", latex, latex_table), ("csv", table, csv_table)):
        if target is not None:
            Path(target).write_text(text(record), encoding="utf-8")
            written[key] = target
    if json:
        return print_json(record.printed(written=written))
    _say(record)
    out.print("\nWritten: " + ", ".join(written.values()), markup=False)


def _check_numbers(given: dict[str, Sequence[float | None]]) -> None:
    for option, values in given.items():
        for v in values:
            if v is not None and not abs(v) < float("inf"):
                raise SearchError(f"{option} is {v}; give a finite cost, in the cost's own unit.")


def _chosen(opened: Any, numbers: Sequence[int], store: str) -> list[int]:
    """Studies once each, the newest if none is named."""
    if numbers:
        return list(dict.fromkeys(numbers))
    records = opened.studies()
    if not records:
        raise StoreError(f"{shown(store)} holds no study; start one with `plantfit run STUDY.toml`.")
    return [records[-1].id]


def _reproduction(opened: Any, chosen: Sequence[int], store: str, seed: int) -> dict[str, str]:
    records = [opened.study(n) for n in chosen]
    versions = dict.fromkeys(", ".join(f"{k} {v}" for k, v in r.versions.items()) for r in records)
    return {
        "command": f"plantfit compare {' '.join(map(str, chosen))} --store {shlex.quote(shown(store))} --seed {seed}",
        "studies": "; ".join(
            f"{r.id} {r.name}, {r.runs_done} of {r.runs_total} runs, {r.created[:19]}" for r in records
        ),
        "seeds": "; ".join(f"{r.id}: {r.plan['seed']}" for r in records),
        "processor": "; ".join(dict.fromkeys(r.cpu for r in records)),
        "versions": "; ".join(versions),
    }


def _say(record: ComparisonOfMethods) -> None:
    for problem in record.problems:
        out.print(f"[bold]{_escaped(problem.name)}[/bold]")
        out.print(_table(problem.methods), soft_wrap=False)
        for s in problem.sentences:
            _line(s.level, s.sentence)
        out.print()
    if record.across:
        out.print("[bold]Over all problems[/bold]")
        for sentence in record.across.sentences:
            _line("info", sentence)


def _line(level: str, sentence: str) -> None:
    colour, mark = MARKS[level]
    out.print(f"[{colour}]{mark}[/{colour}] ", end="")
    out.print(sentence, markup=False)


def _table(methods: Sequence[MethodRuns]) -> Any:
    from rich.table import Table

    from plantfit.report.numbers import seconds, significant

    table = Table(box=None, pad_edge=False)
    table.add_column("method", no_wrap=True)
    # as many as fit into 80 columns; the rest is in the report and its tables
    for name in ("runs", "best", "median", "worst", "evaluations", "time"):
        table.add_column(name, justify="right", no_wrap=True)
    for m in methods:
        c = m.cost
        numbers = (significant(v, 5, ascii_only=True) for v in (c.minimum, c.median, c.maximum))
        failed = f" + {c.failed} failed" if c.failed else ""
        effort = (f"{m.evaluations.mean:.0f}", seconds(m.seconds.mean))
        table.add_row(_escaped(m.name), f"{c.n}{failed}", *numbers, *effort)
    return table


def _escaped(text: str) -> str:
    from rich.markup import escape

    return escape(text)
