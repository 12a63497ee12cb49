"""The command line: every command is a thin layer over the same Python calls.

Exit codes: 0 done; 2 wrong arguments; 3 recording; 4 unit; 5 model or equation; 6 parameters;
7 study file; 8 search; 9 simulation; 10 store; 11 missing extra; 12 file system or memory; 13 board;
70 an error inside plantfit, with a log; 130 stopped by Ctrl-C.
"""

import io
import os
import sys
import warnings
from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperGroup

from plantfit.cli.terminal.failures import INSIDE, inside, shortened
from plantfit.cli.terminal.interrupts import SENTENCE, ending, watched, with_cause
from plantfit.cli.terminal.overview import SECTIONS, sections
from plantfit.errors import Interrupted, PlantfitError, PlantfitWarning


class _Commands(TyperGroup):
    """The commands; one that Ctrl-C stops says so, unless it has a sentence of its own."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise Interrupted(with_cause(SENTENCE)) from None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for title, rows in sections(self.list_commands(ctx)):
            with formatter.section(title):
                formatter.write_dl(rows)
        formatter.write("\n`plantfit COMMAND --help` says more of each. Your own recording: `plantfit init FILE`.\n")


app = typer.Typer(
    cls=_Commands,
    name="plantfit",
    help="From recordings of machines and processes to physical parameters that can be trusted.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

for rows in SECTIONS.values():
    for name, (command, _) in rows.items():
        app.command(name)(command)


def run_cli() -> None:
    """Entry point: every error becomes one sentence and an exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a name that the terminal cannot show must not end the command
            stream.reconfigure(errors="backslashreplace")
    with watched(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those of numpy and jax are for programmers
        warnings.simplefilter("always", PlantfitWarning)
        warnings.showwarning = _told
        code = _ended(lambda: app(standalone_mode=True))
        ending()
    if code:
        sys.exit(code)


def _ended(command: Callable[[], Any]) -> int:
    """The exit code of a command, after the sentence about its error if there was one."""
    try:
        command()
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else 0 if stop.code is None else 1
    except PlantfitError as error:
        ending()
        return _failed(str(error), error.exit_code)
    except BrokenPipeError:  # as in `plantfit list | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as error:
        place = f" {error.filename!r}" if error.filename else ""
        return _failed(
            f"the file system refused{place}: {error.strerror or error}. "
            "Free space or choose another place and run again.",
            12,
        )
    except KeyboardInterrupt:
        ending()
        return _failed("stopped before any work began.", 130)
    except MemoryError:
        return _failed(
            "the memory of this machine is not enough for this; use fewer samples, runs or workers, and run again.", 12
        )
    except Exception as error:
        return _failed(inside(error), INSIDE)
    return 0


def _failed(sentence: str, code: int) -> int:
    print(f"plantfit: {shortened(sentence)}", file=sys.stderr)
    return code


def _told(message: Any, category: Any, *place: Any, **more: Any) -> None:
    print(f"plantfit: {shortened(str(message))}", file=sys.stderr)
