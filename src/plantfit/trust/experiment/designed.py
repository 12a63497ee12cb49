"""An input designed for a study's plant, held against step, PRBS, multisine and chirp within the same limits."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from plantfit.errors import SearchError
from plantfit.findings.results.next_experiment import InputGain
from plantfit.trust.experiment.criteria import Difference, Precision
from plantfit.trust.experiment.exchange import LEVELS, Exchange
from plantfit.trust.experiment.shapes import kind_of, shapes
from plantfit.trust.experiment.trial_record import Told

# cost of an input that breaks a limit, to which by how much is added (Deb, Comput. Methods Appl. Mech. Eng. 186 (2000)
# 311)
OUTSIDE = 1e6
AMPLITUDES = (1.0, 0.8, 0.6, 0.45, 0.33, 0.24, 0.16, 0.1, 0.05)  # of the range of the input
OFFSETS = (0.5, 0.0, 1.0)  # of what is left of the range
MOST_BLOCKS = 64
FINE = tuple(np.linspace(0.0, 1.0, 17))


@dataclass(frozen=True, eq=False)
class Limits:
    """What the bench allows: `low` and `high` (inputs,) of the inputs, `slew` (inputs,) per second, inf where there
    is none, `hold` the samples that a level lasts at least, and `signals` (low, high) of outputs and states, by name
    in their units. `far` are ends between which outputs stay that have no limit of their own: a plant that runs away
    tells nothing, however large its sensitivities."""

    low: np.ndarray
    high: np.ndarray
    slew: np.ndarray
    hold: int
    signals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    far: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def broken(self, told: Told) -> float:
        """By how much signals leave their limits, as shares of these; 0 within."""
        total = 0.0
        for name, (low, high) in (*self.signals.items(), *self.far.items()):
            y = told.signals[name]
            size = high - low if np.isfinite(high - low) else max(abs(v) for v in (low, high) if np.isfinite(v)) or 1.0
            over = np.maximum(np.maximum(y - high, low - y), 0.0)
            total += float(np.nan_to_num(np.max(over) / size, nan=1e3, posinf=1e3))
        return total


@dataclass(frozen=True, eq=False)
class Candidate:
    """An input (N, inputs) by kind and name, and its cost; at least OUTSIDE where it breaks a limit."""

    kind: str
    name: str
    u: np.ndarray
    cost: float


@dataclass(frozen=True, eq=False)
class Designed:
    """The best input, the best of each classical kind, and how many were simulated."""

    best: Candidate
    classical: tuple[Candidate, ...]
    tried: int


def designed(
    goal: Precision | Difference,
    limits: Limits,
    *,
    budget: int = 3000,
    seed: int = 1,
    tell: Callable[[int, float], None] = lambda tried, cost: None,
) -> Designed:
    """The best input that was found in `budget` simulations, classical shapes included.

    Shapes are tried with many settings and within the limits of the signals as large as these allow; levels of blocks
    are then exchanged, from 8 blocks to 64. Raises SearchError where no input keeps the limits.
    """
    trial = goal.trial if isinstance(goal, Precision) else goal.one.trial
    n, inputs, period = len(trial.t), len(limits.low), float(np.median(np.diff(trial.t)))
    begins = np.array([trial.begins[name] for name in trial.model.inputs])

    def cost(u: np.ndarray) -> float:
        told = trial.told(u)
        broken = limits.broken(told)
        if broken > 0:
            return OUTSIDE + broken
        found = goal.cost(told) if isinstance(goal, Precision) else goal.cost(told, goal.other.trial.told(u))
        return found if np.isfinite(found) else 2 * OUTSIDE

    def slewed(u: np.ndarray) -> np.ndarray:
        return _slewed(u, limits.slew * period, begins) if np.any(np.isfinite(limits.slew)) else u

    def played(levels: np.ndarray) -> np.ndarray:
        place = np.minimum(np.arange(n) * len(levels) // n, len(levels) - 1)
        return slewed(limits.low + (limits.high - limits.low) * levels[place])

    exchange = Exchange(lambda levels: cost(played(levels)), budget, tell)
    classical = _classical(cost, slewed, limits, n, inputs, seed, exchange)
    rng = np.random.default_rng(seed)
    most = int(np.clip(n // max(1, limits.hold), 1, MOST_BLOCKS))
    good = sorted(classical, key=lambda c: c.cost)[:3]

    def starts(blocks: int) -> list[np.ndarray]:
        found = [_in_blocks(c.u, blocks, limits) for c in good if c.cost < OUTSIDE]
        alternating = np.tile((np.arange(blocks) % 2.0)[:, None], (1, inputs))
        return [*found, alternating, rng.choice(LEVELS, size=(blocks, inputs)), _resting(begins, limits, blocks)]

    levels, _ = exchange.search(starts, most, rng)
    levels, reached = (
        exchange.improved(levels, exchange.of(levels), rng, FINE)
        if not exchange.over
        else (levels, cost(played(levels)))
    )
    own = Candidate("designed", f"{len(levels)} blocks", played(levels), reached)
    best = min([own, *classical], key=lambda c: c.cost)
    if best.cost >= 2 * OUTSIDE:
        raise SearchError(
            "No input that was tried can be simulated to finite "
            "outputs; check the limits of the inputs and the parameters."
        )
    if best.cost >= OUTSIDE:
        raise SearchError(
            f"No input of {exchange.tried} keeps the limits: the best breaks "
            f"them by {100 * (best.cost - OUTSIDE):.3g} % of their width. "
            "Widen the limits, or begin where the plant is within them."
        )
    return Designed(best, tuple(c for c in classical if c.cost < OUTSIDE), exchange.tried)


def _classical(
    cost: Callable[[np.ndarray], float], slewed: Callable[[np.ndarray], np.ndarray], limits: Limits, n: int,
    inputs: int, seed: int,
    exchange: Exchange,
) -> list[Candidate]:  # fmt: skip
    """The best of each kind, as large as the limits of the signals allow."""
    best: dict[str, Candidate] = {}
    for name, shape in shapes(n, inputs, seed, limits.hold):
        for found in _fitted(cost, slewed, limits, shape, exchange):
            kind = kind_of(name)
            if kind not in best or found[1] < best[kind].cost:
                best[kind] = Candidate(kind, name, *found)
    return list(best.values())


def _fitted(
    cost: Callable[[np.ndarray], float],
    slewed: Callable[[np.ndarray], np.ndarray],
    limits: Limits,
    shape: np.ndarray,
    exchange: Exchange,
) -> Iterator[tuple[np.ndarray, float]]:
    """A shape over the whole range of the inputs; where that breaks a limit, of the largest part that does not, at
    each offset."""
    width = limits.high - limits.low
    for offset in OFFSETS if limits.signals else OFFSETS[:1]:
        for signed in (shape, -shape) if offset != 0.5 else (shape,):
            for part in AMPLITUDES if limits.signals else AMPLITUDES[:1]:
                low = limits.low + offset * (1.0 - part) * width
                u = slewed(low + part * width * 0.5 * (1.0 + signed))
                exchange.tried += 1
                found = cost(u)
                exchange.tell(exchange.tried, found)
                if found < OUTSIDE or part == AMPLITUDES[-1]:
                    yield u, found
                    break


def _in_blocks(u: np.ndarray, blocks: int, limits: Limits) -> np.ndarray:
    """Means of an input over blocks of equal length, as the nearest levels."""
    place = np.minimum(np.arange(len(u)) * blocks // len(u), blocks - 1)
    means = np.stack(
        [np.bincount(place, column, blocks) / np.maximum(np.bincount(place, minlength=blocks), 1) for column in u.T],
        axis=1,
    )
    share = (means - limits.low) / (limits.high - limits.low)
    return np.clip(np.round(share * 16) / 16, 0.0, 1.0)


def _resting(begins: np.ndarray, limits: Limits, blocks: int) -> np.ndarray:
    """The input as it was before, at all blocks: where limits are narrow, the plant at rest may keep them."""
    return np.tile(np.clip((begins - limits.low) / (limits.high - limits.low), 0.0, 1.0), (blocks, 1))


def _slewed(u: np.ndarray, step: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Inputs (N, inputs) that move by at most `step` (inputs,) from one sample to the next, from `first` on."""
    found, now = np.empty_like(u), first
    for k, wanted in enumerate(u):
        now = now + np.clip(wanted - now, -step, step)
        found[k] = now
    return found


def errors_after(goal: Precision, told: Told | None, before: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Standard errors (s,) in their units at the first plant, and the largest over all plants, with a new recording."""
    found = np.sqrt(np.maximum(np.diagonal(goal.covariance(told, before), axis1=1, axis2=2), 0.0)) * goal.scale
    return found[0], np.max(found, axis=0)


def errors_if_known(goal: Precision, told: Told) -> np.ndarray:
    """Standard errors (s,) in their units at the first plant with a new recording, of each one if all others were
    known."""
    total = goal.known_before + goal.information(told)[0]
    return goal.scale / np.sqrt(np.maximum(np.diag(total), 1e-300))


def gains(found: Designed) -> list[InputGain]:
    """How many times as large errors are with the best of each classical kind, or by how much less far apart the
    models."""
    return [
        InputGain(kind=c.kind, name=c.name, times=float(np.exp(c.cost - found.best.cost)))
        for c in sorted(found.classical, key=lambda c: c.cost)
    ]
