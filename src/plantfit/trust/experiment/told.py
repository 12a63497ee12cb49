"""What a designed input is worth, in sentences."""

from collections.abc import Sequence
from math import inf, nan
from statistics import NormalDist

from plantfit.findings.record import array
from plantfit.findings.results.next_experiment import ErrorsAfter, NextExperiment
from plantfit.trust.verdict.words import Sentence, say, some

LEAD = 1.02  # times, from which on an input counts as better than another
BEYOND = 0.5  # of the range that an output had, outside of which it is unknown land
MOST_LEVELS = 8  # in a sentence
TOLD_APART = 3.3  # standard deviations, at which 95 % of decisions are right


def precision_sentences(record: NextExperiment) -> list[Sentence]:
    """About errors of the parameters."""
    rows = record.parameters
    found = [_changed(rows, record), *_levels(record)]
    found += _beside(record, "Standard errors would be {times:.2f} times as large in the mean")
    found += _open(rows)
    larger = {r.name: r.worst / r.then for r in rows if r.then and r.worst}
    spread = [f"{n} {times:.2g} times" for n, times in larger.items() if times > 1.5]
    if spread:
        told = ", ".join(spread[:4])
        found.append(say("info", f"On other plants that the data allow errors can be larger: {told}."))
    return [*found, *_common(record)]


def difference_sentences(record: NextExperiment) -> list[Sentence]:
    """About two models told apart."""
    far = nan if record.distance is None else record.distance
    right = 100.0 * NormalDist().cdf(0.5 * far)
    share = f"{right:.3g} %" if right < 99.9 else "more than 99.9 %"
    level = "good" if far >= TOLD_APART else "warning"
    sentence = (
        f"Under this input the outputs that {record.name} and {record.against} foretell "
        f"lie {far:.3g} standard deviations apart, over noise and what their parameters "
        f"leave open: the right one of the two is told in {share} of recordings."
    )
    if far < TOLD_APART:
        sentence += " Widen the limits, record longer, or use a sensor with less noise."
    return [
        say(level, sentence),
        *_levels(record),
        *_beside(record, "The models would lie {closer:.2f} times closer"),
        *_common(record),
    ]


def _changed(rows: Sequence[ErrorsAfter], record: NextExperiment) -> Sentence:
    chosen = [r for r in rows if not r.open and (not record.chosen or r.name in record.chosen)]
    if not chosen:
        return say("info", f"{_much(record)} leave all parameters open that were asked for.")
    told = [f"{r.name} {_error(r.then, r)} (now {_error(r.now, r)})" for r in chosen[:8]]
    more = f" and {len(chosen) - 8} more" if len(chosen) > 8 else ""
    return say("good", f"With {_much(record)} the standard errors become: {', '.join(told)}{more}.")


def _much(record: NextExperiment) -> str:
    """How much is recorded, as it counts for the model."""
    return f"{record.samples} samples at these levels" if record.levels else f"{record.seconds:g} s of this input"


def _levels(record: NextExperiment) -> list[Sentence]:
    """Where to measure, of a model without dynamics."""
    if not record.levels:
        return []
    names, units = [i.name for i in record.inputs], [i.unit for i in record.inputs]
    if len(record.levels) > MOST_LEVELS:
        at = f"{len(record.levels)} levels, which the file lists"
    else:
        told = []
        for level in record.levels:
            each = [
                f"{n} = {v:.4g} {'' if u in (None, '1') else u}".rstrip()
                for n, v, u in zip(names, array(level.values), units, strict=True)
            ]
            told.append(f"{' with '.join(each)} ({level.samples} sample{'s' if level.samples > 1 else ''})")
        at = some(told, MOST_LEVELS)
    text = (
        f"The model follows {some(names)} at once, so that neither the order nor the times of the samples count: "
        f"measure at {at}, each when the plant is at rest."
    )
    return [say("info", text, levels=len(record.levels))]


def _error(value: float | None, row: ErrorsAfter) -> str:
    if value is None:
        return "unknown"
    return f"{100 * value / abs(row.value):.2g} %" if row.value else f"{value:.2g} {row.unit or ''}".rstrip()


def _beside(record: NextExperiment, words: str) -> list[Sentence]:
    """Against the best of the classical kinds, which are courses in time."""
    if record.levels:
        return []
    others = [c for c in record.compared if c.kind != record.kind]
    if record.kind != "designed":
        return [
            say(
                "info",
                f"Of all that was tried, a {record.shape} tells most; exchanging its levels found nothing better.",
            )
        ]
    if not others:
        return []
    best = others[0]
    times = {c.kind: inf if c.times is None else c.times for c in others}
    told = words.format(times=times[best.kind], closer=times[best.kind])
    rest = ", ".join(f"{c.kind} {times[c.kind]:.2f}" for c in others[1:])
    end = f" (others: {rest})" if rest else ""
    level = "good" if times[best.kind] > LEAD else "info"
    settings = f", a {best.name}" if best.name != best.kind else ""
    sentence = f"{told} with the best {best.kind} of the same length within the same limits{settings}{end}."
    return [say(level, sentence)]


def _common(record: NextExperiment) -> list[Sentence]:
    return [*_beyond(record), *_coloured(record), *_scattering(record)]


def _beyond(record: NextExperiment) -> list[Sentence]:
    """Inputs and outputs that would go where no recording has been."""
    found = []
    for i in record.inputs:
        if i.seen is None:
            continue
        low, high = array(i.seen)
        if _within((i.low, i.high), (low, high)) or (low == high and i.low <= low <= i.high):
            continue  # of one that never moved only where it stands is asked
        unit = f" {i.unit}" if i.unit not in (None, "1") else ""
        sentence = (
            f"{i.name} may go from {i.low:.4g} to {i.high:.4g}{unit}, and the recordings hold {low:.4g} to {high:.4g}"
            f"{unit}: nobody knows yet that the model holds there."
        )
        if i.high < low or i.low > high:
            sentence += f" Are these numbers meant in another unit than {i.unit or 'that of the study file'}?"
        found.append(say("warning", sentence))
    for o in record.outputs:
        (low, high), (least, most) = array(o.seen), array(o.reached)
        down, up = o.open in ("lower", "both"), o.open in ("upper", "both")
        if (down and least < low - BEYOND * (high - low)) or (up and most > high + BEYOND * (high - low)):
            unit = f" {o.unit}" if o.unit not in (None, "1") else ""
            sentence = (
                f"{o.name} would go from {least:.4g} to {most:.4g}{unit}, and the recordings hold {low:.4g} to "
                f"{high:.4g}: nobody knows "
                f"yet that the model holds there. Keep it within limits with --limit {o.name}=LOW..HIGH."
            )
            found.append(say("warning", sentence))
    return found


def _within(reached: Sequence[float], seen: Sequence[float]) -> bool:
    """Whether a signal stays near to where it has been."""
    low, high = seen
    return low - BEYOND * (high - low) <= reached[0] and reached[1] <= high + BEYOND * (high - low)


def _scattering(record: NextExperiment) -> list[Sentence]:
    if not record.scatters:
        return []
    text = (
        f"Recordings scatter in {some(record.scatters)}: the input serves "
        f"{record.plants} plants as another recording may find them."
    )
    return [say("info", text)]


def _open(rows: Sequence[ErrorsAfter]) -> list[Sentence]:
    """What the input does not tell: parameters that others can make up for, and those that hardly act."""
    found = []
    tied, weak = ([r.name for r in rows if r.open and r.alone_open is alone] for alone in (False, True))
    under = "under every input that was tried within these limits"
    if tied:
        each = "each by itself, " if len(tied) > 1 else ""
        one = "one of them" if len(tied) > 1 else "it"
        sentence = (
            f"{some(tied)} would stay open, {each}{under}, because others can make up for "
            f"{'them' if len(tied) > 1 else 'it'}; hold or measure {one}, or widen the limits."
        )
        found.append(say("warning", sentence))
    if weak:
        many = len(weak) > 1
        sentence = (
            f"{some(weak)} would stay open {under}, also if all others were known: {'they have' if many else 'it has'} "
            f"too little effect there. Hold {'them' if many else 'it'}, widen the limits, or record longer."
        )
        found.append(say("warning", sentence))
    return found


def _coloured(record: NextExperiment) -> list[Sentence]:
    """Why variances are taken to be larger than those of white noise."""
    if record.inflation <= 2.0:
        return []
    times = f"{record.inflation:.2g} times"
    scatter = f"recordings scatter in {some(record.widened)}" if record.widened else ""
    if record.correlated:
        sentence = (
            f"The residuals of the study are correlated{', and its ' + scatter if scatter else ''}, which makes "
            f"variances {times} those of white noise; the same is assumed of the new recording. What the model "
            "lacks counts as noise here: look for it first (plantfit diagnose)."
        )
        return [say("warning", sentence)]
    if scatter:
        sentence = (
            f"The study's {scatter}, which makes variances {times} those of white noise; the same is assumed of the "
            "new recording."
        )
        return [say("info", sentence)]
    why = (
        "its errors are larger where the parameters are told"
        if record.unlike > 0.5 * record.inflation
        else "its standard errors allow for more than noise"
    )
    sentence = (
        f"Variances of the study are {times} those of white noise of one size: {why}. The same is assumed of the new "
        "recording."
    )
    return [say("info", sentence)]
