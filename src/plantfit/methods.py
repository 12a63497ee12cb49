"""The search methods by name, listed and made as `plantfit.models` does it.

    methods.names()                      ("auto", "least_squares", ...)
    methods.listing()                    a record of each: name, sentence, source, options
    methods.describe("cmaes")            the same of one, as text
    methods.make("cmaes", sigma=0.2)     an instance, for `fit` and `minimise`

`methods()` gives the plain records of `plantfit methods --json`, as earlier programs have it.
"""

import sys
from functools import partial
from types import ModuleType
from typing import Any

from plantfit.listing import Listed, Option
from plantfit.optimize import registry
from plantfit.optimize.contract import Host, Population

__all__ = ["describe", "listing", "make", "names"]


def names() -> tuple[str, ...]:
    """Names of all methods."""
    return tuple(registry.known())


def make(name: str, /, **options: Any) -> Population | Host:
    """The method called `name` with its options, for `fit` and `minimise`.

    Raises SearchError for an unknown method or option, or a value outside its range.
    """
    return registry.make(name, **options)


def listing() -> tuple[Listed, ...]:
    """A record of every method: name, sentence, source, options, and how it is made."""
    return tuple(_listed(record) for record in registry.methods())


def describe(method: str | Population | Host) -> str:
    """What a method (by its name, or an instance) does, where it is published, and its options, as text. Raises
    SearchError."""
    name = method if isinstance(method, str) else registry.name_of(method)
    make(name)  # raises the sentence for an unknown name
    return next(found for found in listing() if found.name == name).describe()


def _listed(record: dict[str, Any]) -> Listed:
    options = tuple(Option(s["name"], s["default"], s["sentence"], _values(s)) for s in record["settings"])
    return Listed(record["name"], record["sentence"], record["paper"], options, partial(registry.make, record["name"]))


def _values(setting: dict[str, Any]) -> str:
    if "options" in setting:
        return ", ".join(map(str, setting["options"]))
    return " to ".join(str(v) if isinstance(v, int) else f"{v:g}" for v in setting.get("range", ()))


class _Called(ModuleType):
    """The module can be called as the function that it once was."""

    def __call__(self) -> list[dict[str, Any]]:
        return registry.methods()


sys.modules[__name__].__class__ = _Called
