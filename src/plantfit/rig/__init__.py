"""Virtual rigs, closed loops with real sensors' faults whose truth is known; and boards on a serial line, in
`rig.board`.

Names are loaded when first used: recording from a board needs no jax.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plantfit.rig.dc_motor import DcMotorRig
    from plantfit.rig.pendubot import MEASURED, PendubotRig
    from plantfit.rig.run import RigRun
    from plantfit.rig.steam_chamber import SteamChamberRig
    from plantfit.rig.trajectories import Move, RestToRest

_PLACES = {
    "DcMotorRig": "plantfit.rig.dc_motor",
    "MEASURED": "plantfit.rig.pendubot",
    "Move": "plantfit.rig.trajectories",
    "PendubotRig": "plantfit.rig.pendubot",
    "RestToRest": "plantfit.rig.trajectories",
    "RigRun": "plantfit.rig.run",
    "SteamChamberRig": "plantfit.rig.steam_chamber",
}

__all__ = ["MEASURED", "DcMotorRig", "Move", "PendubotRig", "RestToRest", "RigRun", "SteamChamberRig"]


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        return getattr(import_module(_PLACES[name]), name)
    raise AttributeError(f"module 'plantfit.rig' has no attribute {name!r}")
