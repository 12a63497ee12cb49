"""`when falling(h): v = -c*v, w = 0` in equations: the condition and what jumps, not yet read."""

import re
from dataclasses import dataclass

from plantfit.errors import EquationError
from plantfit.models.text.scan import Place, RawStatement, Source, refuse_quotes, split

CROSSINGS = ("falling", "rising", "crossing")

_WHEN = re.compile(r"when\b(?!\s*'?\s*=)")
_HEAD = re.compile(r"when\s+(?P<kind>\w+)\s*(?P<opened>\()")
_FORM = "write when falling(x): v = -c*v, with falling, rising or crossing"


@dataclass(frozen=True)
class RawWhen:
    """`kind` is one of `CROSSINGS`, `place` that of the word; the right sides are not yet read."""

    kind: str
    place: Place
    condition: Source
    resets: tuple[RawStatement, ...]


def is_when(source: Source) -> bool:
    """Whether a statement is an event; `when = 3` is an equation."""
    return _WHEN.match(source.text) is not None


def split_when(source: Source, text: str) -> RawWhen:
    """Find the parts of an event. Raises EquationError with line and column."""
    line = source.text
    head = _HEAD.match(line)
    if head is None or head["kind"] not in CROSSINGS:
        after = re.match(r"when\s*", line)
        raise EquationError(
            f"After 'when' an event is needed, such as falling(x); {_FORM}.",
            text,
            *source.place(after.end() if after else 0),
        )
    closed = _closing(line, head.start("opened"))
    condition = source.part(head.end(), closed).stripped()
    if not condition.characters:
        raise EquationError(f"There is nothing in {head['kind']}(); {_FORM}.", text, *source.place(head.end()))
    refuse_quotes(condition, text)
    rest = line[closed + 1 :]
    colon = closed + 1 + len(rest) - len(rest.lstrip())
    if line[colon : colon + 1] != ":":
        raise EquationError(
            f"After {head['kind']}(...) a ':' and a state that jumps are needed; {_FORM}.", text, *source.place(colon)
        )
    resets = tuple(_reset(part, text, source.place(colon)) for part in _between_commas(source.part(colon + 1)))
    return RawWhen(head["kind"], source.place(head.start("kind")), condition, resets)


def _reset(part: Source, text: str, colon: Place) -> RawStatement:
    if not part.characters:
        raise EquationError(
            "A state and its new value are missing here; write state = expression, several with commas.", text, *colon
        )
    return split(part, text)


def _between_commas(source: Source) -> list[Source]:
    """Parts between the commas that stand outside of parentheses."""
    parts, depth, start = [], 0, 0
    for k, character in enumerate(source.characters):
        depth += (character == "(") - (character == ")")
        if character == "," and depth == 0:
            parts.append(source.part(start, k).stripped())
            start = k + 1
    return [*parts, source.part(start).stripped()]


def _closing(line: str, opened: int) -> int:
    """Place of the parenthesis that closes the one at `opened`; scanning has made sure that there is one."""
    depth = 0
    for k in range(opened, len(line)):
        depth += (line[k] == "(") - (line[k] == ")")
        if depth == 0:
            return k
    raise AssertionError("an open parenthesis passed the scan")
