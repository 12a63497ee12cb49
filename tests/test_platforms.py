"""macOS, Windows and ARM by faked facts: the branches for them work.

What was run on those systems themselves stands in docs/overview.md.
"""

import ctypes
import errno
import importlib
import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from plantfit.errors import BoardError
from plantfit.native import available
from plantfit.native.compile import compilation, processor
from plantfit.native.unsupported import NativeUnsupported
from plantfit.recording.readers import memory
from plantfit.rig.board.link import Link
from plantfit.study.running import cores, worker_names

sys.path.append(str(Path(__file__).parent / "cli"))
from cli_call import heater

NOWHERE = Path("/nowhere/at/all")

# One process in which the modules of plantfit see another system: its names, and neither /proc nor what POSIX alone
# has.
STUDY = """
import importlib, io, json, pkgutil, sys, warnings
from contextlib import suppress

kind, spec = sys.argv[1:]
import plantfit
for module in pkgutil.walk_packages(plantfit.__path__, "plantfit."):
    if module.name.split(".")[1] not in ("cases", "testing", "__main__"):
        with suppress(ImportError):
            importlib.import_module(module.name)

class Seen:  # a module with some facts changed and some names taken away
    def __init__(self, real, facts, lacks=()):
        self.__dict__.update(_real=real, _facts=facts, _lacks=lacks)
    def __getattr__(self, name):
        if name in self._lacks:
            raise AttributeError(name)
        return self._facts[name] if name in self._facts else getattr(self._real, name)
    def __setattr__(self, name, value):
        setattr(self._real, name, value)

import ctypes, ctypes.util, os, signal
posix = ("getuid", "fork", "sched_getaffinity", "O_NOFOLLOW", "getloadavg", "killpg", "setsid")
library = {"ucrtbase": None, "msvcrt": None}
def CDLL(name):
    if kind == "windows" and name not in library:
        raise OSError(name)
    return ctypes.CDLL(library.get(name, name))
faked = {
    "windows": {
        os: Seen(os, {"name": "nt"}, posix), sys: Seen(sys, {"platform": "win32"}),
        signal: Seen(signal, {}, ("pthread_kill", "SIGKILL", "SIGHUP", "SIGUSR1", "SIGXCPU")),
        ctypes: Seen(ctypes, {"CDLL": CDLL, "util": Seen(ctypes.util, {"find_library": lambda name: None})}),
    },
    "macos": {
        os: Seen(os, {}, ("sched_getaffinity",)), sys: Seen(sys, {"platform": "darwin"}), signal: signal,
        ctypes: Seen(ctypes, {"util": Seen(ctypes.util, {"find_library": lambda name: None})}),
    },
    "here": {},
}[kind]
touched = set()
for module in [m for name, m in sys.modules.items() if name.startswith("plantfit")]:
    for name in ("os", "sys", "signal", "ctypes"):
        if (real := vars(module).get(name)) in faked:
            setattr(module, name, faked[real])
            touched.add(name)
real_open = io.open
def no_proc(file, *given, **named):
    if kind != "here" and str(file).startswith(("/proc/", "/sys/fs", "/sys/devices")):
        raise FileNotFoundError(2, "none here", str(file))
    return real_open(file, *given, **named)
io.open = no_proc

from plantfit.cli.main import run_cli
def call(*words):
    sys.argv = ["plantfit", *words]
    try:
        run_cli()
    except SystemExit as end:
        assert not end.code, (words, end.code)
sys.stdout, out = io.StringIO(), sys.stdout
call("check", spec)
call("run", spec, "--store", "s.db", "--out", "s.html")
sys.stdout = shown = io.StringIO()
call("report", "1", "--store", "s.db", "--json")
sys.stdout = out
from plantfit.study.versions import versions
found = json.loads(shown.getvalue())
print(json.dumps([found["parameters"], versions()["engine"], sorted(touched)]))
"""


def fitted(kind, folder):
    folder.mkdir(exist_ok=True)
    heater(folder)
    text = (folder / "heater.toml").read_text("utf-8") + 'methods = ["least_squares"]\nruns = 1\nbudget = 60\n'
    # functions of the C library
    (folder / "heater.toml").write_text(text.replace(")/tau", ")/tau*exp(1e-9*atan(L/tau))"), "utf-8")
    environment = os.environ | {"PLANTFIT_CACHE": str(folder / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", STUDY, kind, "heater.toml"], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
def test_a_study_with_the_facts_of_windows_and_macos(tmp_path):
    usual, engine, _ = fitted("here", tmp_path / "here")
    for kind in ("windows", "macos"):
        parameters, theirs, touched = fitted(kind, tmp_path / kind)
        assert {"os", "sys", "ctypes"} <= set(touched)
        assert theirs == engine
        assert parameters == usual


class Library:
    """llvmlite.binding as another processor would have it."""

    def __init__(self, triple, name, features):
        self.triple, self.name, self.features, self.symbols = triple, name, features, {}

    def get_host_cpu_features(self):
        if self.features is None:
            raise RuntimeError("failed to get host cpu features.")
        flatten = ",".join(f"{'+' if on else '-'}{name}" for name, on in self.features.items())
        return SimpleNamespace(get=self.features.get, flatten=lambda: flatten)

    def get_process_triple(self):
        return self.triple

    def get_host_cpu_name(self):
        return self.name

    def add_symbol(self, name, address):
        self.symbols[name] = address

    def initialize_native_target(self):
        pass

    def initialize_native_asmprinter(self):
        pass


@pytest.fixture
def asked_anew():
    """What is known of the processor is asked again, before and after."""
    cached = (processor.host, processor.available, processor.llvm_binding, compilation._find_one)
    for function in cached:
        function.cache_clear()
    yield
    for function in cached:
        function.cache_clear()


NEON = {"neon": True, "fp-armv8": True}


@pytest.mark.parametrize(
    ("triple", "features", "host"),
    [
        ("aarch64-unknown-linux-gnu", NEON, ("+neon,+fp-armv8", 2, 2, True)),
        ("arm64-apple-darwin24.0.0", NEON, ("+neon,+fp-armv8", 2, 2, True)),
        ("arm64-apple-darwin24.0.0", {}, ("", 2, 2, True)),
        ("x86_64-apple-darwin", {"avx2": True, "fma": True}, ("+avx2,+fma", 4, 2, True)),
        ("x86_64-pc-windows-msvc", {"sse2": True}, ("+sse2", 2, 2, False)),
        (
            "x86_64-pc-windows-msvc", dict.fromkeys(("avx512f", "avx512dq", "avx512bw", "avx512vl", "fma"), True),
            ("+avx512f,+avx512dq,+avx512bw,+avx512vl,+fma,-prefer-256-bit", 8, 4, True),
        ),
    ],
)  # fmt: skip
def test_processors(triple, features, host, monkeypatch, asked_anew):
    monkeypatch.setattr(processor, "llvm_binding", lambda: Library(triple, "some-core", features))
    assert processor.host() == processor.Host("some-core", *host)


def test_a_processor_that_llvm_does_not_know_and_one_of_32_bit_have_no_native_loops(monkeypatch, asked_anew):
    monkeypatch.delenv("PLANTFIT_NATIVE", raising=False)
    monkeypatch.setattr(processor, "llvm_binding", lambda: Library("riscv64-unknown-linux-gnu", "x", None))
    assert not processor.available()
    processor.available.cache_clear()
    monkeypatch.setattr(processor, "llvm_binding", lambda: Library("armv7l-unknown-linux-gnueabihf", "x", NEON))
    monkeypatch.setattr(processor, "sys", SimpleNamespace(maxsize=2**31 - 1, platform="linux"))
    processor.host.cache_clear()
    assert not processor.available()


NARROW = """
import numpy as np
import plantfit.native.compile.processor as p
p.host.cache_clear()
real = p.host()
p.host = lambda: p.Host("generic", real.features, 2, 2, {fused})  # vectors of NEON, with and without fused multiply-add
import plantfit.native.compile.compilation as c
c.host = p.host
import sys
for module in [m for n, m in sys.modules.items() if n.startswith("plantfit.native")]:
    if hasattr(module, "host"):
        module.host = p.host
import plantfit.runtime, jax, jax.numpy as jnp
from plantfit.native import native_scan
for module in [m for n, m in sys.modules.items() if n.startswith("plantfit.native")]:
    if hasattr(module, "host"):
        module.host = p.host
def step(c, x):
    c = c + 0.01 * (jnp.sin(c + x) - jnp.exp(-c * c) + jnp.sqrt(1 + c * c))
    return c, c
x = jnp.asarray(np.random.default_rng(0).normal(size=(50, 7)))
native = jax.jit(lambda: native_scan(step, jnp.zeros(7), x)[0])()
plain = jax.jit(lambda: jax.lax.scan(step, jnp.zeros(7), x)[0])()
print(float(jnp.max(jnp.abs(native - plain))), "native" in jax.jit(
    lambda: native_scan(step, jnp.zeros(7), x)).lower().as_text())
"""


@pytest.mark.parametrize("fused", [True, False])
@pytest.mark.thorough
def test_loops_of_the_width_of_arm(fused, tmp_path):
    if not available():
        pytest.skip("native loops are off here: no llvmlite, or PLANTFIT_NATIVE=0")
    done = subprocess.run(
        [sys.executable, "-c", NARROW.format(fused=fused)],
        capture_output=True,
        text=True,
        env=os.environ | {"PLANTFIT_CACHE": str(tmp_path)},
    )
    assert done.returncode == 0, done.stderr
    off, native = done.stdout.split()
    assert native == "True"
    assert float(off) < 1e-13


def test_functions_of_the_c_library_of_windows_and_macos(monkeypatch, asked_anew):
    llvm, asked = Library("x86_64-pc-windows-msvc", "x", {}), []
    monkeypatch.setattr(compilation, "llvm_binding", lambda: llvm)

    def library(name):
        asked.append(name)
        if name not in ("msvcrt", None):
            raise OSError(f"no {name}")
        return ctypes.CDLL(None)

    faked = SimpleNamespace(
        CDLL=library, cast=ctypes.cast, c_void_p=ctypes.c_void_p, util=SimpleNamespace(find_library=lambda name: None)
    )
    monkeypatch.setattr(compilation, "ctypes", faked)
    monkeypatch.setattr(compilation, "sys", SimpleNamespace(platform="win32"))
    compilation.find_libm(("exp",))
    assert asked == ["ucrtbase", "msvcrt"]
    monkeypatch.setattr(compilation, "sys", SimpleNamespace(platform="darwin"))
    asked.clear()
    compilation.find_libm(("sin",))
    assert asked == [None]  # there all of it is in every process
    assert {name: bool(address) for name, address in llvm.symbols.items()} == {"exp": True, "sin": True}
    with pytest.raises(NativeUnsupported, match="no_such_function, which the C library lacks"):
        compilation.find_libm(("no_such_function",))


def test_windows_needs_a_symbol_for_floating_point(monkeypatch, asked_anew):
    llvm = pytest.importorskip("llvmlite.binding", reason="needs llvmlite")
    added = {}
    monkeypatch.setattr(llvm, "add_symbol", lambda name, address: added.update({name: address}))
    processor.llvm_binding()
    assert added == {}
    processor.llvm_binding.cache_clear()
    monkeypatch.setattr(processor, "sys", SimpleNamespace(platform="win32", maxsize=sys.maxsize))
    processor.llvm_binding()
    assert ctypes.c_int.from_address(added["_fltused"]).value == 1


def test_object_code_of_one_system_is_not_taken_on_another(monkeypatch):
    keys = set()
    for platform in ("linux", "darwin", "win32"):
        monkeypatch.setattr(compilation, "sys", SimpleNamespace(platform=platform))
        keys.add(compilation.key_of("text"))
    assert len(keys) == 3


def test_a_worker_without_proc(monkeypatch):
    """macOS: a process that lives is not given up, one that is gone is; Windows: only silence tells."""
    real = worker_names.Path

    monkeypatch.setattr(worker_names, "Path", lambda place: NOWHERE if str(place).startswith("/proc") else real(place))

    def no_link(place):
        raise FileNotFoundError(place)

    seen = SimpleNamespace(name="posix", getpid=os.getpid, kill=os.kill, readlink=no_link)
    monkeypatch.setattr(worker_names, "os", seen)
    mine = worker_names.new_worker()
    assert not worker_names.is_stale(mine, 100.0, 110.0)
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    machine, _, started, rest = mine.split("|")
    gone = "|".join((machine, str(child.pid), started, rest))
    assert worker_names.is_stale(gone, 100.0, 110.0)
    seen.name = "nt"
    seen.kill = None  # there it ends the process that it asks
    assert not worker_names.is_stale(gone, 100.0, 110.0)
    assert worker_names.is_stale(gone, 100.0, 100.0 + worker_names.STALE_SECONDS + 1.0)


def test_cores_memory_and_name_of_the_processor_where_no_file_tells(monkeypatch):
    monkeypatch.setattr(cores, "os", SimpleNamespace(cpu_count=lambda: 6))
    assert cores.physical_cores(NOWHERE) == 6
    assert cores.quota(NOWHERE) == float("inf")
    assert cores.free_memory(NOWHERE) == float("inf")
    assert memory.free_memory(NOWHERE, NOWHERE) is None
    monkeypatch.setattr(cores, "os", SimpleNamespace(cpu_count=lambda: None))
    assert cores.physical_cores(NOWHERE) == 1
    versions = importlib.import_module("plantfit.study.versions")  # the package has a function of this name
    monkeypatch.setattr(versions, "platform", SimpleNamespace(processor=lambda: "arm", machine=lambda: "arm64"))
    assert versions.cpu_model(NOWHERE) == "arm"
    monkeypatch.setattr(versions, "platform", SimpleNamespace(processor=lambda: "", machine=lambda: "arm64"))
    assert versions.cpu_model(NOWHERE) == "arm64"


def test_a_cache_folder_of_windows_has_no_rights_to_look_at(monkeypatch):
    from plantfit import folders

    monkeypatch.setattr(folders, "os", SimpleNamespace(name="nt"))
    assert folders._is_own(NOWHERE)


@pytest.mark.parametrize(
    ("name", "port", "words", "number", "told"),
    [
        ("nt", "COM9", "could not open port 'COM9': FileNotFoundError(2, 'The system cannot find the file specified.', "
                       "None, 2)", None,
         "There is no port COM9; this machine has COM3; name the port of the board."),
        ("nt", "COM3", "could not open port 'COM3': PermissionError(13, 'Access is denied.', None, 5)", None,
         "Port COM3 is in use by another program"),
        ("nt", "COM3", "could not open port 'COM3': OSError(22, 'The semaphore timeout period has expired.', "
                       "None, 121)", None,
         "Port COM3 cannot be opened"),
        ("posix", "/dev/cu.usbmodem9", "[Errno 2] No such file or directory", errno.ENOENT,
         "There is no port /dev/cu.usbmodem9"),
        ("posix", "/dev/null", "[Errno 16] Resource busy", errno.EBUSY, "in use by another program"),
        ("posix", "/dev/null", "[Errno 13] Permission denied", errno.EACCES, "may not be used by this user"),
    ],
)  # fmt: skip
def test_ports_of_windows_and_macos(name, port, words, number, told, monkeypatch):
    class SerialException(OSError):
        pass

    def open_it(*given, **named):
        raise SerialException(words) if number is None else SerialException(number, words)

    serial = SimpleNamespace(SerialException=SerialException, serial_for_url=open_it)
    monkeypatch.setattr("plantfit.rig.board.link._pyserial", lambda: serial)
    monkeypatch.setattr("plantfit.rig.board.link.ports", lambda: ["COM3"])
    monkeypatch.setattr("plantfit.rig.board.link.os", SimpleNamespace(name=name, path=os.path))
    with pytest.raises(BoardError) as caught:
        Link(port, 115200)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "Error(" not in str(caught.value) or told.endswith("cannot be opened")


INTERRUPTED = """
import sys, types
sys.argv = ["plantfit", "methods"]
import plantfit.cli.commands.reference.catalogue as c
import plantfit.cli.terminal.interrupts as i
class Seen:
    platform = "win32"
    def __getattr__(self, name): return getattr(sys, name)
    def __setattr__(self, name, value): setattr(sys, name, value)
i.sys = Seen()
del i.signal.pthread_kill  # Windows has none
def work():
    import hashlib, time
    try:
        with i.stoppable("Stopping.", lambda: "late", cleans_up=True):
            print("computing", flush=True)
            hashlib.pbkdf2_hmac("sha256", b"", b"", 1_000_000)  # both signals come while C code runs: Python sees one
            while True:
                time.sleep(0.01)
    except KeyboardInterrupt:
        print("motor stopped", flush=True)
        raise
c.methods = lambda *given: work()
from plantfit.cli.start import run
run()
"""


@pytest.mark.skipif(os.name != "posix", reason="sends signals as POSIX does")
def test_two_ctrl_c_with_the_facts_of_windows(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path
    )
    assert process.stdout is not None
    assert process.stderr is not None
    assert process.stdout.readline() == "computing\n"
    process.send_signal(2)
    assert process.stderr.readline() == "Stopping.\n"
    process.send_signal(2)
    out, error = process.communicate(timeout=600)
    assert (process.returncode, out) == (130, "motor stopped\n"), error
