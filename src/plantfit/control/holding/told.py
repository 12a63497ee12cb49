"""What a regulator that holds an equilibrium is worth, as sentences and records."""

from typing import Any

import numpy as np

from plantfit.control.holding.design import HoldDesign, HoldRow
from plantfit.control.tune.told import percent
from plantfit.findings.record import Level
from plantfit.findings.results.held_plant import Regulator
from plantfit.findings.verdict import Sentence

FEW = 40  # plants drawn as lines
POINTS = 400  # of a curve


def verdict(design: HoldDesign, how: str) -> list[Sentence]:
    """Sentences with a level."""
    w, best, alone = design.wishes, design.rows[0], design.rows[1]
    n, known = len(best.stable), design.plant.units[w.along]
    unit = f" {known}" if known and known != "1" else ""
    share = best.share(w)
    told: list[Sentence] = []

    def say(level: Level, sentence: str) -> None:
        told.append(Sentence(level=level, sentence=sentence))

    say(
        "good" if share >= w.share else "bad",
        f"Of {n} plants {how}, {percent(share)} return to the point from {w.along} {w.lean:.3g}{unit} "
        f"away to either side; with the regulator of the best fit alone: {percent(alone.share(w))}.",
    )
    if len(design.unstable):
        fast = float(np.max(np.real(design.unstable)))
        say("info", f"Left alone the best fit falls: a deviation doubles in {np.log(2) / fast:.3g} s.")
    far = [float(v) for v in best.caught[0]]
    worst = [float(np.quantile(best.caught[:, k], 0.05, method="lower")) for k in (0, 1)]
    edge = " (no start farther out was tried)" if max(far) >= w.largest else ""
    say(
        "info",
        f"The best fit is caught from {far[0]:.3g}{unit} below and {far[1]:.3g}{unit} above the point{edge}, "
        f"95 % of the plants from {worst[0]:.3g} and {worst[1]:.3g}{unit}.",
    )
    lost = int(np.sum(~best.stable))
    if lost:
        say("bad", f"{lost} of the {n} loops are unstable.")
    if float(best.ms[0]) > w.ms:
        say(
            "warning",
            f"Ms is {best.ms[0]:.2f}, above the {w.ms:g} that was asked for: it is near the least "
            "of the 153 designs that were tried; a shorter period or a finer sensor serves.",
        )
    return told


def regulator(design: HoldDesign, row: HoldRow) -> Regulator:
    """A row as a record."""
    given, w = row.design.parameters, design.wishes
    worst = [float(np.quantile(row.caught[:, k], 0.05, method="lower")) for k in (0, 1)]
    return Regulator(
        name=row.name, weight=row.weight, shake=row.shake, gain=np.asarray(given.gain)[0].tolist(),
        filter_gain=np.asarray(given.estimator.gain).tolist(), ms=float(row.ms[0]),
        ms_worst=float(np.quantile(row.ms, 0.9)),
        below=float(row.caught[0, 0]), above=float(row.caught[0, 1]), below_worst=worst[0], above_worst=worst[1],
        stable_share=float(np.mean(row.stable)), share=row.share(w),
    )  # fmt: skip


def curves(design: HoldDesign) -> dict[str, Any]:
    """Responses from the lean that was asked for, as the figure of loops takes them: bands (5, 50, 95 %), the best
    fit."""
    found = {}
    for row in design.rows:
        seen = design.responses(row)
        at = np.unique(np.linspace(0, len(seen["t"]) - 1, POINTS).round().astype(int))
        found[row.name] = {"t": seen["t"][at], "y": _bands(seen["y"][:, at]), "u": _bands(seen["u"][:, at])}
    return found


def _bands(values: np.ndarray) -> dict[str, np.ndarray]:
    low, middle, high = np.nanquantile(np.where(np.isfinite(values), values, np.nan), (0.05, 0.5, 0.95), axis=0)
    return {"low": low, "middle": middle, "high": high, "best": values[0]}
