"""Morris screening and Sobol indices on a page: a table, a figure and what they mean."""

from collections.abc import Mapping
from typing import Any

from plantfit.report.figures.pages.sensitivity import sensitivity_figure
from plantfit.report.numbers import significant
from plantfit.trust.sensitivity.screening import Screening
from plantfit.trust.sensitivity.sobol_indices import SobolIndices


def screening_section(
    found: Mapping[str, Screening], title: str = "Sensitivity: Morris screening", of: str = "the cost"
) -> dict[str, Any]:
    """The section of a page (see `case_page`) for screenings by the name of the point that each is around; `of` says
    what reacts."""
    first = next(iter(found.values()))
    where = (
        "over the whole box"
        if first.radius is None
        else f"within {100 * first.radius:g} % of the bounds around the point"
    )
    alone = any(n == 1 for s in found.values() for n in s.sizes)
    rows = []
    for label, s in found.items():
        share = s.mu_star / max(s.mu_star.sum(), 1e-300)
        for k, group in enumerate(s.groups):
            said = [significant(s.mu_star[k]), significant(s.half_width[k], 2), f"{100 * share[k]:.1f}"]
            more = [significant(s.mu[k]), significant(s.sigma[k])] if alone else []
            rows.append([label, group, str(s.sizes[k]), *said, *more])
    columns = ["around", "group", "coordinates", "mu*", f"± {100 * first.confidence:g} %", "share [%]"] + (
        ["mu", "sigma"] if alone else []
    )
    sentences = [
        f"mu* is the mean size of the change of {of} when a group "
        f"moves through the whole width that was looked at, {where}.",
        *(_dropped(label, s.dropped, s.trajectories, "trajectories") for label, s in found.items() if s.dropped),
    ]
    series = {label: _pairs(s.groups, s.mu_star, s.half_width) for label, s in found.items()}
    return {
        "title": title,
        "sentences": sentences,
        "tables": [{"caption": "Elementary effects by group", "columns": columns, "rows": rows}],
        "figures": [{"figure": sensitivity_figure("mu*", series), "label": "mu* by group, with bootstrap intervals"}],
    }


def sobol_section(
    found: SobolIndices, title: str = "Sensitivity: Sobol indices", of: str = "the cost"
) -> dict[str, Any]:
    """The section of a page for Sobol indices."""
    rows = [
        [group, str(found.sizes[k]), significant(found.first[k], 3), significant(found.first_half_width[k], 2),
         significant(found.total[k], 3), significant(found.total_half_width[k], 2)]
        for k, group in enumerate(found.groups)
    ]  # fmt: skip
    half = f"± {100 * found.confidence:g} %"
    where = "the whole box" if found.radius is None else f"{100 * found.radius:g} % of the bounds around the point"
    dropped = [_dropped("", found.dropped, found.samples, "samples")] if found.dropped else []
    series = {
        "first order": _pairs(found.groups, found.first, found.first_half_width),
        "total": _pairs(found.groups, found.total, found.total_half_width),
    }
    return {
        "title": title,
        "sentences": [f"Shares of the variance of {of} for parameters spread evenly over {where}.", *dropped],
        "tables": [
            {
                "caption": "Sobol indices by group",
                "columns": ["group", "coordinates", "first", half, "total", half],
                "rows": rows,
            }
        ],
        "figures": [
            {
                "figure": sensitivity_figure("share of the variance", series),
                "label": "Sobol indices, with bootstrap intervals",
            }
        ],
    }


def _pairs(groups: Any, values: Any, halves: Any) -> dict[str, tuple[float, float]]:
    return {g: (float(v), float(h)) for g, v, h in zip(groups, values, halves, strict=True)}


def _dropped(label: str, dropped: int, of: int, what: str) -> str:
    place = f"{label}: " if label else ""
    return (
        f"{place}{dropped} of {of} {what} held a run that failed and are "
        "left out whole; the figures are those of the part that runs."
    )
