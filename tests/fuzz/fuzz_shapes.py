"""Inputs that a parser lets through and that are wrong inside: trees with other values, tables with other cells,
archives with right checksums around wrong content. Each function is one of a seeded generator alone; `shaped` has
one for each layer."""

import copy
import io
import json
import re
import sqlite3
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

Draw = np.random.Generator

VALUES: list[Any] = [
    True, False, 0, 1, -1, 2, 3, 0.5, -0.0, 1e-320, 1e300, -1e300, float("nan"), float("inf"), float("-inf"), 2**31,
    2**63, -(2**63) - 1,
    10**400, "", " ", "x", "u", "y", "K", "t", "nan", "-1", "\0", "\ud800", "../x", "/", "%s{0}", "x" * 5000,
    "1 furlong/fortnight",
    "degC", "m**1e9", "1e999 m", "s^-1/2", "x' = -x", "9" * 400, [], {}, [[]], [[1]], [1, 2], [2, 1], [0, 0],
    [float("nan"), 1],
    ["a", "a"], [1e300, 1e308], [1] * 300, {"a": 1}, {"": {}}, {"x": {"unit": 1}}, {"from": 0, "to": 1, "count": 10**9},
    {"u": [1, 0]},
    "auto", "pso", "log", "linear", "previous", "clock", "true",
]  # fmt: skip
KEYS = [
    "name", "scales", "standard_errors", "diagnose", "balance", "file", "time", "time_unit", "period", "signals",
    "units", "sheet", "sort",
    "split", "fit", "validate", "skip", "before", "initial_time", "steady", "shared_errors", "unmeasured", "clean",
    "step", "kind",
    "options",
    "equations", "inputs", "outputs", "states", "initial", "constants", "hold", "clock_shift", "extensions",
    "check_units", "tables",
    "over",
    "nodes", "unit", "bounds", "value", "scale", "limits", "typical", "start", "smooth", "tied", "per_recording",
    "sentence", "of", "limit",
    "standard", "expanded", "k", "repeats", "shape", "span", "degrees_of_freedom", "recordings", "draws", "propagation",
    "stepper",
    "substeps", "methods", "runs", "budget", "seed", "settings", "shooting", "population", "control", "output", "input",
    "simulation",
    "search", "uncertainty", "parameters", "model", "recording", "", "\0", "x" * 300, "u", "y", "x", "K", "tau",
]  # fmt: skip


def one(rng: Draw, of: list) -> Any:
    return of[int(rng.integers(len(of)))]


def bent(tree: Any, rng: Draw, changes: int | None = None) -> Any:
    """A copy of a tree of dicts and lists with a few values, keys and branches exchanged."""
    tree = json.loads(json.dumps(tree))
    for _ in range(changes or int(rng.integers(1, 3))):
        places = list(_places(tree))
        if not places:
            return _value(rng)
        parent, key = one(rng, places)
        kind = int(rng.integers(12))
        if kind <= 3:
            parent[key] = _near(parent[key], rng)
        elif kind <= 6:
            parent[key] = _value(rng)
        elif kind == 7:
            del parent[key]
        elif kind == 8 and isinstance(parent, dict):  # another name
            parent[one(rng, KEYS)] = parent.pop(key)
        elif kind == 9:  # what stands elsewhere
            other, at = one(rng, places)
            parent[key] = json.loads(json.dumps(other[at])) if _has(other, at) else None
        elif kind == 10 and isinstance(parent, dict):  # one more
            parent[one(rng, KEYS)] = _value(rng)
        else:
            deep = int(rng.integers(1, 4)) if rng.random() < 0.9 else 150
            for _ in range(deep):
                parent[key] = [parent[key]] if rng.random() < 0.5 else {one(rng, KEYS): parent[key]}
    return tree


def _value(rng: Draw) -> Any:
    """A value of its own: what is changed in it later is no value of another input, and it never holds itself."""
    return copy.deepcopy(one(rng, VALUES))


def _near(value: Any, rng: Draw) -> Any:
    """A value of the same kind."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        if not abs(value) < 1e150:
            return -value
        return one(
            rng,
            [
                -value,
                0,
                value * 1e3,
                value * 1e-3,
                value * 1e9,
                value + 1,
                int(value),
                value * 1e-9,
                value * 1e150,
                float(value),
            ],
        )
    if isinstance(value, str):
        at = int(rng.integers(len(value) + 1))
        other = one(rng, TOKENS) if len(value) > 40 else one(rng, ["", " ", "x", "1", "/", "^2", "'", "u", "s"])
        return value[:at] + other + value[at + int(rng.integers(3)) :]
    return list(reversed(value)) if isinstance(value, list) else value


def _places(tree: Any):
    for key in list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ():
        yield tree, key
        yield from _places(tree[key])


def _has(parent: Any, key: Any) -> bool:
    return key in parent if isinstance(parent, dict) else key < len(parent)


def toml(value: Any) -> str:
    """A value as TOML in one line; None becomes an empty text."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(k))} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value or "") if isinstance(value, str | None) else repr(value)


def studies(text: str, rng: Draw) -> bytes:
    import tomllib

    tree = bent(tomllib.loads(text), rng)
    if not isinstance(tree, dict):
        tree = {"name": tree}
    return "\n".join(f"{json.dumps(key)} = {toml(value)}" for key, value in tree.items()).encode(errors="surrogatepass")


def texts_of_json(text: bytes, rng: Draw) -> bytes:
    return json.dumps(bent(json.loads(text), rng)).encode()


CELLS = [
    "", " ", "nan", "NaN", "inf", "-inf", "NA", "null", "1e400", "-0", "1,5", "1.5.2", "0x10", "1_000", "9" * 400, "٣",
    "½", "1e5", "+-1",
    "TRUE",
    "2020-02-30", "2020-01-01 00:00:00", "12:00", "\0", '"', "'", "#", ";", "\ufeff", "\u2028", "=1+1", "u [V]", "1 V",
    "\u22121", "1e-400",
    "\udcff",
]  # fmt: skip


def cells(text: bytes, rng: Draw) -> bytes:
    """A CSV file with other cells, columns, rows, delimiters, ends of lines and alphabets."""
    rows = [line.split(",") for line in text.decode().splitlines()]
    for _ in range(int(rng.integers(1, 4))):
        row, column = int(rng.integers(len(rows))), int(rng.integers(min(map(len, rows))))
        kind = int(rng.integers(9))
        if kind <= 2:
            rows[row][column] = one(rng, CELLS)
        elif kind == 3:  # a whole column
            for r in rows[int(rng.integers(2)) :]:
                r[column] = one(rng, CELLS)
        elif kind == 4:
            same = one(rng, CELLS)
            for r in rows[1:]:
                r[column] = same
        elif kind == 5:
            rows[row:row] = [list(rows[row])] * int(rng.integers(1, 4))
        elif kind == 6:
            rows[:] = rows[: int(rng.integers(1, 4))]
        elif kind == 7:
            rows[0][column] = one(
                rng, ["", "t", "time [ms]", "u [V]", "[]", "x [furlong]", "a" * 5000, "u [V] [A]", "t [s", "%"]
            )
        else:
            for r in rows:
                r[column:column] = [r[column]]
    lines = [one(rng, [",", ";", "\t", "|", " "]) if rng.random() < 0.3 else ","][0]
    whole = one(rng, ["\n", "\r\n", "\r"]).join(lines.join(r) for r in rows)
    if rng.random() < 0.2:
        whole = one(rng, ["# a comment\n", "\n\n", "sep=;\n", "name;value\n\n", "\ufeff"]) + whole
    code = one(rng, ["utf-16", "utf-8-sig", "latin-1", "cp1252", "utf-32"]) if rng.random() < 0.2 else "utf-8"
    return whole.encode(code, "surrogatepass" if code.startswith("utf") else "replace")


def columns(rng: Draw, good: Any) -> Any:
    """A polars frame with columns of other kinds."""
    import polars as pl

    n, frame = good.height, good
    others = [
        pl.Series([None] * n), pl.Series([[1.0, 2.0]] * n), pl.Series([{"a": 1}] * n), pl.Series(["x"] * n),
        pl.Series([b"\xff"] * n),
        pl.Series(np.arange(n), dtype=pl.UInt64) + (2**63), pl.Series([True] * n), pl.Series([float("nan")] * n),
        pl.Series([float("inf")] * n), pl.Series(["1,5"] * n),
        pl.Series(np.arange(n)).cast(pl.Datetime("us")).dt.replace_time_zone("UTC"),
        pl.Series(np.arange(n)).cast(pl.Date), pl.Series(np.arange(n)).cast(pl.Duration("ms")),
        pl.Series(np.arange(n)).cast(pl.Time),
        pl.Series(["a", "b"] * (n // 2) + ["a"] * (n % 2)).cast(pl.Categorical), pl.Series(np.arange(n)[::-1].copy()),
        pl.Series(np.zeros(n)), pl.Series(np.full(n, 1e308)), pl.Series(np.full(n, -1e308)),
        pl.Series(np.arange(n)).cast(pl.Decimal(38,
        5)),
        pl.Series(np.where(np.arange(n) % 2, 1e308, -1e308)), pl.Series([[]] * n, dtype=pl.List(pl.Float64)),
        pl.Series(["2020-01-01"] * n), pl.Series(np.arange(n)).cast(pl.Int8),
    ]  # fmt: skip
    for _ in range(int(rng.integers(1, 4))):
        name = one(rng, frame.columns) if frame.columns else "t [s]"
        kind = int(rng.integers(6))
        if kind <= 2:
            column = one(rng, others)
            frame = frame.with_columns(pl.Series(name, column)) if frame.height == n else frame
        elif kind == 3:
            other = one(rng, ["", "t", "time [ms]", "\0", "x" * 3000, "u [furlong]", "[", "nan"])
            frame = frame if other in frame.columns else frame.rename({name: other}, strict=False)
        elif kind == 4:
            frame = frame.drop(name)
        else:
            frame = frame.head(int(rng.integers(0, 3)))
    return frame


def frames(rng: Draw, good: Any, metadata: dict[str, str] | None = None) -> bytes:
    with TemporaryDirectory() as folder:
        place = Path(folder, "x")
        columns(rng, good).write_parquet(place, **({} if metadata is None else {"metadata": metadata}))
        return place.read_bytes()


def exports(content: bytes, rng: Draw) -> bytes:
    """A study exported to Parquet with another tree in its metadata or other columns."""
    import polars as pl

    frame, held = pl.read_parquet(io.BytesIO(content)), pl.read_parquet_metadata(io.BytesIO(content))
    text = held["plantfit"]
    if rng.random() < 0.7:
        text = json.dumps(bent(json.loads(text), rng))
        with TemporaryDirectory() as folder:
            frame.write_parquet(Path(folder, "x"), metadata={"plantfit": text})
            return Path(folder, "x").read_bytes()
    return frames(rng, frame, {"plantfit": text})


def sheets(rng: Draw, good: Any) -> bytes:
    """A workbook with other cells, sheets and names."""
    import datetime as dt

    from openpyxl import Workbook

    book = Workbook()
    sheet: Any = book.active
    rows = [list(good.columns), *map(list, good.rows())]
    odd = [
        "=1/0", "=A1", "#N/A", "", None, True, dt.datetime(2020, 1, 1), dt.time(12), dt.timedelta(days=-1), 1e308,
        -1e308, 10**14,
        "x" * 5000,
        "1,5", "u [V]", dt.date(1900, 1, 1), "nan",
    ]  # fmt: skip
    for _ in range(int(rng.integers(1, 5))):
        row, column = int(rng.integers(len(rows))), int(rng.integers(len(rows[0])))
        kind = int(rng.integers(5))
        if kind <= 1:
            rows[row][column] = one(rng, odd)
        elif kind == 2:
            for r in rows[1:]:
                r[column] = one(rng, odd)
        elif kind == 3:
            kept = int(rng.integers(len(good.columns) + 1))
            rows[row] = rows[row][:kept] + [None] * (len(good.columns) - kept)
        else:
            del rows[int(rng.integers(1, len(rows) + 1)) :]
    for r in rows:
        sheet.append(r)
    if rng.random() < 0.2:
        sheet.merge_cells("A1:B2")
    if rng.random() < 0.2:
        book.create_sheet(one(rng, ["2", "Ü", "x" * 31]), 0)
    buffer = io.BytesIO()
    book.save(buffer)
    return rezipped(buffer.getvalue(), rng, 0.5)


def rezipped(archive: bytes, rng: Draw, chance: float, changed: Callable[[bytes, Draw], bytes] | None = None) -> bytes:
    """The archive packed again at a fixed time, with right checksums; by chance one member is changed or left out."""
    from fuzz_inputs import mutated

    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(archive)) as old, zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as new:
        hit = one(rng, old.namelist()) if rng.random() < chance else None
        for name in old.namelist():
            content = re.sub(
                rb"(<dcterms:(?:created|modified)[^>]*>)[^<]*", rb"\g<1>2020-01-01T00:00:00Z", old.read(name)
            )
            if name == hit:
                if rng.random() < 0.1:
                    continue
                content = (changed or mutated)(content, rng)
            new.writestr(zipfile.ZipInfo(name, (2020, 1, 1, 0, 0, 0)), content)
    return buffer.getvalue()


def _array_file(content: bytes, rng: Draw) -> bytes:
    """An .npy file whose header says something else."""
    from fuzz_inputs import mutated

    head, _, data = content[10:].partition(b"\n")
    for _ in range(int(rng.integers(1, 3))):
        old, new = one(rng, [(b"'<f8'", b"'%s'" % one(rng,
                                                      [b"<i8", b">f8", b"|O", b"<U9", b"<c16", b"|b1", b"<M8[s]",
                                                       b"<f2", b"|V8",
        b"x"])),
                             (b"(40,)", one(rng, [b"()", b"(0,)", b"(-1,)", b"(40, 1)", b"(2, 20)",
                                                  b"(10000000000000,)", b"(41,)",
                             b"('a',)"])),
                             (b"False", one(rng, [b"True", b"None", b"1"]))])  # fmt: skip
        head = head.replace(old, new)
    if rng.random() < 0.3:
        data = mutated(data, rng)
    head = head.rstrip()
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    return content[:8] + len(head).to_bytes(2, "little") + head + data


def arrays(content: bytes, rng: Draw) -> bytes:
    return rezipped(content, rng, 1.0, _array_file)


def matrices(rng: Draw) -> bytes:
    """A MATLAB file of arrays that are not columns of numbers."""
    from scipy.io import savemat
    from scipy.sparse import csc_array

    n = 40
    held: dict[str, Any] = {"t": np.arange(n) * 0.1, "y": np.ones(n)}
    odd = [
        np.ones((n, 2)), np.ones((2, n, 2)), np.array([]), np.float64(3.0), "text", np.array(["a"] * n, object),
        csc_array(np.eye(n)),
        np.ones(n) * 1j, {"a": 1.0}, {"t": np.arange(n), "y": np.ones(n)}, np.ones(n, bool), np.ones(n, np.int8),
        np.full(n, np.nan),
        np.full(n, np.inf), np.arange(n)[::-1], np.array([("a", 1.0)], dtype=[("n", object), ("v", float)]),
        np.full(n, 2**63, np.uint64),
    ]  # fmt: skip
    for _ in range(int(rng.integers(1, 3))):
        held[one(rng, ["t", "y", "z", "s"])] = one(rng, odd)
    buffer = io.BytesIO()
    savemat(buffer, held, do_compression=rng.random() < 0.5)
    content = bytearray(buffer.getvalue())
    content[:116] = b"MATLAB 5.0 MAT-file".ljust(116)  # else it holds the time
    return bytes(content)


ROW_VALUES: list[Any] = [
    None, 0, 1, -1, 2**62, 0.5, 1e308, float("inf"), "", "x", "nan", "[]", "{}", "null", "[1]", '{"a": 1}', '"x"',
    "9" * 400, b"", b"\0",
    b"\xff" * 8, b"\0" * 8000, "\0", "done", "open", "running", "interrupted", "pso", "[" * 2000, '{"name": 1e400}',
    '"\\ud800"',
]  # fmt: skip


_TABLES = "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%' ORDER BY name"


def rows(content: bytes, rng: Draw) -> bytes:
    """A study database with other values in its rows."""
    with TemporaryDirectory() as folder:
        place = Path(folder, "x.db")
        place.write_bytes(content)
        link = sqlite3.connect(place, isolation_level=None)
        for pragma in ("ignore_check_constraints = ON", "foreign_keys = OFF", "journal_mode = DELETE"):
            link.execute(f"PRAGMA {pragma}")
        names = [r[0] for r in link.execute(_TABLES)]
        for _ in range(int(rng.integers(1, 4))):
            table = one(rng, names)
            facts = link.execute(f"SELECT name FROM pragma_table_info('{table}')").fetchall()
            column, value = one(rng, facts)[0], one(rng, ROW_VALUES)
            if rng.random() < 0.4:
                held = link.execute(f'SELECT "{column}" FROM {table}').fetchall()
                value = _like(held[0][0] if held else None, rng)
            where = "" if rng.random() < 0.5 else f" WHERE rowid = {int(rng.integers(0, 3))}"
            kind = int(rng.integers(12))
            said = (
                f"DELETE FROM {table}{where}" if kind == 0
                else f"ALTER TABLE {table} DROP COLUMN \"{column}\"" if kind == 1
                else f"UPDATE OR REPLACE {table} SET \"{column}\" = ?{where}"
            )  # fmt: skip
            try:
                link.execute(said, () if kind <= 1 else (value,))
            except (sqlite3.Error, OverflowError, UnicodeError):  # a constraint that cannot be switched off
                continue
        link.close()
        return place.read_bytes()


def _like(held: Any, rng: Draw) -> Any:
    """A value that is nearly what stands there."""
    from fuzz_inputs import mutated

    if isinstance(held, str) and held[:1] in "[{" and held:
        with suppress(ValueError, RecursionError):  # what an earlier change left there
            return json.dumps(bent(json.loads(held), rng))
    if isinstance(held, str):
        return mutated(held.encode(), rng).decode("utf-8", "replace")
    if isinstance(held, bytes):
        return mutated(held, rng)
    return held * one(rng, [-1, 0, 2, 1e300]) if isinstance(held, int | float) else held


TOKEN = re.compile(r"[A-Za-z_]\w*'*|\d+\.?\d*(?:e[+-]?\d+)?|\*\*|[<>=!]=|\S|\n")
TOKENS = [
    "x1", "x2", "x1'", "x2'", "u", "y", "K", "t", "k", "k(x1)", "k(x1, x2)", "k()", "pi", "e", "inf", "nan", "1e308",
    "1e-308", "0", "-1",
    "2",
    "0.5", "+", "-", "*", "/", "^", "**", "(", ")", ",", "=", "==", "<", ">", "<=", "!=", "and", "or", "not", "\n", ";",
    "#", "'", "''",
    "when",
    "falling", "rising", ":", "delay(x1, L)", "delay(u, -1)", "delay(delay(u, L), L)", "delay(u, x1)", "delay(u, 1e9)",
    "sin", "exp(",
    "log(",
    "sqrt(", "max(", "min(", "abs(", "atan2(", "clip(", "where(", "if", "else", "sign(", "tanh(", "friction(x2, K, L)",
    "play(u, K)",
    "deadzone(",
    "coulomb(", "ceil(", "floor(", "mod(", "%", "//", "1/0", "0^-1", "0^0", "x1^x1^x1^x1", "[", "]", "{", "}", ".", "@",
    "~", "|", "&",
    "lambda",
    "\"", "\\", "\u00b2", "\u03b1", "\u2212", "der(x1)", "initial", "x3' = x3\n", "y = 1\n", "2x", "x1.real", "9" * 400,
]  # fmt: skip


NUMBERS = ["0", "0.0", "1e308", "1e-308", "1e999", "3", "0.5", "9" * 400, "1e-400", "100000"]
ALIKE = [
    ["x1", "x2", "u", "K", "L", "c", "m", "t", "pi", "y", "k(x1)", "delay(u, L)", "delay(x1, L)", "delay(x2, 0.5)",
     *NUMBERS],
    ["x1'", "x2'", "x1''", "y", "x1", "z", "u", "K'"], ["+", "-", "*", "/", "^", "**"],
    ["sin", "exp", "sqrt", "abs", "max", "min", "tanh", "sign", "log", "floor", "mod", "atan2", "where", "delay", "k",
     "friction", "play",
    "deadzone"],
    ["(", ")"], [",", "\n", ";"],
]  # fmt: skip


def tokens(text: bytes, rng: Draw) -> bytes:
    """Equations with other words and signs."""
    found = TOKEN.findall(text.decode())
    for _ in range(int(rng.integers(1, 5))):
        at, kind = int(rng.integers(len(found) + 1)), int(rng.integers(10))
        if kind >= 6 and at < len(found):  # one that may stand there
            found[at] = one(
                rng, next((same for same in ALIKE if found[at] in same), NUMBERS if found[at][0].isdigit() else ["x2"])
            )
        elif kind <= 1:
            found[at : at + 1] = [one(rng, TOKENS)]
        elif kind == 2:
            found[at:at] = [one(rng, TOKENS)]
        elif kind == 3:
            del found[at : at + int(rng.integers(1, 5))]
        elif kind == 4:
            piece = found[at : at + int(rng.integers(1, 12))]
            to = int(rng.integers(len(found) + 1))
            found[to:to] = piece * (1 if rng.random() < 0.95 else 60)
        else:
            depth = int(rng.integers(1, 4)) if rng.random() < 0.95 else int(rng.integers(30, 400))
            name = one(rng, ["", "sin", "exp", "-", "sqrt", "abs"])
            found[at : at + 1] = [f"{name}(" * depth, *(found[at : at + 1] or ["x1"]), ")" * depth]
    return " ".join(found).encode()


FIELDS = [
    "", "0", "-1", "nan", "inf", "1e400", "9" * 50, "2147483648", "18446744073709551616", "0x10", "1.5", "x", "u", "w",
    "V", "furlong",
    "\x7f",
    " ", "%", "65536", "-0", "1_0", "+1", "T", "H", "A", "C", "D",
]  # fmt: skip


def lines(rng: Draw) -> bytes:
    """What a board says, with right checksums and wrong fields, in another order."""
    from plantfit.rig.board.protocol import encode

    said: list[list[Any]] = [
        ["H", 1, "board", "1.0", 7, 1000000, 500, 64, 1], ["A", "u", "V", 0.01, 1000], ["C", 0, "w", "rad/s", 0.1, 0.0],
        *(["D", k, 1000 * k, 5, k, 1, 40 + k] for k in range(10)),
    ]  # fmt: skip
    for _ in range(int(rng.integers(1, 5))):
        line, kind = int(rng.integers(len(said))), int(rng.integers(6))
        if kind <= 2:
            said[line][int(rng.integers(len(said[line])))] = one(rng, FIELDS)
        elif kind == 3:
            said[line] = said[line][: int(rng.integers(1, len(said[line]) + 1))] + [one(rng, FIELDS)] * int(
                rng.integers(0, 3)
            )
        elif kind == 4:
            said[line:line] = [list(said[line])] * int(rng.integers(1, 4))
        else:
            said.insert(int(rng.integers(len(said))), said.pop(line))
    return b"".join(encode(str(fields[0]) or "?", *fields[1:]) for fields in said)
