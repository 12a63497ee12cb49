"""All problems by name: those of the suite, whose optimum is certified in truths.json, and candidates that wait for
it."""

from benchmarks.search_suite import (
    dead_times,
    exponentials,
    friction,
    oscillators,
    regressions,
    study_files,
    tables,
    truths,
)
from benchmarks.search_suite.case import Case
from benchmarks.search_suite.study_files import StudyCase

PARTS = (regressions, exponentials, oscillators, dead_times, friction, tables, study_files)
WRITTEN: dict[str, Case | StudyCase] = {case.name: case for part in PARTS for case in part.CASES}
_KNOWN = truths.load()
CASES: dict[str, Case | StudyCase] = {name: case for name, case in WRITTEN.items() if name in _KNOWN}
CANDIDATES: dict[str, Case | StudyCase] = {name: case for name, case in WRITTEN.items() if name not in _KNOWN}
