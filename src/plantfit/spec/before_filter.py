"""A regression of a study file before `filter_alike` takes its signals away, for columns that may be missing."""

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpecError
from plantfit.models.library.regression import LinearModel
from plantfit.spec.recordings import experiment_of
from plantfit.spec.study import Study, model_of
from plantfit.trust.diagnosis.plant.timeless.regression import Regression


def before_filter(study: Study) -> Regression | None:
    """Model and recordings as the study file has them; None where nothing is filtered alike.

    Raises SpecError for a study with a table [regression], whose instruments and band a diagnosis does not follow.
    """
    if study.regression is not None:
        raise SpecError(
            f"{study.path.name} has a table [regression], which is solved in "
            "closed form and cannot be diagnosed; use `plantfit run` alone."
        )
    if study.table.model.filter_alike is None:
        return None
    model = model_of(study.table, study.path)
    assert isinstance(model, LinearModel)
    recordings = {n: experiment_of(n, r, study.path, {}).recording for n, r in study.table.recording.items()}
    return Regression(model, recordings, study.table.model.filter_alike.model_dump())
