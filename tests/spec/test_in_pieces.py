"""A study file written anew in pieces: where they begin holds the truth, and all else stays."""

import tomllib

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plantfit import spec
from plantfit.errors import SpecError

TEXT = """# a driven double well
name = "well"
[recording.run]
file = "run.csv"
{more}
[model]
equations = "x' = v\\nv' = b*x - c*x^3 - 0.3*v + u\\ny = x"
inputs = ["u"]
states = {{ x = {{ initial = "{initial}" }}, v = {{}} }}
outputs = ["y"]
[parameters.b]
bounds = [0.1, 10]  # unknown
[parameters.c]
bounds = [0.1, 10]
[search]
methods = ["pso"]
budget = 3000
"""


def truth(t):
    """Position and velocity (n, 2) under u(t) = 0.5 cos(1.2 t) held between samples."""
    x, rows = np.array([1.0, 0.0]), []
    for u in 0.5 * np.cos(1.2 * t):
        rows.append(x)
        x = solve_ivp(
            lambda s, x, u=u: [x[1], x[0] - x[0] ** 3 - 0.3 * x[1] + u], (0, t[1]), x, rtol=1e-9, atol=1e-10
        ).y[:, -1]
    return np.array(rows)


@pytest.fixture
def write(tmp_path):
    def write(initial="y", more="", span=60.0, text=TEXT):
        t = np.arange(0, span, 0.1)
        y = truth(t)[:, 0] + 0.01 * np.random.default_rng(2).normal(size=len(t))
        for name, rows in (("run", slice(None)), ("short", slice(0, 80))):
            data = np.c_[t, 0.5 * np.cos(1.2 * t), y][rows]
            np.savetxt(tmp_path / f"{name}.csv", data, delimiter=",", header="t [s],u,y", comments="")
        file = tmp_path / "well.toml"
        file.write_text(text.format(initial=initial, more=more), "utf-8")
        return spec.load(file)

    return write


@pytest.mark.parametrize("initial", ["y", pytest.param("0", marks=pytest.mark.slow)])
def test_starts_lie_within_their_bounds(write, initial):
    """Of a state that begins at the measured output the noise of that sample does, of others the states of the plant
    do."""
    study = write(initial)
    new = spec.parse(spec.in_pieces(study, 10.0), study.path)
    experiments = new.problem.experiments
    assert list(experiments) == [f"run-{k}" for k in range(1, 7)]
    states, p = truth(study.problem.experiments["run"].recording.t), new.problem.space.parameters
    at = [round(10 * e.recording.t[0]) for e in experiments.values()]
    measured = np.array([e.recording["y"][0] for e in experiments.values()])
    for k, name in enumerate(("x", "v")):
        low, high = p[f"start_{name}"].bounds or (np.inf, -np.inf)
        begin = states[at, k] - (measured if initial == "y" and name == "x" else 0.0)
        assert low < begin.min() < begin.max() < high
        assert p[f"start_{name}"].per_recording
        assert high - low < (0.3 if initial == "y" and name == "x" else 10.0)


def test_all_else_stays(write):
    study = write(more='[recording.short]\nfile = "short.csv"')
    text = spec.in_pieces(study, 12)
    assert "# a driven double well" in text
    assert "bounds = [0.1, 10]  # unknown" in text
    found = tomllib.loads(text)
    assert found["name"] == "well in pieces"
    # no longer than a piece
    assert found["recording"] == {"run": {"file": "run.csv", "pieces": 12}, "short": {"file": "short.csv"}}
    assert found["search"] == {"budget": 3000, "shooting": 5}
    assert found["parameters"]["start_v"] == {"per_recording": True}


@pytest.mark.parametrize(
    "given", ["split = 0.7", pytest.param("fit = [0, 42]\nvalidate = [42, 60]", marks=pytest.mark.slow)]
)
@pytest.mark.thorough
def test_the_unseen_part_is_left_out(write, given):
    """`plantfit init` writes `split = 0.7`, and the verdict gives the command for such a file."""
    study = write(more=given)
    found = spec.parse(spec.in_pieces(study, 10.0), study.path)
    table = tomllib.loads(found.text)["recording"]
    assert table["run"] == {"file": "run.csv", "pieces": 10, "fit": [0.0, 41.9]}
    assert list(found.problem.experiments) == ["run-1", "run-2", "run-3", "run-4"]


CUT = """pieces = 10
[model.extensions]
start = { x = [-1, 1] }
[parameters.start_x]
per_recording = true"""
STATIC = """name = "well"
[recording.run]
file = "run.csv"
[model]
equations = "y = b*u + c"
inputs = ["u"]
outputs = ["y"]
[parameters.b]
bounds = [0.1, 10]
[parameters.c]
bounds = [0.1, 10]
"""


@pytest.mark.parametrize(
    ("changes", "seconds", "said"),
    [
        ({}, 100.0, "no recording lasts longer than 100 s, the longest 59.9 s"),
        ({}, 0.0, "--pieces 0 cannot be used; give seconds above 0"),
        ({}, float("nan"), "--pieces nan cannot be used"),
        ({}, 0.1, "cannot be cut into pieces of 0.1 s"),
        ({"more": CUT}, 5.0, "is in pieces or has starts already"),
        ({"more": "initial_time = -1.0"}, 10.0, "cannot be cut into pieces of 10 s"),
        ({"text": STATIC}, 10.0, "no states that could begin anew"),
    ],
)
def test_what_cannot_be_cut_is_told(write, changes, seconds, said):
    study = write(**changes)
    with pytest.raises(SpecError) as error:
        spec.in_pieces(study, seconds)
    assert said in str(error.value)
    assert "well.toml" in str(error.value) or "--pieces" in str(error.value)
