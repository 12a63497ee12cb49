"""What sentences on outputs share: their rows by output, how recordings are named, and the noise of each."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.problem.measure.sample_noise import white_part
from plantfit.trust.validate.residuals.residual_tests import measured_rows
from plantfit.trust.verdict.words import FEW, Sentence, number, some

Findings = Mapping[str, Any]
Row = Mapping[str, Any]
GOOD = 80  # percent
WHITE = 0.01  # p-value from which on residuals are called white
FLOOR = 1.2  # times the sample-to-sample noise: below that the fit is at it
BY_CHANCE = 2.0  # times the noise that the few samples of a short recording may leave
TESTED = 20  # samples of an output in one recording from which on residuals are tested and their noise is told
ROUNDING = 1e-12  # of the largest measured value: residuals below say nothing but how numbers are rounded
# share of the squares of a residual in samples so many robust deviations off, of so many samples at most, from which
# on these decide what tests and scores say
DECIDES, FAR, RARE = 0.5, 8.0, 0.05
SPARE = 0.5  # samples beyond the parameters that follow them, below which the fit shows nothing


def each_output(
    findings: Findings,
    rows: Sequence[Row],
    one: Callable[[Findings, Row], Sentence],
    many: Callable[[Findings, str, Sequence[Row]], Iterator[Sentence]],
) -> Iterator[Sentence]:
    """A sentence for each row, or grouped ones for outputs of more than a few recordings."""
    for output in dict.fromkeys(r["output"] for r in rows):
        own = [r for r in rows if r["output"] == output]
        yield from (one(findings, r) for r in own) if len(own) <= FEW else many(findings, output, own)


def place(findings: Findings, row: Row) -> str:
    """The output of a row, with its recording where there are several."""
    several = len(findings["recordings"]) > 1
    return f"{row['output']} of {row['recording']}" if several else row["output"]


def recordings_named(rows: Sequence[Row]) -> str:
    """The recordings of rows, the first few of many."""
    return some([r["recording"] for r in rows])


def shows_nothing(row: Row) -> bool:
    """Whether as many parameters as samples follow these."""
    spare = row.get("spare")
    return spare is not None and spare < SPARE


def most_noise(findings: Findings, output: str) -> float | None:
    """Noise from sample to sample of an output, the most of all recordings."""
    return max((r["noise"] for r in noise_rows(findings) if r["output"] == output), default=None)


def diagnosed(findings: Findings) -> dict[str, bool]:
    """Whether additions to the model were tried, and whether one was named: then no other sentence guesses at
    causes."""
    made = findings.get("diagnosis") or {}
    rounds = made.get("rounds", [])
    named = any(r["found"] for r in rounds) or bool(made.get("repeating") or made.get("stepping"))
    return {"tried": bool(rounds), "named": named}


def found_beside(findings: Findings) -> str:
    """What a diagnosis found that the values do not allow for."""
    made = findings.get("diagnosis") or {}
    if made.get("repeating"):
        return f"A pattern that repeats every {made['repeating']['period'] / 3600:g} h is left"
    if made.get("stepping"):
        return f"A step at t = {number(made['stepping']['steps'][0]['at'], 4)} s is left"
    return ""


def disagree(findings: Findings) -> bool:
    """Whether recordings want other parameters: what is left then is no disturbance."""
    return (findings.get("heterogeneity") or {}).get("agree") is False


def in_time(findings: Findings) -> bool:
    """Whether rows are samples one after another."""
    return findings.get("standard_errors", {}).get("in_time", True)


def forgotten(findings: Findings) -> list[str]:
    """Recordings whose start the simulation forgets while it does not follow them: what is left of them tells
    nothing of the model."""
    return [f["recording"] for f in findings.get("simulation", {}).get("forgets", ())]


def at_rest(findings: Findings) -> bool:
    """Whether the model stays where it begins in every recording."""
    resting = {look["recording"] for look in findings.get("data", ()) if look["kind"] == "at rest"}
    names = {record["name"] for record in findings.get("recordings", ())}
    return bool(names) and names <= resting


def noise_rows(findings: Findings) -> Iterator[Row]:
    """Noise of every output of every recording, and how many times that the residual is."""
    for name, output, unit, residual in _left(findings):
        if np.isfinite(residual).sum() < TESTED:
            continue  # hardly measured in this recording
        noise, rms = white_part(residual), float(np.sqrt(np.nanmean(residual**2)))
        if (found := _test(findings, name, output).get("curved")) is not None:  # rows in no order hide it from noise
            noise = min(noise, found["noise"])
        if np.isfinite(noise) and noise > 0 and rms > 0:
            yield {"recording": name, "output": output, "unit": unit, "noise": noise, "ratio": rms / noise}


def _test(findings: Findings, recording: str, output: str) -> Row:
    """The test of the residuals of an output in a recording; empty where there is none."""
    own = {"recording": recording, "output": output}
    return next((r for r in findings.get("residual_tests", ()) if is_same(r, own)), {})


def short_at_floor(findings: Findings) -> set[tuple[str, str]]:
    """Recordings and outputs of too few samples to tell their noise alone that leave no more than noise: so they do
    together, and none by itself more than a few samples do by chance."""
    short: dict[str, list[tuple[str, int, float, float]]] = {}
    for name, output, _, residual in _left(findings):
        count, noise = int(np.isfinite(residual).sum()), white_part(residual)
        if count < TESTED and np.isfinite(noise):
            short.setdefault(output, []).append((name, count, noise, float(np.sqrt(np.nanmean(residual**2)))))
    found = set()
    for output, rows in short.items():
        names, counts, noises, roots = (np.array(v) for v in zip(*rows, strict=True))
        noise = np.sqrt(np.average(noises**2, weights=counts - 2))
        together = np.sqrt(np.average(roots**2, weights=counts))
        if counts.sum() >= TESTED and together < FLOOR * noise:
            found |= {(str(n), output) for n in names[roots <= BY_CHANCE * noise]}
    return found


def _left(findings: Findings) -> Iterator[tuple[str, str, str | None, np.ndarray]]:
    """Recording, output, unit and residuals (n,) of what is fitted, NaN where some are missing; not of what is
    followed exactly."""
    for record in findings.get("recordings", ()):
        for name, o in record.get("outputs", {}).items():
            part = np.array(o["part"]) == "fit"
            measured = np.array(o["measured"], dtype=float)
            residual = (measured - np.array(o["simulated"], dtype=float))[part]
            if np.isfinite(residual).any() and np.nanstd(residual) > ROUNDING * np.nanmax(np.abs(measured)):
                yield record["name"], name, o["unit"], residual[measured_rows(residual)]


def is_same(a: Row, b: Row) -> bool:
    """Whether two rows are of one output of one recording."""
    return (a["recording"], a["output"]) == (b["recording"], b["output"])


def decided_by_outliers(findings: Findings) -> dict[tuple[str, str], tuple[int, float]]:
    """By recording and output how many outliers, single samples away from those beside them, hold most of the squares
    of the fitted residual, and their share; none where the record has no such samples."""
    kinds = ("spikes", "no_value")
    spiked = {(look["recording"], look["signal"]) for look in findings.get("data", ()) if look["kind"] in kinds}
    found = {}
    for record in findings.get("recordings", ()) if spiked else ():
        for name, o in record.get("outputs", {}).items():
            if (record["name"], name) not in spiked:
                continue
            part = np.array(o["part"]) == "fit"
            residual = (np.array(o["measured"], dtype=float) - np.array(o["simulated"], dtype=float))[part]
            residual = residual[np.isfinite(residual)]
            if len(residual) < TESTED:
                continue
            off = np.abs(residual - np.median(residual))
            far, squares = off > FAR * 1.4826 * float(np.median(off)), off**2
            if 0 < np.sum(far) <= RARE * len(residual) and np.sum(squares[far]) >= DECIDES * np.sum(squares):
                found[record["name"], name] = int(np.sum(far)), float(np.sum(squares[far]) / np.sum(squares))
    return found
