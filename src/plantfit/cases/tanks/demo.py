"""Fit three quarters of the tank record, score the last one."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from plantfit.cases.shared.files import unpack
from plantfit.cases.shared.fitting import fit_file, part, residual, rms
from plantfit.cases.shared.record import figure, record

PUBLISHED = {
    "best linear approximation": 0.75,
    "Volterra": 0.54,
    "Gaussian process state space": 0.45,
    "SCI": 0.40,
    "NLSS2": 0.34,
    "TSEM": 0.33,
    "grey box with overflow (Rogers 2017)": 0.18,
}
THERE = "published, on the validation record, not this one"


def run(folder: str | Path, progress: Callable[[Any], None] | None = None) -> dict[str, Any]:
    """See `plantfit.cases.shared.registry.demos`."""
    file = unpack("tanks", folder) / "tanks.toml"
    answer = fit_file(file, progress)
    error = residual(answer, "level")
    baseline = "linear cascade with offset, whole record"
    figures = [
        figure("RMSE on the fitted three quarters", rms(error[part(answer, "fit")]), "V", 0.525, baseline),
        figure(
            "RMSE on the unseen quarter", rms(error[part(answer, "validation")]), "V", PUBLISHED["SCI"], f"SCI: {THERE}"
        ),
        figure("upper level at the start, never measured", answer.values["h1_start"], "V"),
    ]
    listed = ", ".join(f"{name} {value:.2f} V" for name, value in PUBLISHED.items())
    sentences = [
        "The benchmark's validation record is held back, so the last "
        "quarter of the training record is the unseen part here.",
        f"Published RMSE on that other record, for orientation only: {listed}.",
    ]
    return record("tanks", "Cascaded tanks with overflow", figures, sentences, [answer], [file])
