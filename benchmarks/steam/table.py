"""`python -m benchmarks.steam.table`: one table of the engine, the C twin and the other solvers on workload S."""

import importlib.util
import os
from collections.abc import Callable, Mapping
from typing import Any

import plantfit.runtime  # noqa: F401  (one XLA thread before jax starts)
from benchmarks.data import Steam, steam
from benchmarks.steam.interleaved import Timing, interleaved
from benchmarks.steam.numpy_twin import check
from benchmarks.steam.rivals import Rival, solvers, twins
from benchmarks.steam.twin import twin

BATCHES = (1, 20, 200)
AGREEMENT = 1e-12  # relative, of the C costs with numpy's


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures; QUICK takes three turns instead of five and leaves out the tight
    tolerances."""
    data = steam()
    _check_twin(data)
    own = _own()
    rows = twins(data, BATCHES) | solvers(data, quick)
    calls: dict[str, Callable[[], Any]] = {label: call for label, (call, _) in own.items() if callable(call)}
    timings = interleaved(calls | {label: rival.call for label, rival in rows.items()}, 3 if quick else 5)
    ours = {label: (timings[label] if callable(value) else value, batch) for label, (value, batch) in own.items()}
    print(
        "24 400 samples, 310 parameters; one thread; medians; errors "
        "against Radau at the truth; a batch is drawn over the box"
    )
    print(f"{'':34}{'batch':>6}{'first':>9}{'ms each':>10}{'CPU ms':>10}{'per CPU s':>10}{'max error':>13}")
    for label, (timing, batch) in ours.items():
        _print(label, timing, batch, None)
    for label, rival in rows.items():
        _print(label, timings[label], rival.batch, rival.error)
    return _figures(ours, rows, timings)


def _own() -> Mapping[str, tuple[Any, int]]:
    """The engine's rows {label: (call or timing, batch)}; none while benchmarks/steam/ours.py is missing."""
    if importlib.util.find_spec("benchmarks.steam.ours") is None:
        return {}
    return importlib.import_module("benchmarks.steam.ours").ours()


def _check_twin(data: Steam) -> None:
    for scheme in ("exponential", "ros2"):
        engine = twin(data, scheme)
        if engine is None:
            return
        difference = check(engine)
        if not difference < AGREEMENT:
            raise RuntimeError(
                f"twin.c ({scheme}) differs from numpy by {difference:.1e}, "
                f"more than {AGREEMENT:g}; do not trust its timing."
            )


def _print(label: str, timing: Any, batch: int, error: float | None) -> None:
    wall, cpu = timing.median / batch, getattr(timing, "cpu", float("nan")) / batch
    shown = "" if error is None else f"{error:9.1e} bar"
    print(
        f"{label:34}{batch:6d}{timing.first:7.2f} "
        f"s{1e3 * wall:10.3f}{1e3 * cpu:10.3f}{batch / _seconds(timing):10.0f}{shown:>13}"
    )


def _figures(
    ours: Mapping[str, tuple[Any, int]], rows: Mapping[str, Rival], timings: Mapping[str, Timing]
) -> dict[str, float]:
    """Candidates or gradients per CPU second of every rival, and the rate of each row of ours over theirs: over the
    C twin at the same batch, over the solvers at any; costs with costs, gradients with gradients, nothing with a row
    that is neither."""
    figures = {f"steam {label} per second": rival.batch / _seconds(timings[label]) for label, rival in rows.items()}
    for mine, (timing, batch) in ours.items():
        for label, rival in rows.items():
            alike = rival.kind == _kind(mine) and (rival.batch == batch or not label.startswith("C twin"))
            if alike:
                figures[f"steam {mine} over {label}"] = (
                    _seconds(timings[label], timing) / rival.batch / (_seconds(timing) / batch)
                )
    return {name.replace(",", "").replace(" ", "_"): value for name, value in figures.items()}


def _kind(label: str) -> str:
    return next((kind for kind in ("gradient", "jacobian") if kind in label.lower()), "cost")


def _seconds(timing: Any, beside: Any = None) -> float:
    """CPU seconds, which other work on the machine disturbs less, if both have them; else the wall clock's."""
    both = hasattr(timing, "cpu") and (beside is None or hasattr(beside, "cpu"))
    return timing.cpu if both else timing.median


if __name__ == "__main__":
    run(os.environ.get("QUICK", "") not in ("", "0"))
