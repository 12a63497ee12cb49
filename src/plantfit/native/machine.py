"""From LLVM text to a function in memory: the host's processor, compilation, object code kept on disk.

llvmlite is imported on first use; `available()` is False where it cannot be.
"""

import ctypes
import ctypes.util
import hashlib
import os
import sys
import tempfile
import threading
from dataclasses import dataclass
from functools import cache
from typing import Any

from plantfit.native.unsupported import NativeUnsupported
from plantfit.runtime import cache_folder

_LOCK = threading.Lock()


@dataclass(frozen=True)
class Host:
    """The processor: LLVM's name and features, lanes of float64 in a vector, vectors worth running together, fused multiply-add."""

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
def _llvm() -> Any:
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
    llvm = _llvm()
    features = llvm.get_host_cpu_features()
    wide = bool(features.get("avx512f") and features.get("avx512dq") and features.get("avx512bw") and features.get("avx512vl"))
    width = 8 if wide else 4 if features.get("avx2") else 2
    # 4 vectors together need the 32 registers of AVX-512
    arm = llvm.get_process_triple().startswith(("aarch64", "arm64"))
    flags = features.flatten() + (",-prefer-256-bit" if wide else "")
    return Host(llvm.get_host_cpu_name(), flags, width, 4 if wide else 2, arm or bool(features.get("fma")))


@cache
def _target_machine() -> Any:
    llvm, here = _llvm(), host()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    return target.create_target_machine(cpu=here.cpu, features=here.features, opt=3, reloc="default", codemodel="jitdefault", jit=True)


def key_of(text: str) -> str:
    """Names the machine code of a text on this host."""
    import llvmlite

    here = host()
    parts = (text, here.cpu, here.features, llvmlite.__version__, sys.platform)
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


_ENGINES: dict[str, tuple[Any, int]] = {}  # compiled code stays in memory: XLA programs hold its addresses


def address_of(text: str, key: str, libm: tuple[str, ...]) -> int:
    """Address of `entry` in the compiled text; compiles at most once per process and key."""
    with _LOCK:
        if key not in _ENGINES:
            find_libm(libm)
            _ENGINES[key] = _load(_object_code(text, key))
        return _ENGINES[key][1]


def find_libm(names: tuple[str, ...]) -> None:
    """Make functions of the C library known to LLVM; raises NativeUnsupported for one that it lacks."""
    for name in names:
        _find_one(name)


@cache
def _find_one(name: str) -> None:
    places = ["ucrtbase", "msvcrt"] if sys.platform == "win32" else [ctypes.util.find_library("m") or "", None]
    for place in places:
        if place == "":
            continue
        try:
            function = getattr(ctypes.CDLL(place), name)
        except (OSError, AttributeError):
            continue
        _llvm().add_symbol(name, ctypes.cast(function, ctypes.c_void_p).value)
        return
    raise NativeUnsupported(f"{name}, which the C library lacks")


def _load(code: bytes) -> tuple[Any, int]:
    llvm = _llvm()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    empty = llvm.parse_assembly("")
    engine = llvm.create_mcjit_compiler(empty, target.create_target_machine(opt=3, codemodel="jitdefault", jit=True))
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine, engine.get_function_address("entry")


def _object_code(text: str, key: str) -> bytes:
    file = cache_folder() / "native" / f"{key}.o"
    try:
        return file.read_bytes()
    except OSError:
        code = compile_text(text)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, suffix=".part", delete=False) as part:
            part.write(code)
        os.replace(part.name, file)  # whole or not at all
    except OSError:
        pass  # a cache that cannot be written costs time only
    return code


def compile_text(text: str) -> bytes:
    """Object code of LLVM text, optimised for this host."""
    return _target_machine().emit_object(_optimised(text))


def assembly(text: str) -> str:
    """What `compile_text` makes, to be read."""
    return _target_machine().emit_assembly(_optimised(text))


def _optimised(text: str) -> Any:
    llvm, machine = _llvm(), _target_machine()
    module = llvm.parse_assembly(f'target triple = "{llvm.get_process_triple()}"\ntarget datalayout = "{machine.target_data}"\n{text}')
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = options.loop_unrolling = options.loop_interleaving = False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return module
