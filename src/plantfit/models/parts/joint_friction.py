"""Friction of a joint as terms that are linear in their coefficients, for regression and simulation alike.

    tau = Fv omega + Fc s(omega) + Fs s(omega) exp(-(omega/vs)^2) + mu |load| s(omega) + offset         (1)

Fv viscous, Fc Coulomb, Fs what the breakaway torque has above Coulomb's (Stribeck), mu load-dependent (dimensionless;
the load is the torque through the joint's gear). s is the sign, smoothed: tanh(omega/width), or 2/pi atan(omega/width);
or the presliding state of Dahl over a distance d (rad), which keeps a joint at rest where it is:

    s' = (omega - |omega| s)/d                                                                         (2)

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083-1138; load-dependent part: Hamon, Gautier,
Garrec, Dynamic identification of robots with a dry friction model depending on load and velocity, IROS 2010, eq. (5);
(2): Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, 1968.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.errors import ModelError
from plantfit.models.model import Declared
from plantfit.models.text.suggest import suggest

# isort: split
import jax.numpy as jnp

Sign = Literal["tanh", "atan", "presliding"]

_KINDS = {
    "viscous": ("Fv", "N*m*s/rad", (0.0, 0.1), "viscous friction"),
    "coulomb": ("Fc", "N*m", (0.0, 0.5), "Coulomb friction"),
    "stribeck": ("Fs", "N*m", (0.0, 0.5), "breakaway torque above Coulomb friction"),
    "load": ("mu", "", (0.0, 0.5), "friction per torque through the gear"),
    "offset": ("offset", "N*m", (-0.5, 0.5), "constant torque"),
}


@dataclass(frozen=True)
class JointFriction:
    """Which parts of eq. (1) act on a joint; `width` and `stribeck_velocity` (vs) in rad/s, `presliding_distance` (d)
    in rad.

    Raises ModelError for parts that are not known and widths that are not positive.
    """

    parts: tuple[str, ...] = ()
    width: float = 0.01
    stribeck_velocity: float = 0.1
    sign: Sign = "tanh"
    presliding_distance: float = 0.001

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", _parts(self.parts))
        for what, value in (("sign_width", self.width), ("stribeck_velocity", self.stribeck_velocity)):
            if not value > 0:
                raise ModelError(f"{what} = {value}; give a velocity above 0 in rad/s.")
        if not self.presliding_distance > 0:
            raise ModelError(f"presliding_distance = {self.presliding_distance}; give an angle above 0 in rad.")
        if self.sign not in get_args(Sign):
            raise ModelError(f"sign = {self.sign!r}; use one of {', '.join(get_args(Sign))}.")

    def declared(self, joint: int) -> tuple[Declared, ...]:
        """The coefficients of a joint: Fv1, Fc1, Fs1, mu1, offset1."""
        return tuple(
            Declared(f"{name}{joint}", unit, bounds, sentence=f"{sentence} of joint {joint}")
            for name, unit, bounds, sentence in map(_KINDS.__getitem__, self.parts)
        )

    @property
    def has_state(self) -> bool:
        """Whether the sign is a state of its own, eq. (2)."""
        return self.sign == "presliding" and bool({"coulomb", "stribeck", "load"} & set(self.parts))

    def sliding_rate(self, omega: Any, slide: Any) -> Any:
        """Eq. (2)."""
        return (omega - jnp.abs(omega) * slide) / self.presliding_distance

    def columns(self, omega: Any, load: Any, slide: Any = None) -> list[Any]:
        """The torque per unit of every coefficient, in the order of `declared`.

        `load` (N m) is read where "load" is a part, `slide` (the state of eq. 2) where the sign is "presliding".
        """
        if self.sign == "presliding":
            sign = slide if self.has_state else jnp.zeros_like(omega)
        else:
            sign = jnp.tanh(omega / self.width) if self.sign == "tanh" else 2 / jnp.pi * jnp.arctan(omega / self.width)
        made = {
            "viscous": lambda: omega,
            "coulomb": lambda: sign,
            "stribeck": lambda: sign * jnp.exp(-((omega / self.stribeck_velocity) ** 2)),
            "load": lambda: jnp.abs(load) * sign,
            "offset": lambda: jnp.ones_like(omega),
        }
        return [made[part]() for part in self.parts]


def _parts(given: str | Sequence[str]) -> tuple[str, ...]:
    parts = (given,) if isinstance(given, str) else tuple(given)
    for k, part in enumerate(parts):
        if part not in _KINDS:
            raise ModelError(
                f"friction has the part {part!r}.{suggest(str(part), _KINDS)} Known are {', '.join(_KINDS)}."
            )
        if part in parts[:k]:
            raise ModelError(f"friction names {part!r} twice; name each part once.")
    return parts
