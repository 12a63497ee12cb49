"""How any process makes the problem of a study anew: from text and files, never from pickled objects."""

import hashlib
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

import numpy as np

from plantfit.errors import StoreError
from plantfit.optimize.contract import Objective

STUDY_FILES = "plantfit.rebuild:searched"  # makes what `plantfit run` searches

Made = tuple[Objective, Callable[[Any], Any] | None]


class Maker(Protocol):
    """Makes (objective, to_physical) of the text of a study; the same arguments give the same bits.

    `path` is where the study file lies or lay. `files` maps names of recordings, as the text has them, to
    where they are if that is elsewhere than the text says. `start` replaces the warm starts that the maker
    would have to search for.
    """

    def __call__(self, text: str, path: str, files: Mapping[str, Path], start: np.ndarray | None) -> Made: ...


@dataclass(frozen=True)
class Recipe:
    """`maker` is the place of a Maker, as in "package.module:function"; `files` hold the recordings' bytes, none if
    they are at hand."""

    maker: str
    text: str
    path: str
    files: Mapping[str, bytes] = field(default_factory=dict)

    @property
    def digest(self) -> str:
        """The same for recipes that make the same problem."""
        found = hashlib.sha256()
        for part in (
            self.maker,
            self.text,
            self.path,
            *(p for name in sorted(self.files) for p in (name, self.files[name])),
        ):
            data = part.encode() if isinstance(part, str) else part
            found.update(len(data).to_bytes(8, "big") + data)
        return found.hexdigest()

    def make(self, start: np.ndarray | None = None) -> Made:
        """The objective and the map to declared units. Raises what the maker raises, and StoreError if there is no
        such maker."""
        maker = _found(self.maker)
        with TemporaryDirectory(prefix="plantfit-") as folder:
            places = {}
            for k, (name, data) in enumerate(self.files.items()):
                places[name] = Path(folder, str(k), Path(name).name)  # readers go by the ending of a name
                places[name].parent.mkdir()
                places[name].write_bytes(data)
            return maker(self.text, self.path, places, start)


def _found(maker: str) -> Maker:
    module, _, function = maker.partition(":")
    try:
        return getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        raise StoreError(
            f"The problem of the study cannot be made here because {maker!r} cannot be imported ({error}); "
            "give the place of a function as in 'package.module:function', of a module that every worker has."
        ) from error
