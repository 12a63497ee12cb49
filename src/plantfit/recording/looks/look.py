"""What a look at the data says."""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

MARKED = 200


MISREAD = ("counted", "rounded", "noisy")  # kinds of inputs; of a run the verdict tells them, and the report draws them
IN_VERDICT = frozenset({"hold"})  # kinds that the verdict tells, so that nobody else does


@dataclass(frozen=True)
class Look:
    """`sentence` with its `figures`, of a `signal` (None: the clock) of a recording between `begin` and `end` (s);
    `write` is the line of the study file that treats it, "" where there is none. `level` "info" or "warning".
    `times` (s) are those of single samples that it is about, MARKED at most; `other` is a second signal that it is
    about."""

    kind: str
    level: Literal["info", "warning"]
    recording: str
    signal: str | None
    sentence: str
    begin: float
    end: float
    write: str = ""
    figures: dict[str, int | float | None] = field(default_factory=dict)
    times: list[float] = field(default_factory=list)
    other: str | None = None

    @property
    def record(self) -> dict[str, Any]:
        """As JSON types."""
        return asdict(self)
