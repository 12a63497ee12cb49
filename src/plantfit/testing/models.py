"""Conformance of models: what every model, built in or a plug-in, must keep.

from plantfit.testing import check_model
check_model(my_package.leaky_tank())
"""

from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.model import Declared, Model

import jax
import jax.numpy as jnp

POINTS = 20
STEP = 1e-6  # of the size of a number, for differences
CLOSE = 1e-4  # of the largest slope: how far derivatives may be from differences


def check_model(model: Model, seed: int = 0) -> None:
    """Try the functions of a model at random values within the bounds of its parameters.

    Every state has a derivative and every output a value; the same values give the same numbers, compiled or not, alone
    or in a batch; derivatives by jax agree with differences. States and inputs are drawn from -1 to 1 and, should that
    give no finite number, from
    0.1 to 1. Raises AssertionError with what was expected and what came.
    """
    _expect(isinstance(model, Model), model, f"a {type(model).__name__} was given; give a plantfit Model")
    points = _points(model, seed)
    f = _function(model)
    one = [np.asarray(f(z)) for z in points]
    wanted = len(model.states) + len(model.outputs)
    _expect(
        all(v.shape == (wanted,) for v in one),
        model,
        f"its functions give {one[0].shape} numbers for {wanted} states and outputs",
    )
    finite = [i for i, v in enumerate(one) if np.all(np.isfinite(v))]
    _expect(
        len(finite) > POINTS // 4,
        model,
        f"only {len(finite)} of {POINTS} random points have finite derivatives and outputs",
    )
    compiled, together = jax.jit(f), jax.jit(jax.vmap(f))(np.stack(points))
    for i in finite:
        scale = np.abs(one[i]) + 1e-12
        _expect(
            np.array_equal(one[i], np.asarray(f(points[i]))),
            model,
            "its functions give other numbers when called twice",
        )
        _expect(
            np.all(np.abs(compiled(points[i]) - one[i]) <= 1e-9 * scale),
            model,
            "compiled, its functions give other numbers",
        )
        _expect(
            np.all(np.abs(together[i] - one[i]) <= 1e-9 * scale), model, "in a batch, its functions give other numbers"
        )
    slopes = jax.jit(jax.jacfwd(f))
    wrong = [i for i in finite if not _derived_well(compiled, slopes, points[i])]
    # a point may lie on a corner of the model, where differences are no derivative
    _expect(
        len(wrong) <= max(1, len(finite) // 10),
        model,
        f"derivatives differ from differences at {len(wrong)} of {len(finite)} points",
    )


def _function(model: Model) -> Any:
    states, inputs, sizes = list(model.states), _channels(model), [int(np.prod(p.shape)) for p in model.parameters]

    def f(z: Any) -> Any:
        # parts of plain numbers, which numpy cuts: jax would compile every cut of its own arrays
        one = [jnp.asarray(z[k]) for k in range(len(states) + len(inputs))]
        x = dict(zip(states, one[: len(states)], strict=True))
        u = dict(zip(inputs, one[len(states) :], strict=True))
        p, at = {}, len(states) + len(inputs)
        for declared, size in zip(model.parameters, sizes, strict=True):
            p[declared.name] = jnp.asarray(z[at] if not declared.shape else z[at : at + size].reshape(declared.shape))
            at += size
        rates = {} if model.derivative is None else model.derivative(x, u, p)
        outputs = model.output(x, u, p)
        missing = [s for s in states if s not in rates] + [o for o in model.outputs if o not in outputs]
        _expect(not missing, model, f"its functions give nothing for {missing}")
        return jnp.stack(
            [*(jnp.asarray(rates[s], float) for s in states), *(jnp.asarray(outputs[o], float) for o in model.outputs)]
        )

    return f


def _channels(model: Model) -> list[str]:
    return [*model.inputs, *(d.channel for d in model.delays), *(d.channel for d in model.state_delays), "t"]


def _points(model: Model, seed: int) -> list[Any]:
    rng, f = np.random.default_rng(seed), _function(model)
    signals = len(model.states) + len(_channels(model))
    found: list[Any] = []
    for low in (-1.0, 0.1):
        found = [
            np.concatenate([rng.uniform(low, 1.0, signals), *(_value(p, rng) for p in model.parameters)])
            for _ in range(POINTS)
        ]
        if all(np.all(np.isfinite(f(z))) for z in found):
            break
    return found


def _value(declared: Declared, rng: np.random.Generator) -> np.ndarray:
    shape = declared.shape or (1,)
    if declared.bounds is None:
        return np.ravel(np.broadcast_to(np.asarray(1.0 if declared.value is None else declared.value, float), shape))
    low, high = (np.broadcast_to(np.asarray(b, float), shape) for b in declared.bounds)
    return np.ravel(low * (high / low) ** rng.random(shape) if declared.scale == "log" else rng.uniform(low, high))


def _derived_well(f: Any, slopes: Any, z: np.ndarray) -> bool:
    exact = np.asarray(slopes(z))
    columns = []
    for i in range(len(z)):
        moved = np.zeros(len(z))
        moved[i] = step = STEP * max(abs(float(z[i])), 1e-3)
        columns.append((np.asarray(f(z + moved)) - np.asarray(f(z - moved))) / (2 * step))
    differences = np.stack(columns, axis=1)
    size = np.max(np.abs(exact), axis=1, keepdims=True) + 1e-9
    return bool(np.all(np.abs(exact - differences) <= CLOSE * size + 1e-6))


def _expect(condition: Any, model: Any, sentence: str) -> None:
    if not condition:
        raise AssertionError(f"Model {getattr(model, 'name', model)!r}: {sentence}.")
