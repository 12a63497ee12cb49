"""What the data determine: combinations of parameters that they leave open one by one, and what would have to be
known."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations as choices
from itertools import islice
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.findings.parameters import Determined, DeterminedCombination, FirstValues, KnownOther
from plantfit.models.remade import takes
from plantfit.problem.problem import Problem
from plantfit.trust.identify.range_ends import EndPoint, Ends, free_inverse
from plantfit.trust.intervals.first_values import start_parameters
from plantfit.trust.intervals.parameter_rows import ROUGH
from plantfit.trust.intervals.ranges import Linear, Range

TOGETHER = 4  # parameters of one combination at most
SUBSETS = 3000  # that are tried at most
WIDER = 1.2  # times that an interval is wider by measured initial values, from which on it is told
HEAVY = 0.05  # weight, or weight times reach, of the largest, from which on a parameter belongs to a combination
POWERS = (1.0, 2.0, 0.5, 3.0, 1.5)  # exponents that a product may have
ALIKE = 1e-3  # relative, to which weights are equal
LOOSE = 2.0  # times the least standard error that a rounded exponent or factor may cost
UNEVEN = 1.5  # times as far as its standard error says that a combination may be moved
DIGITS = (3, 4, 5, 6)  # of a factor in a sum, the fewest that do
MANY = 30  # undetermined parameters from which on nothing is named
NOTHING = 1e-150  # a singular value that is none

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Combination:
    """A product of powers (`product`) or a weighted sum of parameters `places`, its value and where the data put it."""

    places: tuple[int, ...]
    weights: tuple[float, ...]
    product: bool
    value: float
    low: float
    high: float
    standard_error: float

    def text(self, names: Sequence[str]) -> str:
        """As a formula."""
        own = [(names[k], w) for k, w in zip(self.places, self.weights, strict=True)]
        if self.product:
            up = "*".join(_power(n, w) for n, w in own if w > 0)
            down = [_power(n, -w) for n, w in own if w < 0]
            below = "*".join(down) if len(down) == 1 else f"({'*'.join(down)})"
            return up + (f"/{below}" if down else "")
        parts = [f"{'-' if w < 0 else '+'} {'' if abs(abs(w) - 1) < 5e-4 else f'{abs(w):.6g}*'}{n}" for n, w in own]
        return " ".join(parts).removeprefix("+ ")


def determined_findings(
    problem: Problem, linear: Linear | None, rows: Sequence[Row], ranges: Mapping[int, Range]
) -> Determined | None:
    """The section "determined" of the findings record; None where there is no linearised problem (tables, many
    coordinates)."""
    if linear is None:
        return None
    names, d = problem.space.names, len(linear.values)
    status = {row["name"]: row["status"] for row in rows}
    loose = [i for i in range(d) if status[names[i]] != "determined"]
    ends = Ends(problem, linear, ranges)
    found = combinations_of(problem, linear, loose, ends) if linear.sound and 1 < len(loose) <= MANY else []
    needs = only_if(linear, loose, ends) if linear.sound and 1 < len(loose) <= MANY else {}
    return Determined(
        count=d - len(loose) + len(found),
        of=d,
        directions=d - len(loose) + (known_directions(linear, loose) if linear.sound else 0),
        sound=linear.sound,
        samples=linear.samples,
        shown=[] if linear.sound else [names[i] for i in _shown(linear)],
        first_values=_by_first_values(problem, linear, status),
        combinations=[
            DeterminedCombination(
                formula=c.text(names),
                weights={names[k]: float(w) for k, w in zip(c.places, c.weights, strict=True)},
                product=c.product,
                value=c.value,
                low=c.low,
                high=c.high,
                standard_error=c.standard_error,
            )
            for c in found
        ],
        only_if={
            names[i]: KnownOther(
                known=names[j],
                unit=problem.space.coordinates[j].unit,
                at=float(linear.values[j]),
                value=float(linear.values[i]),
                standard_error=error,
            )
            for i, (j, error) in needs.items()
        },
    )


def _shown(linear: Linear) -> list[int]:
    """The parameters that would be determined if the residuals were independent of each other."""
    _, singular, right = np.linalg.svd(np.vstack([linear.rows, np.zeros((len(linear.size),) * 2)]), full_matrices=False)
    errors = np.sqrt(np.sum((right.T / np.maximum(singular, NOTHING)) ** 2, axis=1)) * linear.size
    return [i for i, error in enumerate(errors) if error <= ROUGH * abs(linear.values[i])]


def _by_first_values(problem: Problem, linear: Linear, status: Mapping[str, str]) -> FirstValues | None:
    """The parameter whose interval noise in measured initial values makes wider by the largest factor, if by much."""
    names = problem.space.names
    if not np.any(linear.begun >= WIDER):
        return None
    starts = start_parameters(problem, linear.values)  # what these are counts from the measured value
    known = [
        i for i, (n, c) in enumerate(zip(names, problem.space.coordinates, strict=True))
        if status[n] in ("determined", "weak") and c.parameter not in starts
    ]  # fmt: skip
    widest = max(known, key=lambda i: linear.begun[i], default=None)
    if widest is None or linear.begun[widest] < WIDER:
        return None
    option = 'initial = "free"' if takes(problem.model, "initial", "free") else None
    return FirstValues(parameter=names[widest], factor=float(linear.begun[widest]), option=option)


def only_if(linear: Linear, loose: Sequence[int], ends: Ends) -> dict[int, tuple[int, float]]:
    """Of those that the data leave open, which one other has to be known for one to be determined, at the ends of its
    range as well, and its standard error at the answer then."""
    result: dict[int, tuple[int, float]] = {}
    bread, weights = free_inverse(linear.rows), np.eye(len(linear.values))
    for k in loose:
        errors = {}
        for j in (j for j in loose if j != k):
            # as the fit with x_j held: what of x_k follows from x_j is no longer open
            own = weights[k] - bread[k, j] / bread[j, j] * weights[j]
            error = float(np.sqrt(linear.variance_of(own)) * linear.size[k])
            if error <= ROUGH * abs(linear.values[k]):
                errors[j] = error
        known = (
            j for j in sorted(errors, key=lambda j: errors[j]) if all(t.known(weights[k], [j]) for t in ends.of(k))
        )
        if (other := next(known, None)) is not None:
            result[k] = (other, errors[other])
    return result


def known_directions(linear: Linear, loose: Sequence[int]) -> int:
    """How many independent combinations of the parameters `loose` are known near the answer, whatever their form."""
    return int(np.sum(np.linalg.eigvalsh(linear.spread[np.ix_(loose, loose)]) <= ROUGH**2)) if len(loose) else 0


def combinations_of(problem: Problem, linear: Linear, loose: Sequence[int], ends: Ends) -> list[Combination]:
    """Independent combinations of the parameters `loose`, the fewest parameters in each, that the data determine.

    Weights are those of the direction of least variance of a subset, all others free. A product and a sum have the same
    direction at the answer: what stays the same over the points of about the answer's cost that were met tells which of
    them it is, and what is constant in neither form is not named.
    """
    ranges = ends.ranges
    met = [linear.values] + [np.asarray(problem.space.physical(z)) for i in sorted(ranges) for z in ranges[i].points]
    cloud = np.array(met)
    # one that is small at the answer may be large elsewhere
    moved = np.max(np.abs(cloud - linear.values), axis=0) / linear.size
    reach = np.maximum(moved, 1.0)[loose]
    spread = linear.spread[np.ix_(loose, loose)]
    wanted = known_directions(linear, loose)
    kept: list[Combination] = []
    directions = np.zeros((0, len(loose)))
    for subset in islice(_subsets(len(loose)), SUBSETS):
        if len(kept) >= wanted:
            break
        block = spread[np.ix_(subset, subset)]
        values, vectors = np.linalg.eigh(block)
        weights = vectors[:, 0]
        if values[0] > ROUGH**2 or (len(subset) > 1 and values[1] <= ROUGH**2):
            continue
        if max(_evenness(weights), _evenness(weights * reach[list(subset)])) < HEAVY:
            continue
        found = _named(linear, cloud, [loose[k] for k in subset], weights, ends)
        if found is None:
            continue
        # of the form as it is named: the weights at the answer are a little off those of a quotient of two others
        direction = np.zeros(len(loose))
        direction[list(subset)] = _gradient(found, linear.values, linear.size)
        direction /= np.linalg.norm(direction)
        if np.linalg.matrix_rank(np.vstack([directions, direction]), tol=1e-3) == len(directions) + 1:
            directions = np.vstack([directions, direction])
            kept.append(found)
    return kept


def _evenness(weights: np.ndarray) -> float:
    return float(np.min(np.abs(weights)) / np.max(np.abs(weights)))


def _subsets(n: int) -> Iterator[tuple[int, ...]]:
    return (s for size in range(2, min(TOGETHER, n) + 1) for s in choices(range(n), size))


def _named(
    linear: Linear, cloud: np.ndarray, places: Sequence[int], weights: np.ndarray, ends: Ends
) -> Combination | None:
    """The product or the sum with these weights of relative changes that is constant over the cloud."""
    forms = [
        f for f in (_product(linear, cloud, places, weights), _sum(linear, cloud, places, weights)) if f is not None
    ]
    best = min(forms, key=lambda f: (f.high - f.low) / max(abs(f.value), 1e-300), default=None)
    if best is None or best.high - best.low > 2 * 1.96 * ROUGH * abs(best.value):
        return None
    return best if _constant(linear, best, ends) else None


def _constant(linear: Linear, c: Combination, ends: Ends) -> bool:
    """Whether the data determine a combination at the ends of its parameters' ranges, too, and points of about the
    answer's cost that were met leave it as it is, but for what its standard error tells and for a quarter of it: of
    Kb + R*b/Kt, known, "Kb + 0.101*b" is a slope at the answer."""
    reach = max(c.high - c.value, c.value - c.low)
    if reach > max(ROUGH * abs(c.value), UNEVEN * linear.quantile * c.standard_error):
        return False
    return all(_known_there(c, there) for k in c.places for there in ends.of(k))


def _known_there(c: Combination, there: EndPoint) -> bool:
    weights = np.zeros(len(there.size))
    if c.product and np.any(there.values[list(c.places)] == 0.0):
        return False
    weights[list(c.places)] = _gradient(c, there.values, there.size)
    return there.known(weights)


def _gradient(c: Combination, values: np.ndarray, size: np.ndarray) -> np.ndarray:
    """By how much of itself, or of what it is at the answer where that is more, a combination changes where a
    parameter changes by its size: by place."""
    at, weights = list(c.places), np.array(c.weights)
    if c.product:
        return weights * size[at] / values[at]
    return weights * size[at] / max(abs(c.value), abs(float(values[at] @ weights)), 1e-300)


def _product(linear: Linear, cloud: np.ndarray, places: Sequence[int], weights: np.ndarray) -> Combination | None:
    at = list(places)
    if np.any(linear.values[at] == 0.0) or np.any(cloud[:, at] * linear.values[at] <= 0.0):
        return None
    powers = weights * linear.values[at] / linear.size[at]
    # of equal powers the last: rounding would choose which of two stands in the denominator
    powers = powers / powers[np.flatnonzero(np.abs(powers) > (1.0 - ALIKE) * np.max(np.abs(powers)))[-1]]
    least = _variance(linear, at, weights) / float(weights @ weights)
    for unit in (1.0, 2.0, 3.0, 0.5, 1.5):
        trial = np.array([_nearest(p * unit) for p in powers])
        if np.any(trial == 0.0) or not np.any(np.abs(trial) == 1.0):
            continue
        own = trial * linear.size[at] / linear.values[at]
        variance = _variance(linear, at, own)
        if variance / float(own @ own) > max(LOOSE**2 * least, (0.04 * ROUGH) ** 2) or variance > ROUGH**2:
            continue
        trial = trial * np.sign(trial[np.argmax(np.abs(trial) == 1.0)]) if np.sum(trial > 0) == 0 else trial
        values = np.exp(np.sum(np.log(np.abs(cloud[:, at])) * trial, axis=1))
        sign = float(np.prod(np.where(trial % 2 == 1, np.sign(linear.values[at]), 1.0)))
        return _combination(linear, places, trial, True, sign * values, float(np.sqrt(variance)))
    return None


def _sum(linear: Linear, cloud: np.ndarray, places: Sequence[int], weights: np.ndarray) -> Combination | None:
    at = list(places)
    exact = weights / linear.size[at]
    exact = exact / exact[np.flatnonzero(np.abs(weights) > (1.0 - ALIKE) * np.max(np.abs(weights)))[0]]
    least = float(np.sqrt(_variance(linear, at, exact * linear.size[at])))
    factors, error = exact, np.inf
    for digits in DIGITS:
        factors = np.array([_rounded(f, digits) for f in exact])
        error = float(np.sqrt(_variance(linear, at, factors * linear.size[at])))
        if error <= LOOSE * least:
            break
        # along an open direction the linear problem goes on for ever, and the points that were met do not
        if float(np.ptp(cloud[:, at] @ (factors - exact))) <= least:
            error = least
            break
    values = cloud[:, at] @ factors
    return None if values[0] == 0.0 else _combination(linear, places, factors, False, values, error / abs(values[0]))


def _rounded(factor: float, digits: int) -> float:
    """A factor of a sum in so many digits, and a whole number where it is nearly one."""
    whole = float(np.round(factor))
    return whole if factor and abs(factor - whole) < 5e-4 * abs(factor) else float(f"{factor:.{digits}g}")


def _variance(linear: Linear, places: Sequence[int], weights: np.ndarray) -> float:
    """Of the sum of relative changes of parameters `places` with these weights."""
    whole = np.zeros(len(linear.values))
    whole[list(places)] = weights
    return linear.variance_of(whole)


def _combination(
    linear: Linear, places: Sequence[int], weights: np.ndarray, product: bool, values: np.ndarray, relative: float
) -> Combination:
    value, reach = float(values[0]), linear.quantile * relative * abs(float(values[0]))
    low, high = min(value - reach, float(values.min())), max(value + reach, float(values.max()))
    return Combination(tuple(places), tuple(weights.tolist()), product, value, low, high, relative * abs(value))


def _nearest(power: float) -> float:
    """The exponent of `POWERS` near a number, 0 where there is none."""
    near = min(POWERS, key=lambda p: abs(p - abs(power)))
    return float(np.copysign(near, power)) if abs(near - abs(power)) < 0.15 * near else 0.0


def _power(name: str, power: float) -> str:
    return name if power == 1.0 else f"{name}^{power:g}"
