"""A sensor of the input with an offset: a cell whose charge is counted from its current. The truth is computed here."""

import numpy as np
import pytest

import plantfit as pf
from plantfit.trust.diagnosis import diagnose

EQUATIONS = """
s' = -i/Q
v1' = i/C1 - v1/tau1
v = a + b*s + c*s^2 - R0*i - v1
"""
TRUTH = {"Q": 9000.0, "C1": 1500.0, "tau1": 60.0, "R0": 0.03, "s0": 0.8}
CURVE = {"a": 3.3, "b": 0.5, "c": 0.35}


def cell(seed: int, offset_i: float = 0.0, offset_v: float = 0.0) -> pf.Problem:
    """A drive cycle of 50 min at 2 s, whose sensors show these offsets (A, V) too much."""
    draw = np.random.default_rng(seed)
    t = np.arange(0.0, 3000.0, 2.0)
    i = np.round(np.repeat(1.2 + 2.5 * draw.normal(size=150), 10), 2)
    s = TRUTH["s0"] - np.r_[0.0, np.cumsum(i[:-1] * 2.0)] / TRUTH["Q"]
    v1, keeps = np.zeros(len(t)), np.exp(-2.0 / TRUTH["tau1"])
    for k in range(len(t) - 1):
        v1[k + 1] = keeps * v1[k] + (1 - keeps) * i[k] * TRUTH["tau1"] / TRUTH["C1"]
    v = CURVE["a"] + CURVE["b"] * s + CURVE["c"] * s**2 - TRUTH["R0"] * i - v1
    v = np.round((v + offset_v + 5e-4 * draw.normal(size=len(t))) / 1e-3) * 1e-3
    model = pf.equations(
        EQUATIONS,
        inputs={"i": "A"},
        states={"s": {"unit": "", "initial": "s0"}, "v1": "V"},
        outputs={"v": "V"},
        constants={"a": "3.3 V", "b": "0.5 V", "c": "0.35 V"},
        parameters={
            "Q": {"unit": "A*s", "bounds": (3000, 30000)},
            "C1": {"unit": "F", "bounds": (300, 8000)},
            "tau1": {"unit": "s", "bounds": (5, 500)},
            "R0": {"unit": "ohm", "bounds": (0.001, 0.2)},
            "s0": {"unit": "", "bounds": (0.1, 1)},
        },
    )
    recording = pf.from_arrays({"t": t, "i": (i + offset_i, "A"), "v": (v, "V")}, name="cell")
    return pf.Problem(model, recording, split=0.7)


def found_of(problem: pf.Problem) -> list[tuple[str, float | None]]:
    found = diagnose(problem, pf.fit(problem).best.x)
    return [(t.extension.name, t.value) for one in found.rounds for t in one.found]


@pytest.mark.parametrize(
    ("seed", "offset"),
    [pytest.param(1, 0.06, marks=pytest.mark.slow), (2, -0.06), pytest.param(3, 0.12, marks=pytest.mark.slow)],
)
@pytest.mark.thorough
def test_an_offset_of_the_current_is_named_with_its_size(seed, offset):
    named = dict(found_of(cell(seed, offset_i=offset)))
    assert named["offset of i"] == pytest.approx(offset, abs=0.015)
    assert all("change" not in n and "drift" not in n for n in named), named


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_no_offset_of_the_current_is_named_where_there_is_none(seed):
    assert found_of(cell(seed)) == []


@pytest.mark.thorough
def test_an_offset_of_the_voltage_is_not_one_of_the_current():
    named = dict(found_of(cell(1, offset_v=0.02)))
    assert "offset of i" not in named
    assert named.get("offset of v", 0.02) == pytest.approx(0.02, abs=0.004)
