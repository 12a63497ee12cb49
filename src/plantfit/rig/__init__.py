"""Virtual rigs: closed loops with real sensors' faults whose truth is known."""

from plantfit.rig.pendubot import MEASURED, PendubotRig
from plantfit.rig.run import RigRun
from plantfit.rig.trajectories import Move, RestToRest

__all__ = ["MEASURED", "Move", "PendubotRig", "RestToRest", "RigRun"]
