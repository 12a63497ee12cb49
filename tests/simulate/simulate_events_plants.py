"""Small models for the tests of steady states, exact steps, events and state delays."""

from functools import cache

import plantfit.runtime  # noqa: F401
from plantfit.models.model import Declared, Delay, Model
from plantfit.simulate.steps.vector import VectorModel, vectorise

import jax.numpy as jnp


def plant(states, inputs, parameters, derivative, output=None, delays=()) -> VectorModel:
    """A model from space-separated names; without `output` every state is an output."""
    states = states.split()
    return vectorise(
        Model(
            name="plant",
            states=dict.fromkeys(states),
            inputs=dict.fromkeys(inputs.split()),
            outputs={"y": None} if output else dict.fromkeys(states),
            parameters=tuple(Declared(n) for n in parameters.split()),
            derivative=derivative,
            output=output or (lambda x, u, p: x),
            delays=delays,
        )
    )


@cache
def motor() -> VectorModel:
    """A direct-current motor: current i (fast) and speed w (slow) under a voltage v and a load."""
    return plant(
        "i w", "v load", "R L k J b",
        lambda x, u, p: {
            "i": (u["v"] - p["R"] * x["i"] - p["k"] * x["w"]) / p["L"],
            "w": (p["k"] * x["i"] - p["b"] * x["w"] - u["load"]) / p["J"],
        },
    )  # fmt: skip


MOTOR = (2.0, 1e-3, 0.05, 1e-4, 1e-5)


@cache
def tank() -> VectorModel:
    """A tank that empties through a hole, fed late: h' = q - a sqrt(h)."""
    return plant(
        "h",
        "q",
        "a Td",
        lambda x, u, p: {"h": u["late"] - p["a"] * jnp.sqrt(x["h"])},
        delays=(Delay("late", "q", "Td"),),
    )
