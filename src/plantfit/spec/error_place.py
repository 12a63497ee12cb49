"""Errors that begin with the place in the study file where their cause is."""

from collections.abc import Generator
from contextlib import contextmanager

from plantfit.errors import PlantfitError, SpecError


@contextmanager
def errors_at(place: str) -> Generator[None]:
    """Errors from within begin with this place; what nests too deeply or is too large becomes a SpecError."""
    try:
        yield
    except PlantfitError as error:
        error.args = (f"{place}: {error}",)
        raise
    except RecursionError:
        raise SpecError(f"{place}: something has too many brackets inside each other; write it with fewer.") from None
    except (OverflowError, MemoryError) as error:
        raise SpecError(f"{place}: a number or a table is too large ({error}); correct it there.") from None
