"""Filtering both sides of a regression alike."""

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import RecordingError, SpecError
from plantfit.fitting import fit
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Declared
from plantfit.problem.measure.filter_alike import filter_alike
from plantfit.spec import load

T = np.arange(4000) * 0.002
TRUE = {"J": 0.05, "Fc": 0.2}


def model(target="tau"):
    return LinearModel(
        name="joint",
        outputs={target: "N*m"},
        parameters=(Declared("J", "kg*m^2", (0.0, 1.0)), Declared("Fc", "N*m", (0.0, 1.0))),
        regressor=lambda s: np.stack([s["a"], np.sign(s["w"])], axis=1),
        signals={"w": "rad/s", "a": "rad/s^2"},
    )


def record(noise=0.0, t=T):
    w, a = 3 * np.sin(9 * t) + np.sin(4 * t), 27 * np.cos(9 * t) + 4 * np.cos(4 * t)
    tau = TRUE["J"] * a + TRUE["Fc"] * np.sign(w) + noise * np.random.default_rng(1).standard_normal(len(t))
    return rec.from_arrays(t, signals={"w": (w, "rad/s"), "a": (a, "rad/s^2"), "tau": (tau, "N*m")})


def solved(m, r):
    return np.linalg.lstsq(m.columns({n: r[n] for n in m.signals}), r["tau"], rcond=None)[0]


def test_both_sides_filtered_alike_keep_the_parameters():
    made, recordings = filter_alike(model(), {"run": record()}, 5.0, every=5)
    np.testing.assert_allclose(solved(made, recordings["run"]), list(TRUE.values()), rtol=1e-9)
    assert len(recordings["run"]) == len(range(50, 3950, 5))
    assert "filtered alike" in recordings["run"].log[-1]


def test_filtering_the_motion_first_biases_dry_friction():
    r = record()
    for name in ("w", "a", "tau"):
        r = rec.lowpass(r, name, 5.0, order=3)
    error = np.abs(solved(model(), rec.cut(r, 0.2, 7.8)) - list(TRUE.values()))
    assert error[1] > 0.01 * TRUE["Fc"], "otherwise parallel filtering would not be needed"


def test_noise_shrinks_with_the_bandwidth():
    sizes = [np.std(filter_alike(model(), {"run": record(0.1)}, fc)[1]["run"]["tau"] -
                    filter_alike(model(), {"run": record()}, fc)[1]["run"]["tau"]) for fc in (5.0, 20.0)]  # fmt: skip
    assert sizes[1] / sizes[0] == pytest.approx(2.0, rel=0.15)


def test_what_cannot_be_filtered():
    with pytest.raises(RecordingError, match="even steps"):
        filter_alike(model(), {"run": record(t=T + 0.0009 * np.random.default_rng(0).random(len(T)))}, 5.0)
    with pytest.raises(RecordingError, match="nothing is left"):
        filter_alike(model(), {"run": record()}, 5.0, drop=4.0)
    with pytest.raises(RecordingError, match="whole number"):
        filter_alike(model(), {"run": record()}, 5.0, every=0)


STUDY = """
name = "joint"

[recording.run]
file = "run.csv"
time = "t"
clean = [{{ step = "smooth_motion", signal = "position", velocity = "velocity", acceleration = "acceleration", cutoff = 60.0 }}]

[model]
{model}
filter_alike = {{ cutoff = {cutoff}, every = 5 }}

[search]
seed = 1
"""  # noqa: E501
DRIVE = 'kind = "drive_regression"\n'


def written(folder, model=DRIVE, cutoff=5.0):
    x = -np.cos(9 * T) / 3 - np.cos(4 * T) / 4
    v, a = 3 * np.sin(9 * T) + np.sin(4 * T), 27 * np.cos(9 * T) + 4 * np.cos(4 * T)
    force = 80 * a + 150 * v + 30 * np.sign(v) - 4
    np.savetxt(
        folder / "run.csv", np.stack([T, x, force], axis=1), delimiter=",", header="t,position,force", comments=""
    )
    path = folder / "study.toml"
    path.write_text(STUDY.format(model=model, cutoff=cutoff))
    return path


def test_study_file_filters_alike(tmp_path):
    study = load(written(tmp_path))
    answer = fit(study.problem, seed=1)
    assert answer.values == pytest.approx({"M": 80, "Fv": 150, "Fc": 30, "offset": -4}, rel=0.03)
    assert "filtered alike" in study.problem.experiments["run"].recording.log[-1]


def test_study_file_says_what_is_wrong(tmp_path):
    with pytest.raises(RecordingError, match=r"study\.toml, \[model\] filter_alike: .*half the sampling rate"):
        load(written(tmp_path, cutoff=500.0))
    with pytest.raises(SpecError, match="filter_alike is only for regressions"):
        load(written(tmp_path, model='kind = "drive"\n'))
