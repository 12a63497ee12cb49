"""Hammerstein-Wiener model: a linear block between two static nonlinearities."""

from typing import Any, Literal

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.errors import ModelError
from plantfit.models.model import Declared, Delay, Model, Named
from plantfit.models.parts.linear_block import BLOCKS
from plantfit.models.parts.static_ends import (
    Curve,
    dead_zone,
    free_table,
    identity,
    pinned_table,
    polynomial,
    saturation,
)
from plantfit.models.parts.tables import Table
from plantfit.models.remade import remade
from plantfit.models.text.suggest import suggest
from plantfit.models.text.table_text import read_nodes

# isort: split
import jax.numpy as jnp

_NAME = "hammerstein_wiener"
_DELAYED = "u_delayed"
_NODES = {"from": -1, "to": 1, "count": 5}
_INPUTS = ("none", "saturation", "dead_zone", "table")
_OUTPUTS = ("none", "polynomial", "table")
_MOST_ORDER, _MOST_DEGREE = 3, 9


@remade
def hammerstein_wiener(
    input_curve: Literal["none", "saturation", "dead_zone", "table"] = "table",
    order: int = 2,
    form: Literal["modal", "companion"] = "companion",
    output_curve: Literal["none", "polynomial", "table"] = "polynomial",
    degree: int = 1,
    input_nodes: Any = None,
    output_nodes: Any = None,
    dead_time: bool = False,
    input_unit: str | None = None,
    output_unit: str | None = None,
) -> Model:
    """Static curve f, linear block of static gain 1, static curve g.

        v = f(u(t - L)),   w = linear block of v,   y = g(w)

    f by `input_curve`: u itself, held between the parameters low and high ("saturation"), 0 between
    them ("dead_zone"), or linear between `input_nodes` ("table"). Block of `order` 1 to 3: "companion"
    a_n w^(n) + ... + a1 w' + w = v, which may oscillate, or "modal", a sum of first order modes tau_i
    with shares c_i. g by `output_curve`: w itself, g0 + g1 w + ... to the power `degree`, or linear
    between `output_nodes`. Nodes are a list or {"from", "to", "count"}, -1 to 1 at 5 points unless
    given; tables are constant outside. L (s): dead time, 0 without `dead_time`.

    Only the product of the scales of f and g shows in the data. So v and w are in the unit of u, a
    table f meets its first and last node and its inner values are free, and the gain is in g; with
    `output_curve` "none" the table f is free at every node and in the unit of y.
    The model starts at rest under the first input.

    Source: Bai, An optimal two-stage identification algorithm for Hammerstein-Wiener nonlinear systems,
    Automatica 34 (1998) 333-338; here in continuous time.
    """
    _check_choice("input_curve", input_curve, _INPUTS)
    _check_choice("form", form, tuple(BLOCKS))
    _check_choice("output_curve", output_curve, _OUTPUTS)
    _check_whole("order", order, _MOST_ORDER)
    _check_whole("degree", degree, _MOST_DEGREE)
    inner_unit = output_unit if output_curve == "none" else input_unit
    before = _input_curve(input_curve, input_nodes, input_unit, inner_unit, free=output_curve == "none")
    after = _output_curve(output_curve, output_nodes, degree, inner_unit, output_unit)
    block, channel = BLOCKS[form](order), _DELAYED if dead_time else "u"

    def derivative(x: Named, u: Named, p: Named) -> Named:
        return block.derivative(x, before.value(u[channel], p), p)

    def output(x: Named, u: Named, p: Named) -> Named:
        return {"y": after.value(block.output(x, p), p)}

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        return block.rest(before.value(jnp.asarray(u0["u"], dtype=float), p))

    delay = (Declared("L", "s", (0.0, 100.0), sentence="dead time"),) if dead_time else ()
    return Model(
        name=_NAME,
        states=block.states(inner_unit),
        inputs={"u": input_unit},
        outputs={"y": output_unit},
        parameters=(*before.parameters, *block.parameters(), *after.parameters, *delay),
        output=output,
        derivative=derivative,
        initial_state=initial_state,
        delays=(Delay(_DELAYED, "u", "L"),) if dead_time else (),
        sentence="Hammerstein-Wiener: static curve, linear block of static gain 1, static curve.",
        source="Bai, Automatica 34 (1998) 333-338",
    )


def _input_curve(kind: str, nodes: Any, unit: str | None, inner_unit: str | None, free: bool) -> Curve:
    if kind == "table":
        axis = _axis("input_nodes", nodes, 2 if free else 3)
        return (
            free_table("f", axis, inner_unit, "curve of the input at the nodes")
            if free
            else pinned_table("f", axis, unit)
        )
    return {"none": identity, "saturation": lambda: saturation(unit), "dead_zone": lambda: dead_zone(unit)}[kind]()


def _output_curve(kind: str, nodes: Any, degree: int, inner_unit: str | None, unit: str | None) -> Curve:
    if kind == "table":
        return free_table("g", _axis("output_nodes", nodes, 2), unit, "curve of the output at the nodes")
    return polynomial(degree, unit, inner_unit) if kind == "polynomial" else identity()


def _axis(option: str, nodes: Any, least: int) -> tuple[float, ...]:
    axis = read_nodes(f"Model {_NAME!r}: {option}", _NODES if nodes is None else nodes)
    if len(axis) < least:
        raise ModelError(f"Model {_NAME!r}: {option} are {list(axis)}; give at least {least}.")
    return Table(option, (option,), (axis,)).nodes[0]  # refuses nodes that do not increase


def _check_choice(option: str, value: Any, known: tuple[str, ...]) -> None:
    if value not in known:
        raise ModelError(f"Model {_NAME!r}: {option} is {value!r}.{suggest(str(value), known)} Use {', '.join(known)}.")


def _check_whole(option: str, value: Any, most: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= most:
        raise ModelError(f"Model {_NAME!r}: {option} is {value!r}; use a whole number from 1 to {most}.")
