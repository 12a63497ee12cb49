"""The findings of an answer as frozen records, a file for each theme; `whole.py` puts them together, reads them and
gives their schema."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.findings.diagnosis import Diagnosis, Outliers, ResidualChange, Round, Tried
    from plantfit.findings.heterogeneity import (
        AllAtOnce,
        Apart,
        Estimated,
        EstimatedAlone,
        Heterogeneity,
        Moved,
        RecordingAlone,
        SharedParameter,
    )
    from plantfit.findings.parameters import (
        ByNoise,
        Combination,
        Determined,
        DeterminedCombination,
        FirstValues,
        KnownOther,
        Parameter,
        Scatter,
        StandardErrors,
    )
    from plantfit.findings.record import Number, Record, Values, array
    from plantfit.findings.recordings import Input, Output, Recording, Score, Weight
    from plantfit.findings.residuals import Cross, ResidualTest
    from plantfit.findings.runs import Agreement, Basin, DistinctAnswer, History, Run, SameModel
    from plantfit.findings.simulation import Reproduction, SimulatedOutput, Simulation
    from plantfit.findings.tables import OperatingTable, SmoothedTable
    from plantfit.findings.uncertainty import ReadingBudget, StatedError, StatedUncertainty, Uncertainty
    from plantfit.findings.verdict import Sentence
    from plantfit.findings.whole import Findings, findings_schema, read_findings

__all__ = [
    "Agreement",
    "AllAtOnce",
    "Apart",
    "Basin",
    "ByNoise",
    "Combination",
    "Cross",
    "Determined",
    "DeterminedCombination",
    "Diagnosis",
    "DistinctAnswer",
    "Estimated",
    "EstimatedAlone",
    "Findings",
    "FirstValues",
    "Heterogeneity",
    "History",
    "Input",
    "KnownOther",
    "Moved",
    "Number",
    "OperatingTable",
    "Outliers",
    "Output",
    "Parameter",
    "ReadingBudget",
    "Record",
    "Recording",
    "RecordingAlone",
    "Reproduction",
    "ResidualChange",
    "ResidualTest",
    "Round",
    "Run",
    "SameModel",
    "Scatter",
    "Score",
    "Sentence",
    "SharedParameter",
    "SimulatedOutput",
    "Simulation",
    "SmoothedTable",
    "StandardErrors",
    "StatedError",
    "StatedUncertainty",
    "Tried",
    "Uncertainty",
    "Values",
    "Weight",
    "array",
    "findings_schema",
    "read_findings",
]

names_of(
    __name__,
    {
        "diagnosis": "Diagnosis Outliers ResidualChange Round Tried",
        "heterogeneity": "AllAtOnce Apart Estimated EstimatedAlone Heterogeneity Moved RecordingAlone SharedParameter",
        "parameters": "ByNoise Combination Determined DeterminedCombination FirstValues KnownOther Parameter Scatter "
        "StandardErrors",
        "record": "Number Record Values array",
        "recordings": "Input Output Recording Score Weight",
        "residuals": "Cross ResidualTest",
        "runs": "Agreement Basin DistinctAnswer History Run SameModel",
        "simulation": "Reproduction SimulatedOutput Simulation",
        "tables": "OperatingTable SmoothedTable",
        "uncertainty": "ReadingBudget StatedError StatedUncertainty Uncertainty",
        "verdict": "Sentence",
        "whole": "Findings findings_schema read_findings",
    },
)
