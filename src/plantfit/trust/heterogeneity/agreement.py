"""Which parameters differ between recordings, and which recording is apart from the others: a plain record."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.space import Coordinate
from plantfit.trust.heterogeneity.alone import Estimates
from plantfit.trust.heterogeneity.cochran import (
    LEVEL,
    Heterogeneity,
    difference,
    heterogeneity,
    holm,
    pooled,
    seen_from,
    together,
)
from plantfit.trust.heterogeneity.sentences import sentences

TOGETHER = ""  # the test of all parameters at once, beside those by name
One = tuple[float, float, float]  # a value on the scale of its search, its standard error, degrees of freedom


def compared(problem: Problem, joint: Estimates, each: Mapping[str, Estimates]) -> dict[str, Any]:
    """The record of a comparison of recordings, JSON types only:

    {"name", "verdict": [{"level", "sentence", "figures"}], "agree": bool|null, "level", "unit": str|null,
     "recordings": [{"name", "samples", "independent", "sound": bool, "rmse_joint", "rmse_alone"}],
     "parameters": [{"name", "unit", "scale": "linear"|"log", "joint": {"value", "standard_error", "low", "high",
     "status"},
        "alone": [{"recording", "value", "standard_error", "low", "high", "open", "status", "tested": bool}],
        "q", "degrees", "p", "p_adjusted", "i_squared", "between", "seen_from", "differs": bool}],
     "together": null|{"q", "degrees", "p", "p_adjusted", "differs": bool},
     "apart": [{"recording", "others": [name], "moved": [{"name", "unit", "value", "standard_error", "others",
     "others_error", "by",
        "share", "p_adjusted", "told": bool}]}],
     "either": [name]}

    Parameters are the shared ones; those that the study lets differ are no disagreement. Figures of a test are null
    where no two recordings determine the parameter alone. On a log scale the test is of the logarithm, and "between"
    the standard deviation in the unit at the joint value; "seen_from" is that which would be told in 8 of 10 such
    studies. "apart" are recordings without which the others agree, "either" several of which one is. "agree" is null
    where nothing could be tested. "share" is "by" over the value of the others, null at zero.
    """
    shared = {c.name: c for c in problem.space.coordinates if c.recording is None}
    estimates = {n: _tested(c, each) for n, c in shared.items()}
    tests, all_at_once = _tests(estimates, each, shared)
    p = {n: t.p for n, t in tests.items()} | ({} if all_at_once is None else {TOGETHER: all_at_once[2]})
    adjusted = holm(p)
    differ = [n for n in adjusted if adjusted[n] < LEVEL]
    apart, either = (
        _odd({n: own for n, own in estimates.items() if n in tests}, each, shared, differ) if differ else ([], [])
    )
    one = len(problem.outputs) == 1
    record = {
        "name": problem.name,
        "verdict": [],
        "agree": None if not tests else not differ,
        "level": LEVEL,
        "unit": problem.model.outputs[problem.outputs[0]] if one else None,
        "recordings": [
            {
                "name": n, "samples": e.samples, "independent": float(e.independent), "sound": e.sound,
                "rmse_joint": joint.rmse[n],
                "rmse_alone": e.rmse[n],
            }
            for n, e in each.items()
        ],
        "parameters": [
            {
                "name": n,
                "unit": c.unit,
                "scale": "log" if c.log else "linear",
                "joint": _row(joint.rows[n]),
                "alone": [{"recording": r, **_row(e.rows[n]), "tested": r in estimates[n]} for r, e in each.items()],
                **_figures(tests.get(n), adjusted.get(n), c, joint.rows[n]["value"], estimates[n], len(p)),
            }
            for n, c in shared.items()
        ],
        "together": None
        if all_at_once is None
        else {
            "q": all_at_once[0], "degrees": all_at_once[1], "p": all_at_once[2], "p_adjusted": adjusted[TOGETHER],
            "differs": TOGETHER in differ,
        },
        "apart": [_moved(r, [o for o in each if o not in apart], estimates, shared) for r in apart],
        "either": either,
    }  # fmt: skip
    if differ and not apart and not either and len(each) == 2:
        first, second = each
        record["apart"] = [_moved(second, [first], estimates, shared)]
    record["verdict"] = sentences(record)
    return record


def _row(row: Mapping[str, Any]) -> dict[str, Any]:
    return {k: row[k] for k in ("value", "standard_error", "low", "high", "open", "status")}


def _tested(c: Coordinate, each: Mapping[str, Estimates]) -> dict[str, One]:
    """By recording the estimate of one parameter on the scale of its search, where the recording alone determines
    it."""
    found = {}
    for name, e in each.items():
        if e.known(c.name):
            row = e.rows[c.name]
            found[name] = _on_scale(c, row["value"], row["standard_error"], e.degrees)
    return found


def _on_scale(c: Coordinate, value: float, error: float, degrees: float) -> One:
    return (float(np.log(value)), error / value, degrees) if c.log else (value, error, degrees)


def _tests(
    estimates: Mapping[str, Mapping[str, One]], each: Mapping[str, Estimates], shared: Mapping[str, Coordinate]
) -> tuple[dict[str, Heterogeneity], tuple[float, float, float] | None]:
    """Heterogeneity by parameter, and of all at once over the recordings that determine all that any determines."""
    tests = {}
    for name, own in estimates.items():
        if len(own) >= 2:
            tests[name] = heterogeneity(*np.array(list(own.values())).T)
    names = list(tests)
    whole = [r for r in each if all(r in estimates[n] for n in names)]
    if len(names) < 2 or len(whole) < 2:
        return tests, None
    values = np.array([[estimates[n][r][0] for n in names] for r in whole])
    covariances = np.array([_covariance(each[r], names, shared) for r in whole])
    return tests, together(values, covariances, np.array([each[r].degrees for r in whole]))


def _covariance(e: Estimates, names: Sequence[str], shared: Mapping[str, Coordinate]) -> np.ndarray:
    """Of parameters on the scales of their search, with the standard errors that are stated."""
    at = [e.names.index(n) for n in names]
    own = e.covariance[np.ix_(at, at)]
    sizes = np.sqrt(np.maximum(np.diag(own), 1e-300))
    stated = np.array([_on_scale(shared[n], e.rows[n]["value"], e.rows[n]["standard_error"], 1.0)[1] for n in names])
    return own / np.outer(sizes, sizes) * np.outer(stated, stated)


def _least(
    estimates: Mapping[str, Mapping[str, One]], each: Mapping[str, Estimates], shared: Mapping[str, Coordinate]
) -> float:
    """The least adjusted p-value over all tests; 0 where nothing is left to test, since that is no agreement."""
    tests, all_at_once = _tests(estimates, each, shared)
    p = {n: t.p for n, t in tests.items()} | ({} if all_at_once is None else {TOGETHER: all_at_once[2]})
    return min(holm(p).values(), default=0.0)


def _odd(
    estimates: Mapping[str, Mapping[str, One]],
    each: Mapping[str, Estimates],
    shared: Mapping[str, Coordinate],
    differ: Sequence[str],
) -> tuple[list[str], list[str]]:
    """The recordings, less than half of all, without which the others agree, taken one after the other; or, where
    one of several would do, these. None of both where the recordings scatter, or fewer than two of the others tell a
    parameter that differs."""
    left, gone = list(each), []
    if any(len(own) < 3 for n, own in estimates.items() if n in differ):
        return [], []
    while 2 * (len(gone) + 1) < len(each):
        without = {}
        for r in left:
            rest = [o for o in left if o != r]
            without[r] = _least(
                {n: {o: v for o, v in own.items() if o in rest} for n, own in estimates.items()},
                {o: each[o] for o in rest},
                shared,
            )
        enough = [r for r in left if without[r] >= LEVEL]
        if len(enough) > 1 and not gone:
            return [], enough
        best = max(left, key=lambda r: without[r])
        gone.append(best)
        left.remove(best)
        if enough:
            return gone, []
    return [], []


def _moved(
    recording: str, others: Sequence[str], estimates: Mapping[str, Mapping[str, One]], shared: Mapping[str, Coordinate]
) -> dict:
    """By how much each parameter of a recording is off that of the others, the surest first."""
    rows, p = [], {}
    for name, own in estimates.items():
        rest = [own[o] for o in others if o in own]
        if recording not in own or not rest:
            continue
        c, here, there = shared[name], own[recording], pooled(*zip(*rest, strict=True))
        p[name] = difference(here, there)
        (value, error), (mean, spread) = _back(c, here), _back(c, there)
        rows.append(
            {
                "name": name, "unit": c.unit, "value": value, "standard_error": error, "others": mean,
                "others_error": spread,
                "by": value - mean, "share": (value - mean) / abs(mean) if mean else None,
                "sizes": abs(here[0] - there[0]) / _error_of(here, there),
            }
        )  # fmt: skip
    adjusted = holm(p)
    rows.sort(key=lambda r: (adjusted[r["name"]], -r["sizes"]))
    moved = [{k: v for k, v in r.items() if k != "sizes"} | {"p_adjusted": adjusted[r["name"]]} for r in rows]
    return {
        "recording": recording,
        "others": list(others),
        "moved": [{**m, "told": m["p_adjusted"] < LEVEL} for m in moved],
    }


def _error_of(first: One, second: One) -> float:
    """The standard error of a difference."""
    return float(np.hypot(first[1], second[1])) or 1e-300


def _back(c: Coordinate, one: One) -> tuple[float, float]:
    """A value and its standard error in the unit."""
    return (float(np.exp(one[0])), float(np.exp(one[0]) * one[1])) if c.log else (float(one[0]), float(one[1]))


def _figures(
    test: Heterogeneity | None, adjusted: float | None, c: Coordinate, value: float, own: Mapping[str, One], tests: int
) -> dict[str, Any]:
    if test is None:
        return {
            "q": None, "degrees": None, "p": None, "p_adjusted": None, "i_squared": None, "between": None,
            "seen_from": None,
            "differs": False,
        }  # fmt: skip
    assert adjusted is not None
    unit = abs(value) if c.log else 1.0
    seen = seen_from(np.array([error for _, error, _ in own.values()]), LEVEL / tests)
    return {
        "q": test.q, "degrees": test.degrees, "p": test.p, "p_adjusted": adjusted, "i_squared": test.i_squared,
        "between": float(test.between * unit), "seen_from": float(seen * unit), "differs": adjusted < LEVEL,
    }  # fmt: skip


__all__ = ["compared"]
