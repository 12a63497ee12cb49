"""The yardstick of the data set: its filter, its published parameters, and their torque error."""

import tomllib
from importlib.resources import files
from pathlib import Path

import numpy as np
from scipy.signal import butter, filtfilt

import plantfit.recording as rec
from plantfit.models.library.pendubot import pendubot_regression
from plantfit.models.library.regression import LinearModel

RUNS = ("143339", "143601", "143747", "144115", "154220")
L1, GEAR = 0.2, 6.0
PUBLISHED = ("model_1.0", "model_2.0")
CUTOFF_SHARE = 0.02  # of half the sampling rate: 5 Hz at 500 Hz
EDGE = 50  # samples dropped at both ends
JOINTS = (1, 2)


def read_runs(folder: Path, runs: tuple[str, ...] = RUNS) -> dict[str, rec.Recording]:
    """The recordings on their own time stamps: theta1, theta2, speed1, speed2 (of the drive), tau1, tau2."""
    columns = {"theta": ("pos_meas", "rad"), "speed": ("vel_meas", "rad/s"), "tau": ("tau_meas", "N*m")}
    signals = {f"{n}{j}": f"{column}{j}" for n, (column, _) in columns.items() for j in JOINTS}
    units = {f"{n}{j}": unit for n, (_, unit) in columns.items() for j in JOINTS}
    return {
        run: rec.read_csv(
            folder / f"run_{run}.csv.gz", time="time", time_unit="s", signals=signals, units=units, name=f"run_{run}"
        )
        for run in runs
    }


def law_model(friction: tuple[str, ...], sign: str = "atan", **shape: float) -> LinearModel:
    """Torque of both joints by base parameters, rotor inertia and a friction law."""
    return pendubot_regression("base", "hanging", (1, 2), friction, GEAR, l1=L1, sign=sign, **shape)  # pyrefly: ignore[bad-argument-type]


def published(name: str) -> dict[str, float]:
    """Published parameters as base parameters: b1 = I1 + m2 l1^2 and so on; its friction cf atan(100 omega) has Fc =
    cf pi/2."""
    p = tomllib.loads(files("plantfit.cases.double_pendulum").joinpath("published.toml").read_text())[name]
    return {
        "b1": p["I1"] + p["m2"] * L1**2,
        "b2": p["I2"],
        "b4": p["m1"] * p["r1"] + p["m2"] * L1,
        "b5": p["m2"] * p["r2"],
        "Ir": p["Ir"],
        **{f"Fv{j}": p[f"b{j}"] for j in JOINTS},
        **{f"Fc{j}": p[f"cf{j}"] * np.pi / 2 for j in JOINTS},
    }


def filtered(values: np.ndarray) -> np.ndarray:
    """Third-order Butterworth, forwards and backwards, sample by sample as the source does it."""
    b, a = butter(3, CUTOFF_SHARE)
    return filtfilt(b, a, values)


def reference_torque(run: rec.Recording) -> np.ndarray:
    """Filtered measured torque of both joints (2, n), `EDGE` samples dropped at both ends."""
    return np.stack([filtered(run[f"tau{j}"])[EDGE:-EDGE] for j in JOINTS])


def reference_prediction(run: rec.Recording, values: dict[str, float]) -> np.ndarray:
    """Torque of both joints (2, n) as the source computes it: from velocity and acceleration that were filtered
    before."""
    signals = {}
    for j in JOINTS:
        signals[f"theta{j}"] = run[f"theta{j}"]
        signals[f"omega{j}"] = filtered(run[f"speed{j}"])
        signals[f"alpha{j}"] = filtered(np.gradient(filtered(np.gradient(run[f"theta{j}"], run.t)), run.t))
    kept = {n: v[EDGE:-EDGE] for n, v in signals.items()}
    model = law_model(("viscous", "coulomb"))
    return np.stack([model.predict(kept, values, f"tau{j}") for j in JOINTS])
