"""What a model is: declared names with units, and pure functions on named values."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from plantfit.errors import ModelError
from plantfit.models.check_model import check_declared
from plantfit.models.parts.switching import Backlash, Event, Friction, StateDelay
from plantfit.models.parts.tables import Table
from plantfit.models.remade import reduced

Named = Mapping[str, Any]
Numbers = Any  # a number, or nested tuples of numbers in the shape of the parameter


@dataclass(frozen=True)
class Declared:
    """A parameter as the model knows it: a default that the study may override.

    `bounds` are in `unit`; None means that the study must give them. `value` is set for constants
    that the data are not asked about. With a `shape`, (n,) or (ny, nu), it is an array (the values of
    a table); each bound and `value` is then one number for all entries or nested tuples of that shape.
    `limits` (low, high) are physical ones, infinite where there is none, and `typical` a size that matters
    (`plantfit.space.Parameter`).
    """

    name: str
    unit: str | None = None
    bounds: tuple[Numbers, Numbers] | None = None
    scale: Literal["linear", "log"] = "linear"
    value: Numbers | None = None
    sentence: str = ""
    shape: tuple[int, ...] = ()
    limits: tuple[float, float] | None = None
    typical: float | None = None


@dataclass(frozen=True)
class Delay:
    """A delayed copy of an input: `channel` holds input(t - parameter), the parameter in seconds."""

    channel: str
    input: str
    parameter: str


@dataclass(frozen=True)
class Model:
    """A plant as equations.

    `derivative(x, u, p)` gives d/dt of every state, `output(x, u, p)` every output and
    `initial_state(p, u0, y0)` every state at the first sample; all take and give mappings from
    names to jax scalars (or arrays of one common shape) and must be pure and differentiable. A
    parameter with a shape arrives as an array of that shape.
    `u` holds the inputs, the channels of `delays` and of `state_delays`, and time in seconds as "t".
    A model without states has `derivative=None` and is a static function.

    `events`, `frictions` and `backlashes` are what happens beside the derivative, which leaves the
    forces of `frictions` out and gives 0 for the states of `backlashes`. `tables` say over which
    operating points the parameters with a shape are.

    Units are strings for `plantfit.units`; None means unknown and is not checked. Raises ModelError for declarations
    that contradict each other.
    """

    name: str
    states: Mapping[str, str | None]
    inputs: Mapping[str, str | None]
    outputs: Mapping[str, str | None]
    parameters: tuple[Declared, ...]
    output: Callable[[Named, Named, Named], Named]
    derivative: Callable[[Named, Named, Named], Named] | None = None
    initial_state: Callable[[Named, Named, Named], Named] | None = None
    delays: tuple[Delay, ...] = ()
    state_delays: tuple[StateDelay, ...] = ()
    events: tuple[Event, ...] = ()
    frictions: tuple[Friction, ...] = ()
    backlashes: tuple[Backlash, ...] = ()
    tables: tuple[Table, ...] = ()
    sentence: str = ""
    source: str = ""
    text: str | None = field(default=None, compare=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return reduced(self)

    def __post_init__(self) -> None:
        names = [*self.states, *self.inputs, *self.outputs, *(p.name for p in self.parameters)]
        twice = sorted({n for n in names if names.count(n) > 1} - (set(self.states) & set(self.outputs)))
        if twice:
            raise ModelError(
                f"Model {self.name!r}: the name {twice[0]!r} is declared "
                "twice; give each signal and parameter its own name."
            )
        if self.states and self.derivative is None:
            raise ModelError(f"Model {self.name!r} has states but no derivative; give derivative(x, u, p).")
        check_declared(self)

    @property
    def smooth(self) -> bool:
        """Whether the states follow `derivative` alone: no resets, dry friction, backlash or late states."""
        return not (self.events or self.frictions or self.backlashes or self.state_delays)

    def declared(self, name: str) -> Declared:
        """The declaration of one parameter. Raises ModelError for an unknown name."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise ModelError(f"Model {self.name!r} has no parameter {name!r}; it has {[p.name for p in self.parameters]}.")
