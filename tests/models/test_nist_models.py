"""The NIST StRD models as text: the certified parameters must give the certified residual sum of squares."""

import re
from pathlib import Path

import numpy as np
import pytest

from plantfit.models import equations

FOLDER = Path(__file__).parent / "nist_strd"

MODELS = {
    "BoxBOD": "y = b1*(1 - exp(-b2*x))",
    "Chwirut2": "y = exp(-b1*x) / (b2 + b3*x)",
    "DanWood": "y = b1*x^b2",
    "Gauss1": "y = b1*exp(-b2*x) + b3*exp(-(x - b4)^2/b5^2) + b6*exp(-(x - b7)**2/b8**2)",
    "Lanczos3": "y = b1*exp(-b2*x) + b3*exp(-b4*x) + b5*exp(-b6*x)",
    "MGH09": "top = x^2 + x*b2\ny = b1*top / (x^2 + x*b3 + b4)",
    "Misra1a": "y = b1*(1 - exp(-b2*x))",
    "Thurber": """
        top = b1 + b2*x + b3*x^2 + b4*x^3     # cubic over cubic
        y = top / (1 + b5*x +
                   b6*x^2 + b7*x^3)
    """,
}


def read(name):
    """Certified parameters, residual sum of squares, x and y of a file."""
    text = (FOLDER / f"{name}.dat").read_text()
    certified = {m[1]: float(m[2]) for m in re.finditer(r"^ *(b\d) = +\S+ +\S+ +(\S+) +\S+ *$", text, re.MULTILINE)}
    match = re.search(r"Residual Sum of Squares: +(\S+)", text)
    assert match is not None
    y, x = np.loadtxt(text.splitlines()[60:], unpack=True)
    return certified, float(match[1]), x, y


@pytest.mark.parametrize("name", MODELS)
def test_certified_residual_sum_of_squares(name):
    certified, expected, x, y = read(name)
    model = equations(MODELS[name], inputs=["x"], outputs=["y"], parameters=list(certified))
    assert model.derivative is None
    assert tuple(p.name for p in model.parameters) == tuple(certified)
    found = np.asarray(model.output({}, {"x": x, "t": x * 0}, certified)["y"])
    # Lanczos3: the sum of squares is 1e-8, and the certified parameters have eleven digits
    assert np.sum((y - found) ** 2) == pytest.approx(expected, rel=1e-9 if name != "Lanczos3" else 1e-5)
