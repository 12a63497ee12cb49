"""The page of a designed input, and its tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from plantfit.findings.record import array
from plantfit.findings.results.next_experiment import NextExperiment
from plantfit.report.case_page import write_case_page
from plantfit.report.figures.pages.excitation import waveform_figure

COLUMNS = (
    "parameter",
    "value",
    "standard error now",
    "with this record too",
    "of this record alone",
    "largest over the plants",
)
_MEANT = {
    "D": "the ellipsoid of all errors is as small as can be (D-optimal)",
    "A": "the mean square of the relative errors is as small as can be (A-optimal)",
    "difference": "two models foretell outputs as far apart as can be",
}


def error_rows(record: NextExperiment) -> list[tuple[str, ...]]:
    """Texts of `COLUMNS` for each parameter."""
    return [
        (_with_unit(r.name, r.unit), f"{r.value:.4g}", *(_error(v) for v in (r.now, r.then, r.alone, r.worst)))
        for r in record.parameters
    ]


def asked(record: NextExperiment) -> list[str]:
    """What was asked for, and what it was judged by."""
    rows = f"{record.samples} samples" + ("" if record.levels else f" every {record.period:.5g} s")
    found = [f"{rows}; {_MEANT[record.criterion]}."]
    if record.chosen:
        found[0] = found[0][:-1] + f", of {', '.join(record.chosen)} alone."
    for i in record.inputs:
        slew = f", at most {i.slew:g} {_plain(i.unit)}/s".replace(" /s", " per second") if i.slew else ""
        found.append(f"{i.name} from {i.low:.5g} to {i.high:.5g} {_plain(i.unit)}".rstrip() + f"{slew}.")
    for name, r in record.limits.items():
        ends = [f"above {r.low:.5g}" if r.low is not None else "", f"below {r.high:.5g}" if r.high is not None else ""]
        kept = "it goes from {:.5g} to {:.5g}".format(*array(r.reached))
        found.append(f"{name} {' and '.join(e for e in ends if e)} {_plain(r.unit)}".rstrip() + f": {kept}.")
    plants = (
        "the best fit"
        if record.plants == 1
        else f"the best fit and {record.plants - 1} other plants that the data allow"
    )
    if record.criterion == "difference":
        plants = "the best fit of each model"
    found.append(
        f"Judged on {plants}; {record.tried} {'sets of levels' if record.levels else 'inputs'} were simulated."
    )
    return found


def write_next_experiment_page(
    record: NextExperiment, t: np.ndarray, inputs: Mapping[str, tuple[np.ndarray, str | None]],
    outputs: Mapping[str, tuple[np.ndarray, str | None]], path: str | Path, file: str,
) -> Path:  # fmt: skip
    """Write the page of a designed input (`ExperimentDesign.typed`) to `path`; signals (N,) with units at times t
    (N,) in s."""
    along = "sample by sample, in any order" if record.levels else "over time"
    shown = "What will be measured at" if record.levels else "What will be played, and what the model foretells"
    much = f"{record.samples} samples" if record.levels else f"{record.seconds:g} s"
    figures = [
        {"figure": waveform_figure(t, y, n, unit, bool(record.levels)), "label": f"{n} {along}"}
        for n, (y, unit) in (*inputs.items(), *outputs.items())
    ]
    compared = [("this input", record.shape, "1")]
    compared += [(c.kind, c.name, "inf" if c.times is None else f"{c.times:.2f}") for c in record.compared]
    worse = "times closer" if record.criterion == "difference" else "errors, times as large"
    page = {
        "title": f"Next experiment: {record.name}",
        "subtitle": f"{much} of {', '.join(i.name for i in record.inputs)}, in {file}",
        "sections": [
            {"title": "What it tells", "verdict": [v.plain() for v in record.verdict], "sentences": asked(record),
             "tables": [{"caption": "Standard errors", "columns": COLUMNS, "rows": error_rows(record)}]},
            {"title": shown, "figures": figures},
            *([] if record.levels else [{"title": "Beside other inputs of the same length and limits",
             "tables": [{"caption": "The best of each kind", "columns": ("kind", "settings", worse),
                         "rows": compared}]}]),
        ],
    }  # fmt: skip
    return write_case_page(page, path)


def _with_unit(name: str, unit: str | None) -> str:
    return f"{name} [{_plain(unit)}]" if _plain(unit) else name


def _plain(unit: str | None) -> str:
    return "" if unit in (None, "1") else str(unit)


def _error(value: float | None) -> str:
    return "not determined" if value is None else f"{value:.3g}"


__all__: Sequence[str] = ("COLUMNS", "asked", "error_rows", "write_next_experiment_page")
