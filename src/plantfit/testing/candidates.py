"""Conformance of candidates of a diagnosis: what every addition that a package brings must keep.

from plantfit.testing import check_candidate
check_candidate("sensor_curve", my_package.sensor_curve)
"""

import math
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models import equations
from plantfit.models.extensions import Kind, parameter_name
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.trust.diagnosis.candidates import PLACES, Before, Behind, Inside
from plantfit.trust.diagnosis.ranges import Seen, Tried

PERIOD, HELD, SAMPLES = 0.05, 40, 400
SIGNALS = {"inputs": "u", "states": "x", "changes": "K with x", "outputs": "y"}
GAIN, LAG = 3.0, 0.4
SCALE, STEP = 2.5, 1e-6
CLOSE = 0.25  # of the effect: by how much law and model may differ, which treat what is between samples each in its way


def check_candidate(kind: str, candidate: Any, extension: Kind | None = None) -> None:
    """Try a candidate on an input of steps and the output of a lag of first order.

    Its name, phrase and sentence name the signal and the value; where it is tried there is a range, with the values to
    begin with inside; the bounds for the study file hold the value that is found. At zero its law changes nothing (of a
    `level` at one end of its range), at the values to begin with it changes something, in finite numbers, the same
    twice; derivatives agree with differences, and the law with the model that has the `extension`. Raises
    AssertionError with what was expected and what came.
    """
    own = extension or getattr(candidate, "extension", None)
    _expect(
        type(candidate) in PLACES,
        kind,
        f"a {type(candidate).__name__} was given; give a Before, Inside, Changing or Behind",
    )
    _expect(isinstance(own, Kind), kind, "it has no extension, a plantfit.models.extensions.Kind")
    assert isinstance(own, Kind)
    place = PLACES[type(candidate)]
    _expect(own.to == place, kind, f"it is tried on {place}, and its extension is to {own.to}")
    _words(kind, candidate, own)
    for value in (0.8, 0.02):
        low, high = candidate.bounds(0.01, 3.0, value)
        _expect(
            low < value < high,
            kind,
            f"bounds({0.01}, {3.0}, {value}) are {low} and {high}, which do not hold the value",
        )
    t, u = np.arange(SAMPLES) * PERIOD, np.repeat(np.random.default_rng(0).uniform(-2.0, 3.0, SAMPLES // HELD), HELD)
    bare = _Plant(t, u)
    if isinstance(candidate, Inside):
        _inside(kind, candidate, own, bare)
        return
    seen = u if isinstance(candidate, Before) else bare.y
    tried = _tried(kind, candidate, seen)
    starts = tried.starts or (_ahead(tried),)
    for value in starts:
        _law(kind, candidate, t, seen, value)
    nothing = _neutral(kind, candidate, tried, lambda v: _shown(candidate, t, seen, v), seen)
    value = starts[len(starts) // 2]
    model = bare.with_addition(kind, own, SIGNALS[place], value)
    if isinstance(candidate, Before):
        by_law = _Plant(t, np.asarray(candidate.law(t, u.copy(), value, True), dtype=float)).y
    else:
        by_law = _shown(candidate, t, bare.y, value)
    effect = float(np.sqrt(np.mean((by_law - bare.y) ** 2)))
    apart = float(np.sqrt(np.mean((model - by_law) ** 2)))
    _expect(effect > 0, kind, f"at {value:g} its law changes nothing")
    _expect(
        apart <= CLOSE * effect,
        kind,
        f"its law and its model differ by {apart:.3g} at {value:g}, where the law changes {effect:.3g}",
    )
    nothing = nothing if candidate.level else max(nothing, tried.low)  # a time constant of zero cannot be simulated
    left, size = bare.with_addition(kind, own, SIGNALS[place], nothing), float(np.ptp(bare.y))
    _expect(
        np.allclose(left, bare.y, atol=0.01 * size),
        kind,
        f"at {nothing:g}, where its law changes nothing, its model is another one",
    )


class _Plant:
    """x' = (K u - x)/tau, y = x, by plantfit; its output (n,)."""

    def __init__(self, t: np.ndarray, u: np.ndarray):
        self.recording = Recording(t, {"u": Signal(u, "V"), "y": Signal(np.zeros(len(t)), "m/s")}, "exam")
        self.model = equations(
            "x' = (K*u - x)/tau; y = x", inputs={"u": "V"}, states={"x": {"unit": "m/s", "initial": 0.5}},
            outputs={"y": "m/s"},
            parameters={"K": {"bounds": (0.1, 100.0), "unit": "m/s/V"}, "tau": {"bounds": (0.01, 10.0), "unit": "s"}},
        )  # fmt: skip
        self.y = self._simulated(self.model, {})

    def with_addition(self, kind: str, extension: Kind, signal: str, value: float, others: float = 1e-3) -> np.ndarray:
        """The output (n,) with the addition at a value; other parameters that it brings have the value `others`."""
        name, size = parameter_name(kind, signal), abs(value) + 1.0
        try:
            model = extension.make(self.model, signal, (value - size, value + size), name)
        except Exception as failure:
            raise AssertionError(
                f"Candidate {kind!r}: its model cannot be made ({type(failure).__name__}: {failure})."
            ) from failure
        brought = {p.name for p in model.parameters} - {p.name for p in self.model.parameters}
        _expect(name in brought, kind, f"its model has no parameter {name!r}; it brings {sorted(brought)}")
        return self._simulated(model, {**dict.fromkeys(brought, others), name: value})

    def _simulated(self, model: Any, values: dict[str, float]) -> np.ndarray:
        problem = Problem(model, self.recording, dict(values), substeps=16)
        given = {"K": GAIN, "tau": LAG}
        return problem.predict(np.array([given[n] for n in problem.space.names]))["y"]


def _words(kind: str, candidate: Any, extension: Kind) -> None:
    texts = {"name": (candidate.name, ("SIGNAL",)), "phrase": (candidate.phrase, ("VALUE", "SIGNAL"))}
    texts |= {"sentence of its extension": (extension.sentence, ("SIGNAL",))}
    for what, (text, words) in texts.items():
        try:
            said = text.format(*words)
        except (IndexError, KeyError, ValueError):
            said = ""
        _expect(
            all(said.count(w) == 1 for w in words),
            kind,
            f"its {what} is {text!r}, which does not take {' and '.join(words).lower()}",
        )
    _expect(kind.isidentifier(), kind, "it is no name for a key of a study file")


def _tried(kind: str, candidate: Any, values: np.ndarray) -> Tried:
    times = tuple(PERIOD * k for k in (1.0, 3.0, 9.0, 27.0))
    for what, own in (("a constant", np.full(SAMPLES, 2.0)), ("zero", np.zeros(SAMPLES))):
        try:
            candidate.tried(Seen("V", own, SAMPLES * PERIOD, PERIOD, times))
        except Exception as failure:
            raise AssertionError(
                f"Candidate {kind!r}: `tried` fails at {what} ({type(failure).__name__}: {failure})."
            ) from failure
    tried = candidate.tried(Seen("V", values, SAMPLES * PERIOD, PERIOD, times))
    _expect(isinstance(tried, Tried), kind, f"`tried` gives {tried!r} for a signal that moves, not a Tried")
    _expect(tried.low < tried.high, kind, f"its range is {tried.low} to {tried.high}")
    _expect(
        all(tried.low <= s <= tried.high for s in tried.starts),
        kind,
        f"it begins at {tried.starts}, outside of its range",
    )
    _expect(
        bool(tried.starts) != candidate.linear,
        kind,
        "values to begin with are for what is not `linear`, and needed there",
    )
    return tried


def _ahead(tried: Tried) -> float:
    """A value of a linear effect that would be seen."""
    return (
        0.3
        if not (math.isfinite(tried.low) and math.isfinite(tried.high))
        else tried.low + 0.3 * (tried.high - tried.low)
    )


def _neutral(kind: str, candidate: Any, tried: Tried, shown: Any, seen: np.ndarray) -> float:
    """The value at which nothing is changed."""
    at = [v for v in (tried.low, tried.high) if math.isfinite(v)] if candidate.level else [0.0]
    size = max(float(np.max(np.abs(seen))), 1.0)
    same = [v for v in at if np.allclose(shown(v), seen, rtol=0, atol=1e-9 * size)]
    where = "at both ends of its range" if candidate.level else "at zero, where it is nothing,"
    _expect(same, kind, f"{where} its law changes the signal")
    return float(same[0])


def _shown(candidate: Any, t: np.ndarray, signal: np.ndarray, value: float) -> np.ndarray:
    """What the law makes of a signal (n,), in its unit."""
    if isinstance(candidate, Before):
        return np.asarray(candidate.law(t, signal.copy(), value, True), dtype=float)
    return (
        np.asarray(candidate.law(t, signal / SCALE, np.zeros((len(signal), 0)), value, SCALE)[0], dtype=float) * SCALE
    )


def _law(kind: str, candidate: Any, t: np.ndarray, signal: np.ndarray, value: float) -> None:
    law: Any = candidate.law
    for more in ((value, True), (value, False)) if isinstance(candidate, Before) else ((value, SCALE),):
        given = [t.copy(), signal.copy(), *([] if isinstance(candidate, Before) else [np.ones((len(t), 1))])]
        before = [a.copy() for a in given]
        try:
            one, two = (_parts(law(*given, *more)) for _ in range(2))
        except Exception as failure:
            raise AssertionError(
                f"Candidate {kind!r}: its law fails at {value:g} ({type(failure).__name__}: {failure})."
            ) from failure
        _expect(
            all(np.all(np.isfinite(a)) for a in one), kind, f"its law gives numbers that are not finite at {value:g}"
        )
        _expect(one[0].shape == signal.shape, kind, f"its law gives shape {one[0].shape} for {signal.shape}")
        _expect(all(map(np.array_equal, one, two)), kind, "its law gives something else when called twice")
        _expect(all(map(np.array_equal, given, before)), kind, "its law changed what it was given")
    if isinstance(candidate, Behind):
        _derivatives(kind, candidate, t, signal, value)


def _parts(given: Any) -> list[np.ndarray]:
    return [np.asarray(a, dtype=float) for a in (given if isinstance(given, tuple) else (given,)) if a is not None]


def _derivatives(kind: str, candidate: Behind, t: np.ndarray, signal: np.ndarray, value: float) -> None:
    """By the plant's parameters and by the value, against differences; but where the law has a corner."""
    direction = np.random.default_rng(1).normal(size=len(t))

    def shown(a: float, v: float) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        return candidate.law(t, signal / SCALE + a * direction, direction[:, None].copy(), v, SCALE)

    _, slopes, by_value = shown(0.0, value)
    _near(kind, slopes[:, 0], shown(STEP, value)[0], shown(-STEP, value)[0], "derivatives by the plant's parameters")
    _expect(
        (by_value is None) == candidate.differenced,
        kind,
        "a derivative by the value is for what is not `differenced`, and needed there",
    )
    if by_value is not None:
        _near(
            kind,
            np.asarray(by_value),
            shown(0.0, value + STEP)[0],
            shown(0.0, value - STEP)[0],
            "derivatives by its value",
        )
    if candidate.linear:
        zero, one, two = (shown(0.0, k * value)[0] for k in (0.0, 1.0, 2.0))
        _expect(
            np.allclose(two - zero, 2.0 * (one - zero), rtol=1e-9),
            kind,
            "it is called linear, and its law is no straight line of the value",
        )


def _near(kind: str, slopes: np.ndarray, above: np.ndarray, below: np.ndarray, what: str) -> None:
    differences = (above - below) / (2.0 * STEP)
    wrong = np.abs(slopes - differences) > 1e-4 * max(float(np.max(np.abs(differences))), 1e-12)
    _expect(np.mean(wrong) <= 0.02, kind, f"{what} differ from differences at {np.sum(wrong)} of {len(wrong)} samples")


def _inside(kind: str, candidate: Inside, extension: Kind, bare: _Plant) -> None:
    """Nothing at zero, a straight line near it, finite where it would be seen at once."""
    spread, rate = float(np.sqrt(np.mean(bare.y**2))), float(np.sqrt(np.mean(np.gradient(bare.y, PERIOD) ** 2)))
    for unit in (None, "m/s", "1"):
        made = candidate.unit(unit)
        _expect(made is None or isinstance(made, str), kind, f"its unit for a state in {unit!r} is {made!r}")
    size = candidate.size(spread, rate)
    _expect(
        math.isfinite(size) and size > 0,
        kind,
        f"its size is {size} for a spread of {spread:.3g} and a rate of {rate:.3g}",
    )
    others, signal = 0.02 * spread, SIGNALS[extension.to]
    one, two, zero = (bare.with_addition(kind, extension, signal, v, others) for v in (1e-3 * size, 2e-3 * size, 0.0))
    whole = float(np.ptp(bare.y))
    _expect(
        np.allclose(zero, bare.y, atol=1e-6 * whole), kind, "at zero, where it is nothing, its model is another one"
    )
    _expect(bool(np.all(np.isfinite(one))), kind, "its model gives numbers that are not finite")
    effect = one - bare.y
    _expect(float(np.max(np.abs(effect))) > 1e-9 * whole, kind, f"at {1e-3 * size:.3g} its model changes nothing")
    bend = float(np.max(np.abs(two - bare.y - 2.0 * effect)))
    _expect(bend <= 0.05 * float(np.max(np.abs(effect))), kind, "small effects of it are no straight line")


def _expect(condition: Any, kind: str, sentence: str) -> None:
    if not condition:
        raise AssertionError(f"Candidate {kind!r}: {sentence}.")
