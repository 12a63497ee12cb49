"""First and second order processes with dead time."""

from collections.abc import Iterator
from typing import Literal

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.errors import ModelError
from plantfit.models.model import Declared, Delay, Model, Named
from plantfit.models.remade import remade
from plantfit.units import quotient

Initial = Literal["measured", "free"]

_DELAYED = "u_delayed"
_SOURCE = "Seborg, Edgar, Mellichamp, Doyle, Process Dynamics and Control, chapters 5 and 6"


@remade
def first_order(
    dead_time: bool = True,
    offset: bool = True,
    initial: Initial = "measured",
    input_unit: str | None = None,
    output_unit: str | None = None,
) -> Model:
    """First order process with dead time.

        tau y' = K u(t - L) + c - y

    Input u, output y in the units given (None: unknown). K (unit of y per unit of u): gain; tau
    (s): time constant; L (s): dead time, 0 without `dead_time`; c (unit of y): value of y at
    u = 0, 0 without `offset`. `initial` "measured" starts at the first measured y; "free" at the
    parameter y0, which a study with several recordings should make per-recording.

    Source: Seborg, Edgar, Mellichamp, Doyle, Process Dynamics and Control, section 5.2 and 6.2.
    """
    _check_initial("first_order", initial)
    channel = _DELAYED if dead_time else "u"

    def derivative(x: Named, u: Named, p: Named) -> Named:
        return {"y": (_target(u[channel], p, offset) - x["y"]) / p["tau"]}

    def output(x: Named, u: Named, p: Named) -> Named:
        return {"y": x["y"]}

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        return {"y": p["y0"] if initial == "free" else y0["y"]}

    return Model(
        name="first_order",
        states={"y": output_unit},
        inputs={"u": input_unit},
        outputs={"y": output_unit},
        parameters=_parameters(("tau",), dead_time, offset, initial, input_unit, output_unit),
        output=output,
        derivative=derivative,
        initial_state=initial_state,
        delays=(Delay(_DELAYED, "u", "L"),) if dead_time else (),
        sentence="First order process" + (" with dead time." if dead_time else "."),
        source=_SOURCE,
    )


@remade
def second_order(
    dead_time: bool = True,
    offset: bool = True,
    initial: Initial = "measured",
    input_unit: str | None = None,
    output_unit: str | None = None,
) -> Model:
    """Two first order processes in series with dead time.

        tau1 z' = K u(t - L) + c - z
        tau2 y' = z - y

    Symbols as in `first_order`; z (unit of y) is inside and starts where y starts, at rest. The
    output does not change when tau1 and tau2 change places, so that an answer may name them
    either way round.

    Source: Seborg, Edgar, Mellichamp, Doyle, Process Dynamics and Control, section 5.4.
    """
    _check_initial("second_order", initial)
    channel = _DELAYED if dead_time else "u"

    def derivative(x: Named, u: Named, p: Named) -> Named:
        return {"z": (_target(u[channel], p, offset) - x["z"]) / p["tau1"], "y": (x["z"] - x["y"]) / p["tau2"]}

    def output(x: Named, u: Named, p: Named) -> Named:
        return {"y": x["y"]}

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        start = p["y0"] if initial == "free" else y0["y"]
        return {"z": start, "y": start}

    return Model(
        name="second_order",
        states={"z": output_unit, "y": output_unit},
        inputs={"u": input_unit},
        outputs={"y": output_unit},
        parameters=_parameters(("tau1", "tau2"), dead_time, offset, initial, input_unit, output_unit),
        output=output,
        derivative=derivative,
        initial_state=initial_state,
        delays=(Delay(_DELAYED, "u", "L"),) if dead_time else (),
        sentence="Second order process" + (" with dead time." if dead_time else "."),
        source=_SOURCE,
    )


def _target(u, p: Named, offset: bool):
    """Where y goes when u stays."""
    return p["K"] * u + p["c"] if offset else p["K"] * u


def _check_initial(name: str, initial: str) -> None:
    if initial not in ("measured", "free"):
        raise ModelError(f"Model {name!r}: initial is {initial!r}; use 'measured' or 'free'.")


def _parameters(
    time_constants: tuple[str, ...],
    dead_time: bool,
    offset: bool,
    initial: str,
    input_unit: str | None,
    output_unit: str | None,
) -> tuple[Declared, ...]:
    gain = Declared(
        "K", gain_unit(input_unit, output_unit), (-100.0, 100.0), sentence="gain: change of y per change of u, at rest"
    )
    slow = (Declared(tau, "s", (0.1, 1e4), "log", sentence="time constant") for tau in time_constants)
    return gain, *slow, *optional_parameters(dead_time, offset, initial, output_unit)


def gain_unit(input_unit: str | None, output_unit: str | None) -> str | None:
    """Unit of y per unit of u; None when one of them is not known."""
    return None if input_unit is None or output_unit is None else quotient(output_unit, input_unit)


def optional_parameters(dead_time: bool, offset: bool, initial: str, output_unit: str | None) -> Iterator[Declared]:
    """L (s), c and y0 (unit of y), as far as they are asked for."""
    if dead_time:
        yield Declared("L", "s", (0.0, 100.0), sentence="dead time")
    if offset:
        yield Declared("c", output_unit, (-1e3, 1e3), sentence="value of y at u = 0")
    if initial == "free":
        yield Declared("y0", output_unit, (-1e3, 1e3), sentence="value of y at the first sample")
