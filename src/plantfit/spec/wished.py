"""A table of the study file with wishes of a call that count before it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from plantfit.errors import SpecError
from plantfit.spec.asked import asked
from plantfit.spec.tables import key_places, validated

Table = TypeVar("Table", bound=BaseModel)


def table_in(text: str | None, name: str, path: Path = Path("study.toml")) -> dict[str, Any]:
    """What the table `name` of a study file says; nothing without a file."""
    return getattr(validated(text, path), name).model_dump(exclude_unset=True) if text else {}


def wished(kind: type[Table], table: Mapping[str, Any], wishes: Mapping[str, Any], function: str) -> Table:
    """The table with those wishes that are not None. Raises SpecError for a key that there is not, and for a value
    that cannot be."""
    given = {**table, **{k: v for k, v in wishes.items() if v is not None}}
    unknown = [k for k in given if k not in kind.model_fields]
    if unknown:
        raise SpecError(f"{function}() does not know {unknown[0]!r}; it takes {', '.join(kind.model_fields)}.")
    try:
        return kind.model_validate(given)
    except ValueError as error:
        every = error.errors()  # pyrefly: ignore[missing-attribute]  (pydantic's)
        places = key_places(every[0]["loc"])
        told = asked([e for e in every if key_places(e["loc"]) == places])
        name = ".".join(p for p in places if not p.isdigit())
        raise SpecError(f"{name} = {every[0]['input']!r} cannot be used: {told}.") from None
