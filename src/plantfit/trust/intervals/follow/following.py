"""Ranges of all parameters followed on the problem itself, each end by `followed.py`, and joined where a valley
bends."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.study.comparing.symmetry import same_by_symmetry
from plantfit.trust.finish.unknown_noise import as_known
from plantfit.trust.intervals.follow.followed import Followed
from plantfit.trust.intervals.ranges import Linear, Range

LEAST, MOST = 30, 60  # Jacobians for each parameter: those that are always allowed, and at most
# ends of other searches that are looked at, and how far they are from the answer in the cube at least
OTHERS, APART = (4, 0.05)
FRESH = 4  # of the points met for open coordinates, from which the others are followed anew


def followed_ranges(
    problem: Problem, z: np.ndarray, linear: Linear, spent: float, others: Sequence[np.ndarray] = ()
) -> Mapping[int, Range]:
    """Ranges of all coordinates, followed with a third of the evaluations that were `spent`, but `LEAST` to `MOST`
    Jacobians for each.

    `others` are cube points (d,) at which searches ended elsewhere. Where one costs so little more than the answer that
    noise may have chosen between the two, the ranges hold both, however high the cost between them; not where both are
    one model written twice, and not where the other answer lies outside of the bounds.
    """
    problem, d = as_known(problem), len(linear.values)
    allowed = int(min(max(spent / 3.0 / max(problem.jacobian_charge, 1.0), LEAST * d), MOST * d))
    walk = Followed(problem, z, linear, allowed)
    found = {i: walk.range(i) for i in range(d)}
    seen: set[int] = set()
    for end in _far_apart([z, *others], OTHERS + 1)[1:]:
        _hold(walk, found, walk.room.inner(end))
    while True:
        _joined(walk, found)
        open_ones = [i for i in found if not walk.narrow(i, found[i])]
        new = [i for i in open_ones if i not in seen]
        if not new or len(open_ones) == d:  # nothing has changed, or nothing is left that might be called determined
            break
        for i in new:
            walk.look_between(i, found[i])
        seen.update(new)
        met = [z for i in open_ones for z in found[i].points]
        for i in sorted(set(found) - set(open_ones)):
            walk.go_on(i, found[i], _starts(met, i))
    if open_ones:
        for i in sorted(set(found) - set(open_ones)):
            walk.look_beyond(i, found[i], _starts([walk.z, *(z for own in found.values() for z in own.points)], i))
    for i, own in found.items():
        walk.open_at_edges(i, own)
    return {i: replace(own, points=[walk.room.outer(w) for w in own.points]) for i, own in found.items()}


def _hold(walk: Followed, found: Mapping[int, Range], end: np.ndarray) -> None:
    """Widen the ranges to another end of a search that costs as little, and follow them from there."""
    if _near(walk, end):
        return
    place = walk.elsewhere(end)
    if place is not None and not walk.within_bounds(place):
        # bounds are how a user leaves one of two answers that no data tell apart
        place = walk.elsewhere(end, stay=True)
    if place is None:
        return
    place = _named_alike(walk, found, place)
    if _near(walk, place):
        return
    growth, values = walk.growths[place.tobytes()], walk.room.physical(place[None, :])[0]
    for i, own in found.items():
        # samples with little noise make a range narrow, and say nothing of how much another optimum may cost by chance
        if growth <= max(walk.linear.threshold[i], walk.linear.quantile**2):
            own.points.append(place)
            own.low, own.high = min(own.low, float(values[i])), max(own.high, float(values[i]))
            walk.around(i, own, place)
    _joined(walk, found)
    for i, own in found.items():  # a value may be the same there, and go elsewhere from there
        walk.go_on(i, own, [place])


def _near(walk: Followed, place: np.ndarray) -> bool:
    return bool(np.max(np.abs(walk.room.outer(place) - walk.room.outer(walk.z))) <= APART)


def _named_alike(walk: Followed, found: Mapping[int, Range], place: np.ndarray) -> np.ndarray:
    """The point (d,) with exchanged terms and changed signs taken back, as the answer has them: these are one model
    written twice.

    Open coordinates may be anywhere in it, and say nothing of an exchange.
    """
    fixed = np.array([walk.narrow(i, found[i]) for i in range(len(place))])
    symmetry = same_by_symmetry(walk.problem, walk.room.outer(walk.z), walk.room.outer(np.where(fixed, place, walk.z)))
    if symmetry is None:
        return place
    alike = np.clip(walk.room.cube(symmetry.back(np.asarray(walk.room.physical(place)))), 0.0, 1.0)
    walk.growths[alike.tobytes()] = walk.growths[place.tobytes()]
    return alike


def _starts(met: Sequence[np.ndarray], i: int) -> list[np.ndarray]:
    """The two of the points (d,) that are farthest along coordinate i, and `FRESH` far from each other."""
    ends = [choose(met, key=lambda z: float(z[i])) for choose in (min, max)] if met else []
    return ends + [z for z in _far_apart(met, FRESH) if not any(z is e for e in ends)]


def _far_apart(met: Sequence[np.ndarray], most: int) -> list[np.ndarray]:
    """The first of the points (d,) and those farthest from all that were taken before."""
    if not met:
        return []
    points = np.array(met)
    chosen = [0]
    distance = np.max(np.abs(points - points[0]), axis=1)
    while len(chosen) < most and np.max(distance) > 0.0:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.max(np.abs(points - points[chosen[-1]]), axis=1))
    return [met[k] for k in chosen]


def _joined(walk: Followed, found: Mapping[int, Range]) -> None:
    """Widen every range by the points that were met on the way to other ends and cost as little: a valley may bend
    there."""
    met = [z for r in found.values() for z in r.points]
    if not met:
        return
    values = walk.room.physical(np.array(met))
    growths = np.array([walk.growths[z.tobytes()] for z in met])
    for i, own in found.items():
        near = values[growths <= walk.linear.threshold[i], i]
        own.low, own.high = float(np.min(near, initial=own.low)), float(np.max(near, initial=own.high))
