"""Programs of jax that outlive the process: a function that was compiled once for these shapes is neither traced nor
lowered again.

Tracing a simulated problem takes longer than jax's own start. What is kept is XLA's executable, so that its numbers are
the same bits as those of the process that made it. A program is found again by a description of all that is compiled
into it, made by `described`; where there is none (functions of other packages, which may change without a sign) jax
compiles as ever.
"""

import functools
import hashlib
import os
import pickle
import re
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import plantfit
from plantfit.folders import code_folder
from plantfit.native.compile.compilation import read_object, write_object
from plantfit.native.compile.processor import available, host
from plantfit.native.primitive import libm_of, register_kept
from plantfit.runtime import compiler_options

# isort: split
import jax
from jax.core import Tracer
from jax.experimental.serialize_executable import deserialize_and_load, serialize

# Of kept programs, 35 kB on average; beyond it the half that was not used for longest goes, and is compiled anew.
MOST_FILES = 10_000
_LEAST_SECONDS = "jax_persistent_cache_min_compile_time_secs"  # of a compilation whose program XLA's cache takes up
AGE = "age"  # the file with the letters that `_age` gives
LARGEST = 20_000_000  # bytes of a description: next to that much data a compilation counts little
_OURS = {
    "plantfit",
    "numpy",
    "builtins",
    "collections",
    "functools",
    "pathlib",
    "datetime",
    "copyreg",
    "enum",
    "types",
    "operator",
}
_CALLBACK = re.compile(r"@\w*callback")
_LAPACK = re.compile(r"@(?:lapack|blas)_\w+")
_NATIVE = re.compile(r"plantfit_native_[0-9a-f]{32}")


class NotDescribed(Exception):
    """A description holds a function or class that no fingerprint covers, or more data than a compilation is worth."""


class _Describer(pickle.Pickler):
    """Pickles what a function is compiled from; refuses code of other packages."""

    def reducer_override(self, obj: Any) -> Any:
        module = obj.__module__ if isinstance(obj, type) or callable(obj) else type(obj).__module__
        if (module or "").partition(".")[0] not in _OURS:
            raise NotDescribed(module)
        return NotImplemented


class _Digest:
    """A file that is only hashed."""

    def __init__(self, largest: int | None) -> None:
        self.hash, self.size, self.largest = hashlib.sha256(_machine() + _sources()), 0, largest

    def write(self, content: Any) -> int:
        size = memoryview(content).nbytes
        self.size += size
        if self.largest is not None and self.size > self.largest:
            raise NotDescribed("more data than a compilation is worth")
        self.hash.update(content)
        return size


def described(thing: Any, *, large: bool = False) -> bytes | None:
    """A digest of all that `thing`, which can be pickled, consists of, and of plantfit's text and this machine; None
    where it has none.

    One of more than `LARGEST` bytes has none either, unless it may be `large`.
    """
    file = _Digest(None if large else LARGEST)
    try:
        _Describer(file, protocol=5).dump(thing)
    except Exception:  # whatever a pickle of the user's objects raises: it is compiled anew
        return None
    return file.hash.digest()


def _named(function: Callable, name: str) -> Callable:
    """The function under a name of its own, so that XLA's cache holds none of its programs but those that were made
    where they cannot be kept."""

    def kept(*args: Any) -> Any:
        return function(*args)

    folder = code_folder("programs")
    kept.__name__ = f"kept_{name.replace(' ', '_')}{'' if folder is None else _age(folder)}"
    return kept


@cache
def _age(folder: Path) -> str:
    """Letters that are others once programs of the folder have gone.

    XLA's cache may hold these, of earlier versions, and what XLA has read itself it does not write down: under their
    old names they would never be kept again, and be traced in every process.
    """
    file = folder / AGE
    with suppress(OSError):
        with suppress(FileExistsError), file.open("xb") as opened:
            opened.write(os.urandom(4))
        return f"_{file.read_bytes()[:4].hex()}"
    return ""


@cache
def _sources() -> bytes:
    """The text of plantfit, by size and time of every file."""
    root = os.path.dirname(plantfit.__file__)
    found = []
    for folder, _, names in os.walk(root):
        files = [(name, os.stat(os.path.join(folder, name))) for name in names if name.endswith(".py")]
        found += [(os.path.join(folder[len(root) :], name), s.st_size, s.st_mtime_ns) for name, s in files]
    return repr(sorted(found)).encode()


def _options(careful: bool = False) -> dict[str, Any]:
    """How XLA compiles: quickly around native loops, where little is left to it; all programs of a search alike, so
    that its costs have the same bits in blocks of generations and apart. What loops in XLA itself is compiled with
    care."""
    return compiler_options() if available() and not careful else {}


@cache
def _machine() -> bytes:
    """What XLA's executables depend on beside their text: versions, processor and flags."""
    own = host() if available() else None
    return repr(
        (
            sys.version,
            jax.__version__,
            version("jaxlib"),
            own,
            *map(os.environ.get, ("XLA_FLAGS", "PLANTFIT_NATIVE")),
            _options(),
        )
    ).encode()


class Kept:
    """`jax.jit(function)` whose programs are kept on disk. `description` is the digest of all that the function closes
    over, or None; `careful` as in `_options`.

    Not the thing itself is held, which may hold this function: large arrays would then wait for the collector of
    cycles.
    """

    def __init__(self, function: Callable, name: str, description: bytes | None, careful: bool = False):
        functools.update_wrapper(self, function, assigned=("__name__", "__doc__"), updated=())
        self.name, self.description, self.careful = name, description, careful
        self._plain: Any = jax.jit(_named(function, name))
        self._programs: dict[Any, Callable] = {}
        self._lately: tuple[Any, dict[Any, Callable]] = None, {}

    def __call__(self, *args: Any) -> Any:
        # a search asks thousands of times with the same numbers: only the shape of z is looked at then
        lately, programs = self._lately
        if lately is not None and len(args) == 2 and args[1] is lately:
            program = programs.get(_brief(args[0]))
            if program is not None:
                return program(*args)
        leaves, tree = jax.tree.flatten(args)
        if any(isinstance(leaf, Tracer) for leaf in leaves):
            return self._plain(*args)
        shapes = tree, tuple([_kind(leaf) for leaf in leaves])
        program, results = self._programs.get(shapes), None
        if program is None:
            program, results = self._found_or_made(shapes, args)
            self._programs[shapes] = program
        if (
            len(args) == 2 and isinstance(args[1], tuple) and hasattr(args[0], "shape")
        ):  # a mapping could be given again with other entries
            self._lately = args[1], {**(programs if args[1] is lately else {}), _brief(args[0]): program}
        return program(*args) if results is None else results.of

    def around(self, function: Callable, name: str, thing: Any) -> "Kept":
        """A pure function of arrays that calls this one, compiled; found again by the next process where `thing`
        describes its rest."""
        own = None if self.description is None else described((self.name, self.description, thing))
        return Kept(function, name, own, self.careful)

    def clear_cache(self) -> None:
        """Forget the programs of this process, as `clear_cache` of a function of `jax.jit` does."""
        self._programs, self._lately = {}, (None, {})
        self._plain.clear_cache()

    def _found_or_made(self, shapes: Any, args: tuple[Any, ...]) -> "tuple[Callable, _Results | None]":
        """The program for arguments of these shapes, from disk or compiled and put there; jax's own where it cannot
        be kept. With its results where it was called to see that it runs."""
        if not _usual() or None in shapes[1]:
            return self._plain, None
        folder, options = code_folder("programs"), _options(self.careful)
        if folder is None or self.description is None:  # the same bits as where it is kept
            return self._plain.lower(*args).compile(options), None
        key = hashlib.sha256(repr((self.name, shapes)).encode() + self.description).hexdigest()
        return _read(folder, key, args) or _made(folder, key, self.name, self._plain, args, options)


def kept(function: Callable, name: str, thing: Any, careful: bool = False) -> Kept:
    """A pure function of arrays, compiled; found again by the next process where `thing` describes it. `careful` where
    it loops over samples in XLA."""
    return Kept(function, name, described(thing), careful)


def _brief(z: Any) -> Any:
    """The same of one array; a tracer has a type of its own."""
    return type(z), getattr(z, "shape", None), getattr(z, "dtype", None), getattr(z, "weak_type", False)


def _kind(leaf: Any) -> Any:
    """What a program is compiled for; None for what jax itself has to judge."""
    if isinstance(leaf, (bool, int, float)):
        return type(leaf).__name__
    return (leaf.shape, leaf.dtype, getattr(leaf, "weak_type", False)) if hasattr(leaf, "dtype") else None


def _usual() -> bool:
    """Whether jax is set as plantfit sets it, on one CPU device."""
    values = jax.config.values
    odd = (
        values["jax_disable_jit"]
        or values["jax_debug_nans"]
        or values["jax_debug_infs"]
        or not values["jax_enable_x64"]
    )
    return not odd and jax.default_backend() == "cpu" and len(jax.devices()) == 1


class _Results(NamedTuple):
    """What a program gave; also where that is None."""

    of: Any


class _Kept(NamedTuple):
    """What is on disk under the key of a function: what its executable needs to run, and the structure of its
    results."""

    executable: str  # its key
    natives: tuple[tuple[str, tuple[str, ...]], ...]  # native loops as FFI targets, and what they call of the C library
    lapack: bool
    results: Any


def _read(folder: Path, key: str, args: tuple[Any, ...]) -> tuple[Callable, _Results] | None:
    """The program under a key, and what it gives for these arguments; None without one, or where it does not run
    here."""
    content = read_object(folder / key, key)
    if content is None:
        return None
    try:
        found = _loaded(folder, _Kept(*pickle.loads(content)), args)
    except Exception:  # made by another jaxlib, or its executable is gone: it is made anew
        return None
    _used(folder / key)
    return found


def _used(file: Path) -> None:
    """Note that a file was used now: `_make_room` goes by its time."""
    with suppress(OSError):  # a cache that others made may be read only
        os.utime(file)


def _loaded(folder: Path, kept: _Kept, args: tuple[Any, ...]) -> tuple[Callable, _Results] | None:
    executable = read_object(folder / kept.executable, kept.executable)
    # whoever kept it with native loops had asked this jaxlib for its interface (`compile.interface`)
    if executable is None or not all(register_kept(name, libm) for name, libm in kept.natives):
        return None
    if kept.lapack:
        _with_lapack()
    program = deserialize_and_load(executable, jax.tree.structure((args, {})), jax.tree.structure(kept.results))
    results = jax.block_until_ready(program(*args))
    _used(folder / kept.executable)
    return program, _Results(results)


@cache
def _with_lapack() -> None:
    """jax hands all of LAPACK to XLA when it lowers a first call of it. A program that is read lowers nothing, and
    would call nowhere."""
    jax.block_until_ready(jax.jit(jax.numpy.linalg.eigh)(np.eye(2)))


def _made(
    folder: Path, key: str, name: str, jitted: Any, args: tuple[Any, ...], options: dict[str, Any]
) -> tuple[Callable, _Results | None]:
    """The program for these arguments, traced now; compiled and put into the folder where no other function has
    become the same program."""
    lowered = jitted.lower(*args)
    text = lowered.as_text()
    natives = tuple((name, libm_of(name)) for name in sorted(set(_NATIVE.findall(text))))
    results = jax.tree.map(lambda _: 0, lowered.out_info)
    otherwise = b"" if options == _options() else repr(options).encode()
    digest = hashlib.sha256(_machine() + otherwise + _taken(lowered, key) + text.encode()).hexdigest()
    kept = _Kept(digest, natives, _LAPACK.search(text) is not None, results)
    found = None
    with suppress(Exception):  # as in `_read`
        found = _loaded(folder, kept, args)
    if found is None:
        before = _seen.hits
        with _unwritten:
            program = lowered.compile(options)
        found = program, None
        # XLA does not write down a program that it has read itself, nor one that calls back into this process
        if _seen.hits > before or _CALLBACK.search(text):
            return found
        try:
            executable, _, _ = serialize(program)
        except Exception:  # what jax cannot write down works all the same
            return found
        _make_room(folder)
        write_object(folder / kept.executable, kept.executable, executable)
    with suppress(Exception):  # results of other classes than tuples, lists and dictionaries
        write_object(folder / key, key, pickle.dumps(tuple(kept)))
    return found


def _taken(lowered: Any, key: str) -> bytes:
    """Which arguments a program takes: jax leaves those out that are not used, so that `x[0]` and `x[1]` are one text,
    and an executable takes the one that it was compiled for. Where jax does not tell, the key, which no other function
    has."""
    try:
        return repr(sorted(lowered._lowering.compile_args["kept_var_idx"])).encode()
    except (AttributeError, KeyError, TypeError):
        return key.encode()


class _Unwritten:
    """While it is entered XLA's cache takes up no program: what is kept here would be packed and written a second time.

    jax has this setting for all threads at once: what another one compiles meanwhile is compiled anew by the next
    process.
    """

    def __init__(self) -> None:
        self._lock, self._inside, self._usual = threading.Lock(), 0, 0.0

    def __enter__(self) -> None:
        with self._lock:
            if not self._inside:
                self._usual = getattr(jax.config, _LEAST_SECONDS)
                jax.config.update(_LEAST_SECONDS, float("inf"))
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                jax.config.update(_LEAST_SECONDS, self._usual)


_unwritten = _Unwritten()


class _Seen(threading.local):
    """How many programs this thread has read from XLA's cache."""

    hits = 0


def _count(event: str, **_: Any) -> None:
    if event == "/jax/compilation_cache/cache_hits":
        _seen.hits += 1


_seen = _Seen()
jax.monitoring.register_event_listener(_count)


@cache
def _make_room(folder: Path) -> None:
    """Once in a process: the older half goes where there are too many."""
    with _LOCK:
        try:
            files = sorted((f.stat().st_mtime, f) for f in folder.iterdir() if f.name != AGE)
            if len(files) > MOST_FILES:
                for f in (*(f for _, f in files[: len(files) // 2]), folder / AGE):
                    f.unlink(missing_ok=True)
        except OSError:
            return


_LOCK = threading.Lock()
