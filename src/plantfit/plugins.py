"""What other packages add by entry points: methods, models, readers, looks at the data, candidates of a diagnosis.

Nothing of them is imported before it is used.

A package names them in its `pyproject.toml` (docs/plug-ins.md):

    [project.entry-points."plantfit.methods"]
    random_walk = "my_package.walk:RandomWalk"
"""

import inspect
import warnings
from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from plantfit.errors import PlantfitError


@dataclass(frozen=True)
class Plugin:
    """One entry point: the name by which users ask for it, and the package that brings it."""

    name: str
    package: str
    point: EntryPoint

    def load(self, error: type[PlantfitError]) -> Any:
        """What the entry point stands for. Raises `error` where its package cannot be imported."""
        try:
            return self.point.load()
        except Exception as failure:  # whatever the package does while it is imported
            raise error(
                f"{self.name!r} of the package {self.package} cannot be loaded ({type(failure).__name__}: "
                f"{str(failure)[:200]}); "
                f"update or uninstall {self.package}."
            ) from failure


@cache
def offered(group: str, own: Collection[str] = frozenset()) -> dict[str, Plugin]:
    """Plug-ins of the group "methods", "models", "readers", "looks" or "candidates" by name, in alphabetical order.

    Names in `own` are plantfit's, and of two packages with one name the first in the alphabet is taken; a warning names
    what is left out.
    """
    found: dict[str, Plugin] = {}
    points = [(p.name, p.dist.name if p.dist else "?", p) for p in entry_points(group=f"plantfit.{group}")]
    for name, package, point in sorted(points, key=lambda p: p[:2]):
        before = "plantfit" if name in own else found[name].package if name in found else None
        if before is None:
            found[name] = Plugin(name, package, point)
        elif before != package:
            kind = group.removesuffix("s")
            warnings.warn(
                f"The {kind} {name!r} of the package {package} is left out: {before} has one of this name.",
                stacklevel=2,
            )
    return found


def first_sentence(thing: Any) -> str:
    """The first paragraph of a docstring, on one line; "" without."""
    text = inspect.getdoc(thing) or ""
    return " ".join(text.split("\n\n")[0].split())
