"""Parameters of a study: names, units, bounds, scales, ties; unit cube to named values and back."""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit import units
from plantfit.errors import SpaceError

import jax.numpy as jnp
from jax import Array

Numbers = Any  # a number, or nested sequences of numbers in the shape of the parameter


@dataclass(frozen=True)
class Parameter:
    """One quantity to find, or to hold.

    `bounds` in `unit`; `scale` "log" searches evenly over the decades and needs positive bounds.
    `value` fixes it. `tied` names another parameter whose value it takes. `per_recording` gives
    every recording its own value (offsets, initial states). `start` is a guess, of a value per recording also one for
    each by the recording's name: searches that take warm starts begin there as well. `smooth` is for tables: the
    strength with which their second differences are kept small, one for each axis or for all, or "cross-validated" or
    "reml" (see `problem.evaluate.smoothing`).

    `bounds` say where to look, `limits` (low, high), infinite where there is none, what is physically possible:
    intervals reach beyond bounds but never beyond limits. Without `limits` a value whose bounds have one sign keeps
    that sign (a mass, a dead time), and one whose bounds hold both signs has no limit; a temperature in degC ends at
    absolute zero. `typical` is a size that
    matters, in `unit`: a value is called determined when its interval is small against that or against the value,
    whichever is larger.

    With a `shape`, (n,) or (ny, nu), it is an array, as the values of a table are. Each bound, and
    `value` and `start`, is then a number for all entries or nested sequences of that shape.

    What contradicts itself is refused where the parameter is used, by `Space` and `Problem` (SpaceError).
    """

    bounds: tuple[Numbers, Numbers] | None = None
    unit: str | None = None
    scale: Literal["linear", "log"] = "linear"
    value: Numbers | None = None
    tied: str | None = None
    per_recording: bool = False
    start: Numbers | Mapping[str, Numbers] | None = None
    sentence: str = ""
    shape: tuple[int, ...] = ()
    smooth: float | tuple[float, ...] | str | None = None
    limits: tuple[float, float] | None = None
    typical: float | None = None

    def __post_init__(self) -> None:
        for name in ("bounds", "value", "start", "shape", "smooth", "limits"):
            object.__setattr__(self, name, _frozen(getattr(self, name)))


class Guesses(dict):
    """Guesses by the names of recordings, which can be compared and hashed."""

    def __hash__(self) -> int:
        return hash(frozenset(self.items()))


@dataclass(frozen=True)
class Coordinate:
    """One axis of the cube. `recording` is None for a shared parameter, `index` () for a single number.

    `limits` are the physical ones (low, high), `typical` a size that matters, 0 where none was given.
    """

    parameter: str
    recording: str | None
    unit: str | None
    lower: float
    upper: float
    log: bool
    index: tuple[int, ...] = ()
    limits: tuple[float, float] = (-np.inf, np.inf)
    typical: float = 0.0

    @property
    def name(self) -> str:
        """R, R[train], k[3], k[3][train], k[2,5]."""
        entry = _entry(self.parameter, self.index)
        return entry if self.recording is None else f"{entry}[{self.recording}]"


def _told(c: Coordinate) -> str:
    """R: 0.1 to 10 ohm (log)."""
    return f"{c.name}: {c.lower:g} to {c.upper:g}{f' {c.unit}' if c.unit else ''}{' (log)' if c.log else ''}"


def _few(words: Sequence[str], most: int = 12) -> str:
    """Words with commas; the first few and a count where there are many."""
    return ", ".join([*words[:most], *([f"{len(words) - most} more"] if len(words) > most else [])]) or "none"


def _entry(name: str, index: tuple[int, ...]) -> str:
    return f"{name}[{','.join(map(str, index))}]" if index else name


def _frozen(value: Any) -> Any:
    """Lists and arrays as nested tuples, so that a parameter can be compared."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return Guesses((name, _frozen(v)) for name, v in value.items())
    return tuple(_frozen(v) for v in value) if isinstance(value, list | tuple) else value


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool)


def _is_numeric(value: Any) -> bool:
    """A number, or nested tuples of numbers."""
    return all(map(_is_numeric, value)) if isinstance(value, tuple) else _is_number(value)


def _spread(name: str, what: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """A number for all entries, or nested sequences of the shape, as a float64 array of `shape`."""
    if not _is_numeric(value):
        raise SpaceError(f"Parameter {name!r} has {what} {value!r}, which is not a number; write one.")
    try:
        array = np.asarray(value, dtype=float)
    except ValueError:
        raise SpaceError(
            f"Parameter {name!r} has {what} in rows of different lengths; give one number or shape {shape}."
        ) from None
    if array.shape not in ((), shape):
        wanted = f"shape {shape}" if shape else "one number"
        raise SpaceError(
            f"Parameter {name!r} has {what} of shape {array.shape}; give {wanted}{' or one number' if shape else ''}."
        )
    return np.broadcast_to(array, shape)


class Space:
    """The free coordinates of a problem, in a fixed order, and how they become parameter values.

    `parameters` maps names to `Parameter`; `recordings` are the names that per-recording
    parameters are copied for. Raises SpaceError for reversed or missing bounds, log bounds that
    are not positive, ties to unknown names or in a circle.
    """

    def __init__(self, parameters: Mapping[str, Parameter], recordings: Sequence[str] = ()):
        self.parameters = dict(parameters)
        self.recordings = tuple(recordings)
        self.coordinates: tuple[Coordinate, ...] = tuple(self._coordinates())
        self.names = tuple(c.name for c in self.coordinates)
        self.lower = np.array([c.lower for c in self.coordinates])
        self.upper = np.array([c.upper for c in self.coordinates])
        self.log = np.array([c.log for c in self.coordinates], dtype=bool)
        self._place: dict[tuple[str, str | None], int] = {}  # of the first entry; the others follow it
        for i, c in enumerate(self.coordinates):
            self._place.setdefault((c.parameter, c.recording), i)

    def __repr__(self) -> str:
        held = [
            f"{n} = {p.value:g}" if _is_number(p.value) else n
            for n, p in self.parameters.items()
            if p.value is not None
        ]
        tied = [f"{n} = {p.tied}" for n, p in self.parameters.items() if p.tied is not None]
        others = f"held: {_few(held)}; tied: {_few(tied)}"
        of = (
            f", with values of their own for {_few(self.recordings)}"
            if any(c.recording for c in self.coordinates)
            else ""
        )
        count = f"{self.dimension} free coordinate{'s' * (self.dimension != 1)}"
        return f"Space of {count}{of}\n  {_few([_told(c) for c in self.coordinates])}\n  {others}"

    @property
    def start(self) -> np.ndarray | None:
        """The guess as a cube point (d,), the middle where none is given; None without any guess.

        Raises SpaceError for a guess outside the bounds, or for a recording that there is not.
        """
        starts = dict(self._guesses())
        own = [starts.get((c.parameter, c.recording), starts.get((c.parameter, None))) for c in self.coordinates]
        given = [
            None if guess is None else float(guess[c.index]) for guess, c in zip(own, self.coordinates, strict=True)
        ]
        if all(v is None for v in given):
            return None
        for c, v in zip(self.coordinates, given, strict=True):
            if v is not None and not c.lower <= v <= c.upper:
                raise SpaceError(
                    f"Parameter {_entry(c.parameter, c.index)!r} starts at {v:g}, outside "
                    f"its bounds [{c.lower:g}, {c.upper:g}]; widen them or move the start."
                )
        inside = self.cube([c.lower if v is None else v for c, v in zip(self.coordinates, given, strict=True)])
        return np.where([v is None for v in given], 0.5, inside)

    def _guesses(self) -> Iterator[tuple[tuple[str, str | None], np.ndarray]]:
        """Guesses by parameter and recording, None for all recordings."""
        for n, p in self.parameters.items():
            if isinstance(p.start, Mapping):
                unknown = [r for r in p.start if r not in self.recordings]
                if unknown or not p.per_recording:
                    why = (
                        f"there is no recording {unknown[0]!r}"
                        if unknown
                        else "it has one value for all (per_recording is false)"
                    )
                    raise SpaceError(
                        f"Parameter {n!r} has starts by recording, but {why}; give one start, or names of recordings."
                    )
                yield from (((n, r), _spread(n, f"a start in {r}", v, p.shape)) for r, v in p.start.items())
            elif p.start is not None:
                yield (n, None), _spread(n, "a start", p.start, p.shape)

    @property
    def dimension(self) -> int:
        """How many coordinates there are, d."""
        return len(self.coordinates)

    def _coordinates(self) -> Iterator[Coordinate]:
        """One for each free entry; the entries of a parameter in a recording lie beside each other."""
        for name, p in self.parameters.items():
            if p.tied is not None:
                self._check_tie(name)
            elif p.value is not None:
                _check_value(name, p)
            else:
                low, high = _checked_bounds(name, p)
                limits, typical = (
                    _checked_limits(name, p, float(np.min(low)), float(np.max(high))),
                    _checked_typical(name, p),
                )
                for recording in self.recordings if p.per_recording else (None,):
                    for index in np.ndindex(p.shape):
                        bounds = float(low[index]), float(high[index])
                        yield Coordinate(name, recording, p.unit, *bounds, p.scale == "log", index, limits, typical)

    def _check_tie(self, name: str) -> None:
        root = self.root(name)
        own, other = self.parameters[name].shape, self.parameters[root].shape
        if own != other:
            raise SpaceError(
                f"Parameter {name!r} of shape {own} is tied to {root!r} of shape {other}; tie tables of the same nodes."
            )
        mine, its = self.parameters[name].unit, self.parameters[root].unit
        if mine is not None and its is not None and mine != its and not units.equal(mine, its):
            raise SpaceError(
                f"Parameter {name!r} in {mine!r} is tied to {root!r} in {its!r}, "
                "whose number it would take as it is; give both one unit."
            )

    def root(self, name: str) -> str:
        """The parameter whose value this one takes: itself unless it is tied. Raises SpaceError for ties in a circle
        or to nothing."""
        seen = [name]
        while (target := self.parameters[seen[-1]].tied) is not None:
            if target not in self.parameters:
                raise SpaceError(
                    f"Parameter {seen[-1]!r} is tied to {target!r}, which does not exist; known: "
                    f"{sorted(self.parameters)}."
                )
            if target in seen:
                raise SpaceError(
                    f"Parameters {' -> '.join([*seen, target])} are tied in a circle; fix or free one of them."
                )
            seen.append(target)
        return seen[-1]

    def local(self, recording: str) -> np.ndarray:
        """Positions (q,) of the coordinates that enter one recording: the shared ones and its own."""
        return np.array([i for i, c in enumerate(self.coordinates) if c.recording in (None, recording)], dtype=int)

    def of_one_recording(self) -> "Space":
        """The coordinates `local` of any one recording, in their order, as a space without recordings."""
        return Space({n: dataclasses.replace(p, per_recording=False) for n, p in self.parameters.items()})

    def range(self, name: str) -> tuple[float, float]:
        """All values that a parameter can take in its unit, (low, high); equal when it is held."""
        p = self.parameters[self.root(name)]
        held = p.value if p.value is not None else None
        low, high = (held, held) if held is not None else p.bounds  # pyrefly: ignore[not-iterable]
        return float(np.min(low)), float(np.max(high))

    def physical(self, z: Any) -> Array:
        """Cube points (..., d) to values in the declared units (..., d); numpy's numbers by numpy, which compiles
        nothing."""
        xp: Any = np if isinstance(z, np.ndarray | list | tuple) else jnp
        z = xp.asarray(z)
        # log bounds are replaced where unused, so that no gradient meets log of a negative
        low = np.where(self.log, np.maximum(self.lower, 1e-300), 1.0)
        high = np.where(self.log, np.maximum(self.upper, 1e-300), 1.0)
        linear = self.lower + z * (self.upper - self.lower)
        log = xp.exp(np.log(low) + xp.where(self.log, z, 0.0) * (np.log(high) - np.log(low)))
        return xp.where(self.log, log, linear)

    def slopes(self, z: np.ndarray) -> np.ndarray:
        """Derivative (d,) of each value by its own coordinate at a cube point (d,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            log = np.asarray(self.physical(np.asarray(z))) * np.log(self.upper / self.lower)
        return np.where(self.log, log, self.upper - self.lower)

    def cube(self, values: Any) -> np.ndarray:
        """Values in the declared units (..., d) to cube points (..., d); the inverse of `physical`."""
        values = np.asarray(values, dtype=float)
        low = np.where(self.log, np.maximum(self.lower, 1e-300), 1.0)
        high = np.where(self.log, np.maximum(self.upper, 1e-300), 1.0)
        safe = np.where(self.log, np.maximum(values, 1e-300), 1.0)
        linear = (values - self.lower) / (self.upper - self.lower)
        ratio = np.where(self.log, np.log(high) - np.log(low), 1.0)
        return np.where(self.log, (np.log(safe) - np.log(low)) / ratio, linear)

    def tree(self, values: Any, recording: str | None = None) -> dict[str, Any]:
        """Values (d,) in their units to a mapping from every parameter (fixed and tied ones too) to its scalar or
        array.

        Raises SpaceError for a recording that a parameter has no value for.
        """
        return {name: self._of(self.root(name), values, recording) for name in self.parameters}

    def _of(self, name: str, values: Any, recording: str | None) -> Any:
        p = self.parameters[name]
        if p.value is not None:
            return jnp.asarray(_spread(name, "a value", p.value, p.shape) if p.shape else float(p.value))
        place = name, recording if p.per_recording else None
        if place not in self._place:
            raise SpaceError(
                f"Parameter {name!r} has a value per recording, but not for {recording!r}; known: "
                f"{list(self.recordings)}."
            )
        first = self._place[place]
        return values[first : first + math.prod(p.shape)].reshape(p.shape) if p.shape else values[first]

    def vector(self, named: Mapping[str, float]) -> np.ndarray:
        """Named values (coordinate names, in their units) to a vector (d,); SpaceError for one that is missing."""
        missing = [n for n in self.names if n not in named]
        if missing:
            raise SpaceError(f"No value for parameter {missing[0]!r}; needed are {list(self.names)}.")
        return np.array([float(named[n]) for n in self.names])


def _check_value(name: str, p: Parameter) -> None:
    if not _is_numeric(p.value) or not np.all(np.isfinite(_spread(name, "a value", p.value, p.shape))):
        raise SpaceError(f"Parameter {name!r} is fixed at {p.value}, which is not a finite number.")


def _checked_bounds(name: str, p: Parameter) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds, both of the parameter's shape."""
    if p.bounds is None:
        raise SpaceError(
            f"Parameter {name!r} has neither bounds nor a value; give bounds = [low, high] or value = number."
        )
    if isinstance(p.bounds, str) or len(p.bounds) != 2 or not all(map(_is_numeric, p.bounds)):
        raise SpaceError(f"Parameter {name!r} has bounds {p.bounds!r}; give two numbers [low, high].")
    if p.scale not in ("linear", "log"):
        raise SpaceError(f"Parameter {name!r} has scale {p.scale!r}; use 'linear' or 'log'.")
    low, high = (_spread(name, "a bound", b, p.shape) for b in p.bounds)
    for index in np.ndindex(p.shape):
        _check_pair(_entry(name, index), float(low[index]), float(high[index]), p.scale)
    return low, high


def _checked_limits(name: str, p: Parameter, low: float, high: float) -> tuple[float, float]:
    """What is physically possible of a parameter whose entries are searched from `low` to `high`."""
    if p.limits is None and p.unit and units.known(p.unit) and units.is_point(p.unit):  # 0 degC is no end of anything
        return units.factor_offset("K", p.unit)[1], np.inf
    if p.limits is None:
        return (0.0 if low >= 0 else -np.inf), (0.0 if high <= 0 else np.inf)
    if isinstance(p.limits, str) or len(p.limits) != 2 or not all(_is_number(v) and not np.isnan(v) for v in p.limits):
        raise SpaceError(
            f"Parameter {name!r} has limits {p.limits!r}; give two "
            "numbers (low, high), infinite where there is no limit."
        )
    least, most = float(p.limits[0]), float(p.limits[1])
    if low < least or high > most:
        raise SpaceError(
            f"Parameter {name!r} is searched from {low:g} to {high:g}, beyond its physical "
            f"limits [{least:g}, {most:g}]; narrow the bounds or widen the limits."
        )
    return least, most


def _checked_typical(name: str, p: Parameter) -> float:
    if p.typical is None:
        return 0.0
    if not _is_number(p.typical) or not 0 < p.typical < np.inf:
        raise SpaceError(f"Parameter {name!r} has typical = {p.typical!r}; give a size above 0 in its unit.")
    return float(p.typical)


def _check_pair(name: str, low: float, high: float, scale: str) -> None:
    if not (np.isfinite(low) and np.isfinite(high)):
        raise SpaceError(f"Parameter {name!r} has bounds [{low:g}, {high:g}]; both must be finite numbers.")
    if low > high:
        raise SpaceError(f"Parameter {name!r} has reversed bounds [{low:g}, {high:g}]; write [{high:g}, {low:g}].")
    if low == high:
        raise SpaceError(f"Parameter {name!r} has equal bounds {low:g}; write value = {low:g} to hold it.")
    if scale == "log" and low <= 0:
        raise SpaceError(
            f"Parameter {name!r} has scale 'log' but lower bound "
            f"{low:g}; give a lower bound above 0 or scale = 'linear'."
        )
