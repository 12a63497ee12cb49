"""Broken inputs by layer: a good file of each kind, its bytes mutated or what it holds exchanged (fuzz_shapes.py) by
a seeded generator, and what reads it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import fuzz_shapes as shapes
import numpy as np

WORDS = [
    b"nan", b"inf", b"-0", b"1e999", b"9" * 400, b"9" * 5000, b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\\ud800", b'"',
    b"'", b'"""',
    b"[" * 900, b"(" * 70, b"{" * 50, b"]]", b"\n", b"\r", b",", b";", b"\t", b"=", b"1,5", b"../x", b"null", b"true",
    b"-1", b"2147483648",
    b"18446744073709551616", "\u00dcn\u00efcode".encode(), b"delay(u, u)", b"x'' = ", b"**", b"[[1]]", b"1979-05-27",
    b"K", b"u", b"x",
    b"if", b"lambda", b"__import__('os')",
]  # fmt: skip


def mutated(good: bytes, rng: np.random.Generator) -> bytes:
    """A few changes of bytes, slices, lines and words; sometimes nothing of the good file is left."""
    data = bytearray(good)
    if rng.random() < 0.03:
        return rng.bytes(int(rng.integers(0, 3000)))
    for _ in range(int(rng.integers(1, 6))):
        at, length = int(rng.integers(0, len(data) + 1)), int(rng.integers(0, 1 + min(len(data), 40)))
        kind = int(rng.integers(0, 8))
        if kind == 0 and data:
            data[min(at, len(data) - 1)] ^= 1 << int(rng.integers(0, 8))
        elif kind == 1:
            del data[at:]
        elif kind == 2:
            del data[at : at + length]
        elif kind == 3:
            data[at:at] = data[at : at + length] * int(rng.integers(1, 5))
        elif kind == 4:
            lines = bytes(data).split(b"\n")
            rng.shuffle(lines)
            data = bytearray(b"\n".join(lines))
        elif kind == 5 and data:  # a word in place of one that is there
            words = bytes(data).split(b" ")
            words[int(rng.integers(0, len(words)))] = WORDS[int(rng.integers(0, len(WORDS)))]
            data = bytearray(b" ".join(words))
        else:
            word = WORDS[int(rng.integers(0, len(WORDS)))]
            data[at : at + (length if kind == 6 else 0)] = word
    return bytes(data)


@dataclass(frozen=True)
class Layer:
    """`read` gets a file named `name` with mutated bytes of `good()`."""

    name: str
    good: Callable[[], bytes]
    read: Callable[[Path], object]


def _frame():
    import polars as pl

    t = np.arange(40) * 0.1
    return pl.DataFrame({"t [s]": t, "u [V]": np.sin(t), "y [mm]": np.cos(t)})


def _written(name: str, write: Callable[[Path], object]) -> bytes:
    with TemporaryDirectory() as folder:
        write(Path(folder, name))
        return Path(folder, name).read_bytes()


@cache
def _csv() -> bytes:
    return _frame().write_csv().encode()


@cache
def _parquet() -> bytes:
    return _written("x.parquet", lambda p: _frame().write_parquet(p))


@cache
def _xlsx() -> bytes:
    from openpyxl import Workbook

    book = Workbook()
    frame = _frame()
    for row in [frame.columns, *frame.rows()]:
        book.active.append(row)
    return _written("x.xlsx", book.save)


@cache
def _mat() -> bytes:
    from scipy.io import savemat

    return _written("x.mat", lambda p: savemat(p, {"t": np.arange(40) * 0.1, "y": np.ones(40)}))


@cache
def _npz() -> bytes:
    return _written("x.npz", lambda p: np.savez(p, t=np.arange(40) * 0.1, y=np.ones(40)))


def _read(path: Path) -> object:
    from plantfit.recording import read

    return read(path)


STUDY = b"""name = "heater"
[recording.bench]
file = "good.csv"
time = "t [s]"
signals = { u = "u [V]", y = "y [mm]" }
split = 0.7
clean = [{ step = "lowpass", signal = "u", cutoff = 1.0 }, { step = "cut", start = 0.5 }]
[model]
equations = \"\"\"
x' = (K*delay(u, L) - x) / tau
y = x
\"\"\"
inputs = { u = "V" }
states = { x = { unit = "mm", initial = "y" } }
outputs = { y = "mm" }
[parameters.K]
bounds = [0.01, 10.0]
unit = "mm/V"
[parameters.tau]
bounds = [0.1, 50.0]
scale = "log"
unit = "s"
[parameters.L]
bounds = [0.0, 2.0]
start = 0.5
unit = "s"
[search]
methods = ["pso"]
runs = 3
budget = 100
seed = 7
[search.settings]
pso = { population = 10 }
[uncertainty.sensor]
of = "y"
kind = "gain"
limit = 1.0
unit = "%"
"""
RICH = """name = "spring"
balance = "recordings"
standard_errors = "classical"
[scales]
y = 0.5
[recording.a]
file = "good.csv"
signals = { F = "u [V]", y = "y [mm]" }
units = {}
unmeasured = ["w"]
fit = [0.5, 2.0]
validate = [2.5, 3.5]
before = { F = 0.0 }
clean = [
  { step = "fill_gaps", signal = "y", longest = 1.0 }, { step = "detrend", signal = "y" }, { step = "scale", signal = "F", factor = 2.0 },
  { step = "shift_time", seconds = 0.05 }, { step = "resample", period = 0.05 }, { step = "drop_outliers", signal = "y" },
]
[recording.b]
file = "good.csv"
period = 0.1
signals = { F = "u [V]", y = "y [mm]", w = "t [s]" }
units = {}
skip = 0.2
[model]
equations = '''
x' = v
v' = (F - friction(v, Fc, Fs) - k(x)*x - c*x)/m
z = play(delay(F, L)*a, gap)
when falling(x): v = -cr*v, x = 0
y = x + z
w = v*g0
'''
inputs = { F = "V" }
states = { x = { unit = "mm", initial = "y" }, v = { unit = "mm/s", initial = 0.0 }, z = { unit = "mm", initial = "x0" } }
outputs = { y = "mm", w = "s" }
constants = { g0 = "1.5" }
hold = { F = "linear" }
check_units = false
[model.tables.k]
over = ["x"]
nodes = [[-1.0, 0.0, 1.0]]
unit = "N/mm"
[parameters]
k = { bounds = [[0.1, 0.1, 0.1], [2.0, 2.0, 2.0]], smooth = 0.1 }
Fc = { bounds = [0.01, 1.0], start = 0.1, limits = [0.0, inf], typical = 1.0 }
Fs = { tied = "Fc" }
c = { value = 1.0 }
m = { bounds = [0.1, 10.0], scale = "log", unit = "kg" }
L = { bounds = [0.0, 0.5] }
a = { bounds = [-1.0, 1.0], per_recording = true }
gap = { bounds = [0.0, 0.2] }
cr = { bounds = [0.0, 1.0] }
x0 = { value = 0.0 }
[simulation]
stepper = "rk4"
substeps = 2
[search]
methods = ["auto", "cmaes"]
runs = 2
seed = 3
shooting = 4
settings = { cmaes = { population = 12 } }
[uncertainty.u1]
of = ["F"]
kind = "offset"
repeats = [5.007, 4.994, 5.005]
per_recording = true
[uncertainty.u2]
of = "clock"
standard = 20.0
unit = "ppm"
recordings = ["a"]
[propagation]
draws = 20
[control]
output = "y"
input = "F"
"""  # noqa: E501
EQUATIONS = b"""x1' = x2
x2' = (K*delay(u, L) - c*x2 - k(x1)*x1 + 0.1*sin(3*t)) / m
y = x1 + max(0, x2)*exp(-x1^2) - sqrt(abs(x1))
"""


def _study(path: Path) -> object:
    from plantfit.spec import load

    (path.parent / "good.csv").write_bytes(_csv())
    return load(path)


def _equations(path: Path) -> object:
    from plantfit.models import equations

    text = path.read_bytes().decode("utf-8", "surrogateescape")
    parameters = {name: {"bounds": (0.1, 2.0)} for name in ("K", "c", "m", "L", "k")}
    tables = {"k": {"over": "x1", "nodes": [-1.0, 0.0, 1.0]}}
    return equations(
        text,
        inputs={"u": None},
        states={"x1": {}, "x2": {}},
        outputs={"y": None},
        parameters=parameters,
        tables=tables,
        check=False,
    )


def _run_store(path: Path) -> None:
    from plantfit.errors import Status
    from plantfit.optimize.contract import RunResult
    from plantfit.study import Plan, Store

    store = Store.open(path)
    study = store.add(
        Plan("gearmotor", ("pso",), runs=2, budget=20),
        spec_text=STUDY.decode(),
        coordinates=("K", "L"),
        probe=b"\0" * 64,
    )
    while (claim := store.claim(study, "me")) is not None:
        history = np.array([1.0, 20.0])
        results = [
            RunResult(
                "pso", run, 1, np.array([0.5, 0.25]), 0.1, 20.0, 0.1, Status.budget, history, history[::-1], 0, {}
            )
            for run in range(claim.task.first, claim.task.first + claim.task.count)
        ]
        store.finish(claim, results, [{"K": 1.0, "L": 2.0}] * len(results))
    store.engine.dispose()


@cache
def _store() -> bytes:
    return _written("x.db", _run_store)


def _open_store(path: Path) -> object:
    from plantfit.study import Store

    for left in path.parent.glob("*.db-*"):
        left.unlink()
    store = Store.open(path, create=False, busy_timeout=0.1)
    return [
        (s.name, store.plan(s.id), store.runs(s.id), store.whole(s.id), store.counts(s.id)) for s in store.studies()
    ]


def _export(kind: str) -> bytes:
    from plantfit.study import Store

    with TemporaryDirectory() as folder:
        _run_store(Path(folder, "x.db"))
        store = Store.open(Path(folder, "x.db"))
        (store.export_json if kind == "json" else store.export_parquet)(1, Path(folder, "e"))
        return Path(folder, "e").read_bytes()


@cache
def _json() -> bytes:
    return _export("json")


@cache
def _export_parquet() -> bytes:
    return _export("parquet")


def _import(path: Path) -> object:
    from plantfit.study import Store

    for left in path.parent.glob("into.db*"):
        left.unlink()
    store = Store.open(path.parent / "into.db", busy_timeout=0.1)
    return store.runs(store.import_file(path))


def _serial() -> bytes:
    from plantfit.rig.board.protocol import encode

    lines = [
        encode("H", 1, "board", "1.0", 7, 1000000, 500, 64, 1),
        encode("A", "u", "V", 0.01, 1000),
        encode("C", 0, "w", "rad/s", 0.1, 0.0),
    ]
    return b"".join([*lines, *(encode("D", k, 1000 * k, 5, k, 1, 40 + k) for k in range(10))])


def _listen(path: Path) -> object:
    from plantfit.rig.board.protocol import Hello, Lines, Sample, encode

    lines, hello, data = Lines(), Hello(), path.read_bytes()
    framed = [
        encode(line.split(b"*")[0].decode("ascii", "replace").encode("ascii", "replace").decode())
        for line in data.split(b"\n")
    ]
    for chunk in (data, b"".join(framed)):  # as it came, and with right checksums
        for at in range(0, len(chunk), 37):
            for fields in lines.feed(chunk[at : at + 37]):
                if fields[0] in ("H", "A", "C"):
                    hello.take(fields, "port")
                elif fields[0] == "D":
                    try:
                        Sample.read(fields)
                    except (ValueError, IndexError):  # counted by the session as garbled
                        continue
    return hello.board()


LAYERS = {
    "csv": Layer("x.csv", _csv, _read),
    "parquet": Layer("x.parquet", _parquet, _read),
    "xlsx": Layer("x.xlsx", _xlsx, _read),
    "mat": Layer("x.mat", _mat, _read),
    "npz": Layer("x.npz", _npz, _read),
    "toml": Layer("x.toml", lambda: STUDY, _study),
    "equations": Layer("x.txt", lambda: EQUATIONS, _equations),
    "store": Layer("x.db", _store, _open_store),
    "json": Layer("x.json", _json, _import),
    "export": Layer("x.export", _export_parquet, _import),
    "serial": Layer("x.bin", _serial, _listen),
}


SHAPED: dict[str, Callable[[np.random.Generator], bytes]] = {
    "csv": lambda rng: shapes.cells(_csv(), rng),
    "parquet": lambda rng: shapes.frames(rng, _frame()),
    "xlsx": lambda rng: shapes.sheets(rng, _frame()),
    "mat": shapes.matrices,
    "npz": lambda rng: shapes.arrays(_npz(), rng),
    "toml": lambda rng: shapes.studies(RICH if rng.random() < 0.5 else STUDY.decode(), rng),
    "equations": lambda rng: shapes.tokens(EQUATIONS, rng),
    "store": lambda rng: shapes.rows(_store(), rng),
    "json": lambda rng: shapes.texts_of_json(_json(), rng),
    "export": lambda rng: shapes.exports(_export_parquet(), rng),
    "serial": shapes.lines,
}
SHARE = 0.6  # of inputs that a parser lets through


def drawn(layer: str, seed: int, number: int) -> bytes:
    """Input `number` of a layer: a function of its arguments alone."""
    rng = np.random.default_rng([seed, number, *layer.encode()])
    return SHAPED[layer](rng) if rng.random() < SHARE else mutated(LAYERS[layer].good(), rng)
