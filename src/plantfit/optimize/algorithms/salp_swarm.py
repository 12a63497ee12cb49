"""Salp swarm algorithm: as published, as in the paper, and without its dependence on where the box lies."""

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import Facts, Info, Needs
from plantfit.optimize.settings import choice, integer, number

import jax
import jax.numpy as jnp
from jax import Array

REACH = 64  # salps up the chain; farther ones weigh less than 2^-64


class Chain(NamedTuple):
    """Salps (n, d) in the order of the chain, the food (d,) and its cost, and the schedule."""

    x: Array
    food: Array
    food_f: Array
    offset: Array  # (d,), the lower bound in units of the range; 0 when it plays no part
    generation: Array
    horizon: Array  # generations that the budget allows


def follow(x: Array, leaders: int) -> Array:
    """Every salp behind the leaders halfway to the one before it, which has moved already.

    y_i = (x_i + y_{i-1}) / 2 in turn is y_i = sum_k x_{i-k} 2^-(k+1) with a leader's position counted double;
    doubling the length of the sum takes log2 steps instead of one per salp.
    """
    y = jnp.concatenate([x[leaders - 1 : leaders], x[leaders:] / 2])
    length = 1
    while length < min(len(y), REACH):
        y = y + 0.5**length * jnp.pad(y[:-length], ((length, 0), (0, 0)))
        length *= 2
    return jnp.concatenate([x[:leaders], y[1:]])


@dataclass(frozen=True)
class SalpSwarm:
    """Salp swarm algorithm (Mirjalili, Gandomi, Mirjalili, Saremi, Faris and Mirjalili 2017, Advances in Engineering
    Software 114:163, eq. 3.1, 3.2 and 3.4).

    Leaders jump around the food, the best point so far: F_j +- c1 ((ub_j - lb_j) c2 + lb_j), c2 uniform and the sign
    random for every coordinate, c1 = 2 exp(-(4 l / L)^2). Every other salp moves halfway towards the one before it. All
    are then clipped to the box. l counts generations and L is how many the budget allows: runs of different budgets
    are different methods.

    `variant` "published" follows the authors' program: the first half of the chain leads and l starts at 2. "paper"
    follows the printed equations: one leader, l starts at 1, and the sign, tested as c3 >= 0, is always plus.
    Both read the bounds in units: the + lb_j makes jumps depend on where the box lies. On a 10-D sphere "published"
    ends at 3e-12 in [-5, 5] and at 3e-9 in [100, 110], "paper" at 2e-2 and 1.1; on pure noise 34 % of the final
    coordinates of "published" lie exactly on a bound in [100, 110] (8 % in [-5, 5]). "shift_invariant" is "published"
    without the lb_j and ends at 1e-11 in every box; its clipped jumps still leave 11 % of the final coordinates on a
    bound on noise. Castelli, Manzoni, Mariot, Nobile and Tangherloni 2022 (Expert Systems with Applications 189:116029)
    describe these flaws; use another method unless a result must be replicated. Parameters searched on a log scale are
    taken as linear. `leaders` is the share of the chain that leads, at least one salp: half in the authors' program,
    varied by Aljarah, Mafarja, Heidari, Faris, Zhang and Mirjalili 2018 (Applied Soft Computing 71:964). "paper" has
    one leader whatever it says.
    """

    needs: ClassVar[Needs] = Needs(schedule_bound=True, raw_box=True, minimum_population=2)
    population: int = integer(50, 2, 100_000, "salps")
    variant: str = choice(
        "published",
        ("published", "paper", "shift_invariant"),
        "published: the authors' program; paper: the printed equations; "
        "shift_invariant: jumps do not depend on where the box lies",
    )
    leaders: float = number(
        0.5, 0.0, 1.0, "share of the chain that leads, at least one salp; not in variant paper, which has one"
    )

    def __post_init__(self) -> None:
        if self.variant == "shift_invariant":
            object.__setattr__(self, "needs", Needs(schedule_bound=True, minimum_population=2))

    def rows(self, facts: Facts) -> int:
        return self.population

    def init(self, key: Array, facts: Facts) -> Chain:
        x = jax.random.uniform(key, (self.population, facts.dimension))
        offset = jnp.zeros(facts.dimension)
        if self.variant != "shift_invariant":
            assert facts.lower is not None  # the loop checks Needs.raw_box
            assert facts.upper is not None
            offset = jnp.asarray(facts.lower / (facts.upper - facts.lower))
        horizon = jnp.asarray(facts.budget // self.population)
        return Chain(x, x[0], jnp.asarray(jnp.inf), offset, jnp.zeros((), int), horizon)

    def ask(self, key: Array, state: Chain) -> tuple[Array, Chain]:
        x = jnp.where(state.generation == 0, state.x, jnp.clip(self._move(key, state), 0.0, 1.0))
        return x, state

    def _move(self, key: Array, state: Chain) -> Array:
        paper = self.variant == "paper"
        leaders = 1 if paper else max(1, math.floor(self.leaders * self.population))
        count = state.generation if paper else state.generation + 1
        c1 = 2 * jnp.exp(-((4 * count / state.horizon) ** 2))  # eq. 3.2
        c2, c3 = jax.random.uniform(key, (2, leaders, len(state.food)))
        jump = c1 * (c2 + state.offset)
        if not paper:
            jump = jnp.where(c3 < 0.5, jump, -jump)
        return follow(state.x.at[:leaders].set(state.food + jump), leaders)  # eq. 3.1 and 3.4

    def tell(self, state: Chain, x: Array, f: Array) -> tuple[Chain, Info]:
        best = jnp.argmin(f)
        better = f[best] < state.food_f
        food, food_f = jnp.where(better, x[best], state.food), jnp.where(better, f[best], state.food_f)
        return state._replace(x=x, food=food, food_f=food_f, generation=state.generation + 1), {}
