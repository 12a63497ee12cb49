"""Equations of two links in a plane, once for both directions: torque from motion and motion from torque.

Every coefficient b enters the torques linearly, as b times its `Term`:

    tau1 = b (M11 alpha1 + M12 alpha2 + h1),    tau2 = b (M12 alpha1 + M22 alpha2 + h2)              (1)

Lagrange's equations of the energies (theta1 from the horizontal, theta2 relative to link 1, w2 = omega1 + omega2)

    T = b1 omega1^2/2 + b2 w2^2/2 + l1 b5 omega1 w2 cos theta2 + Ir ((gr omega1)^2 + (omega1 - gr omega2)^2)/2
    V = b4 g sin theta1 + b5 g sin(theta1 + theta2)

give the terms of `rigid_terms`, and

    b1 = m1 lc1^2 + m2 l1^2 + I1,   b2 = m2 lc2^2 + I2,   b4 = m1 lc1 + m2 l1,   b5 = m2 lc2        (2)

Source: Fantoni, Lozano, Non-linear Control for Underactuated Mechanical Systems (2002), chapter 5, where theta3 = m2 l1
lc2 is l1 b5; Ir is the inertia of one rotor before a gear of ratio gr, motor 2 sitting on link 1.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401  (float64 before the first array)

# isort: split
import jax.numpy as jnp


class Term(NamedTuple):
    """The torques per unit of one coefficient: factors of the accelerations, and what is left without any (eq. 1)."""

    m11: Any = 0.0
    m12: Any = 0.0
    m22: Any = 0.0
    h1: Any = 0.0
    h2: Any = 0.0


class Link(NamedTuple):
    """A link's mass (kg), distance of its centre of mass from its joint (m), inertia about that centre (kg m^2)."""

    m: Any
    lc: Any
    I: Any  # noqa: E741  (the field's symbol)


class Motion(NamedTuple):
    """Angles (rad, theta1 from the horizontal) and rates (rad/s) of the joints."""

    theta1: Any
    theta2: Any
    omega1: Any
    omega2: Any


def base_of(link1: Link, link2: Link, l1: Any) -> dict[str, Any]:
    """Eq. (2): b1, b2 (kg m^2) and b4, b5 (kg m)."""
    return {
        "b1": link1.m * link1.lc**2 + link2.m * l1**2 + link1.I,
        "b2": link2.m * link2.lc**2 + link2.I,
        "b4": link1.m * link1.lc + link2.m * l1,
        "b5": link2.m * link2.lc,
    }


def rigid_terms(x: Motion, l1: float, g: float) -> dict[str, Term]:
    """The terms of b1, b2, b4, b5 (eq. 1)."""
    c2, s2 = jnp.cos(x.theta2), jnp.sin(x.theta2)
    lift = g * jnp.cos(x.theta1 + x.theta2)
    return {
        "b1": Term(m11=1.0),
        "b2": Term(1.0, 1.0, 1.0),
        "b4": Term(h1=g * jnp.cos(x.theta1)),
        "b5": Term(
            2 * l1 * c2,
            l1 * c2,
            0.0,
            lift - l1 * s2 * (2 * x.omega1 + x.omega2) * x.omega2,
            lift + l1 * s2 * x.omega1**2,
        ),
    }


def rotor_term(gear_ratio: float, motors: Sequence[int]) -> Term:
    """The term of a rotor's inertia Ir (kg m^2), one before the gear of each joint that has a motor."""
    first, second = float(1 in motors), float(2 in motors)
    return Term(gear_ratio**2 * first + second, -gear_ratio * second, gear_ratio**2 * second)


def torque_columns(terms: Mapping[str, Term], alpha1: Any, alpha2: Any) -> tuple[list[Any], list[Any]]:
    """Per joint the factor of every coefficient in its torque, each (n,) or a number (eq. 1)."""
    return (
        [t.m11 * alpha1 + t.m12 * alpha2 + t.h1 for t in terms.values()],
        [t.m12 * alpha1 + t.m22 * alpha2 + t.h2 for t in terms.values()],
    )


def accelerations(terms: Mapping[str, Term], b: Mapping[str, Any], tau1: Any, tau2: Any) -> tuple[Any, Any]:
    """alpha1 and alpha2 (rad/s^2) under torques (N m): eq. (1), summed over the coefficients and solved."""
    m11, m12, m22, h1, h2 = (sum(b[name] * term[k] for name, term in terms.items()) for k in range(5))
    r1, r2 = tau1 - h1, tau2 - h2
    determinant = m11 * m22 - m12 * m12
    return (m22 * r1 - m12 * r2) / determinant, (m11 * r2 - m12 * r1) / determinant


def energies(x: Motion, b: Mapping[str, Any], l1: float, g: float) -> tuple[Any, Any]:
    """Kinetic and potential energy (J) of the links, at coefficients b1, b2, b4, b5."""
    w2 = x.omega1 + x.omega2
    kinetic = 0.5 * b["b1"] * x.omega1**2 + 0.5 * b["b2"] * w2**2 + l1 * b["b5"] * x.omega1 * w2 * jnp.cos(x.theta2)
    return kinetic, g * (b["b4"] * jnp.sin(x.theta1) + b["b5"] * jnp.sin(x.theta1 + x.theta2))
