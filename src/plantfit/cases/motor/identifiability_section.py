"""Section of the motor's page on what its speed determines, and what else would have to be measured."""

from collections.abc import Mapping
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cases.motor.bench import TRUTH
from plantfit.cases.motor.figures import along_figure
from plantfit.cases.motor.methods import parts_at
from plantfit.cases.motor.speed_law import LABELS, LAW, UNITS, Laws, coefficients
from plantfit.models.library.dc_motor import dc_motor
from plantfit.problem import Problem
from plantfit.trust import FlatCurve, Measurement, combinations, flat_curves, openings
from plantfit.trust.verdict.words import number

SPEED = 60.0  # rad/s, of the tests that a workshop could make
SHOWN = 40  # points along a flat curve


def identifiability_section(
    problem: Problem, two_errors: Problem, constants: Mapping[str, float], law: Laws
) -> dict[str, Any]:
    """`problem` of the speed alone, `two_errors` of the paper's J; `constants` are an answer that determines them
    all, `law` the one estimate of the coefficients."""
    space = problem.space
    found = combinations(coefficients, space.names, space.lower, space.upper, LABELS)
    free = [p for p in dc_motor().parameters if p.name in TRUTH]
    low, high = np.array([space.range(p.name if p.name in space.names else "Kb") for p in free]).T
    apart = combinations(coefficients, [p.name for p in free], low, high, LABELS)
    point = np.clip([constants[n] for n in space.names], space.lower, space.upper)
    curves = flat_curves(found, point)
    picked = [LABELS.index(n) for n in found.labels]
    opened = openings(found, law.covariance[0][np.ix_(picked, picked)], point, candidates())
    values, errors = law.values[0], np.sqrt(np.diag(law.covariance[0]))
    true, along = coefficients(TRUTH), _moving_kb(two_errors, curves)
    rows = [
        [text, u, f"{v:.5g}", number(1.96 * e), f"{t:.5g}"]
        for text, u, v, e, t in zip(LABELS, UNITS, values, errors, true, strict=True)
    ]
    return {
        "title": "What the speed determines without a current sensor",
        "sentences": [
            found.sentence,
            f"With Kt free: {apart.open} flat directions of {len(apart.names)} "
            "parameters, because Kt, Jm, Cm and Tf can grow together.",
            f"Rm Tf/K is {1e3 * true[LAW.index('f')]:.1f} mV at the truth, "
            f"a thirtieth of a step of the bridge: this record tells {known(law)} of the {found.rank} combinations "
            "from zero.",
            *(c.sentence for c in curves),
            *_along_sentence(*along),
            *opened.sentences,
        ],
        "tables": [
            {
                "caption": "What is determined",
                "columns": ["combination", "unit", "estimate", "± 95 %", "truth"],
                "rows": rows,
            },
            opened.table(),
        ],
        "figures": [
            {
                "figure": along_figure(*along, TRUTH["Kb"]),
                "label": "Both errors of J along a flat curve: e1 stays, e2 falls with Kb",
            }
        ],
    }


def known(law: Laws) -> int:
    """How many coefficients of the first record stand out of their 95 % intervals."""
    return int(np.sum(np.abs(law.values[0]) > 1.96 * np.sqrt(np.diag(law.covariance[0]))))


def candidates() -> list[Measurement]:
    """Measurements of a workshop, with standard deviations that are ours."""
    return [
        Measurement("Rm by ohmmeter (1 %)", lambda p: p["Rm"], 0.01 * TRUTH["Rm"]),
        Measurement("Lm by LCR meter (2 %)", lambda p: p["Lm"], 0.02 * TRUTH["Lm"]),
        Measurement(
            f"voltage when driven at {SPEED:g} rad/s (0.5 %)", lambda p: SPEED * p["Kb"], 0.005 * SPEED * TRUTH["Kb"]
        ),
        Measurement(
            f"current at steady {SPEED:g} rad/s (20 mA)", lambda p: (p["Cm"] * SPEED + p["Tf"]) / p["Kb"], 0.02
        ),
        Measurement("current when held, at 3 V (20 mA)", lambda p: 3.0 / p["Rm"], 0.02),
    ]


def _moving_kb(problem: Problem, curves: tuple[FlatCurve, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Kb (k,) and root mean squares of e1 and e2 (k,) along the curve on which Kb goes farthest."""
    own = [c for c in curves if "Kb" in c.moving] or list(curves)
    curve = max(own, key=lambda c: np.ptp(np.log(c.points[:, c.names.index("Kb")])))
    points = curve.points[np.unique(np.linspace(0, len(curve.points) - 1, SHOWN).astype(int))]
    parts = np.array([parts_at(problem, dict(zip(curve.names, p.tolist(), strict=True))) for p in points])
    return points[:, curve.names.index("Kb")], parts[:, 0], parts[:, 1]


def _along_sentence(kb: np.ndarray, e1: np.ndarray, e2: np.ndarray) -> list[str]:
    low, high = int(np.argmin(kb)), int(np.argmax(kb))
    return [
        f"Along the curve on which Kb goes from {number(kb[low])} to {number(kb[high])}, e1 stays "
        f"between {e1.min():.4g} and {e1.max():.4g} rad/s rms, while e2 goes from {e2[low]:.3g} to "
        f"{e2[high]:.3g} V: what J seems to determine beyond the combinations is the bias of e2."
    ]
