"""Values that loops and branches hand on: numbers in stack slots, which LLVM promotes to registers, and arrays in
memory."""

from collections.abc import Sequence

from plantfit.native.emit.emitter import Emitter
from plantfit.native.emit.llvm_text import Lanes
from plantfit.native.emit.storage import Storage, copy
from plantfit.native.graph.nodes import Node

Place = list[str] | Storage  # the slots of a number or the memory of an array


def initial_places(e: Emitter, params: Sequence[Node], begin: Sequence[Node]) -> list[Place]:
    """Places of the parameters of a loop, holding the initial values."""
    places: list[Place] = []
    for param, first in zip(params, begin, strict=True):
        varying = e.varies(param)
        if param.size is None:
            kind = e.type_of(param.dtype, varying)
            places.append(e.filled_slots(kind, e.operand(first, varying)))
        else:
            target = e.reserve(param.dtype, param.size, not varying)
            copy(e, e.storage(first), target)
            places.append(target)
    return places


def fetch(e: Emitter, node: Node, place: Place) -> None:
    """Define a node as what its place holds."""
    if isinstance(place, Storage):
        e.bind(node, place)
    else:
        e.define(node, load_slots(e, node, place))


def load_slots(e: Emitter, node: Node, slots: Sequence[str]) -> Lanes:
    """What the slots of a number hold."""
    kind = e.type_of(node.dtype, e.varies(node))
    return [e.put(f"load {kind}, ptr {slot}") for slot in slots]


def renew(e: Emitter, params: Sequence[Node], results: Sequence[Node], places: Sequence[Place]) -> None:
    """Store the results of an iteration for the next; inactive lanes keep what they had."""
    arrays: list[tuple[Storage, Storage]] = []
    own = {p.pointer for p in places if isinstance(p, Storage)}
    for result, place in zip(results, places, strict=True):
        if isinstance(place, Storage) and e.storage(result).pointer != place.pointer:
            source = e.storage(result)
            if source.pointer in own:  # two arrays that change places
                source = e.reserve(place.dtype, place.size, place.flat)
                copy(e, e.storage(result), source)
            arrays.append((source, place))
    for source, place in arrays:
        copy(e, source, place, e.mask)
    for param, result, place in zip(params, results, places, strict=True):
        if not isinstance(place, Storage):
            renew_number(e, param, e.operand(result, e.varies(param)), place)


def renew_one(e: Emitter, node: Node, result: Node, place: Place) -> None:
    """Store a result in the place of a node, in the active lanes."""
    if isinstance(place, Storage):
        copy(e, e.storage(result), place, e.mask)
    else:
        renew_number(e, node, e.operand(result, e.varies(node)), place)


def renew_number(e: Emitter, node: Node, values: Lanes, slots: Sequence[str]) -> None:
    """Store values in the slots of a node, in the active lanes."""
    varying = e.varies(node)
    kind = e.type_of(node.dtype, varying)
    for u, (slot, value) in enumerate(zip(slots, values, strict=True)):
        if varying and e.mask is not None:
            old = e.put(f"load {kind}, ptr {slot}")
            (value,) = e.selected(node.dtype, True, [e.mask[u]], [value], [old])
        e.line(f"store {kind} {value}, ptr {slot}")
