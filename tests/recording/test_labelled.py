"""Lines in which every number has its label, as boards print them."""

import json

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import RecordingError
from plantfit.recording.readers.formats.text.labelled import pairs_of

T, U, Y = np.arange(300) * 50, np.arange(300) // 40 % 3 * 80, np.round(np.sin(np.arange(300) / 20) * 400, 1)
STYLES = {
    "plotter": lambda t, u, y: f"millis:{t},pwm:{u},rpm:{y}",
    "spaces": lambda t, u, y: f"millis: {t} pwm: {u} rpm: {y}",
    "equals": lambda t, u, y: f"millis={t} pwm={u} rpm={y}",
    "tabs": lambda t, u, y: f"millis = {t}\tpwm = {u}\trpm = {y:e}",
    "semicolons": lambda t, u, y: f"millis={t};pwm={u};rpm={y};",
    "json": lambda t, u, y: json.dumps({"millis": int(t), "pwm": int(u), "rpm": float(y)}),
}


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("repeat", [1, 40])
def test_labels_become_the_header(tmp_path, style, repeat):
    t = np.arange(300 * repeat) * 50
    u, y = np.tile(U, repeat), np.tile(Y, repeat)
    path = tmp_path / "serial.log"
    path.write_text("".join(STYLES[style](*row) + "\n" for row in zip(t, u, y, strict=True)))
    r = rec.read_csv(path)
    np.testing.assert_allclose(r.t, t / 1000)
    np.testing.assert_array_equal(r["pwm"], u)
    np.testing.assert_allclose(r["rpm"], y)
    assert "Names are the labels beside the numbers of each row." in r.log


def test_units_in_labels_missing_numbers_and_lines_that_are_none(tmp_path):
    path = tmp_path / "serial.log"
    rows = [f"t [s]:{k * 0.1:.1f},T [degC]:{'nan' if k == 7 else 20 + k},u:1e{k % 3}" for k in range(40)]
    path.write_text("\n".join(rows))
    r = rec.read_csv(path)
    assert r.signals["T"].unit == "degC"
    assert np.flatnonzero(np.isnan(r["T"])).tolist() == [7]
    path.write_text("\n".join([*rows[:20], "WARN i2c", *rows[20:30], "boot", *rows[30:]]))
    with pytest.raises(RecordingError, match=r"line 21: 1 cells.*Line 32 is so, too"):
        rec.read_csv(path)


def test_other_tables_stay_as_they_are(tmp_path):
    for line in ("0,1,2", "12:04:05,1,2", "a,b,c", "t:0", "x:1,x:2", "t:0,pwm:fast", "2024-01-01 12:00:00;3"):
        assert pairs_of(line) is None, line
    path = tmp_path / "clock.csv"
    path.write_text("time,u,y\n" + "".join(f"12:04:{k:02d},{k % 5},{k}\n" for k in range(50)))
    assert list(rec.read_csv(path).signals) == ["u", "y"]
