"""What voltage and speed tell of a DC motor: the coefficients of one differential equation of the speed.

Without the current the two equations of `dc_motor` join to

    Lm Jm/Kt w'' + (Rm Jm + Lm Cm)/Kt w' + (Rm Cm + Kt Kb)/Kt w + Rm Tf/Kt sgn(w) = V,

in which Lm Tf/Kt d/dt sgn(w) is left out, an impulse of microvolt seconds in small motors.
"""

from collections.abc import Mapping
from typing import Any

LAW = ("c0", "c1", "c2", "f")
LABELS = ("(Rm Cm + Kt Kb)/Kt", "(Rm Jm + Lm Cm)/Kt", "Lm Jm/Kt", "Rm Tf/Kt")
UNITS = ("V*s/rad", "V*s^2/rad", "V*s^3/rad", "V")
SENTENCES = (
    "voltage for a steady speed",
    "voltage for an acceleration",
    "voltage for its change",
    "voltage for Coulomb friction",
)
EQUATIONS = "w' = a\na' = (V - c0*w - c1*a - f*smooth_sign(w, edge))/c2"
EDGE = "0.1 rad/s"  # width over which Coulomb friction changes sign


def speed_law(p: Mapping[str, Any]) -> list[Any]:
    """c0, c1, c2, f of motor constants by the names of `dc_motor` (SI units), Kt taken as Kb where it is not given."""
    kt = p.get("Kt", p["Kb"])
    return [
        (p["Rm"] * p["Cm"] + kt * p["Kb"]) / kt,
        (p["Rm"] * p["Jm"] + p["Lm"] * p["Cm"]) / kt,
        p["Lm"] * p["Jm"] / kt,
        p["Rm"] * p["Tf"] / kt,
    ]
