"""Controllers of a plant that is known, written as `plantfit tune` writes them."""

import json
from pathlib import Path

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cli.terminal.out import plain
from plantfit.control.tune import OneLoop, Wishes
from plantfit.control.tune.reduction import reduced
from plantfit.control.tune.told import settings
from plantfit.control.tune.weights.plan_weights import PlanShape
from plantfit.control.tune.weights.servo_weights import ServoPlant
from plantfit.models.model import Model


def tuned_file(
    folder: Path,
    model: Model,
    values: dict[str, float],
    wishes: Wishes,
    weights: tuple[float, ...],
    units: tuple[str, str],
) -> Path:
    """An LQI or MPC, as the wishes say, of these weights for a model of one output and one input; `units` are
    theirs."""
    (output,), (input_,) = model.outputs, model.inputs
    loop = OneLoop(model, output, input_, {}, {n: np.array([v]) for n, v in values.items()})
    rest = loop.at_rest(wishes.set_point, (wishes.lower, 0.0, wishes.upper))
    small = reduced(rest, 0.5 * wishes.period)
    plant = ServoPlant.of(rest, small, wishes)
    plan, given = None, plant.servo(*weights)
    if wishes.controller == "mpc":
        shape = PlanShape.of(plant, small, wishes)
        plan, given = {"moves": shape.lengths}, shape.predictive(*weights)
    record = {
        "output": {"name": output, "unit": units[0]}, "input": {"name": input_, "unit": units[1]},
        "wishes": wishes.__dict__,
        "controllers": [settings(given)], "plan": plan,
    }  # fmt: skip
    file = folder / f"{wishes.controller}-tune.json"
    file.write_text(json.dumps(plain(record), allow_nan=False))
    return file
