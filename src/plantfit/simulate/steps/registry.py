"""The steppers by name. A new one is a function as in `steppers.py` or `exponential.py`, and a row here: study files,
checks and meshes read this table, and so do the tests of order, derivatives and events.

A stepper that has to know its model has no `place`, as EXACT, or whose step chooses its own length, as ADAPTIVE.
`simulate/simulator.py` makes its step and refuses models that it cannot follow; `simulate/loop/held_plant.py` does so
for closed loops. It needs tests of its own.

Nothing here imports jax, so that a study file is checked at once.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

EXACT, ADAPTIVE = "exact", "adaptive"


@dataclass(frozen=True)
class Stepper:
    """Where the function of one step is (`steppers.py` says what it takes), and the order of the error in the length of
    steps.

    `place` None: `Simulator` makes the step for its model. `place_on_arrays`: the same step on rows of numpy arrays
    (`array_steppers.py`); without it records get no mesh (`problem/accuracy/mesh.py`).
    """

    place: str | None
    order: int
    place_on_arrays: str | None = None

    @property
    def step(self) -> Callable:
        """The function of one step; raises TypeError for a stepper that `Simulator` makes."""
        return _at(self.place)

    @property
    def on_arrays(self) -> Callable[..., Any]:
        """The same on rows of numpy arrays; raises TypeError where there is none."""
        return _at(self.place_on_arrays)


STEPPERS = {
    "exponential": Stepper("exponential.exponential", 2, "array_steppers.exponential"),
    "rosenbrock": Stepper("steppers.rosenbrock", 2, "array_steppers.rosenbrock"),
    "rk4": Stepper("steppers.rk4", 4, "array_steppers.rk4"),
    EXACT: Stepper(None, 4),  # any order: halving changes nothing
    ADAPTIVE: Stepper(None, 2),  # by twice the fineness the error falls to a quarter
}
FIXED = tuple(name for name, stepper in STEPPERS.items() if stepper.place)  # the same function for every model


def _at(place: str | None) -> Callable[..., Any]:
    if place is None:
        raise TypeError("This stepper has no function of its own.")
    module, name = place.split(".")
    return getattr(import_module(f"plantfit.simulate.steps.{module}"), name)
