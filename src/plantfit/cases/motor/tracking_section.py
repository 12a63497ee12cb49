"""Verified by control: a pendubot follows poses through the identified constants of its motor, wrong ones, and the
true ones."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit.cases.motor.bench import PUBLISHED
from plantfit.cases.shared.panels import signals_figure
from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.rig.pendubot_tracking import PendubotTracking, Tracked

FINE = 100  # times the counts, to see what the encoders' steps do
OFF = 0.3  # of Rm / Kt, in the wrong motors


def tracking_section(identified: Mapping[str, float], truth: Mapping[str, float]) -> dict[str, Any]:
    """Table and figure of the runs; both hold Rm, Lm, Kb, Jm, Cm, Tf and Kt (Kb's value if left out), as
    `models.dc_motor`."""
    identified, truth = ({"Kt": motor["Kb"], **motor} for motor in (identified, truth))
    rig = PendubotTracking()
    motors = {
        "none: torque itself": None,
        "true": truth,
        "identified": identified,
        "published": PUBLISHED,
        f"Rm/Kt {100 * OFF:.0f} % low": truth | {"Rm": (1 - OFF) * truth["Rm"]},
        f"Rm/Kt {100 * OFF:.0f} % high": truth | {"Rm": (1 + OFF) * truth["Rm"]},
    }
    runs = {name: rig.follow(truth, motor) for name, motor in motors.items()}
    errors = [f"{angle} {kind} [deg]" for angle in ("theta1", "theta2") for kind in ("rms", "max")]
    fine = PendubotTracking(counts=FINE * rig.counts).follow(truth, identified)
    columns = ["controller's constants", *errors, "max voltage [V]", "at limit"]
    rows = [_row(name, run) for name, run in runs.items()]
    return {
        "title": "Verified by control (virtual rig)",
        "sentences": [
            "A pendubot with link 2 upright follows three moves of 20 and 40 degrees. An LQR decides on a torque "
            f"every {1000 * rig.period:g} ms, which becomes the voltage V = (Rm/Kt) tau + Kb w by the constants "
            "that it takes for true. The motor has the true ones, with its winding, rotor and friction.",
            f"In the loop: encoders of {rig.counts} counts, an {rig.bits}-bit "
            f"bridge of ±{rig.limit:.4g} V, speeds by a Kalman filter.",
            _compared(runs),
            f"At rest the voltage plays by {_play(rig, runs['identified']):.2f} V rms, "
            "because a step of an encoder is a jump of the speeds that the filter "
            f"takes from it; encoders {FINE} times finer leave {_play(rig, fine):.2f} V.",
        ],
        "tables": [{"caption": f"Tracking error of both angles over {rig.duration:g} s", "columns": columns,
                    "rows": rows}],
        "figures": [
            {"figure": _tracked(rig, runs["identified"], truth["Kt"]),
             "label": "Both joints and their references, torque of the motor and "
             "voltage, with the identified constants (the paper's figures 17 and 18)"},
            {"figure": _figure(rig, runs), "label": "Error of theta1 with each set of constants"},
        ],
    }  # fmt: skip


def _play(rig: PendubotTracking, tracked: Tracked) -> float:
    """Standard deviation of the voltage after the last move, V."""
    return float(np.std(np.asarray(tracked.run.u["V"])[rig.t > rig.moves[-1].end + 0.5]))


def _tracked(rig: PendubotTracking, tracked: Tracked, constant: float) -> Figure:
    states = tracked.run.states
    panels = []
    for k, joint in enumerate(("theta1", "theta2")):
        wanted, had = np.degrees(tracked.wanted[:, k]), np.degrees(np.asarray(states[joint]))
        panels.append(
            (
                f"{joint} [deg]",
                {f"{joint}, reference": (wanted, style.MEASURED, 3.0), joint: (had, style.SIMULATED, 1.2)},
            )
        )
    panels.append(("torque [N m]", {"torque": (constant * np.asarray(states["i"]), style.SERIES[1], 1.2)}))
    panels.append(("voltage [V]", {"voltage": (np.asarray(tracked.run.u["V"]), style.INPUT, 1.0)}))
    return signals_figure(rig.t, panels)


def _compared(runs: Mapping[str, Tracked]) -> str:
    """What the runs say about the constants."""
    rms = {name: np.degrees(run.rms[0]) for name, run in runs.items()}
    wrong = [name for name in runs if "Rm/Kt" in name]
    said = (
        f"With the identified constants theta1 strays by {rms['identified']:.2f} "
        f"degrees rms, with the true ones by {rms['true']:.2f}; "
    )
    said += f"Rm/Kt wrong by {100 * OFF:.0f} % makes it {' and '.join(f'{rms[name]:.2f}' for name in wrong)}. "
    fastest = np.max(np.abs(np.asarray(runs["true"].run.states["omega1"])))
    return said + (
        f"The published pair, whose Kb is 15 times too low, gives {rms['published']:.2f}: at "
        f"{fastest:.2g} rad/s at most the back-EMF is too small for this test to judge Kb."
    )


def _row(name: str, tracked: Tracked) -> list[str]:
    if tracked.fell:
        return [name, "fell", "", "", "", "", ""]
    (a, b), (c, d) = np.degrees(tracked.rms), np.degrees(tracked.largest)
    volts = (
        [f"{np.max(np.abs(tracked.run.u['V'])):.2f}", f"{100 * tracked.at_limit:.1f} %"]
        if "V" in tracked.run.u
        else ["", ""]
    )
    return [name, f"{a:.3f}", f"{c:.2f}", f"{b:.3f}", f"{d:.2f}", *volts]


def _figure(rig: PendubotTracking, runs: Mapping[str, Tracked]) -> Figure:
    data = []
    for k, (name, tracked) in enumerate(runs.items()):
        if tracked.fell:
            continue
        line = {"color": (*style.SERIES, style.INK, style.MUTED)[k], "width": 1.4}
        values = np.degrees(np.asarray(tracked.run.states["theta1"]) - tracked.wanted[:, 0])
        at = envelope(values, 600)
        points = {"x": style.numbers(rig.t[at]), "y": style.numbers(values[at]), "line": line}
        data.append({"type": "scatter", "mode": "lines", "name": style.plain(name), **points})
    layout = style.layout(300, showlegend=True)
    layout["xaxis"], layout["yaxis"] = style.axis("time [s]"), style.axis("error of theta1 [deg]")
    return {"data": data, "layout": layout}
