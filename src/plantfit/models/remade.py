"""Models that can be pickled: as the call that made them, since their functions are local to it."""

import copy
import functools
import inspect
import pickle
from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any, ParamSpec, TypeVar

from plantfit.errors import ModelError

P = ParamSpec("P")
M = TypeVar("M")

_CALL = "_made_by"  # no field: a copy made by `dataclasses.replace` is another model, and does not have it


def remade(factory: Callable[P, M]) -> Callable[P, M]:
    """A factory of models, which are then pickled as the call of it with the same arguments."""

    @functools.wraps(factory)
    def make(*args: P.args, **kwargs: P.kwargs) -> M:
        kept = tuple(map(_kept, args)), {k: _kept(v) for k, v in kwargs.items()}
        model = factory(*args, **kwargs)
        object.__setattr__(model, _CALL, (make, *kept))
        return model

    return make


def takes(model: Any, option: str, value: Any) -> bool:
    """Whether the factory that made a model also makes it with this value of an option, and does not so already."""
    factory, args, options = getattr(model, _CALL, (None, (), {}))
    if factory is None or option not in inspect.signature(factory).parameters or options.get(option) == value:
        return False
    try:
        factory(*args, **{**options, option: value})
    except (ModelError, TypeError):
        return False
    return True


def _kept(value: Any) -> Any:
    """An argument that stays as it is when the caller changes his own."""
    return copy.deepcopy(value) if isinstance(value, dict | list) else value


def reduced(model: Any) -> tuple[Any, ...]:
    """What `__reduce__` of a model gives. Raises ModelError for a model with functions that cannot be pickled."""
    made_by = getattr(model, _CALL, None)
    if made_by is not None:
        return _called, made_by
    values = {f.name: getattr(model, f.name) for f in fields(model)}
    for name, value in values.items():
        _check(model, name, value)
    return _filled, (type(model), values)


def _called(factory: Callable[..., Any], args: tuple[Any, ...], kwargs: Mapping[str, Any]) -> Any:
    return factory(*args, **kwargs)


def _filled(kind: type, values: Mapping[str, Any]) -> Any:
    return kind(**values)


def _check(model: Any, name: str, value: Any) -> None:
    try:
        pickle.dumps(value)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ModelError(
            f"Model {model.name!r} cannot be pickled, because its {name} is or holds "
            f"a function that is local to another one or a lambda ({error}); define "
            "its functions at the top of a module, or write the model as equations."
        ) from None
