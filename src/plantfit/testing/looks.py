"""Conformance of looks at a signal: what every look that a package brings must keep.

from plantfit.testing import check_look
check_look(my_package.spikes)
"""

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from plantfit.recording.looks import Look
from plantfit.recording.record import Recording, Signal


def check_look(look: Callable[[Recording, str, bool], Iterable[Look]]) -> None:
    """Show it signals of many kinds, as an input and as an output.

    A look takes a recording, the name of a signal and whether it is measured, and gives `Look`s: one sentence with a
    full stop, a level "info" or "warning", a time within the recording. It leaves the recording as it was, gives the
    same twice, does not fail where values are missing or never move, and says nothing about white noise, which is not
    odd. Raises AssertionError with what was expected and what came.
    """
    rng = np.random.default_rng(0)
    t = np.arange(500) * 0.1
    signals = {
        "white noise": rng.normal(size=500), "a step": np.where(t < 20, 0.0, 1.0), "a constant": np.full(500, 2.0),
        "nothing but missing values": np.full(500, np.nan),
        "a ramp with gaps": np.where(rng.random(500) < 0.3, np.nan, t),
        "one spike": np.where(np.arange(500) == 250, 1e3, rng.normal(size=500)),
    }  # fmt: skip
    for what, values in signals.items():
        for measured in (False, True):
            recording = Recording(t, {"y": Signal(values.copy(), "V")}, "exam")
            try:
                one, two = list(look(recording, "y", measured)), list(look(recording, "y", measured))
            except Exception as failure:
                raise AssertionError(
                    f"{_name(look)}: it fails at {what} ({type(failure).__name__}: {failure})."
                ) from failure
            _expect(np.array_equal(recording["y"], values, equal_nan=True), look, f"it changed {what}")
            _expect(
                [repr(a) for a in one] == [repr(a) for a in two],
                look,
                f"it gives something else when it sees {what} again",
            )
            _expect(not (what == "white noise" and one), look, "it finds white noise odd")
            for found in one:
                _one(look, found, t)


def _one(look: Any, found: Any, t: np.ndarray) -> None:
    _expect(isinstance(found, Look), look, f"it gives a {type(found).__name__}, not a Look")
    _expect(found.level in ("info", "warning"), look, f"its level is {found.level!r}, not 'info' or 'warning'")
    _expect(
        found.sentence.endswith(".") and "\n" not in found.sentence,
        look,
        f"{found.sentence!r} is no sentence on one line",
    )
    inside = t[0] <= found.begin <= found.end <= t[-1]
    _expect(inside, look, f"{found.begin} to {found.end} s is not within the recording")
    _expect(
        all(t[0] <= at <= t[-1] for at in found.times),
        look,
        f"it marks {found.times}, not all of it within the recording",
    )
    _expect(all(math.isfinite(v) for v in found.figures.values()), look, f"its figures are {found.figures}")


def _name(look: Any) -> str:
    return f"Look {getattr(look, '__name__', look)!r}"


def _expect(condition: Any, look: Any, sentence: str) -> None:
    if not condition:
        raise AssertionError(f"{_name(look)}: {sentence}.")
