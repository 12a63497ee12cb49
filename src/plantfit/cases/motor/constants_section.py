"""Section of the motor's page on its constants: surrogate against raw record, and what a current channel adds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.cases.motor.bench import PUBLISHED, TRUTH, Bench
from plantfit.cases.motor.figures import ratios_figure
from plantfit.cases.motor.methods import GA, Methods
from plantfit.cases.motor.speed_law import LABELS, Laws, coefficients, fitted_laws, with_speed
from plantfit.cases.motor.surrogate import surrogate_speeds
from plantfit.fitting import Answer
from plantfit.trust.verdict.words import number

NAMES = ("Rm", "Lm", "Kb", "Jm", "Cm", "Tf")


@dataclass(frozen=True)
class Targets:
    """Coefficients of several records, each fitted to what was recorded and to the record's own surrogate."""

    raw: Laws
    surrogate: Laws

    def inside(self, which: Laws) -> np.ndarray:
        """Share of records (4,) whose 95 % interval holds the truth."""
        return np.mean(np.abs(which.values - coefficients(TRUTH)) <= 1.96 * _errors(which), axis=0)


def targets(made: Sequence[Bench], order: int) -> Targets:
    """Fit each bench's record and its surrogate of that order."""
    records = [b.recording for b in made]
    speeds = surrogate_speeds(records, order)
    return Targets(fitted_laws(records), fitted_laws([with_speed(r, s) for r, s in zip(records, speeds, strict=True)]))


def constants_section(found: Targets, current: Answer, methods: Methods) -> dict[str, Any]:
    """Errors and intervals of both targets over the records; constants by a current channel beside the truth, the GA
    and the paper."""
    seen = {p["name"]: p for p in current.findings["parameters"]}
    inside, total = inside_of(current)
    label = next(iter(GA))
    best = methods.best(label)
    rows = [[n, seen[n]["unit"], f"{seen[n]['value']:.5g}", _bound(seen[n]["low"]), _bound(seen[n]["high"]),
             f"{TRUTH[n]:.5g}",
             "yes" if _holds(seen[n]) else "no", number(best[n]), number(PUBLISHED[n])] for n in NAMES]  # fmt: skip
    columns = [
        "constant",
        "unit",
        "with the current",
        "95 % from",
        "to",
        "truth",
        "inside",
        f"{label}, best run",
        "the paper",
    ]
    return {
        "title": "Constants",
        "sentences": [
            f"{len(found.raw.values)} records, each fitted as recorded and through its own surrogate: "
            f"{_compared(found)}",
            f"With a current channel beside the speed (Hall sensor, 20 mA) {inside} of the {total} constants "
            "that the data determine lie inside their 95 % intervals; the current opens both flat directions, "
            "since voltage, speed and current show Rm, Lm and Kb one by one. With Kt free a scale of Kt, Jm, "
            "Cm and Tf stays open even then. Tf = 0.05 mN m is below what this record can show.",
            "The genetic algorithm's runs end at about the same J with constants far apart; its best run is no "
            "estimate of them.",
        ],
        "tables": [
            _targets_table(found),
            {"caption": "Constants from one record, Kt = Kb", "columns": columns, "rows": rows},
        ],
        "figures": [{"figure": _ratios(methods, seen), "label": "Constants over the truth"}],
    }  # fmt: skip


def inside_of(current: Answer) -> tuple[int, int]:
    """How many constants with an interval lie inside of it, of how many."""
    told = [p for p in current.findings["parameters"] if p["status"] == "determined"]
    return sum(_holds(p) for p in told), len(told)


def _holds(p: Mapping[str, Any]) -> bool:
    return p["low"] is not None and p["low"] <= TRUTH[p["name"]] <= p["high"]


def _bound(value: float | None) -> str:
    return "none" if value is None else f"{value:.5g}"


def _errors(which: Laws) -> np.ndarray:
    return np.sqrt(np.einsum("rkk->rk", which.covariance))


def _compared(found: Targets) -> str:
    raw, other = found.inside(found.raw)[:3], found.inside(found.surrogate)[:3]
    return (
        f"the intervals of the raw fits hold the truth in {100 * raw.mean():.0f} % of the coefficients "
        f"of w, w' and w'', those of the surrogate fits in {100 * other.mean():.0f} %. The estimates "
        "are about as good; but the noise in a surrogate does not show in the residual of a fit to it, "
        "so that such intervals mean nothing. Fit the record; keep the surrogate for looking at it."
    )


def _targets_table(found: Targets) -> dict[str, Any]:
    true, rows = np.array(coefficients(TRUTH)), []
    for name, which in (("record", found.raw), ("surrogate", found.surrogate)):
        error, told = which.values / true - 1, _errors(which) / true
        shares = found.inside(which)
        rows += [[label, name, f"{100 * np.mean(error[:, k]):+.3g}", f"{100 * np.sqrt(np.mean(error[:, k] ** 2)):.3g}",
                  f"{100 * np.median(told[:, k]):.3g}", f"{100 * shares[k]:.0f}"] for k,
                 label in enumerate(LABELS)]  # fmt: skip
    columns = [
        "coefficient",
        "fitted to",
        "mean error [%]",
        "rms error [%]",
        "standard error told [%]",
        "truth inside 95 % [%]",
    ]
    return {
        "caption": f"Errors over {len(found.raw.values)} records",
        "columns": columns,
        "rows": sorted(rows, key=lambda r: LABELS.index(r[0])),
    }


def _ratios(methods: Methods, seen: Mapping[str, Any]) -> dict[str, Any]:
    true = np.array([TRUTH[n] for n in NAMES])
    at = [methods.problem.space.names.index(n) for n in NAMES]
    clouds = {label: methods.answers(label)[:, at] / true for label in GA}
    value = np.array([seen[n]["value"] for n in NAMES])
    low, high = (
        np.array([v if seen[n][side] is None else seen[n][side] for n, v in zip(NAMES, value, strict=True)])
        for side in ("low", "high")
    )
    published = np.array([PUBLISHED[n] for n in NAMES]) / true
    return ratios_figure(NAMES, clouds, {"the paper": published}, (low / true, value / true, high / true))
