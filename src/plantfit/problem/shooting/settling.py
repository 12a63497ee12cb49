"""Linear models whose deviations grow nowhere in the box."""

from functools import lru_cache

import numpy as np

from plantfit.native.kept_programs import Kept, kept
from plantfit.problem.problem import Problem
from plantfit.simulate.simulator import Drive, Simulator
from plantfit.simulate.steps.structure import is_linear
from plantfit.sobol import Sobol

import jax
import jax.numpy as jnp

POINTS = 256  # of the box, and as many corners, at which a linear model is asked whether it is stable
SLOW = 0.3 * np.log(1e3)  # growth, as a logarithm, that is far from forgetting the start


def settles(problem: Problem) -> bool:
    """Whether the model is linear and stable in the box, or grows too slowly to forget: a deviation follows x' = A x
    then, wherever the states are and whatever drives them. A is asked for at corners and at Sobol points."""
    if not problem.predictor.has_steps or not problem.predictor.stepping().vector.model.smooth:
        return False
    simulator, space = problem.predictor.stepping(), problem.space
    if simulator.vector.model.state_delays or not is_linear(simulator.vector):
        return False
    drives = {n: d for n, d in problem.data["drive"].items() if isinstance(d, Drive)}
    longest = max((float(d.t[-1] - d.t[0]) for d in drives.values()), default=0.0)
    inside = Sobol(space.dimension, np.random.default_rng(0)).random(POINTS)
    values = np.asarray(space.physical(np.concatenate([inside, np.round(inside)])))
    slopes, own = _slopes(simulator), any(c.recording is not None for c in space.coordinates)
    for name in drives if own else list(drives)[:1]:
        trees = [space.tree(v, name) for v in values]
        a = np.asarray(slopes({n: np.stack([np.asarray(tree[n], dtype=float) for tree in trees]) for n in trees[0]}))
        if not np.all(np.isfinite(a)) or np.max(np.linalg.eigvals(a).real) * longest > SLOW:
            return False
    return True


@lru_cache(maxsize=16)
def _slopes(simulator: Simulator) -> Kept:
    """The derivatives (k, n, n) of a linear model's rates by its states, of parameters that each have k rows."""
    vector = simulator.vector
    n, inputs = len(vector.states), (jnp.zeros(()),) * len(vector.channels)

    def slopes(p):
        return jax.jacfwd(lambda x: jnp.stack(vector.rate(tuple(x), inputs, simulator.positional(p))))(jnp.zeros(n))

    return kept(jax.vmap(slopes), "slopes by states", vector.model)
