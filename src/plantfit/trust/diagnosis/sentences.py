"""What a diagnosis says: a plain record, sentences first."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from plantfit.findings import diagnosis as records
from plantfit.models.extensions.changes import REFERENCE, WITH
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.trust.diagnosis.candidates import Changing, of_packages
from plantfit.trust.diagnosis.catalogue import Extension
from plantfit.trust.diagnosis.diagnose import STRONG, Diagnosis
from plantfit.trust.diagnosis.judge import beyond_end, by_output
from plantfit.trust.diagnosis.plant.cycles import DAY
from plantfit.trust.diagnosis.plant.slow_drift import Rival
from plantfit.trust.diagnosis.plant.timeless.static import static
from plantfit.trust.diagnosis.plant.unmeasured import SOME
from plantfit.trust.diagnosis.plant.unmeasured_told import (
    MORE,
    drifting_record,
    drifts,
    output_unit,
    repeating_record,
    repeats,
    slow_mode,
    stepping_record,
    steps,
    wandering_record,
    wanders,
)
from plantfit.trust.diagnosis.rounds import MOST, SURE, Round, Trial, WhyNot, why_not
from plantfit.trust.diagnosis.treatment import addition_lines, changed, outliers_taken
from plantfit.trust.verdict.words import Sentence, estimate, number, percent, plain_unit, say, some, with_unit
from plantfit.units import compatible, convert, difference_of

SMALL = 0.05  # of the mean square, from which on it is told why an addition is not named
FAILS = 2.0  # times the RMSE of fitted samples with what was found, from which on it does not hold on unseen ones
TELLS, LEAST_POWER = 0.25, 0.2  # of an exponent: its standard error at most, and its size at least
OF_COLUMNS = 0.2  # of what is left: errors of columns that are derivatives may leave less than that
MUCH = 3.0  # times the sample-to-sample noise: more is left than noise
ZERO, ROUNDED = (273.15, 0.02)  # K between K and degC, and by which that is rounded
MARGIN, CLOSE = (3.0, 3.0)  # standard errors that an offset may lie off it, and K that these may be
HOLDS = 0.9  # of what is left, from which on smooth dry friction explains so much that one which sticks may be all


# problem, output, its fitted and unseen samples by recording and what the model gives for it there, RMSE of both, noise
# from sample to sample, what the model is called; gives a sentence or ""
Series = Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]
Linear = Callable[[Problem, str, Series, tuple[float, float], float, str], str]


def with_linear(diagnosis: Diagnosis, linear: Linear | None) -> Diagnosis:
    """The diagnosis with what `linear` says of a linear model without physics, on outputs of which much is left
    (`first_look.linear_beside`)."""
    given = diagnosis.carrier.given
    simulated = isinstance(given.model, Model) and not static(given)
    if linear is None or not simulated or diagnosis.repeating or diagnosis.stepping or diagnosis.mode:
        return diagnosis
    return replace(diagnosis, linear=tuple(_linear(diagnosis, linear)))


def diagnosis_record(diagnosis: Diagnosis, alone: bool = True) -> dict[str, Any]:
    """The plain record of a diagnosis, JSON types only: "verdict" sentences, "outliers", "rounds" of what was tried,
    "write" lines.

    Not `alone` the sentences stand in a verdict that tells the noise itself and says where nothing is left to explain.
    """
    beside = [say("warning", text) for text in diagnosis.linear]
    return {
        "name": diagnosis.carrier.given.name,
        "verdict": [*_sentences(diagnosis, alone), *beside, *(say("info", text) for text in of_packages()[1])],
        "outliers": {
            "counts": {o: list(c) for o, c in diagnosis.outliers.counts.items()},
            "share": diagnosis.outliers.share,
        },
        "rounds": [_round(diagnosis, r).plain() for r in diagnosis.rounds],
        "dropped": [e.name for e in diagnosis.dropped],
        "exchanged": {old.name: new.name for old, new in diagnosis.exchanged},
        "write": addition_lines(changed(diagnosis)),
        "evaluations": diagnosis.evaluations,
        "wandering": wandering_record(diagnosis),
        "drifting": drifting_record(diagnosis),
        "repeating": repeating_record(diagnosis),
        "stepping": stepping_record(diagnosis),
    }


def _round(diagnosis: Diagnosis, one: Round) -> records.Round:
    return records.Round(
        beside=[e.name for e in one.given],
        needed=one.needed,
        found=[t.extension.name for t in one.found],
        likely=likelihood(diagnosis, one),
        untried=[e.name for e in one.untried],
        whole=one.whole,
        tried=[_trial(t) for t in one.trials],
    )


def _trial(t: Trial) -> records.Tried:
    e, later = t.extension, t.unseen_rmse
    return records.Tried(
        name=e.name, kind=e.kind, signal=e.signal, parameter=e.parameter, unit=e.unit, value=t.value,
        standard_error=t.standard_error,
        explained=t.explained, evidence=t.evidence, rmse=t.rmse[0], rmse_with=t.rmse[1],
        unseen_rmse=None if later is None else later[0], unseen_rmse_with=None if later is None else later[1],
    )  # fmt: skip


def _sentences(d: Diagnosis, alone: bool) -> Iterator[Sentence]:
    if d.outliers.named:
        for output, (count, total) in d.outliers.counts.items():
            if count:
                share = 100 * d.outliers.share
                beside = f" with {' and '.join(e.name for e in d.outliers.beside)}" if d.outliers.beside else ""
                step, taken = outliers_taken(d, output)
                yield say(
                    "warning",
                    f"{count} of {total} samples of {output} lie far from their neighbours and hold {share:.0f} "
                    f"% of the squares of the residual{beside}: outliers, which this diagnosis leaves out. "
                    f"{step} under clean takes {'them' if taken == count else f'{taken} of them'} away.",
                    count=count,
                    share=d.outliers.share,
                )
    for output, count in d.outliers.behind.items() if d.outliers.behind_share >= 0.05 else ():
        yield say(
            "info",
            f"{count} samples of {output} right behind steps of inputs lie far from their neighbours and hold "
            f"{100 * d.outliers.behind_share:.0f} % of the squares of the residual. They are no outliers: a clock that "
            "shakes, or an input that is written between two samples, makes the recorded step early or late. Keep "
            "them; sample faster, or record when the input was written.",
            count=count,
            share=d.outliers.behind_share,
        )
    if d.repeating is not None:  # these explain more than all that follows
        yield repeats(d, d.repeating)
    if d.stepping is not None:
        yield steps(d, d.stepping)
    if d.mode is not None:
        yield slow_mode(d, d.mode)
    for k, one in enumerate(r for r in d.rounds if r.found):
        yield _found(d, one, k)
    if d.rival is not None:
        yield _rivalled(d, d.rival)
    if d.carrier.meter.stopped and d.rounds:
        first = d.rounds[0]
        tried, every = len(first.trials), len(first.trials) + len(first.untried)
        part = f"{tried} of {every} additions to the model were tried until then"
        alone_only = f"all {every} additions to the model were tried alone, and not all beside each other"
        yield say("info", f"It was stopped: {part if first.untried else alone_only}.", tried=tried)
    for e in d.dropped:
        text = f"{e.article} {e.name}".strip()
        yield say(
            "info",
            f"{text[0].upper()}{text[1:]} was found first, and explains "
            "nothing beside that: it stood for what was found later.",
        )
    for old, new in d.exchanged:
        first, better = (f"{e.article} {e.name}".strip() for e in (old, new))
        text = (
            f"{first[0].upper()}{first[1:]} was found first; beside what was found later "
            f"{better[0].lower()}{better[1:]} fits better"
        )
        yield say("info", f"{text} in its place.")
    if not d.found and d.rounds and d.mode is None:
        yield _nothing(d, alone)
    last = d.rounds[-1] if d.rounds else None
    if d.found and last and not last.found and last.trials and d.mode is None:
        text = _fails(d, last, "Beside that, none")
        text = text or f"Beside that, nothing that was tried explains more than {percent(_best(last))}."
        yield say("info", text, explained=_best(last))
    asked = bool(d.curves or d.places or d.stepped) and d.beside is None
    if (alone or d.found) and not asked:
        yield from _left(d)
    for p in d.places if asked else ():
        yield say(
            "info", f"{p.name[0].upper() + p.name[1:]}: a smooth curve over {DAY / 3600:g} h, the same every day."
        )
    for p in d.stepped if asked else ():
        yield say("info", f"{p.name[0].upper() + p.name[1:]}: at t = {number(p.at, 4)} s, where one explains most.")
    if d.curves and asked:
        yield say(
            "info",
            f"{some([c.name[0].upper() + c.name[1:] for c in d.curves])}: "
            "a curve in time, as smooth as the data ask for.",
        )
    if d.disturbed is not None and not d.surpassed:
        yield wanders(d, d.disturbed)
    if d.drifting is not None and not d.surpassed:
        yield drifts(d, d.drifting)


def likelihood(d: Diagnosis, one: Round) -> Literal["very likely", "likely", "possibly"] | None:
    """How sure the sentence of a round is: "very likely", "likely", "possibly"; None where the round found nothing."""
    if not one.found:
        return None
    best = max(one.found, key=lambda t: t.explained)
    sure = (
        min(t.evidence for t in one.found) >= STRONG * one.needed
        and best.unseen is not None
        and best.unseen >= 0.5 * best.explained
    )
    much = _stands_for_more(d) or _beside_exponent(d, one) or _undriven(d, one)
    if d.beside is not None and len(d.beside) < len(d.end.additions):
        return "possibly"  # a disturbance or a drift does without it
    if d.rival is not None or d.surpassed or of_columns(d, one):
        return "possibly"
    return "very likely" if sure and one.whole and not much else "likely" if one.whole else "possibly"


def of_columns(d: Diagnosis, one: Round) -> bool:
    """Whether the errors of a regression's columns, made by differentiation, may leave as much as was found."""
    return bool(d.carrier.given.differentiated) and max((t.explained for t in one.found), default=1.0) < OF_COLUMNS


def _instead(d: Diagnosis) -> str:
    """What is told in place of additions to the model; "" where nothing is."""
    told = {"pattern": d.repeating, "step": d.stepping, "slow mode": d.mode}
    return next((name for name, one in told.items() if one is not None), "")


def _found(d: Diagnosis, one: Round, k: int) -> Sentence:
    """One addition, or several that explain alike."""
    best = max(one.found, key=lambda t: t.explained)
    likely, much = likelihood(d, one), _stands_for_more(d) or _beside_exponent(d, one) or _undriven(d, one)
    left = "what is left" if k == 0 else "what is then left"
    instead = _instead(d)
    shown = f"Without that {instead}, {_phrase(one.found[0])}" if instead else _shown(one.found[0])
    text = f"{shown} explains {percent(one.found[0].explained)} of {left} ({_figures(d, one.found[0])})"
    if instead:
        text += f": less than the {instead} does, so it may stand for that."
    elif d.surpassed:  # what a state more does may look like any of them
        text += ": less than a linear model does (see below), so it may stand for that."
    elif one.untried:
        text += f": it may be missing, or stand for {_untried(d, one)}."
    elif len(one.found) == 1:
        text += f": {likely} missing{_or_else(d, one, 'it stands')}."
    else:
        rest = one.found[1:]
        if len(rest) == 1:
            others = f"{_phrase(rest[0])} ({percent(rest[0].explained)}) explains"
        else:
            named = [f"{t.extension.article} {t.extension.name}".strip() for t in rest]
            others = f"{', '.join(named[:-1])} and {named[-1]} explain"
        text += (
            f", and {others} it as well: one of them is {likely} missing{_or_else(d, one, 'they stand')}, and this "
            "record cannot tell which."
        )
    if not instead and much and any(t.extension.kind in ("dead_zone", "input_offset") for t in one.found):
        text += " A rate that is curved in a state, as the outflow of a tank in its level, looks like that."
    if not instead and much:
        text += _holding_friction(d, one)
    if not instead and not d.surpassed:
        text += _exponent(d, one.found[0])
    if not instead and not d.surpassed:
        text += _other_zero(one)
    if not instead and _undriven(d, one):
        text += " Nothing drives the plant, so that a change with its state, as of a wrong exponent, looks the same."
    if not instead and not d.surpassed and any(t.extension.kind in ("lag", "sensor_lag") for t in one.found):
        text += " Another part of the plant that lags looks the same, as a second mass that takes up heat."
    figures = {"explained": best.explained, "rmse": best.rmse[0], "rmse_with": best.rmse[1], "evidence": best.evidence}
    return say("warning", text, **figures)


def _or_else(d: Diagnosis, one: Round, stands: str) -> str:
    """What else may leave what was found; "" where nothing is known of."""
    if of_columns(d, one):
        return f", or {stands} for the errors of {some(list(d.carrier.given.differentiated))} in the columns"
    much = _stands_for_more(d) or _beside_exponent(d, one) or _undriven(d, one)
    return f", or {stands} for something that is not among the additions" if much else ""


def _other_zero(one: Round) -> str:
    """That an offset of a temperature is what two of its units lie apart: the numbers may be in another one. Said only
    where the offset is known closely."""
    for t in one.found:
        e, value, error = t.extension, t.value, t.standard_error
        if e.kind not in ("offset", "input_offset") or value is None or error is None or not e.unit:
            continue
        if not compatible(e.unit, "delta_degC"):
            continue
        far, near = (abs(float(convert(v, e.unit, "delta_degC"))) for v in (value, error))
        if MARGIN * near <= CLOSE and abs(far - ZERO) <= MARGIN * near + ROUNDED:
            return (
                f" K and degC lie {ZERO:g} K apart: the numbers of {e.signal} may be in one of them and be read in the "
                f"other. Look at the unit of {e.signal} in the recording and in the model first."
            )
    return ""


def _holding_friction(d: Diagnosis, one: Round) -> str:
    """That dry friction may be what looks like a dead zone: as an addition it is smooth, and a plant that rests against
    a force creeps away under it."""
    dry = next((t for t in one.trials if t.extension.kind == "coulomb" and t not in one.found), None)
    if (
        dry is None
        or dry.at is None
        or dry.explained < HOLDS
        or not any(t.extension.kind == "dead_zone" for t in one.found)
    ):
        return ""
    signal = dry.extension.signal
    return (
        f" So does dry friction of {signal} that holds the plant at rest: it was tried as a smooth one, under which "
        f"the plant creeps ({_figures(d, dry)}). Compare: write the model as equations, with friction({signal}, F) "
        f"subtracted in the rate of {signal}."
    )


def _untried(d: Diagnosis, one: Round) -> str:
    """What a finding may stand for: additions that no round tried, else those not tried beside what was found."""
    tried = {t.extension for r in d.rounds for t in r.trials}
    never = [e for e in one.untried if e not in tried]
    count, where = (len(never), "") if never else (len(one.untried), " beside what was found before")
    return (
        f"one of the {count} additions that were not tried{where}"
        if count > 1
        else (f"the one addition that was not tried{where}")
    )


def _exponent(d: Diagnosis, t: Trial) -> str:
    """What a change with a state that stays positive says of an exponent: near x0 a factor 1 + c (x - x0) does what a
    power c x0 of x does, as of an outflow by the root of a level or a reaction of another order."""
    e = t.extension
    if not isinstance(e.candidate, Changing) or t.value is None or t.standard_error is None or t.at is None:
        return ""
    subject, driver = e.signal.split(WITH)
    model = d.carrier.given.model
    if not isinstance(model, Model) or driver not in model.states or subject in model.inputs:
        return ""
    low, reference = _lowest(d, driver), d.carrier.values.get(f"{REFERENCE}_{e.signal.replace(' ', '_')}", 0.0)
    power, error = t.value * reference, t.standard_error * reference
    if not low > 0.0 or reference <= 0.0 or error > TELLS or abs(power) < LEAST_POWER:
        return ""
    more = "higher" if power > 0 else "lower"
    near = with_unit(reference, plain_unit(model.states[driver]))
    return (
        f" Near {driver} = {near} a power of {driver} that is {number(abs(power), 2)} {more} does the same: an "
        f"exponent of {driver} in what {subject} does may be wrong, as of an outflow or the order of a reaction."
    )


def _beside_exponent(d: Diagnosis, one: Round) -> bool:
    """Whether another round found what a wrong exponent does: an offset beside that is a part of the same curve."""
    return any(_exponent(d, r.found[0]) for r in d.rounds if r.found and r is not one)


def _undriven(d: Diagnosis, one: Round) -> bool:
    """Whether a change with time was found of a plant that no input moves: its state is a function of time, and a
    change with the state does the same."""
    given = d.carrier.given
    if not isinstance(given.model, Model) or not any(t.extension.signal.endswith(f"{WITH}t") for t in one.found):
        return False
    records = [e.recording for e in given.experiments.values()]
    return not any(np.ptp(np.nan_to_num(r[u])) > 0 for r in records for u in given.model.inputs)


def _lowest(d: Diagnosis, state: str) -> float:
    """The least value of a state in all recordings, at the answer of the model as it is."""
    given = d.carrier.given
    values, found = given.space.physical(d.carrier.z), np.inf
    for name in given.experiments:
        drive = given.whole_drives[name]
        x = np.asarray(given.compiled["trajectories"](given.space.tree(values, name), drive)[state], dtype=float)
        found = min(found, float(np.min(x)) if x.size and np.all(np.isfinite(x)) else -np.inf)
    return found


def _rivalled(d: Diagnosis, found: Rival) -> Sentence:
    """A slow drift that may be all of it."""
    y = found.drift.output
    moved = with_unit(found.drift.moves, plain_unit(difference_of(d.carrier.given.model.outputs[y])))
    that = "that" if len(d.end.additions) == 1 else "all of that"
    text = (
        f"A slow drift of {y}, a curve in time that moves by up to {moved}, explains {percent(found.explains)} of "
        f"what is left by itself, "
        f"as well as {that}: this record does not tell which. What comes back when the record is repeated is no drift. "
        f"Try it by "
        f'--try "slow drift of {y}".'
    )
    return say("warning", text, explained=found.explains)


def _figures(d: Diagnosis, t: Trial) -> str:
    unit = output_unit(d)
    scaled = "scaled " if len(d.carrier.given.outputs) > 1 else ""
    text = f"{scaled}RMSE {number(t.rmse[0])} to {with_unit(t.rmse[1], unit)}"
    if t.unseen_rmse is None:
        return text
    where = "blocks left out" if d.unseen_blocks else "unseen data"
    return f"{text}; {where} {number(t.unseen_rmse[0])} to {number(t.unseen_rmse[1])}"


def _nothing(d: Diagnosis, alone: bool) -> Sentence:
    first = d.rounds[0]
    best = _best(first)
    text = _fails(d, first, "None") or (
        f"{f'Without that {_instead(d)}, nothing' if _instead(d) else 'Nothing'} that was tried explains more than "
        f"{percent(best)} "
        f"of what is left ({len(first.trials)} additions to the model)."
    )
    good = alone and best < SMALL and not d.surpassed and not _much_left(d) and d.beside is None
    return say("good" if good else "info", text, explained=best)


def _fails(d: Diagnosis, one: Round, none: str) -> str:
    """Why what explains much is not named, "" where nothing explains much; `none` begins the sentence."""
    kept = ~d.apart
    use = d.carrier.rows.fit & kept
    found = [(t, why_not(t, d.carrier, one.needed, use, kept)) for t in one.trials if t.explained >= SMALL]
    failed = [(t, why) for t, why in found if why is not None]
    if not failed:
        return ""
    best, why = failed[0]
    # those that were fitted, and compared on unseen data where they explain enough for that
    undecided = sum(why == "not judged" for _, why in found)
    count = sum(t.at is not None for t in one.trials) - undecided
    full = "in full " if undecided else ""
    tried = f"of the {count} additions to the model that were tried {full}holds"
    if len(one.trials) == 1:
        none, tried = "The one addition", "that was tried does not hold"
    elif count == 1:
        none, tried = "The one addition", f"that was tried {full}does not hold"
    elif count == 0:
        none, tried = none.removesuffix("none").removesuffix("None") + "no addition", "was tried in full"
        none = none[0].upper() + none[1:]
    shown = _shown(replace(best, standard_error=None) if why == "no slope" else best)
    text = f"{none} {tried}. {shown} explains {percent(best.explained)} of what is left"
    text = f"{text}{_against(d, one, best, why)}."
    others = [why for _, why in failed[1:]]
    if not others:
        return text
    counts = {why: others.count(why) for why in dict.fromkeys(others)}
    if len(counts) == 1:
        which, them = ("The one other", "s") if len(others) == 1 else (f"The {len(others)} others", "")
        return f"{text} {which} that explain{them} {percent(SMALL)} or more {_MORE[others[0]][len(others) > 1]}."
    told = [f"{n} {_MORE[why][n > 1]}" for why, n in counts.items()]
    return f"{text} Of {len(others)} others that explain {percent(SMALL)} or more {some(told)}."


# of one, of several
_MORE: dict[WhyNot, tuple[str, str]] = {
    "not fitted": ("was not fitted", "were not fitted"),
    "chance": ("may be chance", "may be chance"),
    "not judged": ("was not tried on unseen data", "were not tried on unseen data"),
    "unseen": ("makes unseen data worse", "make unseen data worse"),
    "beyond": ("is the end of a sensor that measured beyond it", "are ends of sensors that measured beyond them"),
    "near zero": ("may have the size 0", "may have the size 0"),
    "no slope": ("has a size that the samples do not tell", "have sizes that the samples do not tell"),
    "bends": ("is a change that explains too little", "are changes that explain too little"),
}


def _against(d: Diagnosis, one: Round, t: Trial, why: WhyNot) -> str:
    """What speaks against an addition that explains much, as the end of a sentence."""
    if why == "unseen":
        return f" on the fitted samples ({_figures(d, t)}), and predicts the unseen ones worse"
    if why == "chance":
        return (
            f", which may be chance: its evidence, twice the gain of log-likelihood, is {number(t.evidence)}, and the "
            f"best of {len(one.trials)} reaches {number(one.needed)} in 1 % of the records that lack nothing"
        )
    if why == "beyond":
        assert t.at is not None
        use = d.carrier.rows.fit & ~d.apart
        share = beyond_end(d.carrier, t.at, t.extension, use)
        return f", and {percent(share)} of the samples lie beyond that end, which such a sensor does not show"
    if why == "near zero":
        return f", and that size is within {SURE:g} standard errors of 0"
    if why == "no slope":
        return ", and the samples do not tell that size: the model bends too much there for a standard error"
    if why == "bends":
        return f": too little for what changes with a signal, which can stand for much; {percent(MOST)} is asked for"
    return " by its derivatives; it was not fitted" if why == "not fitted" else ", and was not tried on unseen data"


def _best(one: Round) -> float:
    return max((t.explained for t in one.trials), default=0.0)


def _left(d: Diagnosis) -> Iterator[Sentence]:
    """Whether more than noise is left after all that was found, where nothing else is to explain it."""
    filtered = d.carrier.given.filtered
    if filtered is not None and filtered.moves:
        return
    for output, times in _much_left(d).items():
        if d.beside is not None and not d.surpassed:
            continue  # it is told what that is
        yield say(
            "warning",
            f"Of {output} {number(times)} times its sample-to-sample noise is left, which nothing that was "
            "tried explains beyond doubt: something else is missing, or the record is too short to tell.",
            times=times,
        )


def _linear(d: Diagnosis, linear: Linear) -> Iterator[str]:
    """What a linear model does where more than noise is left after all that was found."""
    given, rows, end = d.carrier.given, d.carrier.rows, d.end
    for output, times in by_output(d.carrier, end, d.apart).items():
        if times <= SOME:
            continue
        used, squares = {}, ([], [])
        for name, e in given.experiments.items():
            at, masks = rows.part(name, output), np.zeros((2, len(e.recording)), dtype=bool)
            simulated = np.full(len(e.recording), np.nan)
            for mask, own, found in zip(masks, (rows.fit, rows.unseen), squares, strict=True):
                part = at[own[at] & ~d.apart[at]]
                mask[rows.sample[part]] = True
                found.append((end.residuals[part] / rows.weight[part] * given.scales[output]) ** 2)
                error = d.base.residuals[part] / rows.weight[part]
                simulated[rows.sample[part]] = (rows.measured[part] + error) * given.scales[output]
            used[name] = (masks[0], masks[1], simulated)
        fit, unseen = (np.concatenate(s) for s in squares)
        rmse = float(np.sqrt(np.mean(fit)))
        later = float(np.sqrt(np.mean(unseen))) if len(unseen) else float("nan")
        box = "this one and what was found" if d.found else "this one"
        if text := linear(given, output, used, (rmse, later), rmse / times, box):
            yield text


def _stands_for_more(d: Diagnosis) -> bool:
    """Whether what was found may stand for something else: a cause that is not in the catalogue may look like one
    that is, and then more than noise is left, or unseen samples are followed far worse than fitted ones."""
    if d.surpassed or any(times > MORE for times in by_output(d.carrier, d.end, d.apart).values()):
        return True
    last = d.found[-1] if d.found and not d.unseen_blocks else None
    return last is not None and last.unseen_rmse is not None and last.unseen_rmse[1] >= FAILS * last.rmse[1]


def _much_left(d: Diagnosis) -> dict[str, float]:
    """By output how many times its noise is left after all that was found, where that is `MUCH`."""
    return {o: times for o, times in by_output(d.carrier, d.end, d.apart).items() if times > MUCH}


def _shown(t: Trial) -> str:
    text = _phrase(t)
    return text[0].upper() + text[1:]


def _phrase(t: Trial) -> str:
    return t.extension.candidate.phrase.format(_value(t), t.extension.signal)


def _value(t: Trial) -> str:
    e: Extension = t.extension
    row = {"name": "x", "value": t.value, "standard_error": t.standard_error, "unit": plain_unit(e.unit)}
    return estimate(row).removeprefix("x = ") if t.value is not None else "unknown size"
