"""The study file: TOML to recordings, model, space, problem and plan."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.spec.before_filter import before_filter
    from plantfit.spec.reading import load, parse
    from plantfit.spec.recordings import CLEANING, named_file, read_recording
    from plantfit.spec.rewritten.in_combinations import Rewritten, in_combinations
    from plantfit.spec.rewritten.in_pieces import in_pieces
    from plantfit.spec.rewritten.with_additions import with_additions
    from plantfit.spec.study import Study, model_of
    from plantfit.spec.tables import SpecTable, validated

__all__ = [
    "CLEANING",
    "Rewritten",
    "SpecTable",
    "Study",
    "before_filter",
    "in_combinations",
    "in_pieces",
    "load",
    "model_of",
    "named_file",
    "parse",
    "read_recording",
    "validated",
    "with_additions",
]

names_of(
    __name__,
    {
        "before_filter": "before_filter",
        "reading": "load parse",
        "recordings": "CLEANING read_recording named_file",
        "rewritten.in_combinations": "Rewritten in_combinations",
        "rewritten.in_pieces": "in_pieces",
        "rewritten.with_additions": "with_additions",
        "study": "Study model_of",
        "tables": "SpecTable validated",
    },
)
