"""A realistic findings record, made in code: a gear motor with two recordings and eight runs."""

from typing import Any

import numpy as np

TRUTH = {"Rm": 2.31, "Kt": 0.0523, "J": 3.2e-5, "Tf": 1e-6, "Ks": 40.0}
UNITS = {"Rm": "ohm", "Kt": "N*m/A", "J": "kg*m**2", "Tf": "N*m", "Ks": "N*m/rad"}


def example(samples: int = 800, seed: int = 3) -> dict[str, Any]:
    """One parameter at its lower bound (Tf), one flat (Ks); validation in both recordings."""
    rng = np.random.default_rng(seed)
    recordings = [_recording("train", samples, 0.7, rng), _recording("check", samples, 0.0, rng)]
    runs = _runs(rng)
    return {
        "name": "gearmotor",
        "verdict": [
            {
                "level": "good",
                "sentence": "The model explains 97.1 % of speed w on data it never saw.",
                "figures": {"fit_percent": 97.1},
            },
            {"level": "good", "sentence": "6 of 8 runs found the same minimum.", "figures": {"runs": 8, "share": 0.75}},
            {
                "level": "warning",
                "sentence": "Tf lies at its lower bound of 1e-06 N*m; its interval is not valid.",
                "figures": {"bound": 1e-6},
            },
            {
                "level": "bad",
                "sentence": "Ks is not determined: the cost changes by less than 0.01 % between its bounds.",
                "figures": {},
            },
            {
                "level": "info",
                "sentence": "The simulation error is 0.3 % of the residual.",
                "figures": {"ratio": 0.003},
            },
        ],
        "recordings": recordings,
        "scores": _scores(recordings),
        "residual_tests": [_test("train", "w", True, rng), _test("train", "i", False, rng)],
        "parameters": _parameters(),
        "combinations": [
            {
                "sentence": "Only the ratio Kt / J is well known: 1 % more Kt with 1 % more J changes nothing.",
                "weights": {"Rm": 0.08, "Kt": 0.72, "J": -0.69, "Tf": 0.0, "Ks": 0.01},
                "relative_sd": 0.14,
            }
        ],
        "runs": runs,
        "basins": [
            {"cost": 0.0412, "runs": 6, "share": 0.75, "parameters": TRUTH},
            {
                "cost": 0.19,
                "runs": 2,
                "share": 0.25,
                "parameters": {name: 1.4 * value for name, value in TRUTH.items()},
            },
        ],
        "simulation": {
            "stepper": "rosenbrock",
            "substeps": 2,
            "outputs": {
                "w": {"unit": "rad/s", "max_error": 0.012, "rms_error": 0.003, "rms_residual": 0.8},
                "i": {"unit": "A", "max_error": 4e-4, "rms_error": 1e-4, "rms_residual": 0.03},
            },
        },
        "reproduction": {
            "spec": 'name = "gearmotor"\n\n[recording.train]\nfile = "gearmotor.csv"\ntime = "t '
            '[ms]"\n\n[search]\nseed = 1\n',
            "seed": 1,
            "versions": {"plantfit": "0.1.0", "jax": "0.10.2", "numpy": "2.4.6", "python": "3.11.9"},
            "cpu": "x86-64, 2 cores",
            "seconds": {"compile": 3.2, "search": 14.8, "trust": 0.41},
            "command": "plantfit run gearmotor.toml",
        },
    }


def _recording(name: str, n: int, fit_share: float, rng: np.random.Generator) -> dict[str, Any]:
    t = np.arange(n) * 0.01
    u = 6 * np.sign(np.sin(2 * np.pi * 0.35 * t)) + 2 * np.sign(np.sin(2 * np.pi * 1.3 * t + 1))
    w = np.zeros(n)
    for k in range(1, n):
        w[k] = w[k - 1] + 0.01 / 0.12 * (18.6 * u[k - 1] - w[k - 1])
    current = (u - 0.0523 * w) / 2.31
    part = ["fit"] * int(fit_share * n) + ["validation"] * (n - int(fit_share * n))
    measured = w + 0.8 * rng.standard_normal(n)
    measured[n // 3 : n // 3 + 10] = np.nan
    known = [None if np.isnan(v) else v for v in measured.tolist()]
    return {
        "name": name,
        "log": [
            f"Read {n} rows from gearmotor.csv.",
            "Resampled to 100 Hz.",
            "Removed 3 outliers of w (over 6 standard deviations).",
        ],
        "t": t.tolist(),
        "inputs": {"u": {"unit": "V", "values": u.tolist()}},
        "outputs": {
            "w": {
                "unit": "rad/s",
                "measured": known,
                "simulated": w.tolist(),
                "part": part,
            },
            "i": {
                "unit": "A",
                "measured": (current + 0.03 * rng.standard_normal(n) + 0.04 * np.sin(9 * t)).tolist(),
                "simulated": current.tolist(),
                "part": part,
            },
        },
    }


def _scores(recordings: list[dict[str, Any]]) -> list[dict[str, Any]]:
    rows = []
    for recording in recordings:
        for name, output in recording["outputs"].items():
            for part in ("fit", "validation"):
                use = np.array(output["part"]) == part
                if not use.any():
                    continue
                y, s = (np.array(output[k], dtype=float)[use] for k in ("measured", "simulated"))
                error = y - s
                rows.append(
                    {
                        "recording": recording["name"],
                        "output": name,
                        "unit": output["unit"],
                        "part": part,
                        "n": int(np.isfinite(error).sum()),
                        "rmse": float(np.sqrt(np.nanmean(error**2))),
                        "bias": float(np.nanmean(error)),
                        "fit_percent": float(
                            100 * (1 - np.sqrt(np.nansum(error**2) / np.nansum((y - np.nanmean(y)) ** 2)))
                        ),
                    }
                )
    return rows


def _test(recording: str, output: str, white: bool, rng: np.random.Generator) -> dict[str, Any]:
    lags = np.arange(0, 31)
    auto = 0.03 * rng.standard_normal(31) + (0 if white else 0.7 * np.exp(-lags / 6))
    auto[0] = 1.0
    around = np.arange(-30, 31)
    return {
        "recording": recording,
        "output": output,
        "lags_s": (0.01 * lags).tolist(),
        "autocorrelation": auto.tolist(),
        "bound": 0.069,
        "white": white,
        "p_value": 0.43 if white else 2.1e-9,
        "cross": {
            "u": {
                "lags_s": (0.01 * around).tolist(),
                "values": (0.03 * rng.standard_normal(61)).tolist(),
                "bound": 0.069,
                "independent": True,
            }
        },
    }


def _parameters() -> list[dict[str, Any]]:
    bounds = {"Rm": (0.5, 10.0), "Kt": (0.01, 0.2), "J": (1e-6, 1e-3), "Tf": (1e-6, 1e-2), "Ks": (1.0, 1000.0)}
    errors = {"Rm": 0.04, "Kt": 0.0061, "J": 3.7e-6, "Tf": None, "Ks": None}
    status = {"Rm": "determined", "Kt": "weak", "J": "determined", "Tf": "at bound", "Ks": "flat"}
    return [
        {
            "name": name,
            "unit": UNITS[name],
            "value": value,
            "standard_error": errors[name],
            "low": None if (e := errors[name]) is None else value - 1.96 * e,
            "high": None if (e := errors[name]) is None else value + 1.96 * e,
            "lower_bound": bounds[name][0],
            "upper_bound": bounds[name][1],
            "scale": "log" if name in ("J", "Tf", "Ks") else "linear",
            "at_bound": "lower" if name == "Tf" else None,
            "status": status[name],
        }
        for name, value in TRUTH.items()
    ]


def _runs(rng: np.random.Generator) -> list[dict[str, Any]]:
    runs = []
    for k in range(8):
        method, run = ("pso", k) if k < 6 else ("lm", k - 6)
        final = 0.19 if k in (2, 7) else 0.0412 * (1 + 1e-4 * k)
        evaluations = np.unique(
            np.geomspace(20 if method == "pso" else 5, 5000 if method == "pso" else 400, 40).astype(int)
        )
        falling = final + (30 * rng.uniform(0.5, 2)) * np.exp(-np.linspace(0, 9, len(evaluations)))
        falling[-1] = final
        spread = {"Rm": 0.01, "Kt": 0.1, "J": 0.1, "Tf": 0.0, "Ks": 2.0}
        runs.append(
            {
                "method": method,
                "run": run,
                "seed": 1000 + k,
                "cost": final,
                "rmse": float(np.sqrt(final)),
                "status": "budget" if method == "pso" else "converged",
                "evaluations": float(evaluations[-1]),
                "seconds": 1.9 if method == "pso" else 0.21,
                "failures": 3 if k == 1 else 0,
                "parameters": {n: v * float(np.exp(spread[n] * rng.standard_normal())) for n, v in TRUTH.items()},
                "history": {
                    "evaluations": evaluations.astype(float).tolist(),
                    "cost": np.minimum.accumulate(falling).tolist(),
                },
            }
        )
    return runs
