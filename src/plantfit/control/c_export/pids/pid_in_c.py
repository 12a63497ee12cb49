"""A PID as C."""

import math
import os
from collections.abc import Mapping

from plantfit.control.c_export.files import CFiles, checked_finite, checked_name, checked_number, write_c
from plantfit.control.c_export.pids.fixed_pid import BITS, fixed_pid
from plantfit.control.c_export.pids.floating_pid import floating_pid
from plantfit.control.pid import Gains, Settings, checked, gain_units
from plantfit.errors import SimulationError


def pid_to_c(
    gains: Gains,
    folder: str | os.PathLike[str],
    *,
    period: float,
    lower: float = -math.inf,
    upper: float = math.inf,
    anti_windup: str = "clamping",
    tracking_time: float | None = None,
    name: str = "pid",
    number: str = "double",
    full_scale: Mapping[str, float] | None = None,
    units: Mapping[str, str] | None = None,
    note: str = "",
) -> CFiles:
    """Write the `pid` of these gains and settings as C99, NAME.h and NAME.c: struct NAME, NAME_init and NAME_update.

    `number`: "double", "float", or fixed point "q15", "q31" with 16- or 32-bit signals, which needs `full_scale`,
    {"measurement": .., "command": ..}: a signal is the whole number of its full scale / 2^15 or 2^31. The header states
    how far the fixed-point command can be from that of `pid` on the same signals. `units` by the same names and `note`
    go into its comment.

    No memory is allocated, no library called. Raises SimulationError for what `pid` refuses, and for numbers that do
    not fit.
    """
    checked_name(name)
    checked_number(number, ("double", "float", *BITS))
    settings = checked(Settings(float(period), float(lower), float(upper), anti_windup, tracking_time))
    plain = Gains(*(float(value) for value in gains))
    checked_finite(plain._asdict(), "double")
    if plain.filter_time < 0:
        raise SimulationError(f"filter_time = {plain.filter_time:g}; give seconds of at least 0.")
    if number not in BITS and full_scale is not None:
        raise SimulationError(
            f"full_scale belongs to fixed point; leave it out, or give number = 'q15' or 'q31' in place of {number!r}."
        )
    told = [*_story(plain, settings, units or {}), *note.splitlines()]
    if number not in BITS:
        declared, defined = floating_pid(name, plain, settings, number)
        return write_c(folder, name, told, declared, defined)
    declared, defined, scaling = fixed_pid(name, plain, settings, number, full_scale)
    low, high = scaling.raw_limits
    told += [
        f"Fixed point: signals of {scaling.bits} bits, the command limited to {low} .. {high} steps.",
        f"The command is within {scaling.bound:.4g} steps of the exact PID's on the same signals"
        + (f", while its integral is within {scaling.integral_bound:.4g} steps." if anti_windup == "none" else "."),
    ]
    if anti_windup == "clamping":
        told.append(
            "Where the exact command is that near to a limit, one "
            "sample's part of the integral may be kept or left otherwise."
        )
    return write_c(folder, name, told, declared, defined, includes="#include <stdint.h>\n\n")


def _story(gains: Gains, settings: Settings, units: Mapping[str, str]) -> list[str]:
    unknown = sorted(set(units) - {"measurement", "command"})
    if unknown:
        raise SimulationError(f"units names {unknown[0]!r}; it may name 'measurement' and 'command'.")
    y, u = units.get("measurement", "its unit"), units.get("command", "its unit")
    known = gain_units(units.get("measurement"), units.get("command"))
    per = {name: "" if unit == "1" else f" {unit}" for name, unit in known.items()}
    tracked = f" within {settings.tracking_time:g} s" if settings.tracking_time is not None else ""
    return [
        f"Discrete PID every {settings.period:g} s: measurement and reference in {y}, command in {u}.",
        f"Kp {gains.Kp!r}{per['Kp']}, Ki {gains.Ki!r}{per['Ki']}, Kd {gains.Kd!r}{per['Kd']}; "
        f"set-point weights b {gains.b:g}, c {gains.c:g}; "
        f"filter of the derivative {gains.filter_time:g} s.",
        f"Command limited to [{settings.lower:g}, {settings.upper:g}], anti-windup: {settings.anti_windup}{tracked}.",
    ]
