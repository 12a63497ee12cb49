"""Every error that plantfit raises on purpose, and the ways a run can end.

    PlantfitError
      RecordingError      a file or signal that cannot be used as it is
        ClockError          times go back or stand twice; the line of a study file that treats it
        NoTimeError         no column looks like time, and no period is given
      UnitError           a unit that does not exist or does not fit
      ModelError          a model that contradicts itself
        EquationError     a place in the text of an equation
      SpaceError          parameters: bounds, scales, ties, values outside
      SpecError           a key or value of a study file
      SearchError         a method, setting or budget that cannot work
        FlatLikelihood    parameters or noise levels that a likelihood leaves open
      SimulationError     a model that cannot be simulated at these values
      StoreError          the study database: missing, locked, full, damaged
      MissingExtra        an optional package is not installed
      BoardError          a board or its port that cannot be used
      Interrupted         stopped by the user; what was finished is kept

Messages are one sentence that names file, place and value, then what to do.
"""

import enum
import re
from collections.abc import Sequence


class PlantfitError(Exception):
    """Base of all errors meant for a user; `exit_code` is what the command line returns."""

    exit_code = 2


class RecordingError(PlantfitError):
    """A file or signal cannot be used as it is."""

    exit_code = 3


class ClockError(RecordingError):
    """Times go back or stand twice; `treatment` is the line of a study file that treats it."""

    def __init__(self, sentence: str, treatment: str = ""):
        super().__init__(sentence)
        self.treatment = treatment


class NoTimeError(RecordingError):
    """No column is one of time, and no period is given."""


class UnitError(PlantfitError):
    """A unit does not exist or does not fit."""

    exit_code = 4


class ModelError(PlantfitError):
    """A model contradicts itself."""

    exit_code = 5


class EquationError(ModelError):
    """A place in the text of an equation; shows the line with a caret under the character.

    `line` and `column` count from 0 within `text`.
    """

    def __init__(self, message: str, text: str = "", line: int = 0, column: int = 0):
        self.reason, self.text, self.line, self.column = message, text, line, column
        shown = message
        if text:
            source = text.split("\n")[line]
            first = max(0, column - 70)  # a window of a line that is longer than a screen
            left, right = "..." if first else "", "..." if len(source) > first + 140 else ""
            shown = (
                f"{message}\n    {left}{source[first : first + 140]}{right}\n    {' ' * (len(left) + column - first)}^"
            )
        super().__init__(shown)


class SpaceError(PlantfitError):
    """Bounds, scales, ties or values of parameters are wrong."""

    exit_code = 6


class SpecError(PlantfitError):
    """A key or value of a study file is wrong."""

    exit_code = 7


class SearchError(PlantfitError):
    """A method, setting or budget cannot work."""

    exit_code = 8


class FlatLikelihood(SearchError):
    """The likelihood is flat along `names`, parameters and noise levels that the recordings do not tell apart."""

    def __init__(self, names: Sequence[str]):
        self.names = tuple(names)
        super().__init__(
            f"The likelihood is flat along {list(names)}: these "
            "recordings do not tell them apart; hold one or measure more."
        )


class SimulationError(PlantfitError):
    """A model cannot be simulated at these values."""

    exit_code = 9


class StoreError(PlantfitError):
    """The study database is missing, locked, full or damaged."""

    exit_code = 10


class MissingExtra(PlantfitError):
    """An optional package is not installed."""

    exit_code = 11


class BoardError(PlantfitError):
    """A board or its port cannot be used."""

    exit_code = 13


class Interrupted(PlantfitError):
    """Stopped by the user; what was finished is kept."""

    exit_code = 130


class PlantfitWarning(UserWarning):
    """Something that works otherwise than usual, in one sentence; the command line prints it, Python warns."""


def in_words(error: BaseException) -> str:
    """What an exception of Python or a library says of a value, in at most 200 characters, as part of a sentence for a
    user.

    Where it speaks of code alone ("'int' object is not iterable") it is said that a value is of the wrong kind.
    """
    if isinstance(error, TypeError | AttributeError | ValueError | IndexError) and _OF_CODE.search(str(error)):
        return "a value is of the wrong kind"
    return (str(error).splitlines() or [type(error).__name__])[0][:200]


_OF_CODE = re.compile(
    r"^ufunc |<class '|object at 0x|NoneType|unsupported operand|object has no attribute|not subscriptable|indices "
    r"must be integers"
    r"|required positional|object (is not|cannot|does not)|a real number|not supported between|could not be "
    r"(broadcast|convert)|bad operand"
    r"|truth value|operands could not|only (integer|0-dim|size-1|length-1)|setting an array element|must be "
    r"str|unhashable|ambiguous"
    r"|inhomogeneous|loop with signature|isn't supported|Cannot interpret|too many values|not enough "
    r"values|interpreted as an integer"
)


class Status(enum.StrEnum):
    """How a run ended; `sentence` says it to a person."""

    running = "running"
    converged = "converged"
    budget = "budget"
    stagnated = "stagnated"
    target = "target"
    interrupted = "interrupted"
    failed = "failed"

    @property
    def sentence(self) -> str:
        """What the status means, as a sentence."""
        return _SENTENCES[self]


_SENTENCES = {
    Status.running: "The run has not ended yet.",
    Status.converged: "The method met its own tolerance.",
    Status.budget: "The budget of evaluations was spent.",
    Status.stagnated: "No better point was found for long enough to stop.",
    Status.target: "The target cost was reached.",
    Status.interrupted: "The run was stopped and can be resumed.",
    Status.failed: "No candidate of the run could be simulated.",
}
