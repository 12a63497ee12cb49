"""`plantfit --help`: the commands in the order of the work, each in one line that fits 80 columns."""

from collections.abc import Callable, Iterator, Mapping, Sequence

from plantfit.cli.options import begin, bench, fit, next_step, reference, store, understand

SECTIONS: Mapping[str, Mapping[str, tuple[Callable[..., None], str]]] = {
    "Begin": begin.COMMANDS,
    "Fit": fit.COMMANDS,
    "Understand": understand.COMMANDS,
    "Next step": next_step.COMMANDS,
    "Bench": bench.COMMANDS,
    "Store": store.COMMANDS,
    "Reference": reference.COMMANDS,
}
"""What each command takes and its line, by name and section."""


def sections(commands: Sequence[str]) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """Title and (command, line) of each section, names padded to one width; commands that no section names come
    last."""
    width = max(map(len, commands), default=0)
    named = {name for rows in SECTIONS.values() for name in rows}
    lines = {title: {name: said for name, (_, said) in rows.items()} for title, rows in SECTIONS.items()}
    for title, rows in (*lines.items(), ("More", {name: "" for name in commands if name not in named})):
        if own := [(name.ljust(width), said) for name, said in rows.items() if name in commands]:
            yield title, own
