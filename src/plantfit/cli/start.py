"""Where the command `plantfit` begins: Ctrl-C is watched before anything large is imported."""

import gc
import signal

from plantfit.cli.terminal.interrupts import watched

# A command makes a million objects that stay, most of them by importing jax. At Python's own 700 new objects the
# collector of cycles walks through them again and again, which takes a sixth of a `plantfit check`; at its end another
# third is one walk through all of them.
COLLECTED = (50_000, 20, 20)


def run() -> None:
    """The command line, and the end of the process; see main.py."""
    gc.set_threshold(*COLLECTED)
    try:
        with watched():
            try:
                from plantfit.cli.main import run_cli
            except KeyboardInterrupt:
                raise SystemExit(_stopped()) from None
            run_cli()
    finally:
        # everything is said and saved: a late Ctrl-C must not end what libraries do at exit in a traceback
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        gc.freeze()  # what is left goes with the process; `atexit` and finalizers run as ever


def _stopped() -> int:
    import sys

    from plantfit.cli.terminal.interrupts import EXIT_CODE, ending

    ending()
    print("plantfit: stopped before any work began.", file=sys.stderr)
    return EXIT_CODE
