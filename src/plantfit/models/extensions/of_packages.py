"""Additions that other packages bring by the entry point `plantfit.candidates` (docs/plug-ins.md)."""

from typing import Any

from plantfit.errors import ModelError
from plantfit.models.extensions.kinds import KINDS, Kind
from plantfit.plugins import Plugin, offered


def packages_kinds() -> dict[str, Plugin]:
    """What packages offer, by kind, in alphabetical order; nothing of it is imported."""
    return offered("candidates", frozenset(KINDS))


def loaded(plugin: Plugin) -> tuple[Any, Kind]:
    """The candidate of a package, and its addition to a model. Raises ModelError where it has none."""
    candidate = plugin.load(ModelError)
    kind = getattr(candidate, "extension", None)
    if not isinstance(kind, Kind):
        raise ModelError(
            f"{plugin.name!r} of the package {plugin.package} is no candidate with an "
            f"`extension` (docs/plug-ins.md); update or uninstall {plugin.package}."
        )
    return candidate, kind
