"""`plantfit tune`: a controller from a finished study."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def tune(
    spec: str, set_points: Sequence[str], wishes: Mapping[str, Any], tolerance: Sequence[str], budget: int, seed: int,
    study: int | None, out: str | None, c: str | None, store: str, json: bool,
) -> None:  # fmt: skip
    """A controller (PID to MPC) from a finished study, tuned on every plant that the data allow: table, page,
    NAME-tune.json, C file."""
    from plantfit.cli.commands.next_step.tuned_study import (
        asked_of,
        front_in,
        held_in,
        levels_in,
        named_in,
        tolerances_of,
        weights_in,
    )

    more: dict[str, Any] = {
        "tolerances": tolerances_of(tolerance),
        "minimise": weights_in(wishes["minimise"]),
        "front": front_in(wishes["front"]),
    }
    more["levels"] = levels_in(wishes["levels"])
    more |= {
        "hold": held_in(wishes["hold"]),
        "full_scale": named_in("--full-scale", wishes["full_scale"], "T=100 degC"),
    }
    loaded, wishes = asked_of(spec, set_points, {**wishes, **more})
    if (
        wishes["hold"]
        or (loaded.control.hold and wishes["controller"] in (None, "lqr"))
        or wishes["controller"] == "lqr"
    ):
        return hold(spec, loaded, wishes, seed, study, out, c, store, json)
    from plantfit.cli.arguments.file_names import file_name
    from plantfit.cli.commands.next_step.tuned_study import answer_for, check_signals, named_file, refuse_regression
    from plantfit.cli.terminal.out import progress_line
    from plantfit.control.tune.searching.parts import begins
    from plantfit.report.html import check_place

    page = Path(out or file_name(f"{loaded.name}-tune", "html"))
    check_place(page)
    refuse_regression(loaded, spec)
    with named_file(spec, loaded, wishes):
        check_signals(loaded, wishes)
    with progress_line(quiet=json) as tell:
        begins(tell, "preparing the study")
        answer = answer_for(loaded, Path(spec), study, store)
        from plantfit.controllers import tune as tuned

        with named_file(spec, loaded, wishes):
            found = tuned(
                answer, budget=budget, seed=seed, progress=tell, control=loaded.control.model_dump(exclude_unset=True),
                **wishes
            )  # fmt: skip
        from plantfit.cli.commands.next_step.tuned_study import show, written
        from plantfit.cli.terminal.out import print_json

        begins(tell, "writing the page and the C files")
        files = written(found, page, Path(c) if c is not None else page.parent)
    if json:
        return print_json(found.typed.printed(files=[str(f) for f in files]))
    show(found.typed)
    from plantfit.cli.terminal.out import out as screen

    screen.print(f"Written: {', '.join(str(f) for f in files)}", markup=False)


def hold(
    spec: str,
    loaded: Any,
    wishes: Mapping[str, Any],
    seed: int,
    study: int | None,
    out: str | None,
    c: str | None,
    store: str,
    json: bool,
) -> None:
    """`tune --hold`: a regulator that holds an equilibrium."""
    from plantfit.cli.arguments.file_names import file_name
    from plantfit.cli.commands.next_step.tuned_study import answer_for, named_file, show_held, written_held
    from plantfit.cli.terminal.out import out as screen
    from plantfit.cli.terminal.out import print_json, said_line
    from plantfit.report.html import check_place

    page = Path(out or file_name(f"{loaded.name}-tune", "html"))
    check_place(page)
    source = Path(spec) if loaded.regression is not None else answer_for(loaded, Path(spec), study, store)
    from plantfit.holding import hold as held

    asked = loaded.control.model_dump(exclude_unset=True)
    with said_line(quiet=json) as say, named_file(spec, loaded, wishes):
        found = held(source, seed=seed, progress=say, control=asked, **{k: v for k, v in wishes.items() if v})
    files = written_held(found, page, Path(c) if c is not None else page.parent)
    if json:
        return print_json(found.typed.printed(files=[str(f) for f in files]))
    show_held(found.typed)
    screen.print(f"Written: {', '.join(str(f) for f in files)}", markup=False)
