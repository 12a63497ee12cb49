"""Whether an output has a fresh value at every so many samples only, and its record repeats or interpolates it in
between."""

import numpy as np

from plantfit.recording.clean.outliers import inline
from plantfit.recording.looks.look import Look
from plantfit.recording.record import Recording

FRESH = 20  # values at least
ON_TIME, EACH = 0.98, 0.8  # share of changes that come at the right samples, and of these samples that bring one
MOST = 60  # samples from one fresh value to the next
STRAIGHT = 0.02  # of the bends at fresh values, that are left between them
# steps by which a text of few digits bends a line, and times that by which it bends at fresh values
ROUNDED, PLAIN = (2.01, 1.5)


def refreshed_look(recording: Recording, name: str) -> Look | None:
    """The look at an output whose values in between are repeats (`held`) or lie on straight lines (`filled`); None
    for any other, and for one with missing samples."""
    t, y = recording.t, recording[name]
    if not np.all(np.isfinite(y)) or np.ptp(y) == 0:
        return None
    period, ends = float(np.median(np.diff(t))), (float(t[0]), float(t[-1]))
    if (found := _held(y)) is not None:
        every, first = found
        text = (
            f"{name} has a fresh value at every {_th(every)} sample only and repeats it in between, "
            f"so that the model is compared with readings of up to {(every - 1) * period:.3g} s "
            "ago. That looks like a dead time or a lag. Keep the fresh ones."
        )
        return Look(
            "held",
            "warning",
            recording.name,
            name,
            text,
            *ends,
            _write(name, every, first),
            {"every": every, "first": first},
        )
    if (found := _filled(y)) is not None:
        every, first = found
        text = (
            f"{name} lies on straight lines from every {_th(every)} sample to the "
            "next: values in between were interpolated, also from readings that came "
            "later. That is no response of the plant. Keep those that were read."
        )
        return Look(
            "filled",
            "warning",
            recording.name,
            name,
            text,
            *ends,
            _write(name, every, first),
            {"every": every, "first": first},
        )
    return None


def _write(name: str, every: int, first: int) -> str:
    return f"clean = [{inline({'step': 'keep_every', 'signal': name, 'every': every, 'first': first})}]"


def _th(every: int) -> str:
    return {2: "second", 3: "third"}.get(every, f"{every}th")


def _held(y: np.ndarray) -> tuple[int, int] | None:
    """Every how many samples, and from which on, a signal (n,) may change."""
    changes = np.flatnonzero(np.diff(y)) + 1
    if len(changes) < FRESH:
        return None
    every = round(float(np.median(np.diff(changes))))
    if not 2 <= every <= MOST:
        return None
    places = np.bincount(changes % every, minlength=every)
    first = int(np.argmax(places))
    on_time, each = float(places[first]) / len(changes), float(places[first]) / ((len(y) - 1 - first) // every + 1)
    return (every, first) if on_time >= ON_TIME and each >= EACH else None


def _filled(y: np.ndarray) -> tuple[int, int] | None:
    """Every how many samples, and from which on, a signal (n,) bends."""
    bends, levels = np.abs(np.diff(y, 2)), np.unique(y)
    rounding = ROUNDED * float(np.min(np.diff(levels)))
    for every in range(2, min(MOST, len(y) // FRESH) + 1):
        places = (np.arange(len(bends)) + 1) % every
        first = int(np.argmax(np.bincount(places, bends)))
        here, rest = bends[places == first], bends[places != first]
        least = float(np.quantile(here, 1.0 - EACH))
        if least > PLAIN * rounding and float(np.quantile(rest, ON_TIME)) <= max(STRAIGHT * least, rounding):
            fresh = np.arange(first, len(y), every)
            inside = np.arange(fresh[0], fresh[-1] + 1)
            away = np.abs(y[inside] - np.interp(inside, fresh, y[fresh]))
            if float(np.quantile(away, ON_TIME)) <= max(
                STRAIGHT * least, 0.5 * rounding
            ):  # else it is bent, by less than its steps
                return every, first
    return None


__all__ = ["refreshed_look"]
