"""Friction laws for the joints of the double pendulum, and what fitting one gives."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from plantfit.cases.double_pendulum.reference import law_model
from plantfit.models.library.regression import LinearModel


@dataclass(frozen=True)
class Law:
    """Parts and sign of `JointFriction`; `shape` names the option that is fitted over `grid` (same for both joints).

    With `zeros` the encoder zeros of every fitted run are nuisance parameters. A run that was left out is predicted as
    recorded.
    """

    name: str
    parts: tuple[str, ...]
    sign: str = "atan"
    shape: str = "sign_width"
    grid: tuple[float, ...] = (0.01,)
    zeros: bool = False


WIDTHS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.3)  # rad/s
SPEEDS = (0.05, 0.1, 0.3, 1.0, 3.0)  # rad/s
DISTANCES = (3e-4, 5e-4, 7e-4, 1e-3, 1.5e-3, 2e-3)  # rad
PLAIN = Law("viscous, Coulomb by arctan(100 ω)", ("viscous", "coulomb"))
PRESLIDING = Law(
    "viscous, Coulomb with presliding", ("viscous", "coulomb"), "presliding", "presliding_distance", DISTANCES
)
LAWS = (
    PLAIN,
    Law("the same, width of the arctan fitted", ("viscous", "coulomb"), grid=WIDTHS),
    Law("viscous, Coulomb, offset", ("viscous", "coulomb", "offset")),
    Law("viscous, Coulomb, Stribeck", ("viscous", "coulomb", "stribeck"), "atan", "stribeck_velocity", SPEEDS),
    Law("viscous, Coulomb, load", ("viscous", "coulomb", "load")),
    PRESLIDING,
    Law(
        "viscous, Coulomb, load with presliding",
        ("viscous", "coulomb", "load"),
        "presliding",
        "presliding_distance",
        DISTANCES,
    ),
    Law("Coulomb, load with presliding", ("coulomb", "load"), "presliding", "presliding_distance", DISTANCES),
    Law(
        "viscous, Coulomb with presliding, encoder zeros",
        ("viscous", "coulomb"),
        "presliding",
        "presliding_distance",
        DISTANCES,
        True,
    ),
    Law(
        "Coulomb, load with presliding, encoder zeros",
        ("coulomb", "load"),
        "presliding",
        "presliding_distance",
        DISTANCES,
        True,
    ),
)


@dataclass(frozen=True)
class Fitted:
    """A law with its shape and the values of its parameters; `first` the law without load that its loads come from."""

    law: Law
    shape: float
    values: Mapping[str, float]
    cost: float
    first: "Fitted | None" = None
    zeros: Mapping[str, np.ndarray] = field(default_factory=dict)  # rad, by run, to add to both angles (2,)

    @property
    def model(self) -> LinearModel:
        return model_of(self.law, self.shape)


def model_of(law: Law, shape: float) -> LinearModel:
    """The regression of a law; the presliding distance is in the signals that it reads."""
    return law_model(law.parts, law.sign, **({} if law.sign == "presliding" else {law.shape: shape}))
