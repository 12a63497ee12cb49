"""The virtual rigs by name, with constants of the user's own: what `plantfit rig` lists and records."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.rig.offered.catalogue import names, offered, record_rig
    from plantfit.rig.offered.contract import Number, OfferedRig, RigRecord

__all__ = ["Number", "OfferedRig", "RigRecord", "names", "offered", "record_rig"]

names_of(__name__, {"catalogue": "names offered record_rig", "contract": "Number OfferedRig RigRecord"})
