"""The robot's speed loop and its fitness: discrete PID, 8-bit PWM, encoder, motor."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control import Gains, StepMetrics, pid, step_observer
from plantfit.models.text.equations import equations
from plantfit.optimize import Objective
from plantfit.simulate.loop.closed_loop import ClosedLoop, Controller, Trajectory, closed_loop
from plantfit.simulate.loop.sensors import Actuator, Sensor

import jax
import jax.numpy as jnp

# the paper does not print these; ours
PERIOD, SAMPLES, SET_POINT, SUPPLY = 1e-3, 1000, 300.0, 12.0
UPPER = np.array([50.0, 50.0, 1.0])  # Kp, Ki, Kd from 0
# steps in rad/s at the set point
ENCODERS = {"exact speed": 0.0, "pulse period, 1 us timer": 1.5, "counts in 1 ms": 60.0}
TIMER = ENCODERS["pulse period, 1 us timer"]
MOTOR = "i' = (V - Ra*i - kw*w)/La\nw' = (kw*i - B*w)/J"
# a constant duty
OPEN = Controller(lambda measurement, duty: (), lambda state, measurement, reference, duty: (state, duty))


@lru_cache(maxsize=8)
def speed_loop(step: float = TIMER, open_loop: bool = False) -> ClosedLoop:
    """The loop with a speed measured in steps of `step` rad/s; the paper's PID has no anti-windup and no derivative
    filter."""
    motor = equations(
        MOTOR, inputs=["V"], states=["i", "w"], outputs=["w"], parameters=["Ra", "La", "kw", "B", "J"], name="motor"
    )
    controller = OPEN if open_loop else pid(PERIOD, lower=0.0, upper=255.0, anti_windup="none")
    return closed_loop(
        motor, controller, period=PERIOD, actuator=Actuator.pwm(SUPPLY), sensor=Sensor(quantum=step), stepper="exact"
    )


def fitness(m: StepMetrics) -> Any:
    """Eq. 13 with weights 1: overshoot and error as shares of the set point, times in s, at most the second that is
    simulated."""
    horizon = PERIOD * SAMPLES
    times = sum(jnp.minimum(t, horizon) for t in (m.rise_time, m.settling_time, m.peak_time))
    return m.overshoot / 100 + times + jnp.abs(m.steady_state_error) / SET_POINT


def objective(motor: Mapping[str, float]) -> Objective:
    """Fitness over the unit cube of the gains, each closed loop one evaluation."""
    loop, observer, plant = speed_loop(), step_observer(), {n: float(motor[n]) for n in ("Ra", "La", "kw", "B", "J")}

    def one(row: Any) -> Any:
        return fitness(loop.observe(observer, Gains(*(row * UPPER)), plant, SET_POINT, samples=SAMPLES))

    return Objective(3, jax.jit(jax.vmap(one)), lower=np.zeros(3), upper=UPPER)


def response(motor: Mapping[str, float], gains: Any, step: float = TIMER) -> tuple[Trajectory, StepMetrics]:
    """One loop with the gains (Kp, Ki, Kd), or a constant duty where `gains` is a number."""
    open_loop = np.ndim(gains) == 0
    loop, given = speed_loop(step, open_loop), float(gains) if open_loop else Gains(*map(float, gains))
    plant = {n: float(motor[n]) for n in ("Ra", "La", "kw", "B", "J")}
    run = loop.simulate(given, plant, SET_POINT, samples=SAMPLES)
    return run, StepMetrics(*map(float, loop.observe(step_observer(), given, plant, SET_POINT, samples=SAMPLES)))


def constant_duty(motor: Mapping[str, float]) -> float:
    """The duty in whole counts that holds the set point of a motor with these constants."""
    return float(np.round(SET_POINT * (motor["Ra"] * motor["B"] / motor["kw"] + motor["kw"]) * 255 / SUPPLY))
