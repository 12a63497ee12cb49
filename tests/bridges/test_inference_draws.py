"""Draws of the parameters, opened by ArviZ and by xarray."""

import numpy as np
import pytest

import plantfit as pf
from plantfit.bridges import export_plant
from plantfit.errors import MissingExtra, StoreError
from plantfit.trust.intervals.plausible import plausible


@pytest.fixture(scope="module")
def arviz():
    return pytest.importorskip("arviz", reason="ArviZ is not installed: the draws are not opened by it")


def test_arviz_opens_draws_as_they_are(arviz, heater, tmp_path):
    (file,) = export_plant(heater, "arviz", tmp_path, name="a heater")
    assert file.name == "a_heater_draws.nc"
    found = arviz.from_netcdf(file)
    assert {"posterior", "sample_stats", "observed_data", "posterior_predictive"} <= {
        g.strip("/") for g in found.groups()
    }
    drawn = plausible(heater.problem, np.asarray(heater.best.x), heater.findings["parameters"], 1000, 1)
    for k, name in enumerate(heater.problem.space.names):
        np.testing.assert_array_equal(found.posterior[name].values, drawn.values[None, 1:, k])
    summary = arviz.summary(found, var_names=["tau"], round_to="none", stat_focus="mean", kind="stats")
    assert summary.loc["tau", "mean"] == pytest.approx(np.mean(drawn.values[1:, 2]))
    assert summary.loc["tau", "sd"] == pytest.approx(heater.standard_errors["tau"], rel=0.1)
    assert "covariance of the answer" in found.posterior.attrs["how"]
    (experiment,) = heater.problem.experiments.values()
    np.testing.assert_array_equal(found.observed_data["T"].values, experiment.recording["T"])
    np.testing.assert_array_equal(found.observed_data["t"].values, experiment.recording.t)


def test_readings_are_those_of_the_drawn_plants_with_the_noise_of_the_fit(heater, tmp_path):
    xarray = pytest.importorskip("xarray", reason="xarray is not installed: the draws are not opened by it")
    (file,) = export_plant(heater, "arviz", tmp_path)
    with xarray.open_datatree(file, engine="h5netcdf") as tree:  # what ArviZ 1 does
        told, readings = tree["posterior"], tree["posterior_predictive"]["T"]
        assert readings.dims == ("chain", "draw", "t")
        draw = int(readings.draw[7])
        values = {n: float(told[n].sel(chain=0, draw=draw)) for n in heater.problem.space.names}
        off = readings.sel(chain=0, draw=draw).values - heater.predict(values=values)["T"]
        sigma = heater.score("fit")["T"]
        assert np.std(off) == pytest.approx(sigma, rel=0.3)
        assert abs(np.mean(off)) < 4 * sigma / np.sqrt(len(off))
        observed = tree["observed_data"]["T"].values
        low, high = np.quantile(readings.values[0], [0.025, 0.975], axis=0)
        assert 0.88 <= np.mean((observed >= low) & (observed <= high)) <= 1.0


def test_several_recordings_have_variables_of_their_own_and_any_names_are_taken(arviz, heater, tmp_path):
    (given,) = heater.problem.experiments.values()
    record = given.recording
    half = pf.from_arrays({"t": record.t[:40], "u": record["u"][:40], "T": record["T"][:40]})
    names = ["first/\n\x00\ud800", "first"]
    problem = pf.Problem(
        heater.problem.model,
        dict(zip(names, (half, record), strict=True)),
        heater.problem.space.parameters,
        name="*/\x00\ud800",
    )
    answer = pf.fit(problem, budget=300, seed=1)
    (file,) = export_plant(answer, "arviz", tmp_path)
    found = arviz.from_netcdf(file)
    assert found.observed_data["T of first"].dims == ("t of first",)
    assert {v: found.observed_data[v].shape for v in found.observed_data.data_vars} == {
        "T of first": (40,),
        "T of first_": (96,),
    }
    assert found.posterior_predictive["T of first_"].shape[1:] == (200, 96)


def test_the_same_study_writes_the_same_bytes(heater, tmp_path):
    assert (
        export_plant(heater, "arviz", tmp_path / "a")[0].read_bytes()
        == export_plant(heater, "arviz", tmp_path / "b")[0].read_bytes()
    )


def test_without_h5netcdf_the_extra_is_named(heater, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "h5netcdf", None)
    with pytest.raises(MissingExtra, match=r"pip install 'plantfit\[arviz\]'"):
        export_plant(heater, "arviz", tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("to", "start"), [("arviz", b"\x89HDF\r\n\x1a\n"), ("fmu", b"PK\x03\x04"), ("matlab", b"MATLAB 5.0 MAT-file ")]
)
def test_a_binary_of_another_program_is_not_replaced(to, start, heater, tmp_path):
    file = export_plant(heater, to, tmp_path)[0]
    export_plant(heater, to, tmp_path)
    file.write_bytes(start + file.read_bytes().replace(b"plantfit", b"whatever"))
    with pytest.raises(StoreError, match="was not written by plantfit"):
        export_plant(heater, to, tmp_path)
