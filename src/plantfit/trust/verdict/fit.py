"""What the verdict says about the fitted samples; one sentence for many recordings."""

from collections.abc import Iterator, Sequence

from plantfit.trust.verdict.estimators.filtered import moved_by_noise
from plantfit.trust.verdict.outputs import (
    FLOOR,
    GOOD,
    Findings,
    Row,
    decided_by_outliers,
    each_output,
    noise_rows,
    place,
    recordings_named,
    short_at_floor,
    shows_nothing,
)
from plantfit.trust.verdict.words import FEW, Sentence, say, span, times_the_mean, with_unit, worst


def fit_sentences(findings: Findings) -> Iterator[Sentence]:
    """How well the fitted samples are followed."""
    outliers = decided_by_outliers(findings)
    at_floor = {(r["recording"], r["output"]) for r in noise_rows(findings) if r["ratio"] < FLOOR}
    at_floor |= short_at_floor(findings)
    moved = moved_by_noise(findings)
    rows = [
        {
            **r,
            "at_floor": (r["recording"], r["output"]) in at_floor,
            "moved": (r["recording"], r["output"]) in moved,
            "outliers": outliers.get((r["recording"], r["output"])),
        }
        for r in findings["scores"]
        if r["part"] == "fit"
    ]
    yield from each_output(findings, [r for r in rows if r["outliers"]], _by_outliers, _many_by_outliers)
    yield from each_output(findings, [r for r in rows if not r["outliers"]], _fit, _fits)


def _by_outliers(findings: Findings, row: Row) -> Sentence:
    """Fitted samples of which a few decide what is left."""
    (count, share), percent = row["outliers"], row["fit_percent"]
    which, them = (f"{count} outliers hold", "them") if count > 1 else ("one outlier holds", "it")
    text = (
        f"The model follows {place(findings, row)} with an RMSE of {with_unit(row['rmse'], row['unit'])} on the "
        f"fitted samples{_in_percent(percent)}; {which} {100 * share:.0f} % of the "
        f"squares of what is left: take {them} out before you judge the model."
    )
    return say("warning", text, rmse=row["rmse"], outliers=count, share=share)


def _many_by_outliers(findings: Findings, output: str, rows: Sequence[Row]) -> Iterator[Sentence]:
    counts, shares = zip(*(r["outliers"] for r in rows), strict=True)
    rmse = span([r["rmse"] for r in rows], rows[0]["unit"])
    text = (
        f"The model follows {output} of {len(rows)} recordings ({recordings_named(rows)}) with an RMSE of {rmse} on "
        f"the fitted samples; in each of them outliers, {sum(counts)} in all, hold {100 * min(shares):.0f} % or more "
        "of the squares of what is left: take them out before you judge the model."
    )
    yield say("warning", text, rmse=max(r["rmse"] for r in rows), outliers=sum(counts), share=min(shares))


_MUST = "no more than the free parameters that follow them, so that this shows nothing: give more samples of"


def _in_percent(percent: float | None) -> str:
    """A fit as the end of a sentence about an RMSE, as far as it is known."""
    return "" if percent is None else f", {times_the_mean(percent) or f'a fit of {percent:.1f} %'}"


def _fit_level(row: Row) -> str:
    percent = row["fit_percent"]
    if percent is None or (percent < GOOD and (row["at_floor"] or row["moved"])):
        return "info"
    return "good" if percent >= GOOD else "warning" if percent >= 50 else "bad"


def _fit(findings: Findings, row: Row) -> Sentence:
    percent = row["fit_percent"]
    text = (
        f"The model follows {place(findings, row)} with an RMSE of "
        f"{with_unit(row['rmse'], row['unit'])} on the fitted samples"
    )
    if shows_nothing(row):
        text += f", but these {row['n']} are {_MUST} {row['output']}."
        return say("warning", text, rmse=row["rmse"], samples=row["n"])
    if percent is not None and times_the_mean(percent):
        text = (
            f"The model does not follow {place(findings, row)}: its RMSE on the fitted samples is "
            f"{with_unit(row['rmse'], row['unit'])}, {times_the_mean(percent)} of these samples"
        )
    else:
        text += _in_percent(percent)
    text += (
        "; what is left is its noise from sample to sample."
        if percent is not None and percent < GOOD and row["at_floor"]
        else "."
    )
    return say(_fit_level(row), text, rmse=row["rmse"], fit_percent=percent if percent is not None else float("nan"))


def _fits(findings: Findings, output: str, rows: Sequence[Row]) -> Iterator[Sentence]:
    empty = [r for r in rows if shows_nothing(r)]
    if len(empty) <= FEW:
        yield from (_fit(findings, r) for r in empty)
    else:
        which = f"{len(empty)} recordings ({recordings_named(empty)})"
        rmse = span([r["rmse"] for r in empty], rows[0]["unit"])
        text = (
            f"The model follows {output} of {which} with an RMSE of {rmse} on the fitted samples, but in each they "
            f"are {_MUST} {output}."
        )
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
    worst_fit, best_fit = low["fit_percent"], high["fit_percent"]
    if times_the_mean(best_fit):
        text += f", in {low['recording']} {times_the_mean(worst_fit)} and nowhere less than {times_the_mean(best_fit)}."
    elif times_the_mean(worst_fit):
        text += f", a fit of {best_fit:.1f} % at best; in {low['recording']} the RMSE is {times_the_mean(worst_fit)}."
    else:
        text += f", a fit of {worst_fit:.1f} to {best_fit:.1f} % (lowest in {low['recording']})"
        poor = [r for r in known if r["fit_percent"] < GOOD]
        noise = poor and all(r["at_floor"] for r in poor)
        text += f"; where it is below {GOOD} %, what is left is noise from sample to sample." if noise else "."
    level = worst(_fit_level(r) for r in known)
    yield say(level, text, rmse=max(r["rmse"] for r in rows), fit_percent=low["fit_percent"])
