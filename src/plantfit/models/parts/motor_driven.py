"""A mechanism whose torque comes from a DC motor: winding and back-EMF added to any model that is driven by a
torque."""

from dataclasses import replace

from plantfit.errors import ModelError
from plantfit.models.model import Declared, Model, Named

_WINDING = (
    Declared("Rm", "ohm", (0.1, 100.0), "log", sentence="winding resistance"),
    Declared("Lm", "H", (1e-5, 0.1), "log", sentence="winding inductance"),
    Declared("Kb", "V*s/rad", (1e-3, 1.0), "log", sentence="back-EMF constant"),
    Declared("Kt", "N*m/A", (1e-3, 1.0), "log", sentence="torque constant"),
)


def motor_driven(model: Model, torque: str, speed: str, gear: float = 1.0) -> Model:
    """The model with input `torque` (N m) given by a motor, in its place the voltage V; `speed` (rad/s) is the state
    that it turns with.

        Lm i' = V - Rm i - Kb gear speed ;  torque = gear Kt i

    Further state i (A), from 0. The rotor's inertia and friction are the mechanism's, which must have them: they add to
    its own. Source: as `dc_motor`. Raises ModelError for a name that the model does not have, or has already.
    """
    if torque not in model.inputs or speed not in model.states:
        has = f"{model.name!r} has the inputs {list(model.inputs)} and states {list(model.states)}"
        raise ModelError(f"motor_driven: torque {torque!r}, speed {speed!r}; {has}, name one of each.")
    taken = {*model.states, *model.inputs, *(p.name for p in model.parameters)} & {
        "i",
        "V",
        *(p.name for p in _WINDING),
    }
    if taken:
        raise ModelError(f"motor_driven: {model.name!r} already has {sorted(taken)[0]!r}; rename it there.")
    rate, output, start = model.derivative, model.output, model.initial_state

    def inner(x: Named, u: Named, p: Named) -> tuple[Named, Named]:
        drive = {torque: gear * p["Kt"] * x["i"]}
        return {n: v for n, v in x.items() if n != "i"}, {n: v for n, v in u.items() if n != "V"} | drive

    def derivative(x: Named, u: Named, p: Named) -> Named:
        own, drive = inner(x, u, p)
        return {**rate(own, drive, p), "i": (u["V"] - p["Rm"] * x["i"] - gear * p["Kb"] * x[speed]) / p["Lm"]}  # pyrefly: ignore[not-callable]

    return replace(
        model,
        name=f"{model.name}_with_motor",
        states={**model.states, "i": "A"},
        inputs={"V": "V", **{n: unit for n, unit in model.inputs.items() if n != torque}},
        parameters=(*model.parameters, *_WINDING),
        derivative=derivative,
        output=lambda x, u, p: output(*inner(x, u, p), p),
        initial_state=None if start is None else lambda p, u0, y0: {**start(p, {**u0, torque: 0.0}, y0), "i": 0.0},
    )
