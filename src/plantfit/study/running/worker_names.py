"""Who holds a task: a name for this process, and whether the process behind a name still lives."""

import os
import platform
import uuid
from pathlib import Path

STALE_SECONDS = 60.0
AHEAD_SECONDS = 3600.0  # clocks of machines that share a store differ by less


def new_worker(place: str = "") -> str:
    """A name no other worker has: machine, process id, start of the process, a random part.

    `place` says where the work is done if this process only speaks for another one.
    """
    pid = os.getpid()
    return f"{_machine()}|{pid}|{_started(pid)}|{uuid.uuid4().hex} {place}".rstrip()


def where(worker: str) -> str:
    """A name as people read it: "process 4711 on host", or the place that the name has."""
    machine, pid, _, rest = worker.split("|")
    return rest.partition(" ")[2] or f"process {pid} on {machine.partition('/')[0]}"


def is_stale(claimed_by: str | None, heartbeat: float | None, now: float) -> bool:
    """Whether a claim may be taken over: none, silent for a minute, or its process has ended here."""
    if claimed_by is None or heartbeat is None:
        return True
    # a holder that lives beats by the clock as it is now: a sign of life from far ahead was given before the clock was
    # set back
    return now - heartbeat > STALE_SECONDS or heartbeat - now > AHEAD_SECONDS or _has_ended(claimed_by)


def _has_ended(worker: str) -> bool:
    """True only when sure: a process of this machine that is gone. Elsewhere the heartbeat decides."""
    machine, pid, started, _ = worker.split("|")
    if machine != _machine() or os.name != "posix":
        return False
    try:
        os.kill(int(pid), 0)  # signal 0 only asks
    except ProcessLookupError:
        return True
    except PermissionError:
        return False
    return started != _started(int(pid))  # a later process may have got the same id


def _machine() -> str:
    """Host name with, on Linux, the process namespace: containers may share a host name."""
    try:
        namespace = os.readlink("/proc/self/ns/pid")
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        namespace = boot = ""
    return f"{platform.node()}/{boot}/{namespace}".replace("|", "")


def _started(pid: int) -> str:
    """Start of a process in clock ticks since boot, "" where that is not told or it is a zombie."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    except OSError:
        return ""
    return "" if fields[0] in "ZX" else fields[19]
