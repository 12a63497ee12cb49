"""Parameter values that the data allow: draws from the covariance of an answer, by the likelihood where they leave
something open."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtri, stdtrit

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.problem import Problem
from plantfit.space import Coordinate
from plantfit.trust.finish.unknown_noise import as_known
from plantfit.trust.heterogeneity.widened import effects
from plantfit.trust.intervals.kinds.likelihood_draws import by_likelihood
from plantfit.trust.intervals.linearised import Local, linearise
from plantfit.trust.intervals.parameter_rows import NOT_VISITED
from plantfit.trust.intervals.ranges import LEVEL

ROUNDS = 60  # of draws until enough of them are within limits
# further rounds of so many draws, where at least such a share has a cost that the data allow
MORE_ROUNDS, MANY, FEW_KEPT = (40, 4096, 0.02)
WIDE = 0.5  # of a value: a standard error above it is no bell's
# quantile of the costs of draws of what is determined, up to which draws of what is open are kept where no walk begins
LIKE = 0.99
POOL = 1000  # candidates of both kinds that walkers begin at


@dataclass(frozen=True)
class Plausible:
    """`values` (n, d) in the parameters' units, the answer itself first; `open` names what the data leave open,
    `accepted` is the share of the linearised draws whose cost the data allow (1 where nothing is open); `scatters`
    what also differs between recordings, `by_likelihood` whether the likelihood was followed, not the covariance."""

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

    What has a standard error is drawn from a normal distribution with the correlations of the linearised problem, in
    logarithms where the search is in logarithms; stated errors of instruments widen it. Where recordings of the plant
    scatter, the draws are of the plant in another recording: the scatter is added, with its own correlations, and the
    tails are those of Student's t of so few recordings; with `within` they are cut where 95 % of each parameter lie.
    Where one is known roughly or not at all (status "weak", no standard error, or one above half of its value), all are
    drawn by the likelihood between the bounds of the search (`kinds/likelihood_draws.py`); what stated errors and
    scatter add comes on top. Tables, more than 60 coordinates and residuals worth too few independent samples give no
    likelihood: what is open is drawn evenly over the range of the findings then, all others moved with it as the
    linearised problem says, and a draw is kept where its cost is one that draws of the determined parts have too.
    Physical limits cut both. Raises SearchError where hardly a draw is left.
    """
    problem = as_known(problem)
    around = _Around.of(problem, np.asarray(z), rows, np.random.default_rng(seed), within)
    known, kept, accepted, walks = around.known, np.zeros((0, len(around.values))), 1.0, False
    if np.any(known.wide | known.loose) and around.local.linear is not None and around.local.linear.sound:
        pool, near = around.even(), around.drawn(100, False)
        pool = np.concatenate([around.drawn(POOL, True), pool])
        found = by_likelihood(problem, z, around.local, near, pool, around.log, count, around.rng)
        if found is not None:
            walks, kept, accepted = True, around.with_stated(found[0]), found[1]
    if not walks:
        kept, accepted = _by_covariance(problem, around, np.asarray(z), count)
    return Plausible(
        problem.space.names,
        np.concatenate([around.values[None], kept[:count]]),
        tuple(n for n, w in zip(problem.space.names, known.wide, strict=True) if w),
        accepted,
        tuple(n for n, s in zip(problem.space.names, known.scatters, strict=True) if s),
        walks,
    )


@dataclass(frozen=True)
class _Known:
    """What the findings say of each parameter, arrays (d,) in the parameters' units."""

    error: np.ndarray  # standard error of a bell, 0 where there is none
    low: np.ndarray
    high: np.ndarray
    wide: np.ndarray  # whether no bell describes it
    loose: np.ndarray  # whether it is known roughly only
    between: np.ndarray  # scatter between recordings
    degrees: np.ndarray  # of freedom of that, infinite where nothing scatters
    stated: np.ndarray  # whether errors of instruments are stated

    @property
    def scatters(self) -> np.ndarray:
        return np.isfinite(self.degrees)

    @classmethod
    def of(
        cls, problem: Problem, rows: Sequence[Mapping[str, Any]], local: Local, values: np.ndarray, log: np.ndarray
    ) -> "_Known":
        own = {r["name"]: r for r in rows}
        told = [
            cls._one(c, own.get(c.name, {}), local, i, values[i], log[i])
            for i, c in enumerate(problem.space.coordinates)
        ]
        return cls(*(np.array(column) for column in zip(*told, strict=True)))

    @staticmethod
    def _one(
        c: Coordinate, row: Mapping[str, Any], local: Local, i: int, value: float, log: bool
    ) -> tuple[float | bool, ...]:
        """The fields of one parameter, in their order."""
        stated, scatter = (row.get("uncertainty") or {}).get("combined"), row.get("scatter")
        sd = stated or row.get("standard_error")
        boxed = local.linear is None and row.get("at_bound") is None and row.get("status") != NOT_VISITED
        if boxed and not stated:  # tables: what the data leave open is drawn with the box as prior
            sd = min(sd or np.inf, float(local.standard_error[i]))
        bent = log and sd is not None and sd > WIDE * abs(value) and not scatter
        wide = sd is None or not np.isfinite(sd) or (row.get("open") is not None and not boxed) or bent
        low, high = (
            bound if row.get(end) is None else row[end] for end, bound in (("low", c.lower), ("high", c.upper))
        )
        loose = local.linear is not None and row.get("status") == "weak"
        between, degrees = (scatter["between"], scatter["degrees"]) if scatter and not wide else (0.0, np.inf)
        return 0.0 if wide or sd is None else float(sd), low, high, bool(wide), loose, between, degrees, bool(stated)


@dataclass(frozen=True)
class _Around:
    """Draws around the answer by its covariance; a move of 1 is a unit, or a factor of e where the search is in
    logarithms (`log`)."""

    problem: Problem
    local: Local
    rng: np.random.Generator
    known: _Known
    values: np.ndarray
    log: np.ndarray
    error: np.ndarray  # standard deviation of a move, the scatter between recordings in it
    covariance: np.ndarray  # of the values, the scatter in it
    hard: np.ndarray  # (d, 2) physical limits
    limits: np.ndarray  # (d, 2), and ranges of what is wide
    reach: tuple[np.ndarray, np.ndarray]  # moves to the ends of the ranges
    follow: np.ndarray
    farthest: np.ndarray  # of a move

    @classmethod
    def of(
        cls, problem: Problem, z: np.ndarray, rows: Sequence[Mapping[str, Any]], rng: np.random.Generator, within: bool
    ) -> "_Around":
        space, local = problem.space, linearise(problem, z)
        values = np.asarray(space.physical(z), dtype=float)
        log = space.log & (values > 0)
        known = _Known.of(problem, rows, local, values, log)
        size = np.where(log, values, 1.0)
        error, covariance = known.error / size, local.covariance
        if np.any(known.scatters):
            covariance = covariance + scatter_covariance(problem, z, local)
            error = np.hypot(error, known.between / size)
        hard = np.array(
            [
                [max(c.limits[0], 0.0) if k else c.limits[0], c.limits[1]]
                for c, k in zip(space.coordinates, log, strict=True)
            ]
        )
        ranged = np.stack([np.maximum(known.low, hard[:, 0]), np.minimum(known.high, hard[:, 1])], axis=1)
        least = np.where(log & (known.low <= 0), 1e-3 * values, known.low)
        here, low, high = (np.where(log, np.log(np.maximum(v, 1e-300)), v) for v in (values, least, known.high))
        return cls(
            problem, local, rng, known, values, log, error, covariance, hard,
            np.where(known.wide[:, None], ranged, hard),
            (low - here, high - here), _followers(problem, z, size, known.wide),
            np.where(known.scatters & within, stdtrit(known.degrees, 0.5 + LEVEL / 2) * error, np.inf),
        )  # fmt: skip

    def drawn(self, n: int, with_open: bool) -> np.ndarray:
        """Values of n draws that are within the limits; what is wide moves over its range, all others along, or
        stays."""
        move = self._moves((n, len(self.values)), self.error)
        wide = self.known.wide
        if with_open and np.any(wide):
            place = self.reach[0] + self.rng.uniform(size=move.shape) * (self.reach[1] - self.reach[0])
            leads = self.rng.uniform(size=move.shape) < 1.0 / np.sum(wide)
            leads[np.arange(n), self.rng.choice(np.flatnonzero(wide), n)] = True
            move = move + np.where(wide & leads, place, 0.0) @ self.follow.T
        found = self._moved(self.values, move)
        return found[self._inside(found, move, self.limits)]

    def even(self) -> np.ndarray:
        """Draws with what is open over all of the box: the straight line of the linearised problem leaves a bent
        valley."""
        found = self.drawn(POOL, False)
        for i in np.flatnonzero(self.known.wide | self.known.loose):
            c, place = self.problem.space.coordinates[i], self.rng.uniform(size=len(found))
            a, b = max(c.lower, self.hard[i, 0]), min(c.upper, self.hard[i, 1])
            found[:, i] = a * (b / a) ** place if self.log[i] and a > 0 else a + (b - a) * place
        return found

    def with_stated(self, values: np.ndarray) -> np.ndarray:
        """Draws by the likelihood (n, d) with what stated errors and scatter add, which no likelihood has."""
        noise = self.local.standard_error / np.where(self.log, self.values, 1.0)
        beside = np.sqrt(np.maximum(self.error**2 - noise**2, 0.0)) * (self.known.stated | self.known.scatters)
        if not np.any(beside > 0):
            return values
        move = self._moves(values.shape, beside)
        far = self._moved(values, move)
        return np.where(self._inside(far, move, self.hard)[:, None], far, values)

    def _moves(self, shape: tuple[int, ...], error: np.ndarray) -> np.ndarray:
        """Moves (n, d) with these standard deviations and the correlations of the covariance, tails of Student's t
        where few scatter."""
        size = np.where(self.log, self.values, 1.0)
        move = self.rng.standard_normal(shape) @ _spread(self.covariance / size[:, None] / size[None, :], error).T
        scatters = self.known.scatters
        if not np.any(scatters):
            return move
        few = np.where(scatters, self.known.degrees, 1.0)
        # of several variables, each with its own degrees
        tails = np.sqrt(few / chdtri(few, self.rng.uniform(size=(len(move), 1))))
        return np.where(scatters, move * tails, move)

    def _moved(self, values: np.ndarray, move: np.ndarray) -> np.ndarray:
        return np.where(self.log, values * np.exp(np.clip(move, -50, 50)), values + move)

    def _inside(self, values: np.ndarray, move: np.ndarray, limits: np.ndarray) -> np.ndarray:
        return np.all((values >= limits[:, 0]) & (values <= limits[:, 1]) & (np.abs(move) <= self.farthest), axis=1)


def _by_covariance(problem: Problem, around: _Around, z: np.ndarray, count: int) -> tuple[np.ndarray, float]:
    """Draws (count, d) by the covariance, what is wide over its range, and the share of those that the data allow."""
    space, wide = problem.space, around.known.wide
    kept, tried, filtered = np.zeros((0, len(z))), 0, bool(np.any(wide))
    most = _allowed(problem, space, z, around.drawn(100, False)) if filtered else np.inf
    for k in range(ROUNDS + MORE_ROUNDS):
        if len(kept) >= count or (k >= ROUNDS and len(kept) < FEW_KEPT * tried):
            break
        # of many coordinates most draws leave some limit: these cost nothing, so that many are made before it is given
        # up
        new = around.drawn(max(count, 64) if k < ROUNDS else MANY, True)
        tried += len(new)
        if filtered and len(new):
            new = new[_costs(problem, space, new) <= most]
        kept = np.concatenate([kept, new])
    if len(kept) < count:
        raise SearchError(
            f"Of {tried} draws of the parameters within their limits {len(kept)} have a cost "
            f"that the data allow; the ranges of {_few(space.names, wide)} are too wide and "
            "too bent to draw from. Hold one of them at a known value, or record again."
        )
    return kept, min(1.0, len(kept) / tried) if filtered else 1.0  # pyrefly: ignore[division-by-zero]  (there were rounds)


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
    """How all others (d, d) move for the least cost when one that is open moves by 1: -(J_k'J_k)^+ J_k'J_o, in
    columns."""
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
    """The cost up to which draws count: what errors of the determined parameters alone cost, at least that of a
    parameter's 95 %."""
    here = float(problem.cost(np.asarray(z)))
    samples = sum(len(e.recording) for e in problem.experiments.values())
    least = here * (1.0 + 4.0 / max(samples, 1))
    if not len(determined):
        return least
    return max(least, float(np.quantile(_costs(problem, space, determined), LIKE)))
