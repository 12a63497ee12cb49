"""Where the command `plantfit` begins: Ctrl-C is watched before anything large is imported."""

import signal

from plantfit import collector
from plantfit.cli.terminal.interrupts import watched


def run() -> None:
    """The command line, and the end of the process; see main.py."""
    collector.seldom()
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
        collector.left()


def _stopped() -> int:
    import sys

    from plantfit.cli.terminal.interrupts import EXIT_CODE, ending

    ending()
    print("plantfit: stopped before any work began.", file=sys.stderr)
    return EXIT_CODE
