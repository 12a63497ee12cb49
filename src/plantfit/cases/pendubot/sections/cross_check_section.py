"""Section of the pendubot's page: one record fitted backwards, forwards and by plain least squares."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit.cases.pendubot.cross_check import ForwardFit, cross_check
from plantfit.estimate import Estimate, InverseFit
from plantfit.models.library.pendubot_terms import BASE_UNITS
from plantfit.trust.verdict.words import number, span

FAR = 3.0  # standard errors: the largest of four independent ones is above it once in 90 fits


def cross_check_section(
    inverse: InverseFit,
    forward: ForwardFit,
    truth: Mapping[str, float] | None = None,
    shown: str = "virtual rig",
    stretch: tuple[float, float] | None = None,
) -> dict[str, Any]:
    """Sentences and a table about b1, b2, b4, b5 by three fits; `truth` where known, `shown` says which data these are.

    `stretch` (s) is the part of the record that the forward fit saw, None for all of it.
    """
    compared = cross_check(inverse.estimate, forward.estimate)
    ratio = forward.estimate.standard_error / inverse.estimate.standard_error
    why = (
        ": it also uses the play of the loop about each pose, which instruments leave out because it moves with the "
        "errors of the encoders"
        if stretch is None
        else ", from a part of the record"
    )
    sentences = [
        inverse.bias.sentence,
        compared.sentence,
        f"The forward fit's standard errors are {span(ratio.tolist(), None)} of the inverse fit's{why}.",
        f"The forward fit leaves {number(forward.rmse)} encoder steps (RMS) in the "
        "angles; rounding alone leaves about 0.289. It takes the recorded voltage "
        "as exact, and the inverse fit does not need the angles to follow from it.",
    ]
    if truth is not None:
        sentences.insert(2, _against_truth(inverse.estimate, forward.estimate, truth))
    fits = {"Least squares": inverse.least_squares, "Inverse fit": inverse.estimate, "Forward fit": forward.estimate}
    columns = ["Parameter", "Unit", *(c for n in fits for c in (n, "± 95 %")), "Chi-squared, forward against inverse"]
    rows = [_row(k, name, fits, float(compared.chi_squared[k])) for k, name in enumerate(BASE_UNITS)]
    if truth is not None:
        columns.append("Truth")
        rows = [[*row, f"{truth[name]:.6g}"] for row, name in zip(rows, BASE_UNITS, strict=True)]
    note = (
        "Inverse fit: instrumental variables. Chi-squared has one "
        "degree of freedom a row and counts both fits as independent."
    )
    if stretch is not None:
        note += (
            f" The forward fit saw {stretch[0]:g} to {stretch[1]:g} s "
            "of the record only; the whole study (--full) gives it all."
        )
    return {
        "title": f"Backwards and forwards ({shown})",
        "sentences": sentences,
        "tables": [{"caption": "The same record by three fits", "columns": columns, "rows": rows, "note": note}],
    }


def _against_truth(inverse: Estimate, forward: Estimate, truth: Mapping[str, float]) -> str:
    """How far both fits are from what is known: two fits of one record may agree and be wrong together."""
    true = np.array([truth[n] for n in inverse.names])
    off = {label: (e.values - true) / e.standard_error for label, e in (("inverse", inverse), ("forward", forward))}
    parts = [
        f"the {label} fit is off by {number(abs(z[k]))} of its standard errors at most ({inverse.names[k]})"
        for label, z in off.items()
        for k in [int(np.argmax(np.abs(z)))]
    ]
    both = max(np.max(np.abs(z)) for z in off.values())
    end = (
        "."
        if both <= FAR
        else (
            f": more than {FAR:g} is no chance of one fit in a hundred. Both use the same angles, "
            "and an error of the encoders moves them together, which their comparison cannot show."
        )
    )
    return f"Against the truth {parts[0]}, {parts[1]}{end}"


def _row(k: int, name: str, fits: Mapping[str, Estimate], chi: float) -> list[str]:
    values = [
        cell for e in fits.values() for cell in (f"{e.values[k]:.6g}", number(float(np.ptp([e.low[k], e.high[k]])) / 2))
    ]
    return [name, BASE_UNITS[name], *values, number(chi)]
