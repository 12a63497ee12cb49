"""The page of the gear motor: from a first model over what it lacks to a controller, each step with the command that
repeats it."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.cases.gearmotor.steady import steady_speed
from plantfit.cases.shared.fitting import part, residual, rms
from plantfit.cases.shared.followed import followed_figure
from plantfit.controllers import Controller
from plantfit.findings import Round
from plantfit.fitting import Answer
from plantfit.recording import Recording
from plantfit.report.figures import style
from plantfit.report.figures.control.loops import loop_figure
from plantfit.report.figures.missing import share_figure
from plantfit.report.figures.style import Figure
from plantfit.report.pages.controller import heads, named, table_rows

SENSOR = 6.43  # deg/s, one step of the speed that the board reports
SHOWN = 8  # rows of the table of what was tried
QUANTISED = SENSOR / np.sqrt(12.0)

Section = dict[str, Any]


def scores(answer: Answer) -> tuple[float, float]:
    """RMSE in deg/s of the fitted half and of the unseen half."""
    error = residual(answer, "y")
    return rms(error[part(answer, "fit")]), rms(error[part(answer, "validation")])


def first_section(plain: Answer) -> Section:
    """The model that one writes first."""
    seen, unseen = scores(plain)
    return {
        "title": "1. A first model",
        "command": "plantfit run plain.toml",
        "sentences": [
            f"Voltage in, speed out: w' = gain*u - loss*w. It misses the speed by {seen:.1f} deg/s on the "
            f"half that it was fitted to, and by {unseen:.1f} deg/s on the half that it has not seen (shaded)."
        ],
        "figures": [
            {
                "figure": followed_figure({"w' = gain*u - loss*w": plain}, "prbs", "y"),
                "label": "Speed: measured, and as the first model follows it",
            }
        ],
    }


def cause_section(diagnosis: Mapping[str, Any]) -> Section:
    """What the first model lacks, by evidence; `diagnosis` is the record of `trust.diagnosis`."""
    tried = diagnosis["rounds"][0]["tried"]
    rows = [
        [
            t["name"], f"{100 * t['explained']:.0f} %", f"{t['rmse_with']:.2f}",
            "" if t["unseen_rmse_with"] is None else f"{t['unseen_rmse_with']:.2f}",
        ]
        for t in tried[:SHOWN]
    ]  # fmt: skip
    return {
        "title": "2. What it lacks",
        "command": "plantfit diagnose plain.toml",
        "sentences": [
            f"plantfit tried {len(tried)} additions, each with all "
            "parameters fitted again, and judged them on data left out.",
            *(v["sentence"] for v in diagnosis["verdict"]),
        ],
        "tables": [
            {
                "caption": f"The {min(SHOWN, len(tried))} of {len(tried)} additions that explain most",
                "columns": ["added", "explains of what is left", "RMSE with it [deg/s]", "on unseen data [deg/s]"],
                "rows": rows,
                "note": "Where the last column is empty, the addition explained too little to be fitted in full.",
            }
        ],
        "figures": [
            {
                "figure": share_figure(Round.model_validate(diagnosis["rounds"][0])),
                "label": "What each addition explains",
            }
        ],
    }


def fuller_section(plain: Answer, fuller: Answer, added: str, moves_from: float) -> Section:
    """The model with what was named; `moves_from` V is the lowest voltage that turned the motor on its static curve."""
    (_, before), (seen, unseen) = scores(plain), scores(fuller)
    return {
        "title": f"3. The model with a {added}",
        "command": f"plantfit run {fuller.problem.name}.toml",
        "sentences": [
            "The diagnosis wrote this study file: one line more, under [model.extensions].",
            f"RMSE {seen:.2f} deg/s, and {unseen:.2f} deg/s instead of {before:.1f} on the unseen half. The sensor "
            f"reports speed in steps of {SENSOR} deg/s; rounding to them alone leaves {QUANTISED:.1f} deg/s.",
            _determined(fuller),
            "In this record the motor never stops or turns back, so that dry friction and a dead zone are the same. On "
            "its static curve, "
            f"measured apart, it turns from {moves_from:.3f} V on.",
        ],
        "figures": [
            {
                "figure": followed_figure({f"with a {added}": fuller, "without": plain}, "prbs", "y"),
                "label": f"Speed: measured, with a {added} and without",
            }
        ],
    }


def physics_section(
    fuller: Answer, physics: Answer, curve: Recording, sentences: Sequence[str], figures: Sequence[Mapping[str, Any]]
) -> Section:
    """The physics written out, and what it predicts of a curve that it has not seen; what the section on `fuller`
    says is not repeated."""
    seen, unseen = scores(physics)
    reached = [
        [
            f["name"],
            f"{f['value']:.4g} {f['unit'] or ''}",
            "" if f["reference"] is None else f"{f['reference']:.4g}",
            f["source"],
        ]
        for f in figures
    ]
    return {
        "title": "4. Physics that reaches further",
        "command": "plantfit run gearmotor.toml",
        "sentences": [
            "Dry friction, the PWM driver and a dead time as equations: "
            f"RMSE {seen:.2f} deg/s, {unseen:.2f} on the unseen half.",
            _determined(physics, _determined(fuller)),
            *sentences,
        ],
        "figures": [
            {
                "figure": _static_figure(curve, physics),
                "label": "Settled speed over voltage: measured, and predicted from the record above, which ends at "
                "0.44 V",
            }
        ],
        "tables": [
            {
                "caption": "Figures, and what others reached",
                "columns": ["figure", "reached", "reference", "source"],
                "rows": reached,
            }
        ],
    }


def controller_section(controller: Controller, files: Sequence[Path]) -> Section:
    """The loop on every plant that the data allow."""
    record = controller.typed
    best, w = controller.gains, record.wishes
    plants = f"{record.plants} plants"
    return {
        "title": "5. A controller",
        "command": "plantfit tune gearmotor.toml",
        "sentences": [
            *(v.sentence for v in record.verdict),
            f"Kp {best.Kp:.3g} V/(deg/s), Ki {best.Ki:.3g} V/deg, Kd {best.Kd:.2g} V/(deg/s^2), sampled every "
            f"{w.period:.4g} "
            f"s, between {w.lower:.3g} and {w.upper:.3g} V.",
            f"The same as C for the microcontroller: {', '.join(f.name for f in files)}.",
        ],
        "figures": [
            {
                "figure": loop_figure(controller.curves, w, named(record.output), named(record.input), plants),
                "label": f"A step of the set point, then a load: bands over {plants} that the data allow. The loop "
                f"settles within one "
                f"step of the sensor ({SENSOR} deg/s).",
            }
        ],
        "tables": [
            {
                "caption": "Beside the classical rules; kept by: share of the plants that keep overshoot and Ms",
                "columns": list(heads(record)),
                "rows": table_rows(record),
            }
        ],
    }


def _determined(answer: Answer, above: str = "") -> str:
    """What the verdict says of the parameters; a doubt that stands `above` in the same words is only pointed to."""
    text = next(v["sentence"] for v in answer.findings["verdict"] if v["sentence"].startswith("The data determine"))
    values, *doubts = re.split(r"(?<=\.) (?=[A-Z])", text)
    new = [d for d in doubts if d not in above]
    return " ".join(
        [values, *new, *(["What is said of the residuals above holds here too."] if len(new) < len(doubts) else [])]
    )


def _static_figure(curve: Recording, physics: Answer) -> Figure:
    u, y = curve["u"], curve["y"]
    order = np.argsort(u)
    fine = np.linspace(u[order[0]], u[order[-1]], 400)
    data = [
        {
            "type": "scatter", "mode": "markers", "name": "measured", "x": style.numbers(u), "y": style.numbers(y),
            "marker": {"color": style.MEASURED, "size": 5},
        },
        {
            "type": "scatter", "mode": "lines", "name": "predicted", "x": style.numbers(fine),
            "y": style.numbers(steady_speed(fine, physics.values)), "line": {"color": style.SIMULATED, "width": 1.6},
        },
    ]  # fmt: skip
    layout = style.layout(280, showlegend=True)
    layout["xaxis"], layout["yaxis"] = style.axis("u [V]"), style.axis("settled speed [deg/s]")
    return {"data": data, "layout": layout}
