"""The same table through every format."""

import datetime

import numpy as np
import openpyxl
import polars as pl
import pytest
from scipy.io import savemat

import plantfit.recording as rec
from plantfit.errors import RecordingError, UnitError

T = np.array([0.0, 0.1, 0.2, 0.3])
U = np.array([1.0, 1 / 3, 1e-17, -4.0])  # a text of rounded digits would lose the third


def parquet(folder):
    pl.DataFrame({"t": T, "u [V]": U}).write_parquet(folder / "a.parquet")
    return rec.read(folder / "a.parquet")


def xlsx(folder):
    book = openpyxl.Workbook()
    sheet = book.create_sheet("bench", 0)
    for row in [[], ["t", "u"], ["s", "V"], *zip(T.tolist(), U.tolist(), strict=True)]:
        sheet.append(list(row))
    book.save(folder / "a.xlsx")
    return rec.read(folder / "a.xlsx")


def mat(folder):
    savemat(folder / "a.mat", {"run": {"t": T, "u": U[:, None]}, "Ts": 0.1})
    return rec.read(folder / "a.mat", time="run.t", signals={"u": "run.u"}, units={"u": "V"})


def npz(folder):
    np.savez(folder / "a.npz", t=T, u=U, note=np.array(3.0))
    return rec.read(folder / "a.npz", units={"u": "V"})


class PandasLike:
    """Has what is asked of a pandas frame."""

    columns = ("t", "u [V]")

    def __getitem__(self, name):
        return pl.Series({"t": T, "u [V]": U}[name])


@pytest.mark.parametrize(
    "reader",
    [
        parquet, xlsx, mat, npz,
        lambda _: rec.from_frame(pl.DataFrame({"t": T, "u [V]": U})),
        lambda _: rec.from_frame(PandasLike()),
        lambda _: rec.from_arrays(T, signals={"u": (U, "V")}),
        lambda _: rec.from_arrays(period=0.1, signals={"u": rec.Signal(U, "V")}),
    ],
)  # fmt: skip
def test_same_recording(tmp_path, reader):
    r = reader(tmp_path)
    np.testing.assert_allclose(r.t, T, atol=1e-15)
    np.testing.assert_array_equal(r["u"], U)
    assert list(r.signals) == ["u"]
    assert r.signals["u"].unit == "V"


def test_dates_count_from_the_first():
    stamps = [datetime.datetime(2024, 1, 1, 12, 0, 0), datetime.datetime(2024, 1, 1, 12, 0, 0, 500000)]
    np.testing.assert_array_equal(rec.from_frame(pl.DataFrame({"when": stamps, "u": [1, 2]})).t, [0, 0.5])


def test_clock_readings_of_a_frame_go_on_past_midnight():
    times = [datetime.time(23, 59, 58), datetime.time(23, 59, 59, 500_000), datetime.time(0, 0, 1)]
    np.testing.assert_array_equal(rec.from_frame(pl.DataFrame({"time": times, "u": [1, 2, 3]})).t, [0, 1.5, 3.0])


def test_matlab_73_is_named(tmp_path):
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(600))
    with pytest.raises(RecordingError, match="-v7"):
        rec.read(tmp_path / "a.mat")


@pytest.mark.parametrize("name", ["a.mat", "a.npz", "a.xlsx", "a.parquet", "a.csv.gz", "a.xyz"])
def test_damaged_files(tmp_path, name):
    (tmp_path / name).write_bytes(b"\x1f\x8bnothing of use")
    with pytest.raises(RecordingError, match="a\\."):
        rec.read(tmp_path / name)


def test_foreign_option_and_unknown_sheet(tmp_path):
    xlsx(tmp_path)
    with pytest.raises(RecordingError, match="'delimiter' does not apply"):
        rec.read(tmp_path / "a.xlsx", delimiter=";")
    with pytest.raises(RecordingError, match="no sheet 'x'"):
        rec.read(tmp_path / "a.xlsx", sheet="x")


def test_wrong_arrays():
    with pytest.raises(RecordingError, match="lengths differ"):
        rec.from_arrays(T, signals={"u": U[:2]})
    with pytest.raises(RecordingError, match="either"):
        rec.from_arrays(signals={"u": U})
    with pytest.raises(UnitError):
        rec.from_arrays(T, signals={"u": (U, "Vlt")})


def test_a_file_that_ends_the_process_of_its_reader_is_refused_and_others_are_read_after_it(tmp_path, monkeypatch):
    """The trial is real; what crashes there is faked, since each version of a parser crashes at other files."""
    from plantfit.recording.readers import tried

    code = tried._TRY.replace("polars.read_parquet(path)", "__import__('os').abort() if 'bad' in path else None")
    monkeypatch.setattr(tried, "_TRY", code.replace("polars.read_parquet_metadata(path)", "None"))
    helper = tried._Helper()
    monkeypatch.setattr(tried, "_helper", lambda: helper)
    for name in ("good", "bad", "other"):
        pl.DataFrame({"t": [0.0, 1.0, 2.0], "y": [1.0, 2.0, 3.0]}).write_parquet(tmp_path / f"{name}.parquet")
    assert len(rec.read(tmp_path / "good.parquet")) == 3
    first = helper.process
    assert len(rec.read(tmp_path / "other.parquet")) == 3
    assert helper.process is first  # one process for all
    with pytest.raises(RecordingError, match=r"bad\.parquet is damaged: reading it as Parquet crashes; write it anew"):
        rec.read(tmp_path / "bad.parquet")
    assert len(rec.read(tmp_path / "good.parquet")) == 3
    assert helper.process is not first
    helper.stop()
    monkeypatch.setattr(tried, "_TRY", "import time\ntime.sleep(100)")
    monkeypatch.setattr(tried, "SECONDS", 0.2)
    with pytest.raises(RecordingError, match=r"good\.parquet is damaged: reading it as Parquet does not end"):
        rec.read(tmp_path / "good.parquet")
    assert helper.process is None
