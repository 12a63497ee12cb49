"""Arithmetic, comparisons and casts: each node becomes one LLVM instruction per vector, or a scalar one when it does
not vary."""

from plantfit.native.emit.emitter import Emitter
from plantfit.native.emit.llvm_text import BYTES, REGISTER, SUFFIX, float_literal
from plantfit.native.graph.nodes import BOOL, F64, U32, Node
from plantfit.native.unsupported import NativeUnsupported

_BINARY_F64 = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
_BINARY_INT = {"add": "add", "sub": "sub", "mul": "mul", "div": "sdiv", "rem": "srem", "and": "and", "or": "or",
               "xor": "xor",
               "shl": "shl", "srl": "lshr", "sra": "ashr"}  # fmt: skip
_UNSIGNED = {"div": "udiv", "rem": "urem"}
_UNARY_F64 = {
    "floor": "floor",
    "ceil": "ceil",
    "abs": "fabs",
    "sqrt": "sqrt",
    "roundeven": "roundeven",
    "round": "round",
}
_FLOAT_TEST = {"eq": "oeq", "ne": "une", "lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge"}
_INT_TEST = {"eq": "eq", "ne": "ne", "lt": "slt", "le": "sle", "gt": "sgt", "ge": "sge"}
_UINT_TEST = {"eq": "eq", "ne": "ne", "lt": "ult", "le": "ule", "gt": "ugt", "ge": "uge"}


def emit_instruction(e: Emitter, node: Node) -> None:
    """Define a scalar node; raises NativeUnsupported for an operation without an instruction."""
    vector = e.varies(node)
    rows = e.operands(node.args, vector)
    e.define(node, [instruction(e, node, row, vector) for row in rows])


def instruction(e: Emitter, node: Node, args: list[str], vector: bool) -> str:
    """The register of one vector of a node, or of the one number, given the registers of its arguments."""
    op, dtype = node.op, node.dtype
    kind, suffix = e.type_of(dtype, vector), (f"v{e.width}" if vector else "") + SUFFIX[REGISTER[dtype]]
    if op == "neg":
        return e.put(f"fneg {kind} {args[0]}")
    if op == "rcp":
        return e.put(f"fdiv {kind} {float_literal(1.0, vector)}, {args[0]}")
    if op in _BINARY_F64 and dtype == F64:
        return e.put(f"{_BINARY_F64[op]} {kind} {args[0]}, {args[1]}")
    if op in _BINARY_INT:
        name = _UNSIGNED.get(op, _BINARY_INT[op]) if dtype == U32 else _BINARY_INT[op]
        return e.put(f"{name} {kind} {args[0]}, {args[1]}")
    if op in _UNARY_F64:
        return e.call(kind, f"llvm.{_UNARY_F64[op]}.{suffix}", (kind, args[0]))
    if op == "copysign":
        return e.call(kind, f"llvm.copysign.{suffix}", (kind, args[0]), (kind, args[1]))
    if op == "fma":
        return fused(e, node.data, kind, suffix, args)
    if op in _FLOAT_TEST:
        return _comparison(e, node, args, vector)
    if op == "select":
        return e.put(f"select {e.type_of(BOOL, vector)} {args[0]}, {kind} {args[1]}, {kind} {args[2]}")
    if op == "to_int":
        return _to_int(e, node, args[0], vector)
    if op in ("convert", "bits", "float"):
        return _cast(e, node, args[0], vector)
    raise NativeUnsupported(op)


def fused(e: Emitter, signs: tuple[bool, bool], kind: str, suffix: str, args: list[str]) -> str:
    """a b + c in one rounding; `signs` negate the product and c."""
    a, b, c = args
    if signs[0]:
        a = e.put(f"fneg {kind} {a}")
    if signs[1]:
        c = e.put(f"fneg {kind} {c}")
    return e.call(kind, f"llvm.fma.{suffix}", (kind, a), (kind, b), (kind, c))


def _comparison(e: Emitter, node: Node, args: list[str], vector: bool) -> str:
    """Ordered, so false for NaN, but `ne` is true for it."""
    dtype = node.args[0].dtype
    kind = e.type_of(dtype, vector)
    if dtype == F64:
        return e.put(f"fcmp {_FLOAT_TEST[node.op]} {kind} {args[0]}, {args[1]}")
    return e.put(f"icmp {(_UINT_TEST if dtype == U32 else _INT_TEST)[node.op]} {kind} {args[0]}, {args[1]}")


def _to_int(e: Emitter, node: Node, value: str, vector: bool) -> str:
    """Truncate and saturate; NaN gives 0. `node.data`: the value is known to be NaN or in the range of int32."""
    source, target = e.type_of(F64, vector), e.type_of(node.dtype, vector)
    if not node.data:
        lanes = f"v{e.width}" if vector else ""
        name = f"llvm.fptosi.sat.{lanes}{SUFFIX[REGISTER[node.dtype]]}.{lanes}f64"
        return e.call(target, name, (source, value))
    ordered = e.put(f"fcmp ord {source} {value}, {float_literal(0.0, vector)}")
    value = e.put(
        f"select {e.type_of(BOOL, vector)} {ordered}, {source} {value}, {source} {float_literal(0.0, vector)}"
    )
    return e.put(f"fptosi {source} {value} to {target}")


def _cast(e: Emitter, node: Node, value: str, vector: bool) -> str:
    """Conversion, or ("bits", "float") reinterpretation between float64 and int64."""
    (source,) = node.args
    old, new = e.type_of(source.dtype, vector), e.type_of(node.dtype, vector)
    if node.op != "convert":
        return e.put(f"bitcast {old} {value} to {new}")
    if node.dtype == F64:
        return e.put(f"{'uitofp' if source.dtype in (U32, BOOL) else 'sitofp'} {old} {value} to {new}")
    before, after = (1 if d == BOOL else 8 * BYTES[d] for d in (source.dtype, node.dtype))
    if before == after:
        return value
    kind = "trunc" if before > after else "zext" if source.dtype in (U32, BOOL) else "sext"
    return e.put(f"{kind} {old} {value} to {new}")
