"""Text tables in the shapes that loggers write, read to the same numbers; and the errors for the rest."""

import gzip

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import RecordingError, UnitError
from plantfit.recording.readers.columns import split_header
from plantfit.recording.readers.files import similar_file

T, U, W = [0.0, 0.01, 0.02], [0.0, 1.5, -2.25], [10.0, 20.5, 30.0]

SHAPES = {
    "comma": "t [s],u [V],w [rpm]\n0,0,10\n0.01,1.5,20.5\n0.02,-2.25,30\n",
    "round brackets, spaces": "t (s), u (V), w (rpm)\n0, 0, 10\n0.01, 1.5, 20.5\n0.02, -2.25, 30\n",
    "semicolon, decimal comma": "t [s];u [V];w [rpm]\n0;0;10\n0,01;1,5;20,5\n0,02;-2,25;30\n",
    "tab, Windows ends": "t [s]\tu [V]\tw [rpm]\r\n0\t0\t10\r\n0.01\t1.5\t20.5\r\n0.02\t-2.25\t30\r\n",
    "pipe, milliseconds": "t [ms]|u [V]|w [rpm]\n0|0|10\n10|1.5|20.5\n20|-2.25|30\n",
    "unit row": "t;u;w\ns;V;rpm\n0;0;10\n0.01;1.5;20.5\n0.02;-2.25;30\n",
    "white space, unit row": "t   u   w\n s  V  rpm\n 0   0  10\n0.01 1.5  20.5\n0.02  -2.25 30\n",
    "comments, blanks, quotes": '# bench 3\n"t [s]","u [V]","w [rpm]"\n\n"0",0,10\n# '
    'pause\n0.01,"1.5",20.5\n0.02,-2.25,30\n',
    "delimiter at line ends": "t [s],u [V],w [rpm],\n0,0,10,\n0.01,1.5,20.5,\n0.02,-2.25,30,\n",
    "ISO": "time,u [V],w "
    "[rpm]\n2024-03-01T12:00:00,0,10\n2024-03-01T12:00:00.01,1.5,20.5\n2024-03-01T12:00:00.02,-2.25,30\n",
    "clock past midnight": "time,u [V],w [rpm]\n23:59:59.99,0,10\n00:00:00,1.5,20.5\n00:00:00.01,-2.25,30\n",
    "numpy.savetxt": "# t [s],u [V],w [rpm]\n0.0,0.0,10.0\n1e-2,1.5e0,20.5\n2e-2,-2.25,3e1\n",
}


def write(folder, text, name="bench.csv", encoding="utf-8"):
    path = folder / name
    data = text.encode(encoding)
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    ("name", "encoding"),
    [("bench.csv", "utf-8"), ("bench.txt", "utf-8-sig"), ("bench.csv.gz", "latin-1"), ("b.dat", "utf-16")],
)
def test_every_shape_gives_the_same_recording(tmp_path, shape, name, encoding):
    r = rec.read(write(tmp_path, SHAPES[shape], name, encoding))
    np.testing.assert_allclose(r.t, T, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(r["u"], U)
    np.testing.assert_array_equal(r["w"], W)
    assert {n: s.unit for n, s in r.signals.items()} == {"u": "V", "w": "rpm"}
    assert r.log


def test_signals_by_own_names(tmp_path):
    path = write(tmp_path, "t [ms],u [V],speed\n0,1,2\n5,3,4\n")
    r = rec.read_csv(path, time="t [ms]", signals={"V": "u [V]", "w": 2}, units={"w": "rpm"})
    np.testing.assert_array_equal(r.t, [0, 0.005])
    assert r.signals["w"].unit == "rpm"
    np.testing.assert_array_equal(r["V"], [1, 3])


def test_latin1_unit(tmp_path):
    assert rec.read_csv(write(tmp_path, "t [s],T [°C]\n0,1\n1,2\n", encoding="latin-1")).signals["T"].unit == "°C"


def test_no_header_and_period(tmp_path):
    path = write(tmp_path, "5,1\n6,2\n8,3\n")
    np.testing.assert_array_equal(rec.read_csv(path).t, [5, 6, 8])
    r = rec.read_csv(path, period=0.5, signals={"a": 0, "b": "1"})
    np.testing.assert_array_equal(r.t, [0, 0.5, 1.0])
    np.testing.assert_array_equal(r["b"], [1, 2, 3])


def test_missing_cells_become_nan_and_are_counted(tmp_path):
    r = rec.read_csv(write(tmp_path, "t,u\n0,\n1,NaN\n2,NA\n3,4\n4,inf\n"))
    np.testing.assert_array_equal(np.isnan(r["u"]), [1, 1, 1, 0, 1])
    assert any("4 of 5" in sentence for sentence in r.log)


def test_bracketed_word_that_is_no_unit_stays_in_the_name(tmp_path):
    r = rec.read_csv(write(tmp_path, "t,Position (left)\n0,1\n1,2\n"))
    assert list(r.signals) == ["Position_left"]
    assert r.signals["Position_left"].unit is None


def test_equal_headers_get_different_names(tmp_path):
    r = rec.read_csv(write(tmp_path, "t,u,u\n0,1,2\n1,2,3\n"))
    np.testing.assert_array_equal(r["u_2"], [2, 3])


def test_quoted_decimal_commas_between_commas(tmp_path):
    r = rec.read_csv(write(tmp_path, 't,u\n0,"1,5"\n1,"2,5"\n'), delimiter=",", decimal=",")
    np.testing.assert_array_equal(r["u"], [1.5, 2.5])


def test_incomplete_last_line_is_left_out_and_told(tmp_path):
    r = rec.read_csv(write(tmp_path, "t,u,w\n0,1,2\n1,2,3\n2,3"))
    assert len(r) == 2
    assert any("incomplete" in sentence for sentence in r.log)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("# a\nt,u\n\n0,1\n1,x7\n2,3\n", {}, r"bench.csv, line 5, column 'u': 'x7' is not a number"),
        ("t,u\n0,1\n2,2\n1,3\n", {}, r"line 4: time goes back from 2 s to 1 s"),
        ("t,u\n0,1\n2,2\n2,3\n", {}, r"line 4: time 2 s appears twice"),
        ("t,u\n0,1\n,2\n2,3\n", {}, r"line 3: time column 't' is empty"),
        ("t,u\n0,1\n1,2,3\n2,3\n", {}, r"line 3: 3 cells where the first row has 2"),
        ("t,speed\n0,1\n1,2\n", {"signals": {"w": "sped"}}, r"did you mean 'speed'.*\['t', 'speed'\]"),
        ("t,u\n0,1\n1,2\n", {"signals": {"u": 7}}, r"no column 7"),
        ("a,b\n0,1\n1,2\n", {}, r"give time="),
        ("t,u\n", {}, r"no rows of data"),
        ("", {}, r"no rows of data"),
        ("t,u\n0,1\n1,2\n", {"delimiter": ";;"}, r"give one character"),
        ("t,u,u\n0,1,2\n1,2,3\n", {"signals": {"a": "u"}}, r"choose one by number: \[1, 2\]"),
        ("t,u\n0,1\n1,2\n", {"period": -1.0}, r"period is -1"),
        ("t,u\n0,1\n1,2\n", {"time": "t", "period": 1.0}, r"both time and period"),
        ("t;u;w\n0;1,5;0.5\n1;2,5;0.7\n", {}, r"commas .* points"),
        ("t,u\n0,\n1,\n", {"signals": {"u": "u"}}, r"holds no numbers"),
        ("t,u\n0,1\n1,2\n", {"units": {"v": "V"}}, r"units names 'v'"),
        ("t,u\n0,1\n1,2\n", {"sorted": True}, r"unknown reading option 'sorted'"),
    ],
)  # fmt: skip
def test_errors_name_place_and_value(tmp_path, text, options, message):
    with pytest.raises(RecordingError, match=message) as caught:
        rec.read_csv(write(tmp_path, text), **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("header", "options"),
    [
        ("t,u [V]", {"units": {"u": "rpm"}}),
        ("t [V],u", {"time": 0}),
        ("t [ms],u", {"time_unit": "s"}),
        ("t,u", {"time_unit": "V"}),
    ],
)
def test_contradicting_units_are_refused(tmp_path, header, options):
    with pytest.raises(UnitError, match=r"^\S+\.csv: "):
        rec.read_csv(write(tmp_path, f"{header}\n0,1\n1,2\n"), **options)


def test_sort_and_duplicates(tmp_path):
    path = write(tmp_path, "t,u\n2,4\n0,1\n2,6\n1,\n")
    np.testing.assert_array_equal(rec.read_csv(path, sort=True, duplicates="mean")["u"], [1, np.nan, 5])
    np.testing.assert_array_equal(rec.read_csv(path, sort=True, duplicates="first")["u"], [1, np.nan, 4])


def test_missing_file_suggests_a_neighbour(tmp_path):
    write(tmp_path, "t,u\n0,1\n", "gearmotor.csv")
    with pytest.raises(RecordingError, match=r"did you mean 'gearmotor.csv'"):
        rec.read(tmp_path / "gearmoter.csv")


@pytest.mark.parametrize(
    ("wanted", "there", "near"),
    [
        ("nofile.csv", ["unsorted.csv", "valve.csv", "notes.csv", "profile_of_heater.csv"], None),
        ("b.csv", ["a.csv", "c.csv"], None),
        ("pump.csv", ["tank.csv", "lamp.csv"], None),
        ("heatr.csv", ["heater.csv", "motor.csv"], "heater.csv"),
        ("record1.csv", ["record_1.csv", "unsorted.csv"], "record_1.csv"),
        ("Motor.CSV", ["motor.txt", "motor.csv"], "motor.csv"),
        ("data.csv", ["data.xlsx", "date_of_birth.csv"], "data.xlsx"),
        ("run_2.csv", ["run_2.csv.gz", "other.csv"], "run_2.csv.gz"),
    ],
)
def test_only_similar_names_are_suggested(wanted, there, near):
    assert similar_file(wanted, there) == near


def test_not_text(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"PK\x03\x04\x00\x00")
    with pytest.raises(RecordingError, match="not text"):
        rec.read(tmp_path / "a.csv")


@pytest.mark.parametrize("name", ["again.csv", "again.csv.gz"])
def test_round_trip_is_exact(tmp_path, name):
    rng = np.random.default_rng(1)
    values = rng.standard_normal(200) * 10.0 ** rng.integers(-12, 12, 200)
    values[3] = np.nan
    first = rec.from_arrays(
        np.cumsum(rng.random(200)), signals={"T": (values, "°C"), "d": (values[::-1], "-"), "x": values}
    )
    again = rec.read_csv(rec.to_csv(first, tmp_path / name))
    np.testing.assert_array_equal(again.t, first.t)
    for key, signal in first.signals.items():
        np.testing.assert_array_equal(again[key], signal.values)
        assert again.signals[key].unit == signal.unit
    assert again.log[: len(first.log)] == first.log


def test_describe(tmp_path):
    d = rec.describe(write(tmp_path, "t [ms],u [V],note\n0,1,a\n10,,b\n21,3,c\n"))
    assert (d.time, d.rows) == ("t [ms]", 3)
    assert d.period == pytest.approx(0.0105)
    assert d.jitter == pytest.approx(0.0005)
    assert [(c.name, c.unit, c.kind, c.missing) for c in d.columns] == [
        ("t", "ms", "time", 0),
        ("u", "V", "number", 1),
        ("note", None, "text", 0),
    ]
    assert (d.columns[1].minimum, d.columns[1].maximum) == (1, 3)


@pytest.mark.parametrize(
    "stamps",
    [
        ("24-05-30 23:59:58", "24-05-30 23:59:59", "24-05-31 00:00:00"),
        ("24/05/30 23:59:58", "24/05/30 23:59:59", "24/05/31 00:00:00"),
        ("12/05/06 23:59:58", "12/05/06 23:59:59", "12/05/07 00:00:00"),
        ("30/05/24 23:59:58", "30/05/24 23:59:59", "31/05/24 00:00:00"),
        ("05/30/24 23:59:58", "05/30/24 23:59:59", "05/31/24 00:00:00"),
        ("30.05.24 23:59:58", "30.05.24 23:59:59", "31.05.24 00:00:00"),
    ],
)
def test_a_year_of_two_digits_may_stand_first_or_last(tmp_path, stamps):
    r = rec.read(write(tmp_path, "time,u\n" + "".join(f"{stamp},{k}\n" for k, stamp in enumerate(stamps))))
    np.testing.assert_array_equal(r.t, [0.0, 1.0, 2.0])


def test_thousands_are_not_taken_for_decimals(tmp_path):
    with pytest.raises(RecordingError, match="part thousands"):
        rec.read(write(tmp_path, "t;n\n0;998\n1;999\n2;1,000\n3;1,001\n"))
    assert rec.read_csv(write(tmp_path, "t;n\n0;998\n1;999\n2;1,000\n3;1,001\n"), decimal=",")["n"][2] == 1.0
    np.testing.assert_array_equal(
        rec.read(write(tmp_path, "t;n\n0;100\n1;101,325\n2;101,5\n"))["n"], [100.0, 101.325, 101.5]
    )
    np.testing.assert_array_equal(rec.read(write(tmp_path, "t;n\n0;2\n1;1,998\n2;1,999\n"))["n"], [2.0, 1.998, 1.999])


def test_a_long_table_has_one_decimal_mark(tmp_path):
    rows = [(k, g) for k in range(5) for g in "ab"]
    german = rec.read(write(tmp_path, "t;tag;v\n" + "".join(f"0,{k};{g};{k},5\n" for k, g in rows)))
    np.testing.assert_array_equal(german.t, [0.0, 0.1, 0.2, 0.3, 0.4])
    np.testing.assert_array_equal(german["a"], [0.5, 1.5, 2.5, 3.5, 4.5])
    for mixed in ("0.{k};{g};1,00{k}", "0,{k};{g};1.00{k}"):
        with pytest.raises(RecordingError, match="write both alike"):
            rec.read(write(tmp_path, "t;tag;v\n" + "".join(mixed.format(k=k, g=g) + "\n" for k, g in rows)))


@pytest.mark.parametrize(("first", "unit", "step"), [(1717027200000, "ms", 10), (1717027200000000, "us", 10_000)])
def test_times_since_1970_are_not_taken_for_seconds(tmp_path, first, unit, step):
    path = write(tmp_path, "timestamp,u\n" + "".join(f"{first + k * step},{k}\n" for k in range(4)))
    with pytest.raises(UnitError, match=f"time_unit = '{unit}'"):
        rec.read(path)
    np.testing.assert_allclose(np.diff(rec.read(path, time_unit=unit).t), 0.01, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        *[("t/s", "t", "s"), ("Pm/MW", "Pm", "MW"), ("f/mHz", "f", "mHz"), ("T/°C", "T", "°C"), ("p/bar", "p", "bar")],
        *[
            ("v/(m/s)", "v", "m/s"),
            ("n / min^-1", "n", "min^-1"),
            ("Druck / bar", "Druck", "bar"),
            ("pA/bar", "pA", "bar"),
        ],
        *[
            ("U_L/V", "U_L", "V"),
            ("m/kg", "m", "kg"),
            ("Zeit t/s", "Zeit t", "s"),
            ("y/%", "y", "%"),
            ("φ/°", "φ", "°"),
        ],
    ],
)
def test_a_quantity_over_its_unit_is_a_name_and_a_unit(header, name, unit):
    assert split_header(header) == (name, unit)


RATIOS = (
    "a/b on/off in/out km/h m/s l/min mV/V v_m/s A/F x/y P/V L/D I/O N/A V/F air/F T/T0 Vin/Vout m/s^2 1/min N/m "
    "K/min S/N r/min"
)


@pytest.mark.parametrize("header", [*RATIOS.split(), "flow l/min", "speed m/s"])
def test_ratios_choices_and_units_by_themselves_stay_names(header):
    assert split_header(header) == (header, None)


def test_a_file_of_quotients_and_one_of_paths(tmp_path):
    (tmp_path / "a.csv").write_text("t/s;Pm/MW;f/mHz\n0.00;70;1\n0.02;71;2\n0.04;72;3\n")
    found = rec.read_csv(tmp_path / "a.csv")
    assert {n: s.unit for n, s in found.signals.items()} == {"Pm": "MW", "f": "mHz"}
    assert any("in s (stated by the file)" in line for line in found.log)
    old = rec.read_csv(tmp_path / "a.csv", time="t/s", signals={"P": "Pm_MW", "f": "f/mHz"}, units={"P": "MW"})
    assert old.signals["P"].unit == "MW"
    (tmp_path / "b.csv").write_text("time,pump/A,pump/B\n0,70,1\n1,71,2\n2,72,3\n")
    assert {n: s.unit for n, s in rec.read_csv(tmp_path / "b.csv").signals.items()} == {"pump_A": None, "pump_B": None}
