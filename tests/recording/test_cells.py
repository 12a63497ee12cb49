"""Numbers with marks between thousands, and words that stand for no value."""

import numpy as np
import polars as pl
import pytest

from plantfit.errors import RecordingError, SpecError
from plantfit.recording import read, read_csv
from plantfit.recording.readers.numbers import thousands
from plantfit.spec import parse

VALUES = [0.5, 999.25, 1000.0, 1234.5, 98765.25, 1234567.5, -4321.0]
MARKS = [(",", "."), (".", ","), (" ", "."), (" ", ","), ("\u00a0", ","), ("\u202f", ","), ("'", "."), ("\u2019", ".")]


def written(value: float, mark: str, end: str) -> str:
    return f"{value:,.2f}".replace(",", "X").replace(".", end).replace("X", mark)


def table(tmp_path, cells, delimiter=";", **options):
    path = tmp_path / "log.csv"
    rows = [f"{k}{delimiter}{cell}" for k, cell in enumerate(cells)]
    path.write_text("\n".join([f"t [s]{delimiter}y", *rows]) + "\n", encoding="utf-8")
    return read_csv(path, **options)


@pytest.mark.parametrize(("mark", "end"), MARKS)
def test_numbers_with_marks_between_thousands(tmp_path, mark, end):
    recording = table(tmp_path, [written(v, mark, end) for v in VALUES])
    np.testing.assert_array_equal(recording["y"], VALUES)
    assert any(f"{mark!r} between thousands" in line for line in recording.log)


@pytest.mark.parametrize(("mark", "end"), MARKS)
def test_any_numbers_are_read_or_refused_and_never_read_wrongly(tmp_path, mark, end):
    read_so = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        values = np.round(rng.uniform(-1, 1, 6) * 10.0 ** rng.uniform(0, 7, 6), 2)
        try:
            found = table(tmp_path, [written(v, mark, end) for v in values])["y"]
        except RecordingError:
            continue
        np.testing.assert_array_equal(found, values)
        read_so += 1
    assert read_so >= 38


@pytest.mark.parametrize(
    "cells", [["1,234", "5,678"], ["1.234", "5.678"], ["1.23", "1.234,5"], ["12,34.5", "1.0"], ["1 23", "4.0"]]
)
def test_what_may_be_a_decimal_mark_is_no_mark_between_thousands(cells):
    assert thousands(pl.Series(cells)) is None


def test_a_stated_decimal_mark_decides():
    assert thousands(pl.Series(["1.234,5", "7,5"]), ",") == (".", ",")
    assert thousands(pl.Series(["1.234,5", "7,5"]), ".") is None


def test_words_count_as_missing_where_that_is_said(tmp_path):
    cells = ["1.5", "Bad", "2.5", " bad ", "No Data", "3.5"]
    with pytest.raises(RecordingError, match=r"line 3, column 'y': 'Bad' is not a number.*missing = \['Bad'\]"):
        table(tmp_path, cells, signals=["y"])
    with pytest.raises(RecordingError, match="'No Data' is not a number"):
        table(tmp_path, cells, signals=["y"], missing=["Bad"])
    recording = table(tmp_path, cells, signals=["y"], missing=["Bad", "No Data"])
    np.testing.assert_array_equal(recording["y"], [1.5, np.nan, 2.5, np.nan, np.nan, 3.5])
    assert any("3 of 6 values of 'y' are missing" in line for line in recording.log)


@pytest.mark.parametrize("cells", [["1.5", "-999", "2.5"], ["1.5", "-999.0", "2.5"], ["1.5", "-999", "Bad"]])
def test_a_number_may_stand_for_no_value(tmp_path, cells):
    recording = table(tmp_path, cells, signals=["y"], missing=[-999, "Bad"])
    np.testing.assert_array_equal(recording["y"], [float(c) if c in ("1.5", "2.5") else np.nan for c in cells])


def test_numbers_of_other_files_may_stand_for_no_value(tmp_path):
    pl.DataFrame({"t": [0.0, 1.0, 2.0], "y": [1.5, -999.0, 2.5]}).write_parquet(tmp_path / "log.parquet")
    recording = read(tmp_path / "log.parquet", time="t", time_unit="s", missing=[-999])
    np.testing.assert_array_equal(recording["y"], [1.5, np.nan, 2.5])


@pytest.mark.parametrize("wrong", [True, None, ["Bad"]])
def test_what_stands_for_no_value_is_a_word_or_a_number(tmp_path, wrong):
    with pytest.raises(RecordingError, match=r"missing holds .*; give words and numbers"):
        table(tmp_path, ["1.5", "2.5"], missing=[wrong])


def test_words_beside_marks_between_thousands(tmp_path):
    recording = table(tmp_path, ["1,234.5", "Bad", "999.0"], missing=["Bad"])
    np.testing.assert_array_equal(recording["y"], [1234.5, np.nan, 999.0])


def test_words_beside_marks_between_thousands_that_nobody_named(tmp_path):
    with pytest.raises(RecordingError, match="line 3, column 'y': 'Bad' is not a number"):
        table(tmp_path, ["1,234.5", "Bad", "999.0"], signals=["y"])


@pytest.mark.parametrize(("given", "told"), [("[true]", "missing"), ('["Bad", 1.5, -999]', None), ('"Bad"', "missing")])
def test_a_study_file_names_what_stands_for_no_value(tmp_path, given, told):
    (tmp_path / "log.csv").write_text("t [s],u,y\n0,1,1.0\n1,2,Bad\n2,1,-999\n3,2,1.5\n4,1,2.0\n", "utf-8")
    text = f"""name = "a"
[recording.data]
file = "log.csv"
missing = {given}
[model]
equations = "y = k*u"
inputs = ["u"]
outputs = ["y"]
[parameters.k]
bounds = [0, 5]
"""
    if told is not None:
        with pytest.raises(SpecError, match=told):
            parse(text, tmp_path / "a.toml")
        return
    [experiment] = parse(text, tmp_path / "a.toml").problem.experiments.values()
    assert np.isnan(experiment.recording["y"]).tolist() == [False, True, True, True, False]
