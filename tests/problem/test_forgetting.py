"""A record is said to forget its start where deviations grow, chaotic or unstable, and nowhere else."""

import numpy as np
import pytest
from scipy.signal import lsim

from plantfit import Parameter, Problem, Recording, Signal
from plantfit.models import equations
from plantfit.native.kept_programs import Kept
from plantfit.problem.shooting.forgetting import forgetting, forgetting_of_lost
from plantfit.problem.shooting.start import Shooting
from plantfit.trust.verdict.searches import forgetting_sentences

PLANTS: dict[str, tuple[str, dict[str, float], float, bool]] = {
    # equations, initial states, seconds, and whether the start is forgotten
    "lag": ("x' = -a*x + u\ny = x", {"x": 1.0}, 20.0, False),
    "integrator": ("x' = v\nv' = u\ny = a*x", {"x": 0.0, "v": 0.1}, 20.0, False),
    "swing": ("x' = v\nv' = -30*a*x - 0.01*v + u\ny = x", {"x": 1.0, "v": 0.0}, 20.0, False),
    "stiff": ("x' = 1e4*(z - x)\nz' = -a*z + u\ny = x", {"x": 0.0, "z": 1.0}, 20.0, False),
    "limit cycle": ("x' = v\nv' = 2*(1 - x^2)*v - a*x\ny = x", {"x": 0.5, "v": 0.0}, 20.0, False),
    "pendulum swinging": ("x' = v\nv' = -9.81*a*sin(x)\ny = x", {"x": 2.0, "v": 0.0}, 20.0, False),
    "slow growth": ("x' = 0.2*a*x + u\ny = x", {"x": 1.0}, 20.0, False),  # e^4
    "growth": ("x' = 0.8*a*x + u\ny = x", {"x": 1e-3}, 20.0, True),  # e^16
    "upright": ("x' = v\nv' = 9.81*a*x - u\ny = x", {"x": 1e-9, "v": 0.0}, 5.0, True),
    "Lorenz": (
        "x' = 10*a*(y1 - x)\ny1' = x*(28*a - z) - y1\nz' = x*y1 - 8/3*z\ny = x",
        {"x": 1.0, "y1": 1.0, "z": 20.0},
        30.0,
        True,
    ),
    "driven pendulum": ("x' = v\nv' = -sin(x) - 0.5*a*v + 1.5*cos(2/3*t)\ny = x", {"x": 0.2, "v": 0.0}, 200.0, True),
    "double well": ("x' = v\nv' = x - x^3 - 0.3*a*v + 0.5*cos(1.2*t)\ny = x", {"x": 1.0, "v": 0.0}, 200.0, True),
}


def _problem(text: str, states: dict[str, float], seconds: float) -> Problem:
    t = np.linspace(0, seconds, 4001)
    u = np.where(np.sin(t) > 0, 1.0, -1.0)
    model = equations(
        text,
        inputs={"u": None} if "u\n" in text else {},
        states={n: {"initial": v} for n, v in states.items()},
        outputs={"y": None},
        parameters={"a": {"bounds": (0.5, 2.0)}},
        check=False,
    )
    record = Recording(
        t,
        {"u": Signal(u, None), "y": Signal(np.zeros_like(t), None)}
        if model.inputs
        else {"y": Signal(np.zeros_like(t), None)},
        "run",
    )
    return Problem(model, record, {"a": Parameter((0.5, 2.0), scale="log")}, substeps=4)


@pytest.mark.parametrize("name", PLANTS)
def test_only_growing_deviations_are_told(name):
    text, states, seconds, forgets = PLANTS[name]
    found = forgetting(_problem(text, states, seconds), np.array([0.5]))
    assert bool(found) == forgets, found


def test_growth_is_that_of_the_largest_exponent():
    """Of the Lorenz system 0.906 per second (Sprott, Chaos and Time-Series Analysis, 2003): tenfold in 2.54 s in the
    mean."""
    [found] = forgetting(_problem(*PLANTS["Lorenz"][:3]), np.array([0.5]))
    assert 0.7 < found.tenfold < 3.5
    assert found.growth > 1e6


def test_a_second_call_compiles_nothing(monkeypatch):
    problem = _problem(*PLANTS["growth"][:3])
    first = forgetting(problem, np.array([0.5]))
    monkeypatch.setattr(Kept, "_found_or_made", lambda *_: pytest.fail("a program was made anew"))
    assert forgetting(problem, np.array([0.5])) == first


@pytest.mark.parametrize(
    ("tenfold", "said"), [(0.043, "0.04"), (0.43, "0.4"), (4.3, "4"), (17.0, "20"), (430.0, "400")]
)
def test_seconds_are_those_that_a_study_file_takes(tenfold, said):
    [sentence] = forgetting_sentences(
        {"simulation": {"forgets": [{"recording": "run", "growth": 2e7, "tenfold": tenfold}]}}
    )
    assert f"`pieces = {said}` under" in sentence["sentence"]


def test_the_sentence_names_the_lines_to_write():
    none = {"simulation": {"forgets": []}}
    assert list(forgetting_sentences(none)) == []
    told = {
        "simulation": {
            "forgets": [
                {"recording": "run", "growth": 2e7, "tenfold": 0.43},
                {"recording": "b", "growth": 1e5, "tenfold": 1.0},
            ]
        }
    }
    [said] = forgetting_sentences(told)
    assert said["level"] == "bad"
    assert said["sentence"].startswith("The simulations of run and b forget their start: in run a small deviation")
    for part in (
        "`pieces = 0.4` under [recording.run]",
        "tenfold in about 0.4 s",
        "2e+07 times",
        "`shooting = 5`",
        "`start` for each state",
    ):
        assert part in said["sentence"]


WRONG = {  # what is fitted to a resonance, all of which settle or swing on
    "lag": ("x' = (u - x)/a\ny = x", {"x": 0.0}),
    "other resonance": ("x' = v\nv' = 40*a*(u - x) - 0.2*v\ny = x", {"x": 0.0, "v": 0.0}),
    "pendulum": ("x' = v\nv' = -8*a*sin(x) - 0.2*v + u\ny = x", {"x": 0.0, "v": 0.0}),
    "hardening": ("x' = v\nv' = 2*a*(u - x) - 0.1*v - x^3\ny = x", {"x": 0.0, "v": 0.0}),
}


@pytest.mark.parametrize(
    ("damping", "name"),
    [
        pytest.param(
            damping, name, marks=() if name == "lag" or (damping, name) == (0.02, "hardening") else pytest.mark.slow
        )
        for damping in (0.02, 0.3)
        for name in WRONG
    ],
)
def test_records_that_are_not_followed_for_other_reasons_are_left_alone(damping, name):
    """Where multiple shooting joins a record, or does not, of a plant that forgets nothing."""
    t = np.linspace(0, 60, 1500)
    u = np.sign(np.sin(0.7 * t + 1))
    y = lsim(([9.0], [1.0, 6.0 * damping, 9.0]), u, t)[1] + 0.02 * np.random.default_rng(0).normal(size=len(t))
    assert forgetting_of_lost(_of(WRONG[name], t, u, y), np.array([0.5])) == []


def _of(plant: tuple[str, dict[str, float]], t: np.ndarray, u: np.ndarray, y: np.ndarray) -> Problem:
    model = equations(
        plant[0],
        inputs={"u": None},
        states={n: {"initial": v} for n, v in plant[1].items()},
        outputs={"y": None},
        parameters={"a": {"bounds": (0.05, 20.0)}},
        check=False,
    )
    return Problem(
        model,
        Recording(t, {"u": Signal(u, None), "y": Signal(y, None)}, "run"),
        {"a": Parameter((0.05, 20.0), scale="log")},
    )


@pytest.mark.parametrize(
    ("plant", "searched"),
    [
        (("x' = (u - x)/a\ny = x", {"x": 0.0}), False),  # a lag
        (("x' = v\nv' = (u - v)/a\ny = x", {"x": 0.0, "v": 0.0}), False),  # what sums up a lag
        (("x' = (a - 18)*x + u\ny = x", {"x": 0.0}), True),  # unstable in a small part of the box
        (("x' = u - a*x^3\ny = x", {"x": 0.0}), True),  # no linear model
    ],
)
def test_lost_starts_are_searched_for_where_a_model_could_forget_them(monkeypatch, plant, searched):
    t, asked = np.linspace(0, 60, 200), []
    monkeypatch.setattr(Shooting, "search", lambda self, **_: asked.append(1) or pytest.fail("searched"))
    u = np.sign(np.sin(0.7 * t + 1))
    problem = _of(plant, t, u, np.sin(3 * t))
    if searched:
        with pytest.raises(pytest.fail.Exception):
            forgetting_of_lost(problem, np.array([0.5]))
    else:
        assert forgetting_of_lost(problem, np.array([0.5])) == []
    assert bool(asked) == searched


def _held_up(rate: float, seed: int) -> Problem:
    """A body that falls away from its rest by e in 1/`rate` s, held up by a controller that jumps between places; the
    box of its stiffness and gain goes far below and above theirs."""
    rng, dt, n = np.random.default_rng(seed), 0.02 / rate, 1500
    step = np.array([[np.cosh(rate * dt), np.sinh(rate * dt) / rate], [rate * np.sinh(rate * dt), np.cosh(rate * dt)]])
    push = np.array([(np.cosh(rate * dt) - 1.0) / rate**2, np.sinh(rate * dt) / rate])
    x, at, u = np.zeros((n, 2)), np.repeat(rng.uniform(-1, 1, n // 50), 50), np.zeros(n)
    for k in range(n):
        u[k] = rate**2 * (3.0 * (at[k] - x[k, 0]) - 2.0 * x[k, 1] / rate)
        if k + 1 < n:
            x[k + 1] = step @ x[k] + push * u[k]
    model = equations(
        "x' = v\nv' = g*u + s*x\ny = x", inputs=["u"], states={"x": {"initial": "y"}, "v": {"initial": 0.0}},
        outputs=["y"], parameters=["g", "s"], check=False,
    )  # fmt: skip
    y = x[:, 0] + 0.003 * rng.standard_normal(n)
    record = Recording(np.arange(n) * dt, {"u": Signal(u), "y": Signal(y)}, "run")
    box = {"g": Parameter((0.1, 10.0)), "s": Parameter((0.1 * rate**2, 50.0 * rate**2), scale="log")}
    return Problem(model, record, box, substeps=1)


@pytest.mark.parametrize(("rate", "lost"), [(3.0, (0.0, 0.0)), (280.0, (0.0, 0.0)), (40.0, (0.5, 0.05))])
def test_the_length_of_pieces_is_that_of_the_plant_where_a_search_ended_far_from_it(rate, lost):
    """At the lower end of the box a simulation runs away least, and says that it keeps its start for long."""
    problem, z = _held_up(rate, 1), np.array(lost)
    (there,), (found,) = forgetting(problem, z), forgetting_of_lost(problem, z)
    plant = np.log(10.0) / rate
    assert there.tenfold > 2.2 * plant
    assert found.tenfold == pytest.approx(plant, rel=0.35)
