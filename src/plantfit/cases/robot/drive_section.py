"""Section of the robot's page on its drive: two such motors along a path, odometry from their counts, wheels fitted
to a camera."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import plantfit.recording as rec
from plantfit.cases.shared.panels import signals_figure
from plantfit.fitting import Answer
from plantfit.recording import Recording
from plantfit.recording.signals.odometry import pose_along
from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.rig.offered import RigRecord, record_rig

TRUE = {"radius_left": 0.0321, "radius_right": 0.0319, "track": 0.142}  # m; a pair of tyres is never alike
RULER = {"radius_left": 0.032, "radius_right": 0.032, "track": 0.14}  # m, as they are read off
OTHER = {"radius 1 % large": {"radius_left": 1.01, "radius_right": 1.01}, "track 1 % large": {"track": 1.01}}
PULSES, RATIO = 500, 43 / 9
SHOWN = 900  # points of a path


class Way(NamedTuple):
    """A pose over time: x, y (m), heading (rad), distance travelled (m), each (N,)."""

    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    distance: np.ndarray


def driven(folder: Path, seed: int = 1) -> tuple[RigRecord, Path]:
    """One drive of the rig, its record and study file written as drive.csv and drive.toml."""
    made = record_rig("robot_drive", TRUE, seed=seed)
    return made, made.save(folder / "drive.csv", study=True, force=True)["study"]


def odometry_of(recording: Recording, wheels: Mapping[str, float]) -> Way:
    """Equations 4 and 7 with a radius for each wheel, from the origin along x; with one radius it is
    `recording.odometry`."""
    turned = [2 * np.pi / PULSES * recording[f"N_{side}"] for side in ("left", "right")]
    left, right = (
        wheels[f"radius_{side}"] * np.diff(angle) for side, angle in zip(("left", "right"), turned, strict=True)
    )
    return Way(*pose_along(left, right, wheels["track"], (0.0, 0.0, 0.0)))


def drive_section(made: RigRecord, answer: Answer) -> dict[str, Any]:
    """The path by odometry with several sets of wheels, the wheels fitted to the camera, and the motors' speeds."""
    r, exact = made.recording, made.exact
    true = Way(*(exact[n] for n in Way._fields))
    fitted = {n: answer.values[n] for n in TRUE}
    sets = {"true wheels": TRUE, "wheels by ruler": RULER, "wheels fitted to the camera": fitted}
    sets |= {
        f"true wheels, {name}": TRUE | {n: factor * TRUE[n] for n, factor in wrong.items()}
        for name, wrong in OTHER.items()
    }
    ways = {name: odometry_of(r, wheels) for name, wheels in sets.items()}
    rows = [_row(name, way, true) for name, way in ways.items()]
    found = []
    for p in answer.findings["parameters"]:
        if p["name"] in TRUE:
            truth = TRUE[p["name"]]
            said = [f"{1e3 * v:.4f}" for v in (p["value"], p["low"], p["high"], truth)]
            found.append([p["name"], "mm", *said, "yes" if p["low"] <= truth <= p["high"] else "no"])
    again = "plantfit rig robot_drive --study " + " ".join(f"--set {n}={v:g}" for n, v in TRUE.items())
    return {
        "title": "Odometry: a drive of two such motors (virtual rig)",
        "sentences": [
            "Both motors have the paper's constants, half of a robot of 1 kg each, a PID in whole counts "
            "of PWM, and an encoder of 500 pulses on the wheel's axis. The robot goes 1 m straight on, "
            "round a circle of 0.5 m radius to the left, 1 m on, and round one to the right, at 1 m/s, "
            "braked by a negative duty. The paper prints neither wheels nor path; these are ours.",
            "Equation 4 makes angles of the counts, 5 and 6 speeds of wheel and motor, 7 the paths of the wheels; the "
            "pose follows by an "
            "arc for each sample.",
            f"By the true wheels counts alone lose {_lost(ways['true wheels'], true)}. By a ruler, radii "
            f"wrong by 0.1 mm and the track by 2 mm, they lose {_lost(ways['wheels by ruler'], true)}. "
            "The same drive seen by a camera (2 mm rms) tells both radii and the track; odometry by "
            f"them loses {_lost(ways['wheels fitted to the camera'], true)}.",
            f"Another drive: `{again}`, with `--excitation` for another path, then `plantfit run robot_drive.toml`.",
        ],
        "tables": [
            {"caption": "Pose by odometry against the true one", "rows": rows,
             "columns": ["odometry with", "error at the end [mm]", "largest error [mm]",
                         "heading, error at the end [deg]", "path [m]"]},
            {"caption": "Wheels and track fitted to the camera (drive.toml)", "rows": found,
             "columns": ["constant", "unit", "value", "95 % from", "to", "truth of the rig", "inside"]},
        ],
        "figures": [
            {"figure": _paths(true, {n: ways[n] for n in list(sets)[1:3]}), "label": "The path: true, and by odometry"},
            {"figure": _speeds(r, exact), "label": "Speed of both motors: set point, from counts in 10 ms (eq. 5, 6), "
                                                   "true"},
        ],
    }  # fmt: skip


def lost(made: RigRecord, answer: Answer) -> dict[str, float]:
    """The largest error (mm) of odometry with the true wheels, with a ruler's and with fitted ones."""
    true, fitted = Way(*(made.exact[n] for n in Way._fields)), {n: answer.values[n] for n in TRUE}
    sets = {"with the true wheels": TRUE, "with wheels by a ruler": RULER, "with wheels fitted to a camera": fitted}
    return {name: float(np.max(_off(odometry_of(made.recording, wheels), true))) for name, wheels in sets.items()}


def _off(way: Way, true: Way) -> np.ndarray:
    return 1e3 * np.hypot(way.x - true.x, way.y - true.y)


def _lost(way: Way, true: Way) -> str:
    return f"{np.max(_off(way, true)):.1f} mm at most"


def _row(name: str, way: Way, true: Way) -> list[str]:
    off = _off(way, true)
    return [
        name,
        f"{off[-1]:.1f}",
        f"{np.max(off):.1f}",
        f"{np.degrees(way.heading[-1] - true.heading[-1]):.2f}",
        f"{way.distance[-1]:.3f}",
    ]


def _paths(true: Way, ways: Mapping[str, Way]) -> Figure:
    data = []
    lines = {
        "true": (true, style.MEASURED, 5.0),
        **{n: (w, style.SERIES[k + 1], 1.6) for k, (n, w) in enumerate(ways.items())},
    }
    for name, (way, colour, width) in lines.items():
        at = np.union1d(envelope(way.x, SHOWN), envelope(way.y, SHOWN))
        line = {
            "type": "scatter",
            "mode": "lines",
            "name": style.plain(name),
            "line": {"color": colour, "width": width},
        }
        data.append(line | {"x": style.numbers(way.x[at], 5), "y": style.numbers(way.y[at], 5)})
    layout = style.layout(460, showlegend=True, hovermode="closest")
    layout["xaxis"], layout["yaxis"] = style.axis("x [m]"), style.axis("y [m]", scaleanchor="x")
    return {"data": data, "layout": layout}


def _speeds(r: Recording, exact: Recording) -> Figure:
    panels = []
    for side in ("left", "right"):
        counted = rec.counts_to_speed(r, f"N_{side}", "w", PULSES, RATIO)["w"]
        lines = {"set point": (exact[f"wanted_{side}"], style.SERIES[2], 1.2),
                 "from counts": (counted, style.MEASURED, 0.8),
                 "true": (exact[f"w_{side}"], style.SIMULATED, 1.6)}  # fmt: skip
        # one legend entry for both panels
        panels.append(
            (f"{side} motor [rad/s]", lines if side == "left" else {f"{n}, right": v for n, v in lines.items()})
        )
    return signals_figure(r.t, panels)
