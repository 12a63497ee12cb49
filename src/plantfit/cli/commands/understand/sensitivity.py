"""`plantfit sensitivity`: which parameters the cost reacts to."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from plantfit.cli.arguments.values import values_at
from plantfit.cli.terminal.interrupts import stoppable
from plantfit.cli.terminal.out import out, print_json, progress_line
from plantfit.errors import SearchError, SpaceError

METHODS = ("morris", "sobol")


def sensitivity(
    spec: str, method: str, radius: float | None, box: bool, groups: Sequence[str], counts: Mapping[str, int],
    confidence: float,
    values: Sequence[str], study: int | None, page: str | None, store: str, json: bool,
) -> None:  # fmt: skip
    """Say which parameters the cost reacts to: Morris screening around an answer, or Sobol indices over the box."""
    from plantfit import spec as specs
    from plantfit.problem.accuracy.steps import choose_substeps
    from plantfit.trust import morris, need_salib, sobol_indices

    if method not in METHODS:
        raise SearchError(f"--method {method} is unknown; use {' or '.join(METHODS)}.")
    if box and radius is not None:
        raise SearchError(f"--box looks at the whole box and --radius {radius:g} around a point; give one of them.")
    need_salib()
    read = specs.load(spec)
    problem = choose_substeps(read.problem)
    wide = radius if method == "sobol" else None if box else 0.01 if radius is None else radius
    point = None
    if wide is not None:
        given = values_at(problem, values, read.name, study, store)
        point = problem.space.cube(problem.space.vector(given))
        _inside(problem.space, given, point)
    same: dict[str, Any] = {"radius": wide, "groups": _groups(groups), "confidence": confidence, "seed": counts["seed"]}
    with progress_line(json) as tell, stoppable("Stopping; nothing is kept.") as stop:
        same |= {"progress": tell, "stop": stop}
        if method == "morris":
            walked = counts["trajectories"]
            found: Any = morris(problem, point, trajectories=walked, pool=max(100, walked + 1), **same)
        else:
            found = sobol_indices(problem, point, samples=counts["samples"], **same)
    written = str(_page(found, read.name, page)) if page is not None else None
    if json:
        return print_json(found.typed.printed(name=read.name, page=written))
    _say(found)
    if written:
        out.print(f"\nPage: {written}", markup=False)


def _inside(space: Any, given: dict[str, float], point: Any) -> None:
    for c, z in zip(space.coordinates, point, strict=True):
        if not 0.0 <= z <= 1.0:
            raise SpaceError(
                f"{c.name} = {given[c.name]:g} lies outside of its "
                f"bounds [{c.lower:g}, {c.upper:g}]; give a value inside."
            )


def _groups(texts: Sequence[str]) -> dict[str, list[str]] | None:
    """NAME=a,b texts as a mapping; None without any."""
    found: dict[str, list[str]] = {}
    for text in texts:
        name, _, members = (part.strip() for part in text.partition("="))
        wanted = [m.strip() for m in members.split(",")]
        if not name or not all(wanted) or name in found:
            raise SpaceError(
                f"--group {text!r} cannot be read, or comes twice; write NAME=PARAMETER,PARAMETER, as in gains=K,Kt."
            )
        found[name] = wanted
    return found or None


def _page(found: Any, name: str, place: str) -> Path:
    from plantfit.report.case_page import write_case_page
    from plantfit.report.pages.sensitivity import screening_section, sobol_section
    from plantfit.trust import Screening

    section = (
        screening_section({"answer" if found.radius else "box": found})
        if isinstance(found, Screening)
        else sobol_section(found)
    )
    return write_case_page({"title": name, "subtitle": "Sensitivity", "sections": [section]}, place)


def _say(found: Any) -> None:
    from rich.table import Table

    made = found.typed
    half = f"± {100 * made.confidence:g} %"
    rows = [row.plain() for row in made.groups]
    named = {"mu_star": "mu*", "half_width": half, "first_half_width": half, "total_half_width": half}
    keys: list[str] = list(rows[0])
    table = Table(*[named.get(key, key) for key in keys], box=None, pad_edge=False)
    for row in rows:
        table.add_row(
            *(f"{row[k]:.4g}" if isinstance(row[k], float) else "nan" if row[k] is None else str(row[k]) for k in keys)
        )
    out.print(table)
    where = (
        "over the whole box"
        if made.radius is None
        else f"within {100 * made.radius:g} % of the bounds around the point"
    )
    what = {
        "morris": "Change of the cost when a group moves through the width",
        "sobol": "Shares of the variance of the cost",
    }
    out.print(f"\n{what[made.method]}, {where}; {made.evaluations} evaluations.", markup=False)
    if made.dropped:
        counted = f"{made.dropped} of {made.trajectories or made.samples}"
        out.print(f"{counted} held a run that failed and are left out whole.", markup=False)
