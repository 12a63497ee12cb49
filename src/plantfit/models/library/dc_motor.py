"""Brushed DC motor with viscous and Coulomb friction."""

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.models.model import Declared, Delay, Model, Named
from plantfit.models.remade import remade

# isort: split
import jax.numpy as jnp

_DELAYED = "V_delayed"


@remade
def dc_motor(
    current_output: bool = False,
    tied: bool = False,
    dead_time: bool = False,
    load: bool = False,
    smooth_width: float = 0.1,
) -> Model:
    """Voltage-driven DC motor.

        Lm i' = V(t - Td) - Rm i - Kb w
        Jm w' = Kt i - Cm w - Tf tanh(w / w0) - T

    Input V (V), and load torque T (N m) with `load`. Output w (rad/s), and current i (A) with
    `current_output`. Rm (ohm), Lm (H): winding; Kb (V s/rad): back-EMF constant; Kt (N m/A):
    torque constant; Jm (kg m^2): inertia; Cm (N m s/rad): viscous friction; Tf (N m): Coulomb
    friction; w0 = `smooth_width` (rad/s): width over which Coulomb friction changes sign.

    `tied` takes Kt = Kb, which holds in SI units when losses in the iron are left out.
    `dead_time` delays the voltage by Td (s). The motor starts at the first measured speed; a
    current that is not measured starts at the value that holds this speed.

    From speed alone, one scale of (Kt, Jm, Cm, Tf) is free: only their ratios are determined.

    Source: Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems, section 2.3
    (electromechanical systems); Coulomb term smoothed by tanh.
    """
    voltage = _DELAYED if dead_time else "V"
    torque_constant = "Kb" if tied else "Kt"

    def friction(w, p):
        return p["Cm"] * w + p["Tf"] * jnp.tanh(w / smooth_width)

    def derivative(x: Named, u: Named, p: Named) -> Named:
        i, w = x["i"], x["w"]
        torque = p[torque_constant] * i - friction(w, p)
        if load:
            torque = torque - u["T"]
        return {"i": (u[voltage] - p["Rm"] * i - p["Kb"] * w) / p["Lm"], "w": torque / p["Jm"]}

    def output(x: Named, u: Named, p: Named) -> Named:
        return {"w": x["w"], "i": x["i"]} if current_output else {"w": x["w"]}

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        if current_output:
            return {"i": y0["i"], "w": y0["w"]}
        holding = friction(y0["w"], p) + (u0["T"] if load else 0.0)
        return {"i": holding / p[torque_constant], "w": y0["w"]}

    parameters = [
        Declared("Rm", "ohm", (0.1, 100.0), "log", sentence="winding resistance"),
        Declared("Lm", "H", (1e-5, 0.1), "log", sentence="winding inductance"),
        Declared("Kb", "V*s/rad", (1e-3, 1.0), "log", sentence="back-EMF constant"),
        Declared("Kt", "N*m/A", (1e-3, 1.0), "log", sentence="torque constant"),
        Declared("Jm", "kg*m^2", (1e-8, 1e-2), "log", sentence="inertia of rotor and load"),
        Declared("Cm", "N*m*s/rad", (1e-8, 1e-2), "log", sentence="viscous friction"),
        Declared("Tf", "N*m", (1e-6, 1.0), "log", sentence="Coulomb friction"),
    ]
    if tied:
        parameters = [p for p in parameters if p.name != "Kt"]
    if dead_time:
        parameters.append(Declared("Td", "s", (0.0, 0.5), sentence="dead time of the voltage"))
    return Model(
        name="dc_motor",
        states={"i": "A", "w": "rad/s"},
        inputs={"V": "V", "T": "N*m"} if load else {"V": "V"},
        outputs={"w": "rad/s", "i": "A"} if current_output else {"w": "rad/s"},
        parameters=tuple(parameters),
        output=output,
        derivative=derivative,
        initial_state=initial_state,
        delays=(Delay(_DELAYED, "V", "Td"),) if dead_time else (),
        sentence="Brushed DC motor with viscous and Coulomb friction.",
        source="Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems, section 2.3",
    )
