"""Local times of a night in which clocks are put forward or back."""

from datetime import datetime, timedelta

import numpy as np

from plantfit.recording.readers.columns import Table

HOUR = 3600.0  # s


def without_daylight_saving(t: np.ndarray, start: datetime, table: Table) -> tuple[np.ndarray, str]:
    """Times (n,) in s from `start`, a local time, as if nobody had put the clock forward or back, and what is told.

    A clock was put where, in a night to Sunday of spring or autumn, a step of else usual length is an hour longer or
    shorter. No other step may go back then: those are rows out of order.
    """
    rows = np.arange(len(t)) if len(t) < 2 or np.median(np.diff(t)) > 0 else np.arange(len(t))[::-1]
    steps, told = np.diff(t[rows]), ""
    if len(steps) < 10 or np.count_nonzero(steps < 0) > 1:
        return t, ""
    usual = float(np.median(steps))
    if not 0 < usual < HOUR:
        return t, ""
    amount = np.zeros(len(t))
    for k in np.flatnonzero(np.abs(np.abs(steps - usual) - HOUR) <= 0.5 * usual) + 1:
        put = HOUR if steps[k - 1] > 0 else -HOUR
        if _clocks_change(start + timedelta(seconds=float(t[rows[k - 1]]))):
            amount[rows[k:]] -= put
            told += (
                f" An hour was {'taken off' if put > 0 else 'added'} from {table.where(int(rows[k]))} on, because the "
                f"clock was put {'forward' if put > 0 else 'back'} there for daylight saving."
            )
    return (t + amount - amount[0], told) if told else (t, "")


def _clocks_change(local: datetime) -> bool:
    """Whether clocks are put at about this local time somewhere: on Sundays of March, April and September to November,
    from 0:00 to 3:00."""
    hour = local.hour + local.minute / 60
    night = (local.weekday() == 6 and hour <= 3) or (local.weekday() == 5 and hour >= 23.5)
    return night and local.month in (3, 4, 9, 10, 11)
