"""Virtual steam chamber: a valve, a process of known tables and dead times, a pressure transducer and its input
card."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any

import numpy as np
import scipy  # scipy.signal is loaded at its first use

from plantfit.errors import SimulationError
from plantfit.models.library.steam_chamber import steam_chamber
from plantfit.recording.record import Recording, Signal
from plantfit.rig.run import RigRun
from plantfit.runtime import jit
from plantfit.simulate.simulator import Simulator

OPENINGS = tuple(range(10, 101, 10))  # %
DURATIONS = (450.0, 400.0, 350.0, 300.0, 250.0, 200.0, 160.0, 130.0, 110.0, 90.0)  # s, of the openings
NODES = np.linspace(0.0, 20.0, 10)  # bar
ERROR_LIMITS = {"pressure transducer": 0.1, "analog input card": 0.3}  # % of full scale, table 5 of the paper
TABLES = ("k", "A1", "A2")
_UNDER, _OVER = -0.2 / 16, 16.5 / 16  # 3.8 and 20.5 mA of 4 to 20 mA, the readings that NAMUR NE 43 calls valid
_PAD = 5000  # samples that runs are filled up to a multiple of, so that most share one program


def smooth_truth(opening: float) -> dict[str, Any]:
    """Tables k (bar/%), A1 (s), A2 (s^2) over `NODES` and the dead time Td (s) of an opening (%), made up.

    The chamber settles near 20 u/(u + 6.2) bar; s is the pressure's share of it.

        k = 20/(u + 6.2) (1 + 0.15 (0.85 - s)),  A1 = T (1.244 + 0.45 (0.5 - s) - 1.8 (s - 0.5)^2),
        A2 = 15 sqrt(T/45) (0.85 + 0.3 s),  T = 18 (100/u)^0.7 s,  Td = 0.2 + 0.6 ((100 - u)/90)^1.5

    One model of constants for each opening then misses about what the paper's static task missed.
    """
    u = float(opening)
    settled, slow = 20.0 / (u + 6.2), 18.0 * (100.0 / u) ** 0.7
    s = np.minimum(NODES / (settled * u), 1.05)
    return {
        "k": settled * (1.0 + 0.15 * (0.85 - s)),
        "A1": slow * (1.244 + 0.45 * (0.5 - s) - 1.8 * (s - 0.5) ** 2),
        "A2": 15.0 * np.sqrt(slow / 45.0) * (0.85 + 0.3 * s),
        "Td": 0.2 + 0.6 * ((100.0 - u) / 90.0) ** 1.5,
    }


@dataclass(frozen=True, eq=False)
class SteamChamberRig:
    """A chamber on a bench, and what the transducer and the card record of its pressure.

    `truth` maps an opening (%) to tables k, A1, A2 (10,) over `NODES` and Td (s), as `smooth_truth`. Readings are
    `bits` of a `span` (bar): 39/4096 = 0.0095 bar a step. `noise` (bar rms) is that of a sample. Each of `error_limits`
    (% of span) bounds an instrument's error, which is a straight line over the pressure, its ends at zero and full
    scale drawn evenly within the limits, one draw for each seed. `zeroed` takes the error at rest off, as who sets the
    zero before a step does; `errors=False` has none. The valve moves within `valve_limits` (%) at `valve_rate` (%/s) at
    most. `drift` (share, rms) is that of the supply, wandering with the time constant `drift_time` (s). A sample every
    `period` s; `substeps` of the simulation between two.
    """

    truth: Any = smooth_truth
    span: float = 39.0
    bits: int = 12
    noise: float = 0.05
    error_limits: Mapping[str, float] = field(default_factory=lambda: dict(ERROR_LIMITS))
    errors: bool = True
    zeroed: bool = True
    valve_limits: tuple[float, float] = (0.0, 100.0)
    valve_rate: float = np.inf
    drift: float = 0.0
    drift_time: float = 120.0
    period: float = 0.1
    substeps: int = 8

    def __post_init__(self) -> None:
        for name in ("span", "bits", "valve_rate", "drift_time", "period", "substeps"):
            if not getattr(self, name) > 0:
                raise SimulationError(f"The steam rig's {name} is {getattr(self, name)}; give a number above 0.")
        for name in ("noise", "drift"):
            if not getattr(self, name) >= 0:
                raise SimulationError(f"The steam rig's {name} is {getattr(self, name)}; give 0 or more.")
        low, high = self.valve_limits
        if not 0 <= low < high <= 100:
            raise SimulationError(
                f"The steam rig's valve_limits are {self.valve_limits}; "
                "give two openings (%), low and high, in 0 to 100."
            )

    # -- what a user calls ------------------------------------------------------------------------

    def record(self, opening: float | Recording, seed: int, duration: float | None = None) -> RigRun:
        """The step from rest and a closed valve to `opening` (%, above 0) at t = 0, for `duration` s (those of the
        paper if left out).

        A recording with a signal u (%) and the rig's period moves the valve in place of one step; the truth is that of
        its first opening.

        The recording has u (%, what the valve was told) and y (bar); `exact` the valve, the supply's factor and the
        pressure. The instruments' errors come from `seed` alone, so that ten openings of one seed share a set-up.
        Raises SimulationError for an opening that is no share of a valve.
        """
        if isinstance(opening, Recording):
            t, told_valve, name = self._moved(opening)
            opening = float(told_valve[0])
        else:
            _check_opening(opening)
            length = float(np.interp(opening, OPENINGS, DURATIONS)) if duration is None else float(duration)
            if not length >= self.period:
                raise SimulationError(f"The duration is {length:g} s; give at least one period, {self.period:g} s.")
            t, name = np.arange(round(length / self.period) + 1) * self.period, f"opening{opening:g}"
            told_valve = np.full(len(t), float(opening))
        rng = np.random.default_rng([seed, round(1000 * opening)])
        valve, supply = self._valve(told_valve, t), self._supply(rng, len(t))
        p = self.truth(opening)
        y = simulated(p, t, valve * supply, self.substeps)
        errors = self.instrument_errors(seed)
        line = sum(
            (e["zero"] + (e["full_scale"] - e["zero"]) * y / self.span for e in errors.values()), np.zeros(len(t))
        )
        shown = self._converted(y + line + self.noise * rng.standard_normal(len(t)))
        if self.zeroed:
            shown = shown - sum(e["zero"] for e in errors.values())
        told = (
            f"Virtual steam chamber, seed {seed}: {self.noise:g} bar "
            f"rms noise, {self.span / 2**self.bits:.4f} bar a step, "
            + (
                "no instrument errors."
                if not self.errors
                else "zero set before the step."
                if self.zeroed
                else "zero not set."
            )
        )
        truth = {
            "seed": seed, "opening": float(opening), "parameters": {n: np.asarray(v).tolist() for n, v in p.items()},
            "instrument_errors_bar": errors,
            "settings": {n: getattr(self, n) for n in ("span", "bits", "noise", "errors", "zeroed", "drift",
                                                       "drift_time", "period")},
        }  # fmt: skip
        seen = {"u": Signal(told_valve, "%"), "y": Signal(shown, "bar")}
        true = {"valve": Signal(valve, "%"), "supply": Signal(supply, "1"), "y": Signal(y, "bar")}
        exact = Recording(t, true, name, ("Virtual steam chamber: exact signals.",))
        return RigRun(Recording(t, seen, name, (told,)), exact, truth)

    def records(self, seed: int, openings: tuple[float, ...] = OPENINGS) -> dict[str, RigRun]:
        """One run of every opening, "opening10" to "opening100", on one set-up."""
        return {(run := self.record(u, seed)).recording.name: run for u in openings}

    def instrument_errors(self, seed: int) -> dict[str, dict[str, float]]:
        """Each instrument's error (bar) at zero and at full scale."""
        if not self.errors:
            return {}
        rng = np.random.default_rng([seed, 39])
        draw = lambda limit: float(rng.uniform(-1.0, 1.0) * limit / 100.0 * self.span)  # noqa: E731
        return {name: {"zero": draw(limit), "full_scale": draw(limit)} for name, limit in self.error_limits.items()}

    # -- inside -----------------------------------------------------------------------------------

    def _moved(self, openings: Recording) -> tuple[np.ndarray, np.ndarray, str]:
        """Times (N,), openings (N,) (%) held between the samples of a recording, and its name."""
        if "u" not in openings.signals:
            raise SimulationError(
                f"The excitation {openings.name!r} has no signal 'u'; it has {list(openings.signals)}."
            )
        t = np.arange(round(float(openings.t[-1] - openings.t[0]) / self.period) + 1) * self.period
        values = openings["u"][np.searchsorted(openings.t - openings.t[0], t + 5e-10, side="right") - 1]
        for worst in (values.min(), values.max()):
            _check_opening(float(worst))
        return t, values, openings.name

    def _valve(self, told: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Where the valve is (%), (N,), that was told (N,): within its limits, from its closed end at its rate."""
        low, high = self.valve_limits
        wanted = np.clip(told, low, high)
        if not np.isfinite(self.valve_rate):
            return wanted
        if np.all(wanted == wanted[0]):
            return np.minimum(wanted, low + self.valve_rate * t)
        reached, most = np.empty(len(t)), self.valve_rate * self.period
        at = low
        for k, goal in enumerate(wanted):
            reached[k] = at
            at += float(np.clip(goal - at, -most, most))
        return reached

    def _supply(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Factor (N,) of the supply, 1 on average: an Ornstein-Uhlenbeck process sampled."""
        draws = rng.standard_normal(n)
        memory = float(np.exp(-self.period / self.drift_time))
        draws[1:] *= np.sqrt(1.0 - memory**2)
        return 1.0 + self.drift * scipy.signal.lfilter([1.0], [1.0, -memory], draws)

    def _converted(self, y: np.ndarray) -> np.ndarray:
        step = self.span / 2**self.bits
        return step * np.round(np.clip(y, _UNDER * self.span, _OVER * self.span) / step)


def _check_opening(opening: float) -> None:
    if not 0 < opening <= 100:
        raise SimulationError(f"The opening is {opening}; give a number above 0 and at most 100 (%).")


def simulated(p: Mapping[str, Any], t: np.ndarray, opening: np.ndarray, substeps: int) -> np.ndarray:
    """Pressure (N,) bar under openings (N,) %, each held until the next sample, after rest with the valve closed."""
    n = len(t)
    padded = -(-n // _PAD) * _PAD
    period = float(t[1] - t[0])
    later = np.arange(padded) * period
    simulator, outputs = _compiled(substeps)
    drive = simulator.drive(later, {"u": np.r_[opening, np.full(padded - n, opening[-1])]}, before={"u": 0.0})
    return np.asarray(outputs({k: np.asarray(v, dtype=float) for k, v in p.items()}, drive)["y"])[:n]


@lru_cache(maxsize=4)
def _compiled(substeps: int) -> tuple[Simulator, Any]:
    simulator = Simulator.of(steam_chamber(nodes=NODES.tolist()), substeps=substeps)
    return simulator, jit(partial(simulator.outputs))
