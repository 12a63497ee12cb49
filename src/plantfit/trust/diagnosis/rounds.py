"""One round of a diagnosis: every addition tried beside what is there, the best fitted in full, and judged."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.sobol import Sobol
from plantfit.trust.diagnosis.candidates import Changing
from plantfit.trust.diagnosis.catalogue import Extension
from plantfit.trust.diagnosis.judge import LEAST, beyond_end, evidence, needed, standard_error, times_noise, unseen
from plantfit.trust.diagnosis.plant.carrier import Carrier
from plantfit.trust.diagnosis.plant.hypothesis import (
    SINGULAR,
    Fitted,
    carrier_places,
    changing,
    columns,
    evaluate,
    fitted,
    lengths,
    speed_places,
    without,
)
from plantfit.trust.diagnosis.plant.timeless.static import static
from plantfit.trust.intervals.first_values import states_begun_at

QUICK, FINALISTS = 3, 6  # steps of a first try, additions fitted in full
CHANGES = 6  # of what may change with what that are tried
# of the mean square that these must explain, or times the sample-to-sample noise that they may leave
MOST, NEAR = (0.5, 3.0)
ALIKE = 8.0  # evidence for one of two additions below which the record does not tell them apart
PART = 0.02  # of what the better one explains: the same
SAME = 0.5  # cosine of what two additions take from the residual, below which they explain different parts of it
SAME_CURVE = 1e-3  # of what an addition does: one that does the same is the same curve
NEAR_BOUND, ELSEWHERE = 0.02, 3  # of the cube; other points that a fit begins from where one stood there
STEEP = 1e-3  # of the least standard error that a straight line gives
SURE = 2.0  # standard errors that a value is off zero
# of the work left to a round: what first tries may take, and full fits may have taken when one begins
TRYING, FITTING = (0.65, 0.85)

# why an addition that explains something is not found
WhyNot = Literal["not fitted", "chance", "not judged", "unseen", "beyond", "near zero", "no slope", "bends"]


@dataclass(frozen=True)
class Trial:
    """One addition tried: `explained` and `unseen` are shares of the mean square that is left without it (of
    `unseen` None where it was not fitted in full), `rmse` and `unseen_rmse` pairs (without, with), `value` its
    parameter with a standard error."""

    extension: Extension
    explained: float
    evidence: float
    rmse: tuple[float, float]
    unseen: float | None = None
    unseen_rmse: tuple[float, float] | None = None
    value: float | None = None
    standard_error: float | None = None
    at: Fitted | None = None


@dataclass(frozen=True)
class Round:
    """Additions tried beside those `given`: all `trials`, the best first, and which are `found`: one, or several that
    explain alike.

    `untried` are those for which the work allowed was not enough; with `whole` none is, and all of the best were fitted
    to their end. `base` is the fit with what was given that all are held against.
    """

    given: tuple[Extension, ...]
    trials: tuple[Trial, ...]
    found: tuple[Trial, ...]
    needed: float
    untried: tuple[Extension, ...] = ()
    whole: bool = True
    base: Fitted | None = None


def one_round(
    carrier: Carrier,
    base: Fitted,
    extensions: Sequence[Extension],
    use: np.ndarray,
    kept: np.ndarray,
    say: Callable[[str], None],
) -> Round:
    """Additions tried beside those of `base`: the best are fitted in full, and judged on unseen data."""
    left, meter = [e for e in extensions if e not in base.additions], carrier.meter
    quick, untried, begun, whole = [], [], meter.spent, True
    chosen, others = promising(carrier, base, left, use)
    ahead = sorted(chosen, key=_price)
    for k, e in enumerate(ahead):
        steps = _steps_for(carrier, base, ahead[k:], begun)
        if not meter.holds(_cost_of(carrier, base, e, steps), TRYING, begun):
            untried.append(e)
            continue
        say(f"trying {e.name}")
        one = tried(carrier, base, e, use, steps)
        if one is not None:
            quick.append((e, one))
    quick.sort(key=lambda pair: left.index(pair[0]))  # equals stay in the order of the catalogue
    quick.sort(key=lambda pair: pair[1].cost(use))
    before, n = base.cost(use), int(use.sum())
    unit = _scale(carrier)
    root = lambda square: float(np.sqrt(square)) * unit  # noqa: E731
    limit, trials = needed(len(left)), []
    for k, (e, one) in enumerate(quick):
        if k < FINALISTS and 1.0 - one.cost(use) / before >= 0.3 * LEAST:
            if k == 0 or meter.holds(0.0, FITTING, begun):
                say(f"fitting with {e.name}")
                full = fitted(carrier, one.additions, one.x, one.theta, use)
                one = full if full.cost(use) < one.cost(use) else one
            else:
                whole = False
        trials.append((e, one))
    trials.sort(key=lambda pair: pair[1].cost(use))
    if trials and evidence(base, trials[0][1], carrier.rows, use) >= limit and meter.holds(0.0):
        # a wrong model may press its parameters far into a valley; what brings them back is not the addition then
        if not trials[0][1].settled or _pressed(carrier, base) or _pressed(carrier, trials[0][1]):
            if meter.holds(0.0, FITTING, begun):
                say(f"fitting with {trials[0][0].name} from other values")
                trials = _from_elsewhere(carrier, trials, use)
            else:
                whole = False
        say(f"fitting without {trials[0][0].name}")
        again = without(carrier, trials[0][1], trials[0][0], use)
        if again.cost(use) < before:
            base, before = again, again.cost(use)
    rows = []
    for k, (e, one) in enumerate(trials):
        explained = max(0.0, 1.0 - one.cost(use) / before)
        rmse = root(before / n), root(one.cost(use) / n)
        told = evidence(base, one, carrier.rows, use)
        trial = Trial(e, explained, told, rmse, value=one.value(e, carrier), at=one)
        if k < FINALISTS and explained >= LEAST and told >= limit:
            if k == 0 or meter.holds(0.0):
                say(f"judging {e.name}")
                trial = judged(carrier, base, trial, use, kept)
            else:
                whole = False
        rows.append(trial)
    for e, share in others.items():
        rmse = root(before / n), root(before * (1.0 - share) / n)
        rows.append(Trial(e, share, 0.0, rmse))
    rows.sort(key=lambda t: -t.explained)
    found = found_of(carrier, base, rows, extensions, use, kept)
    return Round(base.additions, tuple(rows), found, limit, tuple(untried), whole and not untried, base)


def _steps_for(carrier: Carrier, base: Fitted, ahead: Sequence[Extension], begun: float) -> int:
    """Steps of the next first try: fewer where else the work allowed would not reach to the last addition."""
    for steps in range(QUICK, 1, -1):
        if carrier.meter.holds(sum(_cost_of(carrier, base, e, steps) for e in ahead), TRYING, begun):
            return steps
    return 1


def _cost_of(carrier: Carrier, base: Fitted, e: Extension, steps: int) -> float:
    """Evaluations of the cost that a first try of an addition takes at most."""
    return _price(e, steps) * carrier.charge(changing((*base.additions, e)))


def tried(carrier: Carrier, base: Fitted, e: Extension, use: np.ndarray, steps: int = QUICK) -> Fitted | None:
    """The best short fit, of so many steps, with an addition from its starts."""
    additions, best, speed = (*base.additions, e), None, speed_places(carrier, e)
    for start in e.starts or (0.0,):
        x = base.x.copy()
        if speed:
            x[speed], start = start * carrier.speeds[e.kind, e.signal][1], 0.0
        one = fitted(carrier, additions, x, np.r_[base.theta, start], use, steps)
        if np.isfinite(one.cost(use)) and (best is None or one.cost(use) < best.cost(use)):
            best = one
    return best


def promising(
    carrier: Carrier, base: Fitted, extensions: Sequence[Extension], use: np.ndarray, most: int = CHANGES
) -> tuple[list[Extension], dict[Extension, float]]:
    """The additions that are worth a first try, and the others with the share of the mean square that they explain by
    their derivatives.

    Of changes with a signal there are many: at `most` the best few are tried. The shares are those of a straight line
    once the derivatives by all that is fitted are projected out of effect and residual.
    """
    many = [e for e in extensions if isinstance(e.candidate, Changing)]
    if len(many) <= most:
        return list(extensions), {}
    r, jacobian = evaluate(carrier, base.additions, base.x, base.theta, changes=True)
    known = columns(carrier, base.additions)
    jacobian[:, known] = base.jacobian[:, known]  # with the columns that are differenced
    a, r = jacobian[use][:, known], r[use]
    q, s, _ = np.linalg.svd(a / lengths(a), full_matrices=False)
    q = q[:, s > SINGULAR * np.max(s, initial=0.0)]
    rest, square, shares = r - q @ (q.T @ r), float(r @ r), {}
    for e in many:
        own = jacobian[use][:, carrier_places(carrier, e)]
        own = own / lengths(own)
        apart = own - q @ (q.T @ own)
        size = float(np.sum(apart**2))
        shown = np.isfinite(size) and size > SINGULAR and square > 0.0
        shares[e] = float(np.sum(apart.T @ rest) ** 2) / size / square if shown else 0.0
    best = sorted(many, key=lambda e: -shares[e])[:most]
    chosen = [e for e in extensions if e not in shares or (e in best and shares[e] > 0.0)]
    return chosen, {e: min(share, 1.0) for e, share in shares.items() if e not in chosen}


def judged(carrier: Carrier, base: Fitted, t: Trial, use: np.ndarray, kept: np.ndarray) -> Trial:
    """A trial with its figures on unseen data."""
    assert t.at is not None
    unit, later = _scale(carrier), unseen(carrier, base, t.at, use, kept)
    roots = float(np.sqrt(later.base)) * unit, float(np.sqrt(later.extended)) * unit
    error = standard_error(carrier, t.at, t.extension, use)
    return replace(t, unseen=1.0 - later.extended / later.base, unseen_rmse=roots, standard_error=error)


def refitted(carrier: Carrier, base: Fitted, t: Trial, at: Fitted, use: np.ndarray, kept: np.ndarray) -> Trial:
    """A trial with the figures of another fit of the same additions."""
    before, after, unit = base.cost(use), at.cost(use), _scale(carrier)
    rmse = float(np.sqrt(before / use.sum())) * unit, float(np.sqrt(after / use.sum())) * unit
    told, explained = evidence(base, at, carrier.rows, use), max(0.0, 1.0 - after / before)
    made = replace(t, at=at, explained=explained, evidence=told, rmse=rmse, value=at.value(t.extension, carrier))
    return judged(carrier, base, made, use, kept)


def _price(e: Extension, steps: int = QUICK) -> int:
    """Simulations with derivatives that a first try of an addition takes at most."""
    return max(1, len(e.starts)) * (steps + 1) * (1 + e.candidate.differenced)


def found_of(
    carrier: Carrier,
    base: Fitted,
    trials: Sequence[Trial],
    extensions: Sequence[Extension],
    use: np.ndarray,
    kept: np.ndarray,
) -> tuple[Trial, ...]:
    """The addition that explains most and helps on unseen data, with those that the record cannot tell from it, in
    catalogue order.

    What changes with a signal bends to much that it is not: it has to explain most of what is left, or to come near the
    noise.
    """
    good = [t for t in trials if t.unseen is not None and why_not(t, carrier, 0.0, use, kept) is None]
    if not good:
        return ()
    best = max(good, key=lambda t: t.explained)
    assert best.at is not None
    alike = []
    for t in good:
        assert t.at is not None
        apart = evidence(t.at, best.at, carrier.rows, use)
        if t is not best and not _same_part(base, t.at, best.at, use):
            continue
        if t is best or apart < ALIKE or best.explained - t.explained < PART * (1.0 - best.explained) * best.explained:
            alike.append(t)
    alike = _consistent(carrier, alike)
    if static(carrier.given):
        alike = _in_plain_words(base, alike, use)
    return tuple(sorted(alike, key=lambda t: extensions.index(t.extension)))


def _in_plain_words(base: Fitted, alike: Sequence[Trial], use: np.ndarray) -> list[Trial]:
    """Additions to a static model that explain alike, without changes of a parameter that are one of the others in
    other words: a line whose slope changes with its input has a part by the square of it."""

    def same(t: Trial, other: Trial) -> bool:
        assert t.at is not None
        assert other.at is not None
        apart = (t.at.residuals - other.at.residuals)[use]
        return float(np.linalg.norm(apart)) <= SAME_CURVE * float(
            np.linalg.norm((base.residuals - other.at.residuals)[use])
        )

    plain = [t for t in alike if not changing([t.extension])]
    return [t for t in alike if t in plain or not any(same(t, other) for other in plain)]


def _consistent(carrier: Carrier, alike: Sequence[Trial]) -> list[Trial]:
    """Additions that explain alike, without an offset of an output beside the start of a state that begins at its first
    measured value: a sensor that is off shows that value off as well, and the state then begins with it, as of a plant
    that integrates."""
    starts = {t.extension.signal for t in alike if t.extension.kind == "start"}
    offsets = [t for t in alike if t.extension.kind == "offset"]
    begun = states_begun_at(carrier.given, carrier.z) if starts and offsets else {}
    return [t for t in alike if not (t in offsets and starts & set(begun.get(t.extension.signal, ())))]


def why_not(t: Trial, carrier: Carrier, limit: float, use: np.ndarray, kept: np.ndarray) -> WhyNot | None:
    """Why an addition is not found, whatever it explains; None where nothing is against it.

    "not fitted": its derivatives alone were looked at. "chance": its evidence is below the `limit`. "not judged": it
    was not compared on unseen data. "unseen": these are worse with it. "beyond": it is the end of a sensor, and the
    record goes on beyond it. "near zero", "no slope": its size may be nothing, or the samples tell none. "bends": it is
    a change with a signal, and explains too little for one.
    """
    if t.at is None:
        return "not fitted"
    if t.unseen is None:
        return "chance" if t.evidence < limit else "not judged"
    if t.unseen <= 0:
        return "unseen"
    if beyond_end(carrier, t.at, t.extension, use):
        return "beyond"
    if not _apart_from_nothing(t, carrier, int(use.sum())):
        assert t.value is not None
        assert t.standard_error is not None
        return "near zero" if t.standard_error > abs(t.value) / SURE else "no slope"
    if changing([t.extension]) and t.explained < MOST and not _near_noise(carrier, t, kept):
        return "bends"
    return None


def _same_part(base: Fitted, one: Fitted, other: Fitted, use: np.ndarray) -> bool:
    """Whether two fits take much the same from the residuals of a third, as friction on two joints does not."""
    a, b = ((base.residuals - f.residuals)[use] for f in (one, other))
    return float(a @ b) >= SAME * float(np.linalg.norm(a) * np.linalg.norm(b))


def _near_noise(carrier: Carrier, t: Trial, kept: np.ndarray) -> bool:
    assert t.at is not None
    return times_noise(carrier, t.at, ~kept) <= NEAR


def _pressed(carrier: Carrier, one: Fitted) -> bool:
    """Whether a parameter of the problem stands at a bound."""
    own = one.x[: carrier.own]
    return bool(np.any((own < NEAR_BOUND) | (own > 1.0 - NEAR_BOUND)))


def _from_elsewhere(
    carrier: Carrier, trials: Sequence[tuple[Extension, Fitted]], use: np.ndarray
) -> list[tuple[Extension, Fitted]]:
    """The trials, the best one fitted from some points of the box as well, and the others of the best from where
    that ended."""
    best, made = trials[0][1], list(trials)
    for z in Sobol(max(carrier.own, 1), np.random.default_rng(0)).random(ELSEWHERE)[:, : carrier.own]:
        x = best.x.copy()
        x[: carrier.own] = z
        one = fitted(carrier, best.additions, x, best.theta, use)
        best = one if one.cost(use) < best.cost(use) else best
    if best is trials[0][1]:
        return made
    made[0] = (trials[0][0], best)
    for k, (e, one) in enumerate(trials[1:FINALISTS], 1):
        x = one.x.copy()
        x[: carrier.own] = best.x[: carrier.own]
        again = fitted(carrier, one.additions, x, one.theta, use)
        made[k] = (e, again if again.cost(use) < one.cost(use) else one)
    made.sort(key=lambda pair: pair[1].cost(use))
    return made


def _apart_from_nothing(t: Trial, carrier: Carrier, samples: int) -> bool:
    """Whether the value of an addition that is nothing at zero is known to be something.

    By a straight line a value that takes a residual from one RMSE to another has a standard error of at least their
    ratio over sqrt(samples). Where that at the answer is far smaller, or 0, the model bends so much there, as with a
    friction beyond all forces, that it says nothing about the size.
    """
    if t.extension.candidate.level or t.value is None or t.standard_error is None:
        return True
    if t.extension.place == "inside" and len(carrier.inside[t.extension.kind, t.extension.signal]) > 1:
        return True  # a value for each recording
    least = STEEP * abs(t.value) * t.rmse[1] / max(t.rmse[0], 1e-300) / np.sqrt(max(samples, 1))
    return bool(least <= t.standard_error <= abs(t.value) / SURE)


def _scale(carrier: Carrier) -> float:
    """The unit of the RMSE: that of the output where there is one."""
    scales = carrier.given.scales
    return next(iter(scales.values())) if len(scales) == 1 else 1.0
