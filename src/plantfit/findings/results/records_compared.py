"""`plantfit compare-records`: every recording fitted alone, and its parameters beside those of the others."""

from plantfit.findings.heterogeneity import AllAtOnce, Apart, RecordingAlone, SharedParameter
from plantfit.findings.record import Printed
from plantfit.findings.verdict import Sentence


class ComparisonOfRecords(Printed):
    """What `pf.compare_records` finds.

    Parameters are the shared ones; those that the study lets differ are no disagreement. On a log scale the test is of
    the logarithm.
    """

    name: str
    verdict: list[Sentence] = []
    agree: bool | None
    """None where nothing could be tested."""
    level: float
    unit: str | None
    """Of the output, where there is one."""
    recordings: list[RecordingAlone]
    parameters: list[SharedParameter]
    together: AllAtOnce | None
    apart: list[Apart]
    """Recordings without which the others agree."""
    either: list[str]
    """Several of which one is apart."""
    study: int | None = None
    """Number in the store; `--json` alone."""
    written: dict[str, str] = {}
    """Files by kind; `--json` alone."""
