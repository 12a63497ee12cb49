"""Answers that are one model, and answers that only look alike."""

from functools import cache

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.models import equations
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.study.comparing.symmetry import same_by_symmetry

T = np.linspace(0.0, 3.0, 40)
BOX = (-5.0, 5.0)


@cache
def problem(text: str, names: str, outputs=("y",), units=(), **bounds) -> Problem:
    """A static model of u = 0 .. 3 with these parameters between -5 and 5, or between `bounds`."""
    units = dict(units)
    declared = {n: {"bounds": bounds.get(n, BOX), "unit": units.get(n)} for n in names.split()}
    signals = {"u": Signal(T), **{o: Signal(np.cos((k + 1) * T)) for k, o in enumerate(outputs)}}
    return Problem(
        equations(text, inputs=["u"], outputs=list(outputs), parameters=declared, check=False), Recording(T, signals)
    )


def found(p: Problem, first, second):
    return same_by_symmetry(p, p.space.cube(np.array(first, dtype=float)), p.space.cube(np.array(second, dtype=float)))


TWO = "y = b1*exp(-b2*u) + b3*exp(-b4*u)"
THREE = "y = a1*exp(-((u-c1)/w1)**2) + a2*exp(-((u-c2)/w2)**2) + a3*exp(-((u-c3)/w3)**2)"
NINE = "a1 c1 w1 a2 c2 w2 a3 c3 w3"


@pytest.mark.parametrize(
    ("p", "first", "second", "sentence"),
    [
        (problem(TWO, "b1 b2 b3 b4"), [1, 2, 3, 0.5], [3, 0.5, 1, 2], "b1, b2 and b3, b4 can be exchanged: same model"),
        # amplitudes that are nearly equal: where they stand already does not decide which term they belong to
        (problem(TWO, "b1 b2 b3 b4"), [1, 2, 1.01, 0.5], [1.01, 0.5, 1, 2],
         "b1, b2 and b3, b4 can be exchanged: same model"),
        # answers of searches are not exact
        (problem(TWO, "b1 b2 b3 b4"), [1, 2, 3, 0.5], [3.0004, 0.5001, 0.9999, 2.0002],
         "b1, b2 and b3, b4 can be exchanged: same model"),
        (problem(THREE, NINE), [1, 0.5, 0.3, 2, 1.5, 0.4, 3, 2.5, 0.6], [2, 1.5, 0.4, 1, 0.5, 0.3, 3, 2.5, 0.6],
         "a1, c1, w1 and a2, c2, w2 can be exchanged: same model"),
        (problem(THREE, NINE), [1, 0.5, 0.9, 2, 1.5, 1.4, 3, 2.5, 2.6], [3, 2.5, 2.6, 1, 0.5, 0.9, 2, 1.5, 1.4],
         "a1, c1, w1, a2, c2, w2 and a3, c3, w3 can be exchanged: same model"),
        (problem("y = a*exp(-(u/w)**2) + c", "a w c"), [2, 1, 0.3], [2, -1, 0.3],
         "the sign of w does not matter: same model"),
        (problem("y = a*exp(-(u/w)**2) + c", "a w c"), [2, 1, 0.0], [2, -1, 0.0],
         "the sign of w does not matter: same model"),
        (problem("y = a*sin(b*u) + c", "a b c"), [2, 1, 0.3], [-2, -1, 0.3],
         "a and b can change sign together: same model"),
        (problem("y = a*b*u", "a b"), [3, 1], [1, 3], "a and b can be exchanged: same model"),
        (problem("y = (a-b)**2*u", "a b"), [3, 1], [1, 3], "a and b can be exchanged: same model"),
        (problem("y = (a-b)*(a+2*b)*u", "a b"), [3, 1], [-3, -1], "a and b can change sign together: same model"),
        # bounds of the terms overlap only in part
        (problem(TWO, "b1 b2 b3 b4", b1=(0.0, 4.0), b3=(0.5, 9.0)), [1, 2, 3, 0.5], [3, 0.5, 1, 2],
         "b1, b2 and b3, b4 can be exchanged: same model"),
        (problem("y = a*u + b*u**2\nw = abs(a - 3)*0 + a + b*u", "a b", ("y", "w")), [1, 2], [2, 1], None),
        (problem("y = exp(-a*u) + exp(-b*u)\nw = a*b + u", "a b", ("y", "w")), [1, 2], [2, 1],
         "a and b can be exchanged: same model"),
    ],
)  # fmt: skip
@pytest.mark.further(2)
def test_one_model_written_twice(p, first, second, sentence):
    map_ = found(p, first, second)
    assert (map_ and map_.sentence) == sentence
    if map_ is not None:
        np.testing.assert_allclose(map_(np.array(first, dtype=float)), second, rtol=1e-2, atol=1e-12)
        rng = np.random.default_rng(7)
        for z in p.space.cube(rng.uniform(0.6, 3.9, (5, p.space.dimension))):
            image = p.space.cube(map_(np.asarray(p.space.physical(z))))
            np.testing.assert_allclose(p.residuals(image), p.residuals(z), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("p", "first", "second"),
    [
        # values are exchanged, the model is another: a term that has one of them alone, a power, a factor, an offset
        (problem(TWO.replace("b4*u", "b4*u") + " + 1e-4*b1", "b1 b2 b3 b4"), [1, 2, 3, 0.5], [3, 0.5, 1, 2]),
        (problem("y = b1*exp(-b2*u) + b3*exp(-b4*u**2)", "b1 b2 b3 b4"), [1, 2, 3, 0.5], [3, 0.5, 1, 2]),
        (problem("y = b1*exp(-b2*u) + 1.0001*b3*exp(-b4*u)", "b1 b2 b3 b4"), [1, 2, 3, 0.5], [3, 0.5, 1, 2]),
        (problem("y = a*u + b*u**2", "a b"), [3, 1], [1, 3]),
        (problem("y = a/(b**2 + 1)*u", "a b"), [3, 1], [1, 3]),
        # only half of a term is exchanged
        (problem(TWO, "b1 b2 b3 b4"), [1, 2, 3, 0.5], [3, 2, 1, 0.5]),
        # other values, not exchanged ones
        (problem(TWO, "b1 b2 b3 b4"), [1, 2, 3, 0.5], [3, 0.5, 2, 2]),
        # signs that matter
        (problem("y = a*exp(-u/w) + c", "a w c"), [2, 1, 0.3], [2, -1, 0.3]),
        (problem("y = a*sin(b*u) + c", "a b c"), [2, 1, 0.3], [-2, 1, 0.3]),
        (problem("y = a*b*u + 0.001*a", "a b"), [2, 1], [-2, -1]),
        # the sign is lost over most of the box and matters at the answer: a switch, a limit
        (problem("y = w**2*u if w**2 > 0.01 else w*u", "w", w=(-50.0, 50.0)), [4.0], [4.1]),
        (problem("y = (w if abs(w) < 3 else 3.0)*u", "w", w=(-500.0, 500.0)), [2.0], [-2.0]),
        # the same in one output, not in the other
        (problem("y = exp(-a*u) + exp(-b*u)\nw = a*u", "a b", ("y", "w")), [1, 2], [2, 1]),
        # the two outputs change places, and they measure different things
        (problem("y = exp(-a*u)\nw = exp(-b*u)", "a b", ("y", "w")), [1, 2], [2, 1]),
        # values alike in other units
        (problem("y = a*b*u", "a b", units=(("a", "V"), ("b", "ohm"))), [3, 1], [1, 3]),
    ],
)
@pytest.mark.further(8)
def test_answers_that_only_look_alike(p, first, second):
    assert found(p, first, second) is None


def test_an_answer_is_not_compared_with_itself():
    p = problem(TWO, "b1 b2 b3 b4")
    assert found(p, [1, 2, 3, 0.5], [1.001, 2, 3, 0.5]) is None


def test_a_moving_model_whose_poles_change_places():
    """x1 and x2 in parallel: the sum does not tell which is which; seen apart they are told."""
    t = np.linspace(0.0, 20.0, 80)
    u = np.where(t > 2.0, 1.0, 0.0)
    rec = Recording(t, {"u": Signal(u), "y": Signal(u), "w": Signal(u)})
    declared = {n: {"bounds": (0.1, 10.0), "scale": "log"} for n in ("K1", "T1", "K2", "T2")}
    text = "x1' = (K1*u - x1)/T1\nx2' = (K2*u - x2)/T2\ny = x1 + x2"
    for more, outputs, same in (("", ["y"], True), ("\nw = x1", ["y", "w"], False)):
        model = equations(text + more, inputs=["u"], states=["x1", "x2"], outputs=outputs, parameters=declared)
        p = Problem(model, rec, substeps=2)
        map_ = found(p, [1, 0.5, 2, 3], [2, 3, 1, 0.5])
        assert (map_ is not None) == same
        assert map_ is None or map_.sentence == "K1, T1 and K2, T2 can be exchanged: same model"
