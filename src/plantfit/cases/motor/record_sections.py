"""Sections of the motor's page on its record: the bench, and the surrogate."""

from typing import Any

import numpy as np

from plantfit.cases.motor.bench import OLDEST, PERIOD, PUBLISHED, TRUTH, UNITS, Bench
from plantfit.cases.motor.surrogate import BLOCKS, Surrogate
from plantfit.cases.shared.panels import signals_figure
from plantfit.report.figures import style
from plantfit.trust.verdict.words import number

Section = dict[str, Any]


def bench_section(made: Bench) -> Section:
    """What was played and recorded, and the constants of the virtual motor."""
    r = made.recording
    power = TRUTH["Kt"] / PUBLISHED["Kb"]
    rows = [[n, UNITS[n], number(PUBLISHED[n]), number(TRUTH[n])] for n in TRUTH]
    panels = [
        ("voltage [V]", {"V": (r["V"], style.INPUT, 1.2)}),
        ("speed [rad/s]", {"w": (r["w"], style.MEASURED, 1.4)}),
        ("current [A]", {"i, not used by the paper": (r["i"], style.SERIES[1], 1.0)}),
    ]
    return {
        "title": "The record (virtual bench)",
        "sentences": [
            f"{len(r)} lines, one every {1e3 * PERIOD:g} ms: H-bridge of 12 V at 98 % with 8 "
            "bits, encoder of 500 lines read on four edges, timer of 1 us. Blocks of the "
            "paper's kind: a sine above and one below zero, both beyond 1 V, and a square wave.",
            f"{int(np.sum(np.isnan(r['w'])))} samples have no speed: there the last pulse was older than "
            f"{1e3 * OLDEST:g} ms.",
            "The paper prints Kb = 0.0061 and Kt = 0.0926. In SI units both are one constant; "
            f"a motor with that pair would give {power:.0f} W of shaft power for each watt "
            "that its back-EMF takes. The bench has its constants, but Kb = Kt = 0.0926.",
        ],
        "tables": [
            {
                "caption": "Constants",
                "columns": ["constant", "unit", "the paper's result", "truth of the bench"],
                "rows": rows,
            }
        ],
        "figures": [{"figure": signals_figure(r.t, panels), "label": "Voltage played, speed and current recorded"}],
    }


def _best(found: Surrogate) -> str:
    best = found.chosen.choice.best
    return "" if best == str(found.order) else f", order {best}"


def surrogate_section(found: Surrogate, made: Bench) -> Section:
    """Order by blocks left out, percent fit, and the surrogate over the record."""
    scores, choice = found.chosen.scores, found.chosen.choice
    rows = []
    for n, own in scores.items():
        gain = choice.gains.get(n)
        said = "best" if gain is None else f"{1e3 * gain[0]:.2f} ± {1e3 * gain[1]:.2f}"
        rows.append([n, f"{np.mean(own):.4f}", *(f"{v:.3f}" for v in own), said])
    v, exact = found.answer.values, made.run.exact["w"]
    error = {
        "surrogate, error": (found.speed - exact, style.SIMULATED, 1.2),
        "record, error": (made.recording["w"] - exact, style.MEASURED, 0.6),
    }
    lines = {"recorded": (made.recording["w"], style.MEASURED, 2.4), "surrogate": (found.speed, style.SIMULATED, 1.2)}
    panels = [("speed [rad/s]", lines), ("error [rad/s]", dict(reversed(error.items())))]
    return {
        "title": "The surrogate (Hammerstein-Wiener)",
        "sentences": [
            f"Input saturation, a linear block, a piecewise linear output. Order {found.order}: "
            f"the simplest of which the error on blocks left out ({BLOCKS}, a round of the "
            f"excitation each) is within one standard error of the best{_best(found)}.",
            f"It fits the record to {found.fit_raw:.2f} % (the paper: up to 98 %), as well "
            f"as the true speed itself does ({found.fit_sensor:.2f} %), and is closer to "
            f"the true speed ({found.fit_exact:.2f} %) than the record: it takes noise out.",
            f"Its saturation ({number(v['low'])} and {number(v['high'])} "
            "V) ends up at the ends of what was played: nothing saturates.",
        ],
        "tables": [
            {
                "caption": "RMSE on blocks left out [rad/s]",
                "columns": [
                    "order",
                    "mean",
                    *(f"block {k + 1}" for k in range(BLOCKS)),
                    "above the best ± standard error [mrad/s]",
                ],
                "rows": rows,
            }
        ],
        "figures": [
            {
                "figure": signals_figure(made.recording.t, panels),
                "label": "Surrogate over the record; below, errors of both",
            }
        ],
    }
