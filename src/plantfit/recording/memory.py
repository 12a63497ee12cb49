"""What reading a file needs of memory, and what this machine has, so that too large a file is refused before it is read."""

from pathlib import Path

TIMES = {".parquet": 12, ".npz": 6, ".mat": 6, ".xlsx": 40, ".gz": 60}  # bytes in memory for a byte of the file, estimated
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
    """Bytes that this process may still take: what the kernel calls available, within the limit of its group; None if nobody says."""
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
