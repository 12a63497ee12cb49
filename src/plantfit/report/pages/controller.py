"""A tuned controller as a page and as text, from its record."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from plantfit.findings.results.tuned_controller import Loop, LoopSignal, PidLoop, PredictiveLoop, ServoLoop, TunedController
from plantfit.report.case_page import write_case_page
from plantfit.report.figures.control.loops import loop_figure, nyquist_figure, sensitivity_figure
from plantfit.report.numbers import unit_label, with_unit

_MARKS = {"good": "", "info": "", "warning": "Note: ", "bad": "Not met: "}


def named(signal: LoopSignal) -> str:
    """T1 [degC]"""
    return f"{signal.name} [{signal.unit}]" if signal.unit else str(signal.name)


def heads(record: TunedController) -> tuple[str, ...]:
    """Heads of the table, with units: gains of a PID in ISA form, figures of the loop."""
    unit = record.output.unit
    load = "s" if unit in (None, "", "1") else f"{unit}*s"
    return (
        "tuning", with_unit("K", record.units["Kp"]), "Ti [s]", "Td [s]", "b", "IAE step [s]", "overshoot %",
        with_unit("IAE load", load), "Ms", "GM", "PM [deg]", "kept by",
    )  # fmt: skip


def table_rows(record: TunedController) -> list[tuple[str, ...]]:
    """Texts under `heads` for each controller: figures of the best fit; `kept by` is the share of all plants."""
    return [_row(r) for r in record.controllers]


def _row(r: Loop) -> tuple[str, ...]:
    margins = (f"{r.ms:.2f}", _number(r.gain_margin, 2), _number(r.phase_margin, 0)) if r.stable else ("unstable", "-", "-")
    pid = (f"{r.K:.4g}", f"{r.Ti:.4g}", f"{r.Td:.3g}", f"{r.b:.2g}") if isinstance(r, PidLoop) else ("-", "-", "-", "-")
    return (r.name, *pid, f"{r.iae:.4g}", f"{r.overshoot:.1f}", f"{r.load_iae:.4g}", *margins, f"{100 * r.share:.0f} %")


def settings(record: TunedController) -> str:
    """The tuned controller in a line, with units."""
    best, labels = record.controllers[0], {name: unit_label(unit) for name, unit in record.units.items()}
    per = {name: f" {label}" if label else "" for name, label in labels.items()}
    if isinstance(best, PidLoop):
        return (
            f"Kp {best.Kp:.6g}{per['Kp']}, Ki {best.Ki:.6g}{per['Ki']}, Kd {best.Kd:.6g}{per['Kd']}, b {best.b:.3g}, "
            f"filter {best.filter_time:.3g} s"
        )
    if record.plan is not None:
        plan = record.plan
        told = f"plans {len(plan.moves)} moves over {plan.seconds:.4g} s with {plan.rows} limits, {plan.steps} steps a sample"
        return f"{told} ({plan.multiplications} multiplications); without limits {_servo(best, per)}"
    return _servo(best, per)


def _servo(best: ServoLoop | PredictiveLoop, per: Mapping[str, str]) -> str:
    *states, load = best.K
    return (
        f"K ({', '.join(f'{v:.5g}' for v in states)}) of the states, {load:.4g} of the load, set point {best.f:.5g}{per['Kp']}, "
        f"{len(best.P)} past inputs, filter ({', '.join(f'{v:.4g}' for v in best.gain)})"
    )


def _finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if value is not None and value == value and abs(value) != float("inf") else "none"


def asked(record: TunedController) -> list[str]:
    """What the loop was asked for, with where it is from."""
    w = record.wishes
    y, u = (f" {s.unit}" if s.unit not in (None, "", "1") else "" for s in (record.output, record.input))
    start = w.set_point - w.step
    told = [
        f"{record.output.name} from {start:.5g} to {w.set_point:.5g}{y}, then a load of {w.load:.4g}{u} at the input.",
        f"At most {w.overshoot:g} % overshoot and Ms {w.ms:g} on {100 * w.share:g} % of the plants; "
        f"noise moves the input by at most {100 * w.input_noise:g} % of its range.",
        f"Sampled every {w.period:.6g} s, {record.input.name} within {w.lower:.5g} to {w.upper:.5g}{u}.",
    ]
    ends = (w.output_lower, w.output_upper)
    if any(_finite(v) for v in ends):
        low, high = (f"{v:.5g}" if _finite(v) else "any" for v in ends)
        told.append(f"{record.output.name} is to stay within {low} to {high}{y}.")
    if _finite(w.rate):
        told.append(f"{record.input.name} moves by at most {w.rate:.4g}{u} in a second, whichever controller drives it.")
    if record.others:
        told.append(f"Held: {', '.join(f'{n} = {v:.5g}' for n, v in record.others.items())}.")
    left = [f"{n} = {v}" for n, v in record.proposed.items() if n not in ("overshoot", "ms", "share", "input_noise", "anti_windup")]
    if left:
        told += [f"Proposed: {text}." for text in left]
    return told


def reduction(record: TunedController) -> str:
    """What the rules saw."""
    r = record.reduced
    what = "first order with dead time" if r.how == "as it is" else f"reduced to first order with dead time by {r.how}"
    if r.integrating:
        return f"The rules saw the plant as an integrator ({r.gain:.4g} per second) with dead time {r.dead_time:.4g} s ({r.how})."
    return f"The rules saw the plant as {what}: gain {r.gain:.4g}, lag {r.lag:.4g} s, dead time {r.dead_time:.4g} s, half a sample in it."


def sentences(record: TunedController) -> list[str]:
    """The verdict as lines."""
    return [_MARKS[v.level] + v.sentence for v in record.verdict]


def write_controller_page(record: TunedController, curves: Mapping[str, Any], path: str | Path, files: Sequence[str] = ()) -> Path:
    """Write the page of a tuned controller (`controllers.Controller.typed` and `.curves`) to `path`; StoreError where that fails."""
    best, w = record.controllers[0], record.wishes
    plants = f"{record.plants} plants"
    form = record.form
    if isinstance(best, PidLoop):
        told = (
            f"Parallel form: {settings(record)} of the derivative, which is that of the measurement. ISA form: "
            f"{with_unit('K', record.units['Kp'])} {best.K:.6g}, Ti {best.Ti:.6g} s, Td {best.Td:.6g} s."
        )
    else:
        told = f"{form}: {settings(record)}. Its matrices are in the JSON and C files."
    rows = table_rows(record)
    sources = "; ".join(f"{r.name}: {r.source}" for r in record.controllers if not r.source.startswith(("this", "the same")))
    page = {
        "title": f"Controller of {record.name}",
        "subtitle": f"{record.output.name} by {record.input.name}: {form} on plants {record.plants_are}",
        "sections": [
            {"title": "Verdict", "sentences": [*sentences(record), told]},
            {"title": "Asked for", "sentences": asked(record)},
            {
                "title": "Step and load",
                "figures": [
                    {
                        "figure": loop_figure(curves, w, named(record.output), named(record.input), plants),
                        "label": "output and input after a step of the set point and a load, over all plants",
                    }
                ],
            },
            {
                "title": "Robustness",
                "figures": [
                    {"figure": sensitivity_figure(curves, w.ms, plants), "label": "sensitivity over frequency"},
                    {"figure": nyquist_figure(curves, w.ms), "label": "Nyquist curves with the circle of Ms"},
                ],
            },
            {
                "title": "Beside the rules",
                "sentences": [reduction(record)],
                "tables": [
                    {
                        "caption": "Figures of the best fit; kept by: share of all plants that keep overshoot and Ms",
                        "columns": heads(record),
                        "rows": rows,
                        "note": f"Sources: {sources}.",
                    }
                ],
            },
        ],
    }
    return write_case_page(page, path, files)
