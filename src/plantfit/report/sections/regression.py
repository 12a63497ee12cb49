"""A regression solved by instrumental variables: plain least squares beside them, and what is to be thought of the
difference."""

from collections.abc import Mapping
from typing import Any

from plantfit.findings import Recording
from plantfit.report.figures.fit import fit_figure
from plantfit.report.numbers import interval, plus_minus, unit_label

POINTS = 3000
FEW = 8.0  # degrees of freedom below which an interval is a quarter wider than 1.96 standard errors of many
COLUMNS = ("coefficient", "unit", "instrumental variables", "95 % interval", "least squares", "95 % interval")


def rows_of(record: Mapping[str, Any], ascii_only: bool = True) -> list[tuple[str, ...]]:
    """Texts of `COLUMNS` for each coefficient; without instruments the least squares alone."""
    rows = []
    for p in record["parameters"]:
        cells = [p["name"], (p["unit"] or "") if ascii_only else unit_label(p["unit"])]
        for which in ("instrumental_variables", "least_squares"):
            e = p[which]
            if e is None:
                cells += ["none", ""]
            else:
                cells += [
                    plus_minus(e["value"], e["standard_error"], ascii_only),
                    interval(e["low"], e["high"], ascii_only),
                ]
        rows.append(tuple(cells))
    return rows


def sentences_of(record: Mapping[str, Any]) -> list[dict[str, str]]:
    """The verdict, as findings have it."""
    said = []
    test = record["durbin_wu_hausman"]
    if test is None:
        said.append({"level": "warning", "sentence": "Without instruments nothing shows whether errors in the columns "
                                                     "draw least squares "
                                                     "away."})  # fmt: skip
    elif test["differs"]:
        said.append({"level": "warning", "sentence": f"{test['sentence']} Use the instrumental variables."})
    else:
        said.append({"level": "good", "sentence": test["sentence"]})
    said += _resting_on_few(record)
    for name, value in record["held"].items():
        said.append({"level": "info", "sentence": f"{name} was held at {value:g}."})
    if record["apart"]:
        told = ", ".join(p["name"] for p in record["parameters"])
        said.append(
            {
                "level": "info",
                "sentence": f"Only {told} stand in the columns; {', '.join(record['apart'])} are known by them alone.",
            }
        )
    for part, word in (("fit", "fitted"), ("validation", "unseen")):
        errors = record["rmse"].get(part)
        if errors:
            told = ", ".join(f"{o} {v:.3g} {record['outputs'][o] or ''}".rstrip() for o, v in errors.items())
            said.append({"level": "info", "sentence": f"RMSE of the {word} samples after the filter: {told}."})
    return said


def _resting_on_few(record: Mapping[str, Any]) -> list[dict[str, str]]:
    """A sentence on coefficients that a few samples decide."""
    few = {p["name"]: (p["instrumental_variables"] or p["least_squares"])["degrees"] for p in record["parameters"]}
    few = {n: d for n, d in few.items() if d is not None and d < FEW}
    if not few:
        return []
    counts = {n: round(max(1.0, d)) for n, d in few.items()}
    told = " and ".join(f"{n} (about {c} independent error{'s' if c > 1 else ''})" for n, c in counts.items())
    sentence = (
        f"Few of the {record['rows']} rows decide {told}; the intervals "
        "are wider for it (Student's t). Move what shows them more often."
    )
    return [{"level": "info", "sentence": sentence}]


def page_of(record: Mapping[str, Any], recordings: Any) -> dict[str, Any]:
    """What `write_case_page` takes: sentences, the table, and every recording measured and explained."""
    table = {
        "caption": "Coefficients",
        "columns": list(COLUMNS),
        "rows": rows_of(record, ascii_only=False),
        "note": "Standard errors allow for correlated errors. Both are from the same rows, which plain least squares "
        "counts alike.",
    }
    figures = []
    for r in recordings:
        drawn = fit_figure(Recording.model_validate(r), POINTS)
        figures.append(
            {
                "figure": drawn,
                "label": f"{', '.join(r['outputs'])} of {r['name']}, filtered as the columns are, and as the columns "
                f"explain it",
            }
        )
    return {
        "title": record["name"],
        "subtitle": "A regression by instrumental variables"
        if record["method"] == "instrumental variables"
        else "A regression",
        "sections": [
            {"title": "Result", "command": record["command"], "verdict": record["verdict"], "tables": [table]},
            {"title": "What the columns explain", "figures": figures},
        ],
    }
