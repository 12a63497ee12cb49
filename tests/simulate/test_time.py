"""Wherever t stands it is the time: events, friction, play, tables, initial values; and the time before the record."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plantfit as pf
from plantfit.errors import RecordingError, SimulationError
from plantfit.problem import Experiment, Problem
from plantfit.recording import from_arrays
from plantfit.simulate import Simulator
from plantfit.simulate.steps.registry import FIXED

import jax
import jax.numpy as jnp

T = np.arange(0.0, 25.0, 2.5)


def outputs(model, p=None, t=T, inputs=None, substeps=1, stepper="exponential", **drive):
    simulator = Simulator.of(model, substeps=substeps, stepper=stepper)
    p = {d.name: d.value if d.value is not None else (p or {})[d.name] for d in model.parameters}
    return {n: np.asarray(y) for n, y in simulator.outputs(p, simulator.drive(t, inputs or {}, **drive)).items()}


def counter(condition, kind="rising", **more):
    return pf.equations(
        f"c' = 0\nwhen {kind}({condition}): c = c + 1", states={"c": ""}, outputs={"c": ""}, check=False, **more
    )


MOMENTS = [
    ("t - 12", "rising", [12.0]),
    ("12 - t", "rising", []),
    ("12 - t", "falling", [12.0]),
    ("t - 12", "crossing", [12.0]),
    ("t - 12.5", "rising", [12.5]),  # on a sample
    ("3*t - 0.3", "rising", [0.1]),
    ("sin(t)", "rising", [2 * np.pi, 4 * np.pi, 6 * np.pi]),
    ("sin(t)", "crossing", np.pi * np.arange(1, 8)),
    ("sin(4*t)", "rising", np.pi / 2 * np.arange(1, 15)),  # several within one sample
    ("t*t - 100", "rising", [10.0]),  # on a sample
]
OFTEN = {"12 - t", "t - 12.5", "sin(4*t)"}  # by every stepper; all others by the first one


@pytest.mark.parametrize(
    ("condition", "kind", "moments", "stepper", "substeps"),
    [
        pytest.param(*moment, name, 1 + 4 * k, marks=() if k == 0 or moment[0] in OFTEN else pytest.mark.slow)
        for moment in MOMENTS
        for k, name in enumerate(FIXED)
    ],
)
@pytest.mark.further(12)
def test_events_by_time_alone_happen_once_each(condition, kind, moments, stepper, substeps):
    found = outputs(counter(condition, kind), substeps=substeps, stepper=stepper)["c"]
    np.testing.assert_array_equal(found, [sum(m <= t + 1e-9 for m in moments) for t in T])


def test_many_doses_between_two_samples_and_two_in_one_moment():
    text = "\n".join(["c' = 0", *(f"when rising(t - {k}): c = c + {k}" for k in (1, 2, 3, 4, 5, 3))])
    model = pf.equations(text, states={"c": ""}, outputs={"c": ""}, check=False)
    np.testing.assert_array_equal(outputs(model, t=np.array([0.0, 2.0, 10.0, 20.0]))["c"], [0.0, 3.0, 18.0, 18.0])


@pytest.mark.thorough
def test_moments_that_are_parameters_move_and_their_derivative_is_exact():
    """x' = -x with doses of 1 at a, a + 1, a + 2, a + 3, within one sample: x(t) = sum exp(-(t - moment))."""
    text = "\n".join(["x' = -k*x", *(f"when rising(t - a - {k}): x = x + 1" for k in range(4))])
    model = pf.equations(text, states={"x": ""}, outputs={"x": ""}, parameters=["a", "k"], check=False)
    simulator = Simulator.of(model, stepper="exact")
    drive = simulator.drive(np.array([0.0, 0.5, 8.0, 9.0]), {})

    def at(a):
        return simulator.outputs({"a": a, "k": 1.0}, drive)["x"][2]

    whole = jax.jit(lambda a: (jax.value_and_grad(at)(a), jax.jvp(at, (a,), (1.0,))))
    for a in (0.7, 1.3, 3.0):
        exact = sum(np.exp(-(8.0 - a - k)) for k in range(4))  # and its own slope by a
        for value, slope in whole(a):  # by reverse and by forward mode
            assert float(value) == pytest.approx(exact, rel=1e-13)
            assert float(slope) == pytest.approx(exact, rel=1e-12)


def test_an_event_at_the_very_start_is_refused_in_words():
    with pytest.raises(SimulationError, match=r"at t = 0 s, where the simulation begins.*initial_time"):
        outputs(counter("t - 0"))
    np.testing.assert_array_equal(outputs(counter("t - 0"), initial_time=-1.0)["c"], np.ones(len(T)))


def test_friction_that_depends_on_time():
    """v' = F - friction(v, k*t): stuck until... from F = 2 with k = 1: v' = 2 - t while it moves; it stops at t = 4
    and stays."""
    text = "v' = 2 - friction(v, k*t)"
    model = pf.equations(text, states={"v": ""}, outputs={"v": ""}, parameters={"k": {"value": 1.0}}, check=False)
    t = np.arange(0.0, 7.0, 0.37)
    exact = np.where(t < 4, 2 * t - t**2 / 2, 0.0)
    np.testing.assert_allclose(outputs(model, t=t)["v"], exact, atol=1e-12)


def test_play_of_a_drive_that_is_a_function_of_time():
    model = pf.equations("z = play(2*sin(t), 0.5)", states={"z": ""}, outputs={"z": ""}, check=False)
    t = np.linspace(0.0, 7.0, 701)
    z, expected = 0.0, []
    for s in t:
        z = min(max(z, 2 * np.sin(s) - 0.5), 2 * np.sin(s) + 0.5)
        expected.append(z)
    np.testing.assert_allclose(outputs(model, t=t)["z"], expected, atol=1e-12)


def test_tables_over_time_end_steps_at_their_nodes():
    """x' = k(t), k a hat: exact with one step per sample, though the nodes lie between samples."""
    tables = {"k": {"over": ["t"], "nodes": [[0.0, 3.3, 7.7, 11.1]], "unit": "1/s"}}
    model = pf.equations(
        "x' = k(t)",
        states={"x": ""},
        outputs={"x": ""},
        tables=tables,
        parameters={"k": {"value": [0.0, 2.0, -1.0, 0.5]}},
    )
    times, values = np.array([0.0, 3.3, 7.7, 11.1, 25.0]), np.array([0.0, 2.0, -1.0, 0.5, 0.5])
    fine = np.unique(np.r_[np.linspace(0, 22.5, 22501), times[:-1]])
    k = np.interp(fine, times, values)
    area = np.r_[0.0, np.cumsum(0.5 * (k[1:] + k[:-1]) * np.diff(fine))]
    np.testing.assert_allclose(outputs(model)["x"], np.interp(T, fine, area), atol=1e-12)


def test_t_in_initial_values_is_when_the_simulation_begins():
    model = pf.equations(
        "x' = 1/tau", states={"x": {"unit": "", "initial": "t/tau"}}, outputs={"x": ""}, parameters={"tau": "s"}
    )
    t = np.array([3.0, 4.0, 6.0])
    np.testing.assert_allclose(outputs(model, {"tau": 2.0}, t)["x"], t / 2)
    np.testing.assert_allclose(outputs(model, {"tau": 2.0}, t, initial_time=-5.0)["x"], t / 2)


LAG = pf.equations(
    "x' = (K*u - x)/tau\ny = x + delay(u, L)", inputs={"u": ""}, states={"x": ""}, outputs={"y": ""},
    parameters={
        "K": {"bounds": (0.1, 9.0)}, "tau": {"unit": "s", "bounds": (0.5, 20.0)},
        "L": {"unit": "s", "bounds": (0, 5), "value": 1.5}
    },
)  # fmt: skip


@pytest.mark.parametrize("hold", ["previous", "linear"])
@pytest.mark.further(1)
def test_states_begin_before_the_record_under_the_inputs_before(hold):
    """From rest at -10 s under u = 0.7, the input of the record from its first sample on."""
    t, u = np.arange(2.0, 30.0, 1.1), np.sin(np.arange(26))
    simulator = Simulator.of(LAG, stepper="exact", hold={"u": hold})
    drive = simulator.drive(t, {"u": u}, before={"u": 0.7}, initial_time=-10.0)
    plain = simulator.drive(t, {"u": u}, before={"u": 0.7})
    begin = 2.0 * 0.7 * (1 - np.exp(-12.0 / 6.0))

    @jax.jit
    def simulated(p):
        whole = simulator.outputs(p, drive)["y"]
        return whole, simulator.states(p, plain, (jnp.asarray(begin),))[0], simulator.channels(p, plain)[1]

    found, x, late = map(np.asarray, simulated({"K": 2.0, "tau": 6.0, "L": 1.5}))
    np.testing.assert_allclose(found, x + late, atol=1e-12)


@pytest.mark.thorough
def test_a_problem_with_initial_time_has_the_same_costs_gradients_and_predictions_everywhere():
    rng = np.random.default_rng(0)
    records, exact = {}, {}
    for name, n in (("a", 40), ("b", 23)):
        t, u = np.cumsum(rng.uniform(0.2, 1.0, n)), rng.uniform(-1, 1, n)
        records[name] = Experiment(
            from_arrays(t, signals={"u": u, "y": rng.normal(size=n)}, name=name), before={"u": 0.7}, initial_time=-8.0
        )
    problem = Problem(LAG, records, {"L": (0.2, 3.0)}, hold={"u": "linear"}, substeps=2)
    z = np.array([0.4, 0.3, 0.6])
    values = np.asarray(problem.space.physical(z))
    for name, experiment in records.items():
        exact[name] = problem.predict(values, name)["y"] - experiment.recording["y"]
    r = np.concatenate(list(exact.values()))
    assert float(problem.cost(z)) == pytest.approx(np.mean(r**2), rel=1e-12)
    _, g = problem.value_and_gradient(z)
    residuals, jacobian = problem.residuals_and_jacobian(z)
    np.testing.assert_allclose(residuals, r, atol=1e-12)
    np.testing.assert_allclose(g, 2 * jacobian.T @ r / len(r), rtol=1e-9)
    for k in range(3):
        d = 1e-6 * np.eye(3)[k]
        assert g[k] == pytest.approx(float(problem.cost(z + d) - problem.cost(z - d)) / 2e-6, rel=1e-5, abs=1e-9)


def test_initial_time_after_the_first_sample_or_on_a_steady_record_is_refused():
    r = from_arrays(T, signals={"u": T, "y": T}, name="run")
    with pytest.raises(RecordingError, match="initial_time = 3 s is not before the first sample at 0 s"):
        Experiment(r, initial_time=3.0)
    with pytest.raises(RecordingError, match="steady"):
        Experiment(r, initial_time=-3.0, steady=True)
    with pytest.raises(SimulationError, match="initial_time"):
        Simulator.of(LAG).drive(T, {"u": T}, initial_time=1.0)


DOSES = """
gut' = -ka*gut
blood' = ka*gut - ke*blood
when rising(t - 12): gut = gut + dose
y = blood/V
"""


@pytest.mark.thorough
def test_the_dose_in_the_middle_of_the_record_is_found():
    """Two doses of 100, at the start and at 12: today's second one never came, and 6.0, 0.009, 12.4 were called
    determined."""
    ka, ke, V = 1.2, 0.15, 8.0
    t = np.array([0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 11.0, 12.5, 13.0, 14.0, 16.0, 18.0, 20.0, 24.0])

    def blood(s):
        return np.where(s >= 0, 100 * ka / (ka - ke) * (np.exp(-ke * s) - np.exp(-ka * s)), 0.0)

    y = (blood(t) + blood(t - 12.0)) / V
    model = pf.equations(
        DOSES, states={"gut": {"initial": "dose"}, "blood": None}, outputs={"y": None}, constants={"dose": 100.0},
        check=False,
        parameters={n: {"bounds": b, "scale": "log"} for n,
                    b in {"ka": (0.1, 10), "ke": (0.005, 1), "V": (1, 50)}.items()},
    )  # fmt: skip
    answer = pf.fit(Problem(model, from_arrays(t, signals={"y": y}, name="doses"), initial_time=0.0), seed=1)
    assert answer.values == pytest.approx({"ka": ka, "ke": ke, "V": V}, rel=1e-3)
    assert all(p["status"] == "determined" for p in answer.findings["parameters"])


def test_events_by_time_follow_a_tight_solver_through_a_batch_of_records():
    """A table, friction and an event over time in one; costs of a batch have the bits of each alone."""
    text = "x' = v\nv' = a*sin(t) - friction(v, Fc*(1 + 0.1*t))\nwhen rising(t - 2.2): v = v + 1"
    parameters = {"a": {"bounds": (1, 5)}, "Fc": {"bounds": (0.1, 1)}}
    model = pf.equations(text, states={"x": None, "v": None}, outputs={"x": None}, parameters=parameters, check=False)
    t = np.arange(0.0, 6.0, 0.01)
    problem = Problem(model, from_arrays(t, signals={"x": 0 * t}, name="r"), substeps=1, stepper="rk4")
    z = np.array([[0.5, 0.5], [0.1, 0.9]])
    assert [float(c) for c in problem.costs(z)] == [float(problem.cost(row)) for row in z]
    x = problem.predict(np.array([3.0, 0.55]))["x"]

    def rate(s, q):
        return [q[1], 3 * np.sin(s) - 0.55 * (1 + 0.1 * s) * np.tanh(q[1] / 1e-5)]

    first = solve_ivp(rate, (0, 2.2), [0, 0], "LSODA", rtol=1e-8, atol=1e-10, t_eval=[*t[t < 2.2], 2.2], max_step=0.01)
    second = solve_ivp(
        rate, (2.2, t[-1]), first.y[:, -1] + [0, 1], "LSODA", rtol=1e-8, atol=1e-10, t_eval=t[t >= 2.2], max_step=0.01
    )
    np.testing.assert_allclose(x, np.r_[first.y[0, :-1], second.y[0]], atol=2e-4)


STUDY = """
name = "rest"
[recording.run]
file = "run.csv"
before = { u = 0.7 }
initial_time = -100.0
[model]
equations = "x' = (K*u - x)/tau"
inputs = { u = "" }
states = { x = "" }
outputs = { x = "" }
[parameters.K]
bounds = [0.1, 9.0]
unit = ""
[parameters.tau]
bounds = [0.5, 20.0]
unit = "s"
"""


def test_a_study_file_lets_states_begin_before_the_record(tmp_path):
    from plantfit import spec

    (tmp_path / "run.csv").write_text("t,u,x\n" + "".join(f"{k},{0.7 if k < 3 else 2.0},{k}\n" for k in range(9)))
    (tmp_path / "study.toml").write_text(STUDY)
    problem = spec.load(tmp_path / "study.toml").problem
    x = problem.predict(np.array([2.0, 5.0]))["x"]
    np.testing.assert_allclose(x[:4], 1.4, atol=1e-6)  # at rest
    assert x[-1] > 2.0
    (tmp_path / "study.toml").write_text(STUDY.replace("-100.0", "4.0"))
    with pytest.raises(RecordingError, match="initial_time = 4 s is not before the first sample at 0 s"):
        spec.load(tmp_path / "study.toml")
