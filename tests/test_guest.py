"""What importing plantfit leaves in the process of a user."""

import os
import subprocess
import sys
from pathlib import Path

import jaxlib.version
import numpy as np
import pytest

from plantfit import runtime

import jax
import jax.numpy as jnp

FORKED = """
import os
import plantfit.runtime
import jax.numpy as jnp
child = os.fork()
if child == 0:  # has to make a client of its own
    os._exit(0 if float((jnp.ones((50, 50)) @ jnp.ones(50)).sum()) == 2500.0 else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""

KEEPS_ITS_CACHE = """
import jax
jax.config.update("jax_compilation_cache_dir", FOLDER)
jax.config.update("jax_persistent_cache_min_compile_time_secs", 7.0)
import plantfit.runtime
print(jax.config.jax_compilation_cache_dir == FOLDER, jax.config.jax_persistent_cache_min_compile_time_secs)
"""

ONE_THREAD = """
import os, sys
if "first" in sys.argv:
    import jax
    jax.devices()
import plantfit.runtime
import jax, jax.numpy as jnp
total = float(jax.jit(lambda a: (a @ a).sum())(jnp.ones((800, 800))))
names = [open(f"/proc/self/task/{t}/comm").read().strip() for t in os.listdir("/proc/self/task")]
print(total, names.count("tf_XLAEigen"))
"""

ANOTHER_XLA = """
import jax, jaxlib.version
jaxlib.version.__version__ = "99.0.0"
import os
import plantfit.runtime
print("split_count" in os.environ["XLA_FLAGS"], "multi_thread_eigen" in os.environ["XLA_FLAGS"])
"""


def said(code, *arguments, **environment):
    own = {k: v for k, v in os.environ.items() if k not in ("NPROC", "XLA_FLAGS")}  # this process imported plantfit
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, env=own | environment, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork, which this system lacks")
@pytest.mark.thorough
def test_a_process_that_is_forked_after_the_import_computes():
    assert said(FORKED) == ["0"]


def test_a_compilation_cache_of_the_user_stays_his(tmp_path):
    assert said(KEEPS_ITS_CACHE.replace("FOLDER", repr(str(tmp_path)))) == ["True", "7.0"]


@pytest.mark.skipif(
    not Path("/proc/self/task").exists() or os.cpu_count() == 1, reason="counts threads by /proc, of several cores"
)
@pytest.mark.thorough
def test_xla_gets_one_thread_where_jax_had_not_begun():
    alone, beside = said(ONE_THREAD), said(ONE_THREAD, "first")
    assert float(alone[0]) == float(beside[0]) == 800.0**3
    assert int(alone[1]) == 1
    assert int(beside[1]) > 1  # a pool that was there stays


@pytest.mark.thorough
def test_an_xla_that_was_not_tried_gets_no_flag_that_may_end_it():
    assert said(ANOTHER_XLA) == ["False", "True"]
    assert said(ANOTHER_XLA.replace("99.0.0", jaxlib.version.__version__)) == ["True", "True"]


def test_an_xla_that_does_not_know_how_to_compile_quickly_compiles_all_the_same(monkeypatch):
    monkeypatch.setattr(runtime, "_TRIED", ())
    asked = runtime.compiler_options.__wrapped__
    assert asked() == runtime.QUICK
    monkeypatch.setattr(runtime, "QUICK", {"xla_option_of_another_time": 1})
    assert asked() == {}


def test_a_method_compiled_quickly_is_as_exact():
    def pulled(x, c):
        return jnp.linalg.solve(c @ c.T + 5.0 * jnp.eye(len(x)), jnp.cos(x)) + jnp.sort(x)[::-1] ** 3

    draw = np.random.default_rng(3)
    x, c = draw.normal(size=9), draw.normal(size=(9, 9))
    expected = np.linalg.solve(c @ c.T + 5.0 * np.eye(9), np.cos(x)) + np.sort(x)[::-1] ** 3
    assert np.allclose(runtime.jit(pulled)(x, c), expected, rtol=1e-12, atol=1e-14)
    assert np.allclose(runtime.jit(pulled)(x, c), jax.jit(pulled)(x, c), rtol=1e-13, atol=1e-15)
