"""What is missing in a model: additions tried on the fitted problem, judged by unseen data."""

from plantfit.trust.diagnosis.diagnose import Diagnosis, Trial, diagnose

__all__ = ["Diagnosis", "Trial", "diagnose"]
