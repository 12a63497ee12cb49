"""How large a study may be: told before work begins, since what is larger would end for lack of memory or not at
all."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plantfit.errors import SpecError
from plantfit.spec.tables import SpecTable

if TYPE_CHECKING:
    from plantfit.problem import Problem

MOST_STATES = 128  # compiled loops of 300 states did not end
MOST_NODES = 10_000  # of a table; a quasi-random sample in 21 201 dimensions is the largest that scipy draws
MOST_COORDINATES = 10_000
MOST_STEPS = 10**9  # of a simulation of all recordings, some seconds to minutes for each candidate
LARGEST_ORDER = 20  # of a filter: poles beyond it are lost in rounding
COUNTS = {"order": LARGEST_ORDER}  # arguments of cleaning steps by name; a window holds at most all samples


def check_tables(table: SpecTable, path: Path) -> None:
    """What the study file says by itself."""
    m = table.model
    if len(m.states) > MOST_STATES:
        raise SpecError(
            f"{path.name}: [model] has {len(m.states)} states; at most {MOST_STATES} can be simulated, so use fewer."
        )
    for name, t in m.tables.items():
        axes = (
            t.nodes
            if isinstance(t.nodes, list) and t.nodes and all(isinstance(a, list) for a in t.nodes)
            else [t.nodes]
        )
        count = 1
        for axis in axes:
            count *= len(axis) if isinstance(axis, list) else 1
        if count > MOST_NODES:
            raise SpecError(
                f"{path.name}: model.tables.{name} has {count} nodes; "
                f"a table can have at most {MOST_NODES}, so use fewer."
            )


def check_step(arguments: Mapping[str, Any], samples: int, place: str) -> None:
    """The whole numbers of a cleaning step."""
    for key, most in (COUNTS | {"window": samples}).items():
        value = arguments.get(key)
        if isinstance(value, int) and value > most:
            of = "samples of the recording" if key == "window" else "largest order of a filter"
            raise SpecError(
                f"{place}: {key} = {value!s:.40} is too large; the limit is {most} ({of}), so give a smaller number."
            )


def check_problem(problem: "Problem", table: SpecTable) -> None:
    """The problem made of it: sizes, starts inside bounds, and dead times that are none in the future. Errors leave
    out the file."""
    from plantfit.models.parts.clock_shift import shift_name  # loads jax, and `check_tables` comes before it

    if problem.space.dimension > MOST_COORDINATES:
        raise SpecError(
            f"{problem.space.dimension} values are free; at most {MOST_COORDINATES} can be searched, "
            "so hold some of them, or use fewer nodes and recordings."
        )
    samples = sum(len(e.recording) for e in problem.experiments.values())
    substeps = 1 if table.simulation.stepper == "adaptive" else table.simulation.substeps or 1
    if samples * substeps > MOST_STEPS:
        raise SpecError(
            f"simulation.substeps = {substeps} at {samples} samples are {samples * substeps} steps for each candidate; "
            f"at most {MOST_STEPS} are made, so leave substeps out and plantfit chooses them."
        )
    if problem.by_filters:
        from plantfit.estimate.methods.levels import asked
        from plantfit.estimate.methods.proposals import check_filterable

        check_filterable(problem)
        asked(table.estimate, problem)
    _ = problem.space.start  # raises SpaceError where one lies outside its bounds
    shifts = {shift_name(s) for s in table.model.clock_shift}  # of a clock, which may go either way
    late = {
        d.parameter for d in getattr(problem.model, "delays", ()) if isinstance(getattr(d, "parameter", None), str)
    } - shifts
    for c in problem.space.coordinates:
        if c.parameter in late and c.lower < 0:
            raise SpecError(
                f"parameters.{c.parameter} is a dead time, and its lower bound is "
                f"{f'{c.lower:g} {c.unit or str()}'.rstrip()}; an input cannot act before it happens, "
                "so begin the bounds at 0. If the clocks of two signals differ, use model.clock_shift."
            )
