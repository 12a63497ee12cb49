"""Small plants that the tests of control design share."""

import numpy as np

from plantfit.control import LinearPlant, linearised
from plantfit.models.model import Model
from plantfit.models.text.equations import equations

PERIOD = 0.02


def stick(measured: tuple[str, ...] = ("q",)) -> Model:
    """An inverted pendulum by torque: w' = a sin(q) + b u."""
    text = "q' = w\nw' = a*sin(q) - c*w + b*u"
    units = {"a": None, "b": None, "c": None}
    return equations(text, inputs=["u"], states=["q", "w"], outputs=list(measured), parameters=units, name="stick")


STICK = {"a": 20.0, "b": 50.0, "c": 0.3}


def straight(measured: tuple[str, ...] = ("q",)) -> Model:
    """The same without the sine."""
    text = "q' = w\nw' = a*q - c*w + b*u"
    units = {"a": None, "b": None, "c": None}
    return equations(text, inputs=["u"], states=["q", "w"], outputs=list(measured), parameters=units, name="straight")


def upright(measured: tuple[str, ...] = ("q",)) -> LinearPlant:
    """The stick at rest."""
    return linearised(stick(measured), STICK, {"q": 0.0})


def carts() -> Model:
    """Two carts joined by a spring, a force on each, the positions measured."""
    text = "q' = v\ns' = w\nv' = F - k*(q - s) - c*v\nw' = 2*G + k*(q - s) - c*w"
    return equations(
        text,
        inputs=["F", "G"],
        states=["q", "s", "v", "w"],
        outputs=["s", "q"],
        parameters=dict.fromkeys("kc"),
        name="carts",
    )


CARTS = {"k": 3.0, "c": 0.4}


def quadratic_cost(states: dict, u: dict, q: np.ndarray, r: np.ndarray) -> float:
    """Sum over the samples of x' q x + u' r u."""
    x, v = np.stack([np.asarray(s) for s in states.values()]), np.stack([np.asarray(s) for s in u.values()])
    return float(np.einsum("in,ij,jn->", x, q, x) + np.einsum("in,ij,jn->", v, r, v))
