"""Stored studies by number or name, or by their file."""

import shlex
import tomllib
from pathlib import Path

from plantfit.errors import StoreError
from plantfit.study.store.addresses import shown


def number_of(given: str, store: str) -> int:
    """The number of a stored study: the number itself, or that of the newest study of this name. Raises StoreError."""
    if is_number(given):
        return int(given)
    from plantfit.study import Store

    records = Store.open(store, create=False).studies()
    own = [r.id for r in records if r.name == given]
    if not own:
        raise StoreError(f"{given!r} is neither a study file here nor a study in {shown(store)}; see `plantfit list`.")
    return own[-1]


def number_given(given: str | None, store: str) -> int | None:
    """The number of the stored study that an argument means: a number, a name, or a study file whose newest study it
    is; None for none given. Raises StoreError."""
    if given is None or is_number(given) or not (given.endswith(".toml") or Path(given).is_file()):
        return None if given is None else number_of(given, store)
    from plantfit.study import Store

    if not given.endswith(".toml"):
        raise StoreError(f"{given!r} is no study file; give the number, the name or the .toml file of a study.")
    try:
        name = tomllib.loads(Path(given).read_text(encoding="utf-8-sig")).get("name")
    except FileNotFoundError:
        raise StoreError(f"There is no file {given!r}; `plantfit list` shows what is stored.") from None
    except (OSError, ValueError) as error:
        raise StoreError(f"{given!r} cannot be read as a study file: {error}.") from None
    own = [r.id for r in Store.open(store, create=False).studies() if r.name == name]
    if not own:
        raise StoreError(f"{shown(store)} holds no study of {given!r}; `plantfit run {shlex.quote(given)}` makes one.")
    return own[-1]


def is_number(given: str) -> bool:
    """Whether a word is the number of a study."""
    return given.isascii() and given.isdigit()
