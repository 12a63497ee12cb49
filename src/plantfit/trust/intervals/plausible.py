"""Parameter values that the data allow: draws from the covariance of an answer, by the likelihood where they leave something open."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtri, stdtrit

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.problem import Problem
from plantfit.trust.heterogeneity.widened import effects
from plantfit.trust.intervals.kinds.likelihood_draws import by_likelihood
from plantfit.trust.intervals.linearised import Local, linearise
from plantfit.trust.intervals.parameter_rows import NOT_VISITED
from plantfit.trust.intervals.ranges import LEVEL

ROUNDS = 60  # of draws until enough of them are within limits
WIDE = 0.5  # of a value: a standard error above it is no bell's
LIKE = 0.99  # quantile of the costs of draws of what is determined, up to which draws of what is open are kept where no walk begins
POOL = 1000  # candidates of both kinds that walkers begin at


@dataclass(frozen=True)
class Plausible:
    """`values` (n, d) in the parameters' units, the answer itself first; `open` names what the data leave open, `accepted` is the
    share of the linearised draws whose cost the data allow (1 where nothing is open); `scatters` what also differs between recordings,
    `by_likelihood` whether the likelihood was followed, not the covariance."""

    names: tuple[str, ...]
    values: np.ndarray
    open: tuple[str, ...]
    accepted: float
    scatters: tuple[str, ...] = ()
    by_likelihood: bool = False


def plausible(
    problem: Problem, z: np.ndarray, rows: Sequence[Mapping[str, Any]], count: int, seed: int = 1, within: bool = False
) -> Plausible:
    """`count` draws around the cube point z (d,) and z itself; `rows` are the parameters of the findings at z.

    What has a standard error is drawn from a normal distribution with the correlations of the linearised problem, in logarithms where the
    search is in logarithms; stated errors of instruments widen it. Where recordings of the plant scatter, the draws are of the plant in
    another recording: the scatter is added, with its own correlations, and the tails are those of Student's t of so few recordings; with
    `within` they are cut where 95 % of each parameter lie. Where one is known roughly or not at all (status "weak", no standard error, or
    one above half of its value), all are drawn by the likelihood between the bounds of the search (`kinds/likelihood_draws.py`); what
    stated errors and scatter add comes on top. Tables, more than 60 coordinates and residuals worth too few independent samples give no
    likelihood: what is open is drawn evenly over the range of the findings then, all others moved with it as the linearised problem says,
    and a draw is kept where its cost is one that draws of the determined parts have too.
    Physical limits cut both. Raises SearchError where hardly a draw is left.
    """
    space, rng = problem.space, np.random.default_rng(seed)
    own = {r["name"]: r for r in rows}
    values = np.asarray(space.physical(np.asarray(z)), dtype=float)
    log = space.log & (values > 0)
    size = np.where(log, values, 1.0)  # of a move of 1 in the coordinate that is drawn
    local = linearise(problem, z)
    error, wide, between, degrees = np.zeros(len(values)), np.zeros(len(values), bool), np.zeros(len(values)), np.full(len(values), np.inf)
    low, high, loose = values.copy(), values.copy(), np.zeros(len(values), bool)
    for i, (name, c) in enumerate(zip(space.names, space.coordinates, strict=True)):
        row = own.get(name, {})
        stated = row.get("uncertainty") or {}
        sd = stated.get("combined") or row.get("standard_error")
        boxed = local.linear is None and row.get("at_bound") is None and row.get("status") != NOT_VISITED
        if boxed and not stated.get("combined"):  # tables: what the data leave open is drawn with the box as prior
            sd = min(sd or np.inf, float(local.standard_error[i]))
        low[i] = c.lower if row.get("low") is None else row["low"]
        high[i] = c.upper if row.get("high") is None else row["high"]
        loose[i] = local.linear is not None and row.get("status") == "weak"
        scatter = row.get("scatter")
        bent = log[i] and sd is not None and sd > WIDE * abs(values[i]) and not scatter
        wide[i] = sd is None or not np.isfinite(sd) or (row.get("open") is not None and not boxed) or bent
        error[i] = 0.0 if wide[i] or sd is None else float(sd)
        if scatter and not wide[i]:
            between[i], degrees[i] = scatter["between"], scatter["degrees"]
    error = error / size
    scatters = np.isfinite(degrees)
    own_covariance = local.covariance
    if np.any(scatters):
        own_covariance = own_covariance + scatter_covariance(problem, z, local)
        error = np.hypot(error, between / size)
    spread = _spread(own_covariance / size[:, None] / size[None, :], error)
    limits = np.array([[max(c.limits[0], 0.0) if k else c.limits[0], c.limits[1]] for c, k in zip(space.coordinates, log, strict=True)])
    hard = limits
    follow = _followers(problem, z, size, wide)
    least = np.where(log & (low <= 0), 1e-3 * values, low)
    here, *ends = (np.where(log, np.log(np.maximum(v, 1e-300)), v) for v in (values, least, high))
    limits = np.where(wide[:, None], np.stack([np.maximum(low, limits[:, 0]), np.minimum(high, limits[:, 1])], axis=1), limits)
    farthest = np.where(scatters & within, stdtrit(degrees, 0.5 + LEVEL / 2) * error, np.inf)  # of a move

    def tailed(move: np.ndarray) -> np.ndarray:
        if not np.any(scatters):
            return move
        few = np.where(scatters, degrees, 1.0)
        tails = np.sqrt(few / chdtri(few, rng.uniform(size=(len(move), 1))))  # Student's t of several variables, each with its own degrees
        return np.where(scatters, move * tails, move)

    def drawn(n: int, with_open: bool) -> np.ndarray:
        move = rng.standard_normal((n, len(values))) @ spread.T
        move = tailed(move)
        if with_open and np.any(wide):
            place = ends[0] + rng.uniform(size=(n, len(values))) * (ends[1] - ends[0])
            leads = rng.uniform(size=(n, len(values))) < 1.0 / np.sum(wide)
            leads[np.arange(n), rng.choice(np.flatnonzero(wide), n)] = True
            move = move + np.where(wide & leads, place - here, 0.0) @ follow.T
        found = np.where(log, values * np.exp(np.clip(move, -50, 50)), values + move)
        inside = np.all((found >= limits[:, 0]) & (found <= limits[:, 1]) & (np.abs(move) <= farthest), axis=1)
        return found[inside]

    kept, accepted = np.zeros((0, len(values))), 1.0
    walks = bool(np.any(wide | loose)) and local.linear is not None and local.linear.sound
    found = None
    if walks:
        even = drawn(POOL, False)  # over all of the box too: the straight line of the linearised problem leaves a bent valley
        for i in np.flatnonzero(wide | loose):
            a, b = max(space.coordinates[i].lower, hard[i, 0]), min(space.coordinates[i].upper, hard[i, 1])
            place = rng.uniform(size=len(even))
            even[:, i] = a * (b / a) ** place if log[i] and a > 0 else a + (b - a) * place
        found = by_likelihood(problem, z, local, drawn(100, False), np.concatenate([drawn(POOL, True), even]), log, count, rng)
    walks = found is not None
    if found is not None:
        kept, accepted = found
        stated = [bool((own.get(n, {}).get("uncertainty") or {}).get("combined")) for n in space.names]
        beside = np.sqrt(np.maximum(error**2 - (local.standard_error / size) ** 2, 0.0)) * (np.array(stated) | scatters)
        if np.any(beside > 0):
            move = tailed(rng.standard_normal(kept.shape) @ _spread(own_covariance / size[:, None] / size[None, :], beside).T)
            far = np.where(log, kept * np.exp(np.clip(move, -50, 50)), kept + move)
            inside = np.all((far >= hard[:, 0]) & (far <= hard[:, 1]) & (np.abs(move) <= farthest), axis=1)
            kept = np.where(inside[:, None], far, kept)
    tried, filtered = 0, bool(np.any(wide)) and not walks
    most = _allowed(problem, space, z, drawn(100, False)) if filtered else np.inf
    for _ in range(ROUNDS):
        if len(kept) >= count:
            break
        new = drawn(max(count, 64), True)
        tried += len(new)
        if filtered and len(new):
            new = new[_costs(problem, space, new) <= most]
        kept = np.concatenate([kept, new])
    if len(kept) < count:
        raise SearchError(
            f"Of {tried} draws of the parameters {len(kept)} have a cost that the data allow; the ranges of "
            f"{_few(space.names, wide)} are too wide "
            "and too bent to draw from. Hold one of them at a known value, or record again."
        )
    if filtered:
        accepted = min(1.0, len(kept) / tried)
    return Plausible(
        space.names,
        np.concatenate([values[None], kept[:count]]),
        tuple(n for n, w in zip(space.names, wide, strict=True) if w),
        accepted,
        tuple(n for n, s in zip(space.names, scatters, strict=True) if s),
        walks,
    )


def scatter_covariance(problem: Problem, z: np.ndarray, local: Local) -> np.ndarray:
    """How the answer z (d,) of all recordings moves with them: a covariance (d, d) in the units of the parameters."""
    residuals, jacobian = residuals_and_jacobian(problem.unsmoothed, np.asarray(z))
    slopes = np.asarray(problem.space.slopes(np.asarray(z)))
    return effects(problem, residuals, jacobian, local).covariance * np.outer(slopes, slopes)


def _few(names: Sequence[str], which: np.ndarray) -> str:
    return ", ".join([n for n, w in zip(names, which, strict=True) if w][:6])


def _spread(covariance: np.ndarray, error: np.ndarray) -> np.ndarray:
    """A root (d, d) of the covariance with these standard errors and the correlations of another."""
    known = error > 0
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    with np.errstate(all="ignore"):
        correlation = np.where(known[:, None] & known[None, :], covariance / np.outer(size, size), 0.0)
    correlation = np.nan_to_num(0.5 * (correlation + correlation.T))
    np.fill_diagonal(correlation, known.astype(float))
    values, vectors = np.linalg.eigh(correlation)
    return error[:, None] * (vectors * np.sqrt(np.maximum(values, 0.0)))


def _followers(problem: Problem, z: np.ndarray, size: np.ndarray, wide: np.ndarray) -> np.ndarray:
    """How all others (d, d) move for the least cost when one that is open moves by 1: -(J_k'J_k)^+ J_k'J_o, in columns."""
    found = np.zeros((len(wide), len(wide)))
    if not np.any(wide):
        return found
    _, jacobian = residuals_and_jacobian(problem.unsmoothed, np.asarray(z))
    j = jacobian / problem.space.slopes(np.asarray(z)) * size
    for k in np.flatnonzero(wide):
        others = np.arange(len(wide)) != k
        found[others, k] = -np.linalg.lstsq(j[:, others], j[:, k], rcond=1e-8)[0]
        found[k, k] = 1.0
    return found


def _costs(problem: Problem, space: Any, values: np.ndarray) -> np.ndarray:
    with np.errstate(all="ignore"):
        cube = np.nan_to_num(space.cube(values), nan=0.5)
    return np.nan_to_num(np.asarray(problem.costs(cube)), nan=np.inf)


def _allowed(problem: Problem, space: Any, z: np.ndarray, determined: np.ndarray) -> float:
    """The cost up to which draws count: what errors of the determined parameters alone cost, at least that of a parameter's 95 %."""
    here = float(problem.cost(np.asarray(z)))
    samples = sum(len(e.recording) for e in problem.experiments.values())
    least = here * (1.0 + 4.0 / max(samples, 1))
    if not len(determined):
        return least
    return max(least, float(np.quantile(_costs(problem, space, determined), LIKE)))
