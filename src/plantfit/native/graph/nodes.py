"""The intermediate representation between jaxpr and LLVM: nodes in static single assignment form, in nested regions.

A node is a number per lane (`size` None) or a small array in memory (`size` entries). Regions nest as loops and
branches do; the region of depth 0 is the prologue, which runs once ahead of the time loop.
"""

import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

F64, I64, I32, U32, BOOL = "f64", "i64", "i32", "u32", "bool"
INTEGERS = (I32, I64, U32)
NUMPY = {
    F64: np.dtype(np.float64),
    I64: np.dtype(np.int64),
    I32: np.dtype(np.int32),
    U32: np.dtype(np.uint32),
    BOOL: np.dtype(np.bool_),
}


@dataclass(eq=False, slots=True, repr=False)
class Node:
    """`op` applied to `args`; `data` holds what is not a node (a constant, an offset, regions)."""

    op: str
    args: tuple["Node", ...]
    dtype: str
    data: Any = None
    size: int | None = None
    depth: int = 0


@dataclass(eq=False, slots=True)
class Region:
    """The code of a loop body, branch or prologue: parameters, nodes in order, results."""

    depth: int
    params: list[Node] = field(default_factory=list)
    code: list[Node] = field(default_factory=list)
    results: list[Node] = field(default_factory=list)
    known: dict[Any, Node] = field(default_factory=dict, repr=False)  # nodes by value number


def regions_of(node: Node) -> tuple[Region, ...]:
    """The regions inside a `loop`, `while` or `cond` node."""
    return node.data if node.op in ("loop", "while", "cond") else ()


class Graph:
    """Builds nodes with value numbering (equal nodes are one) and hoists loop invariants to the prologue."""

    def __init__(self) -> None:
        self.prologue = Region(0)
        self.stack = [self.prologue]
        self._constants: dict[Any, Node] = {}

    def open(self) -> Region:
        """Enter a new region inside the current one."""
        self.stack.append(Region(len(self.stack)))
        return self.stack[-1]

    def close(self) -> None:
        """Leave the current region."""
        self.stack.pop()

    def param(self, dtype: str, size: int | None = None) -> Node:
        """A carried value of the current region."""
        node = Node("param", (), dtype, None, size, self.stack[-1].depth)
        self.stack[-1].params.append(node)
        return node

    def const(self, value: Any, dtype: str) -> Node:
        """A constant of the code."""
        value = NUMPY[dtype].type(value)
        key = dtype, struct.pack("d", value) if dtype == F64 else int(value)
        if key not in self._constants:
            self._constants[key] = Node("const", (), dtype, value)
        return self._constants[key]

    def number(self, value: float) -> Node:
        return self.const(value, F64)

    def make(
        self, op: str, args: tuple[Node, ...] = (), dtype: str = F64, data: Any = None, size: int | None = None
    ) -> Node:
        """A node in the current region, or an equal one that exists already; `data` must be hashable or hold
        regions."""
        if op in ("loop", "while", "cond"):
            return self._place(Node(op, args, dtype, data, size, self.stack[-1].depth), self.stack[-1])
        key = op, tuple(map(id, args)), dtype, data, size
        for region in reversed(self.stack):
            if key in region.known:
                return region.known[key]
        region = self._home(op, args)
        node = self._place(Node(op, args, dtype, data, size, region.depth), region)
        region.known[key] = node
        return node

    def _home(self, op: str, args: tuple[Node, ...]) -> Region:
        """The prologue for loop invariants, else the current region."""
        invariant = op != "xload" and all(a.depth == 0 for a in args)
        return self.prologue if invariant else self.stack[-1]

    def _place(self, node: Node, region: Region) -> Node:
        region.code.append(node)
        return node


def walk(region: Region) -> Iterator[Node]:
    """Every node of a region and of the regions inside it."""
    for node in region.code:
        yield node
        for inner in regions_of(node):
            yield from walk(inner)


def count_uses(regions: Iterable[Region]) -> Counter[int]:
    """How often nodes are arguments or results in these regions and those inside them, by id."""
    uses: Counter[int] = Counter()
    for region in (inner for top in regions for inner in all_regions(top)):
        uses.update(id(a) for n in region.code for a in n.args)
        uses.update(id(r) for r in region.results)
    return uses


def all_regions(region: Region) -> Iterator[Region]:
    """A region and those inside it."""
    yield region
    for node in region.code:
        for inner in regions_of(node):
            yield from all_regions(inner)
