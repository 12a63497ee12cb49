"""Rests where Newton's method meets saturations and friction: against closed forms and scipy's integration."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plantfit.runtime  # noqa: F401
from plantfit.control.rests import search
from plantfit.control.scheduling.design import _longest
from plantfit.control.tune import OneLoop, Wishes, tuned_loop
from plantfit.errors import SimulationError
from plantfit.models.text.equations import equations

LIMITS = (-24.0, 24.0)
STARTS = (-19.2, 0.0, 24.0)  # where a loop with these limits looks for a rest first
NAMES = ("J", "R", "kt", "b", "Fc", "Imax", "w0", "iw")
BENCH = dict(zip(NAMES, (3e-4, 1.1, 0.045, 1.2e-4, 0.018, 4.0, 1.0, 0.3), strict=True))


def motor(limit):
    """Coulomb friction and a current limit; `limit` sat or smooth_sat."""
    text = (
        f"i = {limit}\nw' = (kt*i - b*w - coulomb(w, Fc, w0))/J\nspeed = w",
        f"i = {limit}\nth' = w\nw' = (kt*i - b*w - coulomb(w, Fc, w0))/J\nspeed = w",
    )
    return [
        equations(t, inputs=["V"], states=s, outputs=["speed"], parameters=[n for n in NAMES if n in t], name="motor")
        for t, s in zip(text, (["w"], ["th", "w"]), strict=True)
    ]


HARD, ANGLE = motor("sat((V - kt*w)/R, -Imax, Imax)")
SOFT, _ = motor("smooth_sat((V - kt*w)/R, -Imax, Imax, iw)")


def loop(model, *plants):
    names = [p.name for p in model.parameters]
    return OneLoop(model, "speed", "V", {}, {n: np.array([p[n] for p in plants]) for n in names})


def drawn(n, seed=1):
    """Motors unlike each other: every value a factor of up to 2 off, friction steep in half of them."""
    rng = np.random.default_rng(seed)
    found = [{k: v * 2.0 ** rng.uniform(-1, 1) for k, v in BENCH.items()} for _ in range(n)]
    return [p | {"w0": 0.1 if k % 2 else 1.0} for k, p in enumerate(found)]


def current(V, w, p, soft):
    i = (V - p["kt"] * w) / p["R"]
    if not soft:
        return np.clip(i, -p["Imax"], p["Imax"])
    above, below = (p["iw"] * np.logaddexp(0.0, (i + s * p["Imax"]) / p["iw"]) for s in (1.0, -1.0))
    return -p["Imax"] + above - below


def needed(w, p):
    """The current that a speed takes."""
    return (p["b"] * w + p["Fc"] * np.tanh(w / p["w0"])) / p["kt"]


def spun(V, w, p, soft):
    """The speed that a motor comes to from another one near by."""

    def rate(_, w):
        return (p["kt"] * current(V, w, p, soft) - p["b"] * w - p["Fc"] * np.tanh(w / p["w0"])) / p["J"]

    return solve_ivp(rate, (0, 20 * p["J"] / p["b"]), [w], method="LSODA", rtol=1e-10, atol=1e-9).y[0, -1]


@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize(
    "level", [-70.0, 50.0, 100.0, *(pytest.param(v, marks=pytest.mark.slow) for v in (10.0, 90.0))]
)
@pytest.mark.thorough
def test_speeds_of_motors_with_friction_and_a_current_limit_are_held(soft, level):
    """Every one of 12 motors by itself, as the best fit of its study; scipy's integration comes back to the speed."""
    found = 0
    for p in drawn(12):
        rest = loop(SOFT if soft else HARD, p).at_rest(level, STARTS)
        u, can = float(rest.u[0]), abs(needed(level, p)) < p["Imax"]
        assert np.isfinite(u) == can
        if not can:
            continue
        found += 1
        assert rest.x[0, 0] == pytest.approx(level)
        if not soft:
            assert u == pytest.approx(p["R"] * needed(level, p) + p["kt"] * level, abs=1e-5)
        if abs(current(u, level, p, soft)) < 0.97 * p["Imax"]:
            assert spun(u, 0.97 * level, p, soft) == pytest.approx(level, rel=1e-3)
    assert found >= 10


@pytest.mark.thorough
def test_a_family_is_held_as_each_of_its_plants_is():
    plants = [BENCH, *drawn(20, 2)]
    rest = loop(HARD, *plants).at_rest(100.0, STARTS)
    for u, p in zip(rest.u, plants, strict=True):
        can = abs(needed(100.0, p)) < p["Imax"]
        truth = p["R"] * needed(100.0, p) + p["kt"] * 100.0 if can else np.nan
        assert u == pytest.approx(truth, abs=1e-5, nan_ok=True)


@pytest.mark.parametrize("spare", [1e-2, 1e-3])
def test_a_rest_close_to_its_limit_is_found_by_settling(spare):
    """The current that is left is a thousandth of the voltage's range: the grid of inputs steps over it."""
    p = BENCH | {"Imax": needed(100.0, BENCH) * (1 + spare)}
    u = float(loop(HARD, p).at_rest(100.0, STARTS).u[0])
    assert u == pytest.approx(p["R"] * needed(100.0, p) + p["kt"] * 100.0, abs=1e-5)
    assert np.isnan(loop(HARD, p | {"Imax": needed(100.0, p) * (1 - spare)}).at_rest(100.0, STARTS).u[0])


@pytest.mark.thorough
def test_an_angle_that_turns_on_is_left_out_of_the_search():
    rest = loop(ANGLE, BENCH, BENCH | {"Fc": 0.02}).at_rest(100.0, STARTS)
    truth = [p["R"] * needed(100.0, p) + 4.5 for p in (BENCH, BENCH | {"Fc": 0.02})]
    np.testing.assert_allclose(rest.u, truth, atol=1e-5)


def test_a_position_behind_a_current_limit_is_held_against_its_spring():
    model = equations(
        "i = sat(u/2, -m, m)\nx' = v\nv' = 8*i - 50*x - coulomb(v, 0.5, 0.001) - 3*v\ny = x", inputs=["u"],
        states=["x", "v"], outputs=["y"], parameters=["m"], name="spring",
    )  # fmt: skip
    for level in (-0.5, 0.1, 0.6):
        u = OneLoop(model, "y", "u", {}, {"m": np.array([4.0])}).at_rest(level, (-90.0, 0.0, 100.0)).u[0]
        assert u == pytest.approx(100 * level / 8)


def test_a_search_that_succeeds_at_once_does_not_go_on(monkeypatch):
    monkeypatch.setattr(search, "_first", None)
    monkeypatch.setattr(search, "_grid", None)
    linear = equations("y' = k*u - y\nz = y", inputs=["u"], states=["y"], outputs=["z"], parameters=["k"], name="lag")
    assert OneLoop(linear, "z", "u", {}, {"k": np.ones(2)}).at_rest(3.0, (0.0, 5.0)).u.tolist() == [3.0, 3.0]


@pytest.mark.parametrize("model", [HARD, SOFT])
def test_a_speed_beyond_the_current_limit_is_refused_with_what_can_be_had(model):
    """The fastest speed is that at which friction takes all of the current."""
    one = loop(model, BENCH | {"Imax": 1.0, "iw": 0.03})
    with pytest.raises(SimulationError) as e:
        tuned_loop(one, one, Wishes(500.0, 10.0, 0.1, 0.005, *LIMITS))
    assert str(e.value) == (
        "No constant V was found that holds speed at 490. With a constant V from -24 to 24 speed rests at -225 to 225. "
        "Choose another set point or step."
    )


def test_levels_of_a_schedule_none_of_which_is_held_are_named():
    wishes = Wishes(500.0, 10.0, 0.1, 0.005, *LIMITS, controller="scheduled")
    with pytest.raises(SimulationError) as e:
        _longest(loop(HARD, BENCH | {"Imax": 1.0}), wishes, np.array([500.0, 600.0]))
    said = "No constant V was found that holds speed at any of the levels 500, 600; give others ([control] levels)."
    assert str(e.value) == said


@pytest.mark.thorough
def test_a_level_that_the_settled_output_jumps_over_is_not_said_to_be_held():
    """sign leaves out the levels between -1 and 1."""
    jumps = equations(
        "y' = 0.1*u + k*sign(u) - y\nz = y", inputs=["u"], states=["y"], outputs=["z"], parameters=["k"], name="jump"
    )
    assert np.isnan(OneLoop(jumps, "z", "u", {}, {"k": np.ones(1)}).at_rest(0.5, (-8.0, 0.0, 10.0)).u[0])
