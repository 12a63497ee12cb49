"""The course of a diagnosis: additions found one after the other, then two at once where one alone tells nothing."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.extensions import KINDS
from plantfit.trust.diagnosis.catalogue import Extension, inside_kinds
from plantfit.trust.diagnosis.judge import LEAST, evidence, needed, standard_error, times_noise, unseen, validated
from plantfit.trust.diagnosis.outliers import Outliers, apart_of, outliers_of
from plantfit.trust.diagnosis.plant.carrier import Carrier
from plantfit.trust.diagnosis.plant.curves import Curve
from plantfit.trust.diagnosis.plant.cycles import Place, Repeating
from plantfit.trust.diagnosis.plant.disturbance import Disturbed
from plantfit.trust.diagnosis.plant.hypothesis import Fitted, carrier_places, changing, fitted, speed_places, without
from plantfit.trust.diagnosis.plant.slow_drift import Drifting, Rival
from plantfit.trust.diagnosis.plant.slow_mode import SlowMode
from plantfit.trust.diagnosis.plant.starts import begun_anew
from plantfit.trust.diagnosis.plant.stepping.moments import StepPlace
from plantfit.trust.diagnosis.plant.stepping.steps import Stepping
from plantfit.trust.diagnosis.rounds import (
    ALIKE,
    FINALISTS,
    FITTING,
    QUICK,
    Round,
    Trial,
    found_of,
    judged,
    one_round,
    promising,
    refitted,
    tried,
)

RIVALS = 3  # of an earlier finding that are tried in its place
WORTH = 0.1  # of the mean square that one addition must explain to be tried in the place of another
SHARP = 16  # times less is the speed from which on dry friction is whole, where it is found and that fits better
CLEAR = 1.1  # times the sample-to-sample noise: with more left something is missing
NEAR = 3.0  # times that two at once may leave,
LITTLE = 0.15  # or so much of what is left without them: friction that sticks is followed less well than it is measured
CHANGES = 2  # that two at once may have first, or second beside each of the first
PARTNERS = 3  # beside each of the first that are fitted in full
HELD = 0.5  # of what two at once explain that they must explain of unseen data


@dataclass(frozen=True)
class Diagnosis:
    """`rounds` of trials, each beside what the one before found; `outliers` and their rows `apart` (m,) bool; the
    `carrier` on which all were made and the fit of the model as it is (`base`). `unseen_blocks`: blocks were left
    out, since no part of the data is unseen. `dropped` were found first, and explain nothing beside what was found
    later; `exchanged` are pairs of what was found first and what fits better in its place then. `evaluations` of the
    cost were spent. It is `whole` where the work allowed was enough for everything; `linear` says where a linear
    model does far better than all that was found. `disturbed` is the fit beside a disturbance that wanders, where
    what the model or what was found leaves is one, `drifting` that beside slow drifts; `curves` are for the study
    file, of what wanders or drifts or of what was asked for. `rival` is a slow drift that does as well as all that
    was found. `repeating` is the fit beside a pattern that repeats every day, `places` are where one is to be
    written. `stepping` is the fit with a step at a moment, `stepped` are those to be written. `mode` is a
    lag of an input to an output that leaves the noise, where what was found does not."""

    carrier: Carrier
    base: Fitted
    apart: np.ndarray
    rounds: tuple[Round, ...]
    outliers: Outliers
    evaluations: float
    unseen_blocks: bool
    whole: bool = True
    dropped: tuple[Extension, ...] = ()
    exchanged: tuple[tuple[Extension, Extension], ...] = ()
    linear: tuple[str, ...] = ()
    disturbed: Disturbed | None = None
    drifting: Drifting | None = None
    curves: tuple[Curve, ...] = ()
    rival: Rival | None = None
    repeating: Repeating | None = None
    places: tuple[Place, ...] = ()
    stepping: Stepping | None = None
    stepped: tuple[StepPlace, ...] = ()
    mode: SlowMode | None = None

    @property
    def surpassed(self) -> bool:
        """Whether a linear model does far better than all that was found."""
        return bool(self.linear)

    @property
    def beside(self) -> tuple[Extension, ...] | None:
        """What of all that was found is needed beside a disturbance, a drift, a pattern that repeats, a step or a slow
        mode; None where there is none."""
        told = self.disturbed or self.drifting or self.repeating or self.stepping or self.mode
        return None if told is None else told.additions

    @property
    def end(self) -> Fitted:
        """The fit with all that was found."""
        return (self.found[-1].at if self.found else None) or self.base

    @property
    def found(self) -> tuple[Trial, ...]:
        """The first of each round that found something."""
        return tuple(r.found[0] for r in self.rounds if r.found)

    def answer_values(self) -> dict[str, float]:
        """Parameters of the problem by coordinate name, in their units, as the last fit has them, and those of what
        was found."""
        end = self.found[-1].at if self.found else self.base
        assert end is not None
        space = self.carrier.given.space
        values = dict(zip(space.names, np.asarray(space.physical(end.x[: self.carrier.own])).tolist(), strict=True))
        for a in end.additions:
            values[a.parameter] = end.value(a, self.carrier)
            values |= {f"{a.candidate.speed}_{a.signal}": float(end.x[i]) for i in speed_places(self.carrier, a)}  # pyrefly: ignore[missing-attribute]
        return values


@dataclass
class Course:
    """What is known so far: the fit without additions (`bare`), the one with all that was found (`base`), the rounds
    `made`, and which rows are used: `apart` (m,) bool are outliers."""

    carrier: Carrier
    bare: Fitted
    base: Fitted
    apart: np.ndarray
    outliers: Outliers
    say: Callable[[str], None]
    made: list[Round] = field(default_factory=list)
    dropped: list[Extension] = field(default_factory=list)
    exchanged: list[tuple[Extension, Extension]] = field(default_factory=list)
    whole: bool = True

    @classmethod
    def begun(cls, carrier: Carrier, say: Callable[[str], None]) -> "Course":
        """At the answer of a carrier: the model as it is, fitted without outliers."""
        rows = carrier.rows
        base = fitted(carrier, (), carrier.x, np.zeros(0), rows.fit)
        apart, behind = apart_of(base.residuals, carrier)
        outliers = outliers_of(base, apart, carrier, behind)
        if apart.any():
            base = fitted(carrier, (), base.x, np.zeros(0), rows.fit & ~apart)
        return cls(carrier, base, base, apart, outliers, say)

    @property
    def kept(self) -> np.ndarray:
        """Rows (m,) bool that no outlier takes away."""
        return ~self.apart

    @property
    def use(self) -> np.ndarray:
        """Rows (m,) bool that are fitted."""
        return self.carrier.rows.fit & ~self.apart

    def diagnosis(self, made: Sequence[Round]) -> Diagnosis:
        """What the rounds say together."""
        whole, rounds = self.whole and all(r.whole for r in made), _valued(self.carrier, made, self.use)
        return Diagnosis(
            self.carrier, self.bare, self.apart, tuple(rounds), self.outliers, self.carrier.meter.spent,
            not validated(self.carrier.rows, self.kept), whole, tuple(self.dropped), tuple(self.exchanged),
        )  # fmt: skip

    def alone(self, e: Extension) -> list[Round]:
        """The round of this addition, beside those before it, which is kept whatever it explains."""
        one = one_round(self.carrier, self.base, [e], self.use, self.kept, self.say)
        self.base = (one.trials[0].at if one.trials else None) or self.base
        return [one]

    def one_by_one(self, extensions: Sequence[Extension], rounds: int) -> None:
        """At most so many rounds, each beside what the one before it found."""
        meter, taken = self.carrier.meter, 0.0
        for _ in range(rounds):
            before = meter.spent
            if self.made and not meter.holds(taken):
                self.whole = False
                return
            one = one_round(self.carrier, self.base, extensions, self.use, self.kept, self.say)
            taken = meter.spent - before
            self.made = _with_better_base(self.carrier, self.bare, self.made, one, self.use, self.kept)
            self.bare = self.made[0].base or self.bare if self.made else one.base or self.bare
            self.made.append(one)
            if not one.found or one.found[0].at is None:
                return
            self.base = one.found[0].at
            self._settled(extensions)

    def two_at_once(self, extensions: Sequence[Extension]) -> bool:
        """Whether two additions were found in place of what was found one by one: the pair that leaves least, where
        more than noise is left without it and little more with it.

        Of two faults each may look like nothing, or like a third one, as long as the other one is not there.
        """
        carrier, meter, use = self.carrier, self.carrier.meter, self.use
        first = self.made[0]
        if not first.trials or times_noise(carrier, self.base, self.apart) <= CLEAR:
            return False
        ones = [t for t in first.trials if t.at is not None]
        # many stand for much: they must not take the places of others
        changes = [t for t in ones if changing([t.extension])]
        ones = [*[t for t in ones if t not in changes][:FINALISTS], *changes[:CHANGES]]
        ones.sort(key=lambda t: -t.explained)
        best: tuple[Trial, Fitted] | None = None
        for k, t in enumerate(ones):
            assert t.at is not None
            done = [o.extension for o in ones[: k + 1]]
            beside = []
            for e in promising(carrier, t.at, [e for e in extensions if e not in done], use, CHANGES)[0]:
                if not meter.holds(0.0, FITTING):
                    self.whole = False
                    break
                self.say(f"trying {t.extension.name} with {e.name}")
                one = tried(carrier, t.at, e, use)
                beside += [] if one is None else [one]
            for one in sorted(beside, key=lambda one: one.cost(use))[:PARTNERS]:
                full = fitted(carrier, one.additions, one.x, one.theta, use)
                full = full if full.cost(use) < one.cost(use) else one
                best = (t, full) if best is None or full.cost(use) < best[1].cost(use) else best
            if best is not None and times_noise(carrier, best[1], self.apart) <= CLEAR:
                break
        return best is not None and self._taken(extensions, *best)

    def _taken(self, extensions: Sequence[Extension], t: Trial, pair: Fitted) -> bool:
        """Whether a pair is more than chance, holds on unseen data and is better than what was found one by one;
        then it is taken."""
        use, kept, rows, count = self.use, self.kept, self.carrier.rows, len(extensions)
        assert t.at is not None
        carrier, end = self._sharper(pair) or (self.carrier, pair)
        if times_noise(carrier, end, self.apart) > max(NEAR, LITTLE * times_noise(self.carrier, self.bare, self.apart)):
            return False
        if evidence(self.bare, end, rows, use) < needed(count * (count - 1) // 2, 2):
            return False
        if self.base.additions and evidence(self.base, end, rows, use) < needed(count * (count - 1) // 2):
            return False
        for before in (
            self.bare,
            self.base,
        ):  # one of the two may be all that helps, and that was found without the other one
            later, explained = unseen(carrier, before, end, use, kept), 1.0 - end.cost(use) / before.cost(use)
            if 1.0 - later.extended / later.base < HELD * explained:
                return False
        first = replace(self.made[0], found=(judged(carrier, self.bare, t, use, kept),))
        second = one_round(self.carrier, t.at, extensions, use, kept, self.say)
        best = second.found[0].at if second.found else None
        if best is None or carrier is not self.carrier or best.cost(use) > end.cost(use):
            own = Trial(end.additions[-1], 0.0, 0.0, (0.0, 0.0))
            second = replace(second, found=(refitted(carrier, t.at, own, end, use, kept),))
            best = end
        gone = [a for a in self.base.additions if a not in best.additions]
        self.carrier, self.base, self.made, self.dropped, self.exchanged = carrier, best, [first, second], gone, []
        self._settled(extensions)
        return True

    def _sharper(self, one: Fitted) -> tuple[Carrier, Fitted] | None:
        """The carrier with sharper dry friction and a fit on it, where the fit has dry friction and that explains
        more."""
        carrier = self.carrier
        dry = any(a.kind in KINDS and "creep" in KINDS[a.kind].beside for a in one.additions)
        if (
            not dry
            or not carrier.given.predictor.has_steps
            or carrier.sharp > 1
            or not carrier.meter.holds(SHARP * carrier.charge(changing(one.additions)) * QUICK)
        ):
            return None
        self.say("fitting with sharper friction")
        sharp = Carrier.of(carrier.given, carrier.z, inside_kinds(carrier.given), carrier.meter, SHARP)
        at = fitted(sharp, one.additions, one.x, one.theta, self.use)
        return (sharp, at) if at.cost(self.use) <= (1.0 - LEAST) * one.cost(self.use) else None

    def _settled(self, extensions: Sequence[Extension]) -> None:
        """What a finding changes: the noise of first values that states begin at, outliers that it uncovers, dry
        friction that is sharper, and earlier findings that stood for it."""
        if begun := begun_anew(self.carrier, self.base, self.use):
            self._begun_anew(extensions, *begun)
        one = self.made[-1]
        anew, behind = apart_of(self.base.residuals, self.carrier)
        self.outliers = replace(self.outliers, **outliers_of(self.base, anew, self.carrier, behind).of_steps)
        if np.any(anew != self.apart):  # what a wrong model hid, or took for outliers
            self.apart = anew
            self.base = fitted(self.carrier, self.base.additions, self.base.x, self.base.theta, self.use)
            self.outliers = outliers_of(self.base, self.apart, self.carrier, behind)
            self._told(one)
        if sharper := self._sharper(self.base):
            self.carrier, self.base = sharper
            self._told(one)
        if len(self.base.additions) > 1:
            self.say("fitting without what was found before, and with what had helped in its place")
            self.base, self.made, better = _exchanged(
                self.carrier, self.bare, self.base, self.made, self.use, self.kept
            )
            self.exchanged += better
            self.base, self.made, gone = _pruned(self.carrier, self.bare, self.base, self.made, self.use, self.kept)
            self.dropped += gone

    def _begun_anew(self, extensions: Sequence[Extension], carrier: Carrier, base: Fitted) -> None:
        """The last finding on the carrier with first values as they are best beside it, and what helps as well with its
        own. These were held where a fit without any had put them, which may favour one that bends to that."""
        one, use, kept = self.made[-1], self.use, self.kept
        before = one.base or self.bare
        first = one.found[0]
        begun = {first.extension: (carrier, refitted(carrier, before, first, base, use, kept))}
        for t in one.trials:
            if t.unseen is None or t.at is None or t.extension in begun or not carrier.meter.holds(0.0, FITTING):
                continue
            self.say(f"fitting with {t.extension.name} from other first values")
            at = fitted(carrier, t.at.additions, t.at.x, t.at.theta, use)
            own, at = begun_anew(carrier, at, use) or (carrier, at)
            begun[t.extension] = own, refitted(own, before, t, at, use, kept)
        anew = [t for _, t in begun.values()]
        found = found_of(carrier, before, anew, extensions, use, kept) or (begun[first.extension][1],)
        self.made[-1] = replace(one, found=found)
        self.carrier, told = begun[found[0].extension]
        assert told.at is not None
        self.base = told.at

    def _told(self, one: Round) -> None:
        """The last round with the figures of the fit as it is."""
        first = refitted(self.carrier, one.base or self.bare, self.made[-1].found[0], self.base, self.use, self.kept)
        self.made[-1] = replace(one, found=(first, *one.found[1:]))


def _valued(carrier: Carrier, made: Sequence[Round], use: np.ndarray) -> list[Round]:
    """The rounds, the value of everything that was found being that of the fit with all of it; what a later one
    found does not stand for what an earlier one did."""
    firsts = [r.found[0].extension for r in made if r.found]
    made = [
        replace(r, found=(r.found[0], *(t for t in r.found[1:] if t.extension not in firsts)))
        if len(r.found) > 1
        else r
        for r in made
    ]
    found = [r for r in made if r.found]
    end = found[-1].found[0].at if found else None
    if end is None or len(found) < 2:
        return list(made)
    rounds = []
    for one in made:
        if one.found and one.found[0].extension in end.additions:
            e = one.found[0].extension
            first = replace(
                one.found[0], value=end.value(e, carrier), standard_error=standard_error(carrier, end, e, use)
            )
            one = replace(one, found=(first, *one.found[1:]))
        rounds.append(one)
    return rounds


def _pruned(
    carrier: Carrier, bare: Fitted, base: Fitted, made: Sequence[Round], use: np.ndarray, kept: np.ndarray
) -> tuple[Fitted, list[Round], list[Extension]]:
    """The fit and the rounds without additions that the last one found explains as well; which these were."""
    gone: list[Extension] = []
    for a in base.additions[:-1]:
        less = without(carrier, base, a, use)
        if evidence(less, base, carrier.rows, use) < made[-1].needed:
            base, gone = less, [*gone, a]
    rounds = [replace(r, found=()) if r.found and r.found[0].extension in gone else r for r in made]
    return base, _told_anew(carrier, bare, base, rounds, use, kept) if gone else list(made), gone


def _exchanged(
    carrier: Carrier, bare: Fitted, base: Fitted, made: Sequence[Round], use: np.ndarray, kept: np.ndarray
) -> tuple[Fitted, list[Round], list[tuple[Extension, Extension]]]:
    """The fit and the rounds, an earlier finding in exchange for one that had helped as well where the record prefers
    that one by now; which these were.

    What is found first may stand for two causes, of which it is neither.
    """
    rounds, pairs = list(made), []
    for k, one in enumerate(made[:-1]):
        if not one.found or one.found[0].extension not in base.additions:
            continue
        old, best, by = one.found[0].extension, base, None
        rivals = [
            t
            for t in one.trials[:FINALISTS]
            if t.extension not in base.additions and t.explained >= WORTH and t.at is not None
        ]
        for t in rivals[:RIVALS]:
            if not carrier.meter.holds(0.0, FITTING):
                break
            at = _in_place_of(carrier, base, old, t, use)
            if at.cost(use) < best.cost(use) and evidence(base, at, carrier.rows, use) >= ALIKE:
                best, by = at, t
        if by is not None:
            base, rounds[k] = best, replace(one, found=(by,))
            pairs.append((old, by.extension))
    return base, _told_anew(carrier, bare, base, rounds, use, kept) if pairs else rounds, pairs


def _in_place_of(carrier: Carrier, base: Fitted, old: Extension, t: Trial, use: np.ndarray) -> Fitted:
    """The fit with the addition of a trial in place of another one, from where both ended."""
    assert t.at is not None
    place, x, theta = base.additions.index(old), base.x.copy(), base.theta.copy()
    x[carrier_places(carrier, old)] = 0.0
    own = [*carrier_places(carrier, t.extension), *speed_places(carrier, t.extension)]
    x[own] = t.at.x[own]
    theta[place] = t.at.theta[t.at.additions.index(t.extension)]
    return fitted(carrier, (*base.additions[:place], t.extension, *base.additions[place + 1 :]), x, theta, use)


def _told_anew(
    carrier: Carrier, bare: Fitted, base: Fitted, made: Sequence[Round], use: np.ndarray, kept: np.ndarray
) -> list[Round]:
    """The rounds with the figures of the additions of a fit, one after the other."""
    rounds, before = list(made), bare
    for k, one in enumerate(rounds):
        if not one.found:
            continue
        upto = base.additions[: base.additions.index(one.found[0].extension) + 1]
        at = base
        for a in base.additions[len(upto) :]:
            at = without(carrier, at, a, use)
        rounds[k] = replace(one, found=(refitted(carrier, before, one.found[0], at, use, kept), *one.found[1:]))
        before = at
    return rounds


def _with_better_base(
    carrier: Carrier, bare: Fitted, made: Sequence[Round], last: Round, use: np.ndarray, kept: np.ndarray
) -> list[Round]:
    """The rounds, where the last one came upon a better fit of what the one before it had found."""
    if not made or last.base is None or not made[-1].found or made[-1].found[0].at is last.base:
        return list(made)
    first = made[-1]
    at = first.found[0].at
    assert at is not None
    if last.base.cost(use) >= at.cost(use):
        return list(made)
    return [
        *made[:-1],
        replace(
            first, found=(refitted(carrier, first.base or bare, first.found[0], last.base, use, kept), *first.found[1:])
        ),
    ]


__all__ = ["CLEAR", "Course", "Diagnosis"]
