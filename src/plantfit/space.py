"""Parameters of a study: names, units, bounds, scales, ties; unit cube to named values and back."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.errors import SpaceError

import jax.numpy as jnp
from jax import Array


@dataclass(frozen=True)
class Parameter:
    """One quantity to find, or to hold.

    `bounds` in `unit`; `scale` "log" searches evenly over the decades and needs positive bounds.
    `value` fixes it. `tied` names another parameter whose value it takes. `per_recording` gives
    every recording its own value (offsets, initial states). `start` is a guess: searches that take
    warm starts begin there as well.
    """

    bounds: tuple[float, float] | None = None
    unit: str | None = None
    scale: Literal["linear", "log"] = "linear"
    value: float | None = None
    tied: str | None = None
    per_recording: bool = False
    start: float | None = None
    sentence: str = ""


@dataclass(frozen=True)
class Coordinate:
    """One axis of the cube. `recording` is None for a shared parameter."""

    parameter: str
    recording: str | None
    unit: str | None
    lower: float
    upper: float
    log: bool

    @property
    def name(self) -> str:
        return self.parameter if self.recording is None else f"{self.parameter}[{self.recording}]"


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool)


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
        self._place = {(c.parameter, c.recording): i for i, c in enumerate(self.coordinates)}

    @property
    def start(self) -> np.ndarray | None:
        """The guess as a cube point (d,), the middle where none is given; None without any guess.

        Raises SpaceError for a guess outside the bounds.
        """
        given = [self.parameters[c.parameter].start for c in self.coordinates]
        if all(v is None for v in given):
            return None
        for c, v in zip(self.coordinates, given, strict=True):
            if v is not None and not c.lower <= v <= c.upper:
                raise SpaceError(
                    f"Parameter {c.parameter!r} starts at {v:g}, outside its bounds [{c.lower:g}, {c.upper:g}]; "
                    "widen them or move the start."
                )
        inside = self.cube([c.lower if v is None else v for c, v in zip(self.coordinates, given, strict=True)])
        return np.where([v is None for v in given], 0.5, inside)

    @property
    def dimension(self) -> int:
        return len(self.coordinates)

    def _coordinates(self):
        for name, p in self.parameters.items():
            if p.tied is not None:
                self._root(name)
                continue
            if p.value is not None:
                if not _is_number(p.value) or not np.isfinite(p.value):
                    raise SpaceError(f"Parameter {name!r} is fixed at {p.value}, which is not a finite number.")
                continue
            if p.bounds is None:
                raise SpaceError(f"Parameter {name!r} has neither bounds nor a value; give bounds = [low, high] or value = number.")
            if isinstance(p.bounds, str) or len(p.bounds) != 2 or not all(map(_is_number, p.bounds)):
                raise SpaceError(f"Parameter {name!r} has bounds {p.bounds!r}; give two numbers [low, high].")
            low, high = (float(b) for b in p.bounds)
            if not (np.isfinite(low) and np.isfinite(high)):
                raise SpaceError(f"Parameter {name!r} has bounds [{low:g}, {high:g}]; both must be finite numbers.")
            if low > high:
                raise SpaceError(f"Parameter {name!r} has reversed bounds [{low:g}, {high:g}]; write [{high:g}, {low:g}].")
            if low == high:
                raise SpaceError(f"Parameter {name!r} has equal bounds {low:g}; write value = {low:g} to hold it.")
            if p.scale not in ("linear", "log"):
                raise SpaceError(f"Parameter {name!r} has scale {p.scale!r}; use 'linear' or 'log'.")
            if p.scale == "log" and low <= 0:
                raise SpaceError(
                    f"Parameter {name!r} has scale 'log' but lower bound {low:g}; give a lower bound above 0 or scale = 'linear'."
                )
            for recording in self.recordings if p.per_recording else (None,):
                yield Coordinate(name, recording, p.unit, low, high, p.scale == "log")

    def _root(self, name: str) -> str:
        seen = [name]
        while (target := self.parameters[seen[-1]].tied) is not None:
            if target not in self.parameters:
                raise SpaceError(f"Parameter {seen[-1]!r} is tied to {target!r}, which does not exist; known: {sorted(self.parameters)}.")
            if target in seen:
                raise SpaceError(f"Parameters {' -> '.join([*seen, target])} are tied in a circle; fix or free one of them.")
            seen.append(target)
        return seen[-1]

    def physical(self, z: Any) -> Array:
        """Cube points (..., d) to values in the declared units (..., d)."""
        z = jnp.asarray(z)
        # log bounds are replaced where unused, so that no gradient meets log of a negative
        low = np.where(self.log, np.maximum(self.lower, 1e-300), 1.0)
        high = np.where(self.log, np.maximum(self.upper, 1e-300), 1.0)
        linear = self.lower + z * (self.upper - self.lower)
        log = jnp.exp(np.log(low) + jnp.where(self.log, z, 0.0) * (np.log(high) - np.log(low)))
        return jnp.where(self.log, log, linear)

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
        """Values (d,) to a mapping from every parameter (fixed and tied ones too) to its scalar."""
        result = {}
        for name in self.parameters:
            root = self._root(name)
            p = self.parameters[root]
            if p.value is not None:
                result[name] = jnp.asarray(float(p.value))
            else:
                place = root, recording if p.per_recording else None
                if place not in self._place:
                    raise SpaceError(
                        f"Parameter {root!r} has a value per recording, but not for {recording!r}; known: {list(self.recordings)}."
                    )
                result[name] = values[self._place[place]]
        return result

    def vector(self, named: Mapping[str, float]) -> np.ndarray:
        """Named values (coordinate names) to a vector (d,); the inverse of dict(zip(names, values))."""
        missing = [n for n in self.names if n not in named]
        if missing:
            raise SpaceError(f"No value for parameter {missing[0]!r}; needed are {list(self.names)}.")
        return np.array([float(named[n]) for n in self.names])
