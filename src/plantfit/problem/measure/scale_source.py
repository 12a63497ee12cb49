"""Who chose the scale that an output's residual is divided by."""

from typing import Literal, NamedTuple

Kind = Literal["given", "unit", "spread", "residuals"]


class ScaleSource(NamedTuple):
    """`kind` tells who chose a scale; `rounds` of estimation, and whether the last one changed nothing, for "residuals"."""

    kind: Kind
    rounds: int = 0
    settled: bool = True


GIVEN = ScaleSource("given")  # the user's word, which nothing changes
UNIT = ScaleSource("unit")  # 1, because the scale of a single output only sets the unit of the cost
SPREAD = ScaleSource("spread")  # standard deviation of the measured output, until there are residuals
