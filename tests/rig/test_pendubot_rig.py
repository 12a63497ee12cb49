"""The virtual pendubot: exact to a tight solver, with the sensors' faults it promises."""

import functools
import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plantfit.errors import RecordingError, SimulationError
from plantfit.models.library.double_pendulum import Motion, energies
from plantfit.recording import read_csv
from plantfit.rig import MEASURED, Move, PendubotRig

RIG = PendubotRig()
STEP = 2 * np.pi / 10_000


@functools.cache
def recorded():
    return RIG.record(seed=3)


def printed_rate(x, V, p=MEASURED, l1=0.15, g=9.81, kt=0.0724, ke=0.0724, Ra=2.983):
    """M q'' + C q' + G = [tau, 0] with matrices."""
    (q1, q2, v1, v2), (m1, m2, lc1, lc2, I1, I2) = x, (p[n] for n in ("m1", "m2", "lc1", "lc2", "I1", "I2"))
    b1, b2, b3, b4, b5 = m1 * lc1**2 + m2 * l1**2 + I1, m2 * lc2**2 + I2, m2 * l1 * lc2, m1 * lc1 + m2 * l1, m2 * lc2
    c, s = np.cos(q2), np.sin(q2)
    M = np.array([[b1 + b2 + 2 * b3 * c, b2 + b3 * c], [b2 + b3 * c, b2]])
    C = np.array([[-b3 * v2 * s, -b3 * (v1 + v2) * s], [b3 * v1 * s, 0.0]])
    G = np.array([b4 * g * np.cos(q1) + b5 * g * np.cos(q1 + q2), b5 * g * np.cos(q1 + q2)])
    tau = np.array([kt / Ra * V - kt * ke / Ra * v1, 0.0])
    return np.r_[v1, v2, np.linalg.solve(M, tau - C @ [v1, v2] - G)]


def test_every_sample_follows_from_the_one_before_by_a_tight_solver():
    exact = recorded().exact
    x = np.stack([exact[n] for n in ("theta1", "theta2", "omega1", "omega2")], axis=1)
    for k in [*range(0, 24_900, 500), *range(5500, 5510)]:
        # ten samples on: the solver starts anew where the voltage jumps
        y = x[k]
        for j in range(k, k + 10):
            y = solve_ivp(
                lambda _, x, V=exact["V"][j]: printed_rate(x, V), (0, 1e-3), y, method="DOP853", rtol=1e-12, atol=1e-13
            ).y[:, -1]
        np.testing.assert_allclose(x[k + 10], y, rtol=0, atol=2e-11)


def test_encoders_are_rounded_each_with_a_phase_of_its_own():
    phase = recorded().truth["encoder_phase_counts"]
    for name, shift in zip(("theta1", "theta2"), phase, strict=True):
        counts = recorded().recording[name] / STEP - shift
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
        error = (recorded().recording[name] - recorded().exact[name]) / STEP
        assert np.max(np.abs(error)) <= 0.5 + 1e-9
        moving = np.abs(recorded().exact["omega1"]) > 0.1  # at rest the loop plays about the edge of a count
        assert np.std(error[moving]) == pytest.approx(1 / np.sqrt(12), rel=0.03)
    assert phase != RIG.record(seed=4).truth["encoder_phase_counts"]


def test_the_voltage_is_read_with_noise_and_keeps_to_the_limit():
    noise = recorded().recording["V"] - recorded().exact["V"]
    assert np.std(noise) == pytest.approx(5e-3, rel=0.03)
    assert abs(np.mean(noise)) < 2e-4
    tight = PendubotRig(limit=8.9).record(seed=3, offset=(0.01, 0.0)).exact["V"]
    assert np.max(np.abs(tight)) == 8.9


def test_the_poses_are_reached_and_held_by_the_torque_of_gravity():
    for t, theta1 in ((4.4, np.pi / 2), (9.4, 2 * np.pi / 3), (17.4, np.pi / 3), (24.9, np.pi / 2)):
        rest = np.abs(RIG.t - (t - 0.5)) < 0.5
        mean = {n: float(np.mean(recorded().exact[n][rest])) for n in ("theta1", "theta2", "tau1")}
        assert mean["theta1"] == pytest.approx(theta1, abs=5e-3)
        assert mean["theta1"] + mean["theta2"] == pytest.approx(np.pi / 2, abs=1e-3)
        assert mean["tau1"] == pytest.approx(RIG.base["b4"] * 9.81 * np.cos(mean["theta1"]), abs=1e-3)


def test_a_seed_gives_the_same_run_and_another_seed_another():
    again, other = RIG.record(seed=3), RIG.record(seed=4)
    for name in recorded().recording.signals:
        assert np.array_equal(again.recording[name], recorded().recording[name])
    assert not np.array_equal(other.exact["theta1"], recorded().exact["theta1"])  # the controller hears the encoders


def test_base_parameters_move_as_the_physical_ones_do():
    two = [RIG.noise_free(values) for values in (None, RIG.base)]
    for name in ("theta1", "theta2", "omega2", "V", "tau1"):
        np.testing.assert_allclose(two[0][name], two[1][name], atol=1e-9)
    other = RIG.noise_free({**RIG.base, "b4": 1.1 * RIG.base["b4"]})
    assert np.max(np.abs(other["V"] - two[0]["V"])) > 0.5


def test_friction_needs_its_values_and_takes_its_energy():
    with pytest.raises(SimulationError, match="'Fv1'"):
        PendubotRig(friction=("viscous",))
    rough = PendubotRig({**MEASURED, "Fv1": 5e-3, "Fv2": 1e-4}, friction=("viscous",))
    s = rough.record(seed=3, offset=(0.01, 0.0)).exact
    x = Motion(*(s[n] for n in ("theta1", "theta2", "omega1", "omega2")))
    energy = np.sum(energies(x, rough.base, rough.l1, rough.g), axis=0)
    work = 0.0724 / 2.983 * float(np.sum(s["V"][:-1] * np.diff(s["theta1"])))  # the voltage is held over a sample
    brake = 0.0724**2 / 2.983 * np.trapezoid(x.omega1**2, s.t)
    rubbed = np.trapezoid(5e-3 * x.omega1**2 + 1e-4 * x.omega2**2, s.t)
    assert energy[-1] - energy[0] == pytest.approx(work - brake - rubbed, abs=0.01 * rubbed)


def test_a_saved_run_is_read_back_with_its_truth(tmp_path):
    path = recorded().save(tmp_path / "runs")
    back = read_csv(path)
    for name, signal in recorded().recording.signals.items():
        assert np.array_equal(back[name], signal.values)
        assert back.signals[name].unit == signal.unit
    assert json.loads((path.parent / "pendubot_truth.json").read_text("utf-8"))["base"] == RIG.base
    (tmp_path / "taken").write_text("")
    with pytest.raises(RecordingError, match="choose another place"):
        recorded().save(tmp_path / "taken")


def test_a_fall_and_impossible_settings_are_told_in_a_sentence():
    with pytest.raises(SimulationError, match=r"fell at 0\.\d+ s"):
        RIG.record(seed=1, offset=(0.5, 0.5))
    with pytest.raises(SimulationError, match="period is 0"):
        PendubotRig(period=0.0)
    with pytest.raises(SimulationError, match="start it later"):
        PendubotRig(poses=(Move(1.0, 2.0, 2.0), Move(2.0, 1.0, 1.5))).record(seed=1)
