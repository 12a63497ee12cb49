"""The thermal isomerization of alpha-pinene (R. E. Fuguitt, J. E. Hawkins, J. Am. Chem. Soc. 69 (1947) 319; the model
of W. G. Hunter and J. F. MacGregor): problem 5 of the COPS collection (E. D. Dolan, J. J. More, T. S. Munson,
ANL/MCS-TM-273, 2004), whose least sum of squares is 19.872."""

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, equations
from plantfit.fitting import fit

TIMES = [0.0, 1230.0, 3060.0, 4920.0, 7800.0, 10680.0, 15030.0, 22620.0, 36420.0]  # s
SHARES = {  # percent
    "y1": [100.0, 88.35, 76.4, 65.1, 50.4, 37.5, 25.9, 14.0, 4.5],
    "y2": [0.0, 7.3, 15.6, 23.1, 32.9, 42.7, 49.1, 57.4, 63.1],
    "y3": [0.0, 2.3, 4.5, 5.3, 6.0, 6.0, 5.9, 5.1, 3.8],
    "y4": [0.0, 0.4, 0.7, 1.1, 1.5, 1.9, 2.2, 2.6, 2.9],
    "y5": [0.0, 1.75, 2.8, 5.8, 9.3, 12.0, 17.0, 21.0, 25.7],
}
MODEL = """
x1' = -(k1 + k2)*x1
x2' = k1*x1
x3' = k2*x1 - (k3 + k4)*x3 + k5*x5
x4' = k3*x3
x5' = k4*x3 - k5*x5
y1 = x1
y2 = x2
y3 = x3
y4 = x4
y5 = x5
"""
OPTIMUM = {"k1": 5.9259e-5, "k2": 2.9634e-5, "k3": 2.0473e-5, "k4": 27.449e-5, "k5": 3.9980e-5}  # 1/s


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.thorough
def test_a_fit_in_five_decades_ends_in_the_published_optimum(seed):
    states = {f"x{k}": {"initial": 100.0 if k == 1 else 0.0} for k in range(1, 6)}
    model = equations(MODEL, states=states, outputs=list(SHARES), parameters=list(OPTIMUM))
    record = Recording(np.array(TIMES), {y: Signal(np.array(s)) for y, s in SHARES.items()}, "run")
    bounds = {k: Parameter((1e-7, 1e-2), scale="log") for k in OPTIMUM}
    answer = fit(Problem(model, record, bounds, scales=dict.fromkeys(SHARES, 1.0)), seed=seed)
    assert sum(float(np.sum(np.square(r))) for r in answer.residuals["run"].values()) == pytest.approx(19.872, abs=2e-3)
    assert dict(answer.values) == pytest.approx(OPTIMUM, rel=1e-3)
