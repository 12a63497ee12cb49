"""What a virtual rig gives: the recording, and beside it what no bench could know."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plantfit.errors import RecordingError
from plantfit.recording.record import Recording
from plantfit.recording.write import to_csv


@dataclass(frozen=True)
class RigRun:
    """`recording`: what the sensors said. `exact`: the same signals and further ones without their faults.

    `truth`: parameter values, settings and the seed, JSON types only.
    """

    recording: Recording
    exact: Recording
    truth: Mapping[str, Any]

    def save(self, folder: str | Path) -> Path:
        """Write NAME.csv (for `read_csv`) and NAME_truth.json into `folder` and return the path of the table.

        Raises RecordingError where the folder cannot be written to.
        """
        folder, name = Path(folder), self.recording.name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{name}_truth.json").write_text(json.dumps(self.truth, indent=2) + "\n", "utf-8")
        except OSError as error:
            raise RecordingError(
                f"Folder {str(folder)!r} cannot take the run ({error.strerror}); choose another place."
            ) from None
        return to_csv(self.recording, folder / f"{name}.csv")
