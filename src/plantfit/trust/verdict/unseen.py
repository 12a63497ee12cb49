"""What the verdict says about samples that were not fitted, and of which outputs the model does not hold there."""

from collections.abc import Iterator, Sequence

import numpy as np

from plantfit.trust.verdict.estimators.filtered import ahead_of, moved_by_noise
from plantfit.trust.verdict.outputs import (
    FLOOR,
    GOOD,
    Findings,
    Row,
    decided_by_outliers,
    diagnosed,
    disagree,
    each_output,
    most_noise,
    place,
    recordings_named,
    shows_nothing,
)
from plantfit.trust.verdict.words import Sentence, number, say, span, times_the_mean, with_unit, worst

# times the RMSE of fitted samples, up to which unseen ones are followed as well, and from which on they are not
HOLDS, FAILS = (1.3, 2.0)
EXACT = 99.9  # percent: so much of what an output does, and unseen samples hold whatever the fitted ones do
POOR = 50  # percent of unseen samples below which a model that is no worse than on the fitted ones does not hold there
MUCH = 3.0  # times that noise: more is left than noise, however small that is beside what an output does
SOLVED = 99.99  # percent of what an output does: the rest may be the error of a solver, and is no noise to compare with


def unseen_sentences(findings: Findings) -> Iterator[Sentence]:
    """Whether it holds on samples that were not fitted."""
    unseen = [r for r in findings["scores"] if r["part"] == "validation"]
    if not unseen and any("validation" in o["part"] for r in findings["recordings"] for o in r["outputs"].values()):
        yield say(
            "warning",
            "No output was measured where samples were kept unseen, so nothing shows yet that the "
            "model holds on new data: give an earlier split or a second recording.",
        )
    elif not unseen:
        yield say(
            "warning",
            "Nothing was kept unseen, so nothing shows yet that the "
            "model holds on new data: give a split or a second recording.",
        )
    spoiled = {output for _, output in decided_by_outliers(findings)}
    simulated = [r for r in unseen if not _lost(r)]
    yield from each_output(findings, [r for r in unseen if _lost(r)], _lost_one, _lost_many)
    yield from each_output(
        findings, [r for r in simulated if r["output"] in spoiled], _beside_outliers, _many_beside_outliers
    )
    yield from each_output(findings, [r for r in simulated if r["output"] not in spoiled], _unseen, _unseens)


_LITTLE = "the fitted samples, that it would be compared with, are decided by outliers, so that this tells little"


def _beside_outliers(findings: Findings, row: Row) -> Sentence:
    """Unseen samples where outliers decide how far the fitted ones are off."""
    rmse = with_unit(row["rmse"], row["unit"])
    text = f"On samples it has not seen, the RMSE of {place(findings, row)} is {rmse}; {_LITTLE}."
    return say("info", text, rmse=row["rmse"])


def _many_beside_outliers(findings: Findings, output: str, rows: Sequence[Row]) -> Iterator[Sentence]:
    rmse = span([r["rmse"] for r in rows], rows[0]["unit"])
    text = f"On samples it has not seen, the RMSE of {output} in {len(rows)} recordings is {rmse}; {_LITTLE}."
    yield say("info", text, rmse=max(r["rmse"] for r in rows), recordings=len(rows))


def _lost(row: Row) -> bool:
    """Whether the simulation of unseen samples is not a number."""
    return row["rmse"] is None


_WHY = (
    "There the model leaves what its equations allow, as the root of a negative level, or grows without bound: it "
    "does not hold there."
)


def _lost_one(findings: Findings, row: Row) -> Sentence:
    """From when on unseen samples cannot be simulated, and why that may be."""
    text = (
        f"Samples that it has not seen cannot be simulated: {place(findings, row)} is not a "
        f"number{_lost_from(findings, row)}. {_WHY}"
    )
    return say("bad", text)


def _lost_many(findings: Findings, output: str, rows: Sequence[Row]) -> Iterator[Sentence]:
    text = (
        f"Samples that it has not seen cannot be simulated in {len(rows)} recordings ({recordings_named(rows)}): "
        f"{output} is not a number"
    )
    yield say("bad", f"{text}, in {rows[0]['recording']}{_lost_from(findings, rows[0])}. {_WHY}", recordings=len(rows))


def _lost_from(findings: Findings, row: Row) -> str:
    record = next((r for r in findings["recordings"] if r["name"] == row["recording"]), None)
    simulated = record["outputs"][row["output"]]["simulated"] if record else ()
    first = next((t for t, v in zip(record["t"] if record else (), simulated, strict=False) if v is None), None)
    return "" if first is None else f" from t = {number(first, 4)} s on"


_WITHOUT = "without what the noise of the first measured values does"

_HOLDS = {"good": "it holds", "warning": "it holds in part", "bad": "it does not hold there"}


def _base(findings: Findings, row: Row) -> float | None:
    """The RMSE of the fitted samples that an unseen one is compared with; None where all of them are followed
    whatever they are."""
    fitted = {
        (r["recording"], r["output"]): r["rmse"]
        for r in findings["scores"]
        if r["part"] == "fit" and not shows_nothing(r)
    }
    own = fitted.get((row["recording"], row["output"]))
    return own if own is not None else min((v for (_, o), v in fitted.items() if o == row["output"]), default=None)


def _off(row: Row) -> float:
    """The RMSE that tells whether unseen samples are followed: without what noise of first measured values does."""
    return row["rmse"] if row.get("started") is None else row["started"]


def _alone(findings: Findings, output: str) -> str:
    """That nothing can be compared with an unseen RMSE where fitted samples show nothing."""
    empty = any(shows_nothing(r) for r in findings["scores"] if r["part"] == "fit" and r["output"] == output)
    text = (
        f"; fitted samples of {output} are no more than the parameters "
        "that follow them, and do not tell how large it may be"
    )
    return text if empty else ""


def _held_level(row: Row, ratio: float) -> str:
    return "good" if ratio < HOLDS or _exact(row) else "warning" if ratio < FAILS else "bad"


def _exact(row: Row) -> bool:
    """Whether the rest is next to nothing beside what an output does, as of a record that was simulated."""
    return row["fit_percent"] is not None and row["fit_percent"] >= EXACT


def _is_foretold(findings: Findings, row: Row, level: str) -> bool:
    """Whether a miss is no larger than the uncertainty of the parameters lets expect of a model that is right."""
    return level != "good" and _off(row) <= (row.get("foretold") or 0.0) and not disagree(findings)


def failing(findings: Findings) -> list[str]:
    """Outputs of which the verdict says that the model does not hold on unseen samples."""
    found: dict[str, None] = {}
    spoiled = {output for _, output in decided_by_outliers(findings)}
    for row in findings.get("scores", ()):
        if row["output"] in spoiled:
            continue
        if row["part"] == "validation" and _lost(row):
            found[row["output"]] = None
            continue
        if (ahead := _times_ahead(findings, row)) is not None:
            if row["part"] == "validation" and ahead >= FAILS:
                found[row["output"]] = None
            continue
        base = _base(findings, row) if row["part"] == "validation" else None
        level = _held_level(row, _off(row) / base) if base else "good"
        if level == "bad" and not _drift_ends(findings, row) and not _is_foretold(findings, row, level):
            found[row["output"]] = None
    return list(found)


def _is_poor(findings: Findings, row: Row, level: str, noise: float | None) -> bool:
    """Whether little of an unseen output is followed, though its noise from sample to sample would allow more.

    Where samples are too few to tell that noise, those that are followed as the fitted ones (`level` "good"), and these
    well, may do no more than it.
    """
    percent = row["fit_percent"]
    if percent is None or percent >= POOR:
        return False
    if noise is not None:
        return row["rmse"] > FLOOR * noise
    fitted = [r for r in findings["scores"] if r["part"] == "fit" and r["output"] == row["output"]]
    well = all((r["fit_percent"] or 0.0) >= GOOD for r in fitted if not shows_nothing(r))
    return level != "good" or not fitted or not well


def _but(findings: Findings, row: Row, level: str) -> str | None:
    """What is to be said where an unseen output is followed badly, as the fitted samples (`level` "good") or
    somewhat worse, though its noise from sample to sample would allow more; else None."""
    if level == "bad":
        return None
    percent, noise = row["fit_percent"], most_noise(findings, row["output"])
    if percent is not None and _is_poor(findings, row, level, noise):
        worse = "no worse than there, but" if level == "good" else "worse than there, and"
        return f"{worse} {times_the_mean(percent) or f'a fit of {percent:.0f} % only'}"
    if level == "good" and (times := _times_noise(findings, row)):
        worse = _off(row) >= HOLDS * (_base(findings, row) or np.inf)  # than there, and yet next to nothing
        return f"{_in_words(percent, worse)}{number(times, 2)} times the noise from sample to sample"
    return None


def _in_words(percent: float | None, worse: bool) -> str:
    """How unseen samples are followed beside the fitted ones, before how many times the noise is left."""
    text = "worse than there" if worse else "no worse than there"
    if percent is None or percent < GOOD:
        return f"{text}, but "
    return f"{text}, with a fit of {number(percent, 6 if percent >= EXACT else 3)} %, but "


def _times_noise(findings: Findings, row: Row) -> float | None:
    """How many times its noise from sample to sample an unseen output is off, where that is much: the model holds as
    well as on the fitted samples, and not to the noise. None where it is not, and where a solver may leave as much."""
    noise, percent = most_noise(findings, row["output"]), row["fit_percent"]
    if not noise or (percent is not None and percent >= SOLVED):
        return None
    return _off(row) / noise if _off(row) > MUCH * noise else None


def _times_ahead(findings: Findings, row: Row) -> float | None:
    """How many times as far unseen samples are off as fitted ones, foretold one sample ahead, where that explains what
    a simulation leaves of an output."""
    moved = [place for place in moved_by_noise(findings) if place[1] == row["output"]]
    fitted = [a for n, o in moved if (a := ahead_of(findings, {"recording": n, "output": o}, "fit")) is not None]
    unseen = ahead_of(findings, row, "validation")
    if unseen is None or not fitted:
        return None
    own = [a["rmse"] for a in fitted if a["recording"] == row["recording"]]
    return unseen["rmse"] / (own[0] if own else min(a["rmse"] for a in fitted))


def _wandering(findings: Findings, row: Row, ahead: float) -> Sentence:
    """Unseen samples of a plant that noise moves."""
    off = ahead_of(findings, row, "validation")
    assert off is not None
    base = _base(findings, row)
    times = f", {row['rmse'] / base:.2f} times that of the fitted samples" if base else ""
    level = "good" if ahead < HOLDS else "warning" if ahead < FAILS else "bad"
    text = (
        f"On samples it has not seen, the RMSE of {place(findings, row)} is {with_unit(row['rmse'], row['unit'])} "
        f"where it is simulated{times}, for noise moves the plant. Foretold one sample ahead it is "
        f"{with_unit(off['rmse'], off['unit'])}, {ahead:.2f} times that of the fitted samples: {_HOLDS[level]}."
    )
    return say(level, text, rmse=row["rmse"], ratio=ahead)


def _unseen(findings: Findings, row: Row) -> Sentence:
    if (ahead := _times_ahead(findings, row)) is not None:
        return _wandering(findings, row, ahead)
    base = _base(findings, row)
    text = f"On samples it has not seen, the RMSE of {place(findings, row)} is {with_unit(row['rmse'], row['unit'])}"
    if not base:
        return say("info", f"{text}{_alone(findings, row['output'])}.", rmse=row["rmse"])
    ratio, begun = row["rmse"] / base, _off(row) / base
    level = _held_level(row, begun)
    much = level == "good" and _times_noise(findings, row) is not None
    if ratio >= HOLDS > begun and not _exact(row) and not much:
        text += (
            f", {ratio:.2f} times that of the fitted samples, and {begun:.2f} times if the simulation begins at the "
            "first measured values less their noise: it holds."
        )
        return say("good", text, rmse=row["rmse"], ratio=ratio, started=row["started"])
    if ratio >= HOLDS and _exact(row) and not much:
        text += (
            f", {ratio:.2f} times that of the fitted samples, and a fit of {number(row['fit_percent'], 6)} %: it holds."
        )
        return say("good", text, rmse=row["rmse"], ratio=ratio)
    words = _drift_ends(findings, row) if level != "good" else None
    if not words and _is_foretold(findings, row, level):
        text += f", {ratio:.2f} times that of the fitted samples, and no more than "
        text += (
            "noise and the uncertainty of the parameters let"
            if level == "warning"
            else "the uncertainty of the parameters lets"
        )
        text += f" expect (up to {with_unit(row['foretold'], row['unit'])})"
        if level == "warning":
            return say("info", f"{text}.", rmse=row["rmse"], ratio=ratio, foretold=row["foretold"])
        text += (
            ": they are not known well enough to predict there. A recording that moves as those samples do would tell; "
        )
        text += "`plantfit design` plans one."
        return say("warning", text, rmse=row["rmse"], ratio=ratio, foretold=row["foretold"])
    words, well = words or _but(findings, row, level), (row["fit_percent"] or 0.0) >= GOOD
    level = ("info" if much and well else "warning") if words else level
    less = f" ({begun:.2f} times {_WITHOUT})" if begun < ratio else ""
    text = f"{text}, {ratio:.2f} times that of the fitted samples{less}: {words or _HOLDS[level]}."
    text += _shift(findings, row)
    return say(level, text, rmse=row["rmse"], ratio=ratio)


def _drift_ends(findings: Findings, row: Row) -> str | None:
    """What is to be said of an output whose slow drift is fitted: beyond the nodes nobody knows it."""
    drifts = any(
        t["name"] == f"slow_drift_{row['output']}" and t["over"] == ["t"] for t in findings.get("tables") or ()
    )
    return "the curve of its slow drift is level there, since a drift cannot be foretold" if drifts else None


_POOR = ("warning", f"a fit of less than {POOR} % only")

_ABOVE = ("info", f"followed, but at more than {MUCH:g} times the noise from sample to sample")

_CHANCE = ("info", "no worse than noise and the uncertainty of the parameters let expect")

_FORETOLD = (
    "warning",
    "no worse than the uncertainty of the parameters lets expect, which are not known well enough to predict there",
)


def _end(findings: Findings, row: Row, level: str, noise: float | None) -> tuple[str, str]:
    """Level and words for one of many recordings."""
    if _is_foretold(findings, row, level):
        return _CHANCE if level == "warning" else _FORETOLD
    if level != "bad" and _is_poor(findings, row, level, noise):
        return _POOR
    return _ABOVE if level == "good" and _times_noise(findings, row) else (level, _HOLDS[level])


def _unseens(findings: Findings, output: str, rows: Sequence[Row]) -> Iterator[Sentence]:
    bases = [_base(findings, r) for r in rows]
    text = (
        f"On samples it has not seen, the RMSE of {output} in {len(rows)} recordings is "
        f"{span([r['rmse'] for r in rows], rows[0]['unit'])}"
    )
    if not all(bases):
        yield say("info", f"{text}{_alone(findings, output)}.", rmse=max(r["rmse"] for r in rows))
        return
    ratios = [r["rmse"] / base for r, base in zip(rows, bases, strict=True) if base]
    noise = most_noise(findings, output)
    begun = [_off(r) / base for r, base in zip(rows, bases, strict=True) if base]
    ends = [_end(findings, r, _held_level(r, q), noise) for r, q in zip(rows, begun, strict=True)]
    by = {
        end: [r for r, own in zip(rows, ends, strict=True) if own == end]
        for end in (*_HOLDS.items(), _ABOVE, _CHANCE, _POOR, _FORETOLD)
        if end in ends
    }
    held = "; ".join(f"{words} ({len(own)}: {recordings_named(own)})" for (_, words), own in by.items())
    less = f" ({span(begun, None)} times {_WITHOUT})" if begun != ratios else ""
    yield say(
        worst(level for level, _ in by),
        f"{text}, {span(ratios, None)} times that of the fitted samples{less}: {held}.",
        ratio=max(ratios),
    )


def _shift(findings: Findings, row: Row) -> str:
    """A constant error that makes up much of the unseen error: drift rather than dynamics."""
    if abs(row["bias"]) < 0.4 * row["rmse"]:
        return ""
    rest = max(row["rmse"] ** 2 - row["bias"] ** 2, 0.0) ** 0.5
    shift = with_unit(abs(row["bias"]), row["unit"])
    guess = "" if diagnosed(findings)["named"] else " (a drift, or an offset that changed)"
    return f" A constant shift of {shift} is part of it{guess}; without it {with_unit(rest, row['unit'])} remain."
