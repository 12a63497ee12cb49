"""First order process whose gain and time constant change with the operating point."""

from typing import Any, Literal

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.errors import ModelError
from plantfit.models.library.process import gain_unit, optional_parameters
from plantfit.models.model import Declared, Delay, Model, Named
from plantfit.models.parts.tables import Table
from plantfit.models.remade import remade
from plantfit.models.text.table_text import read_nodes

_DELAYED = "u_delayed"
_NODES = {"from": 0, "to": 100, "count": 6}


@remade
def tabled_first_order(
    over: Literal["u", "y"] = "u",
    nodes: Any = None,
    dead_time: bool = True,
    offset: bool = True,
    initial: Literal["measured", "free"] = "measured",
    input_unit: str | None = None,
    output_unit: str | None = None,
) -> Model:
    """First order process with tables over an operating point s, and dead time.

        tau(s) y' = K(s) u(t - L) + c - y,   s = u(t - L) or y

    `over` says what s is. K (unit of y per unit of u) and tau (s) are linear between `nodes` of s, 0 to
    100 at 6 points unless given (a list or {"from", "to", "count"}), and constant outside. L (s): dead
    time, 0 without `dead_time`; c (unit of y): value of y at u = 0, 0 without `offset`. `initial`
    "measured" starts at the first measured y; "free" at the parameter y0.

    Source: Seborg, Edgar, Mellichamp, Doyle, Process Dynamics and Control, sections 5.2 and 6.2;
    scheduled coefficients: Rugh, Shamma, Automatica 36 (2000) 1401-1425.
    """
    for what, value, known in (("over", over, ("u", "y")), ("initial", initial, ("measured", "free"))):
        if value not in known:
            raise ModelError(f"Model 'tabled_first_order': {what} is {value!r}; use {known[0]!r} or {known[1]!r}.")
    channel = _DELAYED if dead_time else "u"
    axis = read_nodes("Model 'tabled_first_order': nodes", _NODES if nodes is None else nodes)
    gain, time_constant = (
        Table("K", (over,), (axis,), gain_unit(input_unit, output_unit)),
        Table("tau", (over,), (axis,), "s"),
    )

    def derivative(x: Named, u: Named, p: Named) -> Named:
        at = x["y"] if over == "y" else u[channel]
        target = gain(p["K"], at) * u[channel] + (p["c"] if offset else 0.0)
        return {"y": (target - x["y"]) / time_constant(p["tau"], at)}

    def output(x: Named, u: Named, p: Named) -> Named:
        return {"y": x["y"]}

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        return {"y": p["y0"] if initial == "free" else y0["y"]}

    parameters = (
        Declared("K", gain.unit, (-100.0, 100.0), sentence=f"gain over {over}", shape=gain.shape),
        Declared("tau", "s", (0.1, 1e4), "log", sentence=f"time constant over {over}", shape=time_constant.shape),
        *optional_parameters(dead_time, offset, initial, output_unit),
    )
    return Model(
        name="tabled_first_order",
        states={"y": output_unit},
        inputs={"u": input_unit},
        outputs={"y": output_unit},
        parameters=parameters,
        output=output,
        derivative=derivative,
        initial_state=initial_state,
        delays=(Delay(_DELAYED, "u", "L"),) if dead_time else (),
        tables=(gain, time_constant),
        sentence="First order process, gain and time constant tables over an operating point"
        + (", dead time." if dead_time else "."),
        source="Rugh, Shamma, Research on gain scheduling, Automatica 36 (2000) 1401-1425",
    )
