"""Steam-filled chamber: second order with dead time, its coefficients tables over the pressure."""

from typing import Any, Literal

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.errors import ModelError
from plantfit.models.model import Declared, Delay, Model, Named
from plantfit.models.parts.quotient import quotient
from plantfit.models.parts.tables import Table
from plantfit.models.remade import remade
from plantfit.models.text.table_text import read_nodes

# isort: split
import jax.numpy as jnp

_DELAYED = "u_delayed"
_NODES = {"from": 0, "to": 20, "count": 10}


@remade
def steam_chamber(
    nodes: Any = None,
    opening_nodes: Any = None,
    dead_time: bool = True,
    initial: Literal["zero", "measured"] = "zero",
) -> Model:
    """Pressure in a chamber behind a valve.

        x1' = x2                                                          (1)
        x2' = (k(x1) u(t - Td) - x1 - A1(x1) x2)/A2(x1)                   (2)
        y = x1                                                            (3)

    Input u (%): opening of the valve; output y (bar); k (bar/%), A1 (s) and A2 (s^2) are linear between
    `nodes` of the pressure, 0 to 20 bar at 10 points unless given (a list or {"from", "to", "count"}),
    and constant outside. Td (s): dead time, 0 without `dead_time`. With `opening_nodes` the tables are
    over the pressure and the delayed opening, bilinear, so that one set serves all openings. `initial`
    "zero" starts without pressure, at rest; "measured" at the first measured pressure, at rest.

    A study of one record for each opening makes k, A1, A2 and Td per-recording.

    Source: Metaheuristic-Based Model Optimization of a Steam-Filled Chamber (research article), eqs. (2) and (3).
    """
    if initial not in ("zero", "measured"):
        raise ModelError(f"Model 'steam_chamber': initial is {initial!r}; use 'zero' or 'measured'.")
    axes = [read_nodes("Model 'steam_chamber': nodes", _NODES if nodes is None else nodes)]
    if opening_nodes is not None:
        axes.append(read_nodes("Model 'steam_chamber': opening_nodes", opening_nodes))
    channel = _DELAYED if dead_time else "u"
    over = ("x1", channel)[: len(axes)]
    k, a1, a2 = (Table(name, over, tuple(axes), unit) for name, unit in (("k", "bar/%"), ("A1", "s"), ("A2", "s^2")))

    def derivative(x: Named, u: Named, p: Named) -> Named:
        x1, x2, opening = x["x1"], x["x2"], u[channel]
        at = (x1, opening)[: len(over)]
        return {"x1": x2, "x2": quotient(k(p["k"], *at) * opening - x1 - a1(p["A1"], *at) * x2, a2(p["A2"], *at))}

    def output(x: Named, u: Named, p: Named) -> Named:
        return {"y": x["x1"]}

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        start = jnp.asarray(y0["y"], dtype=float)
        return {"x1": start if initial == "measured" else jnp.zeros_like(start), "x2": jnp.zeros_like(start)}

    parameters = [
        Declared("k", k.unit, (0.1, 1.5), sentence="gain: pressure at rest per opening", shape=k.shape),
        Declared("A1", a1.unit, (0.1, 160.0), sentence="coefficient of the rate of pressure", shape=a1.shape),
        Declared(
            "A2", a2.unit, (0.1, 160.0), sentence="coefficient of the second derivative of pressure", shape=a2.shape
        ),
    ]
    if dead_time:
        parameters.append(Declared("Td", "s", (0.1, 1.0), sentence="dead time of the valve"))
    return Model(
        name="steam_chamber",
        states={"x1": "bar", "x2": "bar/s"},
        inputs={"u": "%"},
        outputs={"y": "bar"},
        parameters=tuple(parameters),
        output=output,
        derivative=derivative,
        initial_state=initial_state,
        delays=(Delay(_DELAYED, "u", "Td"),) if dead_time else (),
        tables=(k, a1, a2),
        sentence="Steam-filled chamber: second order with tables over the pressure"
        + (" and dead time." if dead_time else "."),
        source="Metaheuristic-Based Model Optimization of a Steam-Filled Chamber (research article), eqs. (2) and (3)",
    )
