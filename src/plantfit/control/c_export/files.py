"""Two files of C99, NAME.h and NAME.c: names, numbers as literals, comments and writing."""

import math
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np

from plantfit.errors import SimulationError
from plantfit.folders import may_be_written

TAKEN = """
auto break case char const continue default do double else enum extern float for goto if inline int long register restrict return short
signed sizeof static struct switch typedef union unsigned void volatile while bool catch class delete explicit export false friend mutable
namespace new operator private protected public template this throw true try typeid typename using virtual filter main
"""  # words of C and C++, and what the files themselves define


class CFiles(NamedTuple):
    """Where the two files are."""

    header: Path
    source: Path


_HEADER = Template("""/* ${told}
 * Made by plantfit.
 */
#ifndef ${UPPER}_H
#define ${UPPER}_H

${includes}#ifdef __cplusplus
extern "C" {
#endif

${declared}
#ifdef __cplusplus
}
#endif

#endif /* ${UPPER}_H */
""")


def write_c(
    folder: str | os.PathLike[str], name: str, told: Iterable[str], declared: str, defined: str, includes: str = ""
) -> CFiles:
    """Write NAME.h, which begins with the lines `told` as a comment and holds `declared`, and NAME.c with `defined`.

    Files that are there are replaced only where plantfit wrote them. Raises SimulationError where they cannot be
    written.
    """
    comment = "\n * ".join(" ".join(line.split()).replace("*/", "* /").replace("/*", "/ *") for line in told)
    header = _HEADER.substitute(UPPER=name.upper(), told=comment, includes=includes, declared=declared)
    files = CFiles(Path(folder) / f"{name}.h", Path(folder) / f"{name}.c")
    foreign = next((f for f in files if not may_be_written(f)), None)
    if foreign is not None:
        raise SimulationError(
            f"{str(foreign)!r} exists and was not written by plantfit; move it, or choose another folder or name."
        )
    try:
        files.header.write_text(header, "utf-8")
        files.source.write_text(f'/* See {name}.h. Made by plantfit. */\n#include "{name}.h"\n\n{defined}', "utf-8")
    except OSError as error:
        raise SimulationError(
            f"{str(files.header)!r} and its .c cannot be written ({error.strerror}); give a folder that exists."
        ) from None
    return files


def checked_name(name: str) -> str:
    """The name itself; raises SimulationError for one that C or a file cannot have."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or name in TAKEN.split():
        raise SimulationError(
            f"name = {name!r} cannot name things in C; give small letters, digits and _, a letter first, no word of C."
        )
    return name


def checked_number(number: str, known: tuple[str, ...]) -> str:
    """The kind of numbers itself; raises SimulationError for another."""
    if number not in known:
        raise SimulationError(f"number = {number!r}; this can be exported in {', '.join(map(repr, known))}.")
    return number


def checked_finite(values: Mapping[str, Any], number: str) -> None:
    """Raises SimulationError for a value that is not finite in `number`, "float" or "double"."""
    for name, value in values.items():
        with np.errstate(over="ignore"):
            held = np.asarray(value, dtype=np.float32 if number == "float" else np.float64)
        if not np.all(np.isfinite(held)):
            raise SimulationError(
                f"{name} = {np.asarray(value).tolist()} is not finite in {number!r}; give finite numbers."
            )


def literal(value: float, number: str) -> str:
    """A finite number as C text that reads back to the same bits of a "double" or "float"."""
    text = repr(float(value)) if number == "double" else str(np.float32(value))
    text = text if re.search(r"[.e]", text) else f"{text}.0"
    text += "f" if number == "float" else ""
    return f"({text})" if text.startswith("-") else text


def table(values: Any, number: str) -> str:
    """An array of any rank as a C initialiser."""
    array = np.asarray(values, dtype=float)
    if array.ndim == 1:
        return "{" + ", ".join(literal(v, number).strip("()") for v in array) + "}"
    return "{" + ", ".join(table(row, number) for row in array) + "}"


def clipped(what: str, lower: float, upper: float, number: str) -> str:
    """Statements that keep the variable `what` within limits; none for infinite ones."""
    lines = ""
    if math.isfinite(lower):
        lines += f"    if ({what} < {literal(lower, number)})\n        {what} = {literal(lower, number)};\n"
    if math.isfinite(upper):
        lines += f"    if ({what} > {literal(upper, number)})\n        {what} = {literal(upper, number)};\n"
    return lines
