"""What the verdict says about fit, unseen data, residuals and noise; one sentence for many recordings."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.trust.validate.residual_tests import measured_rows, white_part
from plantfit.trust.verdict.words import FEW, Sentence, number, say, some, span, with_unit, worst

GOOD = 80  # percent
FLOOR = 1.2  # times the sample-to-sample noise: below that the fit is at it
ROUNDING = 1e-12  # of the largest measured value: residuals below say nothing but how numbers are rounded
HOLDS, FAILS = 1.3, 2.0  # times the RMSE of fitted samples, up to which unseen ones are followed as well, and from which on they are not
TESTED = 20  # samples of an output in one recording from which on residuals are tested and their noise is told
SPARE = 0.5  # samples beyond the parameters that follow them, below which the fit shows nothing
EXACT, SOLVED = 99.9, 99.99  # percent: unseen samples hold whatever the fitted ones do, and a residual may be the error of a solver
POOR = 50  # percent of unseen samples below which a model that is no worse than on the fitted ones does not hold there
MUCH = 3.0  # times that noise: more is left than noise
FORETOLD, UNTOLD = 0.6, 0.05  # share of a residual that the past of an input foretells: from there it follows it, up to there it does not
SEEN = 0.35  # half-width of the band of a correlation with an input, above which a missing response to it would not stand out

Findings = Mapping[str, Any]
Row = Mapping[str, Any]


def fit_sentences(findings: Findings) -> Iterator[Sentence]:
    """How well the fitted samples are followed."""
    at_floor = {(r["recording"], r["output"]) for r in noise_rows(findings) if r["ratio"] < FLOOR}
    rows = [{**r, "at_floor": (r["recording"], r["output"]) in at_floor} for r in findings["scores"] if r["part"] == "fit"]
    yield from _each_output(findings, rows, _fit, _fits)


def unseen_sentences(findings: Findings) -> Iterator[Sentence]:
    """Whether it holds on samples that were not fitted."""
    unseen = [r for r in findings["scores"] if r["part"] == "validation"]
    if not unseen:
        yield say(
            "warning", "Nothing was kept unseen, so nothing shows yet that the model holds on new data: give a split or a second recording."
        )
    yield from _each_output(findings, [r for r in unseen if _lost(r)], _lost_one, _lost_many)
    yield from _each_output(findings, [r for r in unseen if not _lost(r)], _unseen, _unseens)


def _lost(row: Row) -> bool:
    """Whether the simulation of unseen samples is not a number."""
    return row["rmse"] is None


_WHY = "There the model leaves what its equations allow, as the root of a negative level, or grows without bound: it does not hold there."


def _lost_one(findings: Findings, row: Row) -> Sentence:
    """From when on unseen samples cannot be simulated, and why that may be."""
    text = f"Samples that it has not seen cannot be simulated: {_where(findings, row)} is not a number{_lost_from(findings, row)}. {_WHY}"
    return say("bad", text)


def _lost_many(findings: Findings, output: str, rows: Sequence[Row]) -> Iterator[Sentence]:
    text = f"Samples that it has not seen cannot be simulated in {len(rows)} recordings ({_names(rows)}): {output} is not a number"
    yield say("bad", f"{text}, in {rows[0]['recording']}{_lost_from(findings, rows[0])}. {_WHY}", recordings=len(rows))


def _lost_from(findings: Findings, row: Row) -> str:
    record = next((r for r in findings["recordings"] if r["name"] == row["recording"]), None)
    simulated = record["outputs"][row["output"]]["simulated"] if record else ()
    first = next((t for t, v in zip(record["t"] if record else (), simulated, strict=False) if v is None), None)
    return "" if first is None else f" from t = {number(first, 4)} s on"


def residual_sentences(findings: Findings) -> Iterator[Sentence]:
    """Whether anything is left to explain."""
    yield from _each_output(findings, findings["residual_tests"], _residual, _residuals)


def noise_sentences(findings: Findings) -> Iterator[Sentence]:
    """How far the fit is from the noise floor; where something missing was named, jumps of the residual pass for noise, and the diagnosis
    says what is left."""
    if _diagnosed(findings)["named"]:
        return
    yield from _each_output(findings, list(noise_rows(findings)), _noise, _noises)


def _each_output(
    findings: Findings,
    rows: Sequence[Row],
    one: Callable[[Findings, Row], Sentence],
    many: Callable[[Findings, str, Sequence[Row]], Iterator[Sentence]],
) -> Iterator[Sentence]:
    """A sentence for each row, or grouped ones for outputs of more than a few recordings."""
    for output in dict.fromkeys(r["output"] for r in rows):
        own = [r for r in rows if r["output"] == output]
        yield from (one(findings, r) for r in own) if len(own) <= FEW else many(findings, output, own)


def _where(findings: Findings, row: Row) -> str:
    several = len(findings["recordings"]) > 1
    return f"{row['output']} of {row['recording']}" if several else row["output"]


def _names(rows: Sequence[Row]) -> str:
    return some([r["recording"] for r in rows])


def _shows_nothing(row: Row) -> bool:
    """Whether as many parameters as samples follow these."""
    spare = row.get("spare")
    return spare is not None and spare < SPARE


_MUST = "no more than the free parameters that follow them, so that this shows nothing: give more samples of"


def _fit_level(row: Row) -> str:
    percent = row["fit_percent"]
    if percent is None or (percent < GOOD and row["at_floor"]):
        return "info"
    return "good" if percent >= GOOD else "warning" if percent >= 50 else "bad"


def _fit(findings: Findings, row: Row) -> Sentence:
    percent = row["fit_percent"]
    text = f"The model follows {_where(findings, row)} with an RMSE of {with_unit(row['rmse'], row['unit'])} on the fitted samples"
    if _shows_nothing(row):
        text += f", but these {row['n']} are {_MUST} {row['output']}."
        return say("warning", text, rmse=row["rmse"], samples=row["n"])
    text += f", a fit of {percent:.1f} %" if percent is not None else ""
    text += "; what is left is its noise from sample to sample." if percent is not None and percent < GOOD and row["at_floor"] else "."
    return say(_fit_level(row), text, rmse=row["rmse"], fit_percent=percent if percent is not None else float("nan"))


def _fits(findings: Findings, output: str, rows: Sequence[Row]) -> Iterator[Sentence]:
    empty = [r for r in rows if _shows_nothing(r)]
    if len(empty) <= FEW:
        yield from (_fit(findings, r) for r in empty)
    else:
        which = f"{len(empty)} recordings ({_names(empty)})"
        rmse = span([r["rmse"] for r in empty], rows[0]["unit"])
        text = f"The model follows {output} of {which} with an RMSE of {rmse} on the fitted samples, but in each they are {_MUST} {output}."
        yield say("warning", text, rmse=max(r["rmse"] for r in empty), recordings=len(empty))
    rows = [r for r in rows if r not in empty]
    if len(rows) <= FEW:
        yield from (_fit(findings, r) for r in rows)
        return
    unit, known = rows[0]["unit"], [r for r in rows if r["fit_percent"] is not None]
    rmse = span([r["rmse"] for r in rows], unit)
    text = f"The model follows {output} of {len(rows)} recordings with an RMSE of {rmse} on the fitted samples"
    if not known:
        yield say("info", f"{text}.", rmse=max(r["rmse"] for r in rows))
        return
    low, high = (choose(known, key=lambda r: r["fit_percent"]) for choose in (min, max))
    text += f", a fit of {low['fit_percent']:.1f} to {high['fit_percent']:.1f} % (lowest in {low['recording']})."
    level = worst(_fit_level(r) for r in known)
    yield say(level, text, rmse=max(r["rmse"] for r in rows), fit_percent=low["fit_percent"])


_HOLDS = {"good": "it holds", "warning": "it holds in part", "bad": "it does not hold there"}


def _base(findings: Findings, row: Row) -> float | None:
    """The RMSE of the fitted samples that an unseen one is compared with; None where all of them are followed whatever they are."""
    fitted = {(r["recording"], r["output"]): r["rmse"] for r in findings["scores"] if r["part"] == "fit" and not _shows_nothing(r)}
    own = fitted.get((row["recording"], row["output"]))
    return own if own is not None else min((v for (_, o), v in fitted.items() if o == row["output"]), default=None)


def _alone(findings: Findings, output: str) -> str:
    """That nothing can be compared with an unseen RMSE where fitted samples show nothing."""
    empty = any(_shows_nothing(r) for r in findings["scores"] if r["part"] == "fit" and r["output"] == output)
    text = f"; fitted samples of {output} are no more than the parameters that follow them, and do not tell how large it may be"
    return text if empty else ""


def _held_level(row: Row, ratio: float) -> str:
    return "good" if ratio < HOLDS or _exact(row) else "warning" if ratio < FAILS else "bad"


def _exact(row: Row) -> bool:
    """Whether the rest is next to nothing beside what an output does, as of a record that was simulated."""
    return row["fit_percent"] is not None and row["fit_percent"] >= EXACT


def _solved(findings: Findings) -> set[tuple[str, str]]:
    """Recordings and outputs whose fitted samples are followed so closely that what is left may come of what made the record."""
    rows = [r for r in findings.get("scores", ()) if r["part"] == "fit" and r["fit_percent"] is not None]
    return {(r["recording"], r["output"]) for r in rows if r["fit_percent"] >= SOLVED}


def _is_foretold(findings: Findings, row: Row, level: str) -> bool:
    """Whether a miss is no larger than the uncertainty of the parameters lets expect of a model that is right."""
    return level != "good" and row["rmse"] <= (row.get("foretold") or 0.0) and not _disagree(findings)


def failing(findings: Findings) -> list[str]:
    """Outputs of which the verdict says that the model does not hold on unseen samples."""
    found: dict[str, None] = {}
    for row in findings.get("scores", ()):
        if row["part"] == "validation" and _lost(row):
            found[row["output"]] = None
            continue
        base = _base(findings, row) if row["part"] == "validation" else None
        level = _held_level(row, row["rmse"] / base) if base else "good"
        if level == "bad" and not _drift_ends(findings, row) and not _is_foretold(findings, row, level):
            found[row["output"]] = None
    return list(found)


def lacking(findings: Findings) -> list[str]:
    """Outputs of which more than noise is left by what the model lacks: residuals that are not white, and above their noise or named by the
    diagnosis; those not whose record is odd in one stretch."""
    above, named = {(r["recording"], r["output"]) for r in noise_rows(findings) if r["ratio"] >= FLOOR}, _diagnosed(findings)["named"]
    tests = [r for r in findings.get("residual_tests", ()) if not r["white"] and not r.get("shared") and not r.get("stretch")]
    tests = [r for r in tests if (r["recording"], r["output"]) not in _solved(findings)]
    return list(dict.fromkeys(r["output"] for r in tests if named or (r["recording"], r["output"]) in above))


def _most_noise(findings: Findings, output: str) -> float | None:
    """Noise from sample to sample of an output, the most of all recordings."""
    return max((r["noise"] for r in noise_rows(findings) if r["output"] == output), default=None)


def _is_poor(row: Row, noise: float | None) -> bool:
    """Whether little of an unseen output is followed, though its noise from sample to sample would allow more."""
    return row["fit_percent"] is not None and row["fit_percent"] < POOR and (noise is None or row["rmse"] > FLOOR * noise)


def _but(findings: Findings, row: Row, level: str) -> str | None:
    """What is to be said where an unseen output is followed badly, as the fitted samples (`level` "good") or somewhat worse, though its
    noise from sample to sample would allow more; else None."""
    if level == "bad":
        return None
    percent, noise = row["fit_percent"], _most_noise(findings, row["output"])
    if _is_poor(row, noise):
        return f"{'no worse than there, but' if level == 'good' else 'worse than there, and'} a fit of {percent:.0f} % only"
    if level == "good" and percent is not None and percent < GOOD and noise and row["rmse"] > MUCH * noise:
        return f"no worse than there, but {row['rmse'] / noise:.2g} times the noise from sample to sample"
    return None


def _unseen(findings: Findings, row: Row) -> Sentence:
    base = _base(findings, row)
    text = f"On samples it has not seen, the RMSE of {_where(findings, row)} is {with_unit(row['rmse'], row['unit'])}"
    if not base:
        return say("info", f"{text}{_alone(findings, row['output'])}.", rmse=row["rmse"])
    ratio = row["rmse"] / base
    level = _held_level(row, ratio)
    if ratio >= HOLDS and _exact(row):
        text += f", {ratio:.2f} times that of the fitted samples, and a fit of {number(row['fit_percent'], 6)} %: it holds."
        return say("good", text, rmse=row["rmse"], ratio=ratio)
    words = _drift_ends(findings, row) if level != "good" else None
    if not words and _is_foretold(findings, row, level):
        text += f", {ratio:.2f} times that of the fitted samples, and no more than "
        text += "noise and the uncertainty of the parameters let" if level == "warning" else "the uncertainty of the parameters lets"
        text += f" expect (up to {with_unit(row['foretold'], row['unit'])})"
        if level == "warning":
            return say("info", f"{text}.", rmse=row["rmse"], ratio=ratio, foretold=row["foretold"])
        text += ": they are not known well enough to predict there. A recording that moves as those samples do would tell; "
        text += "`plantfit design` plans one."
        return say("warning", text, rmse=row["rmse"], ratio=ratio, foretold=row["foretold"])
    words = words or _but(findings, row, level)
    level = "warning" if words else level
    text = f"{text}, {ratio:.2f} times that of the fitted samples: {words or _HOLDS[level]}.{_shift(findings, row)}"
    return say(level, text, rmse=row["rmse"], ratio=ratio)


def _drift_ends(findings: Findings, row: Row) -> str | None:
    """What is to be said of an output whose slow drift is fitted: beyond the nodes nobody knows it."""
    drifts = any(t["name"] == f"slow_drift_{row['output']}" and t["over"] == ["t"] for t in findings.get("tables") or ())
    return "the curve of its slow drift is level there, since a drift cannot be foretold" if drifts else None


_POOR = ("warning", f"a fit of less than {POOR} % only")
_CHANCE = ("info", "no worse than noise and the uncertainty of the parameters let expect")
_FORETOLD = ("warning", "no worse than the uncertainty of the parameters lets expect, which are not known well enough to predict there")


def _end(findings: Findings, row: Row, level: str, noise: float | None) -> tuple[str, str]:
    """Level and words for one of many recordings."""
    if _is_foretold(findings, row, level):
        return _CHANCE if level == "warning" else _FORETOLD
    return _POOR if level != "bad" and _is_poor(row, noise) else (level, _HOLDS[level])


def _unseens(findings: Findings, output: str, rows: Sequence[Row]) -> Iterator[Sentence]:
    bases = [_base(findings, r) for r in rows]
    text = (
        f"On samples it has not seen, the RMSE of {output} in {len(rows)} recordings is {span([r['rmse'] for r in rows], rows[0]['unit'])}"
    )
    if not all(bases):
        yield say("info", f"{text}{_alone(findings, output)}.", rmse=max(r["rmse"] for r in rows))
        return
    ratios = [r["rmse"] / base for r, base in zip(rows, bases, strict=True) if base]
    noise = _most_noise(findings, output)
    ends = [_end(findings, r, _held_level(r, q), noise) for r, q in zip(rows, ratios, strict=True)]
    by = {
        end: [r for r, own in zip(rows, ends, strict=True) if own == end]
        for end in (*_HOLDS.items(), _CHANCE, _POOR, _FORETOLD)
        if end in ends
    }
    held = "; ".join(f"{words} ({len(own)}: {_names(own)})" for (_, words), own in by.items())
    yield say(
        worst(level for level, _ in by),
        f"{text}, {span(ratios, None)} times that of the fitted samples: {held}.",
        ratio=max(ratios),
    )


def _diagnosed(findings: Findings) -> dict[str, bool]:
    """Whether additions to the model were tried, and whether one was named: then no other sentence guesses at causes."""
    rounds = (findings.get("diagnosis") or {}).get("rounds", [])
    return {"tried": bool(rounds), "named": any(r["found"] for r in rounds)}


def _disagree(findings: Findings) -> bool:
    """Whether recordings want other parameters: what is left then is no disturbance."""
    return (findings.get("heterogeneity") or {}).get("agree") is False


def _shift(findings: Findings, row: Row) -> str:
    """A constant error that makes up much of the unseen error: drift rather than dynamics."""
    if abs(row["bias"]) < 0.4 * row["rmse"]:
        return ""
    rest = max(row["rmse"] ** 2 - row["bias"] ** 2, 0.0) ** 0.5
    shift = with_unit(abs(row["bias"]), row["unit"])
    guess = "" if _diagnosed(findings)["named"] else " (a drift, or an offset that changed)"
    return f" A constant shift of {shift} is part of it{guess}; without it {with_unit(rest, row['unit'])} remain."


def _next(row: Row) -> float:
    """Correlation from one sample to the next."""
    return row["autocorrelation"][1] if len(row["autocorrelation"]) > 1 else 0.0


def _in_time(findings: Findings) -> bool:
    """Whether rows are samples one after another."""
    return findings.get("standard_errors", {}).get("in_time", True)


def _one(findings: Findings) -> str:
    return "sample" if _in_time(findings) else "row"


def _allow(findings: Findings) -> str:
    """What standard errors make of correlated residuals."""
    classical = findings.get("standard_errors", {}).get("kind") == "classical"
    if classical:
        return 'do not allow for it (standard_errors = "robust" does)'
    return "allow for it" if (findings.get("determined") or {}).get("sound", True) else "cannot allow for all of it"


def _follows(c: Mapping[str, Any]) -> bool:
    """Whether the residual depends on an input: at one lag, or by a combination of many."""
    return not c["independent"] or (c.get("explained") or 0.0) > FORETOLD


def _unmoved(c: Mapping[str, Any]) -> bool:
    """Whether a dependence would have been seen, and was not."""
    explained = c.get("explained")
    return c["bound"] <= SEEN and explained is not None and explained < UNTOLD


def _odd(row: Row, named: bool) -> str:
    """What is odd about a record rather than about the model; "" where nothing is, or where the diagnosis `named` what may be missing."""
    if against := row.get("turned"):
        part = f"from t = {number(against['begin'], 4)} to {number(against['end'], 4)} s {row['output']} moves against the simulation"
        figures = f"correlation {against['within']:.2f}, elsewhere {against['elsewhere']:.2f}"
        return f"{part} ({figures}): the sign of {row['output']} or of an input may be wrong there"
    return _lies(row["stretch"]) if row.get("stretch") and not named else ""


def _lies(stretch: Mapping[str, Any]) -> str:
    """Where most of a residual lies, and what to look for there."""
    first, last = number(stretch["begin"], 4), number(stretch["end"], 4)
    text = f"{100 * stretch['share']:.0f} % of their squares lie from t = {first} to {last} s"
    text += f" ({100 * stretch['samples']:.2g} % of the samples)"
    if stretch.get("gap"):
        gap = f"a gap of the clock of {number(stretch['gap'])} s, over which inputs are held"
        return f"{text}, after {gap}: make two recordings of it, cut before and after the gap"
    what = "lost rows, a jump of the clock, a wrong reading or a disturbance"
    return f"{text}, where inputs and simulation do what they do elsewhere: look at the record there for {what}"


def _residual(findings: Findings, row: Row) -> Sentence:
    where = _where(findings, row)
    if row["white"]:
        rest = "no dynamics are left to explain" if _in_time(findings) else "no pattern is left in the order of the rows"
        off = row.get("first")
        but = f" but for what noise of the first value leaves, where the simulation begins ({number(abs(off))} off)" if off else ""
        text = f"The residuals of {where} are white (p = {row['p_value']:.2g}){but}: {rest}."
        return say("good", text, p_value=row["p_value"])
    if (row["recording"], row["output"]) in _solved(findings):
        fit = next(
            r for r in findings["scores"] if r["part"] == "fit" and (r["recording"], r["output"]) == (row["recording"], row["output"])
        )
        text = f"The residuals of {where} are not white, but they are {number(100.0 - fit['fit_percent'])} % of what it does: "
        return say("info", f"{text}the solver or the rounding that made the record may leave as much.", correlation=_next(row))
    text = (
        f"The residuals of {where} are not white (correlation {_next(row):.2f} from one {_one(findings)} to the next); "
        f"standard errors {_allow(findings)}, and something systematic is missing"
    )
    left = [i for i, c in row["cross"].items() if _follows(c)]
    if row.get("shared") and not left:
        text = text.removesuffix(", and something systematic is missing")
        return say(
            "info", f"{text}. The errors of {where} come back with {row['shared']}, which leaves such a pattern.", correlation=_next(row)
        )
    known = _diagnosed(findings)
    if odd := _odd(row, known["named"]):
        text = text.removesuffix(", and something systematic is missing")
        return say("warning", f"{text}, and {odd}.", correlation=_next(row))
    text += (
        "."
        if known["named"] or (known["tried"] and not left)
        else f", and it depends on {', '.join(left)}: the model's response to it is incomplete."
        if left and (findings.get("determined") or {}).get("sound", True)
        else f"; whether it depends on {some(left)} or moves by itself, so few independent samples do not tell."
        if left
        else "; it does not follow the inputs: look for disturbances, drift or sensor effects."
        if row["cross"] and all(_unmoved(c) for c in row["cross"].values()) and not _disagree(findings)
        else "."
    )
    return say("warning", text, correlation=_next(row))


def _residuals(findings: Findings, output: str, rows: Sequence[Row]) -> Iterator[Sentence]:
    white, coloured = [r for r in rows if r["white"]], [r for r in rows if not r["white"]]
    if white:
        where = f"{len(white)} of {len(rows)}" if coloured else f"all {len(rows)}"
        rest = "no dynamics are left to explain there" if _in_time(findings) else "no pattern is left in the order of their rows"
        text = f"The residuals of {output} are white in {where} recordings: {rest}."
        yield say("good" if not coloured else "info", text, white=len(white))
    if coloured:
        text = (
            f"The residuals of {output} are not white in {len(coloured)} of {len(rows)} recordings ({_names(coloured)}; "
            f"correlation up to {max(map(_next, coloured)):.2f} from one {_one(findings)} to the next); "
            f"standard errors {_allow(findings)}, and something systematic is missing."
        )
        named = _diagnosed(findings)["named"]
        odd = [r for r in coloured if _odd(r, named)]
        left = [] if named else [r for r in coloured if r not in odd and any(_follows(c) for c in r["cross"].values())]
        text += f" In {_names(left)} it depends on an input: the model's response to it is incomplete." if left else ""
        for r in odd[:FEW]:
            text += f" In {r['recording']} {_odd(r, named)}."
        text += f" {len(odd) - FEW} more recordings have such a part." if len(odd) > FEW else ""
        yield say("warning", text, correlation=max(map(_next, coloured)))


def noise_rows(findings: Findings) -> Iterator[Row]:
    """Noise of every output of every recording, and how many times that the residual is."""
    for record in findings.get("recordings", ()):
        for name, o in record.get("outputs", {}).items():
            part = np.array(o["part"]) == "fit"
            measured = np.array(o["measured"], dtype=float)
            residual = (measured - np.array(o["simulated"], dtype=float))[part]
            if np.isfinite(residual).sum() < TESTED or np.nanstd(residual) <= ROUNDING * np.nanmax(np.abs(measured)):
                continue  # hardly measured in this recording, or followed exactly
            noise, rms = white_part(residual[measured_rows(residual)]), float(np.sqrt(np.nanmean(residual**2)))
            if np.isfinite(noise) and noise > 0 and rms > 0:
                yield {"recording": record["name"], "output": name, "unit": o["unit"], "noise": noise, "ratio": rms / noise}


def _same(a: Row, b: Row) -> bool:
    return (a["recording"], a["output"]) == (b["recording"], b["output"])


def _noise(findings: Findings, row: Row) -> Sentence:
    text = (
        f"Sample-to-sample noise of {_where(findings, row)} is about {with_unit(row['noise'], row['unit'])}; "
        f"the residual is {row['ratio']:.1f} times that"
    )
    floor = row["ratio"] < FLOOR
    own: Row = next((r for r in findings.get("residual_tests", ()) if _same(r, row)), {})
    above = ", most of it in that stretch." if own.get("stretch") else "." if own.get("turned") else ", so a better model could still gain."
    end = ": the fit is at the noise floor." if floor else above
    return say("good" if floor else "info", text + end, noise=row["noise"], ratio=row["ratio"])


def _noises(findings: Findings, output: str, rows: Sequence[Row]) -> Iterator[Sentence]:
    above = [r for r in rows if r["ratio"] >= FLOOR]
    noise, most = max(r["noise"] for r in rows), max(r["ratio"] for r in rows)
    text = f"Sample-to-sample noise of {output} is about {span([r['noise'] for r in rows], rows[0]['unit'])}; "
    if above:
        text += f"in {len(above)} of {len(rows)} recordings ({_names(above)}) the residual is up to {most:.1f} times that: "
        text += "a better model could still gain."
    else:
        text += f"in all {len(rows)} recordings the residual is at most {number(most)} times that: the fit is at the noise floor."
    yield say("info" if above else "good", text, noise=noise, ratio=most)
