"""Times that run on where a clock was put forward or back, or where a counter of a board ran over."""

from datetime import datetime, timedelta

import numpy as np

from plantfit.recording.readers.columns import Table

HOUR = 3600.0  # s
SPANS = {  # s, after which counters of boards begin anew
    "2^16 us": 0.065536,
    "2^16 ms": 65.536,
    "2^32 ns": 4.294967296,
    "2^32 us": 4294.967296,
    "2^32 ms": 4294967.296,
    "24 h": 86400.0,
}
LOST = 3.0  # steps, up to which rows may be lost where a counter runs over


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


def without_overruns(t: np.ndarray, table: Table) -> tuple[np.ndarray, str]:
    """Times (n,) in s as if the counter that they are read from (millis, micros) had no end, and what is told.

    A counter ran over where every step back is, up to the usual step, as long as a counter of 16 or 32 bits has room,
    signed or not. Any other step back is a row out of order, or a board that was started anew.
    """
    steps = np.diff(t)
    back, forward = np.flatnonzero(steps < 0), steps[steps > 0]
    if not len(back) or len(forward) < 10 or len(back) > len(forward) // 10:
        return t, ""
    usual = float(np.median(forward))
    for name, span in SPANS.items():
        after = steps[back] + span
        if span > 10 * usual and np.all((after > 0) & (after <= LOST * usual)) and np.ptp(t) <= span:
            added = np.zeros(len(t))
            added[back + 1] = span
            # a counter has whole steps of a ns at least: rounding takes back what the sum of large numbers left behind
            whole = np.round(t + np.cumsum(added), 9)
            times = "once" if len(back) == 1 else f"{len(back)} times"
            return whole, f" Its counter ran over {times}, first at {table.where(int(back[0]) + 1)}: {name} were added."
    return t, ""
