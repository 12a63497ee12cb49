"""Filters against numpy by hand, the smoother against batch least squares, filters against each other."""

import kalman_plants as plants
import numpy as np
import pytest

from plantfit import Problem, from_arrays
from plantfit.errors import ModelError, RecordingError, SpaceError
from plantfit.estimate import Noise, ekf, kalman_filter, smoothed, ukf
from plantfit.models import dc_motor, drive_regression


def with_gaps(record):
    """Current missing now and then, both outputs over a stretch."""
    i, w = record["i"].copy(), record["w"].copy()
    i[30:90:3] = np.nan
    i[120:140] = w[120:140] = np.nan
    return from_arrays(record.t, signals={"V": record["V"], "i": i, "w": w})


@pytest.fixture(scope="module")
def record():
    return with_gaps(plants.motor_record(1, 300)[0])


@pytest.fixture(scope="module")
def run(record):
    return kalman_filter(Problem(plants.robot_motor(), record), plants.NOISE, at=plants.TRUTH).run()


def test_the_linear_filter_is_the_textbooks_with_gaps(record, run):
    means, covariances, total = plants.numpy_filter(record)
    assert np.allclose(run.mean, means, rtol=1e-8, atol=1e-10)
    assert np.allclose(run.covariance, covariances, rtol=1e-7)
    assert run.log_likelihood == pytest.approx(total, rel=1e-10)
    assert run.measured[33] == 1
    assert run.measured[130] == 0
    assert run.nis[130] == 0.0
    assert np.isnan(run.innovations[33, 0])
    assert np.isfinite(run.innovations[33, 1])


@pytest.mark.thorough
def test_uneven_samples_are_filtered_by_their_own_steps():
    t = np.cumsum(np.random.default_rng(3).uniform(2e-4, 3e-3, 120))
    record = plants.motor_record(4, t=t)[0]
    run = kalman_filter(Problem(plants.robot_motor(), record), plants.NOISE, at=plants.TRUTH).run()
    means, _, total = plants.numpy_filter(record)
    assert np.allclose(run.mean, means, rtol=1e-7, atol=1e-9)
    assert run.log_likelihood == pytest.approx(total, rel=1e-9)


@pytest.mark.thorough
def test_the_smoother_is_the_batch_solution(record, run):
    """All states at once: least squares over prior, steps and measurements, each by its square root."""
    n, y = 160, np.stack([record["i"], record["w"]], axis=1)
    rows, right = [], []

    def add(blocks, value, covariance):
        inverse = np.linalg.inv(np.linalg.cholesky(covariance))
        row = np.zeros((len(value), 2 * n))
        for k, block in blocks:
            row[:, 2 * k : 2 * k + 2] = block
        rows.append(inverse @ row)
        right.append(inverse @ value)

    f, b, q = plants.motor_matrices(1e-3)
    add([(0, np.eye(2))], np.zeros(2), np.diag(np.square(list(plants.INITIAL.values()))))
    for k in range(n):
        if k:
            add([(k - 1, -f), (k, np.eye(2))], b * record["V"][k - 1], q)
        for j in range(2):
            if np.isfinite(y[k, j]):
                add(
                    [(k, np.eye(2)[j : j + 1])],
                    y[k, j : j + 1],
                    np.array([[list(plants.MEASUREMENT.values())[j] ** 2]]),
                )
    a, c = np.vstack(rows), np.concatenate(right)
    solution = np.linalg.lstsq(a, c, rcond=None)[0].reshape(n, 2)
    covariance = np.linalg.inv(a.T @ a)
    short = from_arrays(record.t[:n], signals={s: record[s][:n] for s in ("V", "i", "w")})
    after = smoothed(kalman_filter(Problem(plants.robot_motor(), short), plants.NOISE, at=plants.TRUTH).run())
    scale = np.array([0.1, 100.0])
    assert np.max(np.abs(after.mean - solution) / scale) < 1e-8
    for k in (0, 50, 130, n - 1):
        assert np.allclose(after.covariance[k], covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2], rtol=1e-6)
    band = after.track("w")
    assert np.all(band.low < band.value)
    assert band.unit == "rad/s"
    assert np.all(
        np.diagonal(after.covariance, axis1=1, axis2=2)
        <= np.diagonal(run.covariance[:n], axis1=1, axis2=2) * (1 + 1e-9)
    )


@pytest.mark.parametrize("kappa", [0.0, 1.0])
@pytest.mark.thorough
def test_on_a_linear_model_all_filters_are_the_linear_one(record, run, kappa):
    problem = Problem(plants.robot_motor(), record)
    extended = ekf(problem, plants.NOISE, at=plants.TRUTH).run()
    assert np.array_equal(extended.mean, run.mean)
    assert np.array_equal(extended.root, run.root)
    spread = ukf(problem, plants.NOISE, at=plants.TRUTH, kappa=kappa).run()
    assert np.allclose(spread.mean, run.mean, rtol=1e-10, atol=1e-12)
    assert np.allclose(spread.covariance, run.covariance, rtol=1e-9)
    assert np.allclose(smoothed(spread).mean, smoothed(run).mean, rtol=1e-8, atol=1e-10)


@pytest.mark.thorough
def test_sample_by_sample_is_the_whole_record(record, run):
    now = kalman_filter(Problem(plants.robot_motor(), record), plants.NOISE, at=plants.TRUTH).online()
    for k in range(150):
        found = now.update(record.t[k], {"V": record["V"][k]}, {"i": record["i"][k], "w": record["w"][k]})
        assert found.states["w"] == pytest.approx(run.mean[k, 1], rel=1e-9, abs=1e-9)
        assert found.sd["i"] == pytest.approx(np.sqrt(run.covariance[k, 0, 0]), rel=1e-8)
        assert found.nis == pytest.approx(run.nis[k], rel=1e-6, abs=1e-9)
    with pytest.raises(RecordingError, match="in order of time"):
        now.update(record.t[3], {"V": 0.0}, {})
    with pytest.raises(RecordingError, match="Input 'V' has no value"):
        now.update(1.0, {}, {})


@pytest.mark.parametrize("kind", [ekf, ukf])
@pytest.mark.thorough
def test_a_nonlinear_filter_finds_a_constant_from_far_off(kind):
    record, level = plants.tank_record(5)
    problem = Problem(plants.tank(), record, substeps=2)
    made = kind(problem, plants.TANK_NOISE, ["k", "area"], at={"k": 0.9, "area": 5.0})
    run = made.run()
    area = run.track("area")
    assert area.value[0] == pytest.approx(5.0, rel=0.2)
    assert np.all(area.low > 0)
    k = run.track("k")
    assert np.all((k.low > 0.1) & (k.high < 1.5))
    for name, low, high in ((n, *run.interval[n]) for n in ("k", "area")):
        assert low < plants.TANK[name] < high
    sd = run.estimate.standard_error / list(plants.TANK.values())
    assert np.all(sd < 0.06)
    rms = np.sqrt(np.mean((run.mean[20:, 0] - level[20:]) ** 2))
    assert rms < np.sqrt(np.mean((smoothed(run).mean[20:, 0] - level[20:]) ** 2)) * 2
    assert rms < 0.05
    now = made.online()
    for j in range(40):
        found = now.update(record.t[j], {"flow": record["flow"][j]}, {"level": record["level"][j]})
    assert found.parameters["k"] == pytest.approx(k.value[39], rel=1e-9)
    assert found.bands["area"][0] == pytest.approx(area.low[39], rel=1e-9)


@pytest.mark.thorough
def test_covariances_stay_positive_over_a_long_exact_record():
    record, _ = plants.motor_record(7, 3000)
    noise = Noise({"i": 1e-6, "w": 1e-6}, {"i": 1e-9, "w": 1e-7}, {"i": 1e3, "w": 1e5})
    run = kalman_filter(Problem(plants.robot_motor(), record), noise, at=plants.TRUTH).run()
    scale = np.sqrt(np.diagonal(run.covariance, axis1=1, axis2=2))
    assert np.all(scale > 0)
    assert np.min(np.linalg.eigvalsh(run.covariance / (scale[:, :, None] * scale[:, None, :]))) > -1e-14


@pytest.mark.thorough
def test_a_dead_time_is_filtered_at_the_edges_of_its_input():
    """A motor that hears its voltage 3.4 samples late is one whose record holds the voltage at finer times."""
    t, delay = 1e-3 * np.arange(200), 3.4e-3
    fine = np.unique(np.round(np.concatenate([t, t + delay]), 10))
    v = 3.0 * (np.random.default_rng(8).random(20) < 0.5).repeat(10)
    held = np.array([v[max(int(np.floor((s - delay) / 1e-3 + 1e-6)), 0)] for s in fine])
    w = 100.0 * np.sin(40 * t)
    there = np.isin(fine, np.round(t, 10))
    sparse = np.full(len(fine), np.nan)
    sparse[there] = w
    noise = Noise({"i": 1.0, "w": 300.0}, {"w": 2.0}, {"i": 0.1, "w": 10.0})
    values = {"Rm": 2.7, "Lm": 0.01, "Kb": 0.005, "Jm": 2e-7, "Cm": 1e-6}
    late = Problem(
        dc_motor(tied=True, dead_time=True),
        from_arrays(t, signals={"V": v, "w": w}),
        {"Td": delay, "Tf": 0.0},
        substeps=4,
    )
    plain = Problem(dc_motor(tied=True), from_arrays(fine, signals={"V": held, "w": sparse}), {"Tf": 0.0}, substeps=4)
    a, b = ekf(late, noise, at=values).run(), ekf(plain, noise, at=values).run()
    there = there & (fine <= t[-1])
    # steps are cut at other places where the voltage stays, which moves them by their own error
    assert np.max(np.abs(a.mean - b.mean[there]) / np.max(np.abs(a.mean), axis=0)) < 1e-5
    now = ekf(late, noise, at=values).online()
    for k in range(60):
        found = now.update(t[k], {"V": v[k]}, {"w": w[k]})
    assert [*found.states.values()] == pytest.approx(a.mean[59], rel=1e-9)
    assert [*found.sd.values()] == pytest.approx(np.sqrt(np.diag(a.covariance[59])), rel=1e-9)


def test_mistakes_are_named(record):
    problem = Problem(plants.robot_motor(), record)
    with pytest.raises(SpaceError, match="'Rx' is not a free parameter"):
        ekf(problem, plants.NOISE, ["Rx"])
    with pytest.raises(SpaceError, match="no measurement level of output 'w'"):
        ekf(problem, Noise({}, {"i": 0.1}, plants.INITIAL))
    with pytest.raises(SpaceError, match="under process"):
        ekf(problem, Noise({"x": 1.0}, plants.MEASUREMENT, plants.INITIAL))
    with pytest.raises(SpaceError, match="measurement level of 'i' is 0"):
        Noise({}, {"i": 0.0})
    with pytest.raises(SpaceError, match="is a range"):
        ekf(problem, Noise({"i": (0.1, 1.0)}, plants.MEASUREMENT, plants.INITIAL))
    with pytest.raises(SpaceError, match="outside its bounds"):
        ekf(problem, plants.NOISE, at={"Ra": 1e3})
    with pytest.raises(SpaceError, match="kappa = -1"):
        ukf(problem, plants.NOISE, kappa=-1.0)
    with pytest.raises(SpaceError, match="drift names 'Ra'"):
        ekf(problem, plants.NOISE, ["La"], drift={"Ra": 0.1})
    with pytest.raises(ModelError, match="is not linear"):
        kalman_filter(Problem(plants.tank(), plants.tank_record(5, 30)[0]), plants.TANK_NOISE)
    signals = {"acceleration": np.sin(record.t), "velocity": np.cos(record.t), "force": np.ones(len(record.t))}
    with pytest.raises(ModelError, match="not a regression"):
        ekf(Problem(drive_regression(), from_arrays(record.t, signals=signals)), plants.NOISE)
