"""A mesh of its own for every record: exact where equal steps are not, and a pure function of the candidate."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plantfit as pf
from plantfit.problem import Problem, checked_cost
from plantfit.problem.accuracy import mesh
from plantfit.problem.accuracy.course import BLOCK, Course
from plantfit.problem.accuracy.mesh import can_mesh, effects, errors_at, mesh_at
from plantfit.problem.accuracy.steps import LONG_MESH, choose_substeps, refined_at, steps_for
from plantfit.problem.evaluate.points import residuals
from plantfit.recording import from_arrays
from plantfit.simulate.check.tight import follow
from plantfit.simulate.steps.array_steppers import Rates
from plantfit.simulate.steps.registry import STEPPERS

T = np.array([0.0, 1.0, 2.0, 4.0, 7.0, 10.0])
# a fast state feeds a slow one: y = b (exp(-k t) - exp(-f t)) / (f - k), a corner at the start that samples do not show
FAST = pf.equations(
    "a' = -f*a\n b' = a*f/100 - k*b\n y = b",
    states={"a": {"initial": 100.0}, "b": {}},
    outputs=["y"],
    parameters={"f": {"bounds": (1.0, 1000.0), "scale": "log"}, "k": {"bounds": (0.01, 10.0), "scale": "log"}},
)


def truth(f, k, t=T):
    return f * (np.exp(-k * t) - np.exp(-f * t)) / (f - k)


def problem_of(model=FAST, y=None, t=T, **more):
    return Problem(model, from_arrays(t, signals={"y": truth(200.0, 0.3) if y is None else y}, name="run"), **more)


def at(problem, **values):
    return np.asarray(problem.space.cube(problem.space.vector(values)))


def test_a_mesh_is_exact_where_equal_steps_are_not_and_puts_its_steps_into_the_corner():
    problem = problem_of()
    z = at(problem, f=200.0, k=0.3)
    fine = mesh_at(problem, z[None, :], {"y": 1.0}, 1e-4)
    error = np.max(np.abs(fine.predict(np.array([200.0, 0.3]))["y"] - truth(200.0, 0.3)))
    drive = fine.data["drive"]["run"]
    assert error < 4e-4 < np.max(np.abs(problem.predict(np.array([200.0, 0.3]))["y"] - truth(200.0, 0.3)))
    assert len(drive.t) < 60  # as long as the shortest they would be 80
    assert np.min(np.diff(drive.t)) < 0.2 < 0.7 < np.max(np.diff(drive.t))
    assert np.argmin(np.diff(drive.t)) == 0
    np.testing.assert_array_equal(drive.t[drive.samples], T)
    assert errors_at(fine, z[None, :], {"y": 1.0})[0] <= 1e-4


def test_estimated_errors_are_those_against_the_closed_form():
    problem = problem_of(stepper="rosenbrock").with_mesh({"run": np.linspace(0, 10, 641)[1:-1]})
    z = at(problem, f=20.0, k=0.3)
    error = problem.predict(np.array([20.0, 0.3]))["y"] - truth(20.0, 0.3)
    found = effects(problem, z[None, :], "run", {"y": 1.0})[0]
    np.testing.assert_allclose(found.error, error, atol=0.1 * np.max(np.abs(error)))
    # what the steps add cannot be less than what all of them make
    assert np.linalg.norm(found.error) <= 1.1 * np.sum(found.share)


def test_costs_on_a_mesh_are_pure_and_derivatives_are_those_of_the_mesh():
    problem = mesh_at(problem_of(), at(problem_of(), f=200.0, k=0.3)[None, :], {"y": 1.0}, 1e-3)
    zs = np.random.default_rng(0).random((40, 2))
    together = np.asarray(problem.costs(zs))
    alone = np.array([float(problem.costs(z[None, :])[0]) for z in zs[:4]])
    np.testing.assert_array_equal(together[:4], alone)
    z, h = np.array([0.6, 0.4]), 1e-6
    _, gradient = problem.value_and_gradient(z)
    _, jacobian = problem.residuals_and_jacobian(z)
    for i, e in enumerate(np.eye(2)):
        central = (float(problem.cost(z + h * e)) - float(problem.cost(z - h * e))) / (2 * h)
        column = (np.asarray(problem.residuals(z + h * e)) - np.asarray(problem.residuals(z - h * e))) / (2 * h)
        np.testing.assert_allclose(gradient[i], central, rtol=1e-5)
        np.testing.assert_allclose(jacobian[:, i], column, atol=1e-6)


def test_steps_are_chosen_for_most_of_the_box_at_the_answer_and_for_given_values():
    # logistic growth from little: between two samples it goes from nothing to its end
    text = "y' = r*y*(1 - y)"
    growth = pf.equations(
        text, states={"y": {"initial": 1e-4}}, outputs=["y"], parameters={"r": {"bounds": (0.5, 20.0), "scale": "log"}}
    )
    y = 1.0 / (1.0 + (1e4 - 1.0) * np.exp(-3.0 * T))
    chosen, again = choose_substeps(problem_of(growth, y)), choose_substeps(problem_of(growth, y))
    assert chosen.mesh
    np.testing.assert_array_equal(chosen.mesh["run"], again.mesh["run"])
    problem = problem_of(growth, y)
    z = at(problem, r=3.0)
    assert np.max(np.abs(problem.predict(np.array([3.0]))["y"] - y)) > 0.01
    assert np.max(np.abs(steps_for(problem, z).predict(np.array([3.0]))["y"] - y)) < 1e-3
    noisy = problem_of(growth, y + 0.01 * np.random.default_rng(1).standard_normal(len(T)))
    assert checked_cost(refined_at(noisy, z), z).off < 0.06  # 3 % of the residual; the rest is for `finish`
    assert checked_cost(noisy, z).off > 1.0


def test_fine_samples_keep_their_single_step():
    t = np.linspace(0, 10, 400)
    slow = pf.equations(
        "y' = -k*y", states={"y": {"initial": 1.0}}, outputs=["y"], parameters={"k": {"bounds": (0.1, 1.0)}}
    )
    problem = Problem(slow, from_arrays(t, signals={"y": np.exp(-0.3 * t)}, name="run"))
    chosen = choose_substeps(problem)
    assert not chosen.mesh
    assert chosen.predictor.stepping().substeps == 1


def test_jumps_and_long_records_get_equal_steps():
    text = "y' = -k\n when falling(y): y = 1"
    jumping = pf.equations(text, states={"y": {"initial": 1.0}}, outputs=["y"], parameters={"k": {"bounds": (0.1, 1)}})
    assert not can_mesh(problem_of(jumping, np.zeros(len(T))))
    t = np.linspace(0, 10, 5000)
    assert not can_mesh(problem_of(y=truth(200.0, 0.3, t), t=t))
    assert can_mesh(problem_of())


@pytest.mark.parametrize("name", [name for name, stepper in STEPPERS.items() if stepper.place_on_arrays])
def test_steps_on_arrays_are_those_on_scalars(name):
    model = pf.equations(
        "a' = -q*a*b + u\n b' = a - b*b*c\n c' = sin(b) - c*u\n y = a",
        inputs=["u"], states=["a", "b", "c"], outputs=["y"], parameters={"q": {"bounds": (0.1, 1)}},
    )  # fmt: skip
    problem = Problem(model, from_arrays(T, signals={"u": T, "y": T}, name="run"))
    vector = problem.predictor.stepping().vector
    random = np.random.default_rng(3)
    x, u0, u1 = random.random((5, 3)), random.random((5, 2)), random.random((5, 2))
    h, q = random.random(5), random.random(5)
    found = STEPPERS[name].on_arrays(Rates(vector), x, u0, u1, h, (q,))
    for k in range(5):
        own = STEPPERS[name].step(vector.rate, tuple(x[k]), tuple(u0[k]), tuple(u1[k]), h[k], (q[k],), True)
        np.testing.assert_allclose(found[k], np.array(own, dtype=float), rtol=1e-11)


POLE_T = np.array([0.0, 1.0, 2.0, 4.0, 7.0, 10.0])


def pole(equation):
    """x = tan(0.1 t) / 0.1 at k = 0.01; a pole at t = pi / (2 sqrt(k)), inside the record for most of the box."""
    states = {s: {} for s in ("z", "x") if f"{s}'" in equation}
    model = pf.equations(
        equation, states=states, outputs=["y"], parameters={"k": {"bounds": (1e-3, 3.0), "scale": "log"}}, name="pole"
    )
    return Problem(model, from_arrays(POLE_T, signals={"y": np.tan(0.1 * POLE_T) / 0.1}, name="run"))


def test_a_search_has_adaptive_steps_where_a_mesh_would_step_over_poles():
    problem = choose_substeps(pole("x' = 1 + k*x^2\n y = x"))
    assert problem.predictor.stepping().stepper == "adaptive"
    k = np.array([0.003, 0.01, 0.05, 0.3, 2.0])
    costs = np.asarray(problem.costs(np.array([at(problem, k=v) for v in k])))
    np.testing.assert_array_equal(np.isfinite(costs), np.pi / 2 / np.sqrt(k) > 10.0)
    assert costs[1] < 1e-4 < costs[0]


@pytest.mark.parametrize(
    "equation", ["z' = -20*(z - 1)\n x' = z + k - x\n y = x", "z' = -200*(z - 1)\n x' = z*k - x\n y = x"]
)
def test_a_mesh_that_gives_true_costs_stays(equation):
    problem = choose_substeps(pole(equation))
    assert problem.predictor.stepping().stepper != "adaptive"


def test_a_pole_is_no_lack_of_evaluations_and_a_lack_of_them_is_no_pole():
    problem = pole("x' = 1 + k*x^2\n y = x")
    drive = problem.whole_drives["run"]
    for evaluations in (20_000, 200_000):
        stopped = follow(problem.predictor.stepping(), {"k": np.asarray(0.3)}, drive, evaluations=evaluations).stopped
        assert stopped is not None
        assert not stopped.spent
        assert stopped.time == pytest.approx(np.pi / 2 / np.sqrt(0.3), rel=1e-4)
    t = np.arange(20.0)  # evaluations are counted where an input moves
    model = pf.equations(
        "x' = u - k*x\n y = x", inputs=["u"], states={"x": {}}, outputs=["y"], parameters={"k": {"bounds": (0.1, 3.0)}}
    )
    problem = Problem(model, from_arrays(t, signals={"u": t % 2, "y": t}, name="run"))
    short = follow(
        problem.predictor.stepping(), {"k": np.asarray(0.5)}, problem.whole_drives["run"], evaluations=10
    ).stopped
    assert short is not None
    assert short.spent


@pytest.mark.thorough
def test_a_mesh_of_a_box_that_nothing_follows_is_given_up_for_adaptive_steps(monkeypatch):
    """A tenth of this box swings two hundred times and more in a record: no mesh is fine enough for nine tenths of
    it."""
    t = np.linspace(0.0, 10.0, 150)
    swing = solve_ivp(
        lambda s, x: (x[1], -25.0 * np.sin(x[0])), (0.0, 10.0), (2.0, 0.0), t_eval=t, rtol=1e-9, atol=1e-9
    ).y[0]
    model = pf.equations(
        "angle' = v\n v' = -w^2*sin(angle)",
        states={"angle": {"initial": 2.0}, "v": {}},
        outputs=["angle"],
        parameters={"w": {"bounds": (0.1, 300.0), "scale": "log"}},
    )
    rounds, refined = [], mesh._refined
    monkeypatch.setattr(
        mesh, "_refined", lambda problem, *more: rounds.append(problem.steps_a_sample) or refined(problem, *more)
    )
    chosen = choose_substeps(Problem(model, from_arrays(t, signals={"angle": swing}, name="run")))
    assert chosen.predictor.stepping().stepper == "adaptive"
    assert not chosen.mesh
    assert 1 < len(rounds) < 10
    assert max(rounds) <= LONG_MESH
    off = np.asarray(residuals(chosen, at(chosen, w=5.0))) * chosen.scales["angle"]
    assert np.sqrt(np.mean(off**2)) < 3e-3 * np.std(swing)


@pytest.mark.parametrize("name", [name for name, stepper in STEPPERS.items() if stepper.place_on_arrays])
def test_a_course_in_compiled_blocks_is_that_of_one_step_after_the_other(name):
    model = pf.equations(
        "a' = -3*q*a + b*u\n b' = a - b*b*c - b\n c' = sin(b) - c*u\n y = a",
        inputs=["u"], states=["a", "b", "c"], outputs=["y"], parameters={"q": {"bounds": (0.1, 1)}},
    )  # fmt: skip
    vector = Problem(model, from_arrays(T, signals={"u": T, "y": T}, name="run")).predictor.stepping().vector
    random, steps = np.random.default_rng(3), BLOCK + 40
    x0, q, h = random.random((2, 3)), np.array([0.2, 0.8]), 0.2 * random.random((2, steps))
    u0, u1 = random.random((2, steps, 2)), random.random((2, steps, 2))
    run, x = Course(vector, name), x0
    found = run.states(x0, u0, u1, h, (q,))
    rates = Rates(vector)
    for k in range(steps):
        np.testing.assert_allclose(found[:, k], x, rtol=1e-9)
        x = STEPPERS[name].on_arrays(rates, x, u0[:, k], u1[:, k], h[:, k], (q,))
    np.testing.assert_allclose(found[:, steps], x, rtol=1e-9)
    # the same bits alone
    np.testing.assert_array_equal(run.states(x0[:1], u0[:1], u1[:1], h[:1], (q[:1],))[0], found[0])


def test_finer_meshes_of_a_model_compile_nothing_anew():
    problem = problem_of()
    z = at(problem, f=200.0, k=0.3)
    vector = problem.predictor.stepping().vector
    programs = []
    for count in (20, 333, 600):
        effects(problem.with_mesh({"run": np.linspace(0.0, 10.0, count)[1:-1]}), z[None, :], "run", {"y": 1.0})
        made = mesh._compiled(vector, "exponential", ())
        programs.append((id(made), len(made.rates._all._programs), len(made.course.compiled._programs)))
    assert programs == [(programs[0][0], 1, 1)] * 3


@pytest.mark.parametrize("k", [0.05, 0.3, 3.0])
def test_a_pole_is_seen_at_once_by_who_asks_only_whether_there_is_one(k):
    problem = pole("x' = 1 + k*x^2\n y = x")
    single, drive, p = problem.predictor.stepping(), problem.whole_drives["run"], {"k": np.asarray(k)}
    told, brief = (follow(single, p, drive, evaluations=20_000, briefly=b) for b in (False, True))
    assert told.stopped is not None
    assert brief.stopped is not None
    assert not told.stopped.spent
    assert not brief.stopped.spent
    assert brief.stopped.state == told.stopped.state
    np.testing.assert_allclose(brief.stopped.time, told.stopped.time, rtol=1e-5)
    assert brief.evaluations < told.evaluations / 4


def test_growth_that_can_be_followed_is_no_pole():
    model = pf.equations("x' = k*x\n y = x", outputs=["y"], states={"x": {"initial": 1e-3}},
                         parameters={"k": {"bounds": (0.1, 30.0)}})  # fmt: skip
    problem = problem_of(model, np.ones(len(T)))
    found = follow(problem.predictor.stepping(), {"k": np.asarray(20.0)}, problem.whole_drives["run"], briefly=True)
    assert found.stopped is None
    np.testing.assert_allclose(found.outputs["y"], 1e-3 * np.exp(20.0 * (T - T[0])), rtol=1e-6)
