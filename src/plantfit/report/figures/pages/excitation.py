"""A waveform over time and its amplitude spectrum."""

import numpy as np

from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import with_unit

_POINTS = 4000


def waveform_figure(t: np.ndarray, values: np.ndarray, name: str, unit: str | None, timeless: bool = False) -> Figure:
    """Values (n,), each held until the next time (s); `timeless` ones are shown by their number."""
    t = np.arange(1.0, len(values) + 1) if timeless else t
    keep = envelope(values, _POINTS)
    line = {
        "type": "scatter",
        "mode": "lines",
        "x": style.numbers(t[keep], 9),
        "y": style.numbers(values[keep]),
        "line": {"color": style.INPUT, "width": 1.4, "shape": "hv" if len(t) <= _POINTS else "linear"},
        "hovertemplate": f"%{{x:.4g}}{'' if timeless else ' s'}: %{{y:.4g}}<extra></extra>",
    }
    layout = style.layout(
        280, xaxis=style.axis("sample" if timeless else "time [s]"), yaxis=style.axis(with_unit(name, unit))
    )
    return {"data": [line], "layout": layout | {"margin": {"l": 56, "r": 14, "t": 14, "b": 44}}}


def spectrum_figure(frequencies: np.ndarray, amplitudes: np.ndarray, name: str, unit: str | None) -> Figure:
    """Amplitudes (k,) of the sines at `frequencies` (Hz) that make up a waveform; the mean is left out."""
    f, a = frequencies[1:], amplitudes[1:]
    keep = envelope(a, _POINTS)
    line = {
        "type": "scatter",
        "mode": "lines",
        "x": style.numbers(f[keep], 7),
        "y": style.numbers(a[keep], 4),
        "line": {"color": style.INPUT, "width": 1},
        "fill": "tozeroy",
        "hovertemplate": "%{x:.4g} Hz: %{y:.3g}<extra></extra>",
    }
    layout = style.layout(
        260, xaxis=style.log_axis("frequency [Hz]", f), yaxis=style.axis(with_unit(f"amplitude of {name}", unit))
    )
    return {"data": [line], "layout": layout | {"margin": {"l": 56, "r": 14, "t": 14, "b": 44}}}
