"""Models: the contract, equations as text, and the library, listed and made as `plantfit.methods` does it.

models.names()                       ("dc_motor", "drive", ...)
models.listing()                     a record of each: name, sentence, source, options
models.describe("dc_motor")          the same of one with its signals and parameters, as text; also of a model
models.make("dc_motor", tied=True)   a model
models.network(text).model()         a model of parts: resistors, springs, tanks, motors, ...
"""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.models.describe import describe
    from plantfit.models.library.catalogue import listing, make, models, names
    from plantfit.models.library.dc_motor import dc_motor
    from plantfit.models.library.drive import drive, drive_regression
    from plantfit.models.library.hammerstein_wiener import hammerstein_wiener
    from plantfit.models.library.pendubot import motor_torque, pendubot, pendubot_regression
    from plantfit.models.library.process import first_order, second_order
    from plantfit.models.library.regression import LinearModel
    from plantfit.models.library.steam_chamber import steam_chamber
    from plantfit.models.library.tabled_process import tabled_first_order
    from plantfit.models.model import Declared, Delay, Model
    from plantfit.models.networks.network import network
    from plantfit.models.parts.friction import coulomb, lugre, stribeck, viscous
    from plantfit.models.parts.smooth import quantize, smooth_abs, smooth_deadzone, smooth_sat
    from plantfit.models.parts.switching import Backlash, Event, Friction, StateDelay
    from plantfit.models.parts.tables import Table, lookup, lookup2
    from plantfit.models.text.equations import equations

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
    "network",
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
        "library.dc_motor": "dc_motor",
        "describe": "describe",
        "library.drive": "drive drive_regression",
        "text.equations": "equations",
        "parts.switching": "Backlash Event Friction StateDelay",
        "parts.friction": "coulomb lugre stribeck viscous",
        "library.hammerstein_wiener": "hammerstein_wiener",
        "library.catalogue": "listing make models names",
        "model": "Declared Delay Model",
        "networks.network": "network",
        "library.pendubot": "motor_torque pendubot pendubot_regression",
        "library.process": "first_order second_order",
        "library.regression": "LinearModel",
        "parts.smooth": "quantize smooth_abs smooth_deadzone smooth_sat",
        "library.steam_chamber": "steam_chamber",
        "library.tabled_process": "tabled_first_order",
        "parts.tables": "Table lookup lookup2",
    },
)
