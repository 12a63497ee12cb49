"""`pieces` cut the fitted part of a recording into recordings with starts of their own, and a start may be given for
each."""

import numpy as np
import pytest

from plantfit import spec
from plantfit.errors import PlantfitError

STUDY = """name = "cut"
[recording.run]
file = "run.csv"
{more}
[model]
equations = "x' = -a*x + u\\ny = x"
inputs = ["u"]
states = {{ x = {{ initial = "x0" }} }}
outputs = ["y"]
[parameters.a]
bounds = [0.1, 10]
[parameters.x0]
bounds = [-5, 5]
per_recording = true
{starts}
"""


@pytest.fixture
def write(tmp_path):
    def write(more: str = "", starts: str = "", t: np.ndarray | None = None):
        t = np.arange(0, 10, 0.1) if t is None else t
        np.savetxt(
            tmp_path / "run.csv",
            np.c_[t, np.sign(np.sin(t)), np.sin(t)],
            delimiter=",",
            header="t [s],u,y",
            comments="",
        )
        file = tmp_path / "cut.toml"
        file.write_text(STUDY.format(more=more, starts=starts), "utf-8")
        return file

    return write


@pytest.mark.parametrize(("seconds", "count"), [(1.0, 10), (2.4, 4), (3.0, 3), (40.0, 1)])
def test_every_fitted_sample_is_in_one_piece(write, seconds, count):
    """Pieces are equally long to a sample, and their names say which they are."""
    experiments = spec.load(write(f"pieces = {seconds}")).problem.experiments
    assert list(experiments) == [f"run-{k}" for k in range(1, count + 1)]
    assert np.array_equal(np.concatenate([e.recording.t for e in experiments.values()]), np.arange(0, 10, 0.1))
    assert np.ptp([len(e.recording) for e in experiments.values()]) <= 1
    assert all(e.recording.name == n for n, e in experiments.items())


def test_pieces_of_uneven_samples_and_of_a_part(write):
    """Of samples at random times none is lost, and what is not fitted is in no piece."""
    t = np.sort(np.random.default_rng(0).uniform(0, 10, 300))
    experiments = spec.load(write("pieces = 0.7\nfit = [2.0, 9.0]", t=t)).problem.experiments
    kept = np.concatenate([e.recording.t for e in experiments.values()])
    assert np.allclose(kept, t[(t >= 2) & (t <= 9)], atol=1e-12)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("pieces = 1\nsplit = 0.5", "leave one of them out"),
        ("pieces = 1\nfit = [0, 5]\nvalidate = [6, 9]", "pieces"),
        ("pieces = 1\ninitial_time = -1", "initial_time"),
        ("pieces = 0.1", "give a longer time"),
        ("pieces = 0", "pieces"),
        ('pieces = 5\n[recording.run-2]\nfile = "run.csv"', "rename one of them"),
    ],
)
def test_pieces_that_cannot_be_are_refused_in_a_sentence(write, more, said):
    with pytest.raises(PlantfitError, match=said):
        spec.load(write(more))


def test_a_start_for_each_recording(write):
    """Recordings without one begin in the middle."""
    space = spec.load(write("pieces = 5", "start = { run-2 = 2.5 }")).problem.space
    assert space.physical(space.start)[1:] == pytest.approx([0.0, 2.5])


@pytest.mark.parametrize(
    ("starts", "said"),
    [
        ("start = { run-3 = 1 }", "no recording 'run-3'"),
        ("start = { run-2 = 9 }", "outside its bounds"),
        ("start = { run-1 = 1 }\n[parameters.b]\nbounds = [0, 1]\nstart = { run-1 = 1 }", "b"),
        ('start = { run-1 = "1" }', "without quotation marks"),
    ],
)
def test_starts_that_cannot_be_are_refused_in_a_sentence(write, starts, said):
    with pytest.raises(PlantfitError, match=said):
        _ = spec.load(write("pieces = 5", starts)).problem.space.start


def test_a_value_for_all_has_one_start(write):
    file = write("pieces = 5")
    file.write_text(
        file.read_text("utf-8").replace("bounds = [0.1, 10]", "bounds = [0.1, 10]\nstart = { run-1 = 1 }"), "utf-8"
    )
    with pytest.raises(PlantfitError, match="per_recording is false"):
        _ = spec.load(file).problem.space.start
