"""Draws of the parameters from their posterior, by NUTS (blackjax)."""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import MissingExtra
from plantfit.native.kept_programs import Kept, described
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.first_values import first_value_effects
from plantfit.trust.intervals.kinds.noise import OutputNoise, log_likelihood
from plantfit.trust.intervals.linearised import residual_blocks

import jax
import jax.numpy as jnp

CHAINS = 4
WARM = 400  # steps that adapt step size and metric, from one that the linearised problem gives
CHUNK = 50  # draws between two words of progress
DOUBLINGS = 8  # of a trajectory at most
INSIDE = 1e-3  # of the cube, from the bounds, where chains begin
LOGISTIC = 0.3  # precision of a logistic variable: what flat priors are on the sampled scale


@dataclass(frozen=True)
class Draws:
    """`values` (chains, draws, d) in the parameters' units, with R-hat and effective sample size (d,) and which
    trajectories diverged (chains, draws)."""

    values: np.ndarray
    log_density: np.ndarray
    r_hat: np.ndarray
    effective: np.ndarray
    diverging: np.ndarray


def need_blackjax() -> None:
    """Raise MissingExtra where blackjax is not installed."""
    if sys.modules.get("blackjax", True) is None or find_spec("blackjax") is None:
        raise MissingExtra("A posterior needs the package blackjax; install it with: pip install 'plantfit[posterior]'")


def posterior(
    problem: Problem, z: np.ndarray, noises: Sequence[OutputNoise], priors: Mapping[int, tuple[float, float]], *,
    chains: int = CHAINS, draws: int = 1000, seed: int = 1, tell: Callable[[int, int], None] = lambda done, of: None,
) -> Draws:  # fmt: skip
    """Draws around the cube point z (d,): the likelihood of `noises`, flat priors on the scale of the search within the
    bounds, and normal ones where `priors` has (mean, standard deviation) by number. Raises MissingExtra where blackjax
    is not installed.

    Starts that the fit has estimated are free: in each draw those that fit it best, to first order about z. The cube is
    mapped to the whole space by logits and rotated to the linearised problem's axes, so that the metric begins near its
    best. (Hoffman and Gelman, J. Mach. Learn. Res. 15 (2014) 1593.)
    """
    need_blackjax()
    from blackjax.diagnostics import effective_sample_size, potential_scale_reduction

    begin = np.clip(z, INSIDE, 1.0 - INSIDE)
    columns, onto = _starts(problem.unsmoothed, z, noises)
    origin, axes = np.log(begin / (1 - begin)), _axes(problem, begin, noises, priors, columns, onto)
    given = _Given(origin, axes, problem.unsmoothed.arguments, *_places(noises), columns, onto)
    key = jax.random.key(seed)
    start_key, warm_key, draw_key = jax.random.split(key, 3)
    positions = jax.random.normal(start_key, (chains, len(z)))
    total = WARM + draws
    tell(0, total)

    adapted, some = _programs(problem, noises, priors)
    states, steps, metrics = adapted(given, jax.random.split(warm_key, chains), positions)
    tell(WARM, total)
    found, done = [], 0
    while done < draws:
        keys = jax.vmap(lambda k: jax.random.split(k, CHUNK))(
            jax.random.split(jax.random.fold_in(draw_key, done), chains)
        )
        states, out = some(given, keys, states, steps, metrics)
        found.append([np.asarray(o) for o in out])
        done += CHUNK
        tell(min(WARM + done, total), total)
    u, log_density, diverged = (np.concatenate(parts, axis=1)[:, :draws] for parts in zip(*found, strict=True))
    cube = 1.0 / (1.0 + np.exp(-(origin + u @ axes.T)))
    values = np.asarray(problem.space.physical(cube.reshape(-1, len(z)))).reshape(cube.shape)
    half = draws // 2
    split = np.concatenate([u[:, :half], u[:, half : 2 * half]])  # halves of chains: a drift within one shows too
    return Draws(
        values,
        log_density,
        np.asarray(potential_scale_reduction(split)),
        np.asarray(effective_sample_size(split)),
        diverged,
    )


def _programs(
    problem: Problem, noises: Sequence[OutputNoise], priors: Mapping[int, tuple[float, float]]
) -> tuple[Kept, Kept]:
    """Chains that adapt themselves, and `CHUNK` draws of each. Records and noise are arguments: other records of this
    shape have the same programs."""
    import blackjax

    density = _density(problem, noises, priors)

    def adapted(given: _Given, key: Any, position: Any) -> Any:
        warm = blackjax.window_adaptation(blackjax.nuts, partial(density, given), max_num_doublings=DOUBLINGS)
        (state, found), _ = warm.run(key, position, num_steps=WARM)
        return state, found["step_size"], found["inverse_mass_matrix"]

    def some(given: _Given, keys: Any, state: Any, step: Any, metric: Any) -> Any:
        kernel = blackjax.nuts(
            partial(density, given), step_size=step, inverse_mass_matrix=metric, max_num_doublings=DOUBLINGS
        )

        def one(state: Any, key: Any) -> Any:
            state, info = kernel.step(key, state)
            return state, (state.position, state.logdensity, info.is_divergent)

        return jax.lax.scan(one, state, keys)

    evaluate = problem.unsmoothed.compiled["residuals_and_jacobian"]
    rest = evaluate.description, [n.order for n in noises], dict(priors), version("blackjax")
    description = None if evaluate.description is None else described(rest)
    return (
        Kept(jax.vmap(adapted, (None, 0, 0)), "posterior adapted", description, careful=True),
        Kept(jax.vmap(some, (None, 0, 0, 0, 0)), "posterior draws", description, careful=True),
    )


class _Given(NamedTuple):
    """Numbers of a density: origin (d,) and axes (d, d) of its scale, the problem's recordings, rows of residuals
    for each output, and what starts do to residuals, with how they follow from these (`_starts`)."""

    origin: Any
    axes: Any
    arguments: Any
    rows: Any
    lagged: Any
    columns: Any
    onto: Any


def _starts(problem: Problem, z: np.ndarray, noises: Sequence[OutputNoise]) -> tuple[np.ndarray, np.ndarray]:
    """What starts that the fit has estimated do to the residuals (m, l), by standard deviations of their noise, and
    what gives (l, m) the likeliest of them, with the sign turned, under the noise at z (d,)."""
    r = residuals_and_jacobian(problem, z)[0]
    begins = first_value_effects(problem, z, residual_blocks(problem)) if problem.start_corrections else None
    columns = np.zeros((len(r), 0)) if begins is None else begins.estimated
    seen, back = np.zeros((columns.shape[1],) * 2), np.zeros(columns.shape[::-1])
    for noise in noises if columns.shape[1] else ():
        phi = np.linalg.lstsq(r[noise.lagged], r[noise.rows], rcond=None)[0] if noise.order else np.zeros(0)
        left = r[noise.rows] - r[noise.lagged] @ phi
        whitened = columns[noise.rows] - np.tensordot(phi, np.swapaxes(columns[noise.lagged], 0, 1), 1)
        weight = len(left) / max(float(left @ left), 1e-300)
        seen += weight * whitened.T @ whitened
        np.add.at(back.T, noise.rows, weight * whitened)
        for k, own in enumerate(phi):
            np.add.at(back.T, noise.lagged[:, k], -weight * own * whitened)
    if begins is not None:
        seen += np.diag(begins.known)
    return columns, np.linalg.pinv(seen) @ back


def _places(noises: Sequence[OutputNoise]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    return [n.rows for n in noises], [n.lagged for n in noises]


def _density(
    problem: Problem, noises: Sequence[OutputNoise], priors: Mapping[int, tuple[float, float]]
) -> Callable[[_Given, jax.Array], jax.Array]:
    """The log density of a position (d,) on the rotated scale; minus infinity where the plant cannot be simulated."""
    evaluate, space = problem.unsmoothed.compiled["residuals_and_jacobian"], problem.space

    def of_residuals(given: _Given, r: jax.Array) -> jax.Array:
        own = [
            replace(n, rows=rows, lagged=lagged)
            for n, rows, lagged in zip(noises, given.rows, given.lagged, strict=True)
        ]
        return log_likelihood(own, r - given.columns @ (given.onto @ r))

    @jax.custom_vjp
    def likelihood(z: jax.Array, given: _Given) -> jax.Array:
        return of_residuals(given, evaluate(z, given.arguments)[0])

    def forward(z: jax.Array, given: _Given) -> Any:
        r, jacobian = evaluate(z, given.arguments)
        value, back = jax.value_and_grad(partial(of_residuals, given))(r)
        good = jnp.isfinite(value) & jnp.all(jnp.isfinite(jacobian))
        return jnp.where(good, value, -jnp.inf), jnp.where(good, back @ jacobian, 0.0)

    likelihood.defvjp(forward, lambda slope, g: (g * slope, None))

    def density(given: _Given, u: jax.Array) -> jax.Array:
        q = given.origin + given.axes @ u
        z = jax.nn.sigmoid(q)
        total = likelihood(z, given) + jnp.sum(jax.nn.log_sigmoid(q) + jax.nn.log_sigmoid(-q))
        if priors:
            values = space.physical(z)
            for k, (mean, deviation) in priors.items():
                c = space.coordinates[k]
                total = total - 0.5 * ((values[k] - mean) / deviation) ** 2
                # a density over values, not over their logarithms
                total = total + (jnp.log(values[k]) if c.log else 0.0)
        return jnp.where(jnp.isnan(total), -jnp.inf, total)

    return density


def _axes(
    problem: Problem, z: np.ndarray, noises: Sequence[OutputNoise], priors: Mapping[int, tuple[float, float]],
    columns: np.ndarray, onto: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Columns (d, d) of one standard deviation each on the scale of logits, of the linearised problem."""
    r, jacobian = (rows - columns @ (onto @ rows) for rows in residuals_and_jacobian(problem.unsmoothed, z))
    information = LOGISTIC * np.eye(len(z))
    onto = z * (1.0 - z)  # of the cube for a move of the logit
    for noise in noises:
        y, J, X = r[noise.rows], jacobian[noise.rows] * onto, r[noise.lagged]
        if noise.order:
            phi = np.linalg.lstsq(X, y, rcond=None)[0]
            y, J = y - X @ phi, J - np.tensordot(phi, np.swapaxes(jacobian[noise.lagged], 0, 1), 1) * onto
        information += J.T @ J * (len(y) / max(float(y @ y), 1e-300))
    slopes = problem.space.slopes(z) * onto
    for k, (_, deviation) in priors.items():
        information[k, k] += (slopes[k] / deviation) ** 2
    values, vectors = np.linalg.eigh(information)
    return vectors / np.sqrt(values)
