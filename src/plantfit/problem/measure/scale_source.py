"""Who chose the scale that an output's residual is divided by."""

from typing import Literal, NamedTuple

Kind = Literal["given", "unit", "spread", "residuals", "few samples"]


class ScaleSource(NamedTuple):
    """`kind` tells who chose a scale; `rounds` of estimation, and whether the last one changed nothing, for
    "residuals".

    "few samples": the least scale of an output that has no more samples than there are free parameters, so that it can
    be followed exactly whatever its noise is.
    """

    kind: Kind
    rounds: int = 0
    settled: bool = True


GIVEN = ScaleSource("given")  # the user's word, which nothing changes
UNIT = ScaleSource("unit")  # 1, because the scale of a single output only sets the unit of the cost
SPREAD = ScaleSource("spread")  # standard deviation of the measured output, until there are residuals
