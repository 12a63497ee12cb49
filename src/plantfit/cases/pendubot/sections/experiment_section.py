"""Section of the pendubot's page: the experiment that would tell most within the bench's limits, beside the paper's."""

from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cases.pendubot.experiment import NAMES, Limits, UprightMoves
from plantfit.estimate import Estimate, InverseDynamics
from plantfit.models.library.pendubot import motor_torque, pendubot_regression
from plantfit.report.figures import style
from plantfit.rig import PendubotRig
from plantfit.rig.trajectories import Move
from plantfit.trust import Gain, d_optimal, gain
from plantfit.trust.verdict.words import number

import jax.numpy as jnp

DRAWN = 20  # every so many samples


def experiment_section(
    rig: PendubotRig | None = None,
    moves: int = 6,
    budget: int = 600,
    seed: int = 1,
    method: str = "cmaes",
    limits: Limits | None = None,
    records: int = 1,
) -> dict[str, Any]:
    """Find `moves` between upright poses that tell most about b1, b2, b4, b5 in the time of `rig`, and compare on the
    rig itself.

    The search simulates the closed loop with the rig's parameters without noise; here they are the truth, on a bench
    those of the first record. Both trajectories then run on the rig with its sensors, and the information is that of
    the true motion. From `records` recordings of each (seeds seed, seed + 1, ...) the coefficients are estimated by
    instrumental variables.
    """
    rig = PendubotRig() if rig is None else rig
    family = UprightMoves(rig, moves, limits or Limits())
    found = d_optimal(family.outcome, None, family.bounds, method=method, budget=budget, seed=seed)
    poses = family.poses(found.design)
    rigs = {"paper's": rig, "D-optimal": _with_poses(rig, poses)}
    runs = {which: _run(r, family) for which, r in rigs.items()}
    told = gain(NAMES, runs["D-optimal"]["information"], runs["paper's"]["information"])
    return {
        "title": "The next experiment (virtual rig)",
        "sentences": [*_sentences(told, found.evaluations, moves, method, rig), _kept(runs["D-optimal"], family)],
        "tables": [
            _errors(rig, runs),
            *([_practised(rigs, range(seed, seed + records))] if records else []),
            _moves(poses),
        ],
        "figures": [
            {
                "figure": _figure(runs),
                "label": "theta1 and voltage over time in the paper's experiment and in the D-optimal one.",
            }
        ],
    }


def _with_poses(rig: PendubotRig, poses: tuple[Move, ...]) -> PendubotRig:
    kept = (
        "parameters",
        "friction",
        "duration",
        "period",
        "counts",
        "voltage_noise",
        "limit",
        "l1",
        "g",
        "substeps",
        "weights",
    )
    return PendubotRig(poses=poses, **{n: getattr(rig, n) for n in kept})


def _run(rig: PendubotRig, family: UprightMoves) -> dict[str, Any]:
    """The true motion of one run on the rig, and its information."""
    exact = rig.record(seed=1).exact
    states = np.stack([exact[n] for n in ("theta1", "theta2", "omega1", "omega2")], axis=1)
    matrix = np.asarray(family.told(jnp.asarray(states), jnp.asarray(exact["V"])))
    return {"t": exact.t, "states": states, "V": exact["V"], "information": matrix}


def _sentences(told: Gain, evaluations: float, moves: int, method: str, rig: PendubotRig) -> list[str]:
    return [
        f"{evaluations:.0f} closed loops of {moves} moves between upright poses in the same {rig.duration:g} s were "
        f"tried by {method}. D-optimal is the one that makes the ellipsoid of all errors together smallest.",
        f"Beside the paper's trajectory on the same rig: {told.sentence}",
        "Errors are those that white noise of the recorded voltage alone would give; noise in the angles adds to both.",
    ]


def _kept(run: dict[str, Any], family: UprightMoves) -> str:
    """How far the run on the rig went towards each limit."""
    limits = family.limits
    x, (low, high) = run["states"], np.degrees(limits.theta1)
    degrees, lean = np.degrees(x[:, 0]), np.degrees(np.abs(x[:, 0] + x[:, 1] - np.pi / 2)).max()
    angles = f"theta1 from {degrees.min():.0f} to {degrees.max():.0f} degrees (limits {low:.0f} and {high:.0f})"
    leaning = f"{lean:.0f} of {np.degrees(limits.lean):.0f} degrees of lean"
    rate = f"{np.abs(x[:, 2]).max():.3g} of {limits.rate:g} rad/s"
    return f"On the rig it uses {np.abs(run['V']).max():.3g} of {family.rig.limit:g} V, {angles}, {leaning} and {rate}."


def _errors(rig: PendubotRig, runs: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Standard errors of each coefficient in both experiments."""
    values = np.array([rig.base[n] for n in NAMES])
    spread = {which: np.sqrt(np.diag(np.linalg.inv(run["information"]))) for which, run in runs.items()}
    old, new = spread.values()
    rows = [
        [n, f"{v:.5g}", f"{100 * a / v:.3g} %", f"{100 * b / v:.3g} %", number(a / b)]
        for n, v, a, b in zip(NAMES, values, old, new, strict=True)
    ]
    columns = ["Coefficient", "Truth", *(f"{which} standard error" for which in runs), "Times smaller"]
    return {"caption": "Standard errors of the two experiments", "columns": columns, "rows": rows}


def _practised(rigs: dict[str, PendubotRig], seeds: range) -> dict[str, Any]:
    """What recordings with encoder steps and noise make of the coefficients: standard errors and errors of every
    estimate."""
    rows = []
    for which, rig in rigs.items():
        values = np.array([rig.base[n] for n in NAMES])
        for seed in seeds:
            e = estimated(rig, seed)
            told = [
                f"{100 * s / v:.2g} ({100 * (x - v) / v:+.2g})"
                for s, x, v in zip(e.standard_error, e.values, values, strict=True)
            ]
            rows.append([which, str(seed), *told])
    caption = "Estimated from the sensors by instrumental variables: standard error (error) in percent"
    return {"caption": caption, "columns": ["Experiment", "Seed", *NAMES], "rows": rows}


def estimated(rig: PendubotRig, seed: int) -> Estimate:
    """b1, b2, b4, b5 of one recording of both joints by instrumental variables (docs/regression.md)."""
    p = rig.parameters
    inverse = InverseDynamics(
        pendubot_regression("base", joints=(1, 2), l1=rig.l1, g=rig.g),
        {f"theta{j}": (f"omega{j}", f"alpha{j}") for j in (1, 2)},
        torques=lambda s: {"tau1": motor_torque(s["V"], s["omega1"], p["kt"], p["ke"], p["Ra"]), "tau2": 0.0},
        held=("V",),
    )
    reference = {"theta1": "theta1_ref", "theta2": "theta2_ref"}
    return inverse.fit(rig.record(seed=seed).recording, simulate=rig.noise_free, reference=reference).estimate


def _moves(poses: tuple[Move, ...]) -> dict[str, Any]:
    rows = [[str(k), f"{m.start:.3f}", f"{m.duration:.3f}", f"{np.degrees(m.to):.2f}"] for k, m in enumerate(poses, 1)]
    return {
        "caption": "The moves found",
        "columns": ["Move", "Start [s]", "Duration [s]", "To theta1 [degrees]"],
        "rows": rows,
    }


def _figure(runs: dict[str, dict[str, Any]]) -> dict[str, Any]:
    traces = []
    for k, (which, run) in enumerate(runs.items()):
        t = style.numbers(run["t"][::DRAWN], 5)
        line = {"color": style.SERIES[k], "width": 1.8}
        base: dict[str, Any] = {
            "type": "scatter",
            "mode": "lines",
            "x": t,
            "name": style.plain(which),
            "legendgroup": which,
            "line": line,
        }
        traces.append(base | {"y": style.numbers(np.degrees(run["states"][::DRAWN, 0]), 5), "yaxis": "y"})
        traces.append(base | {"y": style.numbers(run["V"][::DRAWN], 4), "yaxis": "y2", "showlegend": False})
    layout = style.layout(440, showlegend=True, hovermode="closest")
    layout["xaxis"] = style.axis("t [s]", anchor="y2")
    layout["yaxis"] = style.axis("theta1 [degrees]", domain=[0.54, 1.0])
    layout["yaxis2"] = style.axis("voltage [V]", domain=[0.0, 0.46])
    return {"data": traces, "layout": layout}
