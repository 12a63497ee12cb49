"""What a controller that was tuned on a family of plants is worth, as sentences and as records."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit.control.linear.cascade import Cascade
from plantfit.control.pid import Gains
from plantfit.control.scheduling.law import Schedule
from plantfit.control.tune.forms.loop_poles import loop_poles
from plantfit.control.tune.forms.pid_form import isa_of
from plantfit.control.tune.frequency import frequencies, open_loop
from plantfit.control.tune.loop_design import BESIDE, BEST_FIT, FINE, ROBUST, LoopDesign, article, responses_of
from plantfit.control.tune.reduction import slowest
from plantfit.control.tune.rules import RULES
from plantfit.control.tune.searching.judged import Row, specifications
from plantfit.control.tune.wishes import range_of
from plantfit.findings.record import Level
from plantfit.findings.results.tuned_controller import (
    CascadeLoop,
    Loop,
    PidLoop,
    PredictiveLoop,
    ScheduledLoop,
    ServoLoop,
    SmithLoop,
)
from plantfit.findings.verdict import Sentence

FEW = 40  # plants drawn as lines
POINTS = 400  # of a curve in the record
SLOWER = 1.5  # times the IAE of the best fit's own tuning: the price of not knowing the plant that is told
CLEAR = 0.3  # share of the variance that a parameter has to explain to be named


def verdict(design: LoopDesign, names: Mapping[str, np.ndarray], how: str = "that the data allow") -> list[Sentence]:
    """Sentences with a level; `names` are the free parameters (n,) of the family by name."""
    wishes, best, alone = design.wishes, design.best, design.row(BEST_FIT)
    n, also = design.family.count, wishes.also(design.family.model.inputs[design.family.input])
    told: list[Sentence] = []

    def say(level: Level, sentence: str) -> None:
        told.append(Sentence(level=level, sentence=sentence))

    scheduled = isinstance(best.parameters, Schedule)
    # beside a schedule that was a PID of one level, judged at that level
    beside = "" if alone is None or scheduled else f"; tuned on the best fit alone: {percent(alone.share)}"
    say(
        "good" if design.promised else "bad",
        f"Of {n} plants {how}, {percent(best.share)} have an overshoot under {wishes.overshoot:g} % "
        f"and an Ms under {wishes.ms:g}{''.join(f', {more}' for more in also)}{beside}.",
    )
    unstable = int(np.sum(~design.judged.stable[0]))
    if unstable:
        say("bad", f"{unstable} of the {n} loops are unstable.")
    if design.right_sign < 1:
        say(
            "bad",
            f"{percent(1 - design.right_sign)} of the plants have a gain "
            "of the other sign, which no controller of one sign can hold.",
        )
    if design.held < 1:
        say(
            "warning",
            f"On {percent(1 - design.held)} of the plants the input's limits {wishes.lower:.4g} to "
            f"{wishes.upper:.4g} do not hold the set point under the load: widen them, or choose a lower one.",
        )
    if not design.promised:
        held = {name: float(np.mean(design.judged.meets[0, :, k])) for name, k in specifications(wishes).items()}
        parts = [f"{name} on {percent(share)}" for name, share in held.items() if share < 1]
        why = f" ({', '.join(parts)})" if parts else ""
        asked = f"{percent(wishes.share)} were asked for{why}"
        if _beyond(design):
            own = "at one of the levels" if scheduled else f"with the {best.form.name} that was tuned on it alone"
            say(
                "bad",
                f"{asked}: the best fit misses it too, {own}, so that "
                "measuring again does not help. Ask for less, widen the input's limits, or take another controller.",
            )
        else:
            say("bad", f"{asked}: measure this first, or ask for less.{_first(design, names, *_worst(design))}")
    elif alone is not None and design.alike and best.scores.iae > SLOWER * alone.scores.iae:
        say(
            "info",
            f"Not knowing the plant better makes the step {best.scores.iae / alone.scores.iae:.1f} "
            f"times slower on the best fit than tuning on it alone would.{_first(design, names)}",
        )
    others = [(i, r) for i, r in enumerate(design.rows) if r.name.endswith(BESIDE)]
    if np.isfinite(wishes.output_lower) or np.isfinite(wishes.output_upper):
        say(*_limits_kept(design, others))
    for _, beside in others:
        say("info", _compared(best, beside))
    rules = [r for r in design.rows if r.name in RULES and r.share >= wishes.share]
    if rules and design.promised and not scheduled:  # their shares are those of one level
        first = min(rules, key=lambda r: r.worst["iae"] if np.isfinite(r.worst["iae"]) else np.inf)
        say("info", f"The rule {first.name} keeps these limits too{_larger(first, best)}.")
    return told


def _larger(rule: Row, best: Row) -> str:
    """How much larger than the tuned controller's the errors of a rule are on the best fit; a search that makes both
    small may give up some of one for more of the other."""
    pairs = ((rule.scores.iae, best.scores.iae), (rule.scores.load_iae, best.scores.load_iae))
    step, load = (other / own if own > 0 else np.inf for other, own in pairs)
    if not np.isfinite(step):
        return ""
    told = f"; the IAE of its step is {step:.2f} times as large ({rule.scores.iae:.4g} s)"
    return f"{told}, that of its load {load:.2f} times" if np.isfinite(load) else told


def _limits_kept(design: LoopDesign, others: list[tuple[int, Row]]) -> tuple[Level, str]:
    """How many plants keep the limits of the output."""
    wishes, inside = design.wishes, np.mean(design.judged.scores.outside <= design.wishes.tolerated, axis=1)
    beside = "".join(f"; {r.form.name}: {percent(float(inside[i]))}" for i, r in others)
    limits = range_of(wishes.output_lower, wishes.output_upper)
    told = f"{percent(float(inside[0]))} of the plants keep the output {limits}, to {wishes.tolerated:.2g}{beside}."
    return "good" if inside[0] >= wishes.share else "bad", told


def _compared(best: Row, pid: Row) -> str:
    """The same search for a simpler form beside the one that was asked for."""
    pairs = ((pid.scores.iae, best.scores.iae), (pid.scores.load_iae, best.scores.load_iae))
    step, load = (other / own if own > 0 else np.inf for other, own in pairs)
    form, kept = pid.form.name, percent(pid.share)
    told = (
        f"{article(form).capitalize()} {form} tuned on the same plants: {kept} keep the wishes, "
        f"with {step:.2f} times the IAE of the step and {load:.2f} times that of the load"
    )
    if pid.share >= best.share - 0.01 and 0.5 * (step + load) <= 1.05:
        own = best.form.name if best.form.name.isupper() else f"the {best.form.name}"
        return f"{told}: {own} gains nothing here."
    return f"{told}."


def percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share in (0.0, 1.0) or 0.005 <= share <= 0.995 else f"{100 * share:.1f} %"


def _beyond(design: LoopDesign) -> bool:
    """Whether the best fit itself misses what was asked for, even with the controller that was tuned on it alone. A
    schedule is judged at every level, and the controller of the best fit alone at one of them."""
    if isinstance(design.best.parameters, Schedule):
        return not bool(design.judged.kept[0, 0])
    own = [i for i, row in enumerate(design.rows) if row.name in (ROBUST, BEST_FIT)]
    return len(own) > 1 and not any(bool(design.judged.kept[i, 0]) for i in own)


def _worst(design: LoopDesign) -> tuple[str, np.ndarray]:
    """The figure (n,) of the limit that most plants miss, with its name."""
    scores, ms = design.judged.scores, design.judged.ms[0]
    figures = {
        1: ("overshoot", scores.overshoot[0]), 3: ("what is left of the step", scores.left[0]),
        4: ("the output beyond its limits", scores.outside[0]), 7: ("the settling time", scores.settling[0]),
        8: ("the travel", scores.travel[0]),
    }  # fmt: skip
    places = list(specifications(design.wishes).values())
    worst = min(places, key=lambda k: float(np.mean(design.judged.meets[0, :, k])))
    return figures.get(worst, ("Ms", ms))  # stability and margins go with it


def _first(
    design: LoopDesign, names: Mapping[str, np.ndarray], figure: str = "Ms", values: np.ndarray | None = None
) -> str:  # fmt: skip
    """Which parameter the spread of the loops comes from, by the rank correlation with a figure (n,) of them."""
    size = np.nan_to_num(design.judged.ms[0] if values is None else values, nan=1e9, posinf=1e9)
    target = np.argsort(np.argsort(size))
    shares = {}
    for name, drawn in names.items():
        if np.ptp(drawn) > 0:
            shares[name] = float(np.corrcoef(np.argsort(np.argsort(drawn)), target)[0, 1]) ** 2
    if not shares or not np.ptp(size) > 0:
        return ""
    name = max(shares, key=lambda n: shares[n])
    if not shares[name] > CLEAR:
        return " No single parameter is to blame; a longer recording with a livelier input serves (plantfit design)."
    aimed = "" if "[" in name else f" --for {name}"  # an entry of a table has no experiment of its own
    return (
        f" {percent(shares[name])} of the spread of {figure} comes from {name}: measure it better (plantfit "
        f"design{aimed}), or state it."
    )


def table(design: LoopDesign) -> list[Loop]:
    """A row for each controller."""
    return [_row(design, i, r) for i, r in enumerate(design.rows)]


def _row(design: LoopDesign, i: int, row: Row) -> Loop:
    s, m, own = row.scores, row.margins, settings(row.parameters)
    if row.form.ahead:
        own["ahead"] = row.form.ahead
    plain = PidLoop if "Kp" in own else PredictiveLoop if "X" in own else ServoLoop
    plain = ScheduledLoop if "levels" in own else plain
    kind = SmithLoop if row.form.ahead else CascadeLoop if row.form.inner else plain
    return kind(
        name=row.name, source=row.source, form=row.form.name, **own,
        iae=s.iae, overshoot=s.overshoot, settling=s.settling, load_iae=s.load_iae, load_peak=s.load_peak,
        travel=s.travel, outside=s.outside, itae=s.itae,
        ms=float(m.ms), mt=float(m.mt), gain_margin=float(m.gain), phase_margin=float(m.phase), stable=bool(m.stable),
        input_noise=float(design.judged.input_noise[i, 0]), share=row.share,
        stable_share=float(np.mean(design.judged.stable[i])),
        worst=dict(row.worst),
        meets={name: float(np.mean(design.judged.meets[i, :, k])) for name, k in specifications(design.wishes).items()},
    )  # fmt: skip


def settings(parameters: Any) -> dict[str, Any]:
    """The gains of a PID in both forms; the arrays of a predictor, an LQ servo, and its plan, as lists."""
    if isinstance(parameters, Schedule):
        names = ("Kp", "Ki", "Kd", "b", "filter_time")
        return {"levels": np.asarray(parameters.levels).tolist()} | {
            n: np.asarray(getattr(parameters.gains, n)).tolist() for n in names
        }
    if isinstance(parameters, Cascade):
        inner = settings(parameters.inner)
        return settings(parameters.outer) | {"inner_Kp": inner["Kp"], "inner_Ki": inner["Ki"], "inner_Ti": inner["Ti"]}
    if not isinstance(parameters, Gains):
        found: dict[str, Any] = {}
        for name, value in parameters._asdict().items():
            own = "set_point_share" if name == "share" else name  # a row has a share of the plants too
            found |= settings(value) if hasattr(value, "_asdict") else {own: np.asarray(value).tolist()}
        return found
    g, isa = parameters, isa_of(parameters)
    return {
        "Kp": float(g.Kp), "Ki": float(g.Ki), "Kd": float(g.Kd), "K": float(isa.K), "Ti": float(isa.Ti),
        "Td": float(isa.Td),
        "b": float(g.b), "filter_time": float(g.filter_time),
    }  # fmt: skip


def figure_units(output: str | None, input_: str | None) -> dict[str, str]:
    """Units of the figures that a search makes small, empty for none."""
    y, u = ("" if unit in (None, "1") else unit for unit in (output, input_))
    load = f"{y}*s" if y else "s"
    return {
        "iae": "s", "itae": "s^2", "load_iae": load, "load_peak": y, "settling": "s", "overshoot": "%", "travel": u,
        "input_noise": "",
    }  # fmt: skip


def curves(design: LoopDesign, seed: int = 0) -> dict[str, Any]:
    """Step responses and sensitivities of the family: bands (5, 50, 95 %), some lines, the best fit, and the tuning
    on the best fit alone."""
    wishes, found = design.wishes, {}
    slow = slowest(design.reduced)
    w = frequencies(wishes.period, slow, FINE, design.rest.A)
    w = w[w >= 1e-2 / slow]
    late = np.min(np.where(np.any(design.rest.B != 0, axis=2), design.rest.late, np.inf), axis=1)
    some = np.unique(np.r_[0, np.linspace(0, design.family.count - 1, FEW).round().astype(int)])
    for name in (ROBUST, BEST_FIT):
        row = design.row(name)
        assert row is not None
        seen = design.judges[row.form.name].responses(row.parameters)
        at = np.unique(np.linspace(0, len(seen["t"]) - 1, POINTS).round().astype(int))
        loop = open_loop(
            row.form.response(row.parameters, w), responses_of(design.family, design.rest, row.form, wishes.period, w)
        )
        s = np.abs(1.0 / (1.0 + loop))
        few = np.unique(np.linspace(0, len(w) - 1, POINTS // 2).round().astype(int))
        found[name] = {
            "t": seen["t"][at], "y": _bands(seen["y"][:, at]), "u": _bands(seen["u"][:, at]),
            "y_lines": seen["y"][some][:, at],
            "w": w[few], "sensitivity": _bands(s[:, few]), "nyquist": loop[some][:, few],
            "gain": _bands(np.abs(loop[:, few])), "phase": _bands(_phase(loop, w, late)[:, few]),
            "locus": loop_poles(design.family, design.rest, row.form, row.parameters, wishes.set_point, wishes.period),
        }  # fmt: skip
    return found


def _phase(loop: np.ndarray, w: np.ndarray, late: np.ndarray) -> np.ndarray:
    """Phases (n, F) in degrees without jumps at w (F,) in rad/s, the first between -270 and 90.

    A dead time of `late` (n,) s that turns a loop by more than a quarter between two frequencies is taken out while
    jumps are sought.
    """
    known = np.where(np.isfinite(late) & (np.max(np.diff(w)) * late > 0.5 * np.pi), late, 0.0)
    turned = np.multiply.outer(known, w)
    found = np.degrees(np.unwrap(np.angle(loop * np.exp(1j * turned)), axis=1) - turned)
    return found - 360.0 * np.ceil((found[:, :1] - 90.0) / 360.0)


def _bands(values: np.ndarray) -> dict[str, np.ndarray]:
    low, middle, high = np.nanquantile(np.where(np.isfinite(values), values, np.nan), (0.05, 0.5, 0.95), axis=0)
    return {"low": low, "middle": middle, "high": high, "best": values[0]}
