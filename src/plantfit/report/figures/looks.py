"""What a look at the data means: the signal around the place, which is shaded, and the samples that it is about."""

from typing import Any

import numpy as np

from plantfit.findings import Recording, array
from plantfit.recording.looks.look import MISREAD, Look
from plantfit.recording.looks.noisy import FEWEST, longest_level
from plantfit.recording.looks.signals import LAGS, news_told
from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import significant, with_unit

POINTS, NEAR = 800, 40  # samples drawn at most; beside a short place
WHOLE = 0.6  # of a record: a place longer than that is shown with all of it
CLOSE = 120  # samples that show the levels of a signal
CLOCK = ("gaps", "irregular")
FAILED = "look that failed"
TIMES = ("sampled slowly", "short", "time unit")
FEW = 20  # samples that show how far apart they are
ROOM = 1.05  # times what is to be seen


def look_figure(look: Look, recording: Recording) -> Figure | None:
    """The signal of a look, the steps of the clock, a record beside a time of the model, or what is new in an input
    beside what an output tells of it; None for looks that failed, and for signals that are not recorded."""
    t = array(recording.t)
    if look.kind in TIMES and len(t) > 1:
        return _beside_time(look, t, recording)
    if look.kind == "feedback":
        return _told(look, t, recording)
    if look.kind in CLOCK and len(t) > 1:
        return _figure(look, t[:-1], np.diff(t), f"step of the clock of {recording.name} [s]", len(t) <= POINTS)
    values, unit = _signal(look.signal, recording)
    if (
        look.kind == FAILED
        or values is None
        or look.begin is None
        or look.end is None
        or not np.any(np.isfinite(values))
    ):
        return None
    begin, end = _window(look, t, values)
    title = with_unit(f"{look.signal} in {recording.name}", unit)
    return _figure(look, t[begin:end], values[begin:end], title, end - begin <= 3 * CLOSE)


def _beside_time(look: Look, t: np.ndarray, recording: Recording) -> Figure | None:
    """The first output, and shaded from its first sample on the time that the bounds ask for."""
    if not recording.outputs or not all(look.figures.get(k) for k in ("seconds", "low", "high")):
        return None
    name, output = next(iter(recording.outputs.items()))
    seconds, low, high = (float(look.figures[k] or 0.0) for k in ("seconds", "low", "high"))
    slowly = seconds >= high
    time, how = (high, "at most") if slowly else (low, "at least")
    shown = min(len(t), FEW) if slowly else len(t)
    values = array(output.measured)[:shown]
    if not np.any(np.isfinite(values)):
        return None
    title = (
        f"{with_unit(f'{name} in {recording.name}', output.unit)}; shaded: {how} {significant(time, 4)} s by the bounds"
    )
    figure = _figure(look, t[:shown], values, title, slowly, shaded=False)
    end = t[0] + time
    figure["layout"]["shapes"] = [_zone(float(t[0]), float(end))]
    figure["layout"]["xaxis"]["range"] = [float(t[0]), float(max(t[shown - 1], t[0] + ROOM * time))]
    return figure


def _told(look: Look, t: np.ndarray, recording: Recording) -> Figure | None:
    """What is new in an input beside what past outputs tell of it, where that is most."""
    (u, unit), (y, _) = _signal(look.signal, recording), _signal(look.other, recording)
    if u is None or y is None or not (np.all(np.isfinite(u)) and np.all(np.isfinite(y))) or len(u) <= 3 * LAGS:
        return None
    new, told = news_told(u, y)
    later = t[len(t) - len(new) :]
    power = np.convolve(told**2, np.ones(min(CLOSE, len(told))), "valid")
    first = int(np.argmax(power))
    here = slice(first, first + CLOSE)
    title = with_unit(
        f"new in {look.signal}, and (coloured) what past values of {look.other} tell of it, in {recording.name}", unit
    )
    figure = _figure(look, later[here], new[here], title, False, shaded=False)
    line = {**figure["data"][0], "y": style.numbers(told[here]), "x": style.numbers(later[here], 9)}
    figure["data"] = [figure["data"][0], {**line, "line": {"color": style.WARNING, "width": 1.6}}]
    return figure


def _signal(name: str | None, recording: Recording) -> tuple[np.ndarray | None, str | None]:
    if name in recording.outputs:
        output = recording.outputs[name]
        return array(output.measured), output.unit
    if name in recording.inputs:
        return array(recording.inputs[name].values), recording.inputs[name].unit
    return None, None


def _window(look: Look, t: np.ndarray, values: np.ndarray) -> tuple[int, int]:
    """Places from and to which the signal is drawn."""
    assert look.begin is not None
    assert look.end is not None
    size = look.figures.get("step") if look.kind == "noisy" else None
    if size is not None and (level := longest_level(values, size))[1] - level[0] >= FEWEST:
        return level  # beside jumps the noise would not be seen
    if look.kind in ("quantised", *MISREAD):
        middle = int(np.argmax(np.abs(np.diff(np.where(np.isfinite(values), values, 0.0)))))
        first = int(np.clip(middle - CLOSE // 2, 0, max(0, len(t) - CLOSE)))
        return first, min(len(t), first + CLOSE)
    first, last = int(np.searchsorted(t, look.begin)), int(np.searchsorted(t, look.end, side="right"))
    if last - first > WHOLE * len(t):
        return 0, len(t)
    beside = max(NEAR, last - first)
    return max(0, first - beside), min(len(t), last + beside)


def _figure(look: Look, t: np.ndarray, values: np.ndarray, title: str, single: bool, *, shaded: bool = True) -> Figure:
    keep = envelope(values, POINTS)
    line = {
        "type": "scatter",
        "mode": "lines+markers" if single else "lines",
        "x": style.numbers(t[keep], 9),
        "y": style.numbers(values[keep]),
        "line": {"color": style.MEASURED, "width": 1.2},
        "marker": {"size": 3.5, "color": style.MEASURED},
        "hovertemplate": "%{y:.5~g}<extra></extra>",
    }
    data = [line]
    marked = np.isin(np.round(t, 9), np.round(array(look.times), 9))
    if np.any(marked):
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": style.numbers(t[marked], 9),
                "y": style.numbers(values[marked]),
                "marker": {"size": 7, "color": style.WARNING},
                "hovertemplate": "%{y:.5~g}<extra></extra>",
            }
        )
    layout = style.layout(170, margin={"l": 56, "r": 14, "t": 26, "b": 40})
    layout["xaxis"] = style.axis("time [s]")
    layout["yaxis"] = style.axis(nticks=4)
    layout["annotations"] = [style.heading(title, 0, 1, font=style.SMALL)]
    short = (
        shaded
        and look.begin is not None
        and look.end is not None
        and len(t) > 1
        and look.end - look.begin < WHOLE * (t[-1] - t[0])
    )
    if short and look.kind not in CLOCK:
        layout["shapes"] = [_zone(look.begin, look.end)]
    return {"data": data, "layout": layout}


def _zone(begin: float | None, end: float | None) -> dict[str, Any]:
    zone = {"type": "rect", "xref": "x", "yref": "paper", "x0": begin, "x1": end, "y0": 0, "y1": 1}
    return zone | {"fillcolor": style.BOUND_ZONE, "line": {"width": 0}, "layer": "below"}
