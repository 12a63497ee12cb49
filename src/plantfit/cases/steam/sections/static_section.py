"""What the page shows of the static task and of its dead times."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.cases.steam.static_task import NAMES, WINDOW, DelayStudy, StaticTask
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.rig.steam_chamber import NODES
from plantfit.trust.validate.dead_time import DeadTime

PAPER_TOTAL = 0.3442  # bar^2
UNITS = {"k": "bar/%", "A1": "s", "A2": "s²", "Td": "s"}
WANTED = 0.02  # s


def static_section(
    tasks: Sequence[StaticTask],
    early: Mapping[str, DeadTime],
    truth: Mapping[str, Mapping[str, Any]],
    study: Sequence[DelayStudy] = (),
) -> dict[str, Any]:
    """`tasks` by method, the joint fit first; `early` dead times and `truth` by opening; `study` of the rig with
    other sensors."""
    joint, two = tasks[0], tasks[1]
    delays = {n: float(p["Td"]) for n, p in truth.items()}
    off = [abs(joint.constants[n]["Td"] - d) for n, d in delays.items()]
    inside = sum(early[n].interval[0] <= d <= early[n].interval[1] for n, d in delays.items())
    told = [n for n, d in early.items() if d.determined]
    narrow = min(0.5 * (d.interval[1] - d.interval[0]) for d in early.values())
    sentences = [
        f"Four constants for each opening: total cost {two.total:.4f} bar² in the "
        f"paper's two steps, {joint.total:.4f} jointly; the paper's own record gave "
        f"{PAPER_TOTAL}. The rig's tables were made so that this number is alike.",
        "Fitted with the rest on whole records, the dead time takes up the error of "
        f"the model: it is off by up to {max(off):.2f} s. From the first {WINDOW:g} "
        f"s, as in the paper, {inside} of {len(early)} 95 % intervals hold the truth.",
        f"{len(told)} of {len(early)} records tell the dead time from zero and from 1 s; the narrowest interval is "
        f"±{narrow:.2f} s, so "
        f"that at this noise no single step tells it to {WANTED:g} s: a dead time and the lag A2/A1 look alike.",
    ]
    others = ", ".join(f"{t.label.removeprefix('two steps, ')} {t.total:.4f}" for t in tasks[2:])
    if others:
        sentences.insert(1, f"By the paper's two methods, in its two steps and from its start: {others} bar².")
    tables = [_totals(tasks), _delays(early, joint, two, delays)]
    if study:
        good = [s for s in study if s.half_width <= WANTED]
        names = ", ".join(f"{s.opening:g} %" for s in good)
        sentences.append(
            "With a quieter sensor and a finer card the same estimate "
            f"reaches ±{WANTED:g} s for these openings: {names}."
            if good
            else f"No sensor tried here reaches ±{WANTED:g} s."
        )
        tables.append(_study(study))
    figures = [
        {
            "figure": constants_figure(tasks[:2], truth),
            "label": "Constants over the openings (figure 2), truth at rest and its range",
        }
    ]
    return {
        "title": "Static task: four constants for each opening",
        "sentences": sentences,
        "tables": tables,
        "figures": figures,
    }


def _totals(tasks: Sequence[StaticTask]) -> dict[str, Any]:
    rows = [["the paper, CMA-ES and L-BFGS-B, on its own record", f"{PAPER_TOTAL:.4f}", "", "", ""]]
    for task in tasks:
        best = task.runs.min(axis=1, keepdims=True)
        same = f"{np.mean(task.runs <= 1.001 * best):.0%}" if task.runs.shape[1] > 1 else ""
        rows.append([task.label, f"{task.total:.4f}", str(task.runs.shape[1]), same, f"{task.evaluations:.0f}"])
    return {
        "caption": "Static task: total cost",
        "columns": ["method", "total cost [bar²]", "runs", "within 0.1 % of the best", "evaluations"],
        "rows": rows,
    }


def _delays(
    early: Mapping[str, DeadTime], joint: StaticTask, two: StaticTask, truth: Mapping[str, float]
) -> dict[str, Any]:
    rows = []
    for name, found in early.items():
        low, high = found.interval
        cut = ("0", not found.determined and low < WANTED), ("1 s", found.profile.at_upper)
        ends = [end for end, there in cut if there]
        said = "yes" if found.determined else f"not from {' and '.join(ends)}"
        hit = "yes" if low <= truth[name] <= high else "no"
        given = [found.value, low, high, truth[name], two.constants[name]["Td"], joint.constants[name]["Td"]]
        rows.append([f"{name.removeprefix('opening')} %", *(f"{v:.3f}" for v in given), hit, said])
    return {
        "caption": "Dead times [s]",
        "columns": [
            "opening",
            f"first {WINDOW:g} s",
            "95 % from",
            "to",
            "truth",
            "two steps (Td ≥ 0.1)",
            "joint",
            "inside",
            "told",
        ],
        "rows": rows,
    }


def _study(study: Sequence[DelayStudy]) -> dict[str, Any]:
    rows = []
    for s in study:
        seconds = (f"{s.half_width:.3f}", f"{s.bias:+.3f}", f"{s.rms:.3f}")
        rows.append(
            [f"{s.noise:g} bar, {s.bits} bits", f"{s.opening:g} %", f"{s.coverage:.0%}", *seconds, f"{s.told:.0%}"]
        )
    return {
        "caption": f"Dead time from the first {WINDOW:g} s, many records of the rig with other sensors",
        "columns": [
            "noise, card",
            "opening",
            "interval holds the truth",
            "half width [s]",
            "mean error [s]",
            "rms error [s]",
            "told",
        ],
        "rows": rows,
    }


def constants_figure(tasks: Sequence[StaticTask], truth: Mapping[str, Mapping[str, Any]]) -> Figure:
    """k, A1, A2, Td over the openings by every task, beside the range of the true tables over the pressures that the
    step passes."""
    data, layout = [], style.layout(460, showlegend=True)
    openings = np.array([float(n.removeprefix("opening")) for n in truth])
    for k, name in enumerate(NAMES):
        x, y = f"x{k + 1}" if k else "x", f"y{k + 1}" if k else "y"
        left, low = 0.55 * (k % 2), 0.56 * (1 - k // 2)
        layout[f"xaxis{k + 1}" if k else "xaxis"] = style.axis("opening [%]", domain=[left, left + 0.45], anchor=y)
        layout[f"yaxis{k + 1}" if k else "yaxis"] = style.axis(
            f"{name} [{UNITS[name]}]", domain=[low, low + 0.4], anchor=x
        )
        ends = np.array([_range(p, u, name) for p, u in zip(truth.values(), openings, strict=True)])
        band = {
            "type": "scatter",
            "mode": "lines",
            "x": style.numbers(np.r_[openings, openings[::-1]]),
            "xaxis": x,
            "yaxis": y,
            "fill": "toself",
        }
        band |= {
            "y": style.numbers(np.r_[ends[:, 0], ends[::-1, 1]]),
            "name": "truth",
            "legendgroup": "truth",
            "showlegend": k == 0,
        }
        data.append(band | {"line": {"color": style.MUTED, "width": 1.2}, "fillcolor": "rgba(120,120,120,0.25)"})
        for i, task in enumerate(tasks):
            values = np.array([task.constants[n][name] for n in truth])
            line = {"color": style.SERIES[i], "width": 1.6, "dash": ("solid", "dash")[i % 2]}
            found = {
                "type": "scatter",
                "mode": "lines+markers",
                "x": style.numbers(openings),
                "y": style.numbers(values),
                "xaxis": x,
                "yaxis": y,
            }
            data.append(
                found | {"name": style.plain(task.label), "legendgroup": task.label, "showlegend": k == 0, "line": line}
            )
    return {"data": data, "layout": layout}


def _range(p: Mapping[str, Any], opening: float, name: str) -> tuple[float, float]:
    """The least and the largest value of a true table up to the pressure at which the step comes to rest; twice a
    dead time."""
    values = np.asarray(p[name], dtype=float)
    if values.ndim == 0:
        return float(values), float(values)
    end = NODES[np.argmax(np.asarray(p["k"]) * opening < NODES)]  # the first node beyond
    passed = values[: int(np.searchsorted(NODES, end)) + 1]
    return float(passed.min()), float(passed.max())
