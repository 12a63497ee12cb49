"""From LLVM text to a function in memory; object code is cached on disk."""

import ctypes
import ctypes.util
import hashlib
import os
import stat
import sys
import tempfile
import threading
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from plantfit.folders import code_folder
from plantfit.native.compile.processor import host, llvm_binding
from plantfit.native.unsupported import NativeUnsupported

_LOCK = threading.Lock()


@cache
def _target_machine() -> Any:
    llvm, here = llvm_binding(), host()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    return target.create_target_machine(
        cpu=here.cpu, features=here.features, opt=3, reloc="default", codemodel="jitdefault", jit=True
    )


def key_of(text: str) -> str:
    """The cache key of a text: a hash of it, the processor and the version of llvmlite."""
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


def kept_address(key: str, libm: tuple[str, ...]) -> int | None:
    """The same address where the object code is kept on disk, without its text; None where it is not."""
    with _LOCK:
        if key not in _ENGINES:
            folder = code_folder("native")
            code = None if folder is None else read_object(folder / f"{key}.o", key)
            if code is None:
                return None
            find_libm(libm)
            _ENGINES[key] = _load(code)
        return _ENGINES[key][1]


def engine_of(key: str) -> Any:
    """LLVM's engine of a text that `address_of` compiled."""
    return _ENGINES[key][0]


def find_libm(names: tuple[str, ...]) -> None:
    """Make functions of the C library known to LLVM; raises NativeUnsupported for one that it lacks."""
    for name in names:
        _find_one(name)


@cache
def _find_one(name: str) -> None:
    """Look a function up and add it to LLVM's symbols."""
    places = ["ucrtbase", "msvcrt"] if sys.platform == "win32" else [ctypes.util.find_library("m") or "", None]
    for place in places:
        if place == "":
            continue
        try:
            function = getattr(ctypes.CDLL(place), name)
        except (OSError, AttributeError):
            continue
        llvm_binding().add_symbol(name, ctypes.cast(function, ctypes.c_void_p).value)
        return
    raise NativeUnsupported(f"{name}, which the C library lacks")


def _load(code: bytes) -> tuple[Any, int]:
    """Link object code into the process: (engine, address of `entry`)."""
    llvm = llvm_binding()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    empty = llvm.parse_assembly("")
    engine = llvm.create_mcjit_compiler(empty, target.create_target_machine(opt=3, codemodel="jitdefault", jit=True))
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine, engine.get_function_address("entry")


def _object_code(text: str, key: str) -> bytes:
    """Object code from the cache on disk, else compiled and put there."""
    folder = code_folder("native")
    if folder is None:
        return compile_text(text)
    file = folder / f"{key}.o"
    return read_object(file, key) or write_object(file, key, compile_text(text))


def read_object(file: Path, key: str) -> bytes | None:
    """The object code that `write_object` put into a file; None where there is none, or not that: it is linked
    unseen."""
    try:
        with file.open("rb") as opened:
            if not stat.S_ISREG(os.fstat(opened.fileno()).st_mode):
                return None
            content = opened.read()
    except OSError:
        return None
    head = _header(key, content[HEADER:])
    return content[HEADER:] if content[:HEADER] == head else None


def write_object(file: Path, key: str, code: bytes) -> bytes:
    """Put object code into a file, whole or not at all, also when the power fails; returns it."""
    part = None
    try:
        with tempfile.NamedTemporaryFile(dir=file.parent, suffix=".part", delete=False) as part:
            part.write(_header(key, code) + code)
            part.flush()
            os.fsync(part.fileno())
        os.replace(part.name, file)
    except OSError:  # a cache that cannot be written costs time only
        if part is not None:
            with suppress(OSError):
                os.unlink(part.name)
    return code


MAGIC = b"plantfit object 1\n"
HEADER = len(MAGIC) + 2 * 32


def _header(key: str, code: bytes) -> bytes:
    """What stands before the code: a name of the format, and hashes of the key and of the code with its length."""
    length = len(code).to_bytes(8, "little")
    return MAGIC + hashlib.sha256(key.encode()).digest() + hashlib.sha256(length + code).digest()


def compile_text(text: str) -> bytes:
    """Object code of LLVM text, optimised for the host."""
    return _target_machine().emit_object(_optimised(text))


def _optimised(text: str) -> Any:
    """The module after LLVM's -O3 pipeline without its vectorisers and unrolling: the text is vectorised already."""
    llvm, machine = llvm_binding(), _target_machine()
    module = llvm.parse_assembly(
        f'target triple = "{llvm.get_process_triple()}"\ntarget datalayout = "{machine.target_data}"\n{text}'
    )
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = options.loop_unrolling = options.loop_interleaving = False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return module
