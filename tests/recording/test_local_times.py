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
