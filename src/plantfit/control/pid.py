"""A discrete PID controller in parallel form."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit import units
from plantfit.errors import SimulationError
from plantfit.simulate.loop.closed_loop import Controller

import jax.numpy as jnp

ANTI_WINDUP = ("clamping", "back-calculation", "none")


class Gains(NamedTuple):
    """Parameters of `pid`, each a scalar: e = r - y is in the unit of the output, the command c in its own.

    Kp in c/e, Ki in c/(e s), Kd in c s/e; set-point weights b (proportional part) and c (derivative
    part; 0 spares the actuator a kick at steps of the reference); `filter_time` (s) of the derivative.
    """

    Kp: Any
    Ki: Any = 0.0
    Kd: Any = 0.0
    b: Any = 1.0
    c: Any = 1.0
    filter_time: Any = 0.0


def gain_units(output: str | None, input: str | None) -> dict[str, str]:
    """Units of Kp, Ki and Kd as texts, such as V/(rad/s), for the units of an output and an input; where one of them
    is not known those of dimensionless signals."""
    y, u = ("1", "1") if output is None or input is None or output == input else (output, input)
    whole = y.removesuffix("/s")
    if whole != y:  # a rate: V/(rad/s), V/rad, V/(rad/s^2)
        return {"Kp": units.quotient(u, y), "Ki": units.quotient(u, whole), "Kd": units.quotient(u, f"{y}^2")}
    times = "s" if u.strip() in units.DIMENSIONLESS else f"({u})*s" if "/" in u else f"{u}*s"
    return {"Kp": units.quotient(u, y), "Ki": units.per_second(units.quotient(u, y)), "Kd": units.quotient(times, y)}


class Settings(NamedTuple):
    """What a `pid` is apart from its gains: arguments of that function, checked by `checked`."""

    period: float
    lower: float
    upper: float
    anti_windup: str
    tracking_time: float | None

    @property
    def follow(self) -> float:
        """Share of the excess that back-calculation takes off the integral in a sample, else 0."""
        return self.period / self.tracking_time if self.tracking_time is not None else 0.0


class PidState(NamedTuple):
    """Integral part, filtered derivative part (both in command units), last error and last c r - y."""

    integral: Any
    derivative: Any
    error: Any
    weighted: Any

    def at_rest(self, measurement: Any, command: Any, gains: Gains) -> "PidState":
        """This state with the integral part at which `command` is given while the reference is the measurement."""
        return self._replace(integral=command - gains.Kp * (gains.b - 1.0) * measurement)


def pid(
    period: float,
    *,
    lower: float = -math.inf,
    upper: float = math.inf,
    anti_windup: str = "clamping",
    tracking_time: float | None = None,
) -> Controller:
    """A PID controller sampled every `period` seconds, its command limited to [lower, upper]; its parameters are
    `Gains`.

        P = Kp (b r - y)
        I += Ki period (e + e_last) / 2                                            (Tustin)
        D = (filter_time D + Kd ((c r - y) - (c r - y)_last)) / (filter_time + period)   (backward difference)

    anti_windup "clamping": the integral rests while the command is beyond a limit and the error drives it
    further; "back-calculation": I += period / tracking_time (limited command - command), with tracking_time
    in seconds (at least `period`); "none". Integral and derivative part begin at 0, with reference and measurement
    equal before: the first command is Kp (b r - y). `PidState.at_rest` begins at a command that holds the plant, as the
    exported C does.

    Source: Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., section 8.5 (derivative: eq. 8.26,
    anti-windup: section 8.5); Astrom, Hagglund, Advanced PID Control, section 3.5 (conditional integration).
    Raises SimulationError for a period, limits or anti-windup that cannot work.
    """
    follow = checked(Settings(period, lower, upper, anti_windup, tracking_time)).follow
    init, law = pid_law(period, anti_windup)

    def update(state, measurement, reference, gains):
        return law(state, measurement, reference, gains, lower, upper, follow)

    return Controller(init, update)


def pid_law(period: float, anti_windup: str) -> tuple[Callable[..., PidState], Callable[..., tuple[PidState, Any]]]:
    """`pid` with limits and follow (share of the excess that back-calculation takes off) as further arguments:
    init(measurement, gains), update(state, measurement, reference, gains, lower, upper, follow)."""

    def init(measurement, gains):
        zero = jnp.zeros_like(measurement)
        return PidState(zero, zero, zero, (gains.c - 1.0) * measurement)

    def update(state, measurement, reference, gains, lower, upper, follow):
        error, weighted = reference - measurement, gains.c * reference - measurement
        added = (0.5 * period) * gains.Ki * (error + state.error)
        change = gains.Kd * (weighted - state.weighted)
        derivative = (gains.filter_time * state.derivative + change) * (1.0 / (gains.filter_time + period))
        integral = state.integral + added
        wanted = gains.Kp * (gains.b * reference - measurement) + integral + derivative
        command = jnp.clip(wanted, lower, upper)
        if anti_windup == "clamping":
            further = ((wanted > upper) & (added > 0)) | ((wanted < lower) & (added < 0))
            integral = jnp.where(further, state.integral, integral)
        elif anti_windup == "back-calculation":
            integral = integral + follow * (command - wanted)
        return PidState(integral, derivative, error, weighted), command

    return init, update


def checked(settings: Settings) -> Settings:
    """The settings themselves; raises SimulationError as `pid`."""
    period, lower, upper, anti_windup, tracking_time = settings
    if not (math.isfinite(period) and period > 0):
        raise SimulationError(f"The PID's period is {period}; give seconds above 0.")
    if not lower < upper:
        raise SimulationError(f"The PID's limits are [{lower:g}, {upper:g}]; give lower below upper.")
    if anti_windup not in ANTI_WINDUP:
        raise SimulationError(f"anti_windup = {anti_windup!r} is unknown; use one of {list(ANTI_WINDUP)}.")
    if (tracking_time is not None) != (anti_windup == "back-calculation"):
        raise SimulationError("tracking_time belongs to anti_windup = 'back-calculation'; give both or neither.")
    if tracking_time is not None and not (math.isfinite(tracking_time) and tracking_time >= period):
        raise SimulationError(f"tracking_time = {tracking_time}; give seconds, at least one period ({period:g} s).")
    return settings
