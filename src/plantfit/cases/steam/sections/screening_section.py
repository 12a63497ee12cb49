"""The paper's table 3 rebuilt: Morris screening around the answer of each method."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit.problem.problem import Problem
from plantfit.report.numbers import significant
from plantfit.report.pages import sensitivity as sensitivity_section
from plantfit.trust.sensitivity.salib_extra import MISSING
from plantfit.trust.sensitivity.screening import Screening, morris

TITLE = "Which parameters matter: Morris screening"
GROUPS = ("A1", "A2", "k", "Td")
PAPER = {  # table 3: mu* and its confidence interval, in the order of GROUPS
    "hms": ((0.008026, 0.002282), (0.003035, 0.000862), (0.023484, 0.008050), (0.001076, 0.000460)),
    "shade": ((0.144914, 0.062974), (0.100642, 0.031455), (0.134867, 0.051252), (0.039787, 0.008865)),
    "cmaes": ((0.004968, 0.002026), (0.002292, 0.000572), (0.073069, 0.022986), (0.000876, 0.000235)),
    "dish": ((0.011837, 0.003429), (0.005496, 0.001820), (0.023969, 0.007478), (0.003998, 0.001221)),
    "lbfgsb": ((0.009908, 0.003658), (0.004212, 0.001142), (0.081622, 0.023670), (0.002096, 0.000799)),
}


def screenings(problem: Problem, points: Mapping[str, Any], seed: int = 1) -> dict[str, Screening]:
    """Around each cube point (310,), as in the paper: groups A1, A2, k, Td, 20 optimal trajectories, +-0.01 inside
    the box."""
    groups = {name: [name] for name in GROUPS}
    return {
        label: morris(problem, np.asarray(z), radius=0.01, groups=groups, trajectories=20, seed=seed)
        for label, z in points.items()
    }


def screening_section(problem: Problem, points: Mapping[str, Any], seed: int = 1) -> dict[str, Any]:
    """Section of the page for the answers of methods by name; give the `weighted` dynamic problem, whose cost is the
    paper's C."""
    found = screenings(problem, points, seed)
    section = sensitivity_section.screening_section(found, TITLE, "the total cost C")
    rows = []
    for label, s in found.items():
        for group, said in zip(GROUPS, PAPER.get(_method(label), ((None, None),) * 4), strict=True):
            k = s.groups.index(group)
            rows.append(
                [
                    label,
                    group,
                    significant(s.mu_star[k]),
                    significant(s.half_width[k], 2),
                    *(significant(v) for v in said),
                ]
            )
    table = {
        "caption": "Table 3 of the paper with ours beside it",
        "columns": ["method", "group", "mu*, ours", "± 95 %, ours", "mu*, paper", "interval, paper"],
        "rows": rows,
        "note": "mu* as SALib gives it: change of C (bar²) over the width of the neighbourhood. The paper does not say "
        "how it normalised.",
    }
    return section | {"sentences": [*section["sentences"], *_said(found)], "tables": [table]}


def not_screened() -> dict[str, Any]:
    """The section where SALib is not installed."""
    return {"title": TITLE, "sentences": [f"Left out: the screening {MISSING}."]}


def _method(label: str) -> str:
    """The method that a label such as "CMA-ES, static start" begins with, as the registry spells it."""
    plain = label.lower().replace("-", "").replace("_", "")
    if "exact" in plain:  # the paper has finite differences only
        return label
    return next((name for name in PAPER if plain.startswith(name)), label)


def _said(found: Mapping[str, Screening]) -> list[str]:
    ranks = {label: [s.groups[i] for i in np.argsort(-s.mu_star)] for label, s in found.items()}
    leads = {label: order[0] for label, order in ranks.items()}
    common = max(set(leads.values()), key=list(leads.values()).count)
    others = [label for label, lead in leads.items() if lead != common]
    sentence = f"{common} matters most for {len(leads) - len(others)} of {len(leads)} answers" + (
        f", not for {', '.join(others)}." if others else "."
    )
    calm = min(found, key=lambda label: float(found[label].mu_star.sum()))
    return [
        sentence,
        f"The cost reacts least around the answer of {calm}; in the "
        "paper it was that of HMS, and k led for all but SHADE.",
    ]
