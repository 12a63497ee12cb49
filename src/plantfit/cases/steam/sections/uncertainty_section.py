"""What the page shows of the measurement's uncertainty, the paper's table 5, and of what it leaves of the
parameters."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.cases.steam.problems import dynamic_problem, static_problem, tables_from_static
from plantfit.cases.steam.static_task import STEP, beginning
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording
from plantfit.rig.steam_chamber import ERROR_LIMITS
from plantfit.trust.finish.refit import refit
from plantfit.trust.stated_errors.parameter_uncertainty import (
    ParameterUncertainty,
    SharedError,
    propagate,
    propagate_by_monte_carlo,
)
from plantfit.trust.stated_errors.uncertainty_budget import Budget, type_b, uncertainty_budget

SPAN = 39.0  # bar
# table 5, its "1351" read as 0.1351
PAPER = {"pressure transducer": (0.0225, 0.0450), "analog input card": (0.0675, 0.1351)}
PAPER_TOTAL = 0.1424
COVERAGE = {1: "68 %", 2: "95 %", 3: "99.7 %"}  # table 4
SPAN_ENDS = ", span"
CLOCK, OPENING = 1e-4, 5e-3  # limits that we assume: a card's clock, and the scale of the opening


def pressure_budget(limits: Mapping[str, float] = ERROR_LIMITS, span: float = SPAN) -> Budget:
    """The paper's budget of one reading of the pressure (bar): `limits` in % of `span`, rectangular."""
    return uncertainty_budget([type_b(name, limit / 100.0 * span, "bar") for name, limit in limits.items()], "bar")


def zeroed_errors(limits: Mapping[str, float] = ERROR_LIMITS) -> list[SharedError]:
    """What stays of the instruments after the zero has been set, and what else a set-up shares.

    An error that is a straight line between even errors at zero and at full scale is, less its zero, a gain with a
    triangular distribution twice as wide.
    """
    gains = [
        SharedError(type_b(name + SPAN_ENDS, 2.0 * limit / 100.0, shape="triangular"), "gain", "y")
        for name, limit in limits.items()
    ]
    return [
        *gains,
        SharedError(type_b("scale of the opening", OPENING), "gain", "u"),
        SharedError(type_b("clock", CLOCK), "clock"),
    ]


def constant_uncertainty(recording: Recording, draws: int = 0, seed: int = 0) -> ParameterUncertainty:
    """The static task's constants of one opening and their uncertainties: linear, or by so many refits."""
    problem = static_problem({STEP: recording})
    assert problem.space.start is not None  # `static_problem` has the paper's
    return _uncertainty(problem, problem.space.start, draws, seed)


def table_uncertainty(
    recording: Recording, constants: Mapping[str, float], draws: int = 0, seed: int = 0
) -> ParameterUncertainty:
    """The same of the tables of one opening, fitted from its static `constants`."""
    problem = dynamic_problem({STEP: recording})
    return _uncertainty(
        problem, tables_from_static(problem, {f"{n}[{STEP}]": v for n, v in constants.items()}), draws, seed
    )


def _uncertainty(problem: Problem, start: np.ndarray, draws: int, seed: int) -> ParameterUncertainty:
    z, _ = refit(problem, start, np.ones(len(start), bool), 1e-9)
    errors = zeroed_errors()
    return propagate_by_monte_carlo(problem, z, errors, draws, seed) if draws else propagate(problem, z, errors)


def zero_left_in(recording: Recording) -> float:
    """Standard uncertainty (s) of an early dead time when nobody has set the zero."""
    problem = static_problem({STEP: beginning(recording)})
    start = problem.space.start
    assert start is not None  # `static_problem` has the paper's
    z, _ = refit(problem, start, np.ones(len(start), bool), 1e-9)
    errors = [
        SharedError(type_b(n, limit / 100.0 * SPAN, "bar"), "zero", "y", SPAN) for n, limit in ERROR_LIMITS.items()
    ]
    found = propagate(problem, z, errors)
    at = found.names.index(f"Td[{STEP}]")
    return float(np.sqrt(sum(s[at] ** 2 for s in found.systematic.values())))


def uncertainty_section(
    opening: str,
    found: ParameterUncertainty,
    visited: Sequence[str],
    unset_zero: float,
    constants: ParameterUncertainty | None = None,
) -> dict[str, Any]:
    """Tables `found` of one `opening` (%), of which entries `visited` ("k[3]", "Td") are shown, and its static
    `constants`; `unset_zero` (s) as `zero_left_in` gives it."""
    budget = pressure_budget()
    half, _ = budget.monte_carlo()
    names = ("k", "A1", "A2", "Td")
    inside = [name for name in visited if not np.isnan(found.combined[found.names.index(f"{name}[{STEP}]")])]
    most = max(inside, key=lambda name: _share(found, name))
    gain = "" if constants is None else f"the static gain k by {_times(_share(constants, 'k'))}, "
    note = f"Clock within {1e6 * CLOCK:g} ppm and scale of the opening within {100 * OPENING:g} % are assumed by us."
    return {
        "title": "Uncertainty of the pressure and of the parameters (GUM)",
        "sentences": [
            "After the Guide to the Expression of Uncertainty in Measurement (GUM), whose terms the paper uses: "
            f"expanded uncertainty of a reading, c = 2: {budget.expanded():.4f} bar, the paper's "
            f"{PAPER_TOTAL}. The paper's table prints 1351 for 0.1351, and its text writes the expanded "
            f"{budget.expanded():.4f} bar as the standard uncertainty, which is {budget.combined:.4f} bar.",
            "No part is of type A, from repeated readings: each pressure was read once, every 0.1 s, and "
            "nothing was repeated whose mean could be taken (as in the paper).",
            f"The two rectangles add up to a trapezoid: ±{half:.3f} "
            "bar holds 95 % of it, so that c = 2 is on the safe side.",
            "These errors are the same in all samples of a set-up: no averaging lowers them, and residuals do not show "
            "them. After the "
            "zero has been set before the step, they are errors of the gain.",
            f"At {opening} % they add to the uncertainty by noise: {gain}of the entries shown {most} most, by "
            f"{_times(_share(found, most))}. "
            "What noise leaves open, the instruments hardly matter for.",
            f"With the zero not set, the dead time from the first 2 s of {opening} % would be uncertain by another "
            f"{unset_zero:.2g} s.",
        ],
        "tables": [
            _budget_table(budget),
            _coverage_table(budget),
            *(
                []
                if constants is None
                else [_parameter_table(f"Static constants of {opening} % opening", constants, names)]
            ),
            _parameter_table(f"Entries of the tables of {opening} % opening", found, visited, note),
        ],
    }


def _share(found: ParameterUncertainty, name: str) -> float:
    """Standard uncertainty by shared errors over that by noise."""
    at = found.names.index(f"{name}[{STEP}]")
    return float(np.sqrt(sum(s[at] ** 2 for s in found.systematic.values())) / max(found.random[at], 1e-300))


def _times(share: float) -> str:
    return f"{share:.2g} times that"


def _parameter_table(caption: str, found: ParameterUncertainty, names: Sequence[str], note: str = "") -> dict[str, Any]:
    inner = f"{len(found.draws)} refits (GUM supplement 1)" if found.draws is not None else "linear propagation"
    together: dict[str, list[np.ndarray]] = {}
    for source, by in found.systematic.items():
        together.setdefault("instruments" if source.endswith(SPAN_ENDS) else source, []).append(by)
    parts = {source: np.sqrt(np.sum(np.square(by), axis=0)) for source, by in together.items()}
    rows = []
    for name in names:
        at = found.names.index(f"{name}[{STEP}]")
        if np.isnan(found.combined[at]):  # no interval to first order
            rows.append(
                [name, found.units[at] or "", f"{found.values[at]:.3g}", *[""] * (1 + len(parts)), "on a bound", ""]
            )
            continue
        least = 1e-3 * float(found.combined[at])
        said = [f"{v:.2g}" if v > least else "~0" for v in (float(by[at]) for by in (found.random, *parts.values()))]
        rows.append(
            [
                name,
                found.units[at] or "",
                f"{found.values[at]:.3g}",
                *said,
                f"{found.low[at]:.3g}",
                f"{found.high[at]:.3g}",
            ]
        )
    return {
        "caption": f"{caption}: standard uncertainties by source, 95 % interval by {inner}",
        "columns": ["parameter", "unit", "value", "noise", *parts, "95 % from", "to"],
        "rows": rows,
        "note": note,
    }


def _coverage_table(budget: Budget) -> dict[str, Any]:
    """Table 4: what c = 1, 2, 3 cover of a normal distribution, of the paper, and of the budget's trapezoid."""
    rows = []
    for c, paper in COVERAGE.items():
        normal, own = 100 * math.erf(c / math.sqrt(2)), 100 * covered(budget, c)
        rows.append([str(c), f"±{c}", paper, f"{normal:.2f} %", f"{c * budget.combined:.4f}", f"{own:.2f} %"])
    return {
        "caption": "Expansion coefficient c (the paper's table 4)",
        "columns": [
            "c",
            "standard deviations",
            "paper",
            "normal distribution",
            "expanded [bar]",
            "this budget's trapezoid",
        ],
        "rows": rows,
    }


def covered(budget: Budget, c: float) -> float:
    """What share +-c standard uncertainties hold of the sum of two rectangles of unequal width."""
    wide, narrow = sorted((row["limit"] for row in budget.rows()), reverse=True)
    reach = min(c * budget.combined, wide + narrow)
    flat = wide - narrow
    if reach <= flat:
        return reach / wide
    return 1.0 - (wide + narrow - reach) ** 2 / (4.0 * wide * narrow)


def _budget_table(budget: Budget) -> dict[str, Any]:
    rows = []
    for row in budget.rows():
        standard, expanded = PAPER.get(row["name"], (float("nan"),) * 2)
        rows.append(
            [row["name"], row["kind"], row["shape"], f"{row['limit']:.3f}", f"{row['divisor']:.4f}",
             f"{row['standard']:.4f}",
             f"{row['expanded']:.4f}", f"{row['share']:.0%}", f"{standard:.4f}", f"{expanded:.4f}"]
        )  # fmt: skip
    total = [
        "combined",
        "",
        "",
        "",
        "",
        f"{budget.combined:.4f}",
        f"{budget.expanded():.4f}",
        "100%",
        "",
        f"{PAPER_TOTAL:.4f}",
    ]
    return {
        "caption": "Uncertainty budget of one reading of the pressure [bar] (the paper's table 5)",
        "columns": [
            "source",
            "type",
            "shape",
            "limit",
            "divisor",
            "standard",
            "expanded, c = 2",
            "share",
            "paper: standard",
            "paper: expanded",
        ],
        "rows": [*rows, total],
    }
