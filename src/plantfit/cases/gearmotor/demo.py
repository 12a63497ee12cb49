"""From a first model of the PRBS record over what it lacks to physics that predicts the static curve, and to a
controller."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.cases.gearmotor import story
from plantfit.cases.gearmotor.joint import SETTLING, joint_figures, joint_sentence
from plantfit.cases.gearmotor.steady import steady_speed
from plantfit.cases.shared.files import unpack
from plantfit.cases.shared.fitting import fit_file, part, residual, rms
from plantfit.cases.shared.record import figure, record
from plantfit.cases.shared.stages import stages, within
from plantfit.controllers import tune
from plantfit.errors import SimulationError
from plantfit.fitting import Answer
from plantfit.recording import Recording, read
from plantfit.report.pages.controller import write_controller_page
from plantfit.spec import with_additions
from plantfit.trust.diagnosis import changed, diagnose, diagnosis_record

PARTS = ("first model", "what it lacks", "with what it lacks", "physics", "both records", "controller")
ADDED = "dead zone"
LINEAR = "first-order model with dead time about the mean, same halves"


def run(folder: str | Path, progress: Callable[[Any], None] | None = None) -> dict[str, Any]:
    """See `plantfit.cases.shared.registry.demos`."""
    begins = stages(PARTS, progress)
    first = unpack("gearmotor", folder) / "plain.toml"
    file, both, better = (
        first.with_name(f"{n}.toml") for n in ("gearmotor", "static_and_prbs", f"plain-with-{ADDED.replace(' ', '-')}")
    )
    begins(PARTS[0])
    plain = fit_file(first)
    begins(PARTS[1])
    found = diagnose(plain.problem, plain.best.x)
    if found.found[0].extension.kind != ADDED.replace(" ", "_"):
        raise SimulationError(
            f"The diagnosis named {found.found[0].extension.name!r}; restore the files of the demo and run it again."
        )
    better.write_text(with_additions(first.read_text("utf-8"), first, changed(found), name=better.stem), "utf-8")
    begins(PARTS[2])
    fuller = fit_file(better)
    begins(PARTS[3])
    answer = fit_file(file)
    begins(PARTS[4])
    joint = fit_file(both)
    begins(PARTS[5])
    controller = tune(answer, progress=within(PARTS[5], progress))
    code = controller.to_c(file.parent)
    error, seen, unseen = residual(answer, "y"), part(answer, "fit"), part(answer, "validation")
    settled = unseen & (answer.problem.experiments["prbs"].recording.t >= _start(answer, unseen) + SETTLING)
    low, high = _range(answer)
    curve = read(file.with_name("static.csv"), period=1.0, signals={"u": "u", "y": "y"}, units={"u": "V", "y": "deg/s"})
    static = static_curve(curve, answer.values, low, high)
    figures = [
        figure("RMSE on the fitted half", rms(error[seen]), "deg/s", 5.06, LINEAR),
        figure(
            "RMSE on the unseen half, after 3 s, mean error removed",
            float(np.std(error[settled])),
            "deg/s",
            5.38,
            LINEAR,
        ),
        figure("RMSE on the unseen half, nothing removed", rms(error[unseen]), "deg/s"),
        figure("mean error on the unseen half after 3 s", float(np.mean(error[settled])), "deg/s"),
        *static,
        *joint_figures(joint),
    ]
    near, far = static[0], static[2]
    sentences = [
        f"Its static curve was measured apart, from -5 to 5 V; the record above holds {low:.2f} to "
        f"{high:.2f} V. Within that range the prediction is {near['value']:.0f} deg/s off; at 5 V, "
        f"far outside, it says {far['value']:.0f} deg/s and {far['reference']:.0f} were measured.",
        f"What is left on the unseen half is a drift: {np.mean(error[settled]):.1f} "
        "deg/s in the mean, which constant parameters do not follow.",
        joint_sentence(joint),
    ]
    sections = [
        story.first_section(plain),
        story.cause_section(diagnosis_record(found)),
        story.fuller_section(plain, fuller, ADDED, static[3]["reference"]),
        story.physics_section(fuller, answer, curve, sentences, figures),
        story.controller_section(controller, [code.source, code.header]),
    ]
    page = write_controller_page(controller.typed, controller.curves, file.with_name("gearmotor-tune.html"))
    answers, files = [answer, joint, plain, fuller], [file, both, first, better]
    subtitle = "A real motor: from a first model to a controller"
    return record("gearmotor", "Geared DC motor", figures, sentences, answers, files, sections, subtitle, [page])


def static_curve(curve: Recording, values: dict[str, float], low: float, high: float) -> list[dict[str, Any]]:
    """How well the fitted parameters predict the measured static curve; `low` to `high` V is what the fit has seen."""
    u, y = curve["u"], curve["y"]
    predicted = steady_speed(u, values)
    moving = u[(u > 0) & (y > 0)]
    at_top, inside = u == u.max(), (u >= low) & (u <= high)
    return [
        figure(
            "static curve inside the range of the record, RMSE of the prediction",
            rms(predicted[inside] - y[inside]),
            "deg/s",
        ),
        figure(
            "static curve, -5 to 5 V, RMSE of the prediction",
            rms(predicted - y),
            "deg/s",
            float(np.std(y)),
            "spread of the curve itself",
        ),
        figure(
            "static speed at 5 V, predicted",
            float(predicted[at_top][0]),
            "deg/s",
            float(y[at_top][0]),
            "measured static curve",
        ),
        figure(
            "dead zone, predicted edge",
            values["threshold"],
            "V",
            float(moving.min()),
            "lowest positive voltage that turned the motor",
        ),
    ]


def _start(answer: Answer, mask: np.ndarray) -> float:
    return float(answer.problem.experiments["prbs"].recording.t[mask][0])


def _range(answer: Answer) -> tuple[float, float]:
    u = answer.problem.experiments["prbs"].recording["u"]
    return float(u.min()), float(u.max())
