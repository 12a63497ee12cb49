"""Models: the contract, equations as text, and the library, listed and made as `plantfit.methods` does it.

models.names()                       ("dc_motor", "drive", ...)
models.listing()                     a record of each: name, sentence, source, options
models.describe("dc_motor")          the same of one with its signals and parameters, as text; also of a model
models.make("dc_motor", tied=True)   a model
"""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.models.dc_motor import dc_motor
    from plantfit.models.describe import describe
    from plantfit.models.drive import drive, drive_regression
    from plantfit.models.equations import equations
    from plantfit.models.events import Backlash, Event, Friction, StateDelay
    from plantfit.models.friction import coulomb, lugre, stribeck, viscous
    from plantfit.models.hammerstein_wiener import hammerstein_wiener
    from plantfit.models.library import listing, make, models, names
    from plantfit.models.model import Declared, Delay, Model
    from plantfit.models.pendubot import motor_torque, pendubot, pendubot_regression
    from plantfit.models.process import first_order, second_order
    from plantfit.models.regression import LinearModel
    from plantfit.models.smooth import quantize, smooth_abs, smooth_deadzone, smooth_sat
    from plantfit.models.steam_chamber import steam_chamber
    from plantfit.models.tabled_process import tabled_first_order
    from plantfit.models.tables import Table, lookup, lookup2

__all__ = [
    "Backlash",
    "Declared",
    "Delay",
    "Event",
    "Friction",
    "LinearModel",
    "Model",
    "StateDelay",
    "Table",
    "coulomb",
    "dc_motor",
    "describe",
    "drive",
    "drive_regression",
    "equations",
    "first_order",
    "hammerstein_wiener",
    "listing",
    "lookup",
    "lookup2",
    "lugre",
    "make",
    "models",
    "motor_torque",
    "names",
    "pendubot",
    "pendubot_regression",
    "quantize",
    "second_order",
    "smooth_abs",
    "smooth_deadzone",
    "smooth_sat",
    "steam_chamber",
    "stribeck",
    "tabled_first_order",
    "viscous",
]

names_of(
    __name__,
    {
        "dc_motor": "dc_motor",
        "describe": "describe",
        "drive": "drive drive_regression",
        "equations": "equations",
        "events": "Backlash Event Friction StateDelay",
        "friction": "coulomb lugre stribeck viscous",
        "hammerstein_wiener": "hammerstein_wiener",
        "library": "listing make models names",
        "model": "Declared Delay Model",
        "pendubot": "motor_torque pendubot pendubot_regression",
        "process": "first_order second_order",
        "regression": "LinearModel",
        "smooth": "quantize smooth_abs smooth_deadzone smooth_sat",
        "steam_chamber": "steam_chamber",
        "tabled_process": "tabled_first_order",
        "tables": "Table lookup lookup2",
    },
)
