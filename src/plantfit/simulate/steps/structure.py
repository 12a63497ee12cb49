"""What enters what in a model's equations."""

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.dependencies import dependencies
from plantfit.simulate.steps.vector import VectorModel, placeholders

import jax


def is_linear(vector: VectorModel) -> bool:
    """Whether x' = A x + B u + c with A, B, c made of parameters only (time counts as an input).

    Then no state and no input enters the Jacobians.
    """

    def jacobians(x, u, p):
        return jax.jacfwd(lambda x, u: vector.rate(x, u, p), argnums=(0, 1))(x, u)

    moving = range(len(vector.states) + len(vector.channels))
    return set().union(*dependencies(jacobians, *placeholders(vector.model))).isdisjoint(moving)


def output_reads_input(vector: VectorModel) -> bool:
    """Whether any output depends on an input directly."""
    n, m = len(vector.states), len(vector.channels)
    return not set().union(*dependencies(vector.output, *placeholders(vector.model))).isdisjoint(range(n, n + m))


def output_reads_delayed(vector: VectorModel) -> bool:
    """Whether any output depends on a delayed copy of an input directly."""
    first = len(vector.states) + len(vector.model.inputs)
    late = range(first, first + len(vector.model.delays))
    return not set().union(*dependencies(vector.output, *placeholders(vector.model))).isdisjoint(late)
