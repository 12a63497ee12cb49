"""Stored studies by number or name."""

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


def is_number(given: str) -> bool:
    """Whether a word is the number of a study."""
    return given.isascii() and given.isdigit()
