"""The pictures of docs/verdict.md as SVG, drawn from computed curves by the build."""

from collections.abc import Iterable, Sequence

import numpy as np

WIDE, HIGH = 640, 220
BLUE, RED, GREY, GREEN = "#2563eb", "#dc2626", "#8b8f98", "#15803d"


def pictures() -> dict[str, str]:
    """SVG by name."""
    return {"unseen": _unseen(), "residuals": _residuals(), "intervals": _intervals(), "searches": _searches()}


def _page(parts: Iterable[str]) -> str:
    inner = "\n".join(parts)
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDE} {HIGH}" font-family="sans-serif" font-size="13">'
    return f"{head}\n{inner}\n</svg>\n"


def _line(x: Sequence[float] | np.ndarray, y: Sequence[float] | np.ndarray, colour: str, wide: float = 2, dash: str = "") -> str:
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{wide}" stroke-dasharray="{dash}"/>'


def _text(x: float, y: float, text: str, colour: str = GREY, anchor: str = "start") -> str:
    return f'<text x="{x}" y="{y}" fill="{colour}" text-anchor="{anchor}">{text}</text>'


def _dot(x: float, y: float, colour: str, size: float = 2) -> str:
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{size}" fill="{colour}"/>'


def _unseen() -> str:
    """A first-order response measured and followed; on the unseen part one model holds and another does not."""
    t = np.linspace(0, 10, 320)
    u = np.where(t < 3, 1.0, np.where(t < 6.5, 0.2, 1.3))
    y = np.zeros_like(t)
    for k in range(len(t) - 1):
        y[k + 1] = y[k] + (u[k] - y[k]) * (t[1] - t[0]) / 0.8
    noisy = y + np.random.default_rng(1).normal(0, 0.03, len(t))
    drift = y + 0.09 * np.maximum(t - 6.5, 0)
    x = 20 + 600 * t / 10
    edge = 20 + 600 * 0.65

    def down(v):
        return 185 - 95 * v

    dots = [_dot(a, b, GREY, 1.6) for a, b in zip(x[::3], down(noisy)[::3], strict=True)]
    late = t >= 6.5
    return _page(
        [
            f'<rect x="{edge}" y="10" width="{620 - edge}" height="190" fill="{GREY}" opacity="0.12"/>',
            *dots,
            _line(x, down(y), BLUE),
            _line(x[late], down(drift)[late], RED, dash="5 4"),
            _text(26, 26, "fitted"),
            _text(edge + 6, 194, "not seen by the fit"),
            _text(520, 40, "does not hold", RED, "end"),
            _text(612, 92, "holds", BLUE, "end"),
        ]
    )


def _residuals() -> str:
    """Autocorrelation of white residuals and of residuals in which something systematic is left."""
    parts = []
    rng = np.random.default_rng(2)
    for place, keep, title, colour in ((20, 0.0, "white: only noise is left", BLUE), (340, 0.9, "not white: something is missing", RED)):
        e = rng.normal(size=400)
        for k in range(1, 400):
            e[k] += keep * e[k - 1]
        r = [float(np.sum(e[: 400 - k] * e[k:]) / np.sum(e * e)) for k in range(25)]
        x = place + 11 * np.arange(25)
        bound = 1.96 / 20
        parts.append(f'<rect x="{place}" y="{150 - 110 * bound}" width="270" height="{220 * bound}" fill="{GREY}" opacity="0.2"/>')
        parts += [_line([a, a], [150, 150 - 110 * b], colour, 4) for a, b in zip(x, r, strict=True)]
        parts += [
            _line([place, place + 270], [150, 150], GREY, 1),
            _text(place, 24, title, colour),
            _text(place + 270, 205, "lag", GREY, "end"),
        ]
    return _page(parts)


def _intervals() -> str:
    """A value with the range that the data allow, for each status."""
    rows = (
        ("determined", 0.5, 0.44, 0.56, GREEN),
        ("only roughly known", 0.45, 0.25, 0.8, "#b45309"),
        ("not determined", 0.5, 0.0, 1.0, RED),
        ("on its bound", 1.0, 0.86, 1.0, "#b45309"),
    )
    parts = [
        _line([200, 200], [20, 195], GREY, 1, "3 3"),
        _line([600, 600], [20, 195], GREY, 1, "3 3"),
        _text(400, 212, "bounds of the search", anchor="middle"),
    ]
    for k, (name, value, low, high, colour) in enumerate(rows):
        y = 42 + 44 * k
        parts += [
            _line([200 + 400 * low, 200 + 400 * high], [y, y], colour, 6),
            _dot(200 + 400 * value, y, colour, 7),
            _text(20, y + 5, name, colour),
        ]
    return _page(parts)


def _searches() -> str:
    """A cost with two optima, and where searches from several starts end."""
    p = np.linspace(0, 1, 300)
    cost = 0.65 - 0.42 * np.exp(-(((p - 0.72) / 0.12) ** 2)) - 0.25 * np.exp(-(((p - 0.22) / 0.1) ** 2)) + 0.08 * np.sin(3 * p)
    x, y = 20 + 600 * p, 200 - 250 * cost
    parts = [_line(x, y, GREY)]
    for start in (0.05, 0.14, 0.33, 0.52, 0.62, 0.85, 0.95):
        end = 0.72 if start > 0.45 else 0.22
        places = np.interp([start, end], p, x)
        heights = np.interp([start, end], p, y)
        colour = GREEN if end > 0.5 else RED
        parts += [_dot(places[0], heights[0], colour, 4), _line(places, heights, colour, 1, "2 4")]
    best, worse = np.interp([0.72, 0.22], p, x), np.interp([0.72, 0.22], p, y)
    parts += [_dot(best[0], worse[0], GREEN, 7), _dot(best[1], worse[1], RED, 7)]
    parts += [
        _text(best[0], worse[0] + 24, "best optimum: 4 of 7 searches", GREEN, "middle"),
        _text(best[1], worse[1] + 24, "a worse one", RED, "middle"),
    ]
    return _page(parts)
