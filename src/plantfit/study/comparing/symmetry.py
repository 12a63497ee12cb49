"""Answers that are one model written twice: equal terms exchanged, signs changed together, or a share as the rest.

The two terms of b1 exp(-b2 t) + b3 exp(-b4 t) can change places, the width of a Gaussian that enters squared can change
its sign. Where the rates of f exp(-a t) + (1 - f) exp(-b t) change places, the share f becomes 1 - f. Such answers lie
far apart in the box and are the same optimum.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate.points import residuals
from plantfit.problem.problem import Problem
from plantfit.space import Coordinate

Option = tuple[int, int, float]  # what a value becomes: the place of its source, a sign, and what it is added to
NEAR = 0.05  # share of the bounds by which a mapped answer may miss the other one
ROUNDING = 1e-9  # relative difference of costs and residuals that rounding explains
POINTS = 4  # random points at which a map must leave the residuals as they are
MOST_MAPS, MOST_MOVED = 256, 12  # candidates that are tried, and coordinates that may take part
FEW = 8  # candidates whose residuals are compared without a look at their costs first


@dataclass(frozen=True)
class Symmetry:
    """A map of parameter values that leaves every residual as it is: value i becomes `sign[i]` times value
    `source[i]`, added to `whole[i]` (0, or the whole that it is a share of)."""

    names: tuple[str, ...]
    source: tuple[int, ...]
    sign: tuple[int, ...]
    whole: tuple[float, ...]

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Values (..., d) to values (..., d)."""
        return np.array(self.whole) + np.asarray(values)[..., list(self.source)] * np.array(self.sign)

    def back(self, values: np.ndarray) -> np.ndarray:
        """Values (d,) that the map takes to these."""
        found = np.zeros(len(values))
        found[list(self.source)] = np.array(self.sign) * (values - np.array(self.whole))
        return found

    @property
    def cycles(self) -> list[list[int]]:
        """Coordinates that change places in a ring, those that stay among them, each ring from its first."""
        left, found = list(range(len(self.source))), []
        while left:
            ring = [left[0]]
            while (following := self.source[ring[-1]]) != ring[0]:
                ring.append(following)
            found.append(ring)
            left = [k for k in left if k not in ring]
        return found

    @property
    def sentence(self) -> str:
        """`b1, b2 and b3, b4 can be exchanged: same model`."""
        parts = []
        rings = [ring for ring in self.cycles if len(ring) > 1]
        for length in sorted({len(ring) for ring in rings}):
            own = [ring for ring in rings if len(ring) == length]
            if length == 2:
                places = [sorted(ring) for ring in own]
                terms = [[ring[k] for ring in places] for k in range(2)]
            else:
                terms = sorted(([ring[k] for ring in own] for k in range(length)), key=lambda t: t[0])
            parts.append(f"{_and(', '.join(self.names[i] for i in term) for term in terms)} can be exchanged")
        alone = [ring[0] for ring in self.cycles if len(ring) == 1 and self.sign[ring[0]] < 0]
        flipped = [self.names[i] for i in alone if not self.whole[i]]
        rest = [f"{self.names[i]} {{}} {self.whole[i]:g} - {self.names[i]}" for i in alone if self.whole[i]]
        if any(self.sign[i] < 0 and not self.whole[i] for ring in rings for i in ring):
            parts[-1] += " with a change of sign"
        if any(self.whole[i] for ring in rings for i in ring):
            parts[-1] += ", shares as what is left of the whole"
        if rest:
            parts.append(_and(share.format("becomes" if parts else "can become") for share in rest))
        if flipped:
            parts.append(
                f"the sign of {flipped[0]} does not matter"
                if len(flipped) == 1
                else f"{_and(flipped)} can change sign together"
            )
        return f"{' while '.join(parts)}: same model"


def _and(words: Iterator[str] | Sequence[str]) -> str:
    words = list(words)
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def same_by_symmetry(
    problem: Problem, z1: np.ndarray, z2: np.ndarray, *, near: float = NEAR, seed: int = 0
) -> Symmetry | None:
    """The map that shows two cube points (d,) to be one model: it takes z1 to within `near` of z2 and changes no
    residual; else None.

    Candidates are exchanges and changes of sign that the two answers suggest. A candidate counts only when cost and
    residuals are the same to rounding before and after it at random points (of generator `seed`) that it does not carry
    out of the box, as far as the bounds leave such points. Answers that are near each other already have no map between
    them.
    """
    z1, z2 = np.asarray(z1, dtype=float), np.asarray(z2, dtype=float)
    if np.max(np.abs(z1 - z2)) <= near or np.sum(np.abs(z1 - z2) > near) > MOST_MOVED:
        return None
    maps = list(islice(_candidates(problem, z1, z2, near), MOST_MAPS))
    size = _size(problem)
    # the answer itself first: there an asymmetry shows that a random point may hide behind a limit or a switch
    for draw in (None, *np.random.default_rng(seed).random((POINTS, len(z1)))):
        points = np.array([z1 if draw is None else _inside(problem, m, draw) for m in maps])
        maps = (
            [m for m, same in zip(maps, _unchanged(problem, maps, points, size), strict=True) if same] if maps else []
        )
    return maps[0] if maps else None


def _size(problem: Problem) -> float:
    """Root mean square of the scaled measured outputs."""
    measured = problem.data["measured"].values()
    return float(
        np.sqrt(
            np.mean(
                np.concatenate([np.asarray(y) / problem.scales[o] for own in measured for o, y in own.items()]) ** 2
            )
        )
    )


def _candidates(problem: Problem, z1: np.ndarray, z2: np.ndarray, near: float) -> Iterator[Symmetry]:
    """Maps that take z1 near z2, those first that leave coordinates which did not move where they are."""
    space, values = problem.space, np.asarray(problem.space.physical(z1))
    late = {d.parameter for d in getattr(problem.model, "delays", ())} | {
        d.parameter for d in getattr(problem.model, "state_delays", ())
    }
    options: list[list[Option]] = []
    for i, c in enumerate(space.coordinates):
        found = []
        for j, other in enumerate(space.coordinates):
            if other.unit != c.unit or other.recording != c.recording:
                continue
            ways = [(1, 0.0)]
            if not (c.log or other.log or c.parameter in late):
                ways.append((-1, 0.0))
            if (whole := max(_whole(c), _whole(other))) < np.inf:
                ways.append((-1, whole))
            for sign, of in ways:
                moved = values.copy()
                moved[i] = of + sign * values[j]
                with np.errstate(invalid="ignore", divide="ignore"):
                    miss = abs(float(space.cube(moved)[i]) - z2[i])
                if miss <= near:
                    found.append((i != j or sign < 0, miss, j, sign, of))
        if not found:
            return
        options.append([(j, sign, of) for _, _, j, sign, of in sorted(found)])
    yield from (Symmetry(space.names, *_split(chosen)) for chosen in _permutations(options, len(space.coordinates)))


def _whole(c: Coordinate) -> float:
    """Of what a parameter within these bounds may be a share: 1 or 100 %; infinite for one that may be none."""
    whole = {None: 1.0, "": 1.0, "1": 1.0, "-": 1.0, "%": 100.0}.get(c.unit, np.inf)
    return whole if c.lower >= 0.0 and c.upper <= whole else np.inf


def _split(chosen: Sequence[Option]) -> tuple[tuple[int, ...], tuple[int, ...], tuple[float, ...]]:
    return tuple(j for j, _, _ in chosen), tuple(s for _, s, _ in chosen), tuple(w for _, _, w in chosen)


def _permutations(options: Sequence[Sequence[Option]], d: int, most: int = 20_000) -> Iterator[list[Option]]:
    """One option for each place so that every coordinate is taken once; not the identity. Ends after `most` steps."""
    order = sorted(range(d), key=lambda i: len(options[i]))
    stack: list[tuple[int, dict[int, Option], frozenset[int]]] = [(0, {}, frozenset())]
    for _ in range(most):
        if not stack:
            return
        depth, chosen, taken = stack.pop()
        if depth == d:
            found = [chosen[i] for i in range(d)]
            if any(option != (i, 1, 0.0) for i, option in enumerate(found)):
                yield found
            continue
        i = order[depth]
        stack += [(depth + 1, {**chosen, i: o}, taken | {o[0]}) for o in reversed(options[i]) if o[0] not in taken]


def _unchanged(problem: Problem, maps: Sequence[Symmetry], points: np.ndarray, size: float) -> list[bool]:
    """Which maps leave cost and residuals as they are, each at its own point (d,) of `points`; `size` is that of the
    outputs."""
    images = np.array(
        [problem.space.cube(m(np.asarray(problem.space.physical(z)))) for m, z in zip(maps, points, strict=True)]
    )
    found = np.ones(len(maps), dtype=bool)
    if (
        len(maps) > FEW or problem.smoothing is not None
    ):  # many points at once first; for few it would only be one more shape to compile
        costs = np.asarray(problem.costs(np.concatenate([points, images]))).reshape(2, -1)
        with np.errstate(invalid="ignore"):
            found = np.isfinite(costs[0]) & (np.abs(costs[0] - costs[1]) <= ROUNDING * (np.abs(costs[0]) + size**2))
    for k in np.flatnonzero(found):
        before, after = residuals(problem, points[k]), residuals(problem, images[k])
        found[k] = np.max(np.abs(before - after), initial=0.0) <= ROUNDING * np.max(np.abs(before), initial=size)
    return found.tolist()


def _inside(problem: Problem, symmetry: Symmetry, draw: np.ndarray) -> np.ndarray:
    """The cube point of `draw` within those bounds that the map does not carry a value out of, or within its own
    where there are none."""
    space = problem.space
    lower, upper = space.lower.copy(), space.upper.copy()
    for ring in symmetry.cycles:
        # bounds of all of a ring, seen from each of its places with the signs on the way
        for i in ring:
            low, high, place, sign, whole = -np.inf, np.inf, i, 1, 0.0
            for _ in range(2 * len(ring)):
                ends = sorted((sign * (space.lower[place] - whole), sign * (space.upper[place] - whole)))
                low, high = max(low, ends[0]), min(high, ends[1])
                # value `place` goes where it is the source
                target = symmetry.source.index(place)
                turn = symmetry.sign[target]
                sign, whole, place = sign * turn, symmetry.whole[target] + turn * whole, target
            if low < high:
                lower[i], upper[i] = low, high
    with np.errstate(invalid="ignore", divide="ignore"):
        spread = np.where(
            space.log,
            np.exp(
                np.log(np.maximum(lower, 1e-300))
                + draw * (np.log(np.maximum(upper, 1e-300)) - np.log(np.maximum(lower, 1e-300)))
            ),
            lower + draw * (upper - lower),
        )
    return space.cube(spread)
