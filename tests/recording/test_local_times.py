"""Local times of a night in which clocks are put, days of spreadsheets, and times that are not read."""

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import ClockError, PlantfitError


def _file(tmp_path, times, header="time"):
    path = tmp_path / "night.csv"
    path.write_text(f"{header},u,y\n" + "".join(f"{t},{k % 7},{k}.5\n" for k, t in enumerate(times)))
    return path


def _local(begin, zone, count=300, minutes=1):
    utc = datetime.fromisoformat(begin).replace(tzinfo=UTC)
    return [
        (utc + timedelta(minutes=minutes * k)).astimezone(ZoneInfo(zone)).replace(tzinfo=None) for k in range(count)
    ]


@pytest.mark.parametrize(
    ("begin", "zone", "told"),
    [
        ("2023-10-28T22:00", "Europe/Berlin", "An hour was added"),
        ("2023-03-25T23:00", "Europe/Berlin", "An hour was taken off"),
        ("2023-11-05T04:00", "America/New_York", "An hour was added"),
        ("2023-03-12T05:00", "America/New_York", "An hour was taken off"),
        ("2023-10-28T23:30", "Europe/London", "An hour was added"),
    ],
)
@pytest.mark.parametrize("back", [False, True])
def test_local_times_run_on_when_clocks_are_put_for_daylight_saving(tmp_path, begin, zone, told, back):
    times = _local(begin, zone)
    r = rec.read_csv(_file(tmp_path, times[::-1] if back else times), sort=back)
    np.testing.assert_allclose(np.diff(r.t), 60.0)
    assert any(told in line and "daylight saving" in line for line in r.log)


def test_a_gap_of_an_hour_at_another_time_stays_and_rows_out_of_order_are_refused(tmp_path):
    times = _local("2023-06-10T22:00", "Europe/Berlin")
    gap = [*times[:100], *(t + timedelta(hours=1) for t in times[100:])]
    assert np.diff(rec.read_csv(_file(tmp_path, gap)).t).max() == 3660.0
    twice = [*times[:100], *(t - timedelta(hours=1) for t in times[100:])]
    with pytest.raises(ClockError, match="time goes back"):
        rec.read_csv(_file(tmp_path, twice))


def test_days_of_a_spreadsheet_are_not_taken_as_seconds(tmp_path):
    days = [f"{45000.25 + k / 1440:.8f}" for k in range(30)]
    with pytest.raises(PlantfitError, match=r"time_unit = 'day'.*'Date \[day\]'"):
        rec.read_csv(_file(tmp_path, days, "Date"))
    r = rec.read_csv(_file(tmp_path, days, "Date [day]"))
    np.testing.assert_allclose(np.diff(r.t), 60.0, atol=0.01)
    assert rec.read_csv(_file(tmp_path, days, "t")).t[0] == 45000.25  # seconds may begin there


@pytest.mark.parametrize(
    ("cell", "told"),
    [
        ("2023-10-29 00:00:00 CEST", "zone as an offset"),
        ("22:00", "write 00:22:00, or 22:00:00"),
        ("29.13.2023 12:00:00", "write 2024-05-31 13:05:59"),
    ],
)
def test_a_time_that_is_not_read_is_told_how_to_be_written(tmp_path, cell, told):
    with pytest.raises(PlantfitError, match=told):
        rec.read_csv(_file(tmp_path, [cell] * 12))


def _stamps(first, count, **step):
    return [f"{datetime.fromisoformat(first) + k * timedelta(**step):%d/%m/%Y %H:%M:%S}" for k in range(count)]


def test_a_date_that_may_be_two_is_not_said_to_be_one(tmp_path):
    """4 March or 3 April: the times of one day are the same, and the log names both."""
    r = rec.read_csv(_file(tmp_path, _stamps("2024-03-04T12:00", 20, seconds=1)))
    np.testing.assert_array_equal(r.t, np.arange(20.0))
    assert any("12:00:00 on 2024-04-03 or 2024-03-04: day and month can be exchanged" in line for line in r.log)
    for given, day in (("day first", "2024-03-04"), ("month first", "2024-04-03")):
        told = " ".join(rec.read_csv(_file(tmp_path, _stamps("2024-03-04T12:00", 20, seconds=1)), dates=given).log)
        assert f"in seconds from {day} 12:00:00" in told
        assert "exchanged" not in told
    # the night to the 13th says which of the numbers is the day, and so does a date of two alike
    for first in ("2024-03-12T23:59:50", "2024-04-04T12:00"):
        assert "exchanged" not in " ".join(rec.read_csv(_file(tmp_path, _stamps(first, 20, seconds=1))).log)


def test_dates_of_two_lengths_are_refused_with_the_line_to_write(tmp_path):
    """From 2 January to 1 February, or back."""
    times = ["01/02/2024 10:00:00", "02/01/2024 10:00:00"]
    with pytest.raises(PlantfitError, match='write dates = "day first" or dates = "month first" under'):
        rec.read_csv(_file(tmp_path, times))
    assert rec.read_csv(_file(tmp_path, times), dates="month first").t[-1] == 30 * 86400
    assert np.ptp(rec.read_csv(_file(tmp_path, times), dates="day first", sort=True).t) == 30 * 86400
    with pytest.raises(PlantfitError, match=r"line 2.*'13/02/2024 10:00:00'.*with the month first, as dates says"):
        rec.read_csv(_file(tmp_path, ["13/02/2024 10:00:00", *times]), dates="month first")
    with pytest.raises(PlantfitError, match="dates is 'dmy'; use one of 'day first', 'month first', 'year first'"):
        rec.read_csv(_file(tmp_path, times), dates="dmy")  # pyrefly: ignore[bad-argument-type]


def test_an_hour_of_a_night_that_may_be_two_is_refused(tmp_path):
    """Clocks of New York are put on 10 March 2024, and on 3 October nowhere."""
    times = [f"{t:%d/%m/%Y %H:%M:%S}" for t in _local("2024-03-10T05:00", "America/New_York")]
    with pytest.raises(PlantfitError, match=r"exchanged.*only some of them are a night.*dates = \"day first\""):
        rec.read_csv(_file(tmp_path, times))
    np.testing.assert_allclose(np.diff(rec.read_csv(_file(tmp_path, times), dates="day first").t), 60.0)
    assert np.diff(rec.read_csv(_file(tmp_path, times), dates="month first").t).max() == 3660.0
