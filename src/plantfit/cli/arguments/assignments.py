"""Options that give numbers by name, such as `--set tau=3.5`."""

from collections.abc import Sequence

from plantfit.errors import SpaceError


def numbers_by_name(option: str, texts: Sequence[str]) -> dict[str, float]:
    """NAME=NUMBER texts as a mapping; raises SpaceError for one that cannot be read."""
    named = {}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            named[name.strip()] = float(number)
        except ValueError:
            raise SpaceError(f"{option} {text!r} cannot be read; write NAME=NUMBER, as in {option} tau=3.5.") from None
    return named
