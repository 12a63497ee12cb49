"""Samples in the order of the board's counter to rows of a table: what did not come becomes marked, empty rows."""

from plantfit.rig.board.protocol import Board, Sample

_WRAP = 2**32
BOOKKEEPING = ("counter", "gap")  # columns beside the signals
MOST_ROWS = 100_000  # of one gap; a longer one is a single row


class Rows:
    """Cells of t [s], drive, channels, the set point of a loop, counter, gap. Times are the board's, from 0 at the
    first sample."""

    def __init__(self, board: Board, period: float, wanted: str | None = None):
        self.board, self.period = board, period  # seconds between two samples
        named = [f"{c.name} [{c.unit}]" if c.unit else c.name for c in (board.drive, *board.channels)]
        named += [] if wanted is None else [wanted]
        self.header, self._signals = ",".join(["t [s]", *named, *BOOKKEEPING]), len(named)
        self.wanted: float | None = None  # set point of the samples to come
        self.next: int | None = None  # counter that is expected
        self.t = -period  # of the last row
        self.received = self.lost = self.gaps = 0
        self._stamp: tuple[float, int] | None = None  # time of the last sample that came, and its stamp in us

    def begin(self, counter: int) -> None:
        """`counter` is that of the first sample to come."""
        self.next = counter

    def take(self, sample: Sample) -> list[str]:
        """Rows for a sample and for those that are missing before it; none for one that came already."""
        if self.next is None or len(sample.raw) != len(self.board.channels):
            return []
        ahead = (sample.counter - self.next) % _WRAP
        if ahead >= _WRAP // 2:
            return []
        t = self.t + (ahead + 1) * self.period
        if self._stamp is not None:
            t = self._stamp[0] + ((sample.us - self._stamp[1]) % _WRAP) * 1e-6
        rows = self._missing(ahead, t) if ahead else []
        self.t, self._stamp, self.next = t, (t, sample.us), (sample.counter + 1) % _WRAP
        self.received += 1
        drive, channels = self.board.drive, zip(self.board.channels, sample.raw, strict=True)
        cells = ",".join(
            f"{v:.10g}" for v in (sample.drive * drive.scale, *(c.scale * r + c.offset for c, r in channels))
        )
        if self._signals > 1 + len(self.board.channels):
            cells += "," if self.wanted is None else f",{self.wanted:.10g}"
        rows.append(f"{t:.6f},{cells},{sample.counter},0")
        return rows

    def end(self, counter: int) -> list[str]:
        """Rows for samples that were lost after the last one that came; `counter` is the first that was never made."""
        if self.next is None:
            return []
        ahead = (counter - self.next) % _WRAP
        if not 0 < ahead < _WRAP // 2:
            return []
        rows = self._missing(ahead, self.t + (ahead + 1) * self.period)
        self.next = counter
        self.t += ahead * self.period
        return rows

    def rebooted(self, counter: int, elapsed: float) -> list[str]:
        """The board was reset and starts anew at `counter`, `elapsed` s of this machine's clock after its last
        sample: one empty row."""
        row = self._empty(self.t + elapsed / 2, "")
        self.lost, self.gaps = self.lost + 1, self.gaps + 1
        self.t += max(elapsed, 2 * self.period) - self.period
        self._stamp, self.next = None, counter
        return [row]

    def _missing(self, count: int, until: float) -> list[str]:
        """Empty rows, evenly between the last row and `until` (s)."""
        self.lost, self.gaps = self.lost + count, self.gaps + 1
        shown = count if count <= MOST_ROWS else 1
        step, first = (until - self.t) / (shown + 1), self.next or 0
        return [self._empty(self.t + (k + 1) * step, str((first + k) % _WRAP)) for k in range(shown)]

    def _empty(self, t: float, counter: str) -> str:
        return f"{t:.6f},{',' * (self._signals - 1)},{counter},1"
