"""`plantfit record`: play an excitation on a board and keep what it measures."""

import dataclasses
from typing import TYPE_CHECKING

from plantfit.cli.arguments.quantities import quantity
from plantfit.cli.terminal.interrupts import stoppable
from plantfit.cli.terminal.live_plot import live_plot
from plantfit.cli.terminal.out import out, print_json, warn
from plantfit.errors import Interrupted

if TYPE_CHECKING:
    from plantfit.rig.board.pilot import Loop

SECONDS = 10.0  # of a loop whose file does not tell how long it takes


def record(
    port: str,
    excitation: str | None,
    controller: str | None,
    place: str,
    duration: str | None,
    rate: str | None,
    baud: int,
    wait: str,
    force: bool,
    json: bool,
) -> None:
    """Record until the excitation, the set points or the duration are over, or until Ctrl-C, which stops the motor
    first."""
    from plantfit.recording import read_csv
    from plantfit.rig import board

    played = None if excitation is None or controller is not None else read_csv(excitation)
    loop = None if controller is None else _loop(controller, excitation, quantity("--duration", duration, "s"))
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
                loop=loop,
            )
            stopped = stopping()
    except KeyboardInterrupt:
        raise Interrupted(
            f"Ended at once; the motor was told to stop. What came is in {place}, or in {place}.part."
        ) from None
    if json:
        plain = {
            f.name: getattr(told, f.name) for f in dataclasses.fields(told) if f.name not in ("board", "path", "log")
        }
        print_json({"file": str(told.path), "board": told.board.name, **plain})
    else:
        for line in told.log:
            out.print(line, markup=False)
        out.print(f"Written: {told.path} ({told.seconds:.1f} s)", markup=False)
    if not told.stopped:
        warn("The board did not acknowledge the stop: make sure that the motor stands before you touch it.")
    if stopped and not told.complete:
        raise Interrupted(
            f"Stopped after {told.played} of {told.values} values of the excitation; {told.path} holds what came."
        )


def _loop(controller: str, set_points: str | None, duration: float | None) -> "Loop":
    """A tuned controller with its set points: those of a file or text, else the step that it was tuned for, half the
    time each level."""
    from plantfit.rig.board.pilot import Loop
    from plantfit.rig.offered.driven import driven_by
    from plantfit.rig.offered.tuned import read_tuned

    tuned = read_tuned(controller)
    s, unit = tuned.settings, tuned.output_unit or "1"
    given = set_points or f"{tuned.set_point - tuned.step!r},{tuned.set_point!r}"
    wanted, told = driven_by(given, tuned.output, unit, duration or tuned.seconds or SECONDS, s.period)
    times = wanted.t - wanted.t[0]
    sentence = (
        f"Driven from {tuned.output} by the {tuned.form} of {tuned.name}, every {s.period:g} s; set points: {told}"
    )
    return Loop(
        tuned.running(), s.period, tuned.output, tuned.output_unit, tuned.input, tuned.input_unit, s.lower, s.upper,
        times,
        wanted[tuned.output], duration or float(times[-1]), sentence,
    )  # fmt: skip
