"""The likelihood against numpy and finite differences, its maximum against the truth behind simulated records."""

import kalman_plants as plants
import numpy as np
import pytest

from plantfit import Problem
from plantfit.errors import SearchError, SpaceError
from plantfit.estimate import Noise, compare_estimates, ekf, maximum_likelihood, nis_test
from plantfit.estimate.filters.filter_step import linearised
from plantfit.estimate.filters.likelihood import Innovations
from plantfit.estimate.filters.maximum_likelihood import maximised

FREE = Noise(
    {n: (v / 12, v * 7) for n, v in plants.PROCESS.items()},
    {n: (v / 7, v * 12) for n, v in plants.MEASUREMENT.items()},
    plants.INITIAL,
)
ALL = (
    plants.TRUTH
    | {f"process {n}": v for n, v in plants.PROCESS.items()}
    | {f"measurement {n}": v for n, v in plants.MEASUREMENT.items()}
)


@pytest.fixture(scope="module")
def motor():
    return Problem(plants.robot_motor(), plants.motor_record(11, 400)[0])


@pytest.fixture(scope="module")
def likelihood(motor):
    return Innovations.of(motor, FREE, linearised)


@pytest.mark.thorough
def test_the_likelihood_is_that_of_the_textbook_filter(motor, likelihood):
    z = np.random.default_rng(1).uniform(0.2, 0.8, likelihood.space.dimension)
    named = dict(zip(likelihood.space.names, np.asarray(likelihood.space.physical(z)), strict=True))
    process, measurement = ({n: named[f"{kind} {n}"] for n in ("i", "w")} for kind in ("process", "measurement"))
    record = motor.experiments["run"].recording
    total = plants.numpy_filter(record, named, process, measurement)[2]
    assert float(likelihood.value(z, likelihood.records(motor))) == pytest.approx(-total, rel=1e-9)


@pytest.mark.thorough
def test_gradient_scores_and_hessian_are_exact(motor, likelihood):
    records = likelihood.records(motor)
    z = np.random.default_rng(2).uniform(0.2, 0.8, likelihood.space.dimension)
    _value, gradient = likelihood.values_and_gradients(z, records)
    step = 1e-5 * np.eye(len(z))
    differences = np.array([(likelihood.value(z + e, records) - likelihood.value(z - e, records)) / 2e-5 for e in step])
    assert np.allclose(gradient, differences, rtol=1e-5, atol=1e-6 * np.max(np.abs(gradient)))
    assert np.allclose(
        np.sum(likelihood.scores(z, records)[0], axis=0), gradient, rtol=1e-10, atol=1e-9 * np.max(np.abs(gradient))
    )
    slopes = [[likelihood.values_and_gradients(z + s * e, records)[1] for s in (1, -1)] for e in step]
    hessian = np.array([(np.asarray(a) - np.asarray(b)) / 2e-5 for a, b in slopes])
    assert np.allclose(likelihood.hessian(z, records), hessian, rtol=1e-4, atol=1e-6 * np.max(np.abs(hessian)))


@pytest.mark.thorough
def test_parameters_and_noise_levels_are_found(motor, likelihood):
    found = maximised(likelihood, likelihood.records(motor), FREE)
    assert found.gradient < 1e-4
    assert not found.at_bound
    assert found.count == 800
    truth = np.array(list(ALL.values()))
    off = (found.estimate.values - truth) / found.estimate.standard_error
    assert np.all(np.abs(off) < 3.5)
    assert found.estimate.names == tuple(ALL)
    relative = found.estimate.standard_error / truth
    assert np.all(relative[:5] < 0.2)
    assert np.all(relative > 1e-3)
    # information: the covariance from curvature and the one from the scores estimate the same
    curved = maximised(likelihood, likelihood.records(motor), FREE, "hessian")
    assert np.allclose(curved.estimate.values, found.estimate.values, rtol=1e-4)
    assert np.all(np.abs(np.log(curved.estimate.standard_error / found.estimate.standard_error)) < 0.5)
    assert compare_estimates(curved.estimate, found.estimate).p_value > 0.99
    run = ekf(motor, found.noise, at=found.parameters).run()
    assert run.log_likelihood == pytest.approx(found.log_likelihood, rel=1e-9)
    assert nis_test(run).consistent


@pytest.mark.thorough
def test_a_nonlinear_model_by_both_filters():
    record, _ = plants.tank_record(12, 200)
    problem = Problem(plants.tank(), record, substeps=2)
    noise = Noise({"level": (0.002, 0.2)}, {"level": (0.005, 0.5)}, {"level": 0.1})
    extended = maximum_likelihood(problem, noise, budget=150)
    spread = maximum_likelihood(problem, noise, filter="ukf", budget=150)
    truth = plants.TANK | {"process level": 0.02, "measurement level": 0.05}
    for name, value in truth.items():
        low, high = extended.interval[name]
        assert low * 0.8 < value < high * 1.2
        assert high < 4 * low
    # both filters follow this mild tank alike
    assert np.all(np.abs(spread.estimate.values - extended.estimate.values) < 0.2 * extended.estimate.standard_error)
    assert "log-likelihood" in extended.sentence


@pytest.mark.thorough
def test_a_bound_and_a_flat_direction_are_named(motor):
    held = Problem(
        plants.robot_motor(), motor.experiments["run"].recording, {"Ra": (3.5, 6.0), "La": 1.12e-2, "J": 2.27e-8}
    )
    found = maximum_likelihood(held, plants.NOISE, budget=90)
    assert found.at_bound == ("Ra",)
    assert found.estimate.named["Ra"] == pytest.approx(3.5)
    assert found.estimate.standard_error[0] == 0.0
    assert found.estimate.standard_error[1] > 0.0
    with pytest.raises(SpaceError, match="give a number of at least 0, or a pair"):
        Noise({"i": (0.0, 1.0)}, plants.MEASUREMENT)
    with pytest.raises(SearchError, match="filter = 'kf'"):
        maximum_likelihood(motor, FREE, filter="kf")  # pyrefly: ignore[bad-argument-type]


@pytest.mark.slow
@pytest.mark.parametrize("covariance", ["hessian", "sandwich"])
def test_intervals_cover_the_truth_in_95_of_100(covariance):
    model, runs = plants.robot_motor(), 200
    likelihood, inside, far = None, np.zeros(len(ALL)), []
    for seed in range(runs):
        problem = Problem(model, plants.motor_record(1000 + seed, 1000)[0])
        likelihood = likelihood or Innovations.of(problem, FREE, linearised)
        found = maximised(likelihood, likelihood.records(problem), FREE, covariance, budget=200)
        wrong = found.estimate.values - list(ALL.values())
        # noise on its bound has none
        far.append(wrong[: len(plants.TRUTH)] / found.estimate.standard_error[: len(plants.TRUTH)])
        inside += [found.interval[n][0] < v < found.interval[n][1] for n, v in ALL.items()]
    share = inside[: len(plants.TRUTH)] / runs
    assert np.all(np.abs(share - 0.95) <= 0.04), dict(zip(ALL, inside / runs, strict=True))
    # how the current moves and is measured shows well; the noise of w is a fifth of what its process adds and may run
    # to its bound
    assert np.all(inside[[5, 7]] / runs > 0.88)
    assert np.all(np.abs(np.mean(far, axis=0)) < 0.3)
