"""How many worker processes pay on this machine."""

import os
from pathlib import Path

WORKER_MEMORY = 0.6e9  # bytes that a worker takes beside the problem: jax, its compiled loops, scipy


def physical_cores(cpus: Path = Path("/sys/devices/system/cpu")) -> int:
    """Cores that this process may use, hyperthreads counted once; logical ones where that is not told."""
    own = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
    cores = set()
    for cpu in own:
        try:
            cores.add((cpus / f"cpu{cpu}" / "topology" / "thread_siblings_list").read_text(encoding="ascii").strip())
        except OSError:
            cores.add(str(cpu))
    return max(len(cores), 1)


def quota(group: Path = Path("/sys/fs/cgroup")) -> float:
    """CPUs that the container of this process may use at once; infinite outside one."""
    try:
        limit, period = (group / "cpu.max").read_text(encoding="ascii").split()
        return float("inf") if limit == "max" else int(limit) / int(period)
    except (OSError, ValueError):
        return float("inf")


def free_memory(meminfo: Path = Path("/proc/meminfo")) -> float:
    """Bytes that new processes can get; infinite where that is not told."""
    try:
        rows = dict(line.split(":", 1) for line in meminfo.read_text(encoding="ascii").splitlines())
        return 1024.0 * float(rows["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        return float("inf")


def sensible_workers() -> int:
    """One for each physical core, as far as memory and the container allow."""
    return max(1, int(min(physical_cores(), quota(), free_memory() / WORKER_MEMORY)))
