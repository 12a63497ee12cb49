"""What reading a file needs of memory, and what this machine has, so that too large a file is refused before it is
read."""

from pathlib import Path

# bytes in memory for a byte of the file. Measured by `python -m benchmarks.reading memory`, numbers of 17 digits to
# cells of one digit: text 1.5 to 6 at once and 7 to 23 line by line, gzip 6 to 24, Parquet 5 to 65, npz 2.3 to 4 and
# packed 2.9 to 31, mat
# 2.4 to 4 and packed 3.1 to 36, xlsx 9 to 25. What is packed so well is small, so that a refusal by the worst of them
# would be wrong more often.
TIMES = {".parquet": 12, ".npz": 6, ".mat": 6, ".xlsx": 25, ".gz": 24}
TIMES_OF_TEXT = 12


def memory_needed(file: Path) -> int:
    """Bytes, roughly."""
    return file.stat().st_size * TIMES.get(file.suffix.lower(), TIMES_OF_TEXT)


def _reclaimable(group: Path) -> int:
    """Bytes of cached files that the kernel gives back when memory is wanted; they count as used."""
    try:
        fields = dict(line.split() for line in (group / "memory.stat").read_text(encoding="ascii").splitlines())
    except (OSError, ValueError):
        return 0
    return int(fields.get("inactive_file", 0)) + int(fields.get("active_file", 0))


def free_memory(meminfo: Path = Path("/proc/meminfo"), group: Path = Path("/sys/fs/cgroup")) -> int | None:
    """Bytes that this process may still take: what the kernel calls available, within the limit of its group; None
    if nobody says."""
    free = []
    try:
        fields = dict(line.split(":", 1) for line in meminfo.read_text(encoding="ascii").splitlines())
        free.append(1024 * int(fields["MemAvailable"].split()[0]))
    except (OSError, ValueError, KeyError):
        pass
    try:
        most, used = ((group / name).read_text(encoding="ascii") for name in ("memory.max", "memory.current"))
        free.append(int(most) - int(used) + _reclaimable(group))  # "max" is no limit
    except (OSError, ValueError):
        pass
    return max(0, min(free)) if free else None
