"""`signals`, `units` and time mean the same in files, data frames and arrays."""

import datetime

import numpy as np
import polars as pl
import pytest

import plantfit as pf
from plantfit.errors import RecordingError, UnitError

T = np.array([0.0, 0.1, 0.2, 0.3])
U = np.array([1.0, 1 / 3, 1e-17, -4.0])
W = np.array([5.0, 6.0, 7.0, np.nan])


class Frame:
    """Has what is asked of a pandas frame."""

    def __init__(self, columns, index):
        self.cells, self.columns, self.index = columns, tuple(columns), index

    def __getitem__(self, name):
        return pl.Series(self.cells[name])


class Index:
    """Has what is asked of a pandas index."""

    def __init__(self, values, name=None):
        self.values, self.name = values, name

    def to_numpy(self):
        return np.asarray(self.values)


def indexed(index, name=None, columns=None):
    return Frame(columns or {"U1": U, "speed": W}, Index(index, name))


def csv(folder, **options):
    rows = ["t,U1,speed", *(f"{a!r},{b!r},{c!r}" for a, b, c in zip(T.tolist(), U.tolist(), W.tolist(), strict=True))]
    (folder / "run.csv").write_text("\n".join(rows))
    return pf.read_csv(folder / "run.csv", **options)


def arrays(folder, **options):
    return pf.from_arrays({"t": T, "U1": U, "speed": W}, **options)


def polars(folder, **options):
    return pf.from_frame(pl.DataFrame({"t": T, "U1": U, "speed": W}), **options)


def pandas(folder, **options):
    return pf.from_frame(indexed(T, "t"), **options)


EVERY = pytest.mark.parametrize("made", [csv, arrays, polars, pandas])


@EVERY
def test_own_names_to_columns_with_units(tmp_path, made):
    r = made(tmp_path, signals={"u": "U1", "w": "speed"}, units={"w": "rad/s"})
    assert {n: s.unit for n, s in r.signals.items()} == {"u": None, "w": "rad/s"}
    np.testing.assert_allclose(r.t, T, atol=1e-15)
    np.testing.assert_array_equal(r["u"], U)
    np.testing.assert_array_equal(r["w"], W)


@EVERY
def test_a_list_of_columns_and_all_of_them(tmp_path, made):
    assert list(made(tmp_path, signals=["speed"]).signals) == ["speed"]
    assert list(made(tmp_path).signals) == ["U1", "speed"]


@EVERY
def test_an_unknown_column_is_told_with_those_there_are(tmp_path, made):
    with pytest.raises(RecordingError, match=r"no column 'sped' for signal 'w' \(did you mean 'speed'\?\)"):
        made(tmp_path, signals={"w": "sped"})
    with pytest.raises(RecordingError, match="units names 'x'"):
        made(tmp_path, signals={"w": "speed"}, units={"x": "V"})


def test_arrays_carry_units_in_their_names_or_beside_them():
    r = pf.from_arrays({"time [ms]": 1000 * T, "u [V]": U, "w": (W, "rad/s"), "v": pf.Signal(U, "m/s")}, name="bench")
    assert {n: s.unit for n, s in r.signals.items()} == {"u": "V", "w": "rad/s", "v": "m/s"}
    np.testing.assert_allclose(r.t, T, atol=1e-15)
    assert r.name == "bench"
    with pytest.raises(UnitError, match="says 'V', but units says 'A'"):
        pf.from_arrays({"t": T, "u [V]": U}, units={"u": "A"})


def test_times_of_arrays():
    np.testing.assert_allclose(pf.from_arrays({"u": U}, period=0.5).t, [0, 0.5, 1, 1.5])
    np.testing.assert_array_equal(pf.from_arrays({"clock": T, "u": U}, time="clock").t, T)
    stamps = np.datetime64("2024-01-01T00:00:00.000") + (1000 * T).astype("timedelta64[ms]")
    np.testing.assert_allclose(pf.from_arrays({"when": stamps, "u": U}).t, T, atol=1e-12)
    with pytest.raises(RecordingError, match="no column looks like time"):
        pf.from_arrays({"u": U, "w": W})
    with pytest.raises(RecordingError, match="lengths differ"):
        pf.from_arrays({"t": T, "u": U[:2]})


def test_arrays_as_earlier_programs_gave_them():
    for old in (
        pf.from_arrays(T, signals={"u": (U, "V")}),
        pf.from_arrays(t=T, signals={"u": pf.Signal(U, "V")}, name="recording"),
    ):
        new = pf.from_arrays({"t": (T, "s"), "u": (U, "V")})
        np.testing.assert_array_equal(old.t, new.t)
        np.testing.assert_array_equal(old["u"], new["u"])
        assert old.signals["u"].unit == new.signals["u"].unit == "V"


def test_the_two_ways_are_not_mixed():
    with pytest.raises(
        RecordingError, match=r"signals gives 'u' an array, but names an array here; put it among the arrays"
    ):
        pf.from_arrays({"t": T}, signals={"u": U})
    with pytest.raises(
        RecordingError, match=r"beside times, signals are arrays by name; .* write from_arrays\(\{'t': t"
    ):
        pf.from_arrays(T, signals={"u": "U1"})
    with pytest.raises(RecordingError, match="beside times, signals are arrays by name"):
        pf.from_arrays(T)  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(RecordingError, match="'units' is for named arrays"):
        pf.from_arrays(T, signals={"u": U}, units={"u": "V"})  # pyrefly: ignore[no-matching-overload]
    with pytest.raises(RecordingError, match="unknown reading option 'unit'"):
        pf.from_arrays({"t": T, "u": U}, unit={"u": "V"})  # pyrefly: ignore[no-matching-overload]


# the index of a pandas frame


@pytest.mark.parametrize(
    "index",
    [
        np.datetime64("2024-01-01T00:00:00") + (1000 * T).astype("timedelta64[ms]"),
        (1000 * T).astype("timedelta64[ms]"),
        np.array(
            [datetime.datetime(2024, 1, 1, tzinfo=datetime.UTC) + datetime.timedelta(seconds=s) for s in T],
            dtype=object,
        ),
    ],
)
def test_dates_and_durations_in_the_index_are_the_time(index):
    for name in (None, "whenever"):
        r = pf.from_frame(indexed(index, name), signals={"u": "U1"})
        np.testing.assert_allclose(r.t, T, atol=1e-12)
        np.testing.assert_array_equal(r["u"], U)


def test_an_index_that_is_called_time_is_the_time():
    np.testing.assert_allclose(pf.from_frame(indexed(1000 * T, "time [ms]")).t, T, atol=1e-15)
    np.testing.assert_array_equal(pf.from_frame(indexed(T, "clock"), time="clock").t, T)


def test_an_index_that_only_counts_is_not_the_time():
    with pytest.raises(RecordingError, match="no column looks like time"):
        pf.from_frame(indexed(np.arange(4)))
    with pytest.raises(RecordingError, match="no column looks like time"):
        pf.from_frame(indexed(np.arange(4), "row"))
    r = pf.from_frame(indexed(np.arange(4), columns={"t": T, "u": U}))
    np.testing.assert_array_equal(r.t, T)


def test_a_column_that_time_names_goes_before_the_index_and_numbers_of_columns_stay():
    stamps = np.datetime64("2024-01-01T00:00:00") + np.arange(4).astype("timedelta64[h]")
    r = pf.from_frame(indexed(stamps, "when", {"s": T, "u": U}), time="s", signals={"v": 1})
    np.testing.assert_array_equal(r.t, T)
    np.testing.assert_array_equal(r["v"], U)
