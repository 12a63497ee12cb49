"""A study file with additions to its model: [model.extensions], their parameters, and cleaning steps; all else stays
as it was written."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit

from plantfit.errors import SpecError
from plantfit.models.extensions.steps import moment_of
from plantfit.spec.reading import parse
from plantfit.spec.rewritten.document import text_of
from plantfit.trust.diagnosis.treatment import SMOOTH, Change


def with_additions(
    text: str,
    path: Path,
    changes: Sequence[Change],
    clean: Mapping[str, Sequence[Mapping[str, Any]]] | None = None,
    name: str | None = None,
) -> str:
    """The text of a study file with `changes`, steps added to `clean` of recordings by name, and another `name`.

    Raises SpecError where the new file could not be read.
    """
    document = tomlkit.parse(text.removeprefix("\ufeff"))
    if name is not None:
        document["name"] = name
    for recording, steps in (clean or {}).items():
        own = document["recording"][recording]
        own["clean"] = [*own.get("clean", []), *map(dict, steps)]
    model: Any = document["model"]
    extensions = model.get("extensions")
    if changes and extensions is None:
        model["extensions"] = extensions = tomlkit.table()
    parameters: Any = document.setdefault("parameters", tomlkit.table())
    for c in changes:
        if c.kind not in extensions:
            extensions[c.kind] = tomlkit.inline_table()
        extensions[c.kind][c.signal] = _bounds(c)
        own = tomlkit.table()
        own["start"] = _plain(c.start)
        if c.per_recording:
            own["per_recording"] = True
        if c.nodes is not None:
            own["smooth"] = SMOOTH
        parameters[c.parameter] = own
        if c.moment is not None:
            parameters[moment_of(c.parameter)] = {"start": _plain(c.moment[2])}
        for beside, (low, high, start) in c.ranges:
            parameters[beside] = {"bounds": [_plain(low), _plain(high)], "start": _plain(start)}
        for beside, value in c.values:
            parameters[beside] = {"value": _plain(value)}
    new = text_of(document)
    try:
        parse(new, path)
    except SpecError as error:
        raise SpecError(
            f"{path.name} cannot be written with {', '.join(c.parameter for c in changes)}: {error}"
        ) from None
    return new


def _bounds(c: Change) -> Any:
    """The bounds of an addition, of a curve in time with its nodes, of a pattern that repeats with its period, of
    a step with its moment."""
    pair = [_plain(b) for b in c.bounds]
    if c.period is not None:
        (period, count), made = c.period, tomlkit.inline_table()
        made.update({"bounds": pair, "period": _plain(period), "count": count})
        return made
    if c.moment is not None:
        made = tomlkit.inline_table()
        made.update({"bounds": pair, "at": [_plain(v) for v in c.moment[:2]]})
        return made
    if c.nodes is None:
        return pair
    (begin, end, count), made = c.nodes, tomlkit.inline_table()
    nodes = tomlkit.inline_table()
    nodes.update({"from": _plain(begin), "to": _plain(end), "count": count})
    made.update({"bounds": pair, "nodes": nodes})
    return made


def _plain(value: float) -> float:
    return float(f"{value:.6g}")
