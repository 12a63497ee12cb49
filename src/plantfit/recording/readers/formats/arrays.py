"""Named arrays: MATLAB and NumPy files, and arrays in memory."""

import os
import zipfile
from collections import Counter
from collections.abc import Mapping
from typing import Any, Unpack, cast, overload

import numpy as np
import polars as pl

from plantfit.errors import RecordingError
from plantfit.recording.readers.assemble import Options, assemble
from plantfit.recording.readers.columns import Column, Table, cells_of, named_columns
from plantfit.recording.readers.files import existing
from plantfit.recording.readers.tried import check
from plantfit.recording.record import Recording, Signal


@overload
def from_arrays(arrays: Mapping[str, Any], /, **options: Unpack[Options]) -> Recording: ...


@overload
def from_arrays(  # pyrefly: ignore[inconsistent-overload]  (t may also be named)
    t: Any = None,
    *,
    signals: Mapping[str, Any],
    period: float | None = None,
    name: str = "recording",
    sort: bool = False,
    duplicates: Any = None,
) -> Recording: ...


def from_arrays(arrays: Any = None, /, **options: Any) -> Recording:
    """A recording from arrays (n,) in memory: name -> array, or a pair (array, unit), or a `Signal`.

    `options` are those of `read_csv` (`assemble.Options`): `time` names the array of times, left out it is recognised
    by its name, or `period` gives the seconds between samples; `signals` maps own names to names of `arrays`, or lists
    some of them, left out all are signals; `units` by own name; `time_unit`, `dates`, `sort`, `duplicates`, `name`.

    As in earlier programs, `from_arrays(t, signals={"u": u, "w": (w, "rad/s")})` takes times (n,) in seconds, or None
    and a `period`, and the arrays themselves as `signals`. Raises RecordingError and UnitError.
    """
    if isinstance(arrays, Mapping):
        return _named_arrays(arrays, cast(Options, options))
    return _times_and_signals(**({"t": arrays} | options))


def _named_arrays(arrays: Mapping[str, Any], options: Options) -> Recording:
    name, wanted = options.get("name") or "recording", options.get("signals")
    if isinstance(wanted, Mapping):
        wrong = [key for key, column in wanted.items() if not isinstance(column, str | int | np.integer)]
        if wrong:
            raise RecordingError(
                f"Recording {name!r}: signals gives {wrong[0]!r} an array, but names an array "
                f"here; put it among the arrays, as in from_arrays({{'t': t, {wrong[0]!r}: ...}})."
            )
    found = {str(key): _with_unit(value) for key, value in arrays.items()}
    vectors = {key: _cells(values, key, name) for key, (values, _) in found.items()}
    lengths = {key: len(v) for key, v in vectors.items()}
    if len(set(lengths.values())) > 1:
        raise RecordingError(f"Recording {name!r}: lengths differ, {lengths}; cut them to one length.")
    columns = named_columns(
        vectors, [cells_of(key, v) for key, v in vectors.items()], [unit for _, unit in found.values()]
    )
    table = Table(name, columns, log=("From arrays in memory.",))
    chosen: Options = {**options, "name": name}
    return assemble(table, **chosen)


def _cells(values: Any, key: str, source: str) -> np.ndarray:
    """Numbers, or dates and durations, which may be times."""
    array = np.asarray(values)
    return array if array.dtype.kind in "mM" and array.ndim == 1 else _vector(values, f"array {key!r}", source)


def _with_unit(value: Any) -> tuple[Any, str | None]:
    return (value.values, value.unit) if isinstance(value, Signal) else value if _has_unit(value) else (value, None)


def _times_and_signals(
    t: Any = None,
    *,
    signals: Mapping[str, Any] | None = None,
    period: float | None = None,
    name: str = "recording",
    sort: bool = False,
    duplicates: Any = None,
    **others: Any,
) -> Recording:
    new = "from_arrays({'t': t, 'u': u}, signals={'u': 'u'})"
    if others:
        raise RecordingError(f"Recording {name!r}: {next(iter(others))!r} is for named arrays; write {new}.")
    if not isinstance(signals, Mapping) or any(isinstance(v, str) for v in signals.values()):
        raise RecordingError(
            f"Recording {name!r}: beside times, signals are arrays by name; to choose among named arrays, write {new}."
        )
    arrays: dict[str, tuple[np.ndarray, str | None]] = {}
    for key, value in signals.items():
        values, unit = _with_unit(value)
        arrays[key] = (_vector(values, f"signal {key!r}", name), unit)
    if (t is None) == (period is None):
        raise RecordingError(f"Recording {name!r}: give either the times t or a period.")
    columns = [Column(key, key, None, pl.Series(key, values)) for key, (values, _) in arrays.items()]
    if t is not None:
        times = _vector(t, "t", name)
        columns.insert(0, Column("t", "t", "s", pl.Series("t", times)))
    if len({len(column.cells) for column in columns}) > 1:
        raise RecordingError(
            f"Recording {name!r}: lengths differ, "
            f"{ ({c.header: len(c.cells) for c in columns}) }; cut them to one length."
        )
    shift = 0 if t is None else 1
    chosen = {key: position + shift for position, key in enumerate(arrays)}
    units = {key: unit for key, (_, unit) in arrays.items() if unit is not None}
    time = None if t is None else 0
    table = Table(name, tuple(columns), log=("From arrays in memory.",))
    return assemble(
        table, time=time, period=period, signals=chosen, units=units, name=name, sort=sort, duplicates=duplicates
    )


def read_mat(path: str | os.PathLike[str], **options: Unpack[Options]) -> Recording:
    """A recording from a MATLAB file up to version 7; fields of structures by dotted name ("run.speed").

    `options` as for `read_csv`. Raises RecordingError and UnitError.
    """
    return assemble(mat_table(path, options.get("time")), **options)


def read_npz(path: str | os.PathLike[str], **options: Unpack[Options]) -> Recording:
    """A recording from a NumPy archive of named arrays; `options` as for `read_csv`. Raises RecordingError and
    UnitError."""
    return assemble(npz_table(path, options.get("time")), **options)


def mat_table(path: str | os.PathLike[str], time: str | int | None = None) -> Table:
    """The vectors of a MATLAB file, not yet interpreted."""
    from scipy.io import loadmat

    file = existing(path)
    if b"MATLAB 7.3" in file.open("rb").read(128):
        raise RecordingError(f"{file.name} is a MATLAB 7.3 file; save it in MATLAB with save(..., '-v7').")
    check("mat", file)
    try:
        content = loadmat(file, simplify_cells=True)
    except Exception as error:  # damaged files fail in many ways inside scipy
        raise RecordingError(
            f"{file.name} cannot be read as a MATLAB file ({error}); save it anew with '-v7'."
        ) from None
    return array_table(file.name, dict(_flat(content)), time)


def npz_table(path: str | os.PathLike[str], time: str | int | None = None) -> Table:
    """The vectors of a NumPy archive, not yet interpreted."""
    file = existing(path)
    try:
        with np.load(file, allow_pickle=False) as archive:
            content = {key: archive[key] for key in archive.files}
    except (OSError, ValueError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        why = "" if "pickle" in str(error) else f" ({error})"  # numpy advises to load it unsafely
        raise RecordingError(
            f"{file.name} cannot be read as an archive of plain arrays{why}; write it with numpy.savez."
        ) from None
    return array_table(file.name, dict(_flat(content)), time)


def _has_unit(value: Any) -> bool:
    return isinstance(value, tuple) and len(value) == 2 and (value[1] is None or isinstance(value[1], str))


def _vector(values: Any, what: str, source: str) -> np.ndarray:
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise RecordingError(f"Recording {source!r}: {what} is not an array of numbers; convert it first.") from None
    if array.ndim != 1:
        raise RecordingError(
            f"Recording {source!r}: {what} has shape {array.shape}; give one value per sample, shape (n,)."
        )
    return array


def _flat(content: Mapping[str, Any], prefix: str = "") -> Any:
    """(dotted name, array) for every array in nested structures; columns of matrices are numbered."""
    for key, value in content.items():
        name = f"{prefix}{key}"
        if str(key).startswith("__"):
            continue
        if isinstance(value, Mapping):
            yield from _flat(value, f"{name}.")
        elif isinstance(value, np.ndarray) and value.dtype == object and _is_sheet(value):
            yield from (
                (str(head).strip(), np.asarray(column, dtype=float))
                for head, column in zip(value[0], value[1:].T, strict=True)
            )
        elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
            items = list(np.ravel(np.asarray(value, dtype=object)))
            yield from _flat({str(i): item for i, item in enumerate(items)}, f"{name}.")
        else:
            array = np.asarray(value)
            if array.ndim == 2 and 1 not in array.shape and array.dtype.kind in "fiub":
                yield from ((f"{name}.{j}", column) for j, column in enumerate(array.T))
            else:
                yield name, array


def _is_sheet(cells: np.ndarray) -> bool:
    """Whether an array of objects is a table: a row of names above rows of numbers."""
    if cells.ndim != 2 or len(cells) < 3:
        return False
    names = all(isinstance(cell, str) for cell in cells[0])
    return names and all(np.ndim(cell) == 0 and isinstance(cell, (int, float, np.number)) for cell in cells[1:].ravel())


def _stated_period(arrays: Mapping[str, np.ndarray]) -> tuple[str, float] | None:
    """A number beside the samples that is their period by its name (Ts, dt, ... in s), or their rate (fs in Hz):
    (name, s)."""
    for key, array in arrays.items():
        name, value = (
            key.rpartition(".")[2].lower(),
            float(np.ravel(array)[0]) if array.size == 1 and array.dtype.kind in "fiu" else 0.0,
        )
        if value > 0 and np.isfinite(value):
            if name in ("ts", "dt", "tsample", "sampletime", "sample_time", "period", "t_s", "tsamp"):
                return key, value
            if name in ("fs", "fsample", "samplerate", "sample_rate"):
                return key, 1.0 / value
    return None


def array_table(source: str, arrays: Mapping[str, np.ndarray], time: str | int | None) -> Table:
    vectors = {key: np.ravel(array) for key, array in arrays.items() if array.dtype.kind in "fiubM" and array.ndim <= 2}
    left_out = {key: "it is not a vector of real numbers" for key in arrays if key not in vectors}
    long = Counter(len(vector) for vector in vectors.values() if len(vector) > 1)
    if not long:
        raise RecordingError(f"{source} holds no arrays of samples; it has {list(arrays)}.")
    samples = len(vectors[time]) if isinstance(time, str) and time in vectors else max(long, key=lambda n: (long[n], n))
    left_out |= {
        key: f"it has {len(v)} values where the others have {samples}"
        for key, v in vectors.items()
        if len(v) != samples
    }
    kept = {key: vector for key, vector in vectors.items() if len(vector) == samples}
    cells = [cells_of(key, np.ascontiguousarray(v.astype(v.dtype.newbyteorder("=")))) for key, v in kept.items()]
    stated = _stated_period({key: array for key, array in arrays.items() if key not in kept})
    return Table(source, named_columns(kept, cells), log=(f"Read from {source}.",), left_out=left_out, period=stated)
