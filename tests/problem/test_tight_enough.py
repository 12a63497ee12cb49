"""Where the simulation and the tight solver differ, either may be off: the tight one is asked again with tighter
tolerances.

The published model of T cells (Crauste et al., Cell Systems 4 (2017) 306, as in the collection of PEtab) follows an
unstable course: errors of LSODA with rtol 1e-9 grow to 2 % of an output's range, which DOP853 (rtol 1e-13) and Radau
(1e-12) agree on to 1e-9.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plantfit import spec
from plantfit.models import equations
from plantfit.problem import Problem, checked_cost
from plantfit.problem.accuracy import verification
from plantfit.recording.record import Recording, Signal
from plantfit.simulate.simulator import ADAPTIVE, Simulator

STUDY = Path(__file__).parents[2] / "benchmarks" / "published_odes" / "studies" / "crauste.toml"
# where a fit of ours ended
VALUES = {
    "delta_EL": 0.3172501181084752, "delta_LM": 0.05353754629992298, "delta_NE": 1.4521301356997174e-05,
    "mu_EE": 8.827940169186593e-05,
    "mu_LE": 1.9953300389634984e-06, "mu_LL": 5.4882272150073645e-06, "mu_N": 0.7234126283319495,
    "mu_P": 0.13577611537534554,
    "mu_PE": 1.0000817362529829e-10, "mu_PL": 6.0059329074132956e-05, "rho_E": 1.2489056373814955,
    "rho_P": 0.20822481778505653,
}  # fmt: skip
SCALES = {"EarlyEffector": 2494.2, "LateEffector": 1513.1, "Memory": 7676.7, "Naive": 23.541}


def at(fineness):
    """The problem with adaptive steps, and the cube point of `VALUES`."""
    problem = spec.load(str(STUDY)).problem.with_scales({f"y_observable_{o}": s for o, s in SCALES.items()})
    own = problem.predictor.stepping()
    problem = problem.with_simulator(Simulator(own.vector, ADAPTIVE, fineness, own.interpolated))
    return problem, np.asarray(problem.space.cube(problem.space.vector(VALUES)))


def true_cost(problem):
    """By the equations of the paper and DOP853."""
    p, recording = VALUES, problem.experiments["model1_data1"].recording

    def rate(t, x):
        n, e, late, _, g = x
        return [
            -n * p["mu_N"] - n * g * p["delta_NE"],
            n * g * p["delta_NE"] + e * g * p["rho_E"] - e * e * p["mu_EE"] - e * p["delta_EL"],
            e * p["delta_EL"] - late * late * p["mu_LL"] - e * late * p["mu_LE"] - late * p["delta_LM"],
            late * p["delta_LM"],
            g * g * p["rho_P"] - e * g * p["mu_PE"] - late * g * p["mu_PL"] - g * p["mu_P"],
        ]

    found = solve_ivp(
        rate, (0.0, recording.t[-1]), [8090.0, 0, 0, 0, 1.0], "DOP853", t_eval=recording.t, rtol=1e-13, atol=1e-14
    ).y
    seen: dict[str, Any] = dict(zip(("Naive", "EarlyEffector", "LateEffector", "Memory"), found, strict=False))
    rows = [(seen[o] - recording[f"y_observable_{o}"]) / scale for o, scale in SCALES.items()]
    r = np.concatenate(rows)
    return float(np.mean(r[np.isfinite(r)] ** 2))


@pytest.mark.thorough
def test_an_exact_simulation_is_confirmed_where_the_tight_solver_alone_is_off():
    problem, z = at(256)
    true = true_cost(problem)
    alone = verification._checked(problem, z, np.asarray(problem.residuals(z)), 10**7, None, 1.0)
    assert alone.cost_reported == pytest.approx(true, rel=1e-4)
    assert abs(alone.cost_checked / true - 1.0) > 0.02
    told = checked_cost(problem, z)
    assert told.confirmed
    assert told.cost_checked == pytest.approx(true, rel=1e-3)
    error = verification.error_of(problem, z, "model1_data1")
    assert error.checked_with == "scipy LSODA, rtol 1e-11"
    assert error.rms_error["y_observable_LateEffector"] < 0.01 * SCALES["LateEffector"]


@pytest.mark.thorough
def test_a_simulation_that_is_off_is_still_told():
    problem, z = at(32)
    true = true_cost(problem)
    told = checked_cost(problem, z)
    assert told.cost_checked == pytest.approx(true, rel=1e-3)
    assert told.off == pytest.approx(abs(told.cost_reported / true - 1.0), rel=0.01)
    assert told.off > 0.5
    assert not told.confirmed
    assert (
        verification.error_of(problem, z, "model1_data1").rms_error["y_observable_LateEffector"]
        > SCALES["LateEffector"]
    )


def test_what_agrees_is_not_solved_twice(monkeypatch):
    asked = []
    before = verification.follow
    monkeypatch.setattr(verification, "follow", lambda *a, **k: asked.append(k["rtol"]) or before(*a, **k))
    t = np.linspace(0.0, 5.0, 40)
    parameters = {"tau": {"bounds": (0.5, 2.0), "unit": "s"}}
    model = equations(
        "x' = (1 - x)/tau\ny = x", inputs=[], states={"x": {"initial": 0.0}}, outputs=["y"], parameters=parameters
    )
    y = 1.0 - np.exp(-t) + 0.01 * np.random.default_rng(1).normal(size=40)
    problem = Problem(model, Recording(t, {"y": Signal(y)}), substeps=1)
    z = np.asarray(problem.space.cube(np.array([1.0])))
    assert checked_cost(problem, z).confirmed
    verification.error_of(problem, z, "recording")
    assert asked == [verification.RTOL]
