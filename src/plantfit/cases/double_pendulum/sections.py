"""The sections of the double pendulum's page."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit.cases.double_pendulum.fits.fit_law import predicted
from plantfit.cases.double_pendulum.fits.laws import PLAIN, Fitted
from plantfit.cases.double_pendulum.fits.results import Results, torque_over_all
from plantfit.cases.double_pendulum.fits.runs import Run
from plantfit.cases.double_pendulum.reference import EDGE, PUBLISHED, RUNS, published, reference_torque
from plantfit.recording import cutoff_frequency, resample
from plantfit.recording.signals.differentiation import compare_derivatives
from plantfit.report.figures import style
from plantfit.trust.identify.base_parameters import base_parameters
from plantfit.trust.intervals.parameter_rows import ROUGH
from plantfit.trust.verdict.words import number

Section = dict[str, Any]
PHYSICAL = ("I1", "I2", "m2", "Ir", "m1r1", "m2r2", "b1", "b2", "cf1", "cf2")
L1 = 0.2
DRAWN = "144115"  # the run whose torque and angles are drawn
ENCODER_STEP = 3.8e-4  # rad
COMPARED: tuple[dict[str, Any], ...] = (
    {"method": "central"},
    {"method": "spline"},
    *({"method": "kalman", "cutoff": c} for c in ("likelihood", 5.0, 15.0, 60.0)),
)


def laws(r: Results) -> Section:
    """Every candidate law, scored on runs that it was not fitted to."""
    rows = []
    for name, made in r.left_out.items():
        law = r.fitted[name]
        gain = r.choice.gains.get(name)
        cross = float(np.sqrt(r.choice.means[name]))
        count = f"{len(law.values) + (len(law.law.grid) > 1)}" + (f" + {2 * len(r.runs)}" if law.zeros else "")
        scores = [torque_over_all(law, r.runs)["both"], cross, *(v.scores["both"] for v in made.values())]
        rows.append(
            [name, count, *map(_mean, scores[:2]), "chosen" if gain is None else _gain(*gain), *map(_mean, scores[2:])]
        )
    columns = ["law", "parameters", "all runs", "left out", "behind, 1e-3 (N m)²", *r.runs]
    return {
        "title": "Which friction law",
        "sentences": [
            f"Each run left out in turn: {r.choice.best} predicts the unseen runs best.",
            "Widths, velocities and distances are fitted inside of "
            "every fold, so that the left-out run has no say in them.",
            "All runs: fitted to all, encoder zeros too where the law has them (two more "
            "parameters for each run). A law with more terms fits all runs a little better and may "
            "still lose on an unseen one. With five runs the standard error of a gain is rough.",
            "Behind: the mean square of the runs left out, above that "
            "of the chosen law; last the runs left out one by one.",
            "Load: friction per torque through the gear, which a law without load, fitted first, "
            "estimates. Presliding: Dahl's state for the sign of the velocity. Encoder zeros: "
            "two angles of each fitted run, nuisances; an unseen run is taken as recorded.",
        ],
        "tables": [{"caption": "Torque RMSE of both joints [N m] by friction law", "columns": columns, "rows": rows}],
    }


def left_out(r: Results) -> Section:
    """The chosen law and the published models on every run."""
    rows = []
    for name in r.runs:
        own = r.best[name].scores
        rows.append([
            name, *(_mean(own[j]) for j in ("joint 1", "joint 2", "both")),
            *(_mean(r.published[m][name]["both"]) for m in PUBLISHED),
            *(_mean(r.alike[m][name]["both"]) for m in PUBLISHED),
        ])  # fmt: skip
    columns = ["run", "joint 1", "joint 2", "both", *PUBLISHED, *(f"{m}, filtered alike" for m in PUBLISHED)]
    return {
        "title": "Runs left out, against the published models",
        "sentences": [
            "Ours is fitted to the other four runs. The published models are scored as their authors filter: motion "
            "first, then the law.",
            "Filtering torque and columns alike helps the published "
            "models too; the rest of the gain is the law and its fit.",
        ],
        "tables": [{"caption": "Torque RMSE [N m]", "columns": columns, "rows": rows}],
        "figures": [
            {
                "figure": _torque_figure(r),
                "label": f"Measured and predicted torque of both joints in run {DRAWN}, left out.",
            }
        ],
    }


def parameters(r: Results) -> Section:
    """Values, intervals, what is determined, and encoder zeros."""
    final = r.final
    units = final.model.coefficients
    rows = []
    for name, value in final.values.items():
        theirs = [number(published(m)[name]) if name in published(m) else "" for m in PUBLISHED]
        error = r.errors.get(name)
        interval = (
            "at its bound" if error is None else f"{number(value - 1.96 * error)} to {number(value + 1.96 * error)}"
        )
        rows.append([name, units[name] or "", number(value), interval, *theirs])
    tables = [
        {"caption": "Parameters", "columns": ["parameter", "unit", "value", "95 % interval", *PUBLISHED], "rows": rows}
    ]
    sentences = [
        base_parameters(physical_columns(r.fitted[PLAIN.name], r.runs), PHYSICAL, {"l1": L1}).sentence,
        "Hence model_1.0 (m2 = 0.626 kg) and model_2.0 (m2 = 0.337 kg) predict alike: m2 moves along a direction that "
        "no torque shows. "
        "b1 = I1 + m2 l1² and b4 = m1r1 + m2 l1 are what can be known.",
        "Intervals respect the residuals' correlation in time and between joints; the presliding distance "
        f"({1e3 * final.shape:.2g} mrad) and the loads are taken as known in them.",
    ]
    plain = sum(abs(e) <= ROUGH * abs(final.values[n]) for n, e in r.errors.items())
    sentences.append(
        f"That is what any motion shows at best. How well these runs show it: of the {len(final.values)} numbers of "
        f"the chosen law {plain} "
        f"have a standard error of at most {100 * ROUGH:.0f} % of the value."
    )
    unsure = [n for n, e in r.errors.items() if abs(final.values[n]) < 1.96 * e]
    if unsure:
        sentences.append(f"The interval of {' and '.join(unsure)} holds 0: the data do not tell whether it is there.")
    if final.zeros:
        zeros = [[n, *(f"{1e3 * v:.0f}" for v in z)] for n, z in final.zeros.items()]
        tables.append(
            {
                "caption": "Encoder zeros [mrad], to add to the angles",
                "columns": ["run", "joint 1", "joint 2"],
                "rows": zeros,
            }
        )
        sentences.append(
            "The zeros differ from run to run by up to degrees, as if each run had begun "
            "where friction held the hanging links. They show as a torque that follows "
            "the cosine of the angle, and cannot be known for a run before it is measured."
        )
    return {"title": "Parameters", "sentences": sentences, "tables": tables}


def forward(r: Results) -> Section:
    """Angles from torques over short windows."""
    who = ("ours", *PUBLISHED)
    rows = [[n, *(_mean(r.angles[w][n][j], 4) for j in ("both", "joint 1", "joint 2") for w in who)] for n in r.runs]
    columns = ["run", *(f"{j}, {w}" for j in ("both", "joint 1", "joint 2") for w in who)]
    worse = [n for n in r.runs if r.angles["ours"][n]["both"] > min(r.angles[m][n]["both"] for m in PUBLISHED)]
    sentences = [
        "Simulated from the recorded torques; every 0.5 s the simulation begins anew at "
        "the measured angles and rates. Ours are the parameters fitted without that run.",
        "Angles add an error of torque up twice and show errors that "
        "act at low frequency: encoder zeros and friction at rest.",
    ]
    if worse:
        sentences.append(
            f"In {', '.join(worse)} a published model follows better, though its torque is worse there: the "
            "torque of all runs hardly weighs what these angles add up. docs/demos.md says what was tried."
        )
    return {
        "title": "Forward simulation over 0.5 s",
        "sentences": sentences,
        "tables": [{"caption": "Angle RMSE [rad]", "columns": columns, "rows": rows}],
        "figures": [
            {
                "figure": _angle_figure(r),
                "label": "Measured and simulated angle of joint 1 over windows of 0.5 s, run 143339.",
            }
        ],
    }


def differentiation(r: Results) -> Section:
    """Cut-offs by rule on the recordings, and what the choice does on a path that is known."""
    rows = []
    for name, run in r.runs.items():
        for j in (1, 2):
            even = resample(run.raw, 0.002)
            found = [
                cutoff_frequency(run.raw, f"theta{j}", "likelihood"),
                cutoff_frequency(even, f"theta{j}", "residual"),
            ]
            rows.append(
                [f"{name}, joint {j}", *(f"{c.frequency:.3g}" for c in found), *(f"{1e3 * c.noise:.2g}" for c in found)]
            )
    t = r.runs[RUNS[0]].raw.t
    w = np.array([4.8, 9.6, 14.4])
    a = np.array([0.6, 0.25, 0.1])
    made = compare_derivatives(
        t,
        lambda s: np.sin(np.outer(s, w)) @ a,
        lambda s: np.cos(np.outer(s, w)) @ (a * w),
        lambda s: -np.sin(np.outer(s, w)) @ (a * w**2),
        step=ENCODER_STEP,
        methods=COMPARED,
    )  # fmt: skip
    effect = [[_method(m.settings), f"{m.velocity:.3g}", f"{m.acceleration:.3g}"] for m in made]
    return {
        "title": "Velocity and acceleration",
        "sentences": [
            "Angles are Kalman smoothed on their own, jittered time stamps at the most likely cut-off, with velocity "
            "and acceleration.",
            "The noise found is 1.4 to 3.4 times what encoder steps of "
            "0.38 mrad make (0.11 mrad): more than the steps disturbs it.",
        ],
        "tables": [
            {"caption": "Cut-off by rule", "columns": [
                "signal", "likelihood [Hz]", "residual analysis [Hz]", "noise, likelihood [mrad]",
                "noise, residual analysis [mrad]"
            ], "rows": rows},
            {"caption": "Effect of the choice on a known path, same time stamps and encoder step", "columns": [
                "method", "velocity RMSE [rad/s]", "acceleration RMSE [rad/s²]"
            ], "rows": effect},
        ],
    }  # fmt: skip


def _method(settings: Any) -> str:
    cutoff = settings.get("cutoff")
    return settings["method"] + (
        "" if cutoff is None else f", {cutoff}" if isinstance(cutoff, str) else f", {cutoff:g} Hz"
    )


def physical_columns(plain: Fitted, runs: Mapping[str, Run]) -> np.ndarray:
    """Columns (N, 10) of the ten published parameters, from those of b1, b2, b4, b5, Ir and friction by the chain
    rule."""
    names = list(plain.values)
    chain = np.zeros((len(names), len(PHYSICAL)))
    grows = {"b1": {"I1": 1.0, "m2": L1**2}, "b2": {"I2": 1.0}, "b4": {"m1r1": 1.0, "m2": L1}, "b5": {"m2r2": 1.0},
             "Ir": {"Ir": 1.0},
             **{f"Fv{j}": {f"b{j}": 1.0} for j in (1, 2)},
             **{f"Fc{j}": {f"cf{j}": np.pi / 2} for j in (1, 2)}}  # fmt: skip
    for name, parts in grows.items():
        for physical, factor in parts.items():
            chain[names.index(name), PHYSICAL.index(physical)] = factor
    columns = [run.block(plain.law, plain.shape)[0].reshape(-1, len(names)) for run in runs.values()]
    return np.concatenate(columns) @ chain


def _torque_figure(r: Results) -> style.Figure:
    run, fitted = r.runs[DRAWN], r.best[DRAWN].fitted
    t, measured, ours = run.raw.t[EDGE:-EDGE:10], reference_torque(run.raw)[:, ::10], predicted(fitted, run)[:, ::10]
    lines = [(t, measured[j], ours[j], f"torque {j + 1} [N m]") for j in (0, 1)]
    return _two_panels(lines, "predicted")


def _angle_figure(r: Results) -> style.Figure:
    lines = []
    for who in ("ours", PUBLISHED[0]):
        w = r.windows[who]["143339"]
        t, y, s = w.t[:8, ::5], w.measured["theta1"][:8, ::5], w.simulated["theta1"][:8, ::5]
        gap = np.full((len(t), 1), np.nan)
        flat = [np.concatenate([v, gap], axis=1).ravel() for v in (t, y, s)]
        lines.append((flat[0], flat[1], flat[2], f"theta1 [rad], {who}"))
    return _two_panels(lines, "simulated")


def _two_panels(lines: list[tuple[np.ndarray, np.ndarray, np.ndarray, str]], what: str) -> style.Figure:
    data, layout = [], style.layout(420, showlegend=True, hovermode="x")
    for k, (t, measured, made, title) in enumerate(lines):
        axes = {"xaxis": "x", "yaxis": f"y{k + 1}" if k else "y"}
        for values, name, colour in ((measured, "measured", style.MEASURED), (made, what, style.SIMULATED)):
            data.append({"type": "scatter", "mode": "lines", "x": style.numbers(t, 5), "y": style.numbers(values, 4),
                         "name": name,
                         "line": {"color": colour, "width": 1.5}, "showlegend": k == 0, **axes})  # fmt: skip
        layout[f"yaxis{k + 1}" if k else "yaxis"] = style.axis(title, domain=[0.54, 1.0] if k == 0 else [0.0, 0.46])
    layout["xaxis"] = style.axis("time [s]", anchor="y2")
    return {"data": data, "layout": layout}


def _mean(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}f}"


def _gain(mean: float, error: float) -> str:
    return f"{1e3 * mean:.2f} ± {1e3 * error:.2f}"
