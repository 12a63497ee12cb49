"""A sentence of the verdict."""

from plantfit.findings.record import Level, Number, Record


class Sentence(Record):
    """What the verdict says, how grave it is, and the numbers in it."""

    level: Level
    sentence: str
    figures: dict[str, Number] = {}
