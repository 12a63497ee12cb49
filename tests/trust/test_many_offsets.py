"""Of more than 60 coordinates: an offset near zero has the interval of its closed form, and one that nothing tells
is open."""

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, fit
from plantfit.models import equations

RECORDS, SAMPLES, NOISE = 70, 40, 0.1


def _fitted():
    """70 records of y = a u + c s with an offset c of each, 0 in truth; the last five have s = 0."""
    rng, records = np.random.default_rng(5), {}
    for k in range(RECORDS):
        u, s = rng.normal(size=SAMPLES), np.full(SAMPLES, float(k < RECORDS - 5))
        y = 2.0 * u + NOISE * rng.normal(size=SAMPLES)
        records[f"r{k}"] = Recording(
            np.arange(SAMPLES), {n: Signal(v, None) for n, v in {"u": u, "s": s, "y": y}.items()}, f"r{k}"
        )
    bounds = {"a": (0.0, 5.0), "c": (-1.0, 1.0)}
    model = equations(
        "y = a*u + c*s", inputs=["u", "s"], outputs=["y"], parameters={n: {"bounds": b} for n, b in bounds.items()}
    )
    problem = Problem(model, records, {"a": Parameter((0.0, 5.0)), "c": Parameter((-1.0, 1.0), per_recording=True)})
    rows = fit(problem, "least_squares", seed=1, budget=600).findings["parameters"]
    return [r for r in rows if r["parameter"] == "c"]


@pytest.mark.thorough
def test_offsets_near_zero_have_the_interval_of_the_closed_form():
    rows = _fitted()
    told, dark = rows[: RECORDS - 5], rows[RECORDS - 5 :]
    half = np.array([0.5 * (r["high"] - r["low"]) for r in told])
    assert np.all(np.abs(half / (1.96 * NOISE / np.sqrt(SAMPLES)) - 1) < 0.6)  # noise of each record is its own
    assert all(r["status"] in ("weak", "determined") and r["open"] is None for r in told)
    assert np.mean([r["low"] < 0 < r["high"] for r in told]) > 0.85
    assert all(r["status"] not in ("weak", "determined") for r in dark)
