"""Looks at a signal that other packages bring (docs/plug-ins.md)."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from plantfit.errors import RecordingError
from plantfit.plugins import offered
from plantfit.recording.looks.look import Look
from plantfit.recording.record import Recording


def looks_of_packages(recording: Recording, name: str, measured: bool) -> Iterator[Look]:
    """What functions of other packages find odd about a signal; one that fails or gives something else is told as
    such."""
    for plugin in offered("looks").values():
        ends = (float(recording.t[0]), float(recording.t[-1]))
        try:
            look = plugin.load(RecordingError)
            found = look(recording, name, measured)
            listed = [] if found is None else list(found) if isinstance(found, Iterable) else [found]
            wrong = next((f for f in listed if not isinstance(f, Look)), None)
            if wrong is not None:
                raise TypeError(f"it gives a {type(wrong).__name__}, not a Look")
            if odd := [f.level for f in listed if f.level not in ("info", "warning")]:
                raise ValueError(f"its level is {odd[0]!r}, not 'info' or 'warning'")
        except Exception as failure:  # whatever the package does
            told = (
                f"The look {plugin.name!r} of the package {plugin.package} failed at {name} ({type(failure).__name__}: "
                f"{str(failure)[:200]}); update or uninstall {plugin.package}."
            )
            told = str(failure) if isinstance(failure, RecordingError) else told
            yield Look("look that failed", "info", recording.name, name, told, *ends)
            continue
        yield from (replace(f, recording=recording.name, signal=name) for f in listed)
