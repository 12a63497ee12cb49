"""The plant near its rest as matrices, for the targets that are linear."""

from typing import Any

import numpy as np

from plantfit.bridges.plant import Plant
from plantfit.control.tune.one_loop import OneLoop
from plantfit.errors import SimulationError


def matrices(plant: Plant) -> dict[str, Any]:
    """Matrices of the ways of the input that act, by the seconds that they are late."""
    rest, through, level, names = _linear(plant)
    used = [k for k in range(rest.B.shape[1]) if np.any(rest.B[0, k]) or through[k]]
    places = [plant.vector.states.index(n) for n in names]
    return {
        "A": rest.A[0].tolist(), "C": [rest.C[0].tolist()], "x0": rest.x[0][places].tolist(), "u0": float(rest.u[0]),
        "y0": level,
        "paths": [
            {"delay": float(rest.late[0, k]), "B": rest.B[0, k][:, None].tolist(), "D": [[float(through[k])]]} for k in
            used ],
        "states": list(names), "input": next(iter(plant.model.inputs)), "output": next(iter(plant.model.outputs)),
        "units": {k: v for k, v in {**plant.model.states, **plant.model.inputs, **plant.model.outputs}.items() if v},
    }  # fmt: skip


def _linear(plant: Plant) -> tuple[Any, np.ndarray, float, tuple[str, ...]]:
    """The plant at rest at the middle of its first output in the recording, how this follows every way of the input
    at once (c,), the level, and the states that reach it. SimulationError for a plant of several inputs or outputs,
    or without a rest."""
    model = plant.model
    if len(model.inputs) != 1 or len(model.outputs) != 1:
        raise SimulationError(
            f"Model {model.name!r} has {len(model.inputs)} inputs and {len(model.outputs)} outputs; matrices can be "
            "exported only for one input and one output. Export --to python, c or casadi, which hold the whole model."
        )
    (input_,), (output,) = model.inputs, model.outputs
    loop = OneLoop(model, output, input_, {}, {n: np.asarray(v)[None] for n, v in plant.p.items()})
    seen = plant.answer.problem.experiments[plant.recording].recording[output]
    level = float(np.nanmedian(seen))
    u = plant.inputs[input_]
    rest = loop.at_rest(level, (float(u.min()), float(np.median(u)), float(u.max())))
    if not np.isfinite(rest.u[0]):
        raise SimulationError(
            f"No rest of model {model.name!r} was found at {output} = {level:.4g}, where it would be linearised; "
            "export --to python, c or casadi, which hold the whole model."
        )
    return rest, loop.through(rest)[0], level, loop.followed
