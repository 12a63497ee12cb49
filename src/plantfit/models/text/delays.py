"""delay(x, time) in equations, x an input or a state: each becomes a channel beside the inputs."""

from collections.abc import Mapping
from dataclasses import replace

from plantfit.errors import EquationError
from plantfit.models.model import Declared, Delay
from plantfit.models.parts.switching import StateDelay
from plantfit.models.text.declarations import Declarations
from plantfit.models.text.expression import Node
from plantfit.models.text.suggest import suggest


class DelayTable:
    """Collects the delays of a model while its expressions are rewritten.

    A fixed time (a number in s, or a constant) becomes a parameter with a value, so that the
    simulation knows one kind of delay only.
    """

    def __init__(self, declared: Declarations, text: str):
        self.declared = declared
        self.text = text
        self.delays: dict[str, Delay] = {}
        self.state_delays: dict[str, StateDelay] = {}
        self.hidden: dict[str, Declared] = {}
        self.times: list[Node] = []  # names of parameters and constants, for the unit check

    def rewrite(self, node: Node) -> Node:
        """The expression with every delay replaced by the name of its channel."""
        if node.op != "delay":
            return replace(node, args=tuple(self.rewrite(a) for a in node.args)) if node.args else node
        delayed, time = node.args
        known = [*self.declared.inputs, *self.declared.states]
        if delayed.op != "name" or delayed.name not in known:
            message = f"The first argument of delay() is the name of an input or a state, one of {', '.join(known)}."
            message += suggest(delayed.name, known)
            raise EquationError(message, self.text, *delayed.start)
        parameter = self._parameter(delayed.name, time)
        channel = f"delay({delayed.name}, {parameter})"
        if delayed.name in self.declared.inputs:
            self.delays[channel] = Delay(channel, delayed.name, parameter)
        else:
            self.state_delays[channel] = StateDelay(channel, delayed.name, parameter)
        return Node("name", node.place, node.start, name=channel)

    @property
    def channels(self) -> set[str]:
        """Names of all channels."""
        return {*self.delays, *self.state_delays}

    def channel_units(self) -> Mapping[str, str | None]:
        """Units of the channels, those of their inputs and states."""
        inputs = {d.channel: self.declared.inputs[d.input] for d in self.delays.values()}
        return inputs | {d.channel: self.declared.states[d.state] for d in self.state_delays.values()}

    def _parameter(self, delayed: str, time: Node) -> str:
        if time.op == "number":
            return self._fixed(delayed, time.number, time)
        if time.op == "name" and time.name in self.declared.parameters and time.name not in self.declared.tables:
            self.times.append(time)
            return time.name
        if time.op == "name" and time.name in self.declared.constants:
            self.times.append(time)
            return self._fixed(delayed, self.declared.constants[time.name].value, time)
        names = set(_names(time))
        moving = sorted(names & {*self.declared.inputs, *self.declared.states})
        if moving or names & {"t"}:
            message = (
                "A dead time has to be a parameter, a constant or a number of seconds: one that changes with "
                f"{', '.join(moving) or 'time'} is not there yet. Write delay({delayed}, L) with a parameter L, which "
                "holds for one operating point, and let it differ between recordings with per_recording = true."
            )
            raise EquationError(message, self.text, *time.start)
        known = [*(p for p in self.declared.parameters if p not in self.declared.tables), *self.declared.constants]
        given = f"{time.name!r} is none of them" if time.op == "name" else "this is none of them"
        message = (
            "The second argument of delay() is a parameter, a constant or a number of seconds, "
            f"and {given}.{suggest(time.name, known)} Known are {', '.join(known) or 'none'}."
        )
        raise EquationError(message, self.text, *time.start)

    def _fixed(self, delayed: str, seconds: float, time: Node) -> str:
        if seconds < 0:
            raise EquationError(
                f"A delay of {seconds:g} s looks into the future; write a time of 0 s or more.", self.text, *time.start
            )
        if seconds == 0 and delayed in self.declared.states:
            raise EquationError(f"A state 0 s ago is the state itself; write {delayed}.", self.text, *time.start)
        taken = self.declared.names()
        k = 1
        while True:
            name = f"delay_of_{delayed}" if k == 1 else f"delay_of_{delayed}_{k}"
            if name in self.hidden and self.hidden[name].value == seconds:
                return name
            if name not in self.hidden and name not in taken:
                sentence = f"Fixed delay of {delayed}, written in the equations."
                self.hidden[name] = Declared(name, unit="s", value=seconds, sentence=sentence)
                return name
            k += 1


def _names(node: Node) -> list[str]:
    """All names in an expression."""
    return [*([node.name] if node.op == "name" else []), *(name for a in node.args for name in _names(a))]
