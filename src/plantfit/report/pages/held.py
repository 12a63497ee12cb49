"""A regulator that holds an equilibrium, as a page and as text, from its record."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from plantfit.findings.results.held_plant import HeldPlant
from plantfit.findings.results.tuned_controller import LoopWishes
from plantfit.report.case_page import write_case_page
from plantfit.report.figures.control.loops import loop_figure
from plantfit.report.numbers import with_unit

_MARKS = {"good": "", "info": "", "warning": "Note: ", "bad": "Not met: "}


def heads(record: HeldPlant) -> tuple[str, ...]:
    """Heads of the table, with units."""
    unit = record.units[record.wishes.along] or ""
    return (
        "searched on", *(f"K {n}" for n in record.states), "Ms", with_unit("below", unit), "above", "95 % below",
        "above", "return",
    )  # fmt: skip


def table_rows(record: HeldPlant) -> list[tuple[str, ...]]:
    """Texts under `heads`."""
    return [
        (r.name, *(f"{v:.4g}" for v in r.gain), f"{r.ms:.2f}", f"{r.below:.3g}", f"{r.above:.3g}",
         f"{r.below_worst:.3g}",
         f"{r.above_worst:.3g}", f"{100 * r.share:.0f} %")
        for r in record.regulators
    ]  # fmt: skip


def settings(record: HeldPlant) -> str:
    """The regulator in a line."""
    best, w = record.regulators[0], record.wishes
    told = ", ".join(f"{v:.5g} {n}" for v, n in zip(best.gain, record.states, strict=True))
    return (
        f"LQR: {w.input} = {record.point[w.input]:.4g} less ({told}) of the deviations that a Kalman filter estimates."
    )


def asked(record: HeldPlant) -> list[str]:
    """What was asked for, with where it is from."""
    w = record.wishes
    unit, u = (f" {record.units[n]}" if record.units[n] else "" for n in (w.along, w.input))
    at = ", ".join(f"{n} = {v:.5g}" for n, v in record.point.items())
    told = [
        f"Held at {at}.",
        f"From {w.along} {w.lean:.3g}{unit} off the outputs are to be within {w.tolerance:.3g} of the point "
        f"at the end of {w.seconds:.3g} s, on {100 * w.share:g} % of the plants.",
        f"Sampled every {w.period:.6g} s, {w.input} within {w.lower:.5g} to {w.upper:.5g}{u}.",
    ]
    return told + [f"Proposed: {n} = {v}." for n, v in record.proposed.items()]


def write_held_page(record: HeldPlant, curves: Mapping[str, Any], path: str | Path, files: Sequence[str] = ()) -> Path:
    """Write the page of a regulator (`holding.Held.typed` and `.curves`) to `path`; StoreError where that fails."""
    w = record.wishes
    level = w.at[w.along]
    course = LoopWishes(level, -w.lean, 0.0, w.period, w.lower, w.upper)
    state, command = (with_unit(n, record.units[n] or "") for n in (w.along, w.input))
    page = {
        "title": f"Regulator of {record.name}",
        "subtitle": f"{', '.join(f'{n} = {v:.4g}' for n, v in w.at.items())} held by {w.input}, on plants "
                    f"{record.plants_are}",
        "sections": [
            {"title": "Verdict",
             "sentences": [_MARKS[v.level] + v.sentence for v in record.verdict] + [settings(record)]},
            {"title": "Asked for", "sentences": asked(record)},
            {
                "title": "From the lean back to the point",
                "figures": [{
                    "figure": loop_figure(curves, course, state, command, f"{record.plants} plants"),
                    "label": "the state that leans and the input, over all plants",
                }],
            },
            {
                "title": "Regulators",
                "tables": [{
                    "caption": "Gains of the deviations; how far below and above the point the best fit is caught, and "
                               "95 % of the plants",
                    "columns": heads(record), "rows": table_rows(record),
                    "note": "Starts are tried along the state that leans, all else at rest; return: share of the "
                            "plants that return from "
                    "the lean that was asked for, to both sides.",
                }],
            },
        ],
    }  # fmt: skip
    return write_case_page(page, path, files)
