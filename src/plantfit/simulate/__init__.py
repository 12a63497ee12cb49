"""Simulation of models over recordings, with exact derivatives; closed loops."""

from plantfit.simulate.closed_loop import ClosedLoop, Controller, Observer, closed_loop
from plantfit.simulate.sensors import Actuator, Sensor
from plantfit.simulate.simulator import Drive, Simulator

__all__ = ["Actuator", "ClosedLoop", "Controller", "Drive", "Observer", "Sensor", "Simulator", "closed_loop"]
