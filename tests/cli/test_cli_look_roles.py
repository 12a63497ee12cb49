"""`plantfit look` at a file says of which columns it is not sure what they are."""

import numpy as np
import pytest
from cli_call import call


@pytest.mark.parametrize(
    ("names", "asked", "doubted"),
    [
        (("i [A]", "x [um]"), (), True),  # of a magnetic bearing: a current may be measured, and x anything
        (("i [A]", "x [um]"), ("--input", "i", "--output", "x"), False),
        (("u [V]", "y [rpm]"), (), False),
    ],
)
def test_a_column_whose_role_is_a_guess_is_named(tmp_path, monkeypatch, capsys, names, asked, doubted):
    monkeypatch.chdir(tmp_path)
    rng, n = np.random.default_rng(1), 400
    # both move gradually, so that only their names tell, or nothing does
    u = np.repeat(rng.uniform(-1, 1, n // 20), 20) if not doubted else np.sin(np.arange(n) / 9) + rng.normal(0, 0.02, n)
    y = np.zeros(n)
    for k in range(n - 1):
        y[k + 1] = 0.9 * y[k] + u[k]
    table = np.column_stack([0.01 * np.arange(n), u, y + rng.normal(0, 0.05, n)])
    np.savetxt("run.csv", table, delimiter=",", header=",".join(("t [s]", *names)), comments="", fmt="%.6g")
    said = call(capsys, monkeypatch, "look", "run.csv", *asked).out
    assert ("Not sure of" in said) is doubted
    assert ("name inputs with --input and outputs with --output." in " ".join(said.split())) is doubted
