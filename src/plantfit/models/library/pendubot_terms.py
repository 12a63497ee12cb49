"""What the simulation model and the regression of the pendubot share: parameters, options, and the term of every
coefficient."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.errors import ModelError
from plantfit.models.library.double_pendulum import Link, Motion, Term, base_of, rigid_terms, rotor_term
from plantfit.models.model import Declared, Named
from plantfit.models.parts.joint_friction import JointFriction

# isort: split
import jax.numpy as jnp

Parameters = Literal["physical", "base"]
Angles = Literal["horizontal", "hanging"]

BASE_UNITS = {"b1": "kg*m^2", "b2": "kg*m^2", "b4": "kg*m", "b5": "kg*m"}

_PHYSICAL = (
    Declared("m1", "kg", (0.001, 0.4), sentence="mass of link 1"),
    Declared("m2", "kg", (0.001, 0.4), sentence="mass of link 2"),
    Declared("lc1", "m", (0.001, 0.15), sentence="joint 1 to the centre of mass of link 1", limits=(0.0, 0.15)),
    Declared("lc2", "m", (0.001, 0.3), sentence="joint 2 to the centre of mass of link 2", limits=(0.0, 0.3)),
    Declared("I1", "kg*m^2", (1e-4, 1e-3), sentence="inertia of link 1 about its centre of mass"),
    Declared("I2", "kg*m^2", (1e-4, 1e-3), sentence="inertia of link 2 about its centre of mass"),
)
_BASE_SENTENCES = {
    "b1": "m1 lc1^2 + m2 l1^2 + I1",
    "b2": "m2 lc2^2 + I2",
    "b4": "m1 lc1 + m2 l1",
    "b5": "m2 lc2",
}
_ROTOR = Declared("Ir", "kg*m^2", (0.0, 1e-3), sentence="inertia of a rotor, before its gear")
_OFFSETS = {"horizontal": 0.0, "hanging": -jnp.pi / 2}


def base_values(p: Named, l1: float = 0.15) -> dict[str, Any]:
    """b1, b2 (kg m^2), b4, b5 (kg m) of physical parameters m1, m2, lc1, lc2, I1, I2; jax-traceable."""
    return base_of(Link(p["m1"], p["lc1"], p["I1"]), Link(p["m2"], p["lc2"], p["I2"]), l1)


@dataclass(frozen=True)
class Arm:
    """What `pendubot` and `pendubot_regression` share: the options, and the terms of every coefficient."""

    parameters: Parameters
    angles: Angles
    friction: Mapping[int, JointFriction]  # of the joints whose friction shows
    gear_ratio: float | None
    motors: tuple[int, ...]
    l1: float
    g: float
    declared: tuple[Declared, ...] = field(init=False)  # links, rotor, friction

    def __post_init__(self) -> None:
        check_choice("parameters", self.parameters, Parameters)
        check_choice("angles", self.angles, Angles)
        for what, value in (
            ("l1", self.l1),
            ("g", self.g),
            *([("gear_ratio", self.gear_ratio)] if self.gear_ratio is not None else []),
        ):
            if not value > 0:
                raise ModelError(f"Pendubot: {what} = {value}; give a number above 0.")
        links = _PHYSICAL if self.parameters == "physical" else _base_declared(self.l1)
        object.__setattr__(self, "declared", (*links, *self._beside()))

    def _beside(self) -> tuple[Declared, ...]:
        """Coefficients that are parameters themselves: rotor and friction."""
        rotor = () if self.gear_ratio is None else (_ROTOR,)
        return (*rotor, *(d for joint, friction in self.friction.items() for d in friction.declared(joint)))

    @property
    def coefficients(self) -> dict[str, str | None]:
        """Names and units of all coefficients."""
        return {**BASE_UNITS, **{d.name: d.unit for d in self._beside()}}

    def base(self, p: Named) -> dict[str, Any]:
        """Coefficients by name from named parameters."""
        links = base_values(p, self.l1) if self.parameters == "physical" else {n: p[n] for n in BASE_UNITS}
        return {**links, **{d.name: p[d.name] for d in self._beside()}}

    def terms(self, s: Named, loads: Mapping[int, Any]) -> dict[str, Term]:
        """The term of every coefficient at angles and rates by name, slide1 and slide2 too where friction has such
        states.

        `loads` are torques through joints (N m).
        """
        x = Motion(s["theta1"] + _OFFSETS[self.angles], s["theta2"], s["omega1"], s["omega2"])
        terms = rigid_terms(x, self.l1, self.g)
        if self.gear_ratio is not None:
            terms["Ir"] = rotor_term(self.gear_ratio, self.motors)
        for joint, friction in self.friction.items():
            columns = friction.columns(x.omega1 if joint == 1 else x.omega2, loads.get(joint), s.get(f"slide{joint}"))
            for d, column in zip(friction.declared(joint), columns, strict=True):
                terms[d.name] = Term(h1=column) if joint == 1 else Term(h2=column)
        return terms


def check_choice(option: str, value: Any, choices: Any) -> None:
    """Raise ModelError unless an option has one of the values of a Literal."""
    if value not in get_args(choices):
        raise ModelError(f"Pendubot: {option} = {value!r}; use one of {', '.join(map(repr, get_args(choices)))}.")


def _base_declared(l1: float) -> tuple[Declared, ...]:
    """b1, b2, b4, b5 within what the bounds of the physical parameters allow; each grows with every one of them."""
    ends = [base_values({d.name: (d.bounds or (0.0, 0.0))[k] for d in _PHYSICAL}, l1) for k in (0, 1)]
    return tuple(
        Declared(n, unit, (ends[0][n], ends[1][n]), sentence=_BASE_SENTENCES[n]) for n, unit in BASE_UNITS.items()
    )
