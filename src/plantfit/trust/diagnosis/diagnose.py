"""What is missing in a model, by evidence: every addition of the catalogue is tried on the fitted problem, the best are fitted in full."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.models.model import Model
from plantfit.models.text.suggest import suggest
from plantfit.problem.problem import Problem
from plantfit.trust.diagnosis.carrier import Carrier, rows_of
from plantfit.trust.diagnosis.catalogue import Extension, catalogue, inside_kinds
from plantfit.trust.diagnosis.hypothesis import Fitted, carrier_places, fitted, without
from plantfit.trust.diagnosis.judge import LEAST, evidence, needed, standard_error, unseen, validated
from plantfit.trust.diagnosis.meter import Meter
from plantfit.trust.diagnosis.outliers import Outliers, outliers_of, outlying
from plantfit.trust.diagnosis.rounds import ALIKE, FINALISTS, FITTING, QUICK, Round, Trial, judged, one_round, refitted

ROUNDS = 3  # additions that may be named one after the other
RIVALS = 3  # of an earlier finding that are tried in its place
WORTH = 0.1  # of the mean square that one addition must explain to be tried together with a second
SHARP = 16  # times less is the speed from which on dry friction is whole, where it is found and that fits better
STRONG = 3.0  # times the evidence that is needed: "very likely"


@dataclass(frozen=True)
class Diagnosis:
    """`rounds` of trials, each beside what the one before found; `outliers` and their rows `apart` (m,) bool; the `carrier` on which all
    were made and the fit of the model as it is (`base`). `unseen_blocks`: blocks were left out, since no part of the data is unseen.
    `dropped` were found first, and explain nothing beside what was found later; `exchanged` are pairs of what was found first and what fits
    better in its place then. `evaluations` of the cost were spent. It is `whole` where
    the work allowed was enough for everything."""

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

    @property
    def found(self) -> tuple[Trial, ...]:
        """The first of each round that found something."""
        return tuple(r.found[0] for r in self.rounds if r.found)

    def answer_values(self) -> dict[str, float]:
        """Parameters of the problem by coordinate name, in their units, as the last fit has them, and those of what was found."""
        end = self.found[-1].at if self.found else self.base
        assert end is not None
        space = self.carrier.given.space
        values = dict(zip(space.names, np.asarray(space.physical(end.x[: self.carrier.own])).tolist(), strict=True))
        return values | {a.parameter: end.value(a, self.carrier) for a in end.additions}


def diagnose(
    problem: Problem,
    z: np.ndarray,
    progress: Callable[[str], None] | None = None,
    rounds: int = ROUNDS,
    only: str | Sequence[str] | None = None,
    meter: Meter | None = None,
) -> Diagnosis:
    """Try every addition of the catalogue at the answer z (d,) of a problem, and name those that the data ask for.

    At most `rounds` additions are named, each beside those before it. With `only`, as in "dead time of u", this one alone is tried; of
    several each beside those before it. `progress` is told what is being tried. A `meter` limits the work: what takes least is tried
    first. Raises ModelError for a model that is not simulated over time, and for an addition that the catalogue does not have; Stopped
    where the meter is asked to stop.
    """
    demand_treatable(problem)
    say, meter = progress or (lambda text: None), meter or Meter()
    problem = problem.unsmoothed
    extensions = catalogue(problem, rows_of(problem))
    wanted = None if only is None else chosen(extensions, [only] if isinstance(only, str) else only)
    carrier = Carrier.of(problem, z, inside_kinds(problem), meter)
    say("preparing")
    rows = carrier.rows
    base = fitted(carrier, (), carrier.x, np.zeros(0), rows.fit)
    apart = outlying(base.residuals, rows)
    kept = ~apart
    use = rows.fit & kept
    outliers = outliers_of(base, apart, carrier)
    if apart.any():
        base = fitted(carrier, (), base.x, np.zeros(0), use)
    made: list[Round] = []
    bare, waiting, whole, taken = base, False, True, 0.0
    dropped: list[Extension] = []
    exchanged: list[tuple[Extension, Extension]] = []
    if wanted is not None:
        for e in wanted:
            made.append(one_round(carrier, base, [e], use, kept, say))
            base = (made[-1].trials[0].at if made[-1].trials else None) or base
        return Diagnosis(carrier, bare, apart, tuple(made), outliers, meter.spent, not validated(rows, kept))
    for _ in range(rounds):
        before = meter.spent
        if made and not meter.holds(taken):
            whole = False
            break
        one = one_round(carrier, base, extensions, use, kept, say)
        taken = meter.spent - before
        if waiting:  # neither of two was enough alone; both are named where they are enough together
            both = _together(carrier, bare, made[-1], one, use, kept)
            if both is None:
                break
            made, one = [*made[:-1], both[0]], both[1]
        made = _with_better_base(carrier, bare, made, one, use, kept)
        bare = made[0].base or bare if made else one.base or bare
        made.append(one)
        best = one.trials[0] if one.trials else None
        waiting = not one.found and not waiting and not base.additions and best is not None and best.explained >= WORTH
        following = one.found[0].at if one.found else best.at if waiting and best is not None else None
        if following is None:
            break
        base = following
        anew = outlying(base.residuals, rows)
        if np.any(anew != apart):  # what a wrong model hid, or took for outliers
            apart, kept, use = anew, ~anew, rows.fit & ~anew
            base = fitted(carrier, base.additions, base.x, base.theta, use)
            outliers = outliers_of(base, apart, carrier)
            if one.found:
                made[-1] = replace(one, found=(refitted(carrier, one.base or bare, one.found[0], base, use, kept), *one.found[1:]))
        if one.found and one.found[0].extension.kind == "coulomb" and carrier.sharp == 1 and meter.holds(SHARP * carrier.charge * QUICK):
            say("fitting with sharper friction")
            sharp = Carrier.of(problem, z, inside_kinds(problem), meter, SHARP)
            at = fitted(sharp, base.additions, base.x, base.theta, use)
            if at.cost(use) <= (1.0 - LEAST) * base.cost(use):
                carrier, base = sharp, at
                made[-1] = replace(one, found=(refitted(carrier, one.base or bare, made[-1].found[0], at, use, kept), *one.found[1:]))
        if one.found and len(base.additions) > 1:
            say("fitting without what was found before, and with what had helped in its place")
            base, made, better = _exchanged(carrier, bare, base, made, use, kept)
            exchanged += better
            base, made, gone = _pruned(carrier, bare, base, made, use, kept)
            dropped += gone
    whole, made = whole and all(r.whole for r in made), _valued(carrier, made, use)
    return Diagnosis(
        carrier, bare, apart, tuple(made), outliers, meter.spent, not validated(rows, kept), whole, tuple(dropped), tuple(exchanged)
    )


def _valued(carrier: Carrier, made: Sequence[Round], use: np.ndarray) -> list[Round]:
    """The rounds, the value of everything that was found being that of the fit with all of it."""
    found = [r for r in made if r.found]
    end = found[-1].found[0].at if found else None
    if end is None or len(found) < 2:
        return list(made)
    rounds = []
    for one in made:
        if one.found and one.found[0].extension in end.additions:
            e = one.found[0].extension
            first = replace(one.found[0], value=end.value(e, carrier), standard_error=standard_error(carrier, end, e, use))
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
    """The fit and the rounds, an earlier finding in exchange for one that had helped as well where the record prefers that one by now;
    which these were.

    What is found first may stand for two causes, of which it is neither.
    """
    rounds, pairs = list(made), []
    for k, one in enumerate(made[:-1]):
        if not one.found or one.found[0].extension not in base.additions:
            continue
        old, best, by = one.found[0].extension, base, None
        rivals = [t for t in one.trials[:FINALISTS] if t.extension not in base.additions and t.explained >= WORTH and t.at is not None]
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
    if old.place == "inside":
        x[carrier_places(carrier, old)] = 0.0
    if t.extension.place == "inside":
        own = carrier_places(carrier, t.extension)
        x[own] = t.at.x[own]
    theta[place] = t.at.theta[t.at.additions.index(t.extension)]
    return fitted(carrier, (*base.additions[:place], t.extension, *base.additions[place + 1 :]), x, theta, use)


def _told_anew(carrier: Carrier, bare: Fitted, base: Fitted, made: Sequence[Round], use: np.ndarray, kept: np.ndarray) -> list[Round]:
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


def _with_better_base(carrier: Carrier, bare: Fitted, made: Sequence[Round], last: Round, use: np.ndarray, kept: np.ndarray) -> list[Round]:
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
        replace(first, found=(refitted(carrier, first.base or bare, first.found[0], last.base, use, kept), *first.found[1:])),
    ]


def treatable(problem: Problem) -> bool:
    """Whether a problem is one of models that are simulated over time."""
    moving = not any(e.steady for e in problem.experiments.values())
    return isinstance(problem.model, Model) and problem.predictor.has_steps and moving


def demand_treatable(problem: Problem) -> None:
    """Raises ModelError for a problem that is not `treatable`."""
    if not treatable(problem):
        name = problem.model.name
        raise ModelError(f"Diagnosis is for models that are simulated over time, and {name!r} is not; look at its residuals instead.")


def _together(carrier: Carrier, bare: Fitted, first: Round, second: Round, use: np.ndarray, kept: np.ndarray) -> tuple[Round, Round] | None:
    """Two rounds in which the best of either is found, where both together explain more than chance would of as many pairs."""
    a, b = first.trials[0], second.trials[0] if second.trials else None
    if b is None or a.at is None or b.at is None:
        return None
    pairs = len(first.trials) * len(second.trials)
    if evidence(bare, b.at, carrier.rows, use) < needed(pairs, 2):
        return None
    own = [judged(carrier, base, t, use, kept) for base, t in ((bare, a), (a.at, b))]
    later = unseen(carrier, bare, b.at, use, kept)
    if later.extended >= later.base or any(t.evidence < second.needed for t in own[1:]):
        return None
    return replace(first, found=(own[0],)), second if second.found else replace(second, found=(own[1],))


def chosen(extensions: Sequence[Extension], names: Sequence[str]) -> list[Extension]:
    """The additions of these names, each once. Raises ModelError for one that there is not, and lists those that there are."""
    by_name = {e.name: e for e in extensions}
    for name in names:
        if name.strip() not in by_name:
            raise ModelError(f"There is no {name!r} to try.{suggest(name, list(by_name))} There are: {', '.join(by_name)}.")
    return [by_name[n] for n in dict.fromkeys(name.strip() for name in names)]
