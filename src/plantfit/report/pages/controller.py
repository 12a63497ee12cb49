"""A tuned controller as a page and as text, from its record."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from plantfit.findings.results.tuned_controller import (
    CascadeLoop,
    Loop,
    LoopSignal,
    PidLoop,
    PredictiveLoop,
    ScheduledLoop,
    ServoLoop,
    SmithLoop,
    TunedController,
)
from plantfit.report.case_page import write_case_page
from plantfit.report.figures.control.fronts import front_figure
from plantfit.report.figures.control.loop_shapes import bode_figure, locus_figure
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
        "tuning", with_unit("K", record.units.get("K", record.units["Kp"])), "Ti [s]", "Td [s]", "b", "IAE step [s]",
        "overshoot %",
        with_unit("IAE load", load), "Ms", "GM", "PM [deg]", "kept by",
    )  # fmt: skip


def table_rows(record: TunedController) -> list[tuple[str, ...]]:
    """Texts under `heads` for each controller: figures of the best fit; `kept by` is the share of all plants."""
    return [_row(r) for r in record.controllers]


def _row(r: Loop) -> tuple[str, ...]:
    margins = (
        (f"{r.ms:.2f}", _number(r.gain_margin, 2), _number(r.phase_margin, 0)) if r.stable else ("unstable", "-", "-")
    )
    if isinstance(r, CascadeLoop):  # its gain is in other units than those of the head
        pid = ("-", f"{r.Ti:.4g}", f"{r.Td:.3g}", f"{r.b:.2g}")
        return (
            r.name,
            *pid,
            f"{r.iae:.4g}",
            f"{r.overshoot:.1f}",
            f"{r.load_iae:.4g}",
            *margins,
            f"{100 * r.share:.0f} %",
        )
    pid = (
        (f"{r.K:.4g}", f"{r.Ti:.4g}", f"{r.Td:.3g}", f"{r.b:.2g}")
        if isinstance(r, PidLoop | SmithLoop)
        else ("-", "-", "-", "-")
    )
    return (r.name, *pid, f"{r.iae:.4g}", f"{r.overshoot:.1f}", f"{r.load_iae:.4g}", *margins, f"{100 * r.share:.0f} %")


def settings(record: TunedController) -> str:
    """The tuned controller in a line, with units."""
    best, labels = record.controllers[0], {name: unit_label(unit) for name, unit in record.units.items()}
    per = {name: f" {label}" if label else "" for name, label in labels.items()}
    if isinstance(best, ScheduledLoop):
        ends = " to ".join(f"{g:.5g}" for g in (min(best.Kp, key=abs), max(best.Kp, key=abs)))
        return (
            f"gains of {len(best.levels)} levels of {record.output.name}, "
            f"Kp {ends}{per['Kp']}; they stand in the table of the levels"
        )
    if isinstance(best, PidLoop | SmithLoop | CascadeLoop):
        told = (
            f"Kp {best.Kp:.6g}{per['Kp']}, Ki {best.Ki:.6g}{per['Ki']}, Kd {best.Kd:.6g}{per['Kd']}, b {best.b:.3g}, "
            f"filter {best.filter_time:.3g} s"
        )
        if isinstance(best, CascadeLoop) and record.inner is not None:
            inner = (
                f"PI of {record.inner.name}: Kp {best.inner_Kp:.6g}{per['inner_Kp']}, Ki "
                f"{best.inner_Ki:.6g}{per['inner_Ki']}"
            )
            return f"PID of {record.output.name}: {told}; {inner}"
        ahead = (
            f", {best.ahead} samples ahead, {100 * best.taken:.3g} % of a miss per sample"
            if isinstance(best, SmithLoop)
            else ""
        )
        return told + ahead
    if record.plan is not None:
        plan = record.plan
        told = (
            f"plans {len(plan.moves)} moves over {plan.seconds:.4g} "
            f"s with {plan.rows} limits, {plan.steps} steps a sample"
        )
        return f"{told} ({plan.multiplications} multiplications); without limits {_servo(best, per)}"
    return _servo(best, per)


def _servo(best: ServoLoop | PredictiveLoop, per: Mapping[str, str]) -> str:
    *states, load = best.K
    return (
        f"K ({', '.join(f'{v:.5g}' for v in states)}) of the states, {load:.4g} of the load, set point "
        f"{best.f:.5g}{per['Kp']}, "
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
    weights = ", ".join(f"{v:g} {n.replace('_', ' ')}" for n, v in w.minimise.items())
    told = [
        f"{record.output.name} from {start:.5g} to {w.set_point:.5g}{y}, then a load of {w.load:.4g}{u} at the input.",
        f"At most {w.overshoot:g} % overshoot and Ms {w.ms:g} on {100 * w.share:g} % of the plants; "
        f"noise moves the input by at most {100 * w.input_noise:g} % of its range.",
        f"Sampled every {w.period:.6g} s, {record.input.name} within {w.lower:.5g} to {w.upper:.5g}{u}.",
    ]
    if w.minimise != {"iae": 1.0, "load_iae": 1.0}:
        told.append(f"Made small: {weights}, each counted in that of SIMC on the best fit.")
    if also := w.also(record.input.unit):
        told.append(f"Beside that at least {100 * w.share:g} % of the loops {', '.join(also)}.")
    if record.inner is not None:
        v = f" {record.inner.unit}" if record.inner.unit not in (None, "", "1") else ""
        low, high = (f"{e:.5g}" if _finite(e) else "any" for e in (w.inner_lower, w.inner_upper))
        told.append(f"Set points of {record.inner.name} within {low} to {high}{v}.")
    ends = (w.output_lower, w.output_upper)
    if any(_finite(v) for v in ends):
        low, high = (f"{v:.5g}" if _finite(v) else "any" for v in ends)
        told.append(f"{record.output.name} is to stay within {low} to {high}{y}.")
    if _finite(w.rate):
        told.append(
            f"{record.input.name} moves by at most {w.rate:.4g}{u} in a second, whichever controller drives it."
        )
    if record.others:
        told.append(f"Held: {', '.join(f'{n} = {v:.5g}' for n, v in record.others.items())}.")
    left = [
        f"{n} = {v}"
        for n, v in record.proposed.items()
        if n not in ("overshoot", "ms", "share", "input_noise", "anti_windup", "over")
    ]
    if left:
        told += [f"Proposed: {text}." for text in left]
    return told


def reduction(record: TunedController) -> str:
    """What the rules saw, or the outer loop of a cascade that has no rules beside it."""
    r, searched = record.reduced, {c.source for c in record.controllers}
    sees = "The rules saw" if len(searched) > 2 else "The outer loop sees"  # this search, and the same on one plant
    what = "first order with dead time" if r.how == "as it is" else f"reduced to first order with dead time by {r.how}"
    if r.integrating:
        return (
            f"{sees} the plant as an integrator ({r.gain:.4g} per second) with dead time {r.dead_time:.4g} s ({r.how})."
        )
    return (
        f"{sees} the plant as {what}: gain {r.gain:.4g}, lag "
        f"{r.lag:.4g} s, dead time {r.dead_time:.4g} s, half a sample in it."
    )


def level_heads(record: TunedController) -> tuple[str, ...]:
    """Heads of the table of a schedule, with units."""
    unit = with_unit(record.output.name, record.output.unit or "")
    return (
        unit, "step", with_unit("Kp", record.units["Kp"]), "Ti [s]", "Td [s]", "b", "IAE step [s]", "kept by",
        "kept by one PID",
    )  # fmt: skip


def level_rows(record: TunedController) -> list[tuple[str, ...]]:
    """Texts under `level_heads`; the last column is the PID of the level that does best at all."""
    assert record.schedule is not None
    rows: list[tuple[str, ...]] = []
    for r in record.schedule.levels:
        s = r.settings
        own = (f"{s['Kp']:.4g}", f"{s['Ti']:.4g}", f"{s['Td']:.3g}", f"{s['b']:.2g}")
        shares = (f"{100 * r.share:.0f} %", f"{100 * r.alone[record.schedule.best_single]:.0f} %")
        rows.append((f"{r.level:.5g}", f"{r.step:+.3g}", *own, f"{r.iae:.4g}", *shares))
    return rows


def front_heads(record: TunedController) -> tuple[str, ...]:
    """Heads of the table of a front, with units."""
    assert record.front is not None
    return ("point", *(with_unit(n.replace("_", " "), record.front.units[n]) for n in record.front.figures), "kept by")


def front_rows(record: TunedController) -> list[tuple[str, ...]]:
    """Texts under `front_heads`."""
    assert record.front is not None
    return [
        (str(p.number), *(f"{p.figures[n]:.4g}" for n in record.front.figures),
         f"{100 * p.share:.0f} %") for p in record.front.points
    ]  # fmt: skip


def front_told(record: TunedController) -> str:
    """What to do with a front."""
    assert record.front is not None
    front = record.front
    taken = (
        f"Point {front.picked} is the controller here"
        if front.picked
        else "The controller here is that of the least weighted sum"
    )
    return (
        "Each point is a controller: over all plants no other is better "
        f"in {' and '.join(n.replace('_', ' ') for n in front.figures)}. "
        f"Figures are those of the best fit. {taken}; --pick takes another."
    )


def sentences(record: TunedController) -> list[str]:
    """The verdict as lines."""
    return [_MARKS[v.level] + v.sentence for v in record.verdict]


def _front_section(record: TunedController) -> list[dict[str, Any]]:
    if record.front is None:
        return []
    table = {
        "caption": "Figures of the best fit; kept by: share of all plants",
        "columns": front_heads(record),
        "rows": front_rows(record),
    }
    picture = {"figure": front_figure(record.front), "label": "controllers of the front, numbered as --pick takes them"}
    return [{"title": "Front", "sentences": [front_told(record)], "figures": [picture], "tables": [table]}]


def _specifications_section(record: TunedController) -> dict[str, Any]:
    """What each of the two that were searched risks: shares by specification."""
    both = record.controllers[:2]
    rows = [(name, *(f"{100 * r.meets[name]:.3g} %" for r in both)) for name in both[0].meets]
    rows.append(("all of them", *(f"{100 * r.share:.3g} %" for r in both)))
    table = {
        "caption": f"Shares of {record.plants} plants that meet each specification",
        "columns": ("specification", *(f"tuned on {r.name}" for r in both)), "rows": rows,
    }  # fmt: skip
    return {"title": "Each specification", "sentences": [], "tables": [table]}


def _schedule_section(record: TunedController) -> list[dict[str, Any]]:
    if record.schedule is None:
        return []
    best = record.schedule.levels[record.schedule.best_single].level
    table = {
        "caption": "Gains over the level; between levels they lie on the straight line, beyond the ends they are those "
                   "of the end",
        "columns": level_heads(record), "rows": level_rows(record),
        "note": f"kept by: share of all plants that keep the wishes there; one PID: that of {best:.5g} at all levels.",
    }  # fmt: skip
    return [{"title": "Levels", "sentences": [], "tables": [table]}]


def write_controller_page(
    record: TunedController, curves: Mapping[str, Any], path: str | Path, files: Sequence[str] = ()
) -> Path:
    """Write the page of a tuned controller (`controllers.Controller.typed` and `.curves`) to `path`; StoreError
    where that fails."""
    best, w = record.controllers[0], record.wishes
    plants = f"{record.plants} plants"
    form = record.form
    if isinstance(best, PidLoop):
        told = (
            f"Parallel form: {settings(record)} of the derivative, which is that of the measurement. ISA form: "
            f"{with_unit('K', record.units['Kp'])} {best.K:.6g}, Ti {best.Ti:.6g} s, Td {best.Td:.6g} s."
        )
    else:
        more = "" if isinstance(best, CascadeLoop | ScheduledLoop) else " Its matrices are in the JSON and C files."
        told = f"{form[0].upper()}{form[1:]}: {settings(record)}.{more}"
    rows = table_rows(record)
    sources = "; ".join(
        f"{r.name}: {r.source}" for r in record.controllers if not r.source.startswith(("this", "the same"))
    )
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
                    {"figure": bode_figure(curves, plants), "label": "Bode diagram of the open loop"},
                    {
                        "figure": locus_figure(curves),
                        "label": "poles of the loop of the best fit, its gain from a tenth to ten times",
                    },
                ],
            },
            _specifications_section(record),
            *_schedule_section(record),
            *_front_section(record),
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
