"""What moves a model in a mode: its rates and surfaces, friction forces, jumps and flanks, as functions of numbers.

A mode is a vector: per friction 1, -1 or 0 (sticks), per play 1, -1 or 0 (rests).
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.simulate.check.on_floats import floats, on_floats
from plantfit.simulate.steps.switching import bind_backlash, bind_event, bind_friction
from plantfit.simulate.steps.vector import VectorModel, placeholders

import jax
import jax.numpy as jnp


class Values(NamedTuple):
    """Parameters as they are, and as functions on floats take them."""

    arrays: tuple[np.ndarray, ...]
    floats: list[Any]

    @classmethod
    def of(cls, p: Sequence[Any]) -> "Values":
        return cls(tuple(np.asarray(v, dtype=float) for v in p), floats(p))


class ModeFunction:
    """A function of tuples of numbers on floats where it has such a form and a number comes out, else by jax."""

    def __init__(self, vector: VectorModel, function: Callable[..., Any]):
        x, u, p = placeholders(vector.model)
        ways = (1.0,) * (len(vector.model.frictions) + len(vector.model.backlashes))
        self.plain = on_floats(vector.model.name, function, (x, u, u, ways, p))
        self.compiled = jax.jit(lambda *given: tuple(jnp.asarray(part, dtype=float) for part in function(*given)))

    def __call__(self, x: np.ndarray, u: np.ndarray, du: np.ndarray, mode: np.ndarray, p: Values) -> list[np.ndarray]:
        groups = [np.asarray(v, dtype=float).tolist() for v in (x, u, du, mode)]
        if self.plain is not None:
            with suppress(ArithmeticError, ValueError):
                return [np.array(part) for part in self.plain(*groups, p.floats)]
        return self.by_jax(groups, p.arrays)

    def by_jax(self, groups: Sequence[Sequence[float]], p: Sequence[np.ndarray]) -> list[np.ndarray]:
        """The same, also where no number comes out."""
        return [np.asarray(part) for part in self.compiled(*map(tuple, groups), tuple(p))]


class ModeEquations(NamedTuple):
    """Functions of a mode, of tuples of numbers (x, u, du, mode, p); each gives a tuple of tuples."""

    signs: np.ndarray  # per event, 1 falling, -1 rising, 0 both
    velocities: tuple[int, ...]
    plays: tuple[int, ...]
    motion: ModeFunction  # rates, x with what is pushed, surfaces
    forces: ModeFunction  # force needed to hold and breakaway force of every friction
    jumps: tuple[ModeFunction, ...]  # per event: x
    flanks: ModeFunction  # lowest and highest value of every play


@lru_cache(maxsize=32)
def mode_equations(vector: VectorModel) -> ModeEquations:
    """Made once for a model: what is compiled serves all its parameters."""
    model = vector.model
    events = [bind_event(e, vector) for e in model.events]
    frictions = [bind_friction(f, vector) for f in model.frictions]
    plays = [bind_backlash(b, vector) for b in model.backlashes]
    count = len(frictions)

    def ends(play, x, u, p):
        drive, gap = play.drive(x, u, p), play.gap(x, u, p)
        return drive - gap, drive + gap

    def followed(x, u, mode, p):
        for play, way in zip(plays, mode[count:], strict=True):
            low, high = ends(play, x, u, p)
            z = jnp.where(way > 0, low, jnp.where(way < 0, high, x[play.state]))
            x = (*x[: play.state], z, *x[play.state + 1 :])
        return x

    def rubbed(x, u, mode, p):
        rates = list(vector.rate(x, u, p))
        needs, limits = [], []
        for law, way in zip(frictions, mode[:count], strict=True):
            effect, sliding = law.effect(x, u, p), law.sliding(x, u, p)
            need = -rates[law.velocity] / effect[law.velocity]
            needs.append(need)
            limits.append(jnp.maximum(law.breakaway(x, u, p), sliding))
            force = jnp.where(way == 0, need, -way * sliding)
            rates = [r + e * force for r, e in zip(rates, effect, strict=True)]
            rates[law.velocity] = jnp.where(way == 0, 0.0, rates[law.velocity])
        return rates, needs, limits

    def motion(x, u, du, mode, p):
        x = followed(x, u, mode, p)
        rates, needs, limits = rubbed(x, u, mode, p)
        # what is pushed moves with what pushes it
        for play, way in zip(plays, mode[count:], strict=True):
            _, (low, high) = jax.jvp(lambda x, u, play=play: ends(play, x, u, p), (x, u), (tuple(rates), du))
            rates[play.state] = jnp.where(way > 0, low, jnp.where(way < 0, high, 0.0))
        surfaces = [e.when(x, u, p) for e in events]
        surfaces += [
            jnp.where(way == 0, limit - jnp.abs(need), way * x[law.velocity])
            for law, way, need, limit in zip(frictions, mode[:count], needs, limits, strict=True)
        ]
        for play, way in zip(plays, mode[count:], strict=True):
            low, high = ends(play, x, u, p)
            pushed = way * rates[play.state]
            surfaces += [
                jnp.where(way == 0, x[play.state] - low, pushed),
                jnp.where(way == 0, high - x[play.state], pushed),
            ]
        return tuple(rates), tuple(x), tuple(surfaces)

    def forces(x, u, du, mode, p):
        _, needs, limits = rubbed(x, u, mode, p)
        return tuple(needs), tuple(limits)

    def jump(event):
        return lambda x, u, du, mode, p: (tuple(event.then(x, u, p)),)

    def flanks(x, u, du, mode, p):
        found = [ends(play, x, u, p) for play in plays]
        return tuple(low for low, _ in found), tuple(high for _, high in found)

    return ModeEquations(
        np.array([e.sign for e in events], dtype=int),
        tuple(f.velocity for f in frictions),
        tuple(b.state for b in plays),
        ModeFunction(vector, motion),
        ModeFunction(vector, forces),
        tuple(ModeFunction(vector, jump(e)) for e in events),
        ModeFunction(vector, flanks),
    )


__all__ = ["ModeEquations", "ModeFunction", "Values", "mode_equations"]
