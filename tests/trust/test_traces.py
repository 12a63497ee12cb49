"""How many compiled functions one small fit takes: a loop is compiled once for a shape, from the choice of steps to
the verdict."""

import collections
import logging

import numpy as np
import pytest
from test_agreement import two_outputs

import plantfit.runtime  # noqa: F401
from plantfit.models import equations
from plantfit.native import kept_programs
from plantfit.optimize import minimise
from plantfit.problem import Problem
from plantfit.problem.evaluate import points
from plantfit.recording.record import Recording, Signal
from plantfit.stages import judged, prepare

import jax

OWN = {
    "residuals",
    "costs",
    "values_and_gradients",
    "residuals_and_jacobian",
    "blocks",
    "outputs",
    "trajectories",
    "work",
    "rate",
    "output",
}


class Compilations(logging.Handler):
    """Counts what jax says it compiles, by the name of the function, for functions that hold a model."""

    def __init__(self):
        super().__init__(logging.DEBUG)
        self.count = collections.Counter()

    def emit(self, record):
        message = record.getMessage()
        if message.startswith("Compiling jit("):
            name = message.removeprefix("Compiling jit(").split(")")[0]
            name = name.removeprefix("kept_").removeprefix("tight_").removesuffix("_of_several")
            name = "costs" if name == "candidates" else name
            if name in OWN:
                self.count[name] += 1


@pytest.fixture
def compiled(monkeypatch):
    monkeypatch.setattr(kept_programs, "code_folder", lambda kind: None)  # nothing is read from disk
    handler, logger = Compilations(), logging.getLogger("jax")
    level, propagate, told = logger.level, logger.propagate, getattr(jax.config, "jax_log_compiles")  # noqa: B009  not in the stubs
    jax.config.update("jax_log_compiles", True)
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    logger.propagate = False
    yield handler.count
    jax.config.update("jax_log_compiles", told)
    logger.removeHandler(handler)
    logger.setLevel(level)
    logger.propagate = propagate


def through(problem, method="auto", runs=1, budget=2000):
    prepared = prepare(problem)
    results = minimise(prepared.objective, method, runs=runs, budget=budget, seed=0)
    return judged(prepared.problem, results, seed=0, spec=None, command="", seconds={}, stated=((), None)).findings


def few_samples() -> Problem:
    """The case of the issue: 16 samples, 6 parameters."""
    t = np.linspace(0.0, 3.0, 16)
    text = "x1' = (K1*u - x1)/T1\nx2' = (K2*u - x2)/T2\ny = x1 - x2 + c + s*u"
    declared = {
        "K1": (0.1, 5.0),
        "T1": (0.2, 5.0),
        "K2": (0.1, 5.0),
        "T2": (0.2, 5.0),
        "c": (-1.0, 1.0),
        "s": (-1.0, 1.0),
    }
    model = equations(
        text,
        inputs=["u"],
        states=["x1", "x2"],
        outputs=["y"],
        parameters={n: {"bounds": b} for n, b in declared.items()},
    )
    rng = np.random.default_rng(0)
    return Problem(
        model, Recording(t, {"u": Signal(np.sin(2 * t)), "y": Signal(np.sin(2 * t - 0.5) + 0.01 * rng.normal(size=16))})
    )


# costs: a search evaluates its sample in chunks of 64 and 16; rate: the tight solver takes it and its Jacobian;
# outputs: of the fitted part and, where the tight solver looks at it, of the whole record; residuals: those with
# straight lines between the samples of an input whose hold nobody stated
ONCE = {"residuals_and_jacobian": 1, "residuals": 1, "costs": 2, "outputs": 2, "work": 1, "rate": 2, "output": 1}


def check(compiled, allowed):
    grown = {
        name: f"{n} times, {allowed.get(name, 0)} allowed" for name, n in compiled.items() if n > allowed.get(name, 0)
    }
    assert not grown, f"compiled more often than one shape needs: {grown}"


@pytest.mark.parametrize("make", [few_samples, two_outputs], ids=["16 samples", "reweighting"])
@pytest.mark.parametrize("runs", [1, 3])
@pytest.mark.further(2)
def test_prepare_search_finish_and_verdict_share_their_shapes(compiled, make, runs):
    problem = make()
    compiled.clear()  # making the record simulated it
    findings = through(problem, runs=runs)
    assert findings["agreement"]["agree"] >= 1
    steps = findings["simulation"]["substeps"]
    # steps are judged by half of them, which takes no derivatives; whole steps and those that were chosen are searched
    # with
    check(compiled, {**ONCE, "residuals_and_jacobian": 1 + int(steps > 1), "residuals": 1 + int(np.log2(steps))})


def test_another_problem_of_the_same_shape_is_what_the_counter_counts(compiled):
    """The counter sees a function that is compiled twice: it can fail."""
    problem = few_samples()
    for _ in range(2):
        problem.compiled["residuals"].clear_cache()
        problem.residuals(np.full(6, 0.5))
    assert compiled["residuals"] == 2
    with pytest.raises(AssertionError, match="residuals"):
        check(compiled, ONCE)


def test_points_are_as_many_as_a_search_hands_over():
    from plantfit.optimize.loop.counter import TOGETHER

    assert points.WIDTH == TOGETHER


@pytest.mark.parametrize("make", [few_samples, two_outputs])
def test_a_point_beside_others_is_the_point_alone(make):
    problem = make()
    for z in np.random.default_rng(0).random((3, problem.space.dimension)):
        r, jacobian = points.residuals_and_jacobian(problem, z)
        alone, derivatives = problem.residuals_and_jacobian(z)
        np.testing.assert_allclose(r, alone, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(jacobian, derivatives, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(points.residuals(problem, z), problem.residuals(z), rtol=1e-9, atol=1e-11)
        few, slopes = points.compressed(problem, z)
        assert np.mean(few**2) == pytest.approx(np.mean(alone**2), rel=1e-12)
        np.testing.assert_allclose(
            slopes.T @ slopes / len(few), derivatives.T @ derivatives / len(alone), rtol=1e-9, atol=1e-11
        )
