"""Exported C, compiled for this machine and called sample by sample."""

import ctypes
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plantfit.simulate.loop.closed_loop import Controller

import jax
import jax.numpy as jnp

FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-Wconversion", "-O2"]
REAL = {"double": np.float64, "float": np.float32}
TYPES = {"double": ctypes.c_double, "float": ctypes.c_float, "q15": ctypes.c_int16, "q31": ctypes.c_int32}


def compiled(files) -> ctypes.CDLL:
    """The source as a library, without warnings and needing no other; skips the test where there is no compiler."""
    if shutil.which("gcc") is None or shutil.which("nm") is None:
        pytest.skip("gcc or nm is not on this machine: the exported C is not compiled")
    library = Path(files.source).with_suffix(".so")
    subprocess.run(
        ["gcc", *FLAGS, "-shared", "-fPIC", "-nostdlib", "-o", library, files.source], check=True, timeout=600
    )
    needed = subprocess.run(["nm", "-D", "-u", library], check=True, capture_output=True, text=True, timeout=100).stdout
    assert not [line for line in needed.split("\n") if " U " in line], needed
    return ctypes.CDLL(str(library))


class PidProgram:
    """A PID as exported: `begin(measurement, command)`, `update(measurement, reference)`; whole numbers in fixed
    point."""

    def __init__(self, files, number: str):
        self.name, self.kind, self.state = Path(files.source).stem, TYPES[number], ctypes.create_string_buffer(4096)
        library = compiled(files)
        self._init, self._update = getattr(library, f"{self.name}_init"), getattr(library, f"{self.name}_update")
        self._init.argtypes, self._init.restype = (ctypes.c_void_p, self.kind, self.kind), None
        self._update.argtypes, self._update.restype = (ctypes.c_void_p, self.kind, self.kind), self.kind

    def begin(self, measurement, command: float = 0) -> None:
        self._init(self.state, measurement, command)

    def update(self, measurement, reference):
        return self._update(self.state, measurement, reference)


class ArrayProgram:
    """Functions NAME_verb(state, array or None, ...) on arrays of `number`."""

    def __init__(self, files, number: str):
        self.name, self.kind, self.state = (
            Path(files.source).stem,
            np.dtype(REAL[number]),
            ctypes.create_string_buffer(1024),
        )
        self.library, self.real = compiled(files), TYPES[number]

    def call(self, verb: str, *arrays: Any) -> None:
        """Arrays of another kind are converted, so that only those of this kind are written to."""
        held = [None if a is None else np.ascontiguousarray(a, self.kind) for a in arrays]
        pointers = [None if a is None else a.ctypes.data_as(ctypes.POINTER(self.real)) for a in held]
        getattr(self.library, f"{self.name}_{verb}")(self.state, *pointers)

    def states(self, n: int) -> np.ndarray:
        """What the struct begins with."""
        return np.frombuffer(self.state.raw, self.kind, n)


def macro(files, name: str) -> float:
    """A number that the header defines."""
    line = next(line for line in Path(files.header).read_text().splitlines() if line.startswith(f"#define {name} "))
    return float(line.split()[2].strip("()f"))


def in_loop(begin, update, size):
    """A program as a `Controller`: its struct travels as bytes, so that it stays a pure function for the loop."""
    struct = jax.ShapeDtypeStruct((size,), jnp.uint8)

    def init(measurement, parameters):
        return jax.pure_callback(begin, struct, measurement)

    def stepped(state, measurement, reference, parameters):
        return jax.pure_callback(update, (struct, jax.ShapeDtypeStruct((), jnp.float64)), state, measurement, reference)

    return Controller(init, stepped)
