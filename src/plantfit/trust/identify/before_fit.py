"""Before any fit: how many combinations of the parameters the records can determine, in symbols, and what would have
to be known."""

from collections.abc import Iterator, Sequence
from itertools import combinations as choices
from itertools import islice

import numpy as np

from plantfit.errors import PlantfitError
from plantfit.problem.evaluate.points import residuals_and_jacobian, shared
from plantfit.problem.measure.scale_source import GIVEN
from plantfit.problem.problem import Problem
from plantfit.trust.finish.unknown_noise import LEAST_FREE, few_samples
from plantfit.trust.identify.before_fit_told import ROUGH, BeforeFit

POINTS = 8  # of the box
AGREE, DRAWN = 3, 4  # points that a formula rests on at least, and times the points that are drawn for that at most
NEAR = 0.3  # of the way to a random point: those about one that tells most
# of its bounds, where a parameter without effect at the points is looked at, at so many of them
ELSEWHERE, LOOKED = (0.02, 0.1, 0.25, 0.5, 0.75, 0.9, 0.98), 4
MOST = 40  # coordinates
RANK = 1e-8  # of the largest singular value of the sensitivities, each normed
SAME = 1e-6  # by which directions of points may differ that are the same
TOGETHER = 5  # parameters of one combination at most
SUBSETS = 20000
NOISE = 0.01  # of each output's standard deviation, for what is told of precision


def before_fit(problem: Problem, key: int = 0, points: int = POINTS) -> BeforeFit | None:
    """What the fitted samples of a problem can determine; None for more than `MOST` coordinates or where too few points
    can be simulated.

    The rank is that of the exact sensitivities by the logarithms of the parameters, the largest over `points` random
    points of the box (numpy's generator of `key`): what cannot be told apart anywhere cannot be told apart. Where a
    parameter has no effect at any of them it alone is moved over its bounds as well, as a limit may act elsewhere. A
    combination is named where its formula holds at all points of that rank, three at least: a product of powers where
    the open directions are the same in logarithms, a weighted sum where they are the same in the parameters themselves
    (Bellman and Astrom 1970, Mathematical Biosciences 7, for the notion; Stigter and Molenaar 2015, Automatica 58, for
    the rank of sensitivities).
    """
    space = problem.space
    d = space.dimension
    if not 1 <= d <= MOST or len({*space.names}) < d:
        return None
    own = problem.with_scales({o: NOISE * _spread(problem, o) for o in problem.outputs})
    drawn = np.random.default_rng(key).uniform(0.02, 0.98, (DRAWN * points, d))
    try:
        good = [f for f in (_at(own, z) for z in drawn[:points]) if f is not None]
        if len(good) < max(3, points // 2):
            return None
        lost, first = points - len(good), [p for p, _ in good]
        good += _moved_alone(own, drawn[: min(points, LOOKED)], good)
        for z in drawn[points:]:
            telling = _most_telling(good)
            if len(telling) >= AGREE:
                break
            near = space.cube(good[telling[0]][0])
            good += [f for f in (_at(own, near + NEAR * (z - near)),) if f is not None]
    except PlantfitError:
        return None
    telling, effect = _most_telling(good), _effect(good)
    seen, varies = np.flatnonzero(effect), len(telling) < len(good)
    used = [(p[seen], _open(j[:, seen]), j[:, seen]) for p, j in (good[i] for i in telling)]
    rank = len(seen) - used[0][1].shape[1]
    names = [space.names[i] for i in seen]
    agreed = len(used) >= AGREE
    alone, together = _named(names, used, rank) if agreed else ([], [])
    weights = np.max([np.max(np.abs(n), axis=1, initial=0.0) for _, n, _ in used], axis=0)
    loose = [k for k in range(len(names)) if weights[k] > SAME]
    fix = _fixes(names, [n for _, n, _ in used], loose)
    held = {*fix[0]} if fix else set()
    return BeforeFit(
        tuple(space.names), rank, tuple(alone), tuple(together), tuple(names[k] for k in loose),
        tuple(space.names[i] for i in np.flatnonzero(~effect)), tuple(fix), _rough(names, used, held), points,
        lost,
        *_heard(own, problem, key, points), _too_few(problem),
        _entries(problem, np.flatnonzero(~effect), first), varies, agreed,
    )  # fmt: skip


def _effect(good: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Which coordinates (d,) bool have an effect at any of the points (values (d,), sensitivities (k, d))."""
    return np.max([np.linalg.norm(j, axis=0) for _, j in good], axis=0) > 0


def _most_telling(good: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[int]:
    """The places of the points with the largest rank."""
    seen = np.flatnonzero(_effect(good))
    open_ = [_open(j[:, seen]).shape[1] for _, j in good]
    return [i for i, count in enumerate(open_) if count == min(open_)]


def _moved_alone(
    problem: Problem, points: np.ndarray, good: Sequence[tuple[np.ndarray, np.ndarray]]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """More points, at which a parameter that has no effect at the `good` ones has one: of each `points` (k, d) it alone
    is moved over its bounds. Entries of tables are not looked at, as no value of theirs is where simulations come."""
    tables = {problem.space.root(t.name) for t in getattr(problem.model, "tables", ())}
    found: list[tuple[np.ndarray, np.ndarray]] = []
    for k in np.flatnonzero(~_effect(good)):
        if problem.space.coordinates[k].parameter in tables:
            continue
        own = []
        for z in points:
            for to in ELSEWHERE:
                one = _at(problem, np.where(np.arange(len(z)) == k, to, z))
                if one is not None and np.linalg.norm(one[1][:, k]) > 0:
                    own.append(one)
        found += own
    return found


def _heard(own: Problem, problem: Problem, key: int, points: int) -> tuple[dict[str, int], int, tuple[str, ...]]:
    """Outputs whose errors nothing shows and their samples, the rank without them, and which parameters are determined
    alone then.

    They are those that are followed exactly at most of the points while others are followed with errors of 1 %, as in
    the fit (`trust.finish.weights`).
    """
    few = [o for o in few_samples(problem) if problem.scale_sources[o] != GIVEN]
    if not few:
        return {}, 0, ()
    # a check loads no scipy where nothing needs it
    from plantfit.trust.intervals.linearised import named_blocks
    from plantfit.trust.validate.spare_samples import spare_of
    from plantfit.trust.verdict.outputs import SPARE

    named = named_blocks(own)
    at = np.random.default_rng(key).uniform(0.02, 0.98, (points, problem.space.dimension))
    found = [j for z in at if np.all(np.isfinite(j := np.asarray(residuals_and_jacobian(own, z)[1])))]
    spare = [spare_of(j, named) for j in found]
    left = (
        {o: float(np.median([sum(v for (_, of), v in own_.items() if of == o) for own_ in spare])) for o in few}
        if found
        else {}
    )
    silent = {o: sum(len(index[o]) for index in problem.data["index"].values()) for o, v in left.items() if v < SPARE}
    if not silent:
        return {}, 0, ()
    kept = np.concatenate([np.full(b.rows.stop - b.rows.start, o not in silent) for _, o, b in named])
    bases = [_open(j * kept[:, None], np.linalg.norm(j, axis=0)) for j in found]
    least = min(n.shape[1] for n in bases)
    moved = np.max([np.max(np.abs(n), axis=1, initial=0.0) for n in bases if n.shape[1] == least], axis=0)
    alone = tuple(n for n, w in zip(problem.space.names, moved, strict=True) if w <= SAME)
    return silent, problem.space.dimension - least, alone


def _too_few(problem: Problem) -> int:
    """The fitted samples where a fit with errors that are correlated in time will say that they are too few; else 0."""
    fitted, d = sum(problem.parts.counts.values()), problem.space.dimension
    known = fitted <= d and all(source == GIVEN for source in problem.scale_sources.values())
    return fitted if problem.robust and problem.in_time and fitted < d + LEAST_FREE and not known else 0


def _entries(problem: Problem, unseen: np.ndarray, points: Sequence[np.ndarray]) -> dict[str, bool | None]:
    """Of coordinates without effect those that are entries of a table to which no simulation at the points (d,) comes,
    and whether a recorded sample depends on them; None where what the table is over is not recorded."""
    tables = {problem.space.root(t.name) for t in getattr(problem.model, "tables", ())}
    names = [c.name for c in (problem.space.coordinates[i] for i in unseen) if c.parameter in tables]
    if not names:
        return {}
    from plantfit.trust.identify.table_visits import recorded_visits, table_visits, unvisited

    never = set.intersection(*(unvisited(table_visits(problem, values)) for values in points))
    recorded = recorded_visits(problem, points[0])
    return {n: recorded.get(n) for n in names if n in never}


def _spread(problem: Problem, output: str) -> float:
    values = np.concatenate(
        [np.asarray(e.recording[output]) for e in problem.experiments.values() if output in e.recording.signals]
    )
    spread = float(np.nanstd(values))
    return spread if spread > 0 else 1.0


def _at(problem: Problem, z: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """(values (d,), sensitivities (k, d) of residuals whose noise is 1 by the logarithms of the values), None where
    not finite."""
    jacobian = _sensitivities(problem, z)
    if jacobian is None:
        return None
    space, p = problem.space, np.asarray(problem.space.physical(z))
    by_log = np.array(
        [
            1 / np.log(c.upper / c.lower) if c.log else v / (c.upper - c.lower)
            for c, v in zip(space.coordinates, p, strict=True)
        ]
    )
    return p, jacobian * by_log


def _sensitivities(problem: Problem, z: np.ndarray) -> np.ndarray | None:
    """Sensitivities (k, d) in few rows with the Gauss-Newton matrix of all, by what choosing the steps compiled
    already where it did so."""
    if shared(problem):
        r, jacobian = residuals_and_jacobian(problem, z)
        finite = np.isfinite(r).all() and np.isfinite(jacobian).all()
        return np.asarray(np.linalg.qr(jacobian, mode="r"), dtype=float) if finite else None
    r, jacobian = problem.compressed(z)
    count = sum(len(block[0]) for block in problem.blocks(z))
    return jacobian * np.sqrt(count / len(r)) if np.isfinite(r).all() and np.isfinite(jacobian).all() else None


def _open(jacobian: np.ndarray, size: np.ndarray | None = None) -> np.ndarray:
    """An orthonormal basis (d, d - rank) of the directions that change nothing; sensitivities (k, d) are small
    beside their `size` (d,)."""
    if not jacobian.shape[1]:
        return np.zeros((0, 0))
    norms = np.linalg.norm(jacobian, axis=0) if size is None else size
    by = np.where(norms > 0, norms, 1.0)
    _, singular, right = np.linalg.svd(jacobian / by, full_matrices=True)
    singular = np.r_[singular, np.zeros(len(right) - len(singular))]
    null = right[singular <= RANK * max(singular[0], 1e-300)].T / by[:, None]
    return np.linalg.qr(null / np.maximum(np.linalg.norm(null, axis=0), 1e-300))[0] if null.shape[1] else null


def _same_everywhere(bases: Sequence[np.ndarray]) -> np.ndarray | None:
    """The basis (d, k) that spans what each of the bases spans, None where they differ."""
    mean = np.mean([b @ b.T for b in bases], axis=0)
    values, vectors = np.linalg.eigh(mean)
    k = bases[0].shape[1]
    return vectors[:, -k:] if k and np.all(values[-k:] > 1 - SAME) else None


def _named(
    names: Sequence[str], used: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], rank: int
) -> tuple[list[str], list[str]]:
    """Parameters that are determined alone, and formulas of the other determined combinations."""
    bases = [n for _, n, _ in used]
    moved = np.max([np.max(np.abs(n), axis=1, initial=0.0) for n in bases], axis=0)
    alone = [n for n, w in zip(names, moved, strict=True) if w <= SAME]
    if rank in (len(names), len(alone)):
        return alone, []
    loose = [k for k in range(len(names)) if names[k] not in alone]
    in_logs = _same_everywhere(bases)
    if in_logs is not None:
        return alone, [_product(w, names) for w in _circuits(in_logs, loose, rank - len(alone))]
    by_value = [np.linalg.qr(n * p[:, None])[0] for p, n, _ in used]
    in_values = _same_everywhere(by_value)
    if in_values is not None:
        return alone, [_sum(w, names) for w in _circuits(in_values, loose, rank - len(alone))]
    for spans, formula in ((bases, _product), (by_value, _sum)):  # some of them may hold everywhere
        every = _span(spans)
        wanted = len(names) - every.shape[1] - len(alone)
        if some_ := [formula(w, names) for w in _circuits(every, loose, wanted)]:
            return alone, some_
    return alone, []


def _span(bases: Sequence[np.ndarray]) -> np.ndarray:
    """An orthonormal basis (d, k) of what any of the bases spans."""
    left, singular, _ = np.linalg.svd(np.hstack(bases), full_matrices=False)
    return left[:, singular > SAME * max(singular[0], 1e-300)]


def _circuits(null: np.ndarray, loose: Sequence[int], wanted: int) -> Iterator[dict[int, float]]:
    """Independent weights (by place) of the fewest parameters that stand at right angles to all open directions."""
    kept = np.zeros((0, len(null)))
    for subset in islice((s for size in range(2, TOGETHER + 1) for s in choices(loose, size)), SUBSETS):
        if len(kept) >= wanted:
            return
        block = null[list(subset)]
        _, singular, right = np.linalg.svd(block.T, full_matrices=True)
        singular = np.r_[singular, np.zeros(len(subset) - len(singular))]
        if np.sum(singular < 1e-6) != 1:
            continue
        weights = right[-1]
        if np.min(np.abs(weights)) < 1e-3 * np.max(np.abs(weights)):
            continue
        first = weights / weights[np.argmax(np.abs(weights) > 1e-6)]
        weights = _whole(first)
        row = np.zeros(len(null))
        row[list(subset)] = weights
        if np.linalg.matrix_rank(np.vstack([kept, row / np.linalg.norm(row)]), tol=1e-6) == len(kept) + 1:
            kept = np.vstack([kept, row / np.linalg.norm(row)])
            yield dict(zip(subset, weights.tolist(), strict=True))


def _whole(weights: np.ndarray) -> np.ndarray:
    """The weights as small whole numbers where they are, else as they stand."""
    for factor in range(1, 13):
        trial = weights * factor
        if np.all(np.abs(trial - np.round(trial)) < 1e-4 * factor) and np.max(np.abs(trial)) <= 30:
            return np.round(trial)
    return weights


def _product(weights: dict[int, float], names: Sequence[str]) -> str:
    flip = -1 if sum(w > 0 for w in weights.values()) < sum(w < 0 for w in weights.values()) else 1
    up = [_power(names[k], flip * w) for k, w in weights.items() if flip * w > 0]
    down = [_power(names[k], -flip * w) for k, w in weights.items() if flip * w < 0]
    below = f"/{down[0]}" if len(down) == 1 else f"/({'*'.join(down)})" if down else ""
    return ("*".join(up) or "1") + below


def _power(name: str, power: float) -> str:
    return name if power == 1 else f"{name}^{power:g}"


def _sum(weights: dict[int, float], names: Sequence[str]) -> str:
    parts = [f"{'-' if w < 0 else '+'} {'' if abs(w) == 1 else f'{abs(w):.4g}*'}{names[k]}" for k, w in weights.items()]
    return " ".join(parts).removeprefix("+ ")


def _fixes(names: Sequence[str], bases: Sequence[np.ndarray], loose: Sequence[int]) -> list[tuple[str, ...]]:
    """Smallest sets of parameters that leave no direction open once they are known, six at most."""
    k = bases[0].shape[1]
    if not k:
        return []

    def closes(subset: tuple[int, ...]) -> bool:
        return all(np.linalg.svd(b[list(subset)], compute_uv=False)[-1] > 1e-4 for b in bases)

    found: list[tuple[int, ...]] = list(islice((s for s in islice(choices(loose, k), SUBSETS) if closes(s)), 6))
    return [tuple(str(names[i]) for i in s) for s in found]


def _rough(
    names: Sequence[str], used: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], held: set[str]
) -> dict[str, float]:
    """The median over points of the relative standard error that noise of 1 % leaves, of those above `ROUGH`, with
    `held` known."""
    free = [k for k, n in enumerate(names) if n not in held]
    errors = []
    for _, _, jacobian in used:
        size = np.linalg.norm(jacobian[:, free], axis=0)
        size = np.where(size > 0, size, 1e-300)
        _, singular, right = np.linalg.svd(jacobian[:, free] / size, full_matrices=False)
        errors.append(np.sqrt(np.sum((right.T / np.maximum(singular, 1e-12)) ** 2, axis=1)) / size)
    median = np.median(errors, axis=0)
    return {names[k]: float(e) for k, e in zip(free, median, strict=True) if e > ROUGH}
