"""Parsers in C that end the process at some broken files are tried in another process first."""

import subprocess
import sys
from pathlib import Path

from plantfit.errors import RecordingError

SECONDS = 60.0  # a file of some GiB takes less
_TRY = "import sys\nfrom scipy.io import loadmat\ntry:\n    loadmat(sys.argv[1], simplify_cells=True)\nexcept Exception:\n    pass"


def check_mat(file: Path) -> None:
    """Raise RecordingError for a MATLAB file at which scipy's reader crashes or does not end (found by tests/fuzz, scipy 1.17)."""
    if not sys.executable:
        return
    why = "does not end"
    try:
        tried = subprocess.run([sys.executable, "-I", "-c", _TRY, str(file.resolve())], capture_output=True, timeout=SECONDS)
        if tried.returncode >= 0:
            return
        why = "crashes"
    except subprocess.TimeoutExpired:
        pass
    except OSError:  # no process can be made here
        return
    raise RecordingError(f"{file.name} is damaged: reading it as a MATLAB file {why}; save it anew with '-v7'.")
