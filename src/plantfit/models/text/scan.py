"""Text of equations to raw statements: lines, semicolons, comments, continuation inside parentheses."""

import re
from dataclasses import dataclass, field

from plantfit.errors import EquationError

Place = tuple[int, int]

MAX_CHARACTERS = 100_000
MAX_PARENTHESES = 60

_TARGET = re.compile(r"\s*(?P<name>[^\W\d]\w*)\s*(?P<prime>'?)\s*")


@dataclass
class Source:
    """Characters of one statement and where each stood: `places[k]` is the (line, column) of `characters[k]`."""

    characters: list[str] = field(default_factory=list)
    places: list[Place] = field(default_factory=list)

    def add(self, character: str, place: Place) -> None:
        self.characters.append(character)
        self.places.append(place)

    def part(self, start: int, stop: int | None = None) -> "Source":
        return Source(self.characters[start:stop], self.places[start:stop])

    @property
    def text(self) -> str:
        return "".join(self.characters)

    def stripped(self) -> "Source":
        text = self.text
        return self.part(len(text) - len(text.lstrip()), len(text.rstrip()))

    def place(self, k: int) -> Place:
        """Place of character k; one past the end is the place after the last character."""
        if k < len(self.places):
            return self.places[k]
        line, column = self.places[-1]
        return line, column + 1


@dataclass(frozen=True)
class RawStatement:
    """`target = right` or `target' = right`, right not yet read."""

    target: str
    derivative: bool
    place: Place
    right: Source


def scan(text: str) -> list[Source]:
    """Split text into statements. Raises EquationError for characters and parentheses that cannot stand there."""
    if len(text) > MAX_CHARACTERS:
        raise EquationError(
            f"The equations have {len(text)} characters; at most {MAX_CHARACTERS} are read, so write them more briefly."
        )
    statements, current, opened = [], Source(), []
    for number, line in enumerate(text.split("\n")):
        for column, character in enumerate(line):
            place = (number, column)
            if character == "#":
                break
            if character == ";" and not opened:
                statements.append(current)
                current = Source()
                continue
            _check_character(character, text, place)
            _follow_parenthesis(character, opened, text, place)
            current.add(" " if character.isspace() else character, place)
        if opened:
            current.add(" ", (number, len(line)))
        else:
            statements.append(current)
            current = Source()
    if opened:
        raise EquationError("This parenthesis is never closed; add ')'.", text, *opened[-1])
    return [s.stripped() for s in statements if s.text.strip()]


def split(statement: Source, text: str) -> RawStatement:
    """Find the target and the right-hand side of a statement."""
    equals = _assignment(statement.text)
    if equals is None:
        double = statement.text.find("==")
        if double >= 0:
            raise EquationError(
                "'==' compares two values; write one '=' to give a value.", text, *statement.place(double)
            )
        raise EquationError(
            "There is no '=' here; write name = expression, or name' = expression for a state.",
            text,
            *statement.place(0),
        )
    left = statement.text[:equals]
    match = _TARGET.fullmatch(left)
    if match is None:
        what = f"{left.strip()!r} cannot stand left of '='; write"
        second = re.fullmatch(r"\s*(\w+)\s*''+\s*", left)
        if second is not None:
            name = second[1]
            message = f"{what} a second derivative with one more state, as in {name}' = v and v' = ..."
            raise EquationError(message, text, *statement.place(0))
        raise EquationError(f"{what} a single name, or name' for the derivative of a state.", text, *statement.place(0))
    right = statement.part(equals + 1).stripped()
    if not right.characters:
        raise EquationError("There is nothing right of '='; write an expression.", text, *statement.place(equals))
    refuse_quotes(right, text, rates=True)
    return RawStatement(match["name"], bool(match["prime"]), statement.place(match.start("name")), right)


def refuse_quotes(source: Source, text: str, rates: bool = False) -> None:
    """Raise EquationError at the first quotation mark; with `rates` one behind a name is the rate of a state."""
    for mark in "'\"":
        if mark in source.characters:
            at = source.characters.index(mark)
            place = source.place(at)
            state = re.search(r"[^\W\d]\w*$", "".join(source.characters[:at])) if rates and mark == "'" else None
            if state is not None:  # an accelerometer reads v'
                raise EquationError(
                    f"The rate {state[0]}' cannot stand right of '='. Give it a name of its own, as in rate = ... and "
                    f"{state[0]}' = rate, and write that name here.",
                    text,
                    *place,
                )
            raise EquationError(
                f"The mark {mark} cannot stand in an expression: text is "
                "not allowed, and ' belongs after a state, left of '='.",
                text,
                *place,
            )


def _assignment(text: str) -> int | None:
    for k, character in enumerate(text):
        if character == "=":
            return None if text[k + 1 : k + 2] == "=" or text[:k].endswith(("<", ">", "!")) else k
    return None


def _check_character(character: str, text: str, place: Place) -> None:
    if not (character.isprintable() or character.isspace()):
        raise EquationError(f"The character {character!r} cannot be read; delete it.", text, *place)
    if character in "\\$?`@":
        raise EquationError(f"The character {character} has no meaning in equations; delete it.", text, *place)


def _follow_parenthesis(character: str, opened: list[Place], text: str, place: Place) -> None:
    if character == "(":
        opened.append(place)
        if len(opened) > MAX_PARENTHESES:
            raise EquationError(
                f"More than {MAX_PARENTHESES} parentheses are open here; split the expression with intermediate names.",
                text,
                *place,
            )
    elif character == ")":
        if not opened:
            raise EquationError("This parenthesis was never opened; delete it or add '('.", text, *place)
        opened.pop()
