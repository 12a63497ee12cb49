"""A pendubot follows poses through its motor: as well as by the torque itself, worse with wrong constants, never
beyond the bridge."""

from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plantfit.cases.motor.bench import TRUTH
from plantfit.cases.motor.tracking_section import tracking_section
from plantfit.models.library.pendubot_terms import base_values
from plantfit.rig.pendubot import MEASURED
from plantfit.rig.pendubot_tracking import PendubotTracking

RIG = PendubotTracking(duration=5.0, bits=12)
QUICK = TRUTH | {"Lm": 3e-3}  # a winding of 1 ms


@pytest.fixture(scope="module")
def direct():
    return RIG.follow(QUICK, None)


def test_the_exact_motor_tracks_as_the_torque_itself(direct):
    exact = RIG.follow(QUICK, QUICK)
    assert not direct.fell
    assert np.all(direct.rms < np.radians(0.25))
    np.testing.assert_allclose(exact.rms, direct.rms, rtol=0.15)
    assert exact.at_limit == 0.0


@pytest.mark.parametrize("share", [0.7, 1.3])
def test_a_wrong_motor_tracks_far_worse(direct, share):
    wrong = RIG.follow(QUICK, QUICK | {"Rm": share * QUICK["Rm"]})
    assert np.all(wrong.rms > 5 * direct.rms)


def test_a_weak_supply_is_at_its_limit_and_never_beyond():
    weak = PendubotTracking(duration=5.0, supply=5.0)
    run = weak.follow(TRUTH, TRUTH)
    volts = np.asarray(run.run.u["V"])
    assert np.max(np.abs(volts)) == pytest.approx(weak.limit)
    assert run.at_limit == np.mean(np.abs(volts) > 0.9999 * weak.limit) > 0
    step = weak.limit / 255
    np.testing.assert_allclose(volts / step, np.round(volts / step), atol=1e-6)


def test_the_motion_between_samples_is_that_of_a_tight_solver():
    run = RIG.follow(TRUTH, TRUTH).run
    b, l1, g, p = {n: float(v) for n, v in base_values(MEASURED, 0.15).items()}, 0.15, 9.81, TRUTH

    def rate(_, x, volts):
        q1, q2, v1, v2, i = x
        b3, c, s = l1 * b["b5"], np.cos(q2), np.sin(q2)
        M = np.array([[b["b1"] + b["b2"] + 2 * b3 * c + p["Jm"], b["b2"] + b3 * c], [b["b2"] + b3 * c, b["b2"]]])
        C = np.array([-b3 * s * (2 * v1 * v2 + v2**2), b3 * s * v1**2])
        lift = b["b5"] * g * np.cos(q1 + q2)
        tau = np.array([p["Kt"] * i - p["Cm"] * v1 - p["Tf"] * np.tanh(v1 / 0.01), 0.0])
        acceleration = np.linalg.solve(M, tau - C - np.array([b["b4"] * g * np.cos(q1) + lift, lift]))
        return [v1, v2, *acceleration, (volts - p["Rm"] * i - p["Kb"] * v1) / p["Lm"]]

    x = np.stack([np.asarray(run.states[n]) for n in ("theta1", "theta2", "omega1", "omega2", "i")], axis=1)
    for k in (500, 1500, 2200, 2900):
        after = solve_ivp(
            rate, (0, RIG.period), x[k], args=(float(run.u["V"][k]),), method="DOP853", rtol=1e-11, atol=1e-13
        ).y[:, -1]
        np.testing.assert_allclose(x[k + 1], after, atol=2e-8)


def test_the_section_tells_the_runs_apart(monkeypatch):
    monkeypatch.setattr(
        "plantfit.cases.motor.tracking_section.PendubotTracking",
        partial(PendubotTracking, duration=RIG.moves[-1].end + 1.0),
    )
    section = tracking_section({n: TRUTH[n] for n in ("Rm", "Lm", "Kb", "Jm", "Cm", "Tf")}, TRUTH)
    rows = {row[0]: row[1:] for row in section["tables"][0]["rows"]}
    assert rows["identified"] == rows["true"]  # Kt is Kb where it is left out
    assert float(rows["true"][0]) < 2 * float(rows["none: torque itself"][0])
    assert min(float(rows[f"Rm/Kt 30 % {way}"][0]) for way in ("low", "high")) > 5 * float(rows["true"][0])
