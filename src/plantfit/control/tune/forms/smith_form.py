"""A Smith predictor as a form of controller."""

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.smith import Smith, poles_outside, smith, smith_parts, smith_response, unlimited
from plantfit.control.pid import Settings, checked
from plantfit.control.tune.forms.form import Form, change, spread
from plantfit.control.tune.forms.pid_form import gains_built
from plantfit.control.tune.frequency import pid_response
from plantfit.control.tune.loop_scores import Limits, slewed
from plantfit.control.tune.reduction import Reduced, slowest
from plantfit.control.tune.rules import FILTER, rule_gains
from plantfit.control.tune.weights.servo_weights import ServoPlant
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import SimulationError
from plantfit.space import Parameter, Space

import jax.numpy as jnp


def smith_form(plant: ServoPlant, small: Reduced, sign: int, wishes: Wishes, tracking_time: float | None) -> Form:
    """A Smith predictor on the linearised best fit: a PID for the plant without its dead time, in K, Ti, Td, set-point
    weight and filter, and the seconds in which it takes over what its model misses.

    Raises SimulationError for a plant with an integrator, whose load it would never remove, and for one with no dead
    time of a sample.
    """
    if small.integrating:
        raise SimulationError(
            "The plant has an integrator, and a Smith predictor never removes a load at its input; give controller = "
            "'lqi' or 'mpc', "
            "which take dead time into account too."
        )
    ahead, advanced = plant.ahead, plant.advanced
    if not ahead:
        raise SimulationError(
            f"The dead time is shorter than a sample of {wishes.period:g} s, so that a "
            "Smith predictor is a PID; give controller = 'pid', or a shorter period."
        )
    simc = rule_gains("SIMC", small)
    assert simc is not None
    dead, slow, fast, size = small.first_order[2], slowest(small), 0.5 * wishes.period, abs(simc.K)
    space = Space({
        "K": Parameter((size / 50, size * 100), scale="log"),
        "Ti": Parameter((0.1 * dead, 10.0 * slow), scale="log"),
        "b": Parameter((0.0, 1.0)),
        "Td": Parameter((0.01 * fast, slow), scale="log"),
        "ratio": Parameter((2.0, 30.0), scale="log"),
        "seconds": Parameter((0.01 * dead, 10.0 * slow), scale="log"),
    })  # fmt: skip
    gains_of = gains_built(tuple(space.names), tuple(space.log))
    model = [jnp.asarray(v) for v in (advanced.moves, advanced.drive[:, 0], advanced.seen)]
    steady = jnp.asarray(np.linalg.solve(np.eye(len(advanced.moves)) - advanced.moves, advanced.drive[:, 0]))

    def built(z, data):
        gains, seconds = gains_of(z, data), space.physical(z)[space.names.index("seconds")]
        taken = wishes.period / (wishes.period + seconds)
        return Smith._make([gains, *model, steady, taken, jnp.asarray(plant.u0), jnp.asarray(plant.y0)])

    def response(parameters: Smith, w, xp=np):
        return smith_response(
            parameters, pid_response(parameters.gains, wishes.period, w, xp), ahead, wishes.period, w, xp
        )

    def parts(parameters: Smith, w, xp=np):
        return smith_parts(
            parameters, pid_response(parameters.gains, wishes.period, w, xp), ahead, wishes.period, w, xp
        )

    law = smith(wishes.period, ahead, wishes.anti_windup)
    follow = checked(Settings(wishes.period, wishes.lower, wishes.upper, wishes.anti_windup, tracking_time)).follow
    usual = {"Ti": small.first_order[1], "Td": 0.02 * fast, "ratio": FILTER}
    known = [
        usual | {"K": size * faster, "b": b, "seconds": seconds * dead}
        for faster in (1.0, 2.0, 4.0, 8.0) for b in (0.0, 1.0) for seconds in (0.1, 1.0, 3.0)
    ]  # fmt: skip
    rules = [space.cube(np.array([point[n] for n in space.names])) for point in known]
    starts = np.clip(np.concatenate([rules, spread(space)]), 0.0, 1.0)
    return Form(
        "Smith predictor", space, built, response, slewed(law, change(wishes)),
        lambda s: poles_outside(law, (s, s.u0, unlimited())), starts, ahead=ahead, parts=parts, parted=1,
        data=(space.lower, space.upper, float(sign)),
        given=(Limits(wishes.lower, wishes.upper, follow),),
    )  # fmt: skip
