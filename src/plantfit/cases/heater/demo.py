"""Steps of one heater as a first and a second order with dead time; both heaters by energy balances, the second half
predicted."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from plantfit.cases.shared.files import unpack
from plantfit.cases.shared.fitting import fit_file, part, residual, rms
from plantfit.cases.shared.followed import followed_figure
from plantfit.cases.shared.record import figure, record
from plantfit.fitting import Answer
from plantfit.trust.intervals.profile import profile
from plantfit.trust.validate.dead_time import dead_time

OWN = "simulation with the delayed input's mean, fitted by scipy (own)"
APART = "a first order with dead time for each heater, same halves, by scipy (own)"
REFERENCE = {  # a separate simulator on the same file
    "first_order": {"RMSE": 0.381, "K": 0.3607, "tau": 138.1, "L": 14.2},
    "second_order": {"RMSE": 0.313, "K": 0.3626, "tau_heater": 136.5, "tau_sensor": 10.0, "L": 4.6},
}
ALONE = {"y1": 0.922, "y2": 6.09}  # K, RMSE on the second half


def run(folder: str | Path, progress: Callable[[Any], None] | None = None) -> dict[str, Any]:
    """See `plantfit.cases.shared.registry.demos`."""
    place = unpack("heater", folder)
    files = [place / f"{name}.toml" for name in ("first_order", "second_order", "two_heaters")]
    answers = [fit_file(file, progress) for file in files]
    steps, both = answers[:2], answers[2]
    late = [dead_time(a.problem, a) for a in steps]
    figures = [
        figure(f"{a.problem.name}: RMSE", rms(residual(a, "y")), "K", REFERENCE[a.problem.name]["RMSE"], OWN)
        for a in steps
    ]
    for answer, found in zip(steps, late, strict=True):
        figures.append(
            figure(f"{answer.problem.name}: dead time", found.value, "s", REFERENCE[answer.problem.name]["L"], OWN)
        )
    for output, alone in ALONE.items():
        error = residual(both, output)
        figures.append(figure(f"two heaters, {output}: RMSE on the fitted half", rms(error[part(both, "fit")]), "degC"))
        figures.append(
            figure(
                f"two heaters, {output}: RMSE on the unseen half",
                rms(error[part(both, "validation")]),
                "degC",
                alone,
                APART,
            )
        )
    sentences = [f"{a.problem.name}: {d.sentence}" for a, d in zip(steps, late, strict=True)]
    shorter = late[1].value < late[0].value
    sentences.append(
        f"No pipe delays this board: with a second lag the dead time {'shrinks' if shorter else 'grows'} from "
        f"{late[0].value:.3g} to "
        f"{late[1].value:.2g} s, so that most of the first order's is the way of the heat to the sensor."
    )
    sections = [_steps_section(steps, sentences), _both_section(both)]
    subtitle = "Two recordings of a real board"
    return record(
        "heater", "Heater board (Temperature Control Lab)", figures, sentences, answers, files, sections, subtitle
    )


def _steps_section(steps: Sequence[Answer], sentences: Sequence[str]) -> dict[str, Any]:
    rows = []
    for answer in steps:
        for name, reference in REFERENCE[answer.problem.name].items():
            if name == "RMSE":
                continue
            p = profile(answer.problem, answer, name)
            inside = "yes" if p.low <= reference <= p.high else "no"
            rows.append(
                [
                    answer.problem.name,
                    name,
                    p.unit or "",
                    *(f"{v:.4g}" for v in (p.value, p.low, p.high, reference)),
                    inside,
                ]
            )
    return {
        "title": "One heater, steps of its power",
        "sentences": list(sentences),
        "tables": [
            {
                "caption": "Parameters with intervals by profile likelihood, widened for correlated residuals",
                "columns": ["model", "parameter", "unit", "value", "95 % from", "to", "scipy (own)", "inside"],
                "rows": rows,
            }
        ],
        "figures": [
            {
                "figure": followed_figure({a.problem.name: a for a in steps}, "steps", "y"),
                "label": "Temperature of the heater: measured, and simulated from the first sample on.",
            }
        ],
    }


def _both_section(both: Answer) -> dict[str, Any]:
    rows = [
        [p["name"], p["unit"] or "", *(f"{p[k]:.4g}" for k in ("value", "low", "high"))]
        for p in both.findings["parameters"]
    ]
    return {
        "title": "Two heaters side by side",
        "sentences": [
            "Two energy balances in text, coupled between the heaters; "
            "the first half is fitted, the second only predicted.",
            *(v["sentence"] for v in both.findings["verdict"] if "not seen" in v["sentence"]),
        ],
        "tables": [
            {"caption": "Constants", "columns": ["parameter", "unit", "value", "95 % from", "to"], "rows": rows}
        ],
        "figures": [
            {
                "figure": followed_figure({"simulated": both}, "heaters", output),
                "label": f"Temperature {output[1]}; the shaded half was not fitted.",
            }
            for output in ALONE
        ],
    }
