"""A recording before there is a model: frequency and step responses with bands, delays, and how well any linear
model does."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.first_look.baseline import Baseline, baseline
    from plantfit.first_look.beside_model import linear_beside
    from plantfit.first_look.data import Data, data_of
    from plantfit.first_look.delay import Delay, reaction_delay
    from plantfit.first_look.frequency import FrequencyResponse, frequency_response
    from plantfit.first_look.linear import LinearFit, fit_linear
    from plantfit.first_look.looked import look

__all__ = [
    "Baseline",
    "Data",
    "Delay",
    "FrequencyResponse",
    "LinearFit",
    "baseline",
    "data_of",
    "fit_linear",
    "frequency_response",
    "linear_beside",
    "look",
    "reaction_delay",
]

names_of(
    __name__,
    {
        "baseline": "Baseline baseline",
        "beside_model": "linear_beside",
        "data": "Data data_of",
        "delay": "Delay reaction_delay",
        "frequency": "FrequencyResponse frequency_response",
        "linear": "LinearFit fit_linear",
        "looked": "look",
    },
)
