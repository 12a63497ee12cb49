"""Stated errors as tables: the budget of every reading, and what noise and errors leave of every parameter."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.findings import Findings, Parameter, ReadingBudget, StatedError, StatedUncertainty, Uncertainty
from plantfit.report.numbers import interval, percent, plus_minus, significant, unit_label
from plantfit.report.sections.sentences import listed
from plantfit.report.sections.tables import Table

MOST_SOURCES = 6  # columns of them; the smallest share one
NOTHING = 1e-3  # of the combined uncertainty: less is shown as ~0
RELATIVE = ("gain", "clock")


def of_findings(record: Findings) -> dict[str, Any] | None:
    """What the report shows: `told`, the tables `budgets` and that of the `parameters`; None where nothing was
    stated."""
    stated = record.uncertainty
    if stated is None:
        return None
    return {
        "told": _told(stated),
        "budgets": [budget_table(b) for b in stated.budgets],
        "parameters": widened_table(record.parameters),
    }


def budgets_of(plain: Sequence[Mapping[str, Any] | ReadingBudget], ascii_only: bool = False) -> list[Table]:
    """Tables of budgets as `plantfit.trust.stated_errors.reading_budgets` gives them."""
    return [budget_table(ReadingBudget.model_validate(b), ascii_only) for b in plain]


def budget_table(budget: ReadingBudget, ascii_only: bool = False) -> Table:
    """The table of the GUM: one row for each source, then the combined and the expanded uncertainty."""
    relative = budget.kind == "clock"
    some = any(s.degrees_of_freedom is not None for s in budget.sources)

    def of_result(value: float | None) -> str:
        return _amount(value, None, relative, ascii_only)

    rows: list[tuple[str, ...]] = [
        (
            s.name, s.kind, s.acts + (", each recording its own" if s.per_recording else ""), s.shape,
            _limit(s, ascii_only),
            significant(s.divisor, 4, ascii_only), _amount(s.standard, s.unit, s.acts in RELATIVE, ascii_only),
            of_result(s.contribution), percent(s.share), _degrees(s.degrees_of_freedom, ascii_only),
        )
        for s in budget.sources
    ]  # fmt: skip
    empty = ("",) * 6
    rows.append(
        ("combined", *empty, of_result(budget.combined), percent(1.0), _degrees(budget.degrees_of_freedom, ascii_only))
    )
    rows.append(("expanded, k = 2", *empty, of_result(budget.expanded), "", ""))
    if some:
        factor = significant(budget.coverage_factor, 3)
        rows.append(
            (
                f"95 %, k = {factor}",
                *empty,
                of_result((budget.coverage_factor or 0.0) * (budget.combined or 0.0)),
                "",
                "",
            )
        )
    unit = "" if relative else _unit(budget.unit, ascii_only)
    head = (
        "source",
        "type",
        "acts as",
        "distribution",
        "limit",
        "divisor",
        "standard",
        _label("contribution", unit),
        "share",
        "dof",
    )
    last = len(head) if some else len(head) - 1
    kept = tuple(tuple(row[:last]) for row in rows)
    return Table(_caption(budget, ascii_only), head[:last], kept, frozenset(range(4, last)))


def _unit(unit: str | None, ascii_only: bool) -> str:
    return (unit or "") * (unit not in ("1", "dimensionless")) if ascii_only else unit_label(unit)


def _limit(s: StatedError, ascii_only: bool) -> str:
    """The half width; a normal distribution has none but its k-fold standard uncertainty."""
    return _amount(s.limit, s.unit, s.acts in RELATIVE, ascii_only) if s.kind == "B" else ""


def _label(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _caption(budget: ReadingBudget, ascii_only: bool) -> str:
    where = f" in {listed(budget.recordings)}" if budget.recordings else ""
    at = f"{significant(budget.at, 4, ascii_only)} {_unit(budget.unit, ascii_only)}".strip()
    if budget.kind == "clock":
        return f"The clock{where}: share by which times may be wrong"
    if budget.kind == "constant":
        return f"{budget.of} = {at}, held"
    return f"One reading of {budget.of}{where}" + (
        "" if budget.at is None else f", at {at}, the most uncertain one recorded"
    )


def _amount(value: float | None, unit: str | None, relative: bool, ascii_only: bool) -> str:
    """A number, or a share as % or ppm."""
    if value is not None and relative:
        return (
            f"{significant(100 * value, 3, ascii_only)} %"
            if value >= 1e-3
            else f"{significant(1e6 * value, 3, ascii_only)} ppm"
        )
    label = _unit(unit, ascii_only)
    return significant(value, 3, ascii_only) + (f" {label}" if label else "")


def _degrees(value: float | None, ascii_only: bool) -> str:
    return ("inf" if ascii_only else "∞") if value is None else str(int(value))


def widened_table(parameters: Sequence[Parameter], ascii_only: bool = False) -> Table:
    """Standard uncertainties of every parameter by noise and by source, together, and the interval that they leave."""
    known = [(p, p.uncertainty) for p in parameters if p.uncertainty is not None]
    columns = _columns([u for _, u in known])
    few = any(u.degrees_of_freedom is not None for _, u in known)
    rows = []
    for p, u in known:
        parts = [
            _part(v, u.combined, ascii_only) for v in (u.noise, *(_together(u, names) for names in columns.values()))
        ]
        times = significant(u.combined / u.noise, 2, ascii_only) if u.combined and u.noise else ""
        degrees = [_degrees(u.degrees_of_freedom, ascii_only)] if few else []
        value = plus_minus(p.value, u.combined, ascii_only)
        rows.append(
            (p.name, value, _unit(p.unit, ascii_only), interval(u.low, u.high, ascii_only), *degrees, times, *parts)
        )
    head = (
        "parameter",
        "value ± combined",
        "unit",
        "95 % interval",
        *(["dof"] if few else []),
        "times noise",
        "noise",
        *columns,
    )
    marked = frozenset(k for k, (_, u) in enumerate(known) if u.noise and u.shared and u.shared > u.noise)
    return Table(
        "Standard uncertainties of the parameters by source",
        head,
        tuple(rows),
        frozenset(range(len(head))) - {0, 2},
        marked,
    )


def _columns(found: Sequence[StatedUncertainty]) -> dict[str, list[str]]:
    """Headings with the sources under them: the largest by name, the rest together."""
    names = list(dict.fromkeys(n for u in found for n in u.sources))
    if len(names) <= MOST_SOURCES:
        return {n: [n] for n in names}

    def most(name: str) -> float:
        return max((u.sources.get(name) or 0.0) / u.combined for u in found if u.combined)

    large = sorted(names, key=most, reverse=True)[: MOST_SOURCES - 1]
    return {n: [n] for n in names if n in large} | {
        f"{len(names) - len(large)} others": [n for n in names if n not in large]
    }


def _together(u: StatedUncertainty, names: Sequence[str]) -> float:
    return float(np.sqrt(sum((u.sources.get(n) or 0.0) ** 2 for n in names)))


def _part(value: float | None, combined: float | None, ascii_only: bool) -> str:
    return "~0" if value is not None and combined and value < NOTHING * combined else significant(value, 2, ascii_only)


def _told(stated: Uncertainty) -> str:
    """How the errors were carried to the parameters."""
    if stated.method == "monte carlo":
        return (
            f"Carried to the parameters by {stated.draws} draws of errors, each with a fit anew (GUM supplement "
            "1); intervals hold 95 % of the answers. Standard uncertainties by source are to first order."
        )
    return "Carried to the parameters to first order (GUM): standard uncertainties add in squares to that by noise."
