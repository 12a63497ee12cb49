"""Friction of a joint as terms that are linear in their coefficients, for regression and simulation alike.

    tau = Fv omega + Fc s(omega) + Fs s(omega) exp(-(omega/vs)^2) + mu |load| s(omega) + offset         (1)

Fv viscous, Fc Coulomb, Fs what the breakaway torque has above Coulomb's (Stribeck), mu load-dependent (dimensionless; the load
is the torque through the joint's gear). s is the sign, smoothed: tanh(omega/width), or 2/pi atan(omega/width).

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083-1138; load-dependent part: Hamon, Gautier,
Garrec, Dynamic identification of robots with a dry friction model depending on load and velocity, IROS 2010, eq. (5).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.errors import ModelError
from plantfit.models.model import Declared
from plantfit.models.suggest import suggest

# isort: split
import jax.numpy as jnp

Sign = Literal["tanh", "atan"]

_KINDS = {
    "viscous": ("Fv", "N*m*s/rad", (0.0, 0.1), "viscous friction"),
    "coulomb": ("Fc", "N*m", (0.0, 0.5), "Coulomb friction"),
    "stribeck": ("Fs", "N*m", (0.0, 0.5), "breakaway torque above Coulomb friction"),
    "load": ("mu", "", (0.0, 0.5), "friction per torque through the gear"),
    "offset": ("offset", "N*m", (-0.5, 0.5), "constant torque"),
}


@dataclass(frozen=True)
class JointFriction:
    """Which parts of eq. (1) act on a joint; `width` and `stribeck_velocity` (vs) in rad/s.

    Raises ModelError for parts that are not known and widths that are not positive.
    """

    parts: tuple[str, ...] = ()
    width: float = 0.01
    stribeck_velocity: float = 0.1
    sign: Sign = "tanh"

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", _parts(self.parts))
        for what, value in (("sign_width", self.width), ("stribeck_velocity", self.stribeck_velocity)):
            if not value > 0:
                raise ModelError(f"{what} = {value}; give a velocity above 0 in rad/s.")
        if self.sign not in get_args(Sign):
            raise ModelError(f"sign = {self.sign!r}; use one of {', '.join(get_args(Sign))}.")

    def declared(self, joint: int) -> tuple[Declared, ...]:
        """The coefficients of a joint: Fv1, Fc1, Fs1, mu1, offset1."""
        return tuple(
            Declared(f"{name}{joint}", unit, bounds, sentence=f"{sentence} of joint {joint}")
            for name, unit, bounds, sentence in map(_KINDS.__getitem__, self.parts)
        )

    def columns(self, omega: Any, load: Any) -> list[Any]:
        """The torque per unit of every coefficient, in the order of `declared`; `load` (N m) is read where "load" is a part."""
        sign = jnp.tanh(omega / self.width) if self.sign == "tanh" else 2 / jnp.pi * jnp.arctan(omega / self.width)
        made = {
            "viscous": lambda: omega,
            "coulomb": lambda: sign,
            "stribeck": lambda: sign * jnp.exp(-((omega / self.stribeck_velocity) ** 2)),
            "load": lambda: jnp.abs(load) * sign,
            "offset": lambda: jnp.ones_like(sign),
        }
        return [made[part]() for part in self.parts]


def _parts(given: str | Sequence[str]) -> tuple[str, ...]:
    parts = (given,) if isinstance(given, str) else tuple(given)
    for k, part in enumerate(parts):
        if part not in _KINDS:
            raise ModelError(f"friction has the part {part!r}.{suggest(str(part), _KINDS)} Known are {', '.join(_KINDS)}.")
        if part in parts[:k]:
            raise ModelError(f"friction names {part!r} twice; name each part once.")
    return parts
