"""Intervals of the answer of all recordings that allow for how its parameters scatter between them.

The recordings' parameters p_k are taken as drawn about a mean, with the standard deviations of Paule and Mandel (`cochran.between`), and
the answer of all is, to first order, the mean sum_k A_k p_k with A_k = (J'J)^-1 J_k'J_k. Its variance about the mean of the plant is that
of the noise and sum_k A_k T A_k', T the diagonal of the variances between recordings. Student's t has as many degrees of freedom as these
are known with (Hartung and Knapp, Statistics in Medicine 20 (2001) 3875; Satterthwaite, Biometrics Bulletin 2 (1946) 110). The weights A_k
are those of least squares, not those that would be best: the value stays the one that is simulated with.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.special import stdtrit

from plantfit.problem.problem import Problem
from plantfit.trust.heterogeneity.refitted import own_rows
from plantfit.trust.intervals.linearised import Local
from plantfit.trust.intervals.parameter_rows import judged
from plantfit.trust.intervals.ranges import LEVEL, Range

NOTICED = 1.05  # times its standard error from which on an interval is widened
PRELIMINARY = 0.25  # level of a test that decides whether estimates are pooled (Bancroft, Biometrics 20 (1964) 427)
RCOND = 1e-12  # of the largest singular value: directions below are open

Row = dict[str, Any]


def widened(problem: Problem, jacobian: np.ndarray, local: Local, rows: Sequence[Row], record: Mapping[str, Any]) -> list[Row]:
    """The rows of the findings, those wider that a disagreement of recordings reaches; `record` is that of `agreement.compared`.

    The derivatives (m, d) are those at the answer. Rows without a standard error stay as they are.
    """
    scatter = _scatter(record)
    if not scatter:
        return list(rows)
    names, coordinates = problem.space.names, problem.space.coordinates
    width = np.array([np.log(c.upper / c.lower) if c.log else c.upper - c.lower for c in coordinates])  # on the scale of the search
    variance, degrees = np.zeros(len(names)), np.zeros(len(names))
    moved = [a**2 for a in weights(problem, jacobian, local)]
    for name, (between, noise, count) in scatter.items():
        j = names.index(name)
        felt = np.sum([a[:, j] for a in moved], axis=0) * (width / width[j]) ** 2
        variance += felt * between**2
        degrees += (felt * (between**2 + noise**2)) ** 2 / (count - 1.0)
    return [
        _wider(row, coordinates[names.index(row["name"])], variance[names.index(row["name"])], degrees[names.index(row["name"])], local)
        if row["name"] in names and variance[names.index(row["name"])] > 0
        else row
        for row in rows
    ]


def weights(problem: Problem, jacobian: np.ndarray, local: Local) -> list[np.ndarray]:
    """By recording A_k (d, d): by how much the answer of all moves with the parameters of that recording, both in the cube.

    Coordinates that a bound holds do not move.
    """
    free = np.array([b is None for b in local.at_bound])
    norms = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    j = np.where(free, jacobian / norms, 0.0)
    inverse = np.linalg.pinv(j.T @ j, rcond=RCOND, hermitian=True)
    return [(inverse @ (j[at].T @ j[at])) * (norms[None, :] / norms[:, None]) for at, _ in own_rows(problem).values()]


def _scatter(record: Mapping[str, Any]) -> dict[str, tuple[float, float, int]]:
    """Of every parameter that may scatter its standard deviation between recordings and by noise, both on the scale of the search, and in
    how many recordings it is known. Nothing where the recordings agree; where they do not, a parameter needs less evidence."""
    if record["agree"] is not False:
        return {}
    found = {}
    for p in record["parameters"]:
        if p["p"] is None or p["p"] > PRELIMINARY:
            continue
        alone = [a for a in p["alone"] if a["tested"]]
        noise = [a["standard_error"] / (abs(a["value"]) if p["scale"] == "log" else 1.0) for a in alone]
        between = p["between"] / (abs(p["joint"]["value"]) if p["scale"] == "log" else 1.0)
        if between > 0:
            found[p["name"]] = between, float(np.sqrt(np.mean(np.square(noise)))), len(alone)
    return found


def _wider(row: Row, coordinate: Any, variance: float, degrees: float, local: Local) -> Row:
    """The row with a standard error and an interval that hold for the mean of the recordings."""
    value, error = row["value"], row["standard_error"]
    if error is None or row["status"] not in ("determined", "weak") or row.get("open"):
        return row
    unit = value if coordinate.log else 1.0
    total = float(np.hypot(error / unit, variance**0.5))
    if total < NOTICED * error / unit:
        return row
    quantile = float(stdtrit(max(1.0, total**4 / degrees), 0.5 + LEVEL / 2))
    reach = quantile * total
    ends = (value * np.exp(-reach), value * np.exp(reach)) if coordinate.log else (value - reach, value + reach)
    least, most = coordinate.limits
    low, high = float(max(least, min(ends[0], row["low"]))), float(min(most, max(ends[1], row["high"])))
    assert local.linear is not None
    status = judged(coordinate, value, Range(low, high), local.linear.sound)
    # an interval that reaches all that is possible is not the same as data that say nothing
    wider = {"standard_error": total * unit, "low": low, "high": high, "status": "weak" if status == "flat" else status}
    before = {k: row[k] for k in wider}
    return {**row, **wider, "by_noise": before, "uncertainty": _stated(row.get("uncertainty"), value, unit * variance**0.5, quantile)}


def _stated(uncertainty: Row | None, value: float, between: float, quantile: float) -> Row | None:
    """What errors of instruments make of an interval, and the scatter `between` recordings."""
    if uncertainty is None:
        return None
    noise, combined = (float(np.hypot(uncertainty[k], between)) for k in ("noise", "combined"))
    low, high = (float(np.hypot(value - uncertainty[k], quantile * between)) for k in ("low", "high"))
    return {**uncertainty, "noise": noise, "combined": combined, "low": value - low, "high": value + high}
