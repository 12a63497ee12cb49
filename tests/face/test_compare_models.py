"""`pf.compare_models` on fits of known plants: a missing dead time loses, two forms of one model are not told apart."""

import numpy as np
import pytest

import plantfit as pf

PERIOD = 0.1


def plant_record(seed, late=0):
    """A first-order plant, gain 2, 0.5 s, whose input comes `late` samples late, with noise of 0.05."""
    draw = np.random.default_rng(seed)
    u = np.repeat(draw.choice([0.0, 1.0], 60), 10)
    x, y = 0.0, []
    for k in range(len(u)):
        y.append(x)
        x = 2.0 * u[max(0, k - late)] + (x - 2.0 * u[max(0, k - late)]) * np.exp(-PERIOD / 0.5)
    measured = np.array(y) + draw.normal(0.0, 0.05, len(u))
    return pf.from_arrays({"t": np.arange(len(u)) * PERIOD, "u": (u, "V"), "y": (measured, "rad/s")}, time="t")


def answer(name, equations, record, **parameters):
    model = pf.equations(
        equations, name=name, inputs={"u": "V"}, states={"x": {"unit": "rad/s", "initial": 0.0}},
        outputs={"y": "rad/s"},
        parameters={k: {"bounds": b, "unit": unit} for k, (b, unit) in parameters.items()},
    )  # fmt: skip
    return pf.fit(pf.Problem(model, record, split=0.6), budget=600)


GAIN, TAU = ((0.1, 10.0), "rad/s/V"), ((0.05, 5.0), "s")


@pytest.mark.thorough
def test_the_model_with_the_dead_time_wins_where_there_is_one():
    record = plant_record(1, late=4)
    plain = answer("plain", "x' = (K*u - x)/tau; y = x", record, K=GAIN, tau=TAU)
    late = answer("late", "x' = (K*delay(u, L) - x)/tau; y = x", record, K=GAIN, tau=TAU, L=((0.0, 2.0), "s"))
    found = pf.compare_models({"plain": plain, "late": late})
    assert found.best == "late"
    difference, half = found.difference("late", "plain")
    assert difference > half > 0.0
    rows = {r["model"]: r for r in found.to_frame().to_dicts()}
    assert rows["late"]["rmse_unseen"] == pytest.approx(0.05, rel=0.2)
    assert rows["linear"]["rmse_unseen"] == pytest.approx(0.05, rel=0.3)  # it may have a dead time, too
    assert "late" in repr(found)


@pytest.mark.thorough
def test_two_forms_of_one_model_are_not_told_apart():
    record = plant_record(2)
    one = answer("one", "x' = (K*u - x)/tau; y = x", record, K=GAIN, tau=TAU)
    other = answer("other", "x' = a*u - b*x; y = x", record, a=((0.05, 50.0), "rad/s^2/V"), b=((0.1, 20.0), "1/s"))
    found = pf.compare_models({"one": one, "other": other})
    assert found.best is None
    assert abs(found.difference("one", "other")[0]) < 1e-3


def test_models_of_other_data_are_refused():
    one = answer("one", "x' = (K*u - x)/tau; y = x", plant_record(3), K=GAIN, tau=TAU)
    other = answer("other", "x' = (K*u - x)/tau; y = x", plant_record(4), K=GAIN, tau=TAU)
    with pytest.raises(pf.PlantfitError, match=r"same data|differ"):
        pf.compare_models([one, other])
