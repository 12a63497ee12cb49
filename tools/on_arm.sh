#!/bin/sh
# A native loop on ARM by qemu-user, against the same on this machine:  tools/on_arm.sh FOLDER
# Needs Debian's apt-get and pip, and some 500 MB in FOLDER; nothing is installed outside of it. Takes minutes: qemu is some 15 times slower.
set -e
root=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$1" && cd "$1"
mkdir -p state/lists/partial cache/archives/partial root debs site home && touch state/status
here=$(pwd)
if [ ! -e fetched ]; then
  options="-o Dir::State=$here/state -o Dir::State::status=$here/state/status -o Dir::Cache=$here/cache
    -o APT::Architecture=arm64 -o APT::Architectures=arm64"
  apt-get $options update
  cd debs
  apt-get $options download libc6 libgcc-s1 libstdc++6 zlib1g libssl3 libffi8 libsqlite3-0 libbz2-1.0 liblzma5 libexpat1 libuuid1 \
    libncursesw6 libtinfo6 libreadline8 libcrypt1 libnsl2 libtirpc3 python3.11-minimal libpython3.11-minimal libpython3.11-stdlib
  for file in *.deb; do dpkg -x "$file" ../root; done
  cd .. && apt-get download qemu-user-static && dpkg -x qemu-user-static*.deb qemu
  python3 -m pip download --quiet --only-binary :all: --python-version 3.11 --dest wheels --constraint "$root/constraints.txt" \
    --platform manylinux2014_aarch64 --platform manylinux_2_17_aarch64 --platform manylinux_2_27_aarch64 --platform manylinux_2_28_aarch64 \
    jax numpy scipy polars pint pydantic llvmlite sqlalchemy typer rich plotly jinja2 threadpoolctl tomlkit emcee
  for file in wheels/*.whl; do python3 -m zipfile -e "$file" site; done
  touch fetched
fi
cat > loop.py <<'END'
import platform
import plantfit.runtime
import jax, jax.numpy as jnp, numpy as np
from plantfit.native import native_scan
from plantfit.native.compile.interface import engine
def step(c, x):
    c = c + 0.01 * (jnp.sin(c + x) - jnp.exp(-c * c) + jnp.sqrt(1 + c * c))
    return c, c
x = jnp.asarray(np.random.default_rng(0).normal(size=(50, 7)))
loop = jax.jit(lambda: native_scan(step, jnp.zeros(7), x)[0])
print(platform.machine(), engine(), "native" in loop.lower().as_text(), *(float(v).hex() for v in loop()))
END
export PLANTFIT_CACHE="$here/cache-of-plantfit"
PYTHONPATH="$root/src" "${PYTHON:-$root/.venv/bin/python}" loop.py > here.txt
PYTHONPATH="$here/site:$root/src" HOME="$here/home" qemu/usr/bin/qemu-aarch64-static -L root root/usr/bin/python3.11 loop.py > arm.txt
cat here.txt arm.txt
grep -q "^aarch64 native True " arm.txt
test "$(cut -d' ' -f4- here.txt)" = "$(cut -d' ' -f4- arm.txt)" && echo "The same bits."
