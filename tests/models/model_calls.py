"""The dynamic functions of a model, for tests that know the model has them."""

from collections.abc import Callable

from plantfit.models import Model


def derivative(model: Model) -> Callable:
    assert model.derivative is not None
    return model.derivative


def initial_state(model: Model) -> Callable:
    assert model.initial_state is not None
    return model.initial_state
