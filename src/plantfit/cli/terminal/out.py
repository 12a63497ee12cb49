"""How commands speak: results on standard output, everything else on standard error."""

import json
import sys
import threading
import time
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from rich.console import Console
from rich.markup import escape

out = Console(highlight=False, soft_wrap=True)
err = Console(stderr=True, highlight=False, soft_wrap=True)

LOG_EVERY = 30.0  # seconds between lines of progress where standard error is no terminal

MARKS = {"good": ("green", "+"), "info": ("cyan", "i"), "warning": ("yellow", "!"), "bad": ("red", "x")}


def print_json(value: Any) -> None:
    """One JSON value; not-a-number becomes null."""
    print(json.dumps(plain(value), allow_nan=False))


def plain(value: Any) -> Any:
    """A value as JSON types; not-a-number and infinity become null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return None
    return value


def verdict(findings: dict[str, Any]) -> None:
    """The verdict as marked lines."""
    for v in findings["verdict"]:
        colour, mark = MARKS[v["level"]]
        out.print(f"[{colour}]{mark}[/{colour}] ", end="")
        out.print(v["sentence"], markup=False)


@contextmanager
def doing(what: str) -> Generator[None]:
    """A line while `what` is done, on standard error: wiped away on a terminal; in a log only where it takes more
    than 30 s."""
    if err.is_terminal:
        with err.status(escape(what)):
            yield
        return
    told = threading.Timer(LOG_EVERY, lambda: print(f"{what} ...", file=sys.stderr, flush=True))
    told.daemon = True
    told.start()
    try:
        yield
    finally:
        told.cancel()


def preparing(name: str, shooting: int | None = None) -> AbstractContextManager[None]:
    """A line while the problem of a study is made ready, with so many segments of multiple `shooting`."""
    start = "" if shooting is None else f", and joins {shooting} segments of each record to find a start"
    return doing(f"{name}: chooses how long the steps of its simulation are{start}")


def warn(sentence: str) -> None:
    """A line on standard error."""
    err.print(sentence, markup=False)


def _describe(p: Any) -> tuple[str, str]:
    """What is worked on, and how far it is."""
    if hasattr(p, "part"):  # one of several: nothing is known of what the others take
        return p.part, "" if p.begins else _of_part(p)
    unit = getattr(p, "unit", "run")
    if unit == "part":
        return p.method, f"{unit} {min(p.runs_done + 1, p.runs)}/{p.runs}"
    return getattr(p, "method", "searching"), figures(p, unit)


def figures(p: Any, unit: str = "run") -> str:
    """Runs, evaluations, best cost and time left of a search."""
    return f"{unit} {min(p.runs_done + 1, p.runs)}/{p.runs}, {p.evaluations:.0f} evaluations, {_best(p)}{_left(p)}"


def _of_part(p: Any) -> str:
    """How far one search of several is."""
    return f"{p.evaluations:.0f} of {p.budget_total:.0f} evaluations, {_best(p)}{_left(p)}"


def _best(p: Any) -> str:
    return f"best cost {p.best:.4g}" if p.best < float("inf") else "no result yet"


def _left(p: Any) -> str:
    """What is left of the search at its pace so far; what comes after the search is not in it."""
    return "" if p.seconds_left is None else f", about {duration(p.seconds_left)} left in this search"


def duration(seconds: float) -> str:
    """Seconds as people say them."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def log_lines(describe: Callable[[Any], tuple[str, str]]) -> Callable[[Any], None]:
    """A callback that writes a plain line every 30 s, and one where a part begins: a log file tells as much as a
    screen."""
    began = last = time.monotonic()

    def tell(p):
        nonlocal last
        now = time.monotonic()
        if now - last >= LOG_EVERY or getattr(p, "begins", False):
            last = now
            print(f"{now - began:.0f} s: {': '.join(filter(None, describe(p)))}", file=sys.stderr, flush=True)

    return tell


@contextmanager
def said_line(quiet: bool = False) -> Generator[Callable[[str], None] | None]:
    """What is being done, on standard error: one live line on a terminal, else a plain line every 30 s; yields its
    callback."""
    if quiet:
        yield None
        return
    if not sys.stderr.isatty():
        yield log_lines(lambda text: ("", text))
        return
    try:
        yield lambda text: print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)
    finally:
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


@contextmanager
def progress_line(quiet: bool = False) -> Generator[Any]:
    """Progress on standard error: a live line on a terminal, else a plain line every 30 s; yields the callback of a
    study or a search."""
    if quiet:
        yield None
        return
    if not sys.stderr.isatty():
        yield log_lines(_describe)
        return
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn  # for terminals only

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(30),
        TextColumn("{task.fields[figures]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task("compiling", total=1.0, figures="")

        def tell(p):
            method, figures = _describe(p)
            bar.update(
                task,
                description=method,
                total=p.budget_total,
                completed=min(p.evaluations, p.budget_total),
                figures=figures,
            )

        yield tell
