"""LQ servos as forms of controllers: one with its filter, and one that plans within limits."""

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.predictive.servo_mpc import Predictive, servo_mpc
from plantfit.control.linear.servo import Servo, servo, servo_parts, servo_response, unstable_poles
from plantfit.control.tune.forms.form import Form, change, spread
from plantfit.control.tune.loop_scores import from_rest, slewed
from plantfit.control.tune.reduction import Reduced, slowest
from plantfit.control.tune.weights.plan_weights import PlanShape
from plantfit.control.tune.weights.servo_weights import ServoPlant
from plantfit.control.tune.wishes import Wishes
from plantfit.space import Parameter, Space


def lqi_form(plant: ServoPlant, small: Reduced, wishes: Wishes) -> Form:
    """An LQ servo on the linearised best fit, in the weight of its input, the loads that its filter expects and the
    speed of its set point; spread evenly, its starts are tried for good regions of the cube, of which there are
    several."""
    space = _weights(small)

    def built(z, _):
        rho, wander, shaken, seconds = space.physical(z)
        return plant.servo(rho, wander, shaken * wander, seconds)

    def response(parameters: Servo, w, xp=np):
        return servo_response(parameters, wishes.period, w, xp)

    def parts(parameters: Servo, w, xp=np):
        return servo_parts(parameters, wishes.period, w, xp)

    loop = slewed(from_rest(servo(wishes.period, lower=wishes.lower, upper=wishes.upper)), change(wishes))
    return Form("LQI", space, built, response, loop, unstable_poles, spread(space), parts=parts)


def mpc_form(plant: ServoPlant, small: Reduced, wishes: Wishes, starts: np.ndarray) -> Form:
    """A predictive LQ servo in the same four numbers; `starts` are those of LQ servos, as it is one where no limit
    acts."""
    space, plan = _weights(small), PlanShape.of(plant, small, wishes)

    def built(z, _):
        rho, wander, shaken, seconds = space.physical(z)
        return plan.predictive(rho, wander, shaken * wander, seconds)

    def response(parameters: Predictive, w, xp=np):
        return servo_response(parameters.servo, wishes.period, w, xp)

    def parts(parameters: Predictive, w, xp=np):
        return servo_parts(parameters.servo, wishes.period, w, xp)

    loop = slewed(from_rest(servo_mpc(len(plan.lengths), plan.rated)), change(wishes))
    return Form(
        "MPC", space, built, response, loop, lambda given: unstable_poles(given.servo), starts, plan, parts=parts
    )  # fmt: skip


def _weights(small: Reduced) -> Space:
    """Weight of the input, loads and noise of the input that the filter expects, seconds in which the set point is
    followed."""
    total = slowest(small) + small.first_order[2]
    return Space({
        "rho": Parameter((1e-3, 1e2), scale="log"),
        "wander": Parameter((0.1, 1e3), scale="log"),
        "shaken": Parameter((0.03, 3.0), scale="log"),  # per wander
        "seconds": Parameter((0.02 * total, 2.0 * total), scale="log"),
    })  # fmt: skip
