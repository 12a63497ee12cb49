"""Laws of friction: force (or torque) against a velocity v, in any consistent units.

viscous   F = b v                                                                       (1)
Coulomb   F = Fc tanh(v/width)                                                          (2)
Stribeck  F = (Fc + (Fs - Fc) exp(-(v/vs)^2)) tanh(v/width)                             (3)
LuGre     z' = v - sigma0 |v| z/g(v),  g(v) = Fc + (Fs - Fc) exp(-(v/vs)^2)             (4)
          F = sigma0 z + sigma1 z' + sigma2 v                                           (5)

The sign of v in (2) and (3) is smoothed over `width`. The steady sliding force of LuGre is that of
(3) with the sharp sign, plus sigma2 v.

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083-1138, for (1) to (3);
Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Transactions on Automatic Control 40 (1995)
419-425, for (4) and (5).
"""

from typing import Any

import plantfit.runtime  # noqa: F401  (float64 before the first array)

# isort: split
import jax.numpy as jnp


def viscous(v: Any, b: Any) -> Any:
    """Eq. (1): `b` in force per velocity."""
    return b * v


def coulomb(v: Any, Fc: Any, width: Any) -> Any:
    """Eq. (2): sliding force `Fc` against v; `width` in the unit of v."""
    return Fc * jnp.tanh(v / width)


def stribeck(v: Any, Fc: Any, Fs: Any, vs: Any, width: Any) -> Any:
    """Eq. (3): from the breakaway force `Fs` down to `Fc` over the Stribeck velocity `vs`; `width` well below `vs`."""
    return _sliding_level(v, Fc, Fs, vs) * jnp.tanh(v / width)


def lugre(v: Any, z: Any, sigma0: Any, sigma1: Any, sigma2: Any, Fc: Any, Fs: Any, vs: Any) -> tuple[Any, Any]:
    """Eqs. (4) and (5): (force, z') with the mean deflection z of the bristles as a state of the model.

    `sigma0` is their stiffness (force per length), `sigma1` their damping and `sigma2` viscous friction
    (force per velocity). Start z at 0.
    """
    rate = v - sigma0 * jnp.abs(v) * z / _sliding_level(v, Fc, Fs, vs)
    return sigma0 * z + sigma1 * rate + sigma2 * v, rate


def _sliding_level(v: Any, Fc: Any, Fs: Any, vs: Any) -> Any:
    return Fc + (Fs - Fc) * jnp.exp(-((v / vs) ** 2))
