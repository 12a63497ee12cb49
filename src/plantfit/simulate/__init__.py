"""Simulation of models over recordings, with exact derivatives; closed loops."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.simulate.loop.closed_loop import ClosedLoop, Controller, Observer, closed_loop
    from plantfit.simulate.loop.sensors import Actuator, Sensor
    from plantfit.simulate.simulator import Drive, Simulator

__all__ = ["Actuator", "ClosedLoop", "Controller", "Drive", "Observer", "Sensor", "Simulator", "closed_loop"]

names_of(
    __name__,
    {
        "loop.closed_loop": "ClosedLoop Controller Observer closed_loop",
        "loop.sensors": "Actuator Sensor",
        "simulator": "Drive Simulator",
    },
)
