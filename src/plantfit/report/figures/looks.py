"""What a look at the data means: the signal around the place, which is shaded, and the samples that it is about."""

import numpy as np

from plantfit.findings import Recording, array
from plantfit.recording.looks.look import Look
from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import with_unit

POINTS, NEAR = 800, 40  # samples drawn at most; beside a short place
WHOLE = 0.6  # of a record: a place longer than that is shown with all of it
CLOSE = 120  # samples that show the levels of a signal
CLOCK = ("gaps", "irregular")
NOWHERE = ("feedback", "look that failed")


def look_figure(look: Look, recording: Recording) -> Figure | None:
    """The signal of a look, or the steps of the clock; None for looks that are about no place, and for signals that are not recorded."""
    t = array(recording.t)
    if look.kind in CLOCK and len(t) > 1:
        return _figure(look, t[:-1], np.diff(t), f"step of the clock of {recording.name} [s]", len(t) <= POINTS)
    values, unit = _signal(look, recording)
    if look.kind in NOWHERE or values is None or look.begin is None or look.end is None or not np.any(np.isfinite(values)):
        return None
    begin, end = _window(look, t, values)
    title = with_unit(f"{look.signal} in {recording.name}", unit)
    return _figure(look, t[begin:end], values[begin:end], title, end - begin <= 3 * CLOSE)


def _signal(look: Look, recording: Recording) -> tuple[np.ndarray | None, str | None]:
    if look.signal in recording.outputs:
        output = recording.outputs[look.signal]
        return array(output.measured), output.unit
    if look.signal in recording.inputs:
        return array(recording.inputs[look.signal].values), recording.inputs[look.signal].unit
    return None, None


def _window(look: Look, t: np.ndarray, values: np.ndarray) -> tuple[int, int]:
    """Places from and to which the signal is drawn."""
    assert look.begin is not None
    assert look.end is not None
    if look.kind == "quantised":
        middle = int(np.argmax(np.abs(np.diff(np.where(np.isfinite(values), values, 0.0)))))
        first = int(np.clip(middle - CLOSE // 2, 0, max(0, len(t) - CLOSE)))
        return first, min(len(t), first + CLOSE)
    first, last = int(np.searchsorted(t, look.begin)), int(np.searchsorted(t, look.end, side="right"))
    if last - first > WHOLE * len(t):
        return 0, len(t)
    beside = max(NEAR, last - first)
    return max(0, first - beside), min(len(t), last + beside)


def _figure(look: Look, t: np.ndarray, values: np.ndarray, title: str, single: bool) -> Figure:
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
    short = look.begin is not None and look.end is not None and len(t) > 1 and look.end - look.begin < WHOLE * (t[-1] - t[0])
    if short and look.kind not in CLOCK:
        zone = {"type": "rect", "xref": "x", "yref": "paper", "x0": look.begin, "x1": look.end, "y0": 0, "y1": 1}
        layout["shapes"] = [zone | {"fillcolor": style.BOUND_ZONE, "line": {"width": 0}, "layer": "below"}]
    return {"data": data, "layout": layout}
