"""Torque commands as a motor's voltages: what stands between a controller that thinks in torques and an H-bridge."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.design import Design, followed, stacked
from plantfit.control.linear.lqr import StateFeedback
from plantfit.errors import SimulationError
from plantfit.simulate.loop.closed_loop import Controller

import jax.numpy as jnp


class TorqueDrive(NamedTuple):
    """V = ratio tau + back_emf w, clipped to +-limit; tau from the feedback, w by its estimator."""

    feedback: StateFeedback
    ratio: Any  # V per N m: Rm / (gear Kt)
    back_emf: Any  # V per rad/s: gear Kb
    limit: Any


def through_motor(design: Design, motor: Mapping[str, float], speed: str, limit: float, gear: float = 1.0) -> Design:
    """An `lqr` of one torque, which drives a motor of the constants Rm (ohm), Kt (N m/A), Kb (V s/rad) by its voltage
    V:

        V = Rm / (gear Kt) tau + gear Kb w,  within +-limit

    w is the state `speed` as the estimator sees it, which is told the torque that the motor gives under the voltage
    that is left after clipping. The winding's inductance is left out. References still name states and the torque.

    Source: Tran et al., A Survey of Identification Experimental System Parameters Using Genetic Algorithm, eq. (1).
    Raises SimulationError for a design of another kind, a missing constant or an unknown state.
    """
    plant, parameters = design.plant, design.parameters
    if not isinstance(parameters, StateFeedback) or len(plant.inputs) != 1:
        raise SimulationError(f"through_motor needs an lqr of one torque; this design drives {list(plant.inputs)}.")
    if speed not in plant.states:
        raise SimulationError(f"through_motor: {speed!r} is no state; the plant has {list(plant.states)}.")
    for name in ("Rm", "Kt", "Kb"):
        if not (name in motor and np.isfinite(motor[name]) and motor[name] > 0):
            raise SimulationError(f"through_motor: the motor's {name} is {motor.get(name)}; give a number above 0.")
    ratio, back_emf, at = motor["Rm"] / (gear * motor["Kt"]), gear * motor["Kb"], plant.states.index(speed)
    as_voltage = replace(
        plant,
        A=plant.A - plant.B * back_emf / ratio @ np.eye(1, len(plant.states), at),
        B=plant.B / ratio,
        inputs=("V",),
        u0=ratio * plant.u0 + back_emf * plant.x0[at],
        units={**plant.units, "V": "V"},
    )
    drive = TorqueDrive(parameters, *(jnp.asarray(float(v)) for v in (ratio, back_emf, limit)))
    return Design(torque_drive(plant.outputs, plant.inputs[0], plant.states, at), drive, as_voltage, design.period)


def torque_drive(outputs: tuple[str, ...], torque: str, states: tuple[str, ...], speed: int) -> Controller:
    """The controller whose parameters are `TorqueDrive`; its state is the predicted state and the torque."""

    def init(measurement, parameters):
        estimator = parameters.feedback.estimator
        return estimator.begin(stacked(measurement, outputs)), jnp.broadcast_to(estimator.u0, (1,))

    def update(state, measurement, reference, parameters):
        law, estimator = parameters.feedback, parameters.feedback.estimator
        x = estimator.corrected(state[0], stacked(measurement, outputs), state[1])
        wanted = followed(reference, (torque,), estimator.u0, states)
        wanted = wanted - law.gain @ (x - followed(reference, states, estimator.x0, (torque,)))
        induced = parameters.back_emf * x[speed]
        volts = parameters.ratio * jnp.clip(wanted, law.lower, law.upper)[0] + induced
        volts = jnp.clip(volts, -parameters.limit, parameters.limit)
        given = (volts - induced)[None] / parameters.ratio
        return (estimator.predicted(x, given), given), {"V": volts}

    return Controller(init, update)
