"""Object code from the disk: used when it is what was put there, compiled anew when it is anything else, at no place
that others own."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from plantfit.native import available
from plantfit.native.compile.compilation import HEADER, MAGIC, read_object, write_object

LOOP = """
import sys, warnings
warnings.simplefilter("always")
import plantfit.runtime, jax, jax.numpy as jnp
import plantfit.native.compile.compilation as c
whole, compiled = c.compile_text, []
c.compile_text = lambda text: compiled.append(1) or whole(text)
from plantfit.native import native_scan
print(jax.jit(lambda x: native_scan(lambda c, x: (c * 0.5 + x, None), x, jnp.arange(5.0))[0])(1.0), len(compiled))
"""


def loop(folder, **more):
    given = {k: v for k, v in os.environ.items() if k not in ("PLANTFIT_CACHE", "XDG_CACHE_HOME")}
    given |= {"PLANTFIT_CACHE": str(folder)} if folder else {}
    done = subprocess.run([sys.executable, "-c", LOOP], capture_output=True, text=True, env={**given, **more})
    assert done.returncode == 0, (done.returncode, done.stderr)
    value, compiled = done.stdout.split()
    assert value == "6.15625"
    return int(compiled), done.stderr


@pytest.fixture(autouse=True)
def _native():
    if not available():
        pytest.skip("native loops are off here: no llvmlite, or PLANTFIT_NATIVE=0")


@pytest.mark.thorough
def test_broken_files_are_compiled_anew(tmp_path):
    assert loop(tmp_path)[0] == 2  # the loop, and the probe of the interface
    assert loop(tmp_path)[0] == 0
    files = sorted((tmp_path / "native").glob("*.o"))
    assert len(files) == 2
    whole = {f: f.read_bytes() for f in files}
    half, bare, flipped = (lambda b: b[: len(b) // 2]), (lambda b: b[HEADER:]), lambda b: b[:-1] + bytes([b[-1] ^ 1])
    for ways in ((lambda b: b"", half), (half, bare), (flipped, lambda b: b"x" * 9000)):
        for f, broken in zip(files, ways, strict=True):
            f.write_bytes(broken(whole[f]))
        assert loop(tmp_path)[0] == 2
        assert {f: f.read_bytes() for f in files} == whole  # mended
    files[0].write_bytes(whole[files[1]])  # code of another loop under this name
    assert loop(tmp_path)[0] == 1
    assert sorted((tmp_path / "native").iterdir()) == files


def test_every_byte_of_a_file_is_checked(tmp_path):
    file = tmp_path / "k.o"
    assert read_object(file, "k") is None
    write_object(file, "k", b"code" * 20)
    whole = file.read_bytes()
    assert whole.startswith(MAGIC)
    assert read_object(file, "k") == b"code" * 20
    assert read_object(file, "other") is None
    for at in range(len(whole)):
        file.write_bytes(whole[:at] + bytes([whole[at] ^ 4]) + whole[at + 1 :])
        assert read_object(file, "k") is None
        file.write_bytes(whole[:at])
        assert read_object(file, "k") is None
    file.write_bytes(whole + b"\0")
    assert read_object(file, "k") is None
    file.unlink()
    file.mkdir()
    assert read_object(file, "k") is None


def test_code_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    told = []
    for name in ("fsync", "replace"):
        real = getattr(os, name)
        monkeypatch.setattr(os, name, lambda *given, name=name, real=real: (told.append(name), real(*given)))
    write_object(tmp_path / "k.o", "k", b"code")
    assert told == ["fsync", "replace"]


@pytest.mark.skipif(os.name != "posix", reason="rights of folders are those of POSIX")
@pytest.mark.thorough
def test_a_folder_that_others_can_write_to_is_not_used(tmp_path):
    assert loop(tmp_path)[0] == 2
    for folder, mode in ((tmp_path, 0o777), (tmp_path / "native", 0o775), (tmp_path / "native", 0o703)):
        kept = folder.stat().st_mode
        folder.chmod(mode)
        compiled, said = loop(tmp_path)
        assert compiled == 2
        assert f"{folder} can be written by other users" in said
        assert said.count("can be written by other users") == 1
        folder.chmod(kept)
    assert loop(tmp_path) == (0, "")


@pytest.mark.skipif(os.name != "posix", reason="rights of folders are those of POSIX")
@pytest.mark.parametrize("home", ["/proc", "", "A FILE"])
@pytest.mark.further(1)
def test_no_home_costs_time_only(home, tmp_path):
    (tmp_path / "file").write_text("")
    if home == "":  # neither a name nor a home
        compiled, said = loop(None, HOME=str(tmp_path / "Zoë's home"))
        assert loop(None, HOME=str(tmp_path / "Zoë's home"))[0] == 0
    else:
        compiled, said = loop(None, HOME=str(tmp_path / "file") if home == "A FILE" else home)
    assert compiled == 2
    assert "Traceback" not in said
    assert not list(Path(tmp_path).glob("*.part"))
