"""The eight regressions of NIST StRD with default settings, in boxes that know neither scale nor sign.

Box of every parameter: -10 m to 10 m, m the larger of both starts in magnitude. From start 1, from start 2, and without
a start with five seeds. The score is the smallest log relative error of all parameters, up to exchange of equal terms
and of signs that do not count.
"""

import itertools
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import plantfit as pf
from plantfit.space import Parameter

FOLDERS = ("../shared/data/nist_strd", "tests/models/nist_strd")
WIDE = 10.0  # half width of the box over the larger start
WANTED = 6.0  # digits

FORMULAS = {
    "BoxBOD": "b1*(1 - exp(-b2*x))",
    "Chwirut2": "exp(-b1*x)/(b2 + b3*x)",
    "DanWood": "b1*x^b2",
    "Gauss1": "b1*exp(-b2*x) + b3*exp(-(x - b4)^2/b5^2) + b6*exp(-(x - b7)^2/b8^2)",
    "Lanczos3": "b1*exp(-b2*x) + b3*exp(-b4*x) + b5*exp(-b6*x)",
    "MGH09": "b1*(x^2 + x*b2)/(x^2 + x*b3 + b4)",
    "Misra1a": "b1*(1 - exp(-b2*x))",
    "Thurber": "(b1 + b2*x + b3*x^2 + b4*x^3)/(1 + b5*x + b6*x^2 + b7*x^3)",
}
# terms of a sum that may change places, and parameters that enter squared
TERMS = {"Gauss1": (("b3", "b4", "b5"), ("b6", "b7", "b8")), "Lanczos3": (("b1", "b2"), ("b3", "b4"), ("b5", "b6"))}
SIGNLESS = {"Gauss1": ("b5", "b8")}


@dataclass(frozen=True)
class Certified:
    """Both starts, certified values and residual sum of squares, and the data y, x (n,)."""

    starts: tuple[dict[str, float], dict[str, float]]
    values: dict[str, float]
    squares: float
    y: np.ndarray
    x: np.ndarray


@dataclass(frozen=True)
class Score:
    """One fit: digits of the worst parameter, residual sum over the certified one, and what the search said."""

    name: str
    begin: str  # "start 1", "start 2" or "none"
    seed: int
    digits: float
    squares_ratio: float
    status: str
    hits: int | None
    starts: int | None
    evaluations: float
    seconds: float
    values: dict[str, float]

    @property
    def passed(self) -> bool:
        return self.digits >= WANTED


@cache
def certified(name: str) -> Certified:
    """Read from the .dat file; from the shared data where these are, else from the copy of the tests."""
    root = Path(__file__).resolve().parents[2]
    path = next(p for p in (root / folder / f"{name}.dat" for folder in FOLDERS) if p.exists())
    text = path.read_text()
    found = re.findall(r"^ *(b\d) = +(\S+) +(\S+) +(\S+) +\S+ *$", text, re.MULTILINE)
    squares = re.search(r"Residual Sum of Squares: +(\S+)", text)
    assert squares is not None
    y, x = np.loadtxt(text.splitlines()[60:]).T
    columns = [{n: float(row[k]) for n, *row in found} for k in range(3)]
    return Certified((columns[0], columns[1]), columns[2], float(squares[1]), y, x)


def problem_of(name: str, start: int | None) -> pf.Problem:
    """The regression in its wide box, beginning at start 1 or 2 or at none."""
    known = certified(name)
    model = pf.equations(f"y = {FORMULAS[name]}", inputs=["x"], outputs=["y"], parameters=list(known.values), name=name)
    parameters = {}
    for n in known.values:
        most = WIDE * max(abs(s[n]) for s in known.starts)
        parameters[n] = Parameter((-most, most), start=None if start is None else known.starts[start - 1][n])
    recording = pf.Recording(
        np.arange(len(known.y), dtype=float), {"x": pf.Signal(known.x), "y": pf.Signal(known.y)}, "data"
    )
    return pf.Problem(model, recording, parameters, name=name)


def digits(name: str, values: dict[str, float]) -> float:
    """Log relative error of the worst parameter, at most 16, for the exchange of terms that makes it best."""
    expected = certified(name).values
    values = {n: abs(v) if n in SIGNLESS.get(name, ()) else v for n, v in values.items()}
    groups = TERMS.get(name, ())
    best = -np.inf
    for order in itertools.permutations(groups):
        moved = dict(values)
        for here, there in zip(groups, order, strict=True):
            moved |= {a: values[b] for a, b in zip(here, there, strict=True)}
        errors = [abs(moved[n] - v) / abs(v) for n, v in expected.items()]
        best = max(best, -np.log10(max(*errors, 1e-16)))
    return float(best)


def score(name: str, start: int | None, seed: int, method: str = "auto") -> Score:
    """Fit with default settings."""
    known = certified(name)
    answer = pf.fit(problem_of(name, start), method, seed=seed)
    best = answer.best
    return Score(
        name,
        "none" if start is None else f"start {start}",
        seed,
        round(digits(name, answer.values), 2),
        best.cost * len(known.y) / known.squares,
        str(best.status),
        best.extra.get("basin_hits"),
        best.extra.get("starts"),
        best.evaluations,
        round(sum(answer.seconds.values()), 2),
        answer.values,
    )


def protocol(seeds: int):
    """(name, start, seed) of every fit: both starts once, no start with every seed."""
    for name in FORMULAS:
        yield from ((name, 1, 0), (name, 2, 0))
        yield from ((name, None, seed) for seed in range(seeds))
