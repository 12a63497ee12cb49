"""What a family of plants has to be for a loop to be tuned: it rests at both levels within limits, is stable, and
its input moves it."""

import math
from collections.abc import Sequence

import numpy as np

from plantfit.control.tune.one_loop import OneLoop, Rest
from plantfit.control.tune.reduction import STILL, Reduced, gain_of, integrators, poles
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import SimulationError


def _inside(u: np.ndarray, wishes: Wishes, load: float = 0.0) -> np.ndarray:
    return (u - load >= wishes.lower) & (u - load <= wishes.upper) & np.isfinite(u)


def held_by_limits(rests: Sequence[Rest], wishes: Wishes) -> np.ndarray:
    return _inside(rests[0].u, wishes) & _inside(rests[1].u, wishes) & _inside(rests[1].u, wishes, wishes.load)


def with_rest(rests: Sequence[Rest]) -> np.ndarray:
    """Plants (n,) with a rest at both levels; whether it lies within the limits shows in their loops."""
    whole = np.isfinite(rests[0].u) & np.isfinite(rests[1].u)
    whole[0] = True
    return whole


def sign_of(rest: Rest) -> tuple[int, np.ndarray]:
    """Of the best fit's gain, and whether the others (n,) have another; an unstable pole turns the sign of a gain at
    rest, which does not count, as a controller of the same sign holds the plant."""
    gains = np.array([_gain(rest, i) for i in range(len(rest.u))])
    if not np.isfinite(gains[0]) or gains[0] == 0:
        raise SimulationError(
            "The input does not move the output at the set point (its gain is 0); choose another input, output or set "
            "point, or measure "
            "with an input that moves it."
        )
    return int(np.sign(gains[0])), ~(np.sign(gains) == np.sign(gains[0]))


def _gain(rest: Rest, at: int) -> float:
    if not np.all(np.isfinite(rest.A[at])):
        return float("nan")
    own = poles(rest, at)
    turned = np.sum((np.real(own) > STILL * np.max(np.abs(own))) & (np.imag(own) == 0))
    return gain_of(rest, at) * (-1.0) ** turned


def check_holds(plant: OneLoop, start: Rest, rest: Rest, wishes: Wishes) -> None:
    """Of the best fit: stable, and within the limits at both levels and under the load."""
    unit_y, unit_u = plant.model.outputs[plant.output] or "", plant.model.inputs[plant.input] or ""
    for where, level in ((start, wishes.set_point - wishes.step), (rest, wishes.set_point)):
        u = float(where.u[0])
        if not np.isfinite(u):
            raise SimulationError(
                f"No constant {plant.input} was found that holds {plant.output} at {level:.4g}{_with(unit_y)}. "
                f"{_settles(plant, level, wishes)}Choose another set point or step."
            )
        if not wishes.lower <= u <= wishes.upper:
            raise SimulationError(
                f"{plant.output} at {level:.4g} {unit_y} takes {plant.input} = {u:.4g} {unit_u}, "
                f"beyond its limits {wishes.lower:.4g} to {wishes.upper:.4g} {unit_u}: they cannot "
                f"hold that set point. {_reach(plant, wishes)}Choose another set point or step, or "
                "give the limits of the actuator ([control] lower and upper, or --lower and --upper)."
            )
    u = float(rest.u[0]) - wishes.load
    if not wishes.lower <= u <= wishes.upper:
        raise SimulationError(
            f"Against a load of {wishes.load:.4g} {unit_u} {plant.output} at {wishes.set_point:.4g} "
            f"{unit_y} takes {plant.input} = {u:.4g} {unit_u}, beyond its limits {wishes.lower:.4g} "
            f"to {wishes.upper:.4g} {unit_u}; give a smaller load ([control] load, or --load)."
        )
    found = poles(rest)
    fastest = float(np.max(np.real(found)))
    if fastest > 1e-6 * max(float(np.max(np.abs(found))), 1e-9):
        raise SimulationError(
            f"The plant is unstable at {plant.output} = {wishes.set_point:.4g} {unit_y}: a pole at +{fastest:.4g} "
            f"1/s doubles a deviation every {math.log(2) / fastest:.3g} s. The rules and the search here are for "
            "stable and integrating plants; a regulator holds it: name its states in --hold ([control] hold)."
        )


def check_reached(plant: OneLoop, rest: Rest) -> None:
    """Of the best fit: the input moves every state that does not come to rest by itself (Hautus: [A, B] has full
    rank at a pole of 0)."""
    n = rest.A.shape[-1]
    if not np.all(np.isfinite(rest.A[0])) or not integrators(rest):
        return
    moved = np.c_[rest.A[0], rest.B[0].sum(axis=0)[:, None]]
    size = np.max(np.abs(moved), axis=1, keepdims=True)
    size[size == 0] = 1.0
    moved = moved / size
    left, strength, _ = np.linalg.svd(moved)
    if strength[n - 1] > 1e-9 * strength[0]:
        return
    names = plant.followed
    state = names[int(np.argmax(np.abs(left[:, n - 1] / size[:, 0])))]
    raise SimulationError(
        f"{plant.input} does not reach {state!r}, which keeps any value that it has (a pole at 0), so that "
        "no controller brings it to rest; drive it by another input, or make it a parameter of the model."
    )


def check_inner(plant: OneLoop, inner: Rest) -> None:
    """Of the best fit: the input moves the inner output; `inner` is the rest with the matrices to it."""
    gain = _gain(inner, 0)
    if not np.isfinite(gain) or gain == 0:
        raise SimulationError(
            f"{plant.input} does not move the inner output {plant.inner} at the set point (its gain "
            "is 0); choose another one ([control] inner, or --inner), or a controller of one output."
        )


def _settles(plant: OneLoop, level: float, wishes: Wishes) -> str:
    """Where the best fit rests within the input's limits, where that explains why it does not at a level."""
    found = plant.settled_range(level, wishes.lower, wishes.upper)
    if found is None or found[0] <= level <= found[1]:
        return ""
    unit_y, unit_u = _with(plant.model.outputs[plant.output]), _with(plant.model.inputs[plant.input])
    inputs = f"constant {plant.input} from {wishes.lower:.4g} to {wishes.upper:.4g}{unit_u}"
    low, high = (f"{v:.4g}" for v in found)
    if low == high:
        return f"With any {inputs} {plant.output} rests at {low}{unit_y}. "
    return f"With a {inputs} {plant.output} rests at {low} to {high}{unit_y}. "


def _reach(plant: OneLoop, wishes: Wishes) -> str:
    """The levels that the limits hold: where the plant settles within them, else where the model is near to linear in
    between; empty where that is not known."""
    unit = plant.model.outputs[plant.output] or ""
    found = plant.settled_range(wishes.set_point - wishes.step, wishes.lower, wishes.upper)
    if found is not None:
        return f"They hold about {found[0]:.4g} to {found[1]:.4g} {unit}. "
    lines = []
    for share in (0.35, 0.65):
        level = wishes.set_point - wishes.step + share * wishes.step
        lines.append((level, float(plant.part(slice(0, 1)).at_rest(level, (wishes.lower, wishes.upper)).u[0])))
    (y1, u1), (y2, u2) = lines
    if not np.isfinite(u1 + u2) or u1 == u2 or y1 == y2:
        return ""
    ends = sorted(y1 + (u - u1) * (y2 - y1) / (u2 - u1) for u in (wishes.lower, wishes.upper))
    return f"They hold about {ends[0]:.4g} to {ends[1]:.4g} {unit}. "


def _with(unit: str | None) -> str:
    """A unit behind a number."""
    return f" {unit}" if unit and unit != "1" else ""


def check_dead_time(small: Reduced, wishes: Wishes) -> None:
    dead = small.first_order[2]
    if wishes.horizon is not None and wishes.horizon < 4.0 * dead:
        raise SimulationError(
            f"The horizon of {wishes.horizon:.4g} s is shorter than four times the dead time of {dead:.4g} "
            f"s, so that nothing can be judged in it; give at least {8 * dead:.3g} s, or leave horizon out."
        )
