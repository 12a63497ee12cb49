"""Fuzzy control: regulators of several operating points, blended by how much each point applies."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.design import Design, Limits, followed, limits_of, named, stacked, weight
from plantfit.control.linear.kalman import Estimator, fitting
from plantfit.control.linear.linear_plant import LinearPlant, discretised
from plantfit.control.linear.lqr import regulator
from plantfit.errors import SimulationError
from plantfit.simulate.loop.closed_loop import Controller

import jax
import jax.numpy as jnp


class Rules(NamedTuple):
    """One rule for each operating point: "if the premise is about centre i, the plant is model i and its gain is
    gain i"."""

    centres: Any  # (r,), increasing
    premise: Any  # (p,), 1 for the output that is the premise, else 0
    gains: Any  # (r, m, n)
    estimators: Estimator  # every array with a leading axis (r,)
    x0: Any  # (n,), held without a reference
    u0: Any  # (m,)
    lower: Any  # (m,)
    upper: Any


def takagi_sugeno(
    plants: Sequence[LinearPlant],
    period: float,
    Q: Any,
    R: Any,
    *,
    premise: str,
    hold: int,
    estimators: Sequence[Estimator] | None = None,
    limits: Limits = None,
) -> Design:
    """Parallel distributed compensation: u = u_ref - sum_i h_i(premise) K_i (x - x_ref), K_i the regulator of
    `plants[i]`.

    `plants` are one model linearised at several operating points that differ in the output `premise`; h_i are triangles
    with their tops there, 1 in sum, the first and last going on as 1. `plants[hold]` is the point to hold without a
    reference. The filters of `estimators`, one for each plant, are blended alike.

    Source: Takagi, Sugeno, IEEE Trans. Systems, Man, Cybernetics 15 (1985) 116 (models); Wang, Tanaka, Griffin, IEEE
    Trans. Fuzzy Systems 4 (1996) 14, eq. (9) (compensation). Each rule is stable for its own model; the blend is not
    proven stable by that. Q, R, `limits` and errors as in `lqr`.
    """
    plants = tuple(plants)
    if not plants or not 0 <= hold < len(plants):
        raise SimulationError(
            f"hold = {hold} for {len(plants)} operating points; give the place of one of them, counted from 0."
        )
    first = plants[hold]
    for plant in plants:
        if (plant.states, plant.inputs, plant.outputs) != (first.states, first.inputs, first.outputs):
            raise SimulationError(
                "The operating points have other states, inputs or outputs; linearise one model at all of them."
            )
    if premise not in first.outputs:
        raise SimulationError(
            f"The premise {premise!r} is not measured; name one of the outputs {list(first.outputs)}."
        )
    place = first.outputs.index(premise)
    centres = np.array([plant.y0[place] for plant in plants])
    if np.any(np.diff(centres) <= 0):
        raise SimulationError(
            f"The operating points have {premise} = {centres.tolist()}; give them in increasing order."
        )
    q, r = weight("Q", Q, first.states, False), weight("R", R, first.inputs, True)
    gains = np.stack([regulator(discretised(plant, period), q, r)[0] for plant in plants])
    given = (None,) * len(plants) if estimators is None else tuple(estimators)
    if len(given) != len(plants):
        raise SimulationError(
            f"There are {len(given)} estimators for {len(plants)} operating points; give one for each."
        )
    chosen = [fitting(plant, period, one) for plant, one in zip(plants, given, strict=True)]
    together = jax.tree.map(lambda *arrays: jnp.stack(arrays), *chosen)
    low, high = (jnp.asarray(a) for a in limits_of(limits, first.inputs))
    chosen_output, held = jnp.eye(len(first.outputs))[place], (jnp.asarray(first.x0), jnp.asarray(first.u0))
    parameters = Rules(jnp.asarray(centres), chosen_output, jnp.asarray(gains), together, *held, low, high)
    return Design(_blended(first.outputs, first.inputs, first.states), parameters, first, float(period))


def memberships(value: Any, centres: Any) -> Any:
    """Triangular memberships (r,) of a scalar in `centres` (r,): 1 at a centre, straight to 0 at its neighbours, 1
    in sum."""
    return jax.vmap(lambda top: jnp.interp(value, centres, top))(jnp.eye(centres.shape[0]))


def _blended(outputs: tuple[str, ...], inputs: tuple[str, ...], states: tuple[str, ...]) -> Controller:
    def init(measurement, parameters):
        y = stacked(measurement, outputs)
        begun = jax.vmap(lambda e: e.begin(y))(parameters.estimators)
        return memberships(parameters.premise @ y, parameters.centres) @ begun, jnp.broadcast_to(
            parameters.u0, (len(inputs),)
        )

    def update(state, measurement, reference, parameters):
        x, u = state
        y = stacked(measurement, outputs)
        share = memberships(parameters.premise @ y, parameters.centres)
        x = share @ jax.vmap(lambda e: e.corrected(x, y, u))(parameters.estimators)
        error = x - followed(reference, states, parameters.x0, inputs)
        wanted = followed(reference, inputs, parameters.u0, states) - jnp.einsum(
            "r,rmn,n->m", share, parameters.gains, error
        )
        u = jnp.clip(wanted, parameters.lower, parameters.upper)
        return (share @ jax.vmap(lambda e: e.predicted(x, u))(parameters.estimators), u), named(u, inputs)

    return Controller(init, update)
