"""The processor that native loops are compiled for, and whether they can be.

llvmlite is imported on first use; `available()` is False where it cannot be.
"""

import ctypes
import os
import sys
from dataclasses import dataclass
from functools import cache
from typing import Any


@dataclass(frozen=True)
class Host:
    """LLVM's name and features of the processor, float64 lanes in a vector, most vectors in a block, fused
    multiply-add."""

    cpu: str
    features: str
    width: int
    vectors: int
    fused: bool


@cache
def available() -> bool:
    """Whether native loops can be compiled here: llvmlite is installed and knows this processor."""
    if os.environ.get("PLANTFIT_NATIVE") == "0":
        return False
    try:
        import llvmlite.binding as llvm

        if tuple(llvm.llvm_version_info) < (20, 0, 0) or sys.maxsize < 2**32:
            return False
        return host().width > 0
    except (ImportError, OSError, RuntimeError):
        return False


@cache
def llvm_binding() -> Any:
    """llvmlite.binding, made ready for this processor."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    if sys.platform == "win32":
        _FLTUSED.value = 1
        llvm.add_symbol("_fltused", ctypes.addressof(_FLTUSED))
    return llvm


_FLTUSED = ctypes.c_int(0)  # a symbol that Windows objects with floating point refer to


@cache
def host() -> Host:
    """The processor this process runs on."""
    llvm = llvm_binding()
    features = llvm.get_host_cpu_features()
    wide = bool(
        features.get("avx512f") and features.get("avx512dq") and features.get("avx512bw") and features.get("avx512vl")
    )
    width = 8 if wide else 4 if features.get("avx2") else 2
    # blocks of 4 vectors need the 32 registers of AVX-512
    arm = llvm.get_process_triple().startswith(("aarch64", "arm64"))
    flags = features.flatten() + (",-prefer-256-bit" if wide else "")
    return Host(llvm.get_host_cpu_name(), flags, width, 4 if wide else 2, arm or bool(features.get("fma")))
