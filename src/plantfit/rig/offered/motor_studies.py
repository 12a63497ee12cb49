"""Study files for records of a DC motor: with a current channel its constants, without one the combinations that
speed determines."""

import math
from collections.abc import Mapping
from json import dumps

# where `models.dc_motor` looks
BOUNDS = {
    "Rm": (0.1, 100.0), "Lm": (1e-5, 0.1), "Kb": (1e-3, 1.0), "Kt": (1e-3, 1.0), "Jm": (1e-8, 1e-2), "Cm": (1e-8, 1e-2),
    "Tf": (1e-6, 1.0),
}  # fmt: skip
UNITS = {"Rm": "ohm", "Lm": "H", "Kb": "V*s/rad", "Kt": "N*m/A", "Jm": "kg*m^2", "Cm": "N*m*s/rad", "Tf": "N*m"}
MOTOR = {
    "Rm": "winding resistance", "Lm": "winding inductance", "Kb": "back-EMF constant", "Kt": "torque constant",
    "Jm": "inertia of rotor and load", "Cm": "viscous friction", "Tf": "Coulomb friction",
}  # fmt: skip


def box(low: float, high: float, value: float) -> list[float]:
    """Bounds low to high, widened by whole decades where `value` lies outside or within a factor of 2 of an end."""
    while value > 0 and value < 2.0 * low:
        low = 10.0 ** (math.floor(math.log10(low)) - 1)
    while value > 0.5 * high:
        high = 10.0 ** (math.ceil(math.log10(high)) + 1)
    return [float(f"{low:.6g}"), float(f"{high:.6g}")]


def parameter(name: str, bounds: list[float], unit: str, sentence: str, log: bool = True) -> str:
    """One [parameters.NAME]."""
    scale = 'scale = "log"\n' if log else ""
    return f'[parameters.{name}]\nbounds = {bounds}\nunit = "{unit}"\n{scale}sentence = "{sentence}"\n'


def parameters_of(names: tuple[str, ...], truth: Mapping[str, float]) -> str:
    """The tables of motor constants; `truth` only widens bounds that do not hold it."""
    return "\n".join(parameter(n, box(*BOUNDS[n], truth[n]), UNITS[n], MOTOR[n]) for n in names)


def head(name: str, told: str) -> str:
    """How a study file begins; `told` are comment lines."""
    lines = "".join(f"# {line}\n" for line in told.splitlines())
    return f"{lines}# Run it with:  plantfit run {name}.toml\nname = {dumps(name, ensure_ascii=False)}\n"
