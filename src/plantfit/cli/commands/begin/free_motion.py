"""The text of a first study file of a motion that no input drives: a pendulum let go, a body that cools down."""

from dataclasses import replace
from typing import Literal

import numpy as np

from plantfit.cli.commands.begin.study_text import HEAD, SEARCH, SPLIT, Signal, quoted
from plantfit.units import compatible, factor_offset

Motion = Literal["oscillation", "decay"]
MOST = 20_000  # samples that are looked at

_MIDDLE = """\
# fit = [2.0, 20.0]    # in place of split: from where the motion was let go to where it is at rest, in s
# clean = [{{ step = "drop_outliers", signal = "{y}", window = 11, threshold = 4.0 }}]

# ---- how the plant works --------------------------------------------------------------------
[model]
equations = \"\"\"
{equations}
\"\"\"
states = {{ {states} }}
outputs = {{ {y} = {unit} }}

# ---- what is unknown, and within which bounds --------------------------------------------------
{parameters}
"""
WORDS: dict[Motion, str] = {"oscillation": "a damped oscillation", "decay": "an exponential decay"}


def motion_of(y: np.ndarray) -> tuple[Motion, float]:
    """Which of both samples (n,) show, and the cycles in them: an oscillation goes at least three times through the
    middle of its second half by more than its noise."""
    y = y[np.isfinite(y)][:MOST]
    middle = np.median(y[len(y) // 2 :])
    noise = np.median(np.abs(np.diff(y, 2))) if len(y) > 2 else 0.0
    far = np.abs(y - middle) > max(3.0 * noise, 0.02 * np.ptp(y))
    passes = int(np.count_nonzero(np.diff(np.sign(y[far] - middle))))
    if passes < 3:
        return "decay", 0.0
    power = np.abs(np.fft.rfft((y - middle) * np.hanning(len(y)), 4 * len(y))) ** 2
    return "oscillation", max(float(np.argmax(power)) / 4.0, 1.0)


def free_text(
    y: Signal, values: np.ndarray, source: str, path: str, spec: str, name: str, columns: list[str], time: str,
    period: float, duration: float,
) -> tuple[str, Motion]:  # fmt: skip
    """A study file of the free motion of one output, and which motion it is.

    `values` (n,) are its samples, `path` the recording as the file sees it, `time` the line of its clock, `period` and
    `duration` in s.
    """
    motion, cycles = motion_of(values)
    unit = y.unit or "1"
    # a sine is of an angle in rad, to which the recording is converted
    swings = motion == "oscillation" and y.unit is not None and compatible(y.unit, "rad")
    factor = factor_offset(unit, "rad")[0] if swings else 1.0
    stated, unit = unit, "rad" if swings else unit
    y = replace(y, low=y.low * factor, high=y.high * factor, first=y.first * factor)
    span = y.high - y.low
    rate = "1/s" if unit == "1" else f"{unit}/s" if not any(c in unit for c in "*/ ") else f"({unit})/s"
    size = f"{y.first - span:.4g}, {y.first + span:.4g}"
    rest = f"{y.low - span:.4g}, {y.high + span:.4g}"
    if motion == "oscillation":
        w = 2 * np.pi * cycles / duration
        away = "sin(x - rest)   # of a pendulum; of a spring: (x - rest)" if swings else "(x - rest)"
        equations = f"x' = v\nv' = -2*zeta*w0*v - w0^2*{away}\n{y.symbol} = x"
        states = {"x": (unit, "start"), "v": (rate, "speed")}
        rows = [
            ("w0", f"{w / 3:.4g}, {3 * w:.4g}", "1/s", "rad/s of the motion if nothing damped it", True),
            ("zeta", "0, 1", "1", "damping ratio", False),
            ("rest", rest, unit, f"where {y.symbol} comes to rest", False),
            ("start", size, unit, f"{y.symbol} at the first sample", False),
            ("speed", f"{-3 * w * span:.4g}, {3 * w * span:.4g}", rate, "its rate there", False),
        ]
    else:
        equations = f"x' = (rest - x) / tau\n{y.symbol} = x"
        states = {"x": (unit, "start")}
        rows = [
            ("tau", f"{period / 5:.4g}, {10 * duration:.4g}", "s", f"time constant of {y.symbol}", True),
            (
                "rest",
                f"{y.low - 3 * span:.4g}, {y.high + 3 * span:.4g}",
                unit,
                f"where {y.symbol} comes to rest",
                False,
            ),
            ("start", size, unit, f"{y.symbol} at the first sample", False),
        ]
    parameters = "".join(
        f"[parameters.{n}]\nbounds = [{bounds}]\n"
        + ('scale = "log"\n' if log else "")
        + ("" if u == "1" else f"unit = {quoted(u)}\n")
        + f"sentence = {quoted(told)}\n\n"
        for n, bounds, u, told, log in rows
    )
    text = (HEAD + _MIDDLE + SEARCH).format(
        source=" ".join(source.split()), spec=" ".join(spec.split()), words=f"{WORDS[motion]} without an input",
        name=quoted(name),
        columns="".join(f"#   {c}\n" for c in columns), path=quoted(path), time=time, split=SPLIT, y=y.symbol,
        signals=f"{y.symbol} = {quoted(y.header)}",
        units=f"units = {{ {y.symbol} = {quoted(stated)} }}    # by the name of the column: correct it\n"
        if y.named
        else "# units = { ... }      # for a column whose header gives none\n" if not y.unit else "",
        equations=equations, unit=quoted(unit), parameters=parameters,
        states=", ".join(f'{x} = {{ unit = {quoted(u)}, initial = "{s}" }}' for x, (u, s) in states.items()),
    )  # fmt: skip
    return text, motion
