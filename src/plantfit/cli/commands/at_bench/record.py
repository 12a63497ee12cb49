"""`plantfit record`: play an excitation on a board and keep what it measures."""

import dataclasses

from plantfit.cli.arguments.quantities import quantity
from plantfit.cli.terminal.interrupts import stoppable
from plantfit.cli.terminal.live_plot import live_plot
from plantfit.cli.terminal.out import out, print_json, warn
from plantfit.errors import Interrupted


def record(
    port: str, excitation: str | None, place: str, duration: str | None, rate: str | None, baud: int, wait: str, force: bool, json: bool
) -> None:
    """Record until the excitation or the duration is over, or until Ctrl-C, which stops the motor first."""
    from plantfit.recording import read_csv
    from plantfit.rig import board

    played = None if excitation is None else read_csv(excitation)
    stopped = False
    sentence = "Stopping the motor, then the recording. Ctrl-C again ends at once."
    at_once = "Ended at once; make sure that the motor stands."
    try:
        with stoppable(sentence, lambda: at_once, cleans_up=True) as stopping, live_plot(json) as plot:
            told = board.record(
                port,
                place,
                played,
                duration=quantity("--duration", duration, "s"),
                rate=quantity("--rate", rate, "Hz"),
                baud=baud,
                reconnect=quantity("--reconnect", wait, "s") or 0.0,
                force=force,
                stopping=stopping,
                watch=plot,
            )
            stopped = stopping()
    except KeyboardInterrupt:
        raise Interrupted(f"Ended at once; the motor was told to stop. What came is in {place}, or in {place}.part.") from None
    if json:
        plain = {f.name: getattr(told, f.name) for f in dataclasses.fields(told) if f.name not in ("board", "path", "log")}
        print_json({"file": str(told.path), "board": told.board.name, **plain})
    else:
        for line in told.log:
            out.print(line, markup=False)
        out.print(f"Written: {told.path} ({told.seconds:.1f} s)", markup=False)
    if not told.stopped:
        warn("The board did not acknowledge the stop: make sure that the motor stands before you touch it.")
    if stopped and not told.complete:
        raise Interrupted(f"Stopped after {told.played} of {told.values} values of the excitation; {told.path} holds what came.")
