"""A controller that `plantfit tune` wrote, NAME-tune.json, for a rig to be driven by."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains, Settings, pid
from plantfit.errors import SimulationError
from plantfit.simulate.loop.controller import Controller


@dataclass(frozen=True)
class Tuned:
    """A PID by its `gains` and `settings`, its `output` and `input` with their units (None: not known), and the step it was tuned for,
    to `set_point` by `step`, in the unit of the output."""

    gains: Gains
    settings: Settings
    output: str
    output_unit: str | None
    input: str
    input_unit: str | None
    set_point: float
    step: float
    name: str

    @property
    def law(self) -> Controller:
        """The controller with its limits."""
        s = self.settings
        return pid(s.period, lower=s.lower, upper=s.upper, anti_windup=s.anti_windup, tracking_time=s.tracking_time)


def read_tuned(path: str | Path) -> Tuned:
    """The controller of a file NAME-tune.json. Raises SimulationError for any other file."""
    place = Path(path)
    try:
        return _tuned(json.loads(place.read_text("utf-8")), place.name)
    except OSError as error:
        raise SimulationError(
            f"The controller {str(path)!r} cannot be read ({error.strerror}); name a file that `plantfit tune` wrote."
        ) from None
    except (ValueError, KeyError, IndexError, TypeError, AttributeError):
        raise SimulationError(f"{str(path)!r} is no controller; name a file NAME-tune.json that `plantfit tune` wrote.") from None


def _tuned(record: dict[str, Any], name: str) -> Tuned:
    best, w = record["controllers"][0], record["wishes"]
    gains = Gains(**{n: float(best[n]) for n in ("Kp", "Ki", "Kd", "b", "filter_time")}, c=0.0)
    settings = Settings(float(w["period"]), float(w["lower"]), float(w["upper"]), w["anti_windup"], w.get("tracking_time"))
    out, into = record["output"], record["input"]
    return Tuned(
        gains, settings, out["name"], out["unit"], into["name"], into["unit"], float(w["set_point"]), float(w["step"]), name
    )  # fmt: skip
