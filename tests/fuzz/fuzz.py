"""Feed broken inputs to every layer and count what comes of them:  python tests/fuzz/fuzz.py --minutes 5 --seed 1

A find is an exception that is not one of plantfit's, a sentence that is none, more than 10 s of CPU, or 2 GB of memory
more than before. Each is written to `fuzz-finds/` with its traceback; it becomes a regression test in test_fuzz.py.
"""

import argparse
import re
import resource
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parent))
from fuzz_inputs import LAYERS, drawn

from plantfit.cli.terminal.failures import shortened
from plantfit.errors import PlantfitError

SECONDS, BYTES = 10.0, 2 * 2**30
# words of Python and its libraries about code, which tell a user nothing about a file
CODE = re.compile(
    r"ufunc|<class '|object at 0x|NoneType|unsupported operand|has no attribute|not subscriptable|indices must "
    r"be|required positional arg"
    r"|object (is not|cannot)|a real number, not|not supported between|could not be broadcast|\bbool\(\)|loop with "
    r"signature"
)


@dataclass(frozen=True)
class Find:
    layer: str
    number: int
    what: str
    content: bytes


class Hang(BaseException):
    """More CPU time than an input may take."""


@contextmanager
def limited() -> Generator[None]:
    def stop(number: int, frame: object) -> None:
        raise Hang(f"more than {SECONDS:g} s of CPU")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def fed(layer: str, content: bytes, folder: Path) -> tuple[str, str]:
    """("read" or "refused" or "find", what was said)."""
    file = folder / LAYERS[layer].name
    file.write_bytes(content)
    said = ""
    try:
        with limited():
            LAYERS[layer].read(file)
        return "read", ""
    except PlantfitError as error:
        said = shortened(str(error))  # as the command line does
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return "find", "".join(traceback.format_exception(error))
    if not said.strip() or len(said) > 2000 or "Traceback" in said:
        return "find", f"a sentence of {len(said)} characters: {said[:3000]}"
    if found := CODE.search(said):
        return "find", f"a sentence that speaks of code ({found[0]!r}): {said}"
    return "refused", said


def _peak() -> int:
    """Bytes that this process has held at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def fuzz(
    seed: int, inputs: int | None = None, seconds: float | None = None, layers: tuple[str, ...] = tuple(LAYERS)
) -> tuple[Counter, list[Find]]:
    """Inputs by layer and outcome, and what was found; ends after so many inputs or seconds."""
    layers, counts, before = layers or tuple(LAYERS), Counter(), _peak()
    finds: list[Find] = []
    until = time.monotonic() + (seconds if seconds is not None else float("inf"))
    with TemporaryDirectory() as place, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        number = 0
        while (inputs is None or number < inputs) and time.monotonic() < until:
            layer = layers[number % len(layers)]
            content = drawn(layer, seed, number)
            outcome, said = fed(layer, content, Path(place))
            counts[layer, outcome] += 1
            if outcome == "find":
                finds.append(Find(layer, number, said, content))
            number += 1
    peak = _peak()
    if peak - before > BYTES:  # a process that runs other tests too may be large already
        finds.append(Find("all", number, f"{peak / 2**30:.1f} GiB of memory at the peak", b""))
    return counts, finds


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float)
    parser.add_argument("--inputs", type=int)
    parser.add_argument("--seed", type=int, default=time.time_ns() % 2**31)
    parser.add_argument("--layers", default=",".join(LAYERS))
    given = parser.parse_args()
    minutes = 5.0 if given.minutes is None and given.inputs is None else given.minutes
    print(f"seed {given.seed}", flush=True)
    counts, finds = fuzz(
        given.seed, given.inputs, None if minutes is None else 60 * minutes, tuple(given.layers.split(","))
    )
    for layer in LAYERS:
        own = {outcome: counts[layer, outcome] for outcome in ("read", "refused", "find")}
        if any(own.values()):
            print(f"{layer:10}", *(f"{n:7} {outcome}" for outcome, n in own.items()))
    print(f"{sum(counts.values())} inputs, {len(finds)} finds")
    for find in finds:
        folder = Path("fuzz-finds")
        folder.mkdir(exist_ok=True)
        file = folder / f"{find.layer}-{given.seed}-{find.number}"
        file.with_suffix(".input").write_bytes(find.content)
        file.with_suffix(".txt").write_text(find.what, errors="backslashreplace")
        print(f"{file}.txt: {find.what.strip().splitlines()[-1][:200]}")
    return 1 if finds else 0


if __name__ == "__main__":
    sys.exit(main())
