"""Feed broken files to the command line and count what comes of them:  python tests/fuzz/fuzz_cli.py --inputs 2000
--seed 1

Each input goes to one call of `plantfit` in a process of its own, forked from one that has imported everything. A find
is an ending by a signal, the exit code of an error inside plantfit, a traceback, more than 20 lines of errors, more
than 10 s of CPU, or 2 GB of memory. What is accepted may take 90 s of CPU: XLA and LLVM compile a model that was never
seen, which the undamaged files need too. Inputs are drawn in another process: polars that has run does not survive a
fork.
"""

import argparse
import importlib
import os
import pkgutil
import resource
import signal
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parent))
from fuzz_inputs import LAYERS, STUDY, drawn

SECONDS, BYTES, LINES = 10, 2 * 2**30, 20
ACCEPTED = 90  # seconds of CPU of a call that ends well
WAIT = 300  # seconds by the clock after which a call hangs, however busy the machine is
INSIDE = 70  # exit code of an error that is not meant for users
COMMANDS = {  # what reads a file of a layer; {} is the file
    "csv": ("init", "{}", "--out", "made.toml"),
    "parquet": ("init", "{}", "--out", "made.toml"),
    "xlsx": ("init", "{}", "--out", "made.toml"),
    "npz": ("init", "{}", "--out", "made.toml"),
    "mat": ("init", "{}", "--out", "made.toml"),
    "toml": ("check", "{}"),
    "equations": ("check", "study.toml"),
    "store": ("report", "--store", "{}", "--json"),
    "json": ("import", "{}", "--store", "into.db"),
    "export": ("import", "{}", "--store", "into.db"),
}


@dataclass(frozen=True)
class Find:
    layer: str
    number: int
    what: str
    content: bytes


def placed(layer: str, content: bytes, good: bytes, folder: Path) -> list[str]:
    """The files of a call in an empty folder, and its words."""
    file = folder / LAYERS[layer].name
    file.write_bytes(content)
    if layer in ("toml", "equations"):
        (folder / "good.csv").write_bytes(good)
    if layer == "equations":
        before, _, rest = STUDY.partition(b'equations = """\n')
        (folder / "study.toml").write_bytes(
            before + b'equations = """\n' + content + b'"""\n' + rest.partition(b'"""\n')[2]
        )
    return [word.format(file.name) for word in COMMANDS[layer]]


def called(words: list[str], folder: Path) -> tuple[int, str, float, int]:
    """Exit status (negative: a signal), what stands on standard error, seconds of CPU, bytes of memory at the peak."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.chdir(folder)
            for number, name in ((1, "out"), (2, "err")):
                os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
            used = int(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]))
            resource.setrlimit(resource.RLIMIT_CPU, (used + ACCEPTED + 1, used + ACCEPTED + 2))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
            sys.argv = ["plantfit", *words]
            from plantfit.cli.main import run_cli

            try:
                run_cli()
                code = 0
            except SystemExit as end:
                code = int(end.code or 0)
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(code)
    until, ended = time.monotonic() + WAIT, 0
    while not ended:
        ended, status, spent = os.wait4(child, os.WNOHANG)
        if not ended and time.monotonic() > until:
            os.kill(child, signal.SIGKILL)
            _, status, spent = os.wait4(child, 0)
            break
        time.sleep(0.0 if ended else 0.01)
    said = (folder / "err").read_text("utf-8", errors="replace") if (folder / "err").exists() else ""
    # pyrefly: ignore[unbound-name]  (waited for once at least)
    return os.waitstatus_to_exitcode(status), said, spent.ru_utime + spent.ru_stime, spent.ru_maxrss * 1024


OWN = "made.toml"  # the study file that a call writes, which cannot be what is wrong


def judged(status: int, said: str, seconds: float, peak: int) -> str | None:
    """Why it is a find, or None."""
    if status == -signal.SIGXCPU or seconds > (SECONDS if status else ACCEPTED) + 0.5:
        return f"{seconds:.1f} s of CPU"
    if status < 0:
        return f"ended by signal {-status}: {said[-3000:]}"
    if status and OWN in said.partition(" (")[0]:
        return f"it refuses what it has written itself: {said}"
    if status == INSIDE or "Traceback" in said or "panicked" in said:
        return said
    if status == 1 or (status and not said.strip()) or said.count("\n") > LINES:
        return f"code {status} and {said.count(chr(10))} lines: {said[-3000:]}"
    return f"{peak / 2**30:.1f} GiB of memory" if peak > BYTES else None


def preload() -> None:
    """Import every room, and what they import on first use, so that calls need not; nothing of it is run before the
    fork."""
    import plantfit

    for module in pkgutil.walk_packages(plantfit.__path__, "plantfit."):
        if module.name.split(".")[1] not in ("cases", "testing", "__main__"):
            with suppress(ImportError):  # of an extra
                importlib.import_module(module.name)
    for name in ("scipy.io", "scipy.signal", "fastexcel", "jax._src.lax.linalg", "jax.scipy.linalg"):
        with suppress(ImportError):
            importlib.import_module(name)


def fuzz_cli(
    seed: int, inputs: int | None, seconds: float | None = None, layers: tuple[str, ...] = tuple(COMMANDS)
) -> tuple[Counter, list]:
    """Calls by layer and exit code, and what was found."""
    preload()
    counts, finds, number = Counter(), [], 0
    until = time.monotonic() + (float("inf") if seconds is None else seconds)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as drawing:
        good = drawing.submit(LAYERS["csv"].good).result()
        while (inputs is None or number < inputs) and time.monotonic() < until:
            layer = layers[number % len(layers)]
            content = drawing.submit(drawn, layer, seed, number).result()
            with TemporaryDirectory() as place:
                status, said, spent, peak = called(placed(layer, content, good, Path(place)), Path(place))
            counts[layer, status] += 1
            if (what := judged(status, said, spent, peak)) is not None:
                finds.append(Find(layer, number, what, content))
            number += 1
    return counts, finds


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=2000)
    parser.add_argument("--minutes", type=float)
    parser.add_argument("--seed", type=int, default=time.time_ns() % 2**31)
    parser.add_argument("--layers", default=",".join(COMMANDS))
    given = parser.parse_args()
    print(f"seed {given.seed}", flush=True)
    layers = tuple(given.layers.split(","))
    counts, finds = fuzz_cli(given.seed, given.inputs, None if given.minutes is None else 60 * given.minutes, layers)
    for layer in layers:
        print(f"{layer:10}", *(f"{n:5} x code {code}" for (of, code), n in sorted(counts.items()) if of == layer))
    print(f"{sum(counts.values())} calls, {len(finds)} finds")
    for find in finds:
        folder = Path("fuzz-finds")
        folder.mkdir(exist_ok=True)
        file = folder / f"cli-{find.layer}-{given.seed}-{find.number}"
        file.with_suffix(".input").write_bytes(find.content)
        file.with_suffix(".txt").write_text(find.what, errors="backslashreplace")
        print(f"{file}.txt: {find.what.strip().splitlines()[-1][:200]}")
    return 1 if finds else 0


if __name__ == "__main__":
    sys.exit(main())
