"""Section of the robot's page on the gains: settings of the loop, the winning gains of every method on both motors,
the paper's bars."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.cases.robot.speed_loop import (
    ENCODERS,
    PERIOD,
    SAMPLES,
    SET_POINT,
    SUPPLY,
    TIMER,
    UPPER,
    constant_duty,
    fitness,
    response,
)
from plantfit.control import StepMetrics
from plantfit.control.steps.step_metrics import step_metrics
from plantfit.optimize import RunResult
from plantfit.recording import Recording
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure

Motor = Mapping[str, float]
TERMS = ("overshoot", "rise", "settling", "peak", "error")
SETTINGS = (
    ("alpha of overshoot, rise, settling, peak time, error", "1 each", "not printed"),
    ("overshoot and steady-state error", "as shares of the set point", "not printed"),
    ("times", "s, at most the second that is simulated", "not printed"),
    ("sample time Ts", f"{1e3 * PERIOD:g} ms, {SAMPLES} samples", "not printed"),
    ("set point", f"{SET_POINT:g} rad/s from rest", "not printed"),
    ("supply, PWM", f"{SUPPLY:g} V, 8 bits in whole counts", "8 bits, supply not printed"),
    ("limits of u", "0 to 255 counts", "0 to u_max, at most 255"),
    ("box of Kp, Ki, Kd", "0 to " + ", 0 to ".join(f"{u:g}" for u in UPPER), "not printed; genes in [-lambda, lambda]"),
    ("integral, derivative", "Tustin, backward difference; no anti-windup, no filter", "the same"),
    ("speed measured", f"pulse period, steps of {TIMER:g} rad/s", "not printed"),
    ("elite GA", "600 generations of 500, elite 10, immigrants 10, mutation 0.2", "the same"),
    ("end", "600 generations or fitness 1e-4", "the same"),
)


def winners(
    ga: Sequence[RunResult], long: Mapping[str, RunResult], short: Mapping[str, Sequence[RunResult]]
) -> dict[str, RunResult]:
    """The best run of every method and budget, by a label."""
    best = {"elite_ga, 300 000 loops": min(ga, key=lambda r: r.cost)}
    best |= {f"{n}, 300 000 loops": r for n, r in long.items()}
    return best | {f"{n}, 3000 loops": min(rs, key=lambda r: r.cost) for n, rs in short.items()}


def gains_section(
    identified: Motor, truth: Motor, best: Mapping[str, RunResult], measured: Recording
) -> dict[str, Any]:
    """What the search was told, what it found, what that does on the true motor, and why it differs there."""
    order = sorted(best, key=lambda n: best[n].cost)
    rows = []
    for name in order:
        gains = best[name].x * UPPER
        here, there = (response(m, gains)[1] for m in (identified, truth))
        moved = _terms(there) - _terms(here)
        most = int(np.argmax(np.abs(moved)))
        said = (
            f"{TERMS[most]} {_terms(here)[most]:.4f} to {_terms(there)[most]:.4f}"
            if abs(moved[most]) > 1e-9
            else "nothing"
        )
        rows.append(
            [name, *(f"{g:.6g}" for g in gains), f"{float(fitness(here)):.4f}", f"{float(fitness(there)):.4f}", said]
        )
    leader = best[order[0]].x * UPPER
    cases = {
        "measured at 3 V": measured_metrics(measured)[1],
        "simulated at constant duty": response(identified, constant_duty(identified))[1],
        "simulated with the PID": response(identified, leader)[1],
    }
    shown = _bars(cases)
    return {
        "title": "The PID: settings, gains of every method, and the true motor",
        "sentences": [
            "The gains were found on the identified motor, its constants to four digits; the last columns replay them "
            "on the bench's true "
            "one. Where both differ, the term that changes most is named. A peak time is that of the largest value: of "
            "a response that is "
            "flat to an encoder's step another sample is the largest once the motor is slightly another.",
            f"Bars: {order[0]}, a constant duty, and the record at 3 V, filtered at 200 Hz, against "
            "the speed that it settles at; the encoder's slots keep the record outside of the 2 % "
            "band for longer than the motor is. The paper draws these five figures without numbers.",
        ],
        "tables": [
            {"caption": "What the fitness of equation 13 was made of", "columns": ["setting", "here", "the paper"],
             "rows": [list(row) for row in SETTINGS]},
            {"caption": "The best gains of every method",
             "columns": ["method", "Kp", "Ki [1/s]", "Kd [s]", "identified motor", "true motor", "differs most in"],
             "rows": rows},
            {"caption": "Step metrics of the three cases (the paper's figure 7)", "columns": ["case", *BARS], "rows": [
                [name, *(f"{v:.4g}" if np.isfinite(v) else "never" for v in _five(m))] for name, m in cases.items()]},
        ],
        "figures": [{"figure": shown, "label": "Overshoot, rise, settling and peak time, error: record, constant duty, "
                                               "PID"}],
    }  # fmt: skip


def measured_metrics(measured: Recording) -> tuple[float, StepMetrics]:
    """The speed (rad/s) at which a filtered record settles, the mean of its last half, and the metrics of its way
    there."""
    t, w = measured.t, measured["w_both"]
    there = np.isfinite(w)
    final = float(np.mean(w[there & (t > 0.5 * t[-1])]))
    found = step_metrics(t[there], w[there] / final * SET_POINT, SET_POINT)
    return final, found


def encoders_table(truth: Motor, tuned: Mapping[str, np.ndarray]) -> list[list[str]]:
    """Steps on the true motor, gains by encoder: name, encoder, overshoot, rise, settling, peak, error, fitness."""
    rows = []
    for name, gains in tuned.items():
        for encoder, step in ENCODERS.items():
            rows.append([name, encoder, *said(response(truth, gains, step)[1])])
    return rows


def said(m: StepMetrics) -> list[str]:
    """Metrics as a row of a table."""
    times = [f"{t:.3f}" if np.isfinite(t) else "never" for t in (m.rise_time, m.settling_time, m.peak_time)]
    return [f"{m.overshoot:.2f}", *times, f"{m.steady_state_error:.2f}", f"{float(fitness(m)):.4f}"]


def _terms(m: StepMetrics) -> np.ndarray:
    """The five terms of the fitness."""
    horizon = PERIOD * SAMPLES
    times = [min(float(t), horizon) for t in (m.rise_time, m.settling_time, m.peak_time)]
    return np.array([m.overshoot / 100, *times, abs(m.steady_state_error) / SET_POINT])


BARS = ("overshoot [%]", "rise time [s]", "settling time [s]", "peak time [s]", "error [% of the set point]")


def _five(m: StepMetrics) -> tuple[float, ...]:
    return m.overshoot, m.rise_time, m.settling_time, m.peak_time, 100 * abs(m.steady_state_error) / SET_POINT


def _bars(cases: Mapping[str, StepMetrics]) -> Figure:
    """A panel for each metric, a bar for each case; what never happens has no bar."""
    data, layout = [], style.layout(300, showlegend=True)
    names = list(cases)
    for k, title in enumerate(BARS):
        axis = "" if k == 0 else str(k + 1)
        low = k / len(BARS) + 0.035
        quiet = {"showticklabels": False, "showgrid": False}
        layout["xaxis" + axis] = style.axis(title, domain=[low, (k + 1) / len(BARS)], anchor="y" + axis, **quiet)
        layout["yaxis" + axis] = style.axis(anchor="x" + axis, nticks=5, rangemode="tozero")
        for c, name in enumerate(names):
            bar = {
                "type": "bar",
                "x": [name],
                "y": style.numbers(np.array([_five(cases[name])[k]])),
                "name": style.plain(name),
            }
            look = {"marker": {"color": style.SERIES[c]}, "legendgroup": name, "showlegend": k == 0}
            data.append(bar | look | {"xaxis": "x" + axis, "yaxis": "y" + axis, "hovertemplate": "%{y:.4~g}"})
    return {"data": data, "layout": layout}
