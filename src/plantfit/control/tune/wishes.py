"""What a loop is asked for."""

import math
from dataclasses import dataclass

from plantfit.control.tune.forms.names import CONTROLLERS
from plantfit.errors import SimulationError
from plantfit.findings.results.tuned_controller import LoopWishes

SETTLED = 0.05  # of the step: a loop that is farther off at the end of it does not hold the set point
TOLERATED = 0.01  # of the step


@dataclass(frozen=True)
class Wishes(LoopWishes):
    """What a loop is asked for, in the units of the study; the fields are those of `LoopWishes`."""

    @property
    def settled(self) -> float:
        """How far off the set point, as a share of the step, a loop may be at the end of the step: 5 %, or a step of
        the sensor."""
        return max(SETTLED, self.quantum / abs(self.step))

    @property
    def tolerated(self) -> float:
        """How far beyond its limits the output may be, in its unit: 1 % of the step, or a step of the sensor."""
        return max(TOLERATED * abs(self.step), self.quantum)


def range_of(lower: float, upper: float) -> str:
    """A range in words, of which one end may be open."""
    if math.isinf(lower):
        return f"at or below {upper:.5g}"
    return f"at or above {lower:.5g}" if math.isinf(upper) else f"within {lower:.5g} and {upper:.5g}"


def check_wishes(wishes: Wishes) -> None:
    for name, low in (
        ("period", 0.0),
        ("overshoot", 0.0),
        ("ms", 1.0),
        ("input_noise", 0.0),
        ("settling", 0.0),
        ("travel", 0.0),
    ):
        value = getattr(wishes, name)
        if not ((math.isfinite(value) or name in ("settling", "travel")) and value > low):
            raise SimulationError(f"{name} = {value:g} cannot be asked for; give a number above {low:g}.")
    for name, low, high in (("gain_margin", 1.0, math.inf), ("phase_margin", 0.0, 180.0)):
        if not low <= getattr(wishes, name) < high:
            most = f"up to {high:g}" if math.isfinite(high) else "or more"
            raise SimulationError(f"{name} = {getattr(wishes, name):g} cannot be asked for; give {low:g} {most}.")
    if (
        not wishes.minimise
        or not all(math.isfinite(v) and v >= 0 for v in wishes.minimise.values())
        or not sum(wishes.minimise.values())
    ):
        raise SimulationError(
            f"minimise = {wishes.minimise} weighs nothing; give figures with weights above 0, as in {{iae = 1}}."
        )
    if not 0 < wishes.share < 1:
        raise SimulationError(
            f"share = {wishes.share:g} cannot be promised; give a share of the plants between 0 and 1, such as 0.95."
        )
    if not wishes.lower < wishes.upper:
        raise SimulationError(f"The input's limits are {wishes.lower:g} and {wishes.upper:g}; give lower below upper.")
    if not wishes.step or not math.isfinite(wishes.step):
        raise SimulationError(f"A step of {wishes.step:g} moves nothing; give the change of the set point.")
    if wishes.controller not in CONTROLLERS:
        raise SimulationError(
            f"Controller {wishes.controller!r} is not known; give {', '.join(map(repr, CONTROLLERS))}."
        )
    if not wishes.rate > 0:
        raise SimulationError(
            f"rate = {wishes.rate:g} lets the input never move; give its fastest change in a second, above 0."
        )
    for level in (wishes.set_point - wishes.step, wishes.set_point):
        if not wishes.output_lower <= level <= wishes.output_upper:
            raise SimulationError(
                f"The output is to stay {range_of(wishes.output_lower, wishes.output_upper)}, and the "
                f"step goes from {wishes.set_point - wishes.step:.5g} to "
                f"{wishes.set_point:.5g}; choose another set point or step, or wider limits."
            )
    if wishes.prediction is not None and wishes.controller != "mpc":
        raise SimulationError(
            "A prediction is what an MPC plans for; give controller = 'mpc', or leave prediction out."
        )
