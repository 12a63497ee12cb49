"""Close matches for a name that is not known."""

import difflib
from collections.abc import Iterable


def suggest(name: str, known: Iterable[str]) -> str:
    """ " Did you mean 'x'?" with a leading space, or an empty string when nothing is close."""
    known = sorted(set(known))
    by_case = [k for k in known if k.casefold() == name.casefold()]
    close = by_case or difflib.get_close_matches(name, known, n=3, cutoff=0.6)
    return f" Did you mean {' or '.join(repr(c) for c in close)}?" if close else ""
