"""An identified plant for other programs: python-control, CasADi, C, MATLAB, FMI, ArviZ, plain Python, CSV."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.bridges.exported import TARGETS, export_plant

__all__ = ["TARGETS", "export_plant"]

names_of(__name__, {"exported": "TARGETS export_plant"})
