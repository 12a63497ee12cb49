"""`plantfit look`: a recording without equations."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plantfit.cli.arguments.dates import asked_as_option, check_used, order
from plantfit.cli.arguments.file_names import file_name
from plantfit.cli.terminal.out import out, print_json, verdict
from plantfit.errors import RecordingError, SpecError


def look(
    path: str, inputs: Sequence[str], outputs: Sequence[str], name: str | None, place: str | None, json: bool,
    dates: str | None = None,
) -> None:  # fmt: skip
    """Look at a study file's recording with its inputs and outputs, or at a file of measurements; `dates` is the order
    of day and month in the time stamps of such a file."""
    from plantfit.report.html import check_place

    if dates is not None and path.endswith(".toml"):
        raise SpecError(f"--dates is for a file of measurements; {path} says it with dates under [recording.NAME].")
    recording, own_in, own_out, masks, told = (
        (*_of_study(path, name), "") if path.endswith(".toml") else _of_file(path, inputs, outputs, dates)
    )
    if path.endswith(".toml"):
        own_in, own_out = list(inputs) or own_in, list(outputs) or own_out
    for signal in (*own_in, *own_out):
        if signal not in recording.signals:
            raise RecordingError(f"{path} has no signal {signal!r}; it has {list(recording.signals)}.")
    to = Path(place or file_name(f"{Path(path).name.split('.')[0]}-look", "html"))
    check_place(to)
    from plantfit.first_look import look as looked
    from plantfit.report.case_page import write_case_page
    from plantfit.report.pages.looked import look_page

    fitted = {o: masks[0] for o in own_out} if masks else None
    unseen = {o: masks[1] for o in own_out} if masks else None
    found = looked(recording, own_in, own_out, fitted, unseen)
    write_case_page(look_page(found), to)
    if json:
        return print_json(found.printed(written=str(to)))
    words = f"input{'s' * (len(own_in) > 1)} {', '.join(own_in)}, output{'s' * (len(own_out) > 1)} {', '.join(own_out)}"
    out.print(f"{recording.name}: {words}", markup=False)
    if told:
        out.print(told, markup=False)
    verdict(found.plain())
    out.print(f"\nPage: {to}", markup=False)


def _of_study(path: str, name: str | None) -> tuple[Any, list[str], list[str], Any]:
    from plantfit import spec

    problem = spec.load(path).problem
    names = list(problem.experiments)
    if name is not None and name not in names:
        raise SpecError(f"{path} has no recording {name!r}; it has {names}.")
    experiment = problem.experiments[name or names[0]]
    if experiment.steady:
        raise RecordingError(
            f"Recording {experiment.recording.name!r} is steady, where time means nothing; look at one that moves."
        )
    inputs = [n for n in getattr(problem.model, "inputs", {}) if n not in problem.outputs]
    if not inputs:
        raise SpecError(
            f"{path}: the model has no inputs, and a first look is at "
            "what outputs answer to inputs; name some with --input."
        )
    fit = experiment.mask("fit")
    masks = (fit, experiment.mask("validation") & ~fit) if fit.any() else None
    return experiment.recording, inputs, list(problem.outputs), masks


def _of_file(
    path: str, inputs: Sequence[str], outputs: Sequence[str], dates: str | None
) -> tuple[Any, list[str], list[str], None, str]:
    """The recording of a file, its inputs and outputs, and what was made of its columns."""
    import numpy as np

    from plantfit import recording as rec

    if dates is not None:
        check_used(dates, rec.describe(path, order(dates)))
    with asked_as_option():
        read = rec.read(path, dates=order(dates))
    moving = list(read.signals)
    if len(moving) < 2:
        raise RecordingError(f"{path} has the signals {moving}; a first look needs an input and an output.")
    from plantfit.recording.roles import guess_roles

    roles = {r.name: r for r in guess_roles(path).columns if r.name in read.signals}
    own_in = list(inputs) or [n for n, r in roles.items() if r.kind == "input" and n not in outputs]
    own_out = list(outputs) or [n for n, r in roles.items() if r.kind == "output" and n not in own_in]
    left = [s for s in moving if s not in (*own_in, *own_out)]
    own_in, own_out, told = own_in or left[:1], own_out or left[-1:], ""
    if doubted := [r for n, r in roles.items() if not r.sure and n in (*own_in, *own_out)]:
        listed = ", ".join(f"{r.header!r} ({r.kind})" for r in doubted if r.name not in (*inputs, *outputs))
        told = f"Not sure of {listed}: name inputs with --input and outputs with --output." if listed else ""
    names = {r.header: r.name for r in roles.values()}
    for of in [*own_in]:
        way = names.get(roles[of].direction) if of in roles else None
        if way is None:
            continue
        if way not in own_in or not np.isfinite(read[way]).all():
            told = f"{of!r} has no sign and {way!r} gives it one, which is not in what follows: name both with --input."
            continue
        # their effects do not add up: the direction turns the effect of the other one round
        made = f"{of}_signed"
        while made in read.signals:
            made += "_"
        read = rec.signed(read, of, way, made)
        own_in = [made if n == of else n for n in own_in if n != way]
        told = f"{of!r} has no sign and {way!r} gives it one: they are one input, {made}, as `plantfit init` writes it."
    return read, own_in, own_out, None, told
