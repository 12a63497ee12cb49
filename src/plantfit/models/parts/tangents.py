"""Tangents in the rules of functions with derivatives of their own."""

from typing import Any

import plantfit.runtime  # noqa: F401

# isort: split
from jax.custom_derivatives import SymbolicZero


def still(tangent: Any) -> bool:
    """Whether a tangent is known to be zero, so that nothing needs to be computed for it."""
    return isinstance(tangent, SymbolicZero)
