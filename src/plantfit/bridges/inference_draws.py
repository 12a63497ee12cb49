"""Draws of the parameters that the data allow, for ArviZ."""

import numpy as np

from plantfit.answer import Answer
from plantfit.trust.intervals.kinds.inference_data import Drawn, need_h5netcdf, netcdf_of
from plantfit.trust.intervals.plausible import plausible

DRAWS = 1000
SEED = 1


def inference_draws(answer: Answer, name: str) -> dict[str, str | bytes]:
    """Files by name: NAME_draws.nc. Raises MissingExtra where h5netcdf is not installed."""
    need_h5netcdf()
    problem = answer.problem
    found = plausible(problem, answer.z, answer.findings["parameters"], DRAWS, SEED)
    values = found.values[1:]  # the first is the answer itself
    how = "Plants that the data allow: drawn " + (
        "by the likelihood, with flat priors between the bounds of the search."
        if found.by_likelihood
        else "from the covariance of the answer."
    )
    if found.scatters:
        how += f" Recordings scatter in {', '.join(found.scatters)}; the plants are those of another recording."
    cost = np.asarray(problem.costs(problem.space.cube(values)))
    return {
        f"{name}_draws.nc": netcdf_of(
            problem, Drawn(values[None], {"cost": cost[None]}, how), answer.score("fit"), SEED
        )
    }
