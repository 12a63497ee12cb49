"""`regress(study)`: a study file with a table [regression], solved by instrumental variables beside plain least
squares."""

from pathlib import Path

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError
from plantfit.estimate.regressed import Regressed as Regressed
from plantfit.estimate.regressed import regress as solved
from plantfit.spec.reading import load
from plantfit.spec.study import Study


def regress(study: Study | str | Path) -> Regressed:
    """The coefficients of a study file, or its path, whose table [regression] says how its columns are made.

    The answer has `estimate` (instrumental variables), `least_squares` on the same rows and `bias`, the test of Durbin,
    Wu and Hausman. Raises SpecError for what the file gets wrong, SearchError for a study without [regression] and for
    instruments that do not tell the coefficients apart.
    """
    study = study if isinstance(study, Study) else load(study)
    if study.regression is None:
        raise SearchError(
            f"{study.path.name} has no table [regression]; fit it "
            f"by `plantfit run {study.path.name}`, or add the table."
        )
    return solved(study.problem, study.regression.instruments)
