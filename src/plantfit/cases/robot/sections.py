"""What the page of the robot's motor shows."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.cases.robot.gains_section import encoders_table, measured_metrics, said
from plantfit.cases.robot.speed_loop import SET_POINT, UPPER, constant_duty, response
from plantfit.control import StepMetrics
from plantfit.fitting import Answer
from plantfit.optimize import RunResult
from plantfit.recording import Recording
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure

PAPER_GAINS = np.array([19.102365736574, 0.000859285929, 0.025063706371])
EARLY = 0.1  # s of a step that are drawn
DRAWN = 3  # methods whose short runs are drawn
LOOKS = (*style.SERIES, style.INK, style.MUTED)


def identified_section(answer: Answer, truth: Mapping[str, float]) -> dict[str, Any]:
    """Constants beside the truth of the bench."""
    rows = []
    for found in answer.findings["parameters"]:
        name = found["name"]
        inside = "yes" if found["low"] <= truth[name] <= found["high"] else "no"
        said = [found["value"], found["low"], found["high"], truth[name]]
        rows.append([name, found["unit"], *(f"{v:.5g}" for v in said), inside])
    missed = [row for row in rows if row[-1] == "no"]
    names = " and ".join(row[0] for row in missed)
    worst = max((abs(float(row[2]) / float(row[5]) - 1) for row in missed), default=0.0)
    outside = [f"{names} lie outside of their 95 % intervals, at most {100 * worst:.1f} % off."] if missed else []
    columns = ["constant", "unit", "value", "95 % from", "to", "truth of the bench (the paper's result)", "inside"]
    return {
        "title": "The motor identified (virtual bench)",
        "sentences": [
            "3 V from rest: RMS current and the period of the encoder's pulses, with the faults of both sensors.",
            "Both look back, the RMS over its window and the period over its pulse: their samples are put at the times "
            "that they tell of. "
            "A slot of the disc that is too wide is so in every turn: the errors of its edges are estimated with the "
            "constants (generalised least squares).",
            *outside,
        ],
        "tables": [{"caption": "Constants of the motor", "columns": columns, "rows": rows}],
    }


def search_section(
    ga: Sequence[RunResult], long: Mapping[str, RunResult], short: Mapping[str, list[RunResult]]
) -> dict[str, Any]:
    """Fitness against evaluations, and who reaches the best GA's end with a hundredth of its closed loops."""
    elite = min(ga, key=lambda r: r.cost)
    whole = {**{f"elite_ga, run {k + 1}": r for k, r in enumerate(ga)}, **long}
    spent = [[n, f"{r.cost:.6f}", f"{r.evaluations:.0f}", f"{_when(r, elite.cost)}", f"{r.seconds:.1f}"]
             + [f"{g:.4g}" for g in r.x * UPPER] for n, r in whole.items()]  # fmt: skip
    few = []
    for n, runs in short.items():
        costs = np.array([r.cost for r in runs])
        few.append(
            [n, f"{costs.min():.6f}", f"{np.median(costs):.6f}", f"{np.sum(costs <= elite.cost)} of {len(runs)}"]
        )
    return {
        "title": "300 000 closed loops, and 3000",
        "sentences": [
            "The paper's genetic algorithm (600 generations of 500, elite 10, "
            f"10 immigrants) ends at {elite.cost:.6f}, the best of {len(ga)} "
            "runs. A method that stopped before 300 000 loops met its own rule.",
            "Good gains fill a small corner of the box; beyond it the duty jumps between its limits and nothing "
            "settles, and a method that "
            "misses the corner ends above 1.6.",
        ],
        "tables": [
            {
                "caption": "One run each with 300 000 closed loops",
                "columns": ["method", "fitness", "loops", "loops to the GA's end", "seconds", "Kp", "Ki", "Kd"],
                "rows": spent,
            },
            {
                "caption": "Runs with 3000 closed loops",
                "columns": ["method", "best fitness", "median", "at or below the GA's end"],
                "rows": few,
            },
        ],
        "figures": [
            {
                "figure": _history({f"elite_ga, best of {len(ga)}": elite, **long}, _leading(short)),
                "label": f"Best fitness so far against closed loops; dashed the best run with 3000 loops of the "
                f"{DRAWN} leading methods",
            }
        ],
    }


def response_section(
    identified: Mapping[str, float], truth: Mapping[str, float], tuned: Mapping[str, np.ndarray], measured: Recording
) -> dict[str, Any]:
    """Steps on the true motor with every encoder, before and after, and beside them the record at 3 V."""
    duty = constant_duty(truth)
    first = next(iter(tuned.values()))
    rows = [
        ["constant duty", "none", *said(response(truth, duty)[1])],
        *encoders_table(truth, {**tuned, "the paper's gains": PAPER_GAINS}),
    ]
    final, _ = measured_metrics(measured)
    open_run, metrics = response(identified, constant_duty(identified))
    shown = {
        "record at 3 V": (measured.t, measured["w"] / final),
        "identified motor, constant duty": _share(open_run),
        "identified motor, PID": _share(response(identified, first)[0]),
    }
    steps = {"constant duty": _share(response(truth, duty)[0])}
    steps |= {
        name: _share(response(truth, gains)[0]) for name, gains in {**tuned, "the paper's gains": PAPER_GAINS}.items()
    }
    columns = [
        "control",
        "encoder",
        "overshoot [%]",
        "rise [s]",
        "settling [s]",
        "peak [s]",
        "error [rad/s]",
        "fitness",
    ]
    return {
        "title": "Steps to 300 rad/s on the true motor of the bench",
        "sentences": [
            "Gains were tuned on the identified motor with speed from the pulse period, in steps of 1.5 rad/s at the "
            "set point; counts in 1 ms come in steps of 60 rad/s. Both are rounded here with one step at all speeds.",
            "The paper's gains stand for its own units and limits, which it does not print; in these they are no "
            "judgement of it.",
        ],
        "tables": [{"caption": "Step metrics, 2 % band, rise from 10 to 90 %", "columns": columns, "rows": rows}],
        "figures": [
            {"figure": marked(_steps(shown), metrics, *_share(open_run)),
             "label": "Speed over the speed it settles at: the record, the model, the model with the PID (the paper's "
                      "figure 6); marked on "
                      "the model are the characteristics of the paper's figure 1"},
            {"figure": _steps(steps), "label": "Speed of the true motor over the set point before and after tuning"},
        ],
    }  # fmt: skip


def _when(run: RunResult, cost: float) -> str:
    there = run.history_cost <= cost
    return f"{run.history_evaluations[int(np.argmax(there))]:.0f}" if np.any(there) else "never"


def _leading(short: Mapping[str, list[RunResult]]) -> dict[str, list[RunResult]]:
    """The few methods whose best run is best, so that the figure stays readable with many."""
    order = sorted(short, key=lambda n: min(r.cost for r in short[n]))
    return {n: short[n] for n in order[:DRAWN]}


def _history(whole: Mapping[str, RunResult], short: Mapping[str, list[RunResult]]) -> Figure:
    data = []
    names = list(dict.fromkeys([*whole, *short]))
    for k, name in enumerate(names):
        drawn = [(whole[name], "solid", name)] if name in whole else []
        if name in short:
            drawn.append((min(short[name], key=lambda r: r.cost), "dash", f"{name}, 3000"))
        for r, dash, label in drawn:
            line = {"color": LOOKS[k % len(LOOKS)], "dash": dash, "shape": "hv", "width": 1.6}
            data.append(_line(r.history_evaluations, r.history_cost, label, line))
    layout = style.layout(360 + 10 * len(data), showlegend=True)
    spent, costs = (np.concatenate([np.asarray(trace[axis]) for trace in data]) for axis in "xy")
    layout["xaxis"], layout["yaxis"] = (
        style.log_axis("closed loops", spent),
        style.log_axis("best fitness so far", costs),
    )
    return {"data": data, "layout": layout}


def _share(run: Any) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(run.t), np.asarray(run.y) / SET_POINT


def _steps(shown: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    data = []
    for k, (name, (t, share)) in enumerate(shown.items()):
        early = t <= EARLY
        data.append(_line(t[early], share[early], name, {"color": LOOKS[k], "width": 1.6}))
    layout = style.layout(320, showlegend=True)
    layout["xaxis"], layout["yaxis"] = style.axis("time [s]"), style.axis("speed, share of the final one")
    return {"data": data, "layout": layout}


def marked(figure: Figure, m: StepMetrics, t: np.ndarray, share: np.ndarray) -> Figure:
    """A figure of steps with the five terms of equation 13 at the points of one of its curves: t (n,) in s, share
    (n,) of the final."""
    late, high = float(t[np.argmax(share >= 0.9)]), 1 + m.overshoot / 100
    points = (
        (late, 0.9, f"rise {1e3 * m.rise_time:.0f} ms", 45, 20),
        (m.peak_time, high, f"overshoot {m.overshoot:.0f} %, peak at {1e3 * m.peak_time:.0f} ms", 90, -18),
        (
            m.settling_time,
            float(np.interp(m.settling_time, t, share)),
            f"settled within 2 % at {1e3 * m.settling_time:.0f} ms",
            60,
            45,
        ),
        (EARLY, float(np.interp(EARLY, t, share)), f"steady-state error {m.steady_state_error:.2g} rad/s", -60, 40),
    )
    base = {
        "showarrow": True,
        "arrowhead": 2,
        "arrowsize": 0.8,
        "arrowcolor": style.MUTED,
        "font": style.SMALL,
        "standoff": 2,
    }
    notes = [
        base | {"x": round(float(x), 5), "y": round(y, 4), "text": text, "ax": ax, "ay": ay}
        for x, y, text, ax, ay in points
    ]
    band = {
        "type": "line",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "line": {"color": style.MUTED, "width": 1, "dash": "dot"},
    }
    shapes = [band | {"y0": y, "y1": y} for y in (0.98, 1.02)]
    return figure | {"layout": figure["layout"] | {"annotations": notes, "shapes": shapes}}


def _line(x: np.ndarray, y: np.ndarray, name: str, line: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": style.plain(name),
        "x": style.numbers(x),
        "y": style.numbers(y),
        "line": line,
    }
