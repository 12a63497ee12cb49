"""Linear drive with friction, as a simulation model and as a regression of force."""

from collections.abc import Mapping
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Declared, Model, Named
from plantfit.models.remade import remade

# isort: split
import jax.numpy as jnp

_SOURCE = (
    "Janot, Gautier, Brunot, Data set and reference models of EMPS, "
    "Nonlinear System Identification Benchmarks workshop, 2019"
)

_PARAMETERS = (
    Declared("M", "kg", (1.0, 1e3), "log", sentence="moved mass, with the inertia of the motor"),
    Declared("Fv", "N*s/m", (0.1, 1e4), "log", sentence="viscous friction"),
    Declared("Fc", "N", (0.1, 1e3), "log", sentence="Coulomb friction"),
    Declared(
        "offset", "N", (-100.0, 100.0), sentence="constant force: offset of the amplifier, uneven friction, weight"
    ),
)


@remade
def drive(velocity_output: bool = False, smooth_width: float = 1e-3) -> Model:
    """Mass moved by a force against friction.

        q' = v
        M v' = force - Fv v - Fc tanh(v / v0) - offset

    Input force (N); output q (m), and v (m/s) with `velocity_output`. M (kg), Fv (N s/m),
    Fc (N), offset (N); v0 = `smooth_width` (m/s) is the width over which Coulomb friction
    changes sign. Starts at the first measured position, and at rest unless v is measured.

    Source: Janot, Gautier, Brunot 2019 (EMPS); Coulomb term smoothed by tanh.
    """

    def derivative(x: Named, u: Named, p: Named) -> Named:
        v = x["v"]
        return {"q": v, "v": (u["force"] - p["Fv"] * v - p["Fc"] * jnp.tanh(v / smooth_width) - p["offset"]) / p["M"]}

    def output(x: Named, u: Named, p: Named) -> Named:
        return {"q": x["q"], "v": x["v"]} if velocity_output else {"q": x["q"]}

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        return {"q": y0["q"], "v": y0["v"] if velocity_output else jnp.zeros_like(jnp.asarray(y0["q"], dtype=float))}

    return Model(
        name="drive",
        states={"q": "m", "v": "m/s"},
        inputs={"force": "N"},
        outputs={"q": "m", "v": "m/s"} if velocity_output else {"q": "m"},
        parameters=_PARAMETERS,
        output=output,
        derivative=derivative,
        initial_state=initial_state,
        sentence="Linear drive: mass, viscous and Coulomb friction, constant force.",
        source=_SOURCE,
    )


@remade
def drive_regression() -> LinearModel:
    """Force of a drive as a linear regression.

        force = M acceleration + Fv velocity + Fc sign(velocity) + offset

    Signals acceleration (m/s^2) and velocity (m/s), both from a filtered position; target force
    (N). Parameters as in `drive`. Errors of the differentiated position stand in the columns: where they are not small,
    fit it by instrumental variables, in a study file by the table [regression].

    Source: Janot, Gautier, Brunot 2019 (EMPS), inverse dynamic identification model.
    """

    def regressor(signals: Mapping[str, Any]) -> np.ndarray:
        velocity = np.asarray(signals["velocity"], dtype=float)
        return np.stack(
            [np.asarray(signals["acceleration"], dtype=float), velocity, np.sign(velocity), np.ones_like(velocity)],
            axis=-1,
        )

    return LinearModel(
        name="drive_regression",
        outputs={"force": "N"},
        parameters=_PARAMETERS,
        regressor=regressor,
        signals={"acceleration": "m/s^2", "velocity": "m/s"},
        sentence="Force of a linear drive, linear in mass and friction.",
        source=_SOURCE,
    )
