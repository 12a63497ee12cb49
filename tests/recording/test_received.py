"""Logs of a serial monitor with times before every line, as that of the Arduino IDE."""

from datetime import datetime, timedelta

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import RecordingError

LINES = {
    "one number": (lambda k: f"{200 + k % 13}", "0"),
    "with commas": (lambda k: f"{k % 3},{200 + k % 13}", "1"),
    "with tabs": (lambda k: f"{k % 3}\t{200 + k % 13}", "1"),
    "with spaces": (lambda k: f"{k % 3} {200 + k % 13}", "1"),
    "with labels": (lambda k: f"pwm:{k % 3},rpm:{200 + k % 13}", "rpm"),
    "with one label": (lambda k: f"rpm:{200 + k % 13}", "rpm"),
}


def _log(tmp_path, lines, period=0.05):
    begin = datetime(2024, 1, 1, 23, 59, 59)
    stamps = [f"{begin + k * timedelta(seconds=period):%H:%M:%S.%f}"[:-3] for k in range(len(lines))]
    path = tmp_path / "serial.log"
    path.write_text("".join(f"{stamp} -> {line}\n" for stamp, line in zip(stamps, lines, strict=True)))
    return path


# a long file is read in another way
@pytest.mark.parametrize(("kind", "count"), [*((kind, 40) for kind in LINES), ("with commas", 60_000)])
def test_every_line_is_a_row(tmp_path, kind, count):
    line, name = LINES[kind]
    r = rec.read(_log(tmp_path, [line(k) for k in range(count)]), signals={"y": name})
    np.testing.assert_allclose(r.t, 0.05 * np.arange(count), atol=1e-9)
    np.testing.assert_array_equal(r["y"], 200 + np.arange(count) % 13)
    assert "The serial monitor's times before -> are a column of their own." in r.log


def test_a_printed_header_comments_and_empty_lines(tmp_path):
    lines = ["pwm,rpm [turn/min]", "# ready", *(f"{k % 3},{200 + k % 13}" for k in range(40)), ""]
    r = rec.read(_log(tmp_path, lines))
    np.testing.assert_array_equal(r["rpm"], 200 + np.arange(40) % 13)
    assert r.signals["rpm"].unit == "turn/min"


def test_the_clock_of_the_board_is_taken_where_it_has_one(tmp_path):
    """The monitor's times shake by what the computer did meanwhile."""
    r = rec.read(_log(tmp_path, ["millis,rpm", *(f"{20 * k},{200 + k % 13}" for k in range(40))]))
    np.testing.assert_allclose(r.t, 0.02 * np.arange(40))
    assert list(r.signals) == ["rpm"]


def test_lines_that_do_not_fit_are_named_and_other_tables_stay(tmp_path):
    lines = [f"{k % 3},{k}" for k in range(40)]
    with pytest.raises(RecordingError, match="line 21: 1 cells"):
        rec.read(_log(tmp_path, [*lines[:20], "boot", *lines[20:]]))
    path = tmp_path / "arrows.csv"
    path.write_text("t,u,note\n" + "".join(f"{k},{k % 3},a -> b\n" for k in range(20)))
    assert rec.read(path, signals=["u"]).t[-1] == 19.0
