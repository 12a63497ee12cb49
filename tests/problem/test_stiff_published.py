"""Stiff problems with published end values: what is simulated with default steps at given values is exact, or it is
said that it is not.

Values from the Test Set for IVP Solvers (F. Mazzia, C. Magherini, release 2.4, 2008). Measured samples are those of
scipy's Radau.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plantfit.models import equations
from plantfit.problem import Problem
from plantfit.problem.accuracy.step_errors import largest_step_error
from plantfit.problem.accuracy.steps import _adaptive, choose_substeps, steps_and_error
from plantfit.recording.record import Recording, Signal
from plantfit.simulate.simulator import ADAPTIVE

HIRES = """y1' = -1.71*y1 + 0.43*y2 + 8.32*y3 + 0.0007
y2' = 1.71*y1 - 8.75*y2
y3' = -10.03*y3 + 0.43*y4 + 0.035*y5
y4' = 8.32*y2 + 1.71*y3 - 1.12*y4
y5' = -1.745*y5 + 0.43*y6 + 0.43*y7
y6' = -k*y6*y8 + 0.69*y4 + 1.71*y5 - 0.43*y6 + 0.69*y7
y7' = k*y6*y8 - 1.81*y7
y8' = -k*y6*y8 + 1.81*y7"""
ROBERTSON = """y1' = -k*y1 + 1e4*y2*y3
y2' = k*y1 - 1e4*y2*y3 - 3e7*y2^2
y3' = 3e7*y2^2"""
OREGONATOR = """y1' = 77.27*(y2 + y1*(1 - k*y1 - y2))
y2' = (y3 - (1 + y1)*y2)/77.27
y3' = 0.161*(y1 - y3)"""
POL = """y1' = y2
y2' = ((1 - y1^2)*y2 - y1)/k"""
CASES = {
    "hires": (HIRES, 280.0, [1, 0, 0, 0, 0, 0, 0, 0.0057], [0, 1, 10, 100, 321.8122],
              [7.371312573325668e-4, 1.442485726316185e-4, 5.888729740967575e-5, 1.175651343283149e-3,
               2.386356198831331e-3,
               6.238968252742796e-3, 2.849998395185769e-3, 2.850001604814231e-3]),
    "robertson": (ROBERTSON, 0.04, [1, 0, 0], [0, 0.4, 4, 40, 400, 4e3, 4e4, 4e5, 4e6, 4e7, 4e8, 4e9, 4e10, 1e11],
                  [2.083340149701255e-8, 8.333360770334713e-14, 0.9999999791665050]),
    "oregonator": (OREGONATOR, 8.375e-6, [1, 2, 3], [0, 30, 60, 90, 120, 180, 240, 300, 360],
                   [1.000814870318523, 1228.178521549917, 132.0554942846706]),
    "van der Pol": (POL, 1e-6, [2, 0], [0, 0.5, 1, 1.5, 2], [1.706167732170483, -0.8928097010247975]),
}  # fmt: skip


def made(name):
    text, k, start, times, _ = CASES[name]
    names = [f"y{i + 1}" for i in range(len(start))]
    rows = [compile(line.split("=")[1].strip().replace("^", "**"), name, "eval") for line in text.splitlines()]

    def rate(t, y):
        return [eval(row, {"k": k, **dict(zip(names, y, strict=True))}) for row in rows]

    t = np.array(times, dtype=float)
    exact = solve_ivp(rate, (0.0, t[-1]), np.array(start, dtype=float), "Radau", t_eval=t, rtol=1e-9, atol=1e-15).y
    model = equations(
        text, inputs=[], states={n: {"initial": float(v)} for n, v in zip(names, start, strict=True)}, outputs=names,
        parameters={"k": {"bounds": (0.3 * k, 3.0 * k)}}, check=False,
    )  # fmt: skip
    problem = Problem(model, Recording(t, {n: Signal(y) for n, y in zip(names, exact, strict=True)}))
    return problem, np.asarray(problem.space.cube(np.array([k]))), exact


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in ("hires", "oregonator", "robertson") else n for n in CASES]
)
@pytest.mark.thorough
def test_simulated_at_given_values(name):
    problem, z, exact = made(name)
    shown, error = steps_and_error(choose_substeps(problem), z)
    assert error is None
    y = shown.predict(np.array([CASES[name][1]]))
    for output, own, end in zip(problem.outputs, exact, CASES[name][4], strict=True):
        width = np.ptp(own)
        assert np.max(np.abs(y[output] - own)) < 1e-3 * width, output
        assert abs(own[-1] - end) < 1e-6 * width, output  # scipy's are those that are published
        assert abs(y[output][-1] - end) < 1e-3 * width, output


@pytest.mark.thorough
def test_a_fineness_that_rounding_does_not_allow_gives_way_to_a_coarser_one():
    problem, z, _ = made("robertson")
    fine = _adaptive(problem, lambda *_: 0.0, z[None, :], 1.0, 64)
    assert not np.isfinite(largest_step_error(fine, z))
    chosen = _adaptive(problem, largest_step_error, z[None, :], 1e-3, 64)
    stepper = chosen.predictor.stepping()
    assert stepper.stepper == ADAPTIVE
    assert 1 <= stepper.substeps < 64
    assert largest_step_error(chosen, z) < 1e-3
