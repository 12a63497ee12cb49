"""The last seconds of a recording as lines of blocks in the terminal."""

from collections import deque
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

_BLOCKS = " ▁▂▃▄▅▆▇█"
_SECONDS = 10.0
_WIDTH = 40  # fits a terminal of 80 columns with names and ranges


def sparkline(values: list[float]) -> str:
    """One character for each value, between the lowest and the highest; a blank for NaN."""
    good = [v for v in values if v == v]
    if not good:
        return " " * len(values)
    low, span = min(good), max(good) - min(good)
    return "".join(" " if v != v else _BLOCKS[1 + round((v - low) / span * 7) if span else 4] for v in values)


class Traces:
    """The newest sample of each of the last `_WIDTH` slots of time, for the drive and every channel."""

    def __init__(self) -> None:
        self.slots: deque[tuple[float, ...] | None] = deque(maxlen=_WIDTH)
        self._until = 0.0

    def add(self, p: Any) -> None:
        """Take the newest sample of `p` (plantfit.rig.board.Progress); None where nothing came."""
        slot = _SECONDS / _WIDTH
        while p.seconds > self._until:
            self.slots.append(_values(p.board, p.latest[-1]) if p.latest else None)
            self._until = max(self._until + slot, p.seconds - _SECONDS)

    def lines(self, board: Any) -> list[str]:
        """A line for each signal: name, trace, range."""
        names = [(c.name, c.unit) for c in (board.drive, *board.channels)]
        width = max(len(n) for n, _ in names)
        told = []
        for k, (name, unit) in enumerate(names):
            values = [float("nan") if s is None else s[k] for s in self.slots]
            good = [v for v in values if v == v]
            reach = f"{min(good):.4g} .. {max(good):.4g} {unit}" if good else ""
            told.append(f"{name:>{width}} {sparkline(values):<{_WIDTH}} {reach}")
        return told


def headline(p: Any) -> str:
    """Counts of a recording in one line."""
    state = "" if p.connected else "   PORT AWAY, trying again"
    played = f", played {100 * p.played / p.values:.0f} %" if p.values else ""
    return (
        f"{p.seconds:.1f} s, {p.samples} samples, {p.lost} lost, {p.garbled} garbled, {p.reconnects} "
        f"reconnects{played}{state}"
    )


@contextmanager
def live_plot(quiet: bool) -> Generator[Callable[[Any], None] | None]:
    """A plot on standard error while inside; yields what takes each Progress, None where it is not shown."""
    import sys

    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.live import Live
    from rich.text import Text

    from plantfit.cli.terminal.out import err

    traces = Traces()
    with Live(Text("waiting for the board"), console=err, transient=True, auto_refresh=False) as live:

        def show(p: Any) -> None:
            traces.add(p)
            live.update(Text("\n".join([headline(p), *traces.lines(p.board)]), no_wrap=True), refresh=True)

        yield show


def _values(board: Any, sample: Any) -> tuple[float, ...]:
    channels = zip(board.channels, sample.raw, strict=False)
    return (sample.drive * board.drive.scale, *(c.scale * r + c.offset for c, r in channels))
