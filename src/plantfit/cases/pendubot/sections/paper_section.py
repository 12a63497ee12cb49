"""The paper's study as sections of the page: its tables and figures with our numbers, its legible ones beside them,
and the gaps."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.cases.pendubot.published import ERRATA, PUBLISHED
from plantfit.cases.pendubot.sections.paper_figures import (
    ZOOM,
    bars_figure,
    gap_figure,
    overlay_figure,
    parameters_figure,
    residual_figure,
    signals_figure,
    trajectory_figure,
)
from plantfit.cases.pendubot.sections.pose_figures import poses_figure, scheme_figure
from plantfit.cases.pendubot.study_runs import CLOSE, Floor, MethodRuns
from plantfit.cases.pendubot.torque import TorqueRecord
from plantfit.problem import Problem
from plantfit.study.comparing.statistics import summarise
from plantfit.trust.verdict.words import some

UNITS = {"m1": "kg", "m2": "kg", "lc1": "m", "lc2": "m", "I1": "kg m^2", "I2": "kg m^2"}
BUDGET_AND_PAPER = (
    "PSO, CGA, SSA: 50 members, 200 iterations (ours, the paper prints neither). The paper's means lie 0.34 % (SSA) "
    "and 3.2 % (CGA) "
    "above its best."
)
Section = dict[str, Any]


def record_section(record: TorqueRecord, floor: Floor) -> Section:
    """What was recorded, how it became signals, and the optimum."""
    run = record.run
    rates = {n: float(np.sqrt(np.mean((record.recording[n] - run.exact[n]) ** 2))) for n in ("omega1", "omega2")}
    cut = (
        f"{record.rule} Both angles pass it; rates and accelerations are central differences, off by "
        f"{rates['omega1']:.2g} and "
        f"{rates['omega2']:.2g} rad/s rms. The torque is that of the recorded voltage, not filtered, as in the paper."
    )
    sentences = [
        "Nothing here was measured on a machine: a virtual rig with the paper's motor, encoders, sampling and "
        "trajectory made the record.",
        "The paper gives no controller. Ours is an LQG whose observer trusts the encoders until the torque chatters as "
        "much as the paper's "
        "residual, 0.015 N m: that the least RMSE is near the paper's is so by construction.",
        cut,
        *floor.sentences,
        _truth(record, floor),
    ]
    constants = run.truth["constants"]
    poses = poses_figure(run.recording, run.truth["base"], constants["l1"], constants["g"])
    figures = [
        {"figure": scheme_figure(run.truth["parameters"]), "label": "The links and their names (paper's figure 1)"},
        {
            "figure": poses,
            "label": "The three poses (figure 3), the reference of the angles, and the flat output (equation 16)",
        },
        {"figure": trajectory_figure(run.recording), "label": "Angles of the virtual rig and their references"},
        {
            "figure": signals_figure(record.recording),
            "label": "Angles, rates, accelerations and torque of the virtual rig (figure 4)",
        },
    ]
    return {"title": "Virtual rig: the record of the paper's study", "sentences": sentences, "figures": figures}


def _truth(record: TorqueRecord, floor: Floor) -> str:
    truth = record.run.truth["parameters"]
    apart = max(floor.values, key=lambda n: abs(floor.values[n] / truth[n] - 1.0))
    return (
        f"The optimum is not the truth: {apart} is {floor.values[apart]:.3g} {UNITS[apart]} there and "
        f"{truth[apart]:.3g} on the rig, "
        "because this torque hardly shows link 2, which stays upright, and the smoothed motion has errors of its own."
    )


def results_section(record: TorqueRecord, problem: Problem, floor: Floor, runs: Sequence[MethodRuns]) -> Section:
    """Tables 2 to 4 and figures 5 to 7."""
    model, truth = problem.model, record.run.truth["parameters"]
    torques = {r.label: problem.predict(r.answers[r.best])["tau1"] for r in runs}
    torques["theoretical"] = problem.predict(np.array([truth[n] for n in problem.space.names]))["tau1"]
    rmse = {r.label: r.rmse for r in runs}
    figures = [
        {
            "figure": overlay_figure(record.recording, torques),
            "label": f"Torque of the virtual rig and of the best runs ({model.name})",
        },
        {
            "figure": overlay_figure(record.recording, torques, ZOOM),
            "label": "The same from 5 to 6.6 s (paper's figure 5); theoretical: by the "
            "parameters measured before assembly, which are the rig's",
        },
        {
            "figure": residual_figure(record.recording, torques, "theoretical", ZOOM),
            "label": "From 5 to 6.6 s: what the theoretical torque leaves of the measured one, and how far the best "
            "runs are from it",
        },
        {
            "figure": bars_figure("mean time of a run [s]", {r.label: r.seconds for r in runs}),
            "label": "Time of a run (figure 6)",
        },
        {"figure": bars_figure("mean RMSE [N m]", rmse), "label": "RMSE with 95 % intervals, virtual rig (figure 7)"},
        {
            "figure": parameters_figure(runs, problem.space, truth),
            "label": "Answers of the runs (250 of a method at most) between their bounds, the best of each method, and "
            "the truth",
        },
    ]
    tables = [_best_table(problem, floor, runs, truth), _rmse_table(runs), _time_table(runs)]
    return {
        "title": "Virtual rig: tables 2 to 4 and figures 5 to 7",
        "sentences": _told(runs),
        "tables": tables,
        "figures": figures,
    }


def _told(runs: Sequence[MethodRuns]) -> list[str]:
    total = sum(r.total_seconds for r in runs)
    wide = max(runs, key=lambda r: float(np.mean(np.ptp(r.answers, axis=0))))
    spread = float(np.median(np.std(wide.answers, axis=0) / np.mean(wide.answers, axis=0)))
    return [
        f"{sum(len(r.gap) for r in runs)} runs took {total:.0f} s in "
        "all, compilation included; the paper's took about 900 s each.",
        f"The RMSE of all runs of {wide.label} agree to {np.ptp(wide.rmse) / wide.rmse.min():.1g}, "
        f"their parameters differ by {100 * spread:.0f} % (median standard deviation): a small "
        "spread of the RMSE says nothing about the parameters.",
    ]


def _best_table(
    problem: Problem, floor: Floor, runs: Sequence[MethodRuns], truth: Mapping[str, float]
) -> dict[str, Any]:
    rows = [
        [
            f"{n} [{UNITS[n]}]",
            *(f"{r.answers[r.best][k]:.4g}" for r in runs),
            f"{floor.values[n]:.4g}",
            f"{truth[n]:.4g}",
        ]
        for k, n in enumerate(problem.space.names)
    ]
    rows.append(["RMSE [N m]", *(f"{r.rmse[r.best]:.9f}" for r in runs), f"{floor.rmse:.9f}", _rmse_at(problem, truth)])
    return {
        "caption": "Table 2: parameters of the best run of each method, virtual rig",
        "columns": ["parameter", *(r.label for r in runs), "optimum", "truth of the rig"],
        "rows": rows,
    }


def _rmse_at(problem: Problem, truth: Mapping[str, float]) -> str:
    z = problem.space.cube([truth[n] for n in problem.space.names])
    return f"{float(np.sqrt(problem.costs(z[None, :])[0])):.9f}"


def _rmse_table(runs: Sequence[MethodRuns]) -> dict[str, Any]:
    rows = []
    for r in runs:
        s, paper = summarise(r.rmse), PUBLISHED.get(r.name, {})
        low, high = s.normal_interval
        said = [f"{paper[k]:.9g}" if k in paper else "" for k in ("rmse_min", "rmse_mean", "rmse_std")]
        ours = [f"{v:.9f}" for v in (s.minimum, s.mean)] + [f"{v:.2e}" for v in (s.std, s.sem)]
        rows.append([r.label, *ours, f"{low:.9f} to {high:.9f}", *said])
    return {
        "caption": "Table 3: RMSE in N m, virtual rig, beside what is legible of the paper's",
        "columns": [
            "method",
            "min",
            "mean",
            "std",
            "SEM",
            "95 % interval of the mean",
            "paper: min",
            "paper: mean",
            "paper: std",
        ],
        "rows": rows,
        "note": f"Runs: {some([f'{r.label} {len(r.rmse)}' for r in runs])}. 95 % interval: mean ± 1.96 SEM (standard "
        "error of the mean), as in the paper. The records differ, so that the levels cannot be compared; ours was made "
        "to be near the paper's.",
    }


def _time_table(runs: Sequence[MethodRuns]) -> dict[str, Any]:
    rows = []
    for r in runs:
        s, paper = summarise(r.seconds), PUBLISHED.get(r.name, {})
        low, high = s.normal_interval
        said = [f"{paper[k]:.4f}" if k in paper else "" for k in ("time_mean", "time_std")]
        interval = f"{low:.3g} to {high:.3g}" if s.n > 1 else ""
        rows.append([r.label, *(f"{v:.3g}" for v in (s.minimum, s.mean, s.std, s.sem)), interval, *said])
    return {
        "caption": "Table 4: seconds a run, ours beside the paper's",
        "columns": ["method", "min", "mean", "std", "SEM", "95 % interval of the mean", "paper: mean", "paper: std"],
        "rows": rows,
        "note": "Runs are searched side by side and share out the time of their chunk; compilation, before the first, "
        "is not counted.",
    }


def gap_section(
    runs: Sequence[MethodRuns],
    told: Sequence[str],
    title: str = "Virtual rig: how far from the optimum, and why",
    record: str = "virtual rig",
    note: str = BUDGET_AND_PAPER,
) -> Section:
    """How far every run on a `record` ends above the optimum, and why."""
    rows = []
    for r in runs:
        share, (low, high) = r.share_close
        quantiles = [f"{v:.1e}" if v > 1e-12 else "< 1e-12" for v in np.quantile(r.gap, [0.5, 0.99, 1.0])]
        rows.append(
            [r.label, str(len(r.gap)), *quantiles, f"{100 * share:.1f} %", f"{100 * low:.1f} to {100 * high:.1f} %"]
        )
    table = {
        "caption": f"Gap of the RMSE to the constrained optimum, relative, {record}",
        "columns": [
            "method",
            "runs",
            "median",
            "99 % quantile",
            "largest",
            f"below {CLOSE:g}",
            "95 % interval of the share",
        ],
        "rows": rows,
        "note": note,
    }
    figure = {"figure": gap_figure(runs), "label": f"Gap of every run to the optimum, sorted, {record}"}
    return {"title": title, "sentences": list(told), "tables": [table], "figures": [figure]}


def errata_section() -> Section:
    """What is misprinted in the paper."""
    table = {
        "caption": "Misprints of the paper and what was used here",
        "columns": ["where", "printed", "used here", "why"],
        "rows": [list(row) for row in ERRATA],
    }
    return {"title": "Errata of the paper", "sentences": [], "tables": [table]}
