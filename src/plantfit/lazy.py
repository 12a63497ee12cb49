"""Names of a room that are loaded when first used, so that a command imports only what it needs (PEP 562 for a whole
room)."""

import sys
from collections.abc import Mapping
from importlib import import_module
from types import ModuleType
from typing import Any


class _Room(ModuleType):
    """A package whose public names come from the modules that `_places` says."""

    _places: Mapping[str, str]

    def __getattr__(self, name: str) -> Any:
        places = self.__dict__.get("_places", {})
        if name not in places:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        value = getattr(import_module(places[name]), name)
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        # the import system binds trust/intervals/covariance.py as `covariance` to its room, where the function of that
        # name belongs
        if not (isinstance(value, ModuleType) and name in self.__dict__.get("_places", {})):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*self.__dict__, *self.__dict__.get("_places", {})})


def names_of(room: str, modules: Mapping[str, str]) -> None:
    """Let a room load names when they are first used: of each of its modules those that the text lists, apart by
    blanks.

    Called in `__init__.py` of the room, where the same imports stand under TYPE_CHECKING for editors.
    """
    package = sys.modules[room]
    package.__dict__["_places"] = {
        name: f"{room}.{module}" for module, names in modules.items() for name in names.split()
    }
    package.__class__ = _Room
