"""What an optimizer is and what it may see: a unit cube and numbers.

Two shapes share one registry and one result type. A `Population` method is a frozen record of
settings with pure functions, so that the loop can vmap it over runs. A `Host` method drives
itself (scipy, tree of populations) and counts its evaluations through the `Counter` it is given.
A method has one of these shapes; docs/plug-ins.md, "A method", shows a whole one.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import Status

from jax import Array

State = Any
Info = dict[str, Array]


@dataclass(frozen=True)
class Needs:
    """Capabilities as data: the loop refuses a method whose needs the objective cannot meet."""

    gradient: bool = False
    residuals: bool = False
    schedule_bound: bool = False  # needs the budget at init; runs of different budgets are not comparable
    raw_box: bool = False  # reads Facts.lower and Facts.upper (literal salp swarm only)
    minimum_population: int = 1
    baseline: bool = False  # only samples the cube; what it finds is no optimum


class Facts(NamedTuple):
    """What an optimizer may know at its start."""

    dimension: int
    budget: int
    lower: np.ndarray | None = None
    upper: np.ndarray | None = None
    start: np.ndarray | None = None  # warm starts (k, d), which also replace rows of the first generation


class Population(Protocol):
    """Pure ask/tell on the unit cube; `needs` is a class attribute, settings are frozen fields."""

    needs: ClassVar[Needs]

    def rows(self, facts: Facts) -> int:
        """Rows that `ask` returns, fixed for the run. The loop refuses a budget that does not cover them."""
        ...

    def init(self, key: Array, facts: Facts) -> State:
        """A pytree of fixed-shape arrays."""
        ...

    def ask(self, key: Array, state: State) -> tuple[Array, State]:
        """Candidates (rows, dimension) inside [0, 1]."""
        ...

    def tell(self, state: State, x: Array, f: Array) -> tuple[State, Info]:
        """Take the costs (rows,); not-finite ones arrive as +inf. Info["stop"] (the method met its
        own tolerance) and Info["stagnated"] may be bools."""
        ...


class Refreshing(Population, Protocol):
    """A population method with costly work that is not due in every generation (an eigendecomposition).

    Under vmap a condition on the state runs both branches, so the loop holds the counter: it calls
    `refresh` before the `ask` of every generation divisible by `refresh_period`.
    """

    def refresh_period(self, facts: Facts) -> int:
        """Generations between two refreshes, at least 1; must not depend on the budget."""
        ...

    def refresh(self, state: State) -> State:
        """The state with its costly part brought up to date; pure."""
        ...


class Shrinking(Population, Protocol):
    """A population method whose generations need not fill all its rows (a population that shrinks)."""

    def live(self, state: State) -> Array:
        """How many rows, counted from the first, the next generation uses: an int from 1 to `rows`.

        The same before and after `ask`. Only these candidates are evaluated and charged; `tell` gets +inf
        for the others.
        """
        ...


class Projected(Protocol):
    """A least-squares problem over some of its coordinates: at every point the others are solved for inside their
    bounds."""

    @property
    def kept(self) -> np.ndarray:
        """Coordinates (q,) that are searched, places in the cube of all."""
        ...

    @property
    def charge(self) -> float:
        """Evaluations that one point of `rows` costs."""
        ...

    @property
    def cost_charge(self) -> float:
        """Evaluations that one point of `sample` costs, and one of `rows` that is left after its cost."""
        ...

    def rows(
        self, zn: np.ndarray, below: np.ndarray | None = None, /
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """At n points (n, q): residuals (n, k) and their derivatives (n, k, q) in rows whose mean square is the
        cost, the full cube points (n, d), and which are whole (n,). A point that cannot be simulated has NaN
        residuals; one that surely costs more than its entry of `below` (n,) need not be whole: its derivatives are
        then 0."""
        ...

    def sample(self, zn: np.ndarray, /) -> tuple[np.ndarray, np.ndarray]:
        """At n points (n, q): costs (n,), never too low by rounding, +inf where a point cannot be simulated, and
        full points (n, d)."""
        ...


@dataclass(frozen=True)
class Objective:
    """A cost over the unit cube, with whatever derivatives it has.

    `costs` maps (n, d) to (n,), is jax-traceable and pure; a candidate that cannot be simulated
    costs +inf. `value_and_gradient` maps (d,) to (float, (d,)); `residuals_and_jacobian` maps (d,)
    to ((m,), (m, d)) with cost = mean(residuals**2); `compressed` likewise in few rows with the same
    mean square, gradient and Gauss-Newton matrix, for plain least squares. `separable` are groups of
    coordinates that partition the cube so that the cost is a sum over groups; `blocks` then gives, at (d,), for
    each group its residuals (k,), with cost = sum of their squares, and their derivatives (k, q) by the
    group's coordinates. Only the groups are asked for that its second argument, (groups,) of bool, names; the others
    may hold any numbers. Charges are in evaluations. `start` (k, d) are warm starts, possibly empty. `batch_rows` maps
    (n, d) to ((n, k), (n, k, d)): rows with the same mean square, gradient and Gauss-Newton matrix as the residuals and
    Jacobians of n points, for methods that run many starts side by side. `projected` makes the same problem with the
    parameters solved for in which the residuals are affine, None if there are none. `lower` and `upper` (d,) are the
    bounds in units; `log` (d,) tells which coordinates are logarithms. `held` is a number that is another one where
    values that are held are others: costs at a few points may not show it.
    """

    dimension: int
    costs: Callable[[Array], Array]
    value_and_gradient: Callable[[np.ndarray], tuple[float, np.ndarray]] | None = None
    residuals_and_jacobian: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    compressed: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    batch_rows: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    projected: Callable[[], "Projected | None"] | None = None
    separable: tuple[np.ndarray, ...] | None = None
    blocks: Callable[[np.ndarray, np.ndarray], list[tuple[np.ndarray, np.ndarray]]] | None = None
    gradient_charge: float = 3.0
    jacobian_charge: float = 5.0
    start: np.ndarray | None = None
    lower: np.ndarray | None = None
    upper: np.ndarray | None = None
    log: np.ndarray | None = None
    noise_floor: float | None = None  # expected cost at the truth when known
    held: float | None = None


@dataclass(frozen=True, eq=False)
class CostOfData:
    """Costs as `Objective` takes them, of a `function(x, data)` that is compiled once for all `data` (a pytree of
    arrays) of one shape.

    `function` maps ((n, d), data) to (n,), is jax-traceable and pure, and is found again by its hash. Where it is a
    `KeptCosts`, programs around it outlive the process.
    """

    function: Callable[[Array, Any], Array]
    data: Any

    def __call__(self, x: Array) -> Array:
        return self.function(x, self.data)


@dataclass(frozen=True)
class KeptCosts:
    """Costs as `Objective` takes them, with programs around them that outlive the process.

    `keep(g, name, thing)` compiles a pure function g of arrays that calls `function`, and is described by `thing` apart
    from that; `keep_alone` one that does not call it.
    """

    function: Callable[..., Array]
    keep: Callable[[Callable, str, Any], Callable]
    keep_alone: Callable[[Callable, str, Any], Callable]

    def __call__(self, x: Array, *data: Any) -> Array:
        return self.function(x, *data)


@dataclass(frozen=True)
class RunResult:
    """One seeded run: plain values only, so that a store can keep it.

    `history` holds evaluations spent and best cost so far, both (k,), at each improvement and at
    the end.
    """

    method: str
    run: int
    seed: int
    x: np.ndarray
    cost: float
    evaluations: float
    seconds: float
    status: Status
    history_evaluations: np.ndarray
    history_cost: np.ndarray
    failures: int = 0  # candidates that could not be simulated
    extra: dict[str, Any] = field(default_factory=dict)


class Host(Protocol):
    """A method that drives itself."""

    needs: ClassVar[Needs]

    def run(self, key: Array, objective: Objective, budget: int, counter: Any) -> Status:
        """Minimise through `counter` (see `optimize.loop.counter.Counter`), which records and enforces the budget."""
        ...
