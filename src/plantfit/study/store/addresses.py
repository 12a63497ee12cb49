"""Store addresses as people may see them: the only place that turns one into text for a message, a page or a log."""

import os
import re
import shlex
from urllib.parse import quote, quote_plus, unquote, unquote_plus

# where studies are kept unless the environment or --store says otherwise
STORE, VARIABLE = ("plantfit.db", "PLANTFIT_STORE")
MASK = "***"
# to the last @: a password may hold one that is not escaped
_USER = re.compile(r"([A-Za-z][\w+.-]*://[^\s/?#:@'\"]*):([^\s'\"]*)@")
_KEY = r"(?:ssl)?(?:password|passwd|passphrase|pwd)"
_QUERY = re.compile(rf"([?&;]{_KEY}=)([^&#\s'\"]*)", re.IGNORECASE)
_WORDS = re.compile(rf"(\b{_KEY}\s*[=:]\s*)('(?:[^'\\]|\\.)*'|\"(?:[^\"\\]|\\.)*\"|[^\s'\",;&)]+)", re.IGNORECASE)


def shown(place: str | os.PathLike[str]) -> str:
    """A store address without its passwords; a file name as it is."""
    text = os.fspath(place)
    return _masked_url(text) if "://" in text else text


def store_option(place: str | os.PathLike[str]) -> str:
    """What a command that a message shows needs to reach the store: " --store PLACE", nothing for the usual place."""
    return "" if os.fspath(place) == STORE else f" --store {shlex.quote(shown(place))}"


def concealed(text: str, *places: str | os.PathLike[str]) -> str:
    """A text from elsewhere (a driver, a traceback) without passwords: those of the `places`, and all that stand
    like one."""
    for place in places:
        for secret in sorted(_secrets(os.fspath(place)), key=len, reverse=True):
            text = text.replace(secret, MASK)
    return _WORDS.sub(rf"\1{MASK}", _masked_url(text))


def _masked_url(text: str) -> str:
    return _QUERY.sub(rf"\1{MASK}", _USER.sub(rf"\1:{MASK}@", text))


def _secrets(place: str) -> set[str]:
    """The passwords of an address, escaped and not, as a driver may repeat them."""
    if "://" not in place:
        return set()
    found = {m.group(2) for pattern in (_USER, _QUERY) for m in pattern.finditer(place)}
    spelled = {form(s) for s in found for form in (str, unquote, unquote_plus)}
    spelled |= {form(s) for s in spelled for form in (quote, quote_plus)}
    return {s for s in spelled if len(s) > 1}
