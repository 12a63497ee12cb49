"""What importing plantfit leaves in the process of a user."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

IMPORTED = """
import os
before = dict(os.environ)
import plantfit.runtime
import jax.numpy as jnp
JAX = {"TPU_SKIP_MDS_QUERY", "TF_CPP_MIN_LOG_LEVEL", "KMP_DUPLICATE_LIB_OK"}  # what jax and threadpoolctl set themselves
assert {k for k in {*os.environ, *before} if os.environ.get(k) != before.get(k)} <= JAX
assert len(jnp.linspace(0, 1, 3)) == 3
print("as before")
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


def said(code, *arguments, **environment):
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, env={**os.environ, **environment}, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize("flags", ["", "--xla_cpu_multi_thread_eigen=true", "--xla_dump_max_hlo_modules=3"])
def test_environment_variables_are_as_before(flags):
    assert said(IMPORTED, **({"XLA_FLAGS": flags} if flags else {})) == ["as", "before"]


def test_a_compilation_cache_of_the_user_stays_his(tmp_path):
    assert said(KEEPS_ITS_CACHE.replace("FOLDER", repr(str(tmp_path)))) == ["True", "7.0"]


@pytest.mark.skipif(not Path("/proc/self/task").exists() or os.cpu_count() == 1, reason="counts threads by /proc, of several cores")
def test_xla_gets_one_thread_where_jax_had_not_begun():
    alone, beside = said(ONE_THREAD), said(ONE_THREAD, "first")
    assert float(alone[0]) == float(beside[0]) == 800.0**3
    assert int(alone[1]) == 1
    assert int(beside[1]) > 1  # a pool that was there stays
