"""Models: the contract, equations as text, and the library."""

from plantfit.models.dc_motor import dc_motor
from plantfit.models.describe import describe
from plantfit.models.drive import drive, drive_regression
from plantfit.models.equations import equations
from plantfit.models.library import make, models
from plantfit.models.model import Declared, Delay, Model
from plantfit.models.process import first_order, second_order
from plantfit.models.regression import LinearModel

__all__ = [
    "Declared",
    "Delay",
    "LinearModel",
    "Model",
    "dc_motor",
    "describe",
    "drive",
    "drive_regression",
    "equations",
    "first_order",
    "make",
    "models",
    "second_order",
]
