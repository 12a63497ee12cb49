"""Pictures of what faults look like, as SVG: a record with each fault beside the same plant without it, and each look at the data.

Plants are simulated here, in closed form or by small steps; laws are those that `plantfit diagnose` tries.
"""

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "src"))

from plantfit.models.extensions import KINDS
from plantfit.models.extensions.parts import SHAPES
from plantfit.recording.looks import Look, clock_looks, feedback_look, signal_looks
from plantfit.recording.record import Recording, Signal
from plantfit.trust.diagnosis.candidates import CANDIDATES, Before, Behind
from plantfit.trust.diagnosis.plant.timeless.static import CANDIDATES as PARTS

WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 640, 170, 44, 10, 22
PERIOD, SAMPLES, GAIN, LAG, FINE = 0.05, 240, 2.0, 0.5, 20
SIZES = {
    "dead_time": 0.4, "lag": 0.5, "dead_zone": 0.8, "saturation": 1.2, "backlash": 0.6, "input_offset": 0.6, "viscous": 1.0, "coulomb": 2.5, "quadratic": 0.5, "start": 2.5,
    "sensor_lag": 0.5, "offset": 0.8, "drift": 0.15, "sensor_high": 2.0, "sensor_low": -0.8, "stribeck": 4.0, "change": 0.25,
}  # fmt: skip
STYLE = (
    ".with{stroke:#d97706}.without{stroke:#64748b}.place{fill:#3b82f6;fill-opacity:.15}.mark{fill:#d97706}"
    "text{font:11px sans-serif;fill:#64748b}"
)
T = np.arange(SAMPLES) * PERIOD

Line = tuple[str, np.ndarray, np.ndarray]  # class, times, values


def pictures() -> dict[str, tuple[str, str, str]]:
    """By name of a candidate or look: its heading, what it says, and its SVG."""
    found = {}
    u = np.repeat(np.random.default_rng(2).uniform(-1.5, 2.0, SAMPLES // 40), 40)
    for kind, candidate in CANDIDATES.items():
        signal = {"inputs": "u", "states": "x", "changes": "K with u", "outputs": "y"}[KINDS[kind].to]
        said = KINDS[kind].sentence.format(signal)
        said = said if said.startswith(f"{signal} ") else said[0].upper() + said[1:]
        found[kind] = candidate.name.format(signal), f"{said}.", svg([("without", T, plant(u)), ("with", T, faulty(kind, u))])
    drift = 0.6 * np.sin(2 * np.pi * T / (0.6 * T[-1])) + 0.4 * np.sin(2 * np.pi * T / (1.1 * T[-1]) + 1.0)
    said = KINDS["slow_drift"].sentence.format("y")
    found["slow_drift"] = "slow drift of y", f"{said[0].upper()}{said[1:]}.", svg([("without", T, plant(u)), ("with", T, plant(u) + drift)])
    sun = np.maximum(np.sin(2 * np.pi * T / (0.2 * T[-1])), 0.0)  # five days
    for kind, signal, y in (("cycle", "x", plant(u + sun)), ("sensor_cycle", "y", plant(u) + 0.6 * sun)):
        said = KINDS[kind].sentence.format(signal)
        name = f"daily pattern of {'the sensor of ' if kind == 'sensor_cycle' else ''}{signal}"
        found[kind] = name, f"{said[0].upper()}{said[1:]}.", svg([("without", T, plant(u)), ("with", T, y)])
    late = T >= 0.55 * T[-1]
    for kind, signal, name, y in (
        ("step", "K", "step of K", plant(np.where(late, 1.4, 1.0) * u)),
        ("load_step", "x", "load step of x", plant(u + 0.8 * late)),
        ("sensor_step", "y", "step of the sensor of y", plant(u) + 0.8 * late),
    ):
        said = KINDS[kind].sentence.format(signal)
        said = said if said.startswith(f"{signal} ") else said[0].upper() + said[1:]
        found[kind] = name, f"{said}.", svg([("without", T, plant(u)), ("with", T, y)])
    found |= characteristics()
    for name, recording, look in looks():
        signal = look.signal
        if signal is None:
            lines, place = [("with", recording.t[:-1], np.diff(recording.t))], None
        else:
            lines, place = [("with", recording.t, recording[signal])], (look.begin, look.end)
        found[name] = look.kind, look.sentence, svg(lines, place, look.times)
    return found


def characteristics() -> dict[str, tuple[str, str, str]]:
    """By name of a part that a static model may lack: its heading, what it says, and a curve over u with and without it."""
    found = {}
    for kind, row in PARTS.items():
        u = np.linspace(0.2, 3.0, 100) if kind in ("power", "square", "proportional", "product") else np.linspace(-3.0, 3.0, 201)
        pair, y = "y with u and v" if kind == "product" else "y with u", 1.0 + 0.8 * u
        part = {"power": y * (np.abs(u) ** 0.3 - 1.0), "product": 0.25 * u * 2.0}.get(kind)  # v is 2
        if part is None:
            part = (0.8 if kind == "sign" else 0.15) * np.asarray(SHAPES[kind][0](u))
        said = KINDS[kind].sentence.format(pair)
        heading = row.name.format(y="y", u="u", v="v")
        found[kind] = heading, f"{said[0].upper()}{said[1:]}.", svg([("without", u, y), ("with", u, y + part)], unit="of u")
    return found


def plant(u: np.ndarray, start: float = 0.0, braked: Mapping[str, float] | None = None) -> np.ndarray:
    """x' = (GAIN u - x)/LAG (n,), less friction or a drag, the gain changing with u, from `start`, in steps of a twentieth period."""
    x, y, h = start, np.empty(len(u)), PERIOD / FINE
    own = braked or {}
    for k, v in enumerate(u):
        y[k] = x
        for _ in range(FINE):
            rate = (GAIN * (1.0 + own.get("change", 0.0) * v) * v - x) / LAG
            dry = own.get("coulomb", 0.0) + own.get("stribeck", 0.0) * np.exp(-((x / 0.5) ** 2))
            x += h * (rate - dry * np.tanh(x / 0.02) - own.get("quadratic", 0.0) * x * abs(x) - own.get("viscous", 0.0) * x)
    return y


def faulty(kind: str, u: np.ndarray) -> np.ndarray:
    """The output (n,) of the plant with a fault."""
    candidate, size = CANDIDATES[kind], SIZES[kind]
    if isinstance(candidate, Before):
        return plant(candidate.law(T, u, size, True))
    if isinstance(candidate, Behind):
        return candidate.law(T, plant(u), np.zeros((len(u), 0)), size, 1.0)[0]
    return plant(u, size) if kind == "start" else plant(u, braked={kind: size})


def looks() -> Iterator[tuple[str, Recording, Look]]:
    """A recording that each look is about, and what the look says."""
    rng, n = np.random.default_rng(3), 400
    t, u = np.arange(n) * PERIOD, np.repeat(rng.uniform(-1.5, 2.0, n // 20), 20)
    y = plant(u) + 0.02 * rng.normal(size=n)
    spikes, stuck, missing, marked, gap = y.copy(), y.copy(), y.copy(), y.copy(), t.copy()
    marked[[60, 61, 190, 310]] = -9.99
    spikes[[60, 190, 310]] += [2.5, -3.0, 2.0]
    stuck[150:190], missing[200:240] = stuck[150], np.nan
    gap[250:] += 0.6
    signals = {
        "clipped": np.minimum(y, 1.5), "stuck": stuck, "quantised": np.round(y / 0.2) * 0.2, "spikes": spikes, "missing": missing,
        "no_value": marked,
        "wrapped": 0.06 * np.cumsum(y + 2.5) % (2 * np.pi), "held": np.repeat(y[::8], 8), "filled": np.interp(t, t[::8], y[::8]),
    }  # fmt: skip
    for kind, values in signals.items():
        recording = Recording(t, {"y": Signal(values, "rad" if kind == "wrapped" else "V")}, "record")
        yield kind, recording, next(k for k in signal_looks(recording, "y", True) if k.kind == kind)
    still = Recording(t, {"u": Signal(np.full(n, 2.0), "V")}, "record")
    yield "constant", still, next(iter(signal_looks(still, "u", False)))
    for kind, times in (("gaps", gap), ("irregular", t + 0.4 * PERIOD * rng.uniform(-1, 1, n))):
        recording = Recording(times, {"y": Signal(y, "V")}, "record")
        yield kind, recording, next(k for k in clock_looks(recording) if k.kind == kind)
    yield "feedback", *_loop(rng, t)


def _loop(rng: np.random.Generator, t: np.ndarray) -> tuple[Recording, Look]:
    """An input that a controller computes from the noisy output."""
    x, decay, u, y = 0.0, np.exp(-PERIOD / LAG), np.empty(len(t)), np.empty(len(t))
    for k in range(len(t)):
        y[k] = x + 0.1 * rng.normal()
        u[k] = 1.5 * (np.sign(np.sin(t[k])) - y[max(k - 1, 0)])
        x = decay * x + (1 - decay) * GAIN * u[k]
    recording = Recording(t, {"u": Signal(u, "V"), "y": Signal(y, "V")}, "record")
    look = feedback_look(recording, "u", "y")
    assert look is not None
    return recording, look


def svg(lines: list[Line], place: tuple[float, float] | None = None, times: tuple[float, ...] = (), unit: str = "s") -> str:
    """Lines over time (or what else has the `unit`) with their range, a place that is shaded and samples that are marked; colours fit light and dark pages."""
    t, y = (np.concatenate([line[k] for line in lines]) for k in (1, 2))
    low, high = float(np.nanmin(y)), float(np.nanmax(y))
    low, high = (low - 1.0, high + 1.0) if low == high else (low - 0.05 * (high - low), high + 0.05 * (high - low))

    def at(a: float, b: float) -> str:
        right = LEFT + (WIDTH - LEFT - 10) * (a - t.min()) / np.ptp(t)
        return f"{right:.1f},{TOP + (HEIGHT - TOP - BOTTOM) * (high - b) / (high - low):.1f}"

    made = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}"><style>{STYLE}</style>']
    if place is not None and place[1] - place[0] < 0.6 * np.ptp(t):
        (x0, y0), (x1, y1) = (at(place[0], high).split(","), at(place[1], low).split(","))
        made.append(f'<rect class="place" x="{x0}" y="{y0}" width="{float(x1) - float(x0):.1f}" height="{float(y1) - float(y0):.1f}"/>')
    for name, own, values in lines:
        parts = (" ".join(at(a, b) for a, b in part) for part in _pieces(own, values))
        made += [f'<polyline class="{name}" fill="none" stroke-width="1.3" points="{points}"/>' for points in parts]
    own, values = lines[-1][1], lines[-1][2]
    for mark in times:
        x, y0 = at(mark, float(values[np.argmin(np.abs(own - mark))])).split(",")
        made.append(f'<circle class="mark" cx="{x}" cy="{y0}" r="3"/>')
    for value in (low, high):
        height = float(at(t.min(), value).split(",")[1]) + 4
        made.append(f'<text x="{LEFT - 4}" y="{height:.0f}" text-anchor="end">{value:.2g}</text>')
    made.append(f'<text x="{WIDTH - 10}" y="{HEIGHT - 6}" text-anchor="end">{np.ptp(t):.3g} {unit}</text></svg>')
    return "".join(made)


def _pieces(t: np.ndarray, values: np.ndarray) -> Iterator[list[tuple[float, float]]]:
    """Stretches without missing values."""
    good = np.isfinite(values)
    for part in np.split(np.arange(len(t)), np.flatnonzero(np.diff(good)) + 1):
        if len(part) and good[part[0]]:
            yield list(zip(t[part].tolist(), values[part].tolist(), strict=True))
