"""Reading a recording of two million samples (CSV) and checking it, against polars reading the same file into a frame.

python -m benchmarks.reading          a process for each reading, taken in turns; the medians and their ratios
python -m benchmarks.reading memory   what each format takes of memory for a byte of its file
(recording/readers/memory.py)
"""

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

SAMPLES = 2_000_000
TURNS = 5
_READ = """
import resource, sys, time
import polars, plantfit.recording
read = plantfit.recording.read if sys.argv[1] == "plantfit" else polars.read_csv
def peak():  # of this program; that of getrusage may be the parent's
    try:
        return next(1024 * int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM"))
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
read(sys.argv[2])  # what is imported and set up once
before, started, cpu = peak(), time.perf_counter(), time.process_time()
found = read(sys.argv[3])
print(time.perf_counter() - started, time.process_time() - cpu, peak() - before)
"""


def frame(samples: int) -> pl.DataFrame:
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(3, samples))
    return pl.DataFrame(
        {"t [s]": np.arange(samples) * 1e-3, "u [V]": noise[0], "w [rad/s]": np.cumsum(noise[1]), "i [A]": noise[2]}
    )


def reading(who: str, small: Path, large: Path) -> tuple[float, ...]:
    """Seconds, seconds of CPU, and bytes of memory more than before, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", _READ, who, str(small), str(large)], check=True, capture_output=True, text=True
    )
    return tuple(float(word) for word in done.stdout.split())


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures."""
    with tempfile.TemporaryDirectory() as folder:
        small, large = Path(folder, "small.csv"), Path(folder, "large.csv")
        frame(100).write_csv(small)
        frame(SAMPLES).write_csv(large)
        size = large.stat().st_size
        taken = {who: [] for who in ("polars", "plantfit")}
        for _ in range(2 if quick else TURNS):
            for who, list_ in taken.items():
                list_.append(reading(who, small, large))
    medians = {who: np.median(np.array(rows), axis=0) for who, rows in taken.items()}
    print(f"{SAMPLES} samples of 3 signals, CSV of {size / 1e6:.0f} MB")
    for who, (wall, cpu, memory) in medians.items():
        print(f"{who:9} {wall:6.2f} s, {cpu:5.2f} s of CPU, {memory / 2**20:5.0f} MiB")
    wall, cpu, memory = medians["plantfit"] / medians["polars"]
    print(f"plantfit over polars: {wall:.2f} of the time, {cpu:.2f} of the CPU time, {memory:.2f} of the memory")
    return {
        "reading_time_over_polars": float(wall),
        "reading_cpu_over_polars": float(cpu),
        "reading_memory_over_polars": float(memory),
    }


def memory() -> None:
    """Bytes of memory for a byte of the file, by format and kind of content."""
    from scipy.io import savemat

    n = 400_000
    long = frame(n)
    short = long.select(pl.int_range(n).alias("t [s]"), pl.lit(1).alias("u [V]"))
    with tempfile.TemporaryDirectory() as folder:
        for what, content in (("17 digits", long), ("short cells", short)):
            arrays: dict[str, Any] = {name.split()[0]: content[name].to_numpy() for name in content.columns}
            text = content.write_csv()
            writers = {
                "csv": lambda p, text=text: p.write_text(text),
                "quoted.csv": lambda p, text=text: p.write_text(
                    text + '"1e9",' + ",".join("1" for _ in text.split("\n")[0].split(",")[1:])
                ),
                "csv.gz": lambda p, text=text: _packed(p, text),
                "parquet": lambda p, content=content: content.write_parquet(p),
                "npz": lambda p, arrays=arrays: np.savez(p, **arrays),
                "compressed.npz": lambda p, arrays=arrays: np.savez_compressed(p, **arrays),
                "mat": lambda p, arrays=arrays: savemat(p, arrays),
                "compressed.mat": lambda p, arrays=arrays: savemat(p, arrays, do_compression=True),
                "xlsx": lambda p, content=content: _sheet(p, content.head(60_000)),
            }
            for ending, write in writers.items():
                small, large = Path(folder, f"small.{ending}"), Path(folder, f"large.{ending}")
                write(large)
                frame(100).write_csv(small.with_suffix(".csv"))
                _, _, grown = reading("plantfit", small.with_suffix(".csv"), large)
                print(
                    f"{what:12} {ending:15} {large.stat().st_size / 1e6:7.2f} "
                    f"MB, {grown / large.stat().st_size:6.1f} bytes for a byte",
                    flush=True,
                )


def _packed(path: Path, text: str) -> None:
    import gzip

    path.write_bytes(gzip.compress(text.encode(), 6))


def _sheet(path: Path, content: pl.DataFrame) -> None:
    from openpyxl import Workbook

    book = Workbook(write_only=True)
    sheet = book.create_sheet()
    for row in [content.columns, *content.iter_rows()]:
        sheet.append(row)
    book.save(path)


if __name__ == "__main__":
    memory() if sys.argv[1:] == ["memory"] else run(False)
