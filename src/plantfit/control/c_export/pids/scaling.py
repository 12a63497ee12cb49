"""Coefficients of a PID as whole numbers with a shift, and how far its command can then be off.

Signals are whole numbers of steps (full scale / 2^(bits - 1)), parts of the command carry FRACTION binary places more.
A coefficient, in steps of the command per step of the measurement, is mantissa / 2^places. All worst cases below are
those of signals at full scale, so that nothing can overflow 64 bits.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from plantfit.control.pid import Gains, Settings
from plantfit.errors import SimulationError

FRACTION = 16  # binary places of the parts of the command, below its step
MANTISSA = 29  # bits: products with sums of four 32-bit signals fit 62
UNIT = 30  # binary places of coefficients from 0 to 1
LARGEST = 2.0**61  # of a part of the command: three of them add up within 64 bits


@dataclass(frozen=True)
class Coefficient:
    """Whole numbers near the given ones times 2^places; a product is shifted by `shift` to have FRACTION places."""

    mantissas: tuple[int, ...]
    places: int

    @property
    def shift(self) -> int:
        return self.places - FRACTION

    @property
    def error(self) -> float:
        """The most by which rounding changes one of them."""
        return 0.5 * 2.0**-self.places if any(self.mantissas) else 0.0


@dataclass(frozen=True)
class Scaling:
    """A PID in whole numbers: `steps` of measurement and command in their units, limits in steps, worst error in
    steps."""

    bits: int
    steps: tuple[float, float]
    proportional: Coefficient  # of reference and measurement
    integral: Coefficient  # of the sum of two errors
    derivative: Coefficient  # of changes of reference and measurement
    kept: int  # of the derivative from sample to sample, in 2^-UNIT
    follow: int  # in 2^-UNIT
    limits: tuple[float, float]
    bound: float
    integral_bound: float  # the error bound holds for integral parts up to this, in steps

    @property
    def raw_limits(self) -> tuple[int, int]:
        """The whole numbers of steps within the limits."""
        return math.ceil(self.limits[0] - 1e-9), math.floor(self.limits[1] + 1e-9)

    @property
    def fine_limits(self) -> tuple[int, int]:
        """The limits with FRACTION places."""
        return round(self.limits[0] * 2**FRACTION), round(self.limits[1] * 2**FRACTION)


def scaled(gains: Gains, settings: Settings, bits: int, full_scale: Mapping[str, float] | None) -> Scaling:
    """The scaling for signals of `bits` bits; raises SimulationError for full scales or gains that cannot be held."""
    measurement, command = _full_scales(full_scale)
    top, largest = 2.0 ** (bits - 1), 2.0 ** (bits - 1) - 1.0
    steps = (measurement / top, command / top)
    low, high = settings.lower, settings.upper
    if (math.isfinite(low) and low < -command * (1 + 1e-9)) or (math.isfinite(high) and high > command * (1 + 1e-9)):
        raise SimulationError(
            f"The limits [{low:g}, {high:g}] are beyond the command's full scale {command:g}; give a larger full scale."
        )
    limits = (max(low / steps[1], -top), min(high / steps[1], largest))
    unit, period, time = steps[0] / steps[1], settings.period, gains.filter_time + settings.period
    p = _coefficient("Kp", (unit * gains.Kp * gains.b, unit * gains.Kp))
    i = _coefficient("Ki", (unit * 0.5 * period * gains.Ki,))
    d = _coefficient("Kd", (unit * gains.Kd * gains.c / time, unit * gains.Kd / time))
    kept, follow = round(gains.filter_time / time * 2**UNIT), round(settings.follow * 2**UNIT)
    if kept == 2**UNIT or (settings.follow and not follow):
        raise SimulationError(
            "The filter or tracking time is beyond 1e9 periods; give a shorter one, or export floating point."
        )
    worst_p, worst_d = (sum(map(abs, c.mantissas)) * 2.0**-c.places * top for c in (p, d))
    worst_d *= 2.0  # the filter's answer to any measurement within full scale
    added = abs(i.mantissas[0]) * 2.0**-i.places * 4.0 * top
    integral = max(map(abs, limits)) + worst_p + worst_d + (added * 2**UNIT / follow if follow else 0.0)
    if max(worst_p, worst_d, integral) * 2.0**FRACTION > 0.9 * LARGEST:
        raise SimulationError(
            f"The gains drive parts of the command up to {integral / top:.3g} times its full scale at full-scale "
            f"signals, beyond what {bits} bits are scaled for; give larger full scales, or export floating point."
        )
    place, rest = 2.0**-FRACTION, 1.0 - kept * 2.0**-UNIT
    error_p = 2.0 * p.error * top + place
    error_d = 4.0 * d.error * top + (2.0 * place + 0.5 * 2.0**-UNIT * worst_d) / rest
    error_i = place + (0.5 / abs(i.mantissas[0]) * integral if i.mantissas[0] else 0.0)
    # the integral begins at the command at rest less a proportional part: an error_p more
    if follow:
        share, excess = follow * 2.0**-UNIT, integral + worst_p + worst_d
        error_i = (2.0 * error_i + place + 0.5 * 2.0**-UNIT * excess) / share + error_p + error_d
    bound = 1.0 + 2.0 * error_p + error_d + error_i + 1e-15 * integral * (settings.anti_windup != "none")
    return Scaling(bits, steps, p, i, d, kept, follow, limits, bound, integral)


def _full_scales(given: Mapping[str, float] | None) -> tuple[float, float]:
    if given is None or set(given) != {"measurement", "command"}:
        raise SimulationError(
            f"full_scale = {given!r}; fixed point needs the largest magnitudes "
            f"as {{'measurement': .., 'command': ..}} in their units."
        )
    for name, value in given.items():
        if not (math.isfinite(value) and value > 0):
            raise SimulationError(f"The full scale of the {name} is {value}; give its largest magnitude, above 0.")
    return float(given["measurement"]), float(given["command"])


def _coefficient(name: str, values: tuple[float, ...]) -> Coefficient:
    largest = max(map(abs, values))
    if not math.isfinite(largest) or largest > 2.0 ** (MANTISSA - FRACTION):
        raise SimulationError(
            f"{name} moves the command by {largest:.3g} of its steps for one step of the measurement, more than "
            f"{2 ** (MANTISSA - FRACTION)}; give a larger full scale of the command, or export floating point."
        )
    places = MANTISSA - math.frexp(largest)[1] if largest else FRACTION
    places = min(max(places, FRACTION), FRACTION + 61)
    mantissas = tuple(round(value * 2.0**places) for value in values)
    if largest and not any(mantissas):
        raise SimulationError(
            f"{name} is too small for fixed point ({largest:.3g} steps per step); give 0, or export floating point."
        )
    return Coefficient(mantissas, places)
