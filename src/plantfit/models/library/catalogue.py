"""The models by name: those that come with plantfit, and those that other packages bring (`plugins.py`)."""

import inspect
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any, Literal, cast

from plantfit.errors import ModelError
from plantfit.listing import Listed, Option
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Model
from plantfit.models.text.suggest import suggest
from plantfit.plugins import offered

Factory = Callable[..., Model | LinearModel]

_PLACES = {
    "dc_motor": "plantfit.models.library.dc_motor",
    "drive": "plantfit.models.library.drive",
    "drive_regression": "plantfit.models.library.drive",
    "first_order": "plantfit.models.library.process",
    "hammerstein_wiener": "plantfit.models.library.hammerstein_wiener",
    "pendubot": "plantfit.models.library.pendubot",
    "pendubot_regression": "plantfit.models.library.pendubot",
    "second_order": "plantfit.models.library.process",
    "steam_chamber": "plantfit.models.library.steam_chamber",
    "tabled_first_order": "plantfit.models.library.tabled_process",
}


def names() -> tuple[str, ...]:
    """Names of all models, without importing them."""
    return (*_PLACES, *offered("models", frozenset(_PLACES)))


def factory(name: str) -> Factory:
    """The function that makes the model of this name. Raises ModelError for an unknown name."""
    if name in _PLACES:
        return getattr(import_module(_PLACES[name]), name)
    brought = offered("models", frozenset(_PLACES))
    if name not in brought:
        known = names()
        raise ModelError(
            f"There is no model {name!r}.{suggest(name, known)} Known "
            f"are {', '.join(known)}, or write your own equations."
        )
    function = brought[name].load(ModelError)
    if not callable(function):
        raise ModelError(
            f"{name!r} of the package {brought[name].package} is not "
            "a function that makes a model; see docs/plug-ins.md."
        )
    return cast(Factory, function)


def models() -> dict[str, Factory]:
    """Names to the functions that make the models."""
    return {name: factory(name) for name in names()}


def listing() -> tuple[Listed, ...]:
    """A record of every model: name, sentence, source, options, and how it is made."""
    return tuple(listed(name) for name in names())


def listed(name: str) -> Listed:
    """The record of one model. Raises ModelError for an unknown name."""
    function = factory(name)
    model, known = function(), inspect.signature(function).parameters.values()
    options = tuple(Option(o.name, o.default, values=_values(o.annotation)) for o in known)
    return Listed(name, model.sentence, model.source, options, partial(make, name))


def _values(annotation: Any) -> str:
    """The words that an option may be, of its annotation; else its kind."""
    words = getattr(annotation, "__args__", ()) if getattr(annotation, "__origin__", None) is Literal else ()
    if words:
        return ", ".join(map(str, words))
    return annotation.__name__ if isinstance(annotation, type) else str(annotation)


def make(name: str, /, **options: Any) -> Model | LinearModel:
    """A model by name with its options. Raises ModelError for an unknown name or option."""
    function = factory(name)
    known = tuple(inspect.signature(function).parameters)
    for option in options:
        if option not in known:
            raise ModelError(
                f"Model {name!r} has no option {option!r}.{suggest(option, known)} Options are "
                f"{', '.join(known) or 'none'}."
            )
    return function(**options)
