"""Simulation of models over recordings, with exact derivatives."""

from plantfit.simulate.simulator import Drive, Simulator

__all__ = ["Drive", "Simulator"]
