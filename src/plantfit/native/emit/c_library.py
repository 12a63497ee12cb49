"""Calls of the C library, lane by lane."""

from plantfit.native.emit.emitter import Emitter
from plantfit.native.emit.llvm_text import Lanes
from plantfit.native.graph.nodes import F64, Node


def emit_libm(e: Emitter, node: Node) -> None:
    """A C function of the arguments."""
    e.libm[node.data] = len(node.args)
    vector = e.varies(node)
    e.define(node, _calls(e, node.data, e.operands(node.args, vector), vector))


def emit_patched(e: Emitter, node: Node) -> None:
    """The first argument, but the C function of the third in lanes where the second holds; a branch, rarely taken."""
    near, where, x = node.args
    varying = e.varies(node)
    e.libm[node.data] = 1
    kind = e.type_of(F64, varying)
    masks, values = e.operand(where, varying), e.operand(near, varying)
    slots = e.filled_slots(kind, values)
    far, end = e.name("far"), e.name("near")
    e.line(f"br i1 {e.any_lane(masks) if varying else masks[0]}, label %{far}, label %{end}")
    e.label(far)
    slow = _calls(e, node.data, e.operands([x], varying), varying)
    for slot, value, mask, other in zip(slots, values, masks, slow, strict=True):
        (chosen,) = e.selected(F64, varying, [mask], [other], [value])
        e.line(f"store {kind} {chosen}, ptr {slot}")
    e.line(f"br label %{end}")
    e.label(end)
    e.define(node, [e.put(f"load {kind}, ptr {slot}") for slot in slots])


def _calls(e: Emitter, name: str, rows: list[list[str]], vector: bool) -> Lanes:
    kind = e.type_of(F64, vector)
    function = f"lanes_{name}" if vector else name
    return [e.put(f"call {kind} @{function}({', '.join(f'{kind} {a}' for a in row)})") for row in rows]


def lanes_function(name: str, count: int, width: int) -> str:
    """The definition of `lanes_name`: a C function of `count` arguments applied to each lane of vectors."""
    vector = f"<{width} x double>"
    lines = [f"declare double @{name}({', '.join(['double'] * count)}) nounwind"]
    lines.append(
        f"define internal {vector} @lanes_{name}({', '.join(f'{vector} %a{i}' for i in range(count))}) noinline #0 {{"
    )
    value = "poison"
    for lane in range(width):
        lines.extend(f"  %x{lane}_{i} = extractelement {vector} %a{i}, i64 {lane}" for i in range(count))
        lines.append(f"  %y{lane} = call double @{name}({', '.join(f'double %x{lane}_{i}' for i in range(count))})")
        lines.append(f"  %r{lane} = insertelement {vector} {value}, double %y{lane}, i64 {lane}")
        value = f"%r{lane}"
    return "\n".join([*lines, f"  ret {vector} {value}", "}"])
