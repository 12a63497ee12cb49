"""`plantfit export`, `import` and `merge`."""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plantfit.cli.arguments.file_names import file_name
from plantfit.cli.commands.understand.stored import number_given
from plantfit.cli.terminal.out import out, print_json, warn
from plantfit.errors import StoreError
from plantfit.study.store.addresses import shown, store_option

if TYPE_CHECKING:
    from plantfit.study.store.merging import Merged
    from plantfit.study.store.records import WholeStudy
    from plantfit.study.store.store import Store


def export(given: str | None, json: bool, parquet: bool, place: str | None, store: str) -> None:
    """One study to JSON, Parquet or both."""
    from plantfit.study import Store

    opened, number = Store.open(store, create=False), number_given(given, store)
    records = [opened.study(number)] if number is not None else opened.studies()[-1:]
    if not records:
        raise StoreError(f"{shown(store)} holds no study yet; start one with `plantfit run STUDY.toml`.")
    study = records[0]
    kinds = [kind for kind, asked in (("json", json), ("parquet", parquet)) if asked]
    if place is not None and len(kinds) == 2:
        raise StoreError(
            f"--out {place} names one file, but --json and --parquet ask for two; leave one of the three out."
        )
    if not kinds:
        kinds = ["parquet" if place is not None and place.endswith(".parquet") else "json"]
    for kind in kinds:
        file = Path(place or file_name(study.name, kind))
        if place is None and file.exists() and not _is_export(file):
            raise StoreError(f"{file} exists already and is not an exported study; name another file with --out.")
        (opened.export_json if kind == "json" else opened.export_parquet)(study.id, file)
        out.print(
            f"Study {study.id} ({study.name}), {study.runs_done} of {study.runs_total} runs: {file}", markup=False
        )


def import_(files: list[str], spec: str | None, store: str, json: bool) -> None:
    """Exported files as new studies; one that is already here is said."""
    from plantfit.study import Store
    from plantfit.study.store.importing import read_study

    path = None if spec is None else str(Path(spec).resolve())
    if path is not None and not Path(path).is_file():
        raise StoreError(f"There is no study file {spec}; give the place where it lies on this machine.")
    read = [(file, read_study(Path(file))) for file in files]  # all are whole before the first is added
    opened, told = Store.open(store), []
    for file, whole in read:
        same = opened.find_same(whole)
        number = opened.add_whole(whole, spec_path=path)
        study = opened.study(number)
        told.append(
            {"file": file, "study": number, "runs_done": study.runs_done, "runs": study.runs_total, "same_as": same}
        )
        if same is not None:
            warn(
                f"Study {same} is the same study as {file}: `plantfit "
                f"merge {shlex.quote(file)}` would have united them."
            )
        if not json:
            more = "" if study.state == "done" else f"; go on with `plantfit resume {number}{store_option(store)}`"
            out.print(
                f"{file}: study {number} ({study.name}), {study.runs_done} of {study.runs_total} runs{more}",
                markup=False,
            )
    if json:
        print_json(told)


def merge(sources: list[str], store: str, json: bool) -> None:
    """The studies of other stores and exported files into this one."""
    from plantfit.study import Store

    opened, told = Store.open(store), []
    for source in sources:
        for whole in _studies(source, opened):
            found = opened.merge(whole, shown(source))
            told.append({"source": shown(source), "there": whole.study.id or None, **_record(found)})
            if not json:
                _tell(whole, shown(source), found)
    if json:
        print_json(told)
    elif not told:
        out.print("There is no study in what was given; nothing was changed.", markup=False)


def _studies(source: str, target: "Store") -> Iterator["WholeStudy"]:
    """The studies of a store, or the one of an exported file."""
    from plantfit.study import Store
    from plantfit.study.store.importing import read_study

    if "://" not in source and Path(source).is_file() and not _is_sqlite(Path(source)):
        yield read_study(Path(source))
        return
    other = Store.open(source, create=False)
    if other.address == target.address:
        raise StoreError(
            f"{shown(source)} is the store to merge into; name another one, or choose the target with --store."
        )
    for study in other.studies():
        yield other.whole(study.id)


def _is_export(path: Path) -> bool:
    with path.open("rb") as file:
        start = file.read(200)
    return start.startswith(b"PAR1") or b'"plantfit study ' in start


def _is_sqlite(path: Path) -> bool:
    with path.open("rb") as file:
        start = file.read(16)
    return not start or start.startswith(b"SQLite format 3")


def _tell(whole: "WholeStudy", source: str, found: "Merged") -> None:
    there = (
        f"{source}: study {whole.study.id} ({whole.study.name})" if whole.study.id else f"{source} ({whole.study.name})"
    )
    if found.new:
        return out.print(f"{there} is new here: study {found.study} with {found.added} runs", markup=False)
    out.print(
        f"{there} is study {found.study} here: {found.added} runs "
        f"added, {found.equal} the same, {found.different} kept",
        markup=False,
    )
    if found.different:
        warn(found.notes[-1])


def _record(found: "Merged") -> dict[str, Any]:
    return {
        "study": found.study,
        "new": found.new,
        "added": found.added,
        "equal": found.equal,
        "different": found.different,
        "notes": list(found.notes),
    }
