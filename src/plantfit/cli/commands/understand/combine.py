"""`plantfit combine`: a study file whose parameters are the combinations that the data determine."""

import shlex
from pathlib import Path

from plantfit.cli.arguments.file_names import file_name
from plantfit.cli.commands.fit.studies import stored_answer
from plantfit.cli.terminal.out import out, print_json
from plantfit.errors import SpecError


def combine(given: str | None, place: str | None, force: bool, store: str, json: bool) -> None:
    """Write the file beside the study file (or at `place`)."""
    from plantfit import spec

    study, answer = stored_answer(given, store)
    target = Path(place) if place else study.path.with_name(f"{Path(file_name(study.name, 'toml')).stem}-combined.toml")
    if target.is_relative_to(Path.cwd()):
        target = target.relative_to(Path.cwd())
    if target.exists() and not force:
        raise SpecError(f"{str(target)!r} exists already; give another name with --out, or --force to overwrite it.")
    new = spec.in_combinations(study, answer.findings)
    try:
        target.write_text(new.text, encoding="utf-8")
    except OSError as error:
        raise SpecError(
            f"{str(target)!r} cannot be written ({error.strerror}); give another place with --out."
        ) from None
    if json:
        return print_json({"file": str(target), "made": dict(new.made), "held": dict(new.held), "left": dict(new.left)})
    for name, formula in new.made.items():
        out.print(f"  new: {name} = {formula}", markup=False)
    for name, value in new.held.items():
        out.print(f"  held: {name} = {value:g}", markup=False)
    for name, reason in new.left.items():
        out.print(f"  as before: {name}, because {reason}", markup=False)
    out.print(f"Written: {target}\nNext: plantfit run {shlex.quote(str(target))}", markup=False)
