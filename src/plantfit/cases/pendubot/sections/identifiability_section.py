"""Section of the pendubot's page: what its torque determines, what stays open, what would open it, and the optimum
that physics allows."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cases.pendubot.sections.flat_figure import flat_figure
from plantfit.estimate import Estimate
from plantfit.models.library.pendubot import pendubot_regression
from plantfit.problem.evaluate.compress import compress
from plantfit.recording.record import Recording
from plantfit.trust import (
    Combinations,
    LinkNames,
    Measurement,
    RegressionPart,
    certified_floor,
    combinations,
    constrained_optimum,
    flat_curves,
    link_constraints,
    nearest_possible,
    openings,
    regression_covariance,
)
from plantfit.trust.verdict.words import number, span

import jax.numpy as jnp

LINKS = (0.15, 0.3)  # lengths in m
ADDED = (0.05, 0.25)  # a known mass in kg, and its place in m from joint 2


def identifiability_section(
    recording: Recording,
    answer: Mapping[str, float] | None = None,
    estimate: Estimate | None = None,
    truth: Mapping[str, float] | None = None,
    lengths: tuple[float, float] = LINKS,
    g: float = 9.81,
    shown: str = "virtual rig",
) -> dict[str, Any]:
    """Sentences, tables and figures about the six parameters of a pendubot.

    `recording` has the signals of `pendubot_regression` and tau1 (N m); `answer` are the m1, m2, lc1, lc2, I1, I2 from
    which the flat curves start, by default a possible body nearest to the estimate; `estimate` an unbiased one of
    b1, b2, b4, b5 beside plain least squares; `truth` the true b's where known; `lengths` of the links in m. `shown`
    says in the title which data these are.
    """
    l1, l2 = lengths
    model = pendubot_regression(l1=l1, g=g)
    names, low, high = _box(model)
    columns, torque = model.columns({s: recording[s] for s in model.signals}), recording["tau1"]
    labels, constants = tuple(model.coefficients), {"l1": l1, "l2": l2, "g": g}
    found = combinations(model.coefficient_values, names, low, high, labels, columns, constants)
    plain, *_ = np.linalg.lstsq(columns, torque)
    spread = regression_covariance([RegressionPart(columns, torque - columns @ plain)])
    best, best_spread = (plain, spread) if estimate is None else (estimate.values, estimate.covariance)
    links = [LinkNames(f"m{k}", f"lc{k}", f"I{k}", length) for k, length in ((1, lengths[0]), (2, lengths[1]))]
    possible = nearest_possible(best, best_spread, model.coefficient_values, names, low, high, link_constraints(links))
    point = np.array([(possible.nearest.values if answer is None else answer)[n] for n in names])
    curves = flat_curves(found, point)
    picked = [labels.index(n) for n in found.labels]
    opened = openings(found, best_spread[np.ix_(picked, picked)], point, candidates(l1, l2, g))
    sentences = [
        f"{found.sentence[:-1]}, wherever in the box the parameters lie (rank {span(found.rank_at.tolist(), None)} at "
        f"{len(found.rank_at)} random points).",
        _both_joints(recording, names, low, high, lengths, g),
        possible.sentence,
        *(c.sentence for c in curves),
    ]
    floor_sentences, floor_table = _floor(columns, torque, model, names, low, high, links)
    return {
        "title": f"What the torque determines ({shown})",
        "sentences": [*sentences, *floor_sentences, *opened.sentences],
        "tables": [_base_table(found, plain, spread, estimate, truth), floor_table, opened.table()],
        "figures": [
            {
                "figure": flat_figure(found, curves, compress(columns, torque), model.coefficient_values),
                "label": "RMSE of the torque along the flat curves and across them: along, it does not change.",
            }
        ],
    }


def candidates(l1: float, l2: float, g: float) -> list[Measurement]:
    """Measurements that a workshop can make, with standard deviations that are ours: 0.5 g, 1 mm, 1 ms, and 1 % of a
    torque record."""
    mass, place = ADDED

    def period(p: Mapping[str, Any], k: int) -> Any:
        m, lc, inertia = p[f"m{k}"], p[f"lc{k}"], p[f"I{k}"]
        return 2 * jnp.pi * jnp.sqrt((inertia + m * lc**2) / (m * g * lc))

    def with_mass(p: Mapping[str, Any]) -> list[Any]:
        m2 = p["m2"] + mass
        lc2 = (p["m2"] * p["lc2"] + mass * place) / m2
        inertia = p["I2"] + p["m2"] * (p["lc2"] - lc2) ** 2 + mass * (place - lc2) ** 2
        return list(pendubot_regression(l1=l1, g=g).coefficient_values({**p, "m2": m2, "lc2": lc2, "I2": inertia}))

    return [
        Measurement("link 1 on a scale (0.5 g)", lambda p: p["m1"], 5e-4),
        Measurement("link 2 on a scale (0.5 g)", lambda p: p["m2"], 5e-4),
        Measurement("link 2 balanced on an edge (1 mm)", lambda p: p["lc2"], 1e-3),
        Measurement("link 2 swung on its own (period, 1 ms)", lambda p: period(p, 2), 1e-3),
        Measurement("link 1 swung on its own (period, 1 ms)", lambda p: period(p, 1), 1e-3),
        Measurement(
            "the torque of link 1 on its own (1 %)",
            lambda p: [p["m1"] * p["lc1"], p["I1"] + p["m1"] * p["lc1"] ** 2],
            [2.5e-4, 3.5e-5],
        ),
        Measurement(
            f"a record with {1e3 * mass:g} g added to link 2 at {place:g} m", with_mass, [4e-5, 3e-5, 4e-4, 1.5e-4]
        ),
    ]


def _box(model: Any) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    low, high = np.array([p.bounds for p in model.parameters], dtype=float).T
    return tuple(p.name for p in model.parameters), low, high


def _both_joints(
    recording: Recording, names: Sequence[str], low: Any, high: Any, lengths: tuple[float, float], g: float
) -> str:
    """Whether the equation of joint 2, whose torque is zero, adds a combination."""
    both = pendubot_regression(joints=(1, 2), l1=lengths[0], g=g)
    rows = np.vstack(list(both.blocks({s: recording[s] for s in both.signals}).values()))
    found = combinations(both.coefficient_values, names, low, high, tuple(both.coefficients), rows)
    more = (
        "no further combination" if found.rank == len(both.coefficients) else f"only {found.rank} combinations in all"
    )
    return (
        "The equation of joint 2, whose torque is zero, contains the same coefficients and gives "
        f"{more}; so does any fit of the angles, because the motion depends on these coefficients alone."
    )


def _base_table(
    found: Combinations, plain: np.ndarray, spread: np.ndarray, estimate: Estimate | None, truth: Any
) -> dict[str, Any]:
    columns = ["Combination", "Unit", "Least squares", "± 95 %"] + (
        [] if estimate is None else ["Instrumental variables", "± 95 %"]
    )
    rows = []
    for i, text in enumerate(found.texts):
        row = [
            text,
            "kg m^2" if found.labels[i] in ("b1", "b2") else "kg m",
            f"{plain[i]:.6g}",
            number(1.96 * np.sqrt(spread[i, i])),
        ]
        if estimate is not None:
            row += [f"{estimate.values[i]:.6g}", number(1.96 * estimate.standard_error[i])]
        rows.append(row + ([] if truth is None else [f"{truth[found.labels[i]]:.6g}"]))
    note = (
        "Intervals of least squares respect the autocorrelation of the residuals, but not the bias that noise in "
        "the columns gives."
    )
    return {
        "caption": "What is determined",
        "columns": columns + ([] if truth is None else ["Truth"]),
        "rows": rows,
        "note": note,
    }


def _floor(
    columns: np.ndarray, torque: np.ndarray, model: Any, names: Any, low: Any, high: Any, links: Sequence[LinkNames]
) -> tuple[list[str], dict[str, Any]]:
    """The constrained optima, proven."""
    data, rows, sentences = compress(columns, torque), [], []
    for what, constraints in (("bounds", {}), ("bounds and feasibility", link_constraints(links))):
        optimum = constrained_optimum(data, model.coefficient_values, names, low, high, constraints)
        floor = certified_floor(
            data, model.coefficient_values, names, low, high, links, optimum.cost, inside_links=bool(constraints)
        )
        sentences += [f"Within {what}: {optimum.sentence}", floor.sentence]
        pressed = "; ".join(optimum.active) or "nothing"
        rows.append(
            [
                what,
                f"{optimum.rmse:.9g}",
                f"{100 * (optimum.rmse / np.sqrt(optimum.free_cost) - 1):.3g} %",
                pressed,
                f"{optimum.kkt:.0e}",
            ]
        )
    caption = "The floor that every optimizer is compared to"
    table = {
        "caption": caption,
        "columns": ["Within", "RMSE [N m]", "Above least squares", "What holds it there", "First-order residual"],
        "rows": rows,
    }
    return sentences, table
