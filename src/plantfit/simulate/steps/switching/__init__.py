"""What happens inside a step: events, dry friction that sticks, backlash.

`declared` reads what a model declares, `switched` is a step that is cut where something happens, `crossings` finds the
place.
"""

from plantfit.simulate.steps.switching.backlash import with_backlash
from plantfit.simulate.steps.switching.declared import bind_backlash, bind_event, bind_friction
from plantfit.simulate.steps.switching.events import with_events
from plantfit.simulate.steps.switching.friction import with_friction
from plantfit.simulate.steps.switching.switched import Switching, values_of

__all__ = [
    "Switching",
    "bind_backlash",
    "bind_event",
    "bind_friction",
    "values_of",
    "with_backlash",
    "with_events",
    "with_friction",
]
