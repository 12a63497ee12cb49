"""How strongly tables are to be smoothed: by left-out pieces of the recordings, or by restricted maximum likelihood."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpaceError
from plantfit.findings.tables import SmoothedTable
from plantfit.problem.evaluate.smoothing import Key, Smoothing
from plantfit.problem.measure.long_run import inflation
from plantfit.problem.problem import Problem
from plantfit.trust.finish.smoothed_descent import Rows, descend
from plantfit.trust.intervals.linearised import Local, residual_blocks

FOLDS, PIECES = 5, 2  # left-out parts, and the pieces of each recording that one part has
# typical bends (box widths) that cross-validation compares, 0.3 to 3e-5
BENDS = tuple(10.0 ** (-0.5 - 0.5 * k) for k in range(9))
FINEST, COARSEST = 1e-6, 1e3  # typical bends that strengths stay between
# of restricted maximum likelihood: rounds at most, change of a strength's logarithm that ends them
ROUNDS, SETTLED = (60, 0.01)
STEPS = 3  # towards the answer in each round


@dataclass(frozen=True)
class Score:
    """What cross-validation found for one typical bend (box widths): mean square of the left-out residuals and its
    standard error."""

    bend: float
    score: float
    standard_error: float


@dataclass(frozen=True)
class Chosen:
    """A problem with the chosen strengths, its answer z (d,) from there, and the scores that cross-validation
    compared."""

    problem: Problem
    z: np.ndarray
    scores: tuple[Score, ...] = field(default=())


def choose_strengths(problem: Problem, z: np.ndarray) -> Chosen:
    """The strengths that the parameters' `smooth` asks for, near the answer z (d,); the problem itself where all are
    given.

    Tables with "reml" get one for each axis, tables with "cross-validated" one for all together, in which the others
    stay as they are.
    """
    ways = problem.smoothing.asked if problem.smoothing else {}
    reml, validated = ([n for n, way in ways.items() if way == wanted] for wanted in ("reml", "cross-validated"))
    found = Chosen(problem, np.asarray(z, dtype=float))
    if reml:
        found = by_reml(found.problem, found.z, reml)
    return by_cross_validation(found.problem, found.z, validated) if validated else found


def by_reml(problem: Problem, z: np.ndarray, names: Sequence[str] | None = None) -> Chosen:
    """Strengths of the tables `names` (all smoothed ones if None) by restricted maximum likelihood, one for each axis.

    With bends b of rows B, J'J of the data and S = sum of strength x B'B over all tables, until nothing changes

        strength <- strength phi (tr(S^- B'B) - tr((J'J + S)^-1 B'B)) / b'b

    (generalised Fellner-Schall: Wood and Fasiolo, Biometrics 73 (2017) 1071, eq. 4), each round near the answer to its
    strengths. phi is the variance of a residual times the factor by which correlation from sample to sample inflates
    that of a mean.
    """
    smoothing = _smoothing(problem)
    chosen = [key for key in smoothing.keys if names is None or key[0] in names]
    rows = Rows(problem)
    z = descend(rows, smoothing, z)
    for _ in range(ROUNDS):
        matrix = rows.normal_matrix(z)
        inverse = np.linalg.pinv(matrix + smoothing.matrix, rcond=1e-13, hermitian=True)
        phi = _noise(problem, z, float(np.sum(inverse * matrix)))
        moved = _fellner_schall(smoothing, chosen, z, phi, inverse)
        change = max(abs(np.log(moved[k] / smoothing.strengths[k])) for k in chosen)
        smoothing = smoothing.with_strengths(moved)
        z = descend(rows, smoothing, z, most=STEPS)
        if change < SETTLED:
            break
    return Chosen(problem.with_smoothing(smoothing.strengths), descend(rows, smoothing, z))


def _fellner_schall(
    smoothing: Smoothing, chosen: Sequence[Key], z: np.ndarray, phi: float, inverse: np.ndarray
) -> dict[Key, float]:
    """The strengths `chosen` one round later; `inverse` is (J'J + S)^-1."""
    all_rows, offset, place = smoothing.rows
    penalty = _pseudo_inverse(smoothing)
    bends, moved = all_rows @ z + offset, {}
    for key in chosen:
        here = place == smoothing.keys.index(key)
        rows, size = all_rows[here], float(np.sum(bends[here] ** 2))
        free = np.sum((rows @ penalty) * rows) - np.sum((rows @ inverse) * rows)
        now = smoothing.strengths[key] * phi * max(float(free), 0.0) / max(size, 1e-300)
        moved[key] = float(np.clip(now, phi / COARSEST**2, phi / FINEST**2))
    return moved


def _pseudo_inverse(smoothing: Smoothing) -> np.ndarray:
    """S^- (d, d), table by table; what bends of no axis see (a plane and its twist) is left out by its number of
    dimensions."""
    result = np.zeros((smoothing.dimension,) * 2)
    matrix = smoothing.matrix
    for own, unseen in smoothing.tables:
        values, vectors = np.linalg.eigh(matrix[np.ix_(own, own)])
        kept = vectors[:, unseen:]
        result[np.ix_(own, own)] = (kept / np.maximum(values[unseen:], 1e-300)) @ kept.T
    return result


def by_cross_validation(
    problem: Problem, z: np.ndarray, names: Sequence[str] | None = None, *, bends: Sequence[float] = BENDS
) -> Chosen:
    """One strength for the tables `names` (all smoothed ones if None): that with the least error in left-out pieces.

    Every recording is cut into `FOLDS x PIECES` pieces of equal length; each fifth is left out in turn, fitted without
    and simulated through (Stone, J. R. Statist. Soc. B 36 (1974) 111; pieces and not single samples, which their
    neighbours give away). `bends` are the candidates: a strength sigma^2/bend^2 takes bends of that standard deviation
    for likely.
    """
    smoothing = _smoothing(problem)
    chosen = [key for key in smoothing.keys if names is None or key[0] in names]
    rows, parts = Rows(problem), _parts(problem)
    variance = float(np.mean(np.asarray(problem.residuals(z)) ** 2))
    tried: list[tuple[Score, Smoothing, np.ndarray]] = []
    for bend in bends:
        candidate = smoothing.with_strengths({key: variance / bend**2 for key in chosen})
        z = descend(rows, candidate, z)
        errors = [_left_out(rows, candidate, z, parts == k) for k in range(FOLDS)]
        squares = np.concatenate(errors)
        means = np.array([np.mean(e) for e in errors])
        score = Score(float(bend), float(np.mean(squares)), float(np.std(means, ddof=1) / np.sqrt(FOLDS)))
        tried.append((score, candidate, z))
    _, best, z = min(tried, key=lambda t: t[0].score)
    return Chosen(problem.with_smoothing(best.strengths), z, tuple(t[0] for t in tried))


def _left_out(rows: Rows, smoothing: Smoothing, z: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Squared residuals of the rows `held` (m,) after a fit to the others."""
    without = descend(rows, smoothing, z, ~held)
    return rows.residuals(without)[held] ** 2


def _parts(problem: Problem) -> np.ndarray:
    """Which part (m,) each residual is left out with."""
    count = FOLDS * PIECES
    return np.concatenate(
        [np.arange(n) * count // n % FOLDS for b in residual_blocks(problem) if (n := b.rows.stop - b.rows.start)]
    )


def _noise(problem: Problem, z: np.ndarray, effective: float) -> float:
    """Variance that independent residuals with as many `effective` parameters would need for means as uncertain as
    these."""
    residuals = np.asarray(problem.residuals(z))
    blocks = residual_blocks(problem)
    inflated = sum(float(np.sum(residuals[b.rows] ** 2)) * inflation(residuals[b.rows], b.index) for b in blocks)
    return max(inflated / max(1.0, len(residuals) - effective), np.finfo(float).tiny)


def _smoothing(problem: Problem) -> Smoothing:
    if problem.smoothing is None:
        raise SpaceError("No parameter of this problem is smoothed; give a table smooth = 'reml' first.")
    return problem.smoothing


def typical_bends(problem: Problem, z: np.ndarray) -> dict[Key, float]:
    """By parameter and axis the bend (box widths) that its strength takes for likely: sigma/sqrt(strength), inf for
    none."""
    sigma = float(np.sqrt(np.mean(np.asarray(problem.residuals(z)) ** 2)))
    return {
        key: float(sigma / np.sqrt(s)) if s > 0 else float("inf") for key, s in _smoothing(problem).strengths.items()
    }


def smoothing_rows(problem: Problem, local: Local) -> list[SmoothedTable]:
    """Rows of the findings record, one for each smoothed table: strengths and typical bends by axis, and its
    effective entries."""
    if problem.smoothing is None:
        return []
    bends, rows = typical_bends(problem, problem.space.cube(local.values)), []
    for name in dict.fromkeys(key[0] for key in problem.smoothing.keys):
        own = [i for i, c in enumerate(problem.space.coordinates) if c.parameter == name]
        keys = [key for key in problem.smoothing.keys if key[0] == name]
        rows.append(
            SmoothedTable(
                name=name,
                over=[signal for _, signal in keys],
                strengths=[problem.smoothing.strengths[key] for key in keys],
                bends=[bends[key] if np.isfinite(bends[key]) else None for key in keys],
                chosen=problem.smoothing.asked.get(name, "given"),
                entries=len(own),
                effective=float(np.sum(local.effective[own])),
            )
        )
    return rows
