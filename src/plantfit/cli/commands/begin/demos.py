"""`plantfit demo`: a real recording, end to end."""

import inspect
import time
from pathlib import Path
from typing import Any

from plantfit.cli.arguments.file_names import file_name
from plantfit.cli.terminal.interrupts import saying
from plantfit.cli.terminal.out import out, print_json, progress_line, verdict
from plantfit.errors import SpecError


def listed(json: bool) -> None:
    """Names of the demos, how long each takes, and what it shows."""
    from plantfit.cases.shared.registry import TIMED_ON, demos, seconds

    rows = {name: sentence for name, (sentence, _) in demos().items()}
    if json:
        return print_json({name: {"sentence": sentence, "seconds": seconds(name)} for name, sentence in rows.items()})
    width = max(map(len, rows))
    for name, sentence in rows.items():
        out.print(f"{name:{width}}  {_about(seconds(name)):>11}  {sentence}", markup=False)
    out.print(f"\n{TIMED_ON}", markup=False)


def _about(seconds: float) -> str:
    return f"about {5 * max(1, round(seconds / 5))} s" if seconds < 55 else f"about {seconds / 60:.0f} min"


def copied(name: str, folder: str, json: bool) -> None:
    """Copy the recordings and study files of a demo to `folder`/`name` and name them."""
    from plantfit.cases.shared.files import unpack

    _known(name)
    place = unpack(name, Path(folder) / name)
    names = sorted(p.name for p in place.iterdir() if p.suffix in (".toml", ".csv", ".gz"))
    if json:
        return print_json({"name": name, "folder": str(place), "files": names})
    out.print(f"Written into {place}: {', '.join(names)}", markup=False, soft_wrap=True)


def _known(name: str) -> tuple[str, Any]:
    """The sentence and the loader of a demo. Raises SpecError where there is none of this name."""
    from plantfit.cases.shared.registry import demos

    known = demos()
    if name not in known:
        raise SpecError(f"There is no demo {name!r}; there are {', '.join(known)}.")
    return known[name]


def demo(name: str, folder: str, full: bool, json: bool) -> None:
    """Run one demo in `folder`/`name` and write a report for every fit, and a page of its own where it has sections."""
    from plantfit.cases.shared.registry import seconds

    sentence, load = _known(name)
    if not json:
        out.print(f"[bold]{name}[/bold]: {sentence}\n{'' if full else f'This takes {_about(seconds(name))}.'}\n")
    began, place = time.perf_counter(), Path(folder) / name
    stopped = f"Demo {name!r} was stopped by {{cause}}; what was written so far is in {place}. It begins anew."
    with saying(stopped):
        run = load()
        if full and "full" not in inspect.signature(run).parameters:
            raise SpecError(f"The demo {name!r} has one size only; leave --full out.")
        with progress_line(json) as tell:
            record = run(place, progress=tell, **({"full": True} if full else {}))
    names = [file_name(a.problem.name.replace(" ", "_"), "html") for a in record["answers"]]
    pages = [a.report(place / file) for a, file in zip(record["answers"], names, strict=True)]
    if record["sections"]:
        from plantfit.report.case_page import write_case_page

        further = [p.name for p in record["pages"]]
        own = "index.html" if f"{name}.html" in names else f"{name}.html"
        pages = [write_case_page(record, place / own, [*names, *further]), *pages, *record["pages"]]
    reports = [str(page.resolve()) for page in pages]
    if json:
        plain = {k: record[k] for k in ("name", "title", "found", "figures", "sentences")}
        fits = [
            {
                "name": a.problem.name,
                "values": a.values,
                "verdict": a.findings["verdict"],
                "scores": a.findings["scores"],
            }
            for a in record["answers"]
        ]
        return print_json({**plain, "fits": fits, "reports": reports, "seconds": time.perf_counter() - began})
    for line in record["found"]:
        out.print(f"- {line}", markup=False)
    if record["found"]:
        out.print()
    if any("command" in s for s in record["sections"]):
        _story(record["sections"], place)
    else:
        for answer in record["answers"]:
            out.print(f"[bold]{answer.problem.name}[/bold]")
            verdict(answer.findings)
            out.print()
        _figures(record["figures"])
        for line in record["sentences"]:
            out.print(f"- {line}", markup=False)
    out.print(f"\n{time.perf_counter() - began:.0f} s. Open in a browser:")
    for path in reports:
        out.print(f"  {path}", markup=False)


def _story(sections: list[dict[str, Any]], place: Path) -> None:
    """Steps with the commands that repeat them in the folder `place`."""
    from rich.markup import escape

    for section in sections:
        out.print(f"[bold]{escape(section['title'])}[/bold]")
        for line in section["sentences"]:
            out.print(f"  {line}", markup=False)
        if "command" in section:
            out.print(f"  [dim]$ {escape(section['command'])}[/dim]")
        out.print()
    out.print(f"The commands repeat a step in {place}.", markup=False)


def _figures(figures: list[dict[str, Any]]) -> None:
    from rich.table import Table

    table = Table("figure", "reached", "reference", "where the reference is from", box=None, pad_edge=False)
    for f in figures:
        unit = f" {f['unit']}" if f["unit"] else ""
        reference = f"{f['reference']:.4g}{unit}" if f["reference"] is not None else ""
        table.add_row(f["name"], f"{f['value']:.4g}{unit}", reference, f["source"] or "")
    out.print(table)
