"""Additions to any model, text or Python: what a study file says under [model.extensions]."""

from plantfit.models.extensions.extended import KINDS, parameter_name, with_extensions

__all__ = ["KINDS", "parameter_name", "with_extensions"]
