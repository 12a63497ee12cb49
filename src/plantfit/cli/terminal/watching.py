"""What workers do now: lines under the progress of a study, and `plantfit workers`."""

import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Group
from rich.live import Live
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from plantfit.cli.terminal.out import err, figures, log_lines, out, print_json

MOST_LINES = 16
REFRESH_SECONDS = 1.0


@contextmanager
def study_progress(quiet: bool, names: Callable[[int], str]) -> Generator[Any]:
    """A live line for a study and one for each worker, on standard error (plain lines where that is no terminal);
    yields a callback for `StudyProgress`, None if not shown."""

    def name(p: Any) -> str:
        return f"{names(p.study_id)} {p.method}".strip()

    if quiet:
        yield None
        return
    if not sys.stderr.isatty():
        yield log_lines(lambda p: (name(p), figures(p)))
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(30),
        TextColumn("{task.fields[figures]}"),
        TimeElapsedColumn(),
    )
    bar = Progress(*columns, console=err)
    task = bar.add_task("compiling", total=1.0, figures="")
    with Live(bar, console=err, transient=True, refresh_per_second=5) as live:

        def tell(p: Any) -> None:
            bar.update(
                task,
                description=name(p),
                total=p.budget_total,
                completed=min(p.evaluations, p.budget_total),
                figures=figures(p),
            )
            lines = (
                [f"    {line}" for line in worker_lines(p.workers, p.budget_total / p.runs)]
                if len(p.workers) > 1
                else []
            )
            live.update(Group(bar, Text("\n".join(lines), style="dim")) if lines else bar)

        yield tell


def worker_lines(held: Sequence[Any], budget: float) -> list[str]:
    """What each worker does, a line each; `budget` is that of a run."""
    from plantfit.study.running.worker_names import where

    lines = [f"{where(h.worker)}: {_task(h)}, {_share(h, budget)}" for h in held[:MOST_LINES]]
    return lines + ([f"and {len(held) - MOST_LINES} more workers"] if len(held) > MOST_LINES else [])


def workers(number: int | None, store: str, watch: bool, json: bool) -> None:
    """Who works on the unfinished studies of a store, or on one study; again and again with `watch`."""
    from plantfit.study import Store

    opened = Store.open(store, create=False)
    if json:
        return print_json([_row(study, h) for study, h in _held(opened, number)])
    if not watch:
        return out.print(_page(opened, number))
    with Live(_page(opened, number), console=out, auto_refresh=False) as live:
        while True:
            try:
                time.sleep(REFRESH_SECONDS)
                live.update(_page(opened, number), refresh=True)
            except KeyboardInterrupt:
                return None


def _held(opened: Any, number: int | None) -> list[tuple[Any, Any]]:
    studies = [opened.study(number)] if number is not None else [s for s in opened.studies() if s.state != "done"]
    return [(study, h) for study in studies for h in opened.held(study.id)]


def _page(opened: Any, number: int | None) -> Any:
    from plantfit.study.running.worker_names import where

    held = _held(opened, number)
    if not held:
        return Text("Nobody works here now; `plantfit resume` goes on with an unfinished study.")
    rows = [("study", "worker", "task", "of its budget", "last sign of life")]
    for study, h in held:
        silent = f"{max(h.silent, 0.0):.0f} s ago"
        rows.append((f"{study.id} {study.name}", where(h.worker), _task(h), _share(h, study.plan["budget"]), silent))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return Text("\n".join(lines), no_wrap=True, overflow="ignore")


def _row(study: Any, h: Any) -> dict[str, Any]:
    from plantfit.study.running.worker_names import where

    task = {"method": h.task.method, "first_run": h.task.first, "runs": h.task.count}
    return {
        "study": study.id,
        "name": study.name,
        "worker": where(h.worker),
        **task,
        "evaluations": h.evaluations,
        "silent_s": h.silent,
    }


def _task(h: Any) -> str:
    last = h.task.first + h.task.count - 1
    return (
        f"{h.task.method} run {h.task.first}" if h.task.count == 1 else f"{h.task.method} runs {h.task.first} to {last}"
    )


def _share(h: Any, budget: float) -> str:
    return "begins" if h.evaluations is None else f"{100 * min(h.evaluations / (h.task.count * budget), 1.0):.0f} %"
