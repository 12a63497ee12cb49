"""A jaxlib whose interface is not the one that native loops are written for: scans, one sentence, and never a crash."""

import os
import subprocess
import sys

import pytest

from plantfit.native import available
from plantfit.native.compile.interface import engine, refusal

LOOP = """
import warnings
import plantfit.native.compile.ffi_handler as handler
{change}
import plantfit.runtime, jax, jax.numpy as jnp
from plantfit.native import native_scan
from plantfit.study import versions
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    for k in (3.0, 4.0):
        halved = lambda c, x: (c * 0.5 + x, None)
        after = jax.jit(lambda c, k=k: native_scan(halved, c, jnp.arange(k), fallback=True)[0])(1.0)
print(float(after), versions()["engine"], "native" in jax.jit(lambda c: native_scan(
    lambda c, x: (c * 0.5 + x, None), c, jnp.arange(3.0), fallback=True)[0]).lower(1.0).as_text())
print(*[str(w.message) for w in told], sep="\\n")
"""


def lines(change, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", LOOP.format(change=change)],
        capture_output=True, text=True, env={**os.environ, "PLANTFIT_CACHE": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.fixture(autouse=True)
def _native():
    if not available():
        pytest.skip("native loops are off here: no llvmlite, or PLANTFIT_NATIVE=0")


@pytest.mark.thorough
def test_this_jaxlib_serves_the_interface(tmp_path):
    assert refusal() is None
    assert engine() == "native"
    assert lines("", tmp_path) == ["4.3125 native True", ""]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("handler.VERSION = (0, 99)", "does not serve version 0.99"),
        ("handler.VERSION = (1, 0)", "does not serve version 1.0"),
        ("handler.SIZES = (160, 40, 40, 48)", "structs have the sizes [168, 0, 0, 0]"),
        ("handler.SIZES = (168, 40, 40, 56)", "structs have the sizes [168, 40, 40, 48]"),
    ],
)
@pytest.mark.further(1)
def test_another_interface_ends_in_scan_with_one_sentence(change, said, tmp_path):
    result, *told = lines(change, tmp_path)
    assert result == "4.3125 scan False"
    assert len(told) == 1
    assert said in told[0]
    assert "XLA scans" in told[0]
