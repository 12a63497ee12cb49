"""`plantfit tune`: a controller from a finished study."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def tune(
    spec: str, set_points: Sequence[str], wishes: Mapping[str, Any], tolerance: Sequence[str], budget: int, seed: int,
    study: int | None, out: str | None, c: str | None, store: str, json: bool,
) -> None:  # fmt: skip
    """A PID, LQI or MPC from a finished study, tuned on every plant that the data allow: a table, a page, NAME-tune.json and a C file."""
    from plantfit.cli.commands.design.tuned_study import asked_of, tolerances_of

    loaded, wishes = asked_of(spec, set_points, {**wishes, "tolerances": tolerances_of(tolerance)})
    from plantfit.cli.arguments.file_names import file_name
    from plantfit.cli.commands.design.tuned_study import answer_for
    from plantfit.cli.terminal.out import progress_line
    from plantfit.report.html import check_place

    page = Path(out or file_name(f"{loaded.name}-tune", "html"))
    check_place(page)
    answer = answer_for(loaded, Path(spec), study, store)
    from plantfit.controllers import tune as tuned

    with progress_line(quiet=json) as tell:
        found = tuned(
            answer, budget=budget, seed=seed, progress=tell, control=loaded.control.model_dump(exclude_unset=True), **wishes
        )  # fmt: skip
    from plantfit.cli.commands.design.tuned_study import show, written
    from plantfit.cli.terminal.out import print_json

    files = written(found, page, Path(c) if c is not None else page.parent)
    if json:
        return print_json(found.typed.printed(files=[str(f) for f in files]))
    show(found.typed)
    from plantfit.cli.terminal.out import out as screen

    screen.print(f"Written: {', '.join(str(f) for f in files)}", markup=False)
