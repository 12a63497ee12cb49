"""Intervals of the answer of all recordings that allow for how its parameters scatter between them.

To first order the answer of all is the sum of what every recording adds to it, c_k = -(J'J)^-1 J_k' r_k, which is A_k
(p_k - p) of the parameters p_k that it has alone, with A_k = (J'J)^-1 J_k' J_k. The c_k scatter as the recordings do,
whatever the reason: the variance of the answer about the mean of the plant is the sum of their squares, each over the
share of the scatter that is left in it, 1 - 2 a_k + sum a^2 (Bell and McCaffrey, Survey Methodology 28 (2002) 169:
recordings are the clusters; a_k is the diagonal of A_k). Student's t has the degrees of freedom that this sum has for
equal scatter, k - 1 where the recordings tell equally much: then it is the interval of Hartung and Knapp, Statistics in
Medicine 20 (2001) 3875. Nothing is subtracted for the noise, so that recordings that agree on one parameter by chance
do not look as if they determined it. The value stays that of least squares, the one that is simulated with.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import stdtrit

from plantfit.problem.problem import Problem
from plantfit.trust.heterogeneity.few import NORMAL, times_wider
from plantfit.trust.heterogeneity.refitted import own_rows
from plantfit.trust.intervals.linearised import Local
from plantfit.trust.intervals.parameter_rows import judged
from plantfit.trust.intervals.ranges import LEVEL, Range

NOTICED = 1.05  # times its reach from which on an interval is widened
WORTH = 1.15  # times from which on that of recordings that agree is
PRELIMINARY = (
    0.25  # level of a test from which on plants are drawn as if they scatter (Bancroft, Biometrics 20 (1964) 427)
)
ENOUGH = 3  # recordings from which on: two say nothing of a scatter
RCOND = 1e-12  # of the largest singular value: directions below are open
LEFT = 0.05  # of a recording's scatter: at least so much is taken to be left where it sets a parameter nearly alone

Row = dict[str, Any]


@dataclass(frozen=True)
class Effects:
    """What every recording adds to the answer of all: `moves` (k, d) in the cube, each scaled so that the sum of
    squares is the variance of the answer, and the `degrees` (d,) of freedom of that sum."""

    moves: np.ndarray
    degrees: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """Of the answer (d, d), in the cube."""
        return self.moves.T @ self.moves


def effects(problem: Problem, residuals: np.ndarray, jacobian: np.ndarray, local: Local) -> Effects:
    """Of the recordings on the answer, from residuals (m,) and derivatives (m, d) there. Coordinates that a bound
    holds do not move."""
    free = np.array([b is None for b in local.at_bound])
    norms = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    j = np.where(free, jacobian / norms, 0.0)
    inverse = np.linalg.pinv(j.T @ j, rcond=RCOND, hermitian=True)
    rows = [at for at, _ in own_rows(problem).values()]
    added = np.array([-(inverse @ (j[at].T @ residuals[at])) / norms for at in rows])
    shares = np.array([np.einsum("ij,ji->i", inverse, j[at].T @ j[at]) for at in rows])
    for i, c in enumerate(problem.space.coordinates):
        if c.recording is not None:  # its own recording follows the others
            shares[:, i] = 1.0 / len(rows)
    left = np.maximum(1.0 - 2.0 * shares + np.sum(shares**2, axis=0), LEFT)
    return Effects(added / np.sqrt(left), np.array([_degrees(a, r) for a, r in zip(shares.T, left.T, strict=True)]))


def _degrees(shares: np.ndarray, left: np.ndarray) -> float:
    """Of sum_k a_k^2 e_k^2 / left_k with e_k = x_k - sum a x and x of equal variance (Satterthwaite)."""
    away = np.eye(len(shares)) - shares[None, :]
    form = away.T @ (away * (shares**2 / left)[:, None])
    squares = float(np.sum(form**2))
    return max(1.0, float(np.trace(form)) ** 2 / squares) if squares > 0 else 1.0


def widened(
    problem: Problem,
    residuals: np.ndarray,
    jacobian: np.ndarray,
    local: Local,
    rows: Sequence[Row],
    record: Mapping[str, Any],
) -> list[Row]:
    """The rows of the findings, those wider that the scatter of recordings reaches; `record` is that of
    `agreement.compared`.

    Where recordings disagree on anything, every parameter has the interval of Student's t of so few; where they do not,
    those that they tell alone have the one of `few`, since few recordings agree by chance. Residuals (m,) and
    derivatives (m, d) are those at the answer. Rows without a standard error stay as they are.
    """
    tests = {p["name"]: p for p in record["parameters"]}
    told = record["agree"] is False
    compared = [n for n, p in tests.items() if p["p"] is not None]
    if not told and not compared:
        return list(rows)
    found, names, coordinates = (
        effects(problem, residuals, jacobian, local),
        problem.space.names,
        problem.space.coordinates,
    )
    errors = np.sqrt(np.diag(found.covariance))
    made = []
    for row in rows:
        name = row["name"]
        if name not in names or not (told or name in compared):
            made.append(row)
            continue
        i = names.index(name)
        c = coordinates[i]
        error = errors[i] * (np.log(c.upper / c.lower) if c.log else c.upper - c.lower)  # on the scale of the search
        between = tests[name]["between"] if name in tests and tests[name]["between"] is not None else 0.0
        doubted = not told and tests[name]["p"] <= PRELIMINARY and len(_tested(tests[name])) >= ENOUGH
        scatter = {"between": between, "degrees": float(found.degrees[i]), "told": told} if told or doubted else None
        made.append(_wider(row, c, error, found.degrees[i], scatter, told, local))
    return made


def _tested(parameter: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [a for a in parameter["alone"] if a["tested"]]


def _wider(
    row: Row, coordinate: Any, spread: float, degrees: float, scatter: Row | None, told: bool, local: Local
) -> Row:
    """The row with a standard error and an interval that hold for the mean of the recordings."""
    value, error = row["value"], row["standard_error"]
    if error is None or row["status"] not in ("determined", "weak") or row.get("open"):
        return row
    unit = value if coordinate.log else 1.0
    noise = error / unit
    times = times_wider((spread / noise) ** 2, degrees) if noise > 0 else 1.0
    reach = times * NORMAL * noise
    if told:
        reach = max(reach, float(stdtrit(degrees, 0.5 + LEVEL / 2)) * spread)
    ends = (value * np.exp(-reach), value * np.exp(reach)) if coordinate.log else (value - reach, value + reach)
    least, most = coordinate.limits
    low, high = float(max(least, min(ends[0], row["low"]))), float(min(most, max(ends[1], row["high"])))
    if high - low < (NOTICED if told else WORTH) * (row["high"] - row["low"]):
        # another recording is farther off than the mean
        return {**row, "scatter": scatter} if scatter and scatter["between"] > 0 else row
    assert local.linear is not None
    status = judged(coordinate, value, Range(low, high), local.linear.sound)
    # an interval that reaches all that is possible is not the same as data that say nothing
    fresh = max(error, spread * unit) if scatter else times * error
    wider = {"standard_error": float(fresh), "low": low, "high": high, "status": "weak" if status == "flat" else status}
    before = {k: row[k] for k in wider}
    more = unit * np.sqrt(max(reach**2 - (NORMAL * noise) ** 2, 0.0))
    return {
        **row, **wider, "by_noise": before, "scatter": scatter,
        "uncertainty": _stated(row.get("uncertainty"), value, float(more)),
    }  # fmt: skip


def _stated(uncertainty: Row | None, value: float, reach: float) -> Row | None:
    """What errors of instruments make of an interval, and a scatter between recordings that adds so much to its half
    width by the noise."""
    if uncertainty is None:
        return None
    noise, combined = (float(np.hypot(uncertainty[k], reach / NORMAL)) for k in ("noise", "combined"))
    low, high = (float(np.hypot(value - uncertainty[k], reach)) for k in ("low", "high"))
    return {**uncertainty, "noise": noise, "combined": combined, "low": value - low, "high": value + high}


__all__ = ["Effects", "effects", "widened"]
