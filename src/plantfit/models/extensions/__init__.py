"""Additions to any model, text or Python: what a study file says under [model.extensions]."""

from plantfit.models.extensions.extended import with_extensions
from plantfit.models.extensions.kinds import KINDS, Kind, brought, parameter_name
from plantfit.models.extensions.wiring import declared, rewired

__all__ = ["KINDS", "Kind", "brought", "declared", "parameter_name", "rewired", "with_extensions"]
