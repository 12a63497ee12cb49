"""Draws of the parameters by the likelihood of the data, from costs alone: where an ellipsoid says nothing."""

from collections.abc import Callable, Iterator

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.linearised import Local, residual_blocks
from plantfit.trust.intervals.ranges import effective_samples

LIKE = 0.99  # quantile of the costs of draws of what is determined, up to which all starts are equal
WALKERS = 128  # at least, and four for each coordinate
SWEEPS, BETWEEN = 100, 20  # moves of each walker before the first draws are taken, and between those and the next
FEW = 2  # times as many different starts as coordinates are needed


def by_likelihood(
    problem: Problem,
    z: np.ndarray,
    local: Local,
    near: np.ndarray,
    pool: np.ndarray,
    log: np.ndarray,
    count: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, float] | None:
    """`count` draws (count, d) around the cube point z (d,) in the parameters' units, and the share of `pool` whose
    cost the data allow.

    The prior is flat between the bounds of the search, in logarithms where `log` (d,). With residuals that are worth n
    independent samples and a standard deviation that is not known the likelihood is the cost to the power -n / 2
    (Gelman et al., Bayesian Data Analysis, 3rd ed., section 14.2). Walkers begin in the `pool` (k, d): with equal
    chance up to the cost that draws `near` (m, d) of what is determined have, else by the likelihood. None where too
    few of the pool can be simulated.
    """
    space, d, half = problem.space, len(log), max(WALKERS // 2, 2 * len(log))
    residuals = np.asarray(problem.residuals(np.asarray(z)))
    samples = effective_samples(residuals, residual_blocks(problem), d)[0] if local.robust else float(len(residuals))
    low = np.array([max(c.lower, c.limits[0]) for c in space.coordinates])
    high = np.array([min(c.upper, c.limits[1]) for c in space.coordinates])
    here = float(problem.cost(np.asarray(z)))
    share = max(1, len(residuals) - d) / max(1, len(residuals))
    # rounding where a fit is exact
    noise = max(here, 1e-300) if local.linear is None else max(here, local.linear.variance * share)

    def grown(values: np.ndarray) -> np.ndarray:
        """The cost beyond the answer's over the noise (n,), infinite outside the bounds. Batches have one size: one
        program serves."""
        inside = np.all((values >= low) & (values <= high), axis=1)
        with np.errstate(all="ignore"):
            cube = np.nan_to_num(space.cube(np.where(inside[:, None], values, local.values)), nan=0.5)
        cube = np.concatenate([cube, np.repeat(cube[:1], -len(cube) % half, axis=0)])
        costs = np.concatenate([np.asarray(problem.costs(cube[k : k + half])) for k in range(0, len(cube), half)])[
            : len(values)
        ]
        return np.where(inside, np.nan_to_num((costs - here) / noise, nan=np.inf), np.inf)

    def log_likelihood(growth: np.ndarray) -> np.ndarray:
        return -0.5 * samples * np.log(np.maximum(1.0 + growth, 1e-300))

    def log_density(x: np.ndarray) -> np.ndarray:
        return log_likelihood(grown(values_of(x)))

    def values_of(x: np.ndarray) -> np.ndarray:
        return np.where(log, np.exp(np.clip(x, -700.0, 700.0)), x)

    costs_near = grown(near) if len(near) else np.zeros(0)
    most = float(np.quantile(costs_near[np.isfinite(costs_near)], LIKE)) if np.any(np.isfinite(costs_near)) else 0.0
    most = max(most, 4.0 / max(samples, 1.0))
    growth = grown(pool)
    usable = np.flatnonzero(np.isfinite(growth))
    if len(usable) < FEW * d + 2:
        return None
    # the largest are a draw without replacement
    chance = log_likelihood(np.maximum(growth[usable], most)) + rng.gumbel(size=len(usable))
    begin = np.resize(usable[np.argsort(-chance, kind="stable")], 2 * half)
    starts = pool[begin]
    x = np.where(log, np.log(np.where(log, starts, 1.0)), starts)
    found: list[np.ndarray] = []
    for drawn in walked(log_density, x, SWEEPS, BETWEEN, int(rng.integers(2**32))):
        found.append(values_of(drawn))
        if len(found) * 2 * half >= count:
            break
    return np.concatenate(found)[:count], float(np.mean(growth <= most))


def walked(
    log_density: Callable[[np.ndarray], np.ndarray], starts: np.ndarray, sweeps: int, between: int, seed: int
) -> Iterator[np.ndarray]:
    """Walkers (w, d), w even, after `sweeps` moves of each from `starts` (w, d), and again after `between` more,
    without end.

    Half of the moves are stretches (Goodman and Weare, Comm. App. Math. Comp. Sci. 5 (2010) 65), half are differences
    of two walkers (Nelson et al., Astrophys. J. Suppl. 210 (2014) 11), a tenth of these the whole difference, from one
    hill of the density to another. `log_density` (n, d) -> (n,) is minus infinity where there is none.
    """
    import emcee  # half a second to import, and rarely needed

    moves = [(emcee.moves.StretchMove(), 0.5), (emcee.moves.DEMove(), 0.45), (emcee.moves.DEMove(gamma0=1.0), 0.05)]
    sampler = emcee.EnsembleSampler(*starts.shape, log_density, moves=moves, vectorize=True)
    sampler.random_state = np.random.RandomState(seed).get_state()
    state = sampler.run_mcmc(starts, sweeps, skip_initial_state_check=True, store=False)
    while True:
        yield np.array(state.coords)
        state = sampler.run_mcmc(state, between, skip_initial_state_check=True, store=False)
