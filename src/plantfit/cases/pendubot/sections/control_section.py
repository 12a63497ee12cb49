"""The identified pendubot held upright by four controllers: how far each catches it, and how."""

from collections.abc import Mapping
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control import (
    Caught,
    Design,
    equilibrium,
    kalman_observer,
    largest_initial_angle,
    linearised,
    lqr,
    mpc,
    pid_per_output,
    takagi_sugeno,
)
from plantfit.models.library.pendubot import pendubot
from plantfit.models.model import Model
from plantfit.report.figures.strobe import Panel, strobe_figure
from plantfit.simulate.loop.closed_loop import ClosedLoop
from plantfit.simulate.loop.sensors import Actuator, Sensor

PERIOD, COUNTS, LIMIT = 1e-3, 10_000, 24.0  # s, per revolution, V
UPRIGHT = {"theta1": np.pi / 2, "theta2": 0.0}
MOTOR = {"kt": 0.0724, "ke": 0.0724, "Ra": 2.983}
L1, L2 = 0.15, 0.3  # m
WANDER = {"omega1": 0.3, "omega2": 0.3}  # rad/s in a second, what the filter takes for granted
Q, R = {"theta1": 1.0, "theta2": 1.0}, {"V": 0.1}
LEAN = np.radians(30.0)  # of the outer rules
OFF = 0.03  # of every parameter of the links
FASTER = 1.1
WAYS = {
    "PID": "one for each angle, integral on theta1; the plant's poles mirrored to the left and 10 % faster, and -0.5/s",
    "Takagi-Sugeno": "regulators at theta1 = 60, 90 and 120 degrees with link 2 upright, blended by theta1",
    "LQR": "weights 1/rad^2 on both angles and 0.1/V^2",
    "MPC": "the same weights, 40 moves of 10 ms within ±24 V",
}


def controllers(model: Model, values: Mapping[str, float]) -> dict[str, Design]:
    """Four designs for the upright by name; `values` are of `pendubot(drive="voltage")`, physical or base."""
    noise = 2 * np.pi / COUNTS / np.sqrt(12.0)
    limits = (-LIMIT, LIMIT)
    leaning = [{"theta1": np.pi / 2 + lean, "theta2": -lean} for lean in (-LEAN, 0.0, LEAN)]
    plants = [linearised(model, values, *equilibrium(model, values, pose, fixed=["theta1"])) for pose in leaning]
    filters = [kalman_observer(plant, PERIOD, WANDER, noise) for plant in plants]
    upright, estimator = plants[1], filters[1]
    mirrored = -FASTER * np.abs(np.linalg.eigvals(upright.A).real)
    return {
        "PID": pid_per_output(upright, PERIOD, [*mirrored, -0.5], integral="theta1", filter_time=2e-3, limits=limits),
        "Takagi-Sugeno": takagi_sugeno(
            plants, PERIOD, Q, R, premise="theta1", hold=1, estimators=filters, limits=limits
        ),
        "LQR": lqr(upright, PERIOD, Q, R, estimator=estimator, limits=limits),
        "MPC": mpc(upright, PERIOD, Q, R, limits=limits, horizon=40, hold=10, steps=12, estimator=estimator),
    }


def closed(design: Design, model: Model) -> ClosedLoop:
    """The loop with the rig's encoders and amplifier."""
    sensor, actuator = Sensor(quantum=2 * np.pi / COUNTS), Actuator(-LIMIT, LIMIT)
    return design.close(model, sensor=sensor, actuator=actuator, stepper="rk4", substeps=1)


def caught(loop: ClosedLoop, design: Design, plant: Mapping[str, float]) -> Caught:
    """How far link 1 may lean (rad) with both links in line and at rest, and still be brought upright."""
    return largest_initial_angle(
        loop,
        design.parameters,
        plant,
        UPRIGHT,
        {"theta1": 1.0},
        largest=np.radians(25.0),
        resolution=np.radians(0.1),
        seconds=3.0,
    )


def control_section(
    values: Mapping[str, float], truth: Mapping[str, float] | None = None, start: float = np.radians(8.0)
) -> dict[str, Any]:
    """A section of a case page: designs on the identified `values`, run on the plant `truth` (the same if left out).

    Both hold m1, m2, lc1, lc2, I1, I2 or b1, b2, b4, b5 (SI), and the motor's kt, ke, Ra where they differ from the
    paper's. `start` (rad) is the lean from which the motions of the figure begin.
    """
    designs = controllers(_model(values), MOTOR | dict(values))
    plant = MOTOR | dict(values if truth is None else truth)
    model = _model(plant)
    rows, runs, steps = [], {}, []
    for name, design in designs.items():
        loop = closed(design, model)
        best = caught(loop, design, plant)
        worst = [caught(loop, design, other) for other in _off(plant)]
        runs[name] = loop.simulate(
            design.parameters, plant, {}, samples=3000, x0=UPRIGHT | {"theta1": np.pi / 2 + start}
        )
        tail = np.asarray(runs[name].u["V"])[-1000:]
        ways = [best.low, best.high, min(w.low for w in worst), min(w.high for w in worst)]
        rows.append([name, WAYS[name], *(f"{np.degrees(w):.1f}" for w in ways), f"{np.sqrt(np.mean(tail**2)):.2f}"])
        steps.append(max(c.resolution for c in (best, *worst)))
    out = np.degrees(np.max(np.abs(np.asarray(runs["LQR"].states["theta1"]) - np.pi / 2)))
    off = f"{100 * OFF:g} % off"
    least = min(float(row[k]) for row in rows for k in (2, 3))
    return {
        "title": "Held upright (virtual rig)",
        "sentences": [
            "Four controllers, designed on the identified plant, hold the upright on "
            f"{'that plant' if truth is None else 'the virtual rig, which has the true parameters'}, with encoders of "
            f"{COUNTS} counts, one voltage every {1000 * PERIOD:g} ms and an amplifier of ±{LIMIT:g} V in the loop.",
            f"Each catches both links in line and at rest that lean at least {least:.1f} degrees to either side.",
            f"From {np.degrees(start):.0f} degrees link 1 swings out to {out:.0f} "
            "degrees on its way under link 2, where a linear design fits less and less.",
            f"The last two angles are those on a worse plant: all parameters of the links {off}, up and down in turn.",
        ],
        "tables": [
            {
                "caption": f"Largest lean of link 1 that is caught, in degrees (found to {np.degrees(max(steps)):.2f} "
                f"degrees), and the "
                "voltage once at rest",
                "columns": ["controller", "design", "to -", "to +", f"to -, {off}", f"to +, {off}", "V rms at rest"],
                "rows": rows,
            }
        ],
        "figures": [_figure(runs, start)],
    }


def _figure(runs: Mapping[str, Any], start: float) -> dict[str, Any]:
    shown = runs["LQR"]
    theta1, theta2 = np.asarray(shown.states["theta1"]), np.asarray(shown.states["theta2"])
    panels = [
        Panel(
            "theta1 from the upright [deg]",
            {n: np.degrees(np.asarray(r.states["theta1"]) - np.pi / 2) for n, r in runs.items()},
        ),
        Panel("theta2 [deg]", {n: np.degrees(np.asarray(r.states["theta2"])) for n, r in runs.items()}),
        Panel("voltage [V]", {n: np.asarray(r.u["V"]) for n, r in runs.items()}),
    ]
    at = [0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.2]
    figure = strobe_figure(np.asarray(shown.t), arm(theta1, theta2), at, panels, "LQR, 0 to 1.2 s")
    lean = f"{np.degrees(start):.0f} degrees"
    return {
        "figure": figure,
        "label": f"The arm caught by LQR from a lean of {lean}, at ten times; angles and voltage of all four over time",
    }


def arm(theta1: np.ndarray, theta2: np.ndarray) -> np.ndarray:
    """Base, elbow and tip (N, 3, 2) in m, theta1 from the horizontal."""
    elbow = L1 * np.stack([np.cos(theta1), np.sin(theta1)], axis=-1)
    tip = elbow + L2 * np.stack([np.cos(theta1 + theta2), np.sin(theta1 + theta2)], axis=-1)
    return np.stack([np.zeros_like(elbow), elbow, tip], axis=1)


def _model(values: Mapping[str, float]) -> Model:
    return pendubot("base" if "b1" in values else "physical", drive="voltage")


def _off(plant: Mapping[str, float]) -> list[dict[str, float]]:
    """Two plants around this one: every parameter of the links up and down in turn, and the other way round."""
    links = [n for n in plant if n not in MOTOR]
    return [
        dict(plant) | {n: plant[n] * (1.0 + OFF * sign * (-1) ** k) for k, n in enumerate(links)} for sign in (1, -1)
    ]
