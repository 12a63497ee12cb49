"""Saturation, dead zone and modulus with rounded corners, and rounding with a usable derivative.

A `width` above 0 has the unit of x; the rounded form differs from the sharp one by at most about a
width at the corners, and by nothing that counts some widths away.
"""

from typing import Any

import plantfit.runtime  # noqa: F401  (float64 before the first array)

# isort: split
import jax
import jax.numpy as jnp


def quantize(x: Any, step: Any) -> Any:
    """The nearest multiple of `step` (half to even), as an analog-to-digital converter gives.

    The derivative by x is 1 and not the true 0 ("straight-through"), so that searches by gradient see
    through it; by `step` it is 0.
    """
    x = jnp.asarray(x, dtype=float)
    rounded = jax.lax.stop_gradient(step * jnp.round(x / step))
    return rounded + (x - jax.lax.stop_gradient(x))


def smooth_abs(x: Any, width: Any) -> Any:
    """sqrt(x^2 + width^2): |x| with a round bottom; `width` at 0."""
    return jnp.sqrt(x * x + width * width)


def smooth_sat(x: Any, low: Any, high: Any, width: Any) -> Any:
    """x held between low and high, with corners rounded by softplus; width ln 2 off at each corner."""
    return low + _soft_positive(x - low, width) - _soft_positive(x - high, width)


def smooth_deadzone(x: Any, low: Any, high: Any, width: Any) -> Any:
    """0 between low and high and x beyond, less the edge, with rounded corners: x - smooth_sat(x, ...)."""
    return _soft_positive(x - high, width) - _soft_positive(low - x, width)


def _soft_positive(x: Any, width: Any) -> Any:
    return width * jax.nn.softplus(x / width)
