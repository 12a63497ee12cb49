"""C twins of the timings P, T and D: built once, called with arrays and numbers."""

import ctypes
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.steam.compiler import build


def c_twin(name: str, function: str) -> Callable[..., None] | None:
    """A function of benchmarks/`name`.c that takes contiguous float64 arrays, ints (int64) and floats; None without
    a compiler."""
    built = build(Path(__file__).with_name(f"{name}.c"))
    if built is None:
        print(f"SKIPPED the C twin {name}.c: no C compiler (gcc) was found")
        return None
    library = ctypes.CDLL(str(built))

    def call(*arguments: np.ndarray | float) -> None:
        getattr(library, function)(*map(_passed, arguments))

    return call


def _passed(value: np.ndarray | float) -> ctypes.c_void_p | ctypes.c_int64 | ctypes.c_double:
    if isinstance(value, np.ndarray):
        assert value.dtype == float
        assert value.flags.c_contiguous
        return ctypes.c_void_p(value.ctypes.data)
    return ctypes.c_int64(value) if isinstance(value, int) else ctypes.c_double(value)
