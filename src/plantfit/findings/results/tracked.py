"""`plantfit track`: a finished study's filter over new samples."""

from plantfit.findings.record import Number, Printed, Record


class RaisedAlarm(Record):
    """The plant has left what the study knows of it."""

    t: float
    """s"""
    since: float
    """s, from where on the samples say so."""
    parameter: str | None
    """Whose change explains most; None where none does."""
    unit: str | None
    from_value: Number
    to_value: Number
    alike: list[str]
    """Parameters that explain as much, as far as the samples tell."""
    factor: Number
    """By how much innovations are larger than the study expects."""
    p: Number
    """The chance of such a look with a healthy plant."""
    allowed: Number
    """What this look may have."""
    told: Number = None
    """s, when samples behind the alarm have told its cause; None where those before it do, or none."""
    sentence: str


class Tracked(Printed):
    """What `plantfit track --json` prints."""

    study: int | None
    """Number in the store; None where none was kept."""
    samples: int
    looks: int
    false_alarm: float
    """Chance of an alarm in a record as long as the study's, with a healthy plant."""
    alarms: list[RaisedAlarm]
    end: dict[str, Number] | None
    """What is believed at the end, by state and parameter, with `t`; None without samples."""
    sentence: str
    written: dict[str, str] = {}
    """Files by kind."""
