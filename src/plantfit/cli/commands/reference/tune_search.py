"""`plantfit tune-search`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plantfit.cli.terminal.interrupts import stoppable
from plantfit.cli.terminal.out import out, print_json, progress_line
from plantfit.cli.terminal.working import demand_search
from plantfit.errors import Interrupted, SearchError


def tune_search(
    spec: str, method: str, outer: str, budget: int | None, runs: int, trials: int, seed: int,
    only: str | None, ranges: Sequence[str], hold: Sequence[str], place: str | None, json: bool,
) -> None:  # fmt: skip
    """Tune the settings of a method on the problem of a study file."""
    from plantfit import spec as specs
    from plantfit.stages import prepare
    from plantfit.study.tuning.tuner import tune

    narrowed, held = _ranges(ranges), _held(hold)
    names = None if only is None else [n.strip() for n in only.split(",") if n.strip()]
    study = specs.load(spec)
    demand_search(study)
    objective = prepare(study.problem).objective
    with progress_line(json) as tell, stoppable() as stop:
        found = tune(
            objective, method, outer, only=names, ranges=narrowed, held=held,
            budget=study.plan.budget if budget is None else budget,
            runs=runs, trials=trials, seed=seed, progress=tell, stop=stop,
        )  # fmt: skip
    if place is not None and found.trials:
        Path(place).write_text(found.toml(), encoding="utf-8")
    _say(found, place, json)
    if found.interrupted:
        raise Interrupted(found.sentence)


def _ranges(written: Sequence[str]) -> dict[str, Sequence[Any]]:
    """name=low:high and name=word,word as a mapping."""
    found: dict[str, Sequence[Any]] = {}
    for text in written:
        name, _, value = text.partition("=")
        parts = [p.strip() for p in value.split(":" if ":" in value else ",")]
        if not name.strip() or not all(parts):
            raise SearchError(
                f"--range {text!r} cannot be read; write inertia=0.4:0.9, or topology=global,ring for words."
            )
        found[name.strip()] = parts
    return found


def _held(written: Sequence[str]) -> dict[str, Any]:
    """name=value as a mapping; a value is a whole number, a number or a word."""
    found: dict[str, Any] = {}
    for text in written:
        name, _, value = (part.strip() for part in text.partition("="))
        if not name or not value:
            raise SearchError(f"--hold {text!r} cannot be read; write population=50, or topology=ring for a word.")
        found[name] = _value(value)
    return found


def _value(text: str) -> Any:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _say(found: Any, place: str | None, json: bool) -> None:
    if json:
        return print_json({**found.record(), "file": place})
    if not found.trials:
        return
    out.print(_table(found), soft_wrap=False)
    made = sum(t.runs for t in found.trials)
    out.print(
        f"{len(found.trials)} settings tried by {found.outer} with {made} runs of {found.budget} evaluations in "
        f"{found.seconds:.0f} s; "
        f"{sum(t.dropped for t in found.trials)} left a race early.",
        markup=False,
    )
    first, last = found.search_runs
    begin, end = found.fresh_runs
    out.print(
        f"Chosen on runs {first} to {last} of seed {found.seed}, compared on runs {begin} to {end}.\n", markup=False
    )
    if not found.interrupted:
        out.print(found.sentence, markup=False)
        out.print()
    out.print(found.toml(), markup=False, end="")
    if place is not None:
        out.print(f"\nWritten to {place}", markup=False)


def _table(found: Any) -> Any:
    from rich.table import Table

    table = Table("setting", "default", "best found", "searched", box=None, pad_edge=False)
    for d in found.dials:
        searched = (
            ", ".join(_plain(v) for v in d["values"])
            if "values" in d
            else f"{_plain(d['range'][0])} to {_plain(d['range'][1])}"
        )
        table.add_row(f"[bold]{d['name']}[/bold]", _plain(d["default"]), _plain(found.best[d["name"]]), searched)
    return table


def _plain(value: Any) -> str:
    return "the method's choice" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
