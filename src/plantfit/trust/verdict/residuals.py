"""What the verdict says about residuals and noise, and of which outputs the model lacks something."""

from collections.abc import Iterator, Mapping, Sequence
from math import comb
from typing import Any

from plantfit.trust.verdict.estimators.correlated import as_noise, may_be_noise, weighted_sentences
from plantfit.trust.verdict.estimators.filtered import moved_by_noise, wandering_sentences
from plantfit.trust.verdict.outputs import (
    FLOOR,
    WHITE,
    Findings,
    Row,
    decided_by_outliers,
    diagnosed,
    disagree,
    each_output,
    forgotten,
    in_time,
    is_same,
    noise_rows,
    place,
    recordings_named,
)
from plantfit.trust.verdict.words import FEW, Sentence, number, percent, say, some, span, with_unit

NOISE = 1.1  # times the sample-to-sample noise: a residual below that is hardly more
ENOUGH = 10  # samples for each parameter, from which on a residual that is noise was not fitted away
SOLVED = 99.99  # percent of what an output does: what is left may be the error of a solver
LEFT_OVER = 5.0  # standard errors of the mean of white residuals, from which on a constant is left
# share of a residual that the past of an input foretells: from there it follows it, up to there it does not
FORETOLD, UNTOLD = (0.6, 0.05)
# half-width of the band of a correlation with an input, above which a missing response to it would not stand out
SEEN = 0.35


def residual_sentences(findings: Findings) -> Iterator[Sentence]:
    """Whether anything is left to explain."""
    outliers = decided_by_outliers(findings)  # tests tell of these, not of the model
    rows = [r for r in findings["residual_tests"] if r["recording"] not in forgotten(findings)]
    rows = [r for r in rows if (r["recording"], r["output"]) not in outliers]
    moved = moved_by_noise(findings)
    rows = [r for r in rows if r["white"] or (r["recording"], r["output"]) not in moved]
    yield from each_output(findings, rows, _residual, _residuals)
    yield from wandering_sentences(findings)
    for row in _coloured_together(findings):
        yield _short(findings, row)
    coloured = [r["output"] for r in rows if not r["white"] and _left_by_a_solver(findings, r) is None]
    yield from weighted_sentences(findings, list(dict.fromkeys(coloured)))


def _coloured_together(findings: Findings) -> list[Row]:
    """Short recordings that are not white together, but where what made them may leave as much."""
    found = []
    for row in findings.get("short_recordings", ()):
        kept = [n for n in row["recordings"] if n not in forgotten(findings)]
        own = ({"recording": n, "output": row["output"]} for n in kept)
        if not row["white"] and any(_left_by_a_solver(findings, r) is None for r in own):
            found.append(row)
    return found


def _short(findings: Findings, row: Row) -> Sentence:
    few = len(row["recordings"])
    together = f"; {few} recordings of few samples taken together" if few > 1 else ""
    text = (
        f"The residuals of {row['output']} are not white (correlation {row['correlation']:.2f} from one sample to the "
        f"next{together}); standard errors {_allow(findings)}, and something systematic is missing."
    )
    return say("warning", text, correlation=row["correlation"])


def size_sentences(findings: Findings) -> Iterator[Sentence]:
    """Outputs of a model at rest whose residuals are of several sizes, where standard errors take them as of one."""
    rows = [r for r in findings.get("residual_tests", ()) if r.get("sizes")]
    for output in dict.fromkeys(r["output"] for r in rows):
        row = min((r for r in rows if r["output"] == output), key=lambda r: r["sizes"]["p_value"])
        found, unit = row["sizes"], next((s.get("unit") for s in findings.get("scores", ()) if is_same(s, row)), None)
        text = (
            f"The residuals of {place(findings, row)} are not of one size: {with_unit(found['low'], unit)} rms in the "
            f"third of the rows where the model is lowest, {with_unit(found['high'], unit)} where it is highest (p = "
            f"{found['p_value']:.2g}). ± takes them as of one size and may be too small, above all where few rows "
            'decide: write standard_errors = "robust", which allows for sizes that differ.'
        )
        yield say("warning", text, p_value=found["p_value"])


def noise_sentences(findings: Findings) -> Iterator[Sentence]:
    """How far the fit is from the noise floor; where something missing was named, jumps of the residual pass for
    noise, and the diagnosis says what is left."""
    if diagnosed(findings)["named"]:
        return
    outliers = decided_by_outliers(findings)
    rows = [r for r in noise_rows(findings) if r["recording"] not in forgotten(findings)]
    beside = {**outliers, **moved_by_noise(findings)}
    rows = [r for r in rows if (r["recording"], r["output"]) not in beside]
    yield from each_output(findings, rows, _noise, _noises)


def lacking(findings: Findings) -> list[str]:
    """Outputs of which more than noise is left by what the model lacks: residuals that are not white, and above
    their noise or named by the diagnosis; those not whose record is odd in one stretch, or of many where as few are
    so by chance."""
    above, named = (
        {(r["recording"], r["output"]) for r in noise_rows(findings) if r["ratio"] >= FLOOR},
        diagnosed(findings)["named"],
    )
    every = findings.get("residual_tests", ())
    curves = [r["output"] for r in every if r.get("curved")]
    tests = [r for r in every if not r["white"] and not r.get("shared") and not r.get("stretch")]
    tests = [r for r in tests if (r["recording"], r["output"]) not in moved_by_noise(findings)]
    lack = [r["output"] for r in tests if named or (r["recording"], r["output"]) in above]
    found = [o for o in dict.fromkeys(lack) if not _few_by_chance([r for r in every if r["output"] == o])]
    return list(dict.fromkeys([*found, *curves, *(r["output"] for r in _coloured_together(findings))]))


def only_noise(findings: Findings) -> bool:
    """Whether all that is left of every fitted output is white, or has a pattern of errors that samples share, and is
    as large as its sample-to-sample noise, by tests that had enough samples: what explains the records better explains
    hardly more."""
    fitted = {(s["recording"], s["output"]) for s in findings.get("scores", ()) if s["part"] == "fit"}
    tests = [r for r in findings.get("residual_tests", ()) if not r.get("curved")]
    white = {(r["recording"], r["output"]) for r in tests if r["white"] or _known_pattern(r)}
    low = {(r["recording"], r["output"]) for r in noise_rows(findings) if r["ratio"] < NOISE}
    samples = sum(s["n"] for s in findings.get("scores", ()) if s["part"] == "fit")
    enough = samples >= ENOUGH * len(findings.get("parameters", ()))
    return bool(fitted) and enough and fitted <= white & low and not decided_by_outliers(findings)


def _known_pattern(row: Row) -> bool:
    """Whether residuals that are not white follow errors that samples share, and no input."""
    return bool(row.get("shared")) and not any(_follows(c) for c in row["cross"].values())


def _few_by_chance(rows: Sequence[Row]) -> bool:
    failed = [r["p_value"] for r in rows if not r["white"]]
    return len(rows) > 1 and by_chance(failed, len(rows))


def _left_by_a_solver(findings: Findings, row: Row) -> float | None:
    """Which percentage of what an output does is left, where that is so little that what made the record may leave
    as much; else None."""
    fitted = next(
        (r["fit_percent"] for r in findings.get("scores", ()) if r["part"] == "fit" and is_same(r, row)), None
    )
    return 100.0 - fitted if fitted is not None and fitted >= SOLVED else None


_SOLVER = "the solver or the rounding that made the record may leave as much"


def _next(row: Row) -> float:
    """Correlation from one sample to the next."""
    return row["autocorrelation"][1] if len(row["autocorrelation"]) > 1 else 0.0


def _one(findings: Findings) -> str:
    return "sample" if in_time(findings) else "row"


def _allow(findings: Findings) -> str:
    """What standard errors make of correlated residuals."""
    weighted = (findings.get("correlated") or {}).get("least_squares")
    if findings.get("standard_errors", {}).get("kind") == "classical" and not weighted:
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
    """What is odd about a record rather than about the model; "" where nothing is, or where the diagnosis `named`
    what may be missing."""
    if (against := row.get("turned")) and against.get("throughout"):
        figures = f"correlation {against['within']:.2f}, in other recordings {against['elsewhere']:.2f} or more"
        turned = f"{row['output']} moves against the simulation throughout ({figures})"
        return f"{turned}: the sign of {row['output']} or of an input may be wrong there"
    if against:
        part = (
            f"from t = {number(against['begin'], 4)} to {number(against['end'], 4)} "
            f"s {row['output']} moves against the simulation"
        )
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


def _constant(findings: Findings, row: Row) -> str:
    """The mean of white residuals and what it may be, where that is no chance; "" where it is."""
    scores = (r for r in findings.get("scores", ()) if r["part"] == "fit" and is_same(r, row))
    s = next((r for r in scores if r.get("bias") is not None and r.get("rmse") is not None), None)
    if s is None or s["n"] < 2:
        return ""
    error = max(s["rmse"] ** 2 - s["bias"] ** 2, 0.0) ** 0.5 / s["n"] ** 0.5
    if not abs(s["bias"]) > LEFT_OVER * error:
        return ""
    off = f", {abs(s['bias']) / error:.0f} standard errors from zero" if error > 0 else ""
    mean = with_unit(-s["bias"], s.get("unit"))
    return f"a mean of {mean}{off}: what is left to explain is a constant, an offset of the sensor or of an input."


def _along_inputs(where: str, found: Mapping[str, Any]) -> Sentence:
    """That the residuals of rows in no order follow a curve in the inputs."""
    names = some(found["inputs"], 9)
    text = (
        f"The residuals of {where} follow {names}: a polynomial of {'it' if len(found['inputs']) == 1 else 'them'} "
        f"explains {percent(found['explained'])} of their squares (p = {found['p_value']:.2g}), though the order of "
        "the rows shows no pattern. The curve of the model is not that of the plant, and something systematic is "
        "missing."
    )
    return say("warning", text, explained=found["explained"], p_value=found["p_value"])


def _residual(findings: Findings, row: Row) -> Sentence:
    where = place(findings, row)
    if row["white"] and row.get("curved"):
        return _along_inputs(where, row["curved"])
    if row["white"]:
        rest = "no dynamics are left to explain" if in_time(findings) else "no pattern is left in the order of the rows"
        if constant := _constant(findings, row):
            text = f"The residuals of {where} are white (p = {row['p_value']:.2g}) about {constant}"
            return say("warning", text, p_value=row["p_value"])
        text = f"The residuals of {where} are white (p = {row['p_value']:.2g}): {rest}."
        return say("good", text, p_value=row["p_value"])
    if (left := _left_by_a_solver(findings, row)) is not None:
        text = f"The residuals of {where} are not white, but they are {number(left)} % of what it does: {_SOLVER}."
        return say("info", text, correlation=_next(row))
    text = (
        f"The residuals of {where} are not white (correlation {_next(row):.2f} from one {_one(findings)} to the next); "
        f"standard errors {_allow(findings)}, and something systematic is missing"
    )
    left = [i for i, c in row["cross"].items() if _follows(c)]
    if row.get("shared") and not left:
        text = text.removesuffix(", and something systematic is missing")
        return say(
            "info",
            f"{text}. The errors of {where} come back with {row['shared']}, which leaves such a pattern.",
            correlation=_next(row),
        )
    known = diagnosed(findings)
    if odd := _odd(row, known["named"]):
        text = text.removesuffix(", and something systematic is missing")
        return say("warning", f"{text}, and {odd}.", correlation=_next(row))
    if not left and may_be_noise(findings, row["output"]):
        text = text.removesuffix(", and something systematic is missing")
        return say("info", f"{text}. {as_noise(findings)}.", correlation=_next(row))
    text += (
        "."
        if known["named"] or (known["tried"] and not left)
        else f", and it depends on {', '.join(left)}: the model's response to it is incomplete."
        if left and (findings.get("determined") or {}).get("sound", True)
        else f"; whether it depends on {some(left)} or moves by itself, so few independent samples do not tell."
        if left
        else "; it is no linear response to the inputs: look for disturbances, drift, sensor effects, or what is not "
        "linear in the inputs, as a limit."
        if row["cross"] and all(_unmoved(c) for c in row["cross"].values()) and not disagree(findings)
        else "."
    )
    return say("warning", text, correlation=_next(row))


def _residuals(findings: Findings, output: str, rows: Sequence[Row]) -> Iterator[Sentence]:
    white, patterned = [r for r in rows if r["white"]], [r for r in rows if not r["white"]]
    small = [(r, left) for r in patterned if (left := _left_by_a_solver(findings, r)) is not None]
    coloured = [r for r in patterned if not any(r is own for own, _ in small)]
    chance = by_chance([r["p_value"] for r in coloured], len(rows))
    if white:
        where = f"{len(white)} of {len(rows)}" if patterned else f"all {len(rows)}"
        rest = (
            "no dynamics are left to explain there"
            if in_time(findings)
            else "no pattern is left in the order of their rows"
        )
        beside = (
            f", and as few as fail the test at 1 % ({recordings_named(coloured)}) do so by chance"
            if chance and coloured
            else ""
        )
        text = f"The residuals of {output} are white in {where} recordings{beside}: {rest}."
        constant = [r for r in white if _constant(findings, r)]
        if constant:
            first = constant[0]
            text += f" But in {recordings_named(constant)} a constant is left; {first['recording']} has "
            text += _constant(findings, first)
        good = not patterned or (beside and not small)
        along = [r for r in white if r.get("curved")]
        text += f" But in {recordings_named(along)} they follow the inputs." if along else ""
        odd = constant or along
        yield say("warning" if odd else "good" if good else "info", text, white=len(white))
        for r in sorted(along, key=lambda r: r["curved"]["p_value"])[:1]:
            yield _along_inputs(f"{output} of {r['recording']}", r["curved"])
    if small:
        text = (
            f"The residuals of {output} are not white in {len(small)} of {len(rows)} recordings, but they are at most "
        )
        yield say(
            "info",
            f"{text}{number(max(left for _, left in small))} % of what it does: {_SOLVER}.",
            recordings=len(small),
        )
    if coloured and not chance:
        text = (
            f"The residuals of {output} are not white in {len(coloured)} of {len(rows)} recordings "
            f"({recordings_named(coloured)}; "
            f"correlation up to {max(map(_next, coloured)):.2f} from one {_one(findings)} to the next); "
            f"standard errors {_allow(findings)}, and something systematic is missing."
        )
        named = diagnosed(findings)["named"]
        odd = [r for r in coloured if _odd(r, named)]
        left = [] if named else [r for r in coloured if r not in odd and any(_follows(c) for c in r["cross"].values())]
        if not (odd or left) and may_be_noise(findings, output):
            text = text.removesuffix(", and something systematic is missing.")
            yield say("info", f"{text}. {as_noise(findings)}.", correlation=max(map(_next, coloured)))
            return
        text += (
            f" In {recordings_named(left)} it depends on an input: the model's response to it is incomplete."
            if left
            else ""
        )
        for r in odd[:FEW]:
            text += f" In {r['recording']} {_odd(r, named)}."
        text += f" {len(odd) - FEW} more recordings have such a part." if len(odd) > FEW else ""
        yield say("warning", text, correlation=max(map(_next, coloured)))


def by_chance(p_values: Sequence[float | None], tests: int) -> bool:
    """Whether tests of white noise that failed, of so many, did so by chance: neither their number nor the smallest
    of them is rare."""
    least, failed = min((p for p in p_values if p is not None), default=1.0), len(p_values)
    fewer = sum(comb(tests, k) * WHITE**k * (1.0 - WHITE) ** (tests - k) for k in range(failed))
    return least * tests > WHITE and 1.0 - fewer > WHITE


def _noise(findings: Findings, row: Row) -> Sentence:
    text = (
        f"Sample-to-sample noise of {place(findings, row)} is about {with_unit(row['noise'], row['unit'])}; "
        f"the residual is {row['ratio']:.1f} times that"
    )
    own: Row = next((r for r in findings.get("residual_tests", ()) if is_same(r, row)), {})
    floor = row["ratio"] < FLOOR and not own.get("curved")
    above = (
        ", most of it in that stretch."
        if own.get("stretch")
        else "."
        if own.get("turned")
        else ", by noise that is correlated or by what the model lacks."
        if may_be_noise(findings, row["output"])
        else ", so a better model could still gain."
    )
    end = ": the fit is at the noise floor." if floor else above
    return say("good" if floor else "info", text + end, noise=row["noise"], ratio=row["ratio"])


def _noises(findings: Findings, output: str, rows: Sequence[Row]) -> Iterator[Sentence]:
    above = [r for r in rows if r["ratio"] >= FLOOR]
    noise, most = max(r["noise"] for r in rows), max(r["ratio"] for r in rows)
    text = f"Sample-to-sample noise of {output} is about {span([r['noise'] for r in rows], rows[0]['unit'])}; "
    if above:
        text += (
            f"in {len(above)} of {len(rows)} recordings ({recordings_named(above)}) the residual is up to "
            f"{most:.1f} times that: "
        )
        noise_alone = may_be_noise(findings, output)
        text += "correlated noise, or what the model lacks." if noise_alone else "a better model could still gain."
    else:
        text += (
            f"in all {len(rows)} recordings the residual is at most "
            f"{number(most)} times that: the fit is at the noise floor."
        )
    yield say("info" if above else "good", text, noise=noise, ratio=most)
