"""Conformance of readers: what every reader that a package brings must keep.

from plantfit.testing import check_reader
check_reader(my_package.read_log, "a_file_of_its_kind.log")
"""

import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

CUTS = 12


def check_reader(reader: Callable[[Path], Mapping[str, Any]], path: str | os.PathLike[str]) -> None:
    """Read a file twice, then its beginnings of several lengths.

    A reader takes a path and gives a mapping of names to arrays (n,) of real numbers; most of them have one length. It
    leaves the file as it was, gives the same twice, and of a file that was cut it gives arrays or raises an Exception.
    Raises AssertionError with what was expected and what came.
    """
    path = Path(path)
    before = path.read_bytes()
    one, two = reader(path), reader(path)
    _expect(path.read_bytes() == before, reader, "it changed the file")
    _arrays(reader, one)
    _expect(list(one) == list(two), reader, "it gives other names when it reads the file again")
    for name in one:
        same = np.array_equal(np.asarray(one[name], float), np.asarray(two[name], float), equal_nan=True)
        _expect(same, reader, f"{name!r} has other values when the file is read again")
    lengths = [len(np.asarray(v)) for v in one.values()]
    _expect(max(lengths.count(n) for n in lengths) > len(lengths) / 2, reader, f"the arrays have the lengths {lengths}")
    with tempfile.TemporaryDirectory() as folder:
        cut = Path(folder) / path.name
        for k in range(CUTS):
            cut.write_bytes(before[: len(before) * k // CUTS])
            try:
                part = reader(cut)
            except Exception:  # any: `plantfit.read` makes one sentence of it
                continue
            _arrays(reader, part, "of a file that was cut ")


def _arrays(reader: Any, found: Any, which: str = "") -> None:
    _expect(
        isinstance(found, Mapping),
        reader,
        f"{which}it gives a {type(found).__name__}, not a mapping of names to arrays",
    )
    for name, values in found.items():
        array = np.asarray(values)
        _expect(isinstance(name, str) and array.ndim == 1, reader, f"{which}{name!r} is not a name of an array (n,)")
        _expect(array.dtype.kind in "fiub", reader, f"{which}{name!r} holds {array.dtype}, not real numbers")


def _expect(condition: Any, reader: Any, sentence: str) -> None:
    if not condition:
        raise AssertionError(f"Reader {getattr(reader, '__name__', reader)!r}: {sentence}.")
