"""What is missing in a model: additions tried on the fitted problem, judged by unseen data."""

from plantfit.trust.diagnosis.candidates import Before, Behind, Inside
from plantfit.trust.diagnosis.diagnose import Diagnosis, diagnose
from plantfit.trust.diagnosis.meter import Meter, Stopped
from plantfit.trust.diagnosis.phase import asked_for, misrecorded, with_diagnosis
from plantfit.trust.diagnosis.ranges import Seen, Tried
from plantfit.trust.diagnosis.rounds import Trial
from plantfit.trust.diagnosis.sentences import diagnosis_record, with_linear
from plantfit.trust.diagnosis.treatment import Change, asked_changes, change_of, changed, clean_steps

__all__ = [
    "Before",
    "Behind",
    "Change",
    "Diagnosis",
    "Inside",
    "Meter",
    "Seen",
    "Stopped",
    "Trial",
    "Tried",
    "asked_changes",
    "asked_for",
    "change_of",
    "changed",
    "clean_steps",
    "diagnose",
    "diagnosis_record",
    "misrecorded",
    "with_diagnosis",
    "with_linear",
]
