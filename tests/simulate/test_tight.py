"""The tight solver of the check: events, friction, play and late states against closed forms, whole records, and
what it refuses."""

import numpy as np
import pytest

import plantfit as pf
from plantfit.problem import Problem, checked_cost, verify
from plantfit.recording import from_arrays
from plantfit.simulate import Simulator
from plantfit.simulate.check.tight import follow
from plantfit.simulate.check.verify import check_steps

T = np.arange(0.0, 6.0, 0.05)
RNG = np.random.default_rng(0)
U = np.repeat(RNG.uniform(-2, 2, 24), 5)


def simulated(text, p, t=T, inputs=None, states=("x",), hold=None, longest=None, substeps=64, stepper="rk4", **drive):
    model = pf.equations(text, states=states, inputs=list(inputs or {}), outputs=["y"], parameters=list(p), check=False)
    simulator = Simulator.of(model, stepper=stepper, substeps=substeps, hold=hold)
    return simulator, simulator.drive(t, inputs or {}, longest=longest, **drive)


def bounced(t, g, c):
    hit, v = np.sqrt(2 / g), np.sqrt(2 * g)
    if t < hit:
        return 1 - 0.5 * g * t * t
    while True:
        v, t0 = c * v, hit
        hit = t0 + 2 * v / g
        if t < hit:
            return v * (t - t0) - 0.5 * g * (t - t0) ** 2


def decaying(t, moments):
    return sum(np.where(t >= m, np.exp(-(t - m)), 0.0) for m in moments)


def sliding(t):
    """v' = 2 - t until it stops at 4, and rests."""
    return np.where(t < 4, 2 * t - t**2 / 2, 0.0)


def played(t):
    z, found = 0.0, []
    for s in np.unique(np.concatenate([t, np.linspace(0, t[-1], 40001)])):
        z = min(max(z, 2 * np.sin(s) - 0.2), 2 * np.sin(s) + 0.2)
        found.append((s, z))
    s, z = np.array(found).T
    return np.interp(t, s, z)


def late(t):
    """x' = -x(t - 1) from 1, by the method of steps."""
    return np.where(
        t < 1, 1 - t, np.where(t < 2, 1 - t + (t - 1) ** 2 / 2, 1 - t + (t - 1) ** 2 / 2 - (t - 2) ** 3 / 6)
    )


CASES = {
    "bounces": (
        "x' = v\nv' = -g\nwhen falling(x): v = -c*v\ny = x", {"g": 9.81, "c": 0.8}, T[:50],
        {"states": {"x": {"initial": 1.0}, "v": None}},
        lambda t: np.array([bounced(s, 9.81, 0.8) for s in t]),
    ),
    "doses": ("x' = -k*x\nwhen rising(t - 2): x = x + 1\nwhen rising(t - a): x = x + 1\ny = x", {"k": 1.0, "a": 1.23},
              T, {},
              lambda t: decaying(t, (2.0, 1.23))),
    "friction": ("x' = 2 - friction(x, k*t)\ny = x", {"k": 1.0}, T, {}, sliding),
    "play": ("x = play(2*sin(t), g)\ny = x", {"g": 0.2}, T, {}, played),
    "late": ("x' = -delay(x, L)\ny = x", {"L": 1.0}, T[:60], {"states": {"x": {"initial": 1.0}}, "longest": {"L": 2.0}},
             late),
    "held": ("x' = (u - x)/tau\ny = x", {"tau": 0.5}, T, {"inputs": {"u": np.ones(len(T))}},
             lambda t: 1 - np.exp(-t / 0.5)),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_the_tight_solver_follows_closed_forms(name):
    text, p, t, more, exact = CASES[name]
    found = follow(*_with(simulated(text, p, t, substeps=1, **more), p))
    assert found.stopped is None
    np.testing.assert_allclose(found.outputs["y"], exact(t), atol=2e-8)


@pytest.mark.parametrize("order", ["xv", "vx"])
def test_models_that_give_another_state_each_are_told_apart(order):
    """Programs that outlive the process took one for the other: a record of v was compared with x."""
    exact = {"x": np.cos(2.0 * T), "v": -2.0 * np.sin(2.0 * T)}
    for output in order:
        own = f"x' = v\nv' = -k*x\ny = {output}"
        simulator, drive = simulated(own, {"k": 4.0}, states={"x": {"initial": 1.0}, "v": {"initial": 0.0}})
        found = follow(simulator, {"k": 4.0}, drive).outputs["y"]
        np.testing.assert_allclose(found, exact[output], atol=1e-6)


def test_play_that_rests_at_a_flank_that_stands_still_is_pushed_again():
    """A drive that came to rest, from where its speed is a rounding error of either sign."""
    t = 0.01 * np.arange(1400)
    u = np.repeat([-1.0, 0.0, 1.0, 0.0, 1.0, 0.0, -1.0], 200)
    p = {"tau": 0.03, "gap": 0.1}
    text = "v' = (u - v)/tau\nx' = v\nz = play(x, gap)\ny = z"
    made = simulated(text, p, t, inputs={"u": u}, states=("v", "x", "z"), substeps=1)
    found = follow(*_with(made, p))
    z, moved = 0.0, []
    for x in found.states[made[0].vector.states.index("x")]:  # it turns back between no two samples
        z = min(max(z, x - p["gap"]), x + p["gap"])
        moved.append(z)
    np.testing.assert_allclose(found.outputs["y"], moved, atol=1e-8)


def _with(made, p):
    return made[0], p, made[1]


STICKS = ("x' = v\nv' = (u - friction(v, Fc, Fs))/m\ny = x", {"Fc": 1.0, "Fs": 1.3, "m": 0.7})


@pytest.mark.thorough
def test_the_error_of_a_simulation_is_told_over_the_whole_record():
    """Sticking and sliding with a held force: coarse and fine steps, and a record of more than 1500 pieces."""
    text, p = STICKS
    u = RNG.uniform(-2, 2, 1600)
    simulator, drive = simulated(text, p, 0.05 * np.arange(1600), {"u": u}, ("x", "v"), substeps=1)
    error = check_steps(simulator, p, drive)
    assert (error.first, error.last) == (0, 1599)
    assert error.max_error["y"] < 1e-9  # constant forces: rk4 is exact
    text, p = "x' = (u - x - x^3)/tau\ny = x", {"tau": 0.05}
    simulator, drive = simulated(text, p, T, {"u": U}, substeps=1)
    coarse = check_steps(simulator, p, drive)
    fine = check_steps(simulator.refined(4), p, drive)
    assert coarse.max_error["y"] > 100 * fine.max_error["y"] > 0


POLE = "x' = k*x^2\ny = x"


@pytest.mark.parametrize("t", [np.arange(0.0, 3.0, 0.5), np.array([0.0, 1.5, 3.0])])
def test_a_pole_is_told_by_time_and_state_and_never_raises(t):
    """x = 1/(1 - t): also where the solver fails before the first sample behind the start."""
    simulator, drive = simulated(POLE, {"k": 1.0}, t, states={"x": {"initial": 1.0}}, substeps=1, stepper="exponential")
    error = check_steps(simulator, {"k": 1.0}, drive)
    assert error.stopped is not None
    assert error.stopped.time == pytest.approx(1.0, abs=1e-5)
    assert error.stopped.state == "x"
    assert "grows without bound" in error.stopped.sentence


def test_an_answer_behind_a_pole_is_refused_and_exponential_growth_is_not():
    t = np.array([0.0, 0.8, 1.6, 2.4])
    model = pf.equations(
        POLE, states={"x": {"initial": 1.0}}, outputs=["y"], parameters={"k": {"bounds": (0.5, 2.0)}}, check=False
    )
    problem = Problem(model, from_arrays(t, signals={"y": np.zeros(4)}, name="run"), substeps=1)
    found = checked_cost(problem, problem.space.cube(np.array([1.0])))
    assert found.cost_checked == np.inf
    assert not found.confirmed
    assert found.refused is not None
    assert "refused: in recording run, at t = " in found.refused
    assert verify(problem, problem.space.cube(np.array([1.0])))[0].refused is not None
    grows, p = "x' = k*x\ny = x", {"k": 5.0}
    simulator, drive = simulated(grows, p, T, states={"x": {"initial": 1e-3}})
    assert check_steps(simulator, p, drive).stopped is None


@pytest.mark.thorough
def test_the_checked_cost_is_that_of_the_exact_solution():
    """Two outputs with scales, two records with weights; one step a sample is too coarse and said to be."""
    model = pf.equations("x' = (u - x)/tau - 0.2*x^3\ny = x\nw = x + u", inputs=["u"], states=["x"], outputs=["y", "w"],
                         parameters={"tau": {"bounds": (0.05, 2.0)}}, check=False)  # fmt: skip
    records = {
        n: from_arrays(
            t, signals={"u": np.where(np.arange(len(t)) % 4 < 2, 1.5, -0.5), "y": np.sin(t) / 9, "w": np.cos(t)}
        )
        for n, t in (("a", 0.4 * np.arange(40)), ("b", 0.3 * np.arange(25)))
    }
    problem = Problem(model, records, substeps=1, balance="recordings", scales={"y": 0.3, "w": 2.0})
    z = problem.space.cube(np.array([0.1]))
    coarse, fine = (
        checked_cost(problem, z),
        Problem(model, records, substeps=512, balance="recordings", scales={"y": 0.3, "w": 2.0}),
    )
    assert coarse.cost_reported == pytest.approx(float(problem.cost(z)), rel=1e-12)
    assert coarse.cost_checked == pytest.approx(float(fine.cost(z)), rel=1e-7)
    assert not coarse.confirmed
    assert coarse.refused is None
    assert checked_cost(fine, z).confirmed
    # nothing is kept there
    again = Problem(model, records, substeps=1, balance="recordings", scales={"y": 0.3, "w": 2.0})
    some = checked_cost(again, z, evaluations=500)
    assert 0 < some.samples < coarse.samples
    assert some.refused is None
